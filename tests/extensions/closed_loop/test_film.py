"""The film of a closed loop shows at each time what the robot has seen by then, and no more."""

import mujoco
import numpy as np
import pytest
from gl_there import gl_or_skip
from loop_walks import BAG, GOAL, START
from PIL import Image

from mlivr_gym.errors import MlivrError, RenderError
from mlivr_gym.extensions.closed_loop import film as filming
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.film import closed_loop_film, news_at
from mlivr_gym.extensions.closed_loop.hits import CUBE
from mlivr_gym.extensions.closed_loop.loop import run_closed_loop
from mlivr_gym.extensions.closed_loop.record import STOPPED, ClosedLoopRecord, Event, Footage
from mlivr_gym.pictures import rendering
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.scene import COLOURS, compile_spec, scene_spec

SPEED, SIZE = 10.0, (160, 120)
BOX = mujoco.mjtGeom.mjGEOM_BOX


class WatchedCamera(DepthCamera):
    """Cameras whose hits are kept beside their times."""

    def measure(self, model, data, robot, rng):
        hits = super().measure(model, data, robot, rng)
        HITS.append((data.time, hits))
        return hits


HITS = []


@pytest.fixture(scope="module")
def record(graph):
    """A walk of two steps, in the second of which it sees more of the bag."""
    HITS.clear()
    camera = WatchedCamera(period=0.5, pixels=40)
    return run_closed_loop(
        graph, START, GOAL, unknown=[BAG], camera=camera, max_steps=2, filmed=True
    )


@pytest.fixture(scope="module")
def drawn(graph, record, tmp_path_factory):
    """Time, geoms, route and captions of each picture, by a renderer that keeps what it is told."""
    kept, told, scene_of = [], [], compile_spec(scene_spec(graph.grasp_map, graph.robot))

    class Painter:
        def __init__(self, grasp_map, robot, width, height, obstacles, capsules):
            self.shape = height, width, 3

        def render(self, *_, route, draw, **others):
            scene = mujoco.MjvScene(scene_of, 5000)
            draw(scene)
            kept.append((scene, list(scene.geoms[: scene.ngeom]), route))
            return np.zeros(self.shape, dtype=np.uint8)

        def close(self):
            pass

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mlivr_gym.pictures.films.SceneRenderer", Painter)
        patch.setattr(rendering, "with_caption", lambda one, text, _: told.append(text) or one)
        path = tmp_path_factory.mktemp("film") / "walk.gif"
        closed_loop_film(graph, record, path, unknown=[BAG], size=SIZE, speed=SPEED)
    times = [*np.arange(0.0, record.duration, SPEED / 10.0), record.duration]
    return list(zip(times, kept, zip(told[::2], told[1::2], strict=True), strict=True))


def boxes_of(geoms, opacity):
    """Centre and half edges of the boxes of an opacity."""
    colour = np.array(COLOURS["obstacle"]) * (1.0, 1.0, 1.0, opacity)
    return [
        (geom.pos.copy(), geom.size.copy())
        for geom in geoms
        if geom.type == BOX and np.allclose(geom.rgba, colour, atol=1e-6)
    ]


def hits_until(time):
    """What the cameras have measured at the bag."""
    hits = np.concatenate([hits for at, hits in HITS if at <= time])
    low, high = BAG.bounds + 0.03 * np.array([[-1.0], [1.0]])
    return hits[((hits > low) & (hits < high)).all(axis=1)]


