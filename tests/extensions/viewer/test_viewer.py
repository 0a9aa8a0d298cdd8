"""What follows from what people do on the page; nothing is drawn in a browser here."""

import threading

import numpy as np
import pytest
from recordings import recording_of

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

from mlivr_gym.extensions.viewer import drawing
from mlivr_gym.extensions.viewer import viewer as viewers
from mlivr_gym.extensions.viewer.frames import STEP_TIME, load_frames
from mlivr_gym.extensions.viewer.viewer import add_panel
from mlivr_gym.world.boxes import Box


def said(viewer, name):
    """Words in the panel."""
    return viewer.page.items[name].content


def node(viewer, name):
    """Something that is drawn."""
    return viewer.page.nodes[name]


def index(viewer, point):
    """Index of a point."""
    return viewer.live.graph.grasp_map.index(point)


def test_the_robot_is_where_the_frame_has_it(viewer, walk):
    viewer.seek(2 * STEP_TIME)
    np.testing.assert_allclose(
        node(viewer, "robot/base").position, walk.motion.base_positions[2], atol=1e-6
    )
    assert "step 3 of 4" in node(viewer, "now").text
    viewer.seek(99.0)
    assert node(viewer, "now").text == "stance 4 of 4"
    assert viewer.time == viewer.frames.duration


def test_playing_goes_on_to_the_end_and_begins_again(viewer):
    viewer.tick()
    assert viewer.time == 0.0
    viewer.toggle()
    viewer.tick()
    assert viewer.time == pytest.approx(viewers.TICK)
    viewer.speed = 1000.0
    viewer.tick()
    assert (viewer.time, viewer.playing) == (viewer.frames.duration, False)
    viewer.toggle()
    assert (viewer.time, viewer.playing) == (0.0, True)
    viewer.scrub(7.0)
    assert (viewer.time, viewer.playing) == (7.0, False)


@pytest.mark.parametrize("name", ["change", "refresh", "seek", "toggle", "tick"])
def test_what_one_visitor_does_waits_for_what_another_is_doing(viewer, name):
    done = threading.Event()
    given = {"change": [done.set], "seek": [1.0]}.get(name, [])
    thread = threading.Thread(target=lambda: (getattr(viewer, name)(*given), done.set()))
    with viewer._lock:
        thread.start()
        assert not done.wait(0.2)
    thread.join()
    assert done.is_set()


def darkened(viewer):
    """How many points are dark, since they are occupied."""
    faces = set(viewer.live.graph.grasp_map.faces)
    nodes = (viewer.page.nodes[f"points/{face}"] for face in faces)
    return sum(int((node.batched_colors.max(axis=1) < 50).sum()) for node in nodes)


def test_a_click_blocks_a_point(viewer, walk):
    point = walk.steps[0].to_point
    viewer.click = viewers.BLOCK
    viewer.clicked(index(viewer, point))
    assert point not in {step.to_point for step in viewer.live.plan.steps}
    assert darkened(viewer) == 1
    viewer.clicked(index(viewer, point))
    assert darkened(viewer) == 0


def test_a_click_explains_why_a_point_cannot_be_held(viewer):
    viewer.clicked(index(viewer, "D2b:4"))
    told = said(viewer, "explanation")
    assert told.startswith("**D2b:4**, deck")
    assert "limb 0: point 'D2b:4' is held by limb 1" in told


def test_why_there_is_no_plan_is_said(viewer):
    x = viewer.live.graph.grasp_map.positions[:, 0]
    viewer.live.graph.occupy(np.flatnonzero((x > 2.9) & (x < 4.6)).tolist())
    viewer.change(viewer.live.replan)
    assert "No plan" in said(viewer, "summary")
    assert "plan/path" not in viewer.page.nodes


def test_what_cannot_be_changed_is_said(viewer):
    viewer.change(lambda: viewer.live.graph.occupy(["X9:9"]))
    assert "X9:9" in said(viewer, "summary")


def test_a_plan_is_drawn_with_its_footholds(viewer, walk):
    drawn, grasp_map = viewer.page.nodes, viewer.live.graph.grasp_map
    held = [*walk.stances[0], *(step.to_point for step in walk.steps)]
    points = grasp_map.positions[[grasp_map.index(point) for point in held]]
    places = np.concatenate([walk.motion.base_positions, points])
    for k, position in enumerate(places):
        np.testing.assert_allclose(drawn[f"plan/ball{k}"].position, position)
    assert f"plan/ball{len(places)}" not in drawn


def test_obstacles_of_the_world_are_drawn(viewer):
    box = Box.between("crate", "obstacle", (0.2, 0.0, 0.0), (0.4, 0.3, 0.1))
    viewer.change(lambda: viewer.live.graph.add_obstacles([box]))
    vertices = node(viewer, "obstacles/0").vertices
    np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], box.bounds, atol=1e-6)


def test_without_a_plan_no_robot_is_shown(page, live):
    """Not even at first, when there was no other."""
    live.plan = None
    live.replan(start=("D2a:4", "O2a:4"))
    viewer = viewers.Viewer(page, live)
    add_panel(viewer)
    assert "No plan" in said(viewer, "summary")
    assert not node(viewer, "robot").visible
    viewer.change(lambda: live.replan(start=("D2a:4", "D2b:4")))
    assert live.plan is not None
    assert node(viewer, "robot").visible


def test_near_walls_are_left_out(viewer):
    low, high = viewer.live.graph.grasp_map.cabin
    middle, aft, above = 0.5 * (low + high), np.array([0.0, 6.0, 0.0]), np.array([0.0, 0.0, 6.0])
    faces = {name for name in viewer.page.nodes if name.startswith("points/")}
    for eye, hidden in ((middle, set()), (middle - aft, {"forward"}),
                        (middle + aft + above, {"aft", "overhead"})):  # fmt: skip
        drawing.hide_walls(viewer.page, viewer.live.graph.grasp_map, eye)
        assert {name for name in faces if not node(viewer, name).visible} == {
            f"points/{face}" for face in hidden
        }
        assert not any(node(viewer, f"module/{face}").visible for face in hidden)


def test_an_execution_is_played_until_it_is_planned_anew(page, live, walk, tmp_path):
    recording = recording_of(walk)
    np.savez(tmp_path / "simulation.npz", **recording.arrays())
    viewer = viewers.Viewer(page, live, load_frames(tmp_path / "simulation.npz", walk))
    add_panel(viewer)
    assert viewer.frames.duration == pytest.approx(200.0)
    viewer.seek(120.0)
    at = np.argmin(np.abs(recording.times - recording.times[0] - 120.0))
    place = node(viewer, "robot/base").position
    assert np.linalg.norm(place - recording.base_positions[at]) < 0.1
    viewer.change(live.replan)
    assert viewer.frames.duration == pytest.approx(4 * STEP_TIME)
