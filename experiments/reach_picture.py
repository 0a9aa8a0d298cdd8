"""Draw after how many steps each point of the JEM can be grasped from a start.

    python experiments/reach_picture.py [--out docs/pictures]

Writes `reach.png`.
"""

from __future__ import annotations

from reports import command_line, two_limb_graph

from mlivr_gym.pictures.reach_figure import reach_figure
from mlivr_gym.planners.reach import reach_from
from mlivr_gym.world.grasp_map import as_map

START = ("D2a:4", "D2b:4")
"""Start of the example of `mlivr-gym plan`."""


def main() -> None:
    """Search from the start and draw the points."""
    out = command_line(__doc__, out="docs/pictures").parse_args().out
    graph = two_limb_graph(as_map("jem"))
    path = out / "reach.png"
    reach_figure(graph.grasp_map, reach_from(graph, START), path, "Reach of mlivr2 in the JEM")
    path.with_suffix(".svg").unlink()


if __name__ == "__main__":
    main()