def test_a_picture_shows_what_was_seen_by_then(drawn):
    """Each box has hits of the time before, and each cube with enough of them is in a box."""
    counts = []
    for time, (_, geoms, _), _ in drawn:
        boxes = boxes_of(geoms, 1.0)
        counts.append(len(boxes))
        before, soon = hits_until(time), hits_until(time + 0.02)  # the spacing of the samples
        for centre, half in boxes:
            assert (np.abs(soon - centre) <= half + 1e-6).all(axis=1).any()
        cells = (before / CUBE + 1000.0).astype(int) @ (1, 10_000, 100_000_000)
        _, number, hits = np.unique(cells, return_inverse=True, return_counts=True)
        covered = np.zeros(len(before), dtype=bool)
        for centre, half in boxes:
            covered |= (np.abs(before - centre) <= half + 1e-6).all(axis=1)
        assert covered[hits[number] >= 9].all()
        assert covered.any()
        (pale,) = boxes_of(geoms, filming.UNKNOWN_OPACITY)  # the unknown box
        np.testing.assert_allclose(pale, (BAG.centre, BAG.half), atol=1e-6)
    assert len(set(counts)) > 4  # what is seen changes along the film


def test_a_picture_shows_the_plan_and_tells_the_events_of_its_time(drawn, record):
    begun = [event.time for event in record.events if event.kind == "step"]
    for time, (_, _, route), (clock, news) in drawn:
        done = sum(at <= time for at in begun)
        assert clock == f"{time:.0f} s of {record.duration:.0f} s (x10)"
        if time < record.duration:
            planned = [event for event in record.events if event.kind == "planned"][done]
            assert len(route.stances) == planned.values["steps"] + 1
            last = [event for event in record.events if event.time <= time][-1]
            assert news.endswith(last.line)
    assert drawn[-1][2] == (
        f"{record.duration:.0f} s of {record.duration:.0f} s (x10)",
        "stopped: no arrival within 2 attempted steps",
    )
    events = [Event("end", 3.0, {"outcome": STOPPED, "reason": "no way"})]
    proved = ClosedLoopRecord(STOPPED, "no way", proved=True, events=events)
    told = ["", "stopped, with a proof that there is no plan: no way"]
    assert [news_at(proved, time) for time in (2.0, 3.0)] == told


def test_no_motion_is_missing(graph, record):
    """A limb that is refused goes back, tries again, and goes back again."""
    point = Planner(graph).plan(START, GOAL, "steps").unwrap().steps[0].to_point
    refused = run_closed_loop(graph, START, GOAL, refusing=[point], max_steps=3, filmed=True)
    assert {event.kind for event in refused.events} >= {"refused", "step"}
    for one in (record, refused):
        whole = one.footage.recording
        assert whole.times[0] < 0.05
        assert one.duration - whole.times[-1] < 0.05
        assert np.diff(whole.times).min() > 0.0
        assert np.diff(whole.times).max() < 0.05
        aim = graph.posture_of(one.state).base_position[0]
        np.testing.assert_allclose(whole.base_positions[-1], aim, atol=0.02)


def test_a_film_is_written(graph, record, tmp_path):
    path, shown = tmp_path / "walk.gif", []
    with gl_or_skip():
        closed_loop_film(
            graph, record, path, unknown=[BAG], size=SIZE, speed=40.0, progress=shown.append
        )
    count = int(np.ceil(record.events[-1].time / 4.0)) + 1  # 0, 4, 8 s and so on, and the end
    assert shown == list(range(1, count + 1))
    with Image.open(path) as film:
        assert film.size == SIZE
        assert film.n_frames == count
        first = np.asarray(film.convert("RGB")).astype(int)[: SIZE[1] - 44]
    assert ((first[..., 0] > first[..., 2] + 80).sum()) > 100  # the bag is orange


def test_what_cannot_be_filmed_is_named(graph, record, tmp_path):
    path = tmp_path / "walk.gif"
    with pytest.raises(MlivrError, match="the walk was not filmed"):
        closed_loop_film(graph, ClosedLoopRecord(), path)
    with pytest.raises(MlivrError, match="the robot did not move"):
        closed_loop_film(graph, ClosedLoopRecord(footage=Footage()), path)
    with pytest.raises(RenderError, match=r"valid endings"):
        closed_loop_film(graph, record, tmp_path / "walk.avi")
    assert not list(tmp_path.iterdir())
