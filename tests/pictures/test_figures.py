"""Figures of plans, walks and executions show the numbers that they stand for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from recordings import resting

from mlivr_gym import Box
from mlivr_gym.files import FileError
from mlivr_gym.pictures import plan_figures as module
from mlivr_gym.pictures import simulation_figures
from mlivr_gym.pictures.figures import (
    BASE_COLOUR,
    GOAL_COLOUR,
    figure_files,
    save_figure,
    save_image,
)
from mlivr_gym.pictures.map_views import FROM_ABOVE, FROM_THE_SIDE, IN_SPACE
from mlivr_gym.pictures.plan_figures import BOX_COLOUR, parts_of, plan_figure
from mlivr_gym.pictures.route import plan_base_path
from mlivr_gym.pictures.simulation_figures import SHADES, simulation_figure
from mlivr_gym.planners import Planner
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.simulation.recording import Capture, Failure

VIEWS = (IN_SPACE, FROM_ABOVE, FROM_THE_SIDE)


@pytest.fixture
def kept(monkeypatch):
    """The figures that would be written."""
    figures = []
    for one in (module, simulation_figures):
        monkeypatch.setattr(one, "save_figure", lambda figure, path: figures.append(figure))
    return figures


def path_of(axes):
    """The thick green line of a view."""
    (path,) = (line for line in axes.lines if to_hex(line.get_color()) == BASE_COLOUR)
    return np.array(path.get_data_3d() if axes.name == "3d" else path.get_data()).T


def test_the_figure_of_a_plan_shows_path_stances_goal_and_numbers(kept, checked_graph, plan, jem):
    """Footholds in the flat views; the numbers of the plan in the line above them."""
    tree = np.random.default_rng(0).uniform(1.0, 2.0, (7000, 2, 3))
    plan_figure(checked_graph.grasp_map, plan, "plan.png", tree, "Case 3")
    (drawn,) = kept
    held = [[stance[limb] for stance in plan.stances] for limb in range(2)]
    for axes, view in zip(drawn.axes, VIEWS, strict=True):
        numbers = [text.get_text() for text in axes.texts]
        assert numbers == [str(k) for k in range(len(plan.stances))]
        np.testing.assert_allclose(path_of(axes), plan_base_path(plan)[:, view])
        gold = [to_hex(c) for part in axes.collections for c in part.get_edgecolor()]
        assert GOAL_COLOUR in gold + [to_hex(line.get_color()) for line in axes.lines]
        if view == IN_SPACE:
            continue
        dots = {part.get_label(): np.array(part.get_offsets()) for part in axes.collections}
        for limb, points in enumerate(held):
            places = jem.positions[[jem.index(point) for point in points]][:, view]
            np.testing.assert_allclose(dots[f"footholds of limb {limb}"], places)
    told = " ".join(text.get_text() for text in drawn.texts)
    assert (
        f"{len(plan.steps)} steps, base translation {plan.base_translation:.2f} m, "
        f"minimum $w_m$ {plan.motion.w_m.min():.3f}, minimum $w_b$ {plan.motion.w_b.min():.4f}, "
        f"{plan.statistics.expanded} states expanded (2334 of 7000 drawn)"
    ) in told


BOX = Box.between("cargo", "obstacle", (3.0, -0.2, -0.2), (3.4, 0.2, 0.2))


def test_the_figure_of_a_walk_shows_what_was_walked_and_the_box(kept, graph):
    """Of two plans, the first abandoned after a step."""
    planner = Planner(graph)
    first = planner.plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    second = planner.plan(first.stances[1], (6.3, 0.5, 0.35), "base").unwrap()
    walked = [(first, 1), (second, len(second.steps))]
    module.walk_figure(graph.grasp_map, walked, "walk.png", [BOX])
    (figure,) = kept
    walked = np.vstack([parts_of(first, 1)[0], plan_base_path(second)])
    stances = np.vstack([first.motion.base_positions[:2], second.motion.base_positions[1:]])
    for axes, view in zip(figure.axes, VIEWS, strict=True):
        np.testing.assert_allclose(path_of(axes), walked[:, view])
        assert len(axes.texts) - (view == IN_SPACE) == len(stances)  # and the name of the box
        if view != IN_SPACE:
            (box,) = (one for one in axes.patches if to_hex(one.get_facecolor()) == BOX_COLOUR)
            np.testing.assert_allclose(np.ptp(box.get_xy(), axis=0), [0.4, 0.4])
            np.testing.assert_allclose(box.get_xy().min(axis=0), BOX.bounds[0][list(view)])
    length = np.linalg.norm(np.diff(stances, axis=0), axis=1).sum()
    told = [text.get_text() for text in figure.texts]
    assert f"{len(stances) - 1} steps, base translation {length:.2f} m" in told
    whole = plan_base_path(first)
    assert len(first.steps) > 1
    for taken in range(len(first.steps) + 1):
        walked, abandoned = parts_of(first, taken)
        np.testing.assert_allclose(np.vstack([walked, abandoned[1:]]), whole, atol=1e-12)


@pytest.fixture
def recording():
    """A step of 20 s at random, of which the phases end at 5 s and 15 s, and a capture at 20 s."""
    rng, times = np.random.default_rng(0), 0.1 * np.arange(230)
    return replace(
        resting(len(times)),
        times=times,
        phase=(times > 4.95).astype(int) + (times > 14.95),
        joint_torques=rng.normal(size=(len(times), 2, 6)),
        grasp_forces=rng.normal(size=(len(times), 2, 3)),
        base_errors=1e-3 * rng.uniform(size=len(times)),
    )


CAPTURE = Capture(20.0, 0, 1, "D2a:4", 0.001, 0.01)


def curves(panel):
    """Lines along the whole recording, by colour."""
    return {to_hex(line.get_color()): line for line in panel.lines if len(line.get_xdata()) > 99}


def test_an_execution_is_drawn_as_it_was_recorded(kept, recording):
    failure = Failure("collision", 21.5, 0, "swing", -1, "it touches", {})
    simulation_figure(recording, (CAPTURE,), failure, "x.png", "A walk")
    (figure,) = kept
    whole, largest, forces, errors = figure.axes
    (rms,) = curves(whole).values()
    mean = [np.mean(torques**2) for torques in recording.joint_torques]
    np.testing.assert_allclose(rms.get_xydata(), np.transpose([recording.times, np.sqrt(mean)]))
    for limb in range(2):
        colour = to_hex(LIMB_COLOURS[limb])
        torques = [np.abs(one).max() for one in recording.joint_torques[:, limb]]
        np.testing.assert_allclose(curves(largest)[colour].get_ydata(), torques)
        assert curves(largest)[colour].get_label() == f"limb {limb}"
        force = [np.sqrt(one @ one) for one in recording.grasp_forces[:, limb]]
        np.testing.assert_allclose(curves(forces)[colour].get_ydata(), force)
    (millimetres,) = curves(errors).values()
    np.testing.assert_allclose(millimetres.get_ydata(), 1e3 * recording.base_errors)
    for panel in figure.axes:
        spans = {to_hex(span.get_facecolor()): span for span in panel.patches}
        for phase, begin, end in ((0, 0.0, 4.9), (2, 15.0, 22.9)):
            span = spans[SHADES[phase][1]]
            assert (span.get_x(), span.get_width()) == pytest.approx((begin, end - begin))
        marked = [line.get_xdata()[0] for line in panel.lines if len(line.get_xdata()) == 2]
        assert {20.0, 21.5} <= set(marked)
    assert "failed at 21.50 s: it touches" in [text.get_text() for text in figure.texts]


def test_a_spike_at_a_capture_is_cut_off_and_its_height_written(kept, recording):
    forces = np.clip(recording.grasp_forces, -1.0, 1.0)
    forces[205] = (30.0, 0.0, 40.0)
    recording = replace(recording, grasp_forces=forces)
    simulation_figure(recording, (CAPTURE,), None, "x.png", "A walk")
    panel = kept[0].axes[2]
    usual = np.linalg.norm(np.delete(forces, range(200, 210), axis=0), axis=2).max()
    assert panel.get_ylim() == pytest.approx((0.0, 1.45 * usual))
    assert [text.get_text() for text in panel.texts] == ["\u2191 50"]


def some_figure():
    figure = Figure(figsize=(2.0, 1.5))
    axes = figure.add_subplot()
    axes.plot([0, 1, 2], [2, 0, 1], label="a line", clip_on=True)
    axes.imshow(np.arange(6.0).reshape(2, 3), extent=(0, 1, 0, 1))
    axes.legend()
    return figure


def test_a_figure_is_written_twice_and_each_time_alike(tmp_path):
    seen = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        save_figure(some_figure(), folder / "plan.png")
        assert {path.name for path in folder.iterdir()} == {"plan.png", "plan.svg"}
        seen.append([(folder / f"plan.{kind}").read_bytes() for kind in ("png", "svg")])
    assert seen[0] == seen[1]
    png, svg = seen[0]
    assert png.startswith(b"\x89PNG")
    assert svg.startswith(b"<?xml")
    assert b"a line" in svg
    assert b"<dc:date>" not in svg


def test_either_file_names_both_and_no_other_format_may_be_promised(tmp_path):
    for given, files in (
        ("a/plan.png", ("a/plan.png", "a/plan.svg")),
        ("a/plan.svg", ("a/plan.png", "a/plan.svg")),
        ("plan.v2.PNG", ("plan.v2.PNG", "plan.v2.svg")),
        ("plan", ("plan", "plan.svg")),
    ):
        assert figure_files(Path(given)) == tuple(map(Path, files))
    picture = np.zeros((4, 4, 3), dtype=np.uint8)
    for name in ("plan.jpg", "plan.v2"):
        for save, what in ((save_figure, some_figure()), (save_image, picture)):
            with pytest.raises(FileError, match=f"as '.*{name}'; valid endings are '.png'"):
                save(what, tmp_path / name)
    assert not list(tmp_path.iterdir())
