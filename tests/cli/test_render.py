"""The command `render`."""

import numpy as np
from PIL import Image

from mlivr_gym.cli.render import shots_of
from mlivr_gym.errors import RenderError
from mlivr_gym.motion.plan import Plan


def test_render_says_once_that_there_is_no_gl(run, tmp_path, monkeypatch):
    """And draws with matplotlib, which needs none."""

    def missing(*_, **__):
        raise RenderError("MuJoCo has no GL library here")

    monkeypatch.setattr("mlivr_gym.cli.render.SceneRenderer", missing)
    out = tmp_path / "scene.png"
    code, told, _ = run("render", "--start", "D2a:4", "D2b:4", "--out", str(out))
    assert code == 0
    assert [line for line in told.splitlines() if "matplotlib" in line] == [
        "no GL library can be used, so matplotlib draws instead: MuJoCo has no GL library here"
    ]
    assert out.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["scene.png"]


def test_ghosts_stand_in_the_stances_that_follow(plan_file, jem):
    plan = Plan.load(plan_file)
    last = len(plan.stances) - 1
    assert last > 1
    for k, shot in enumerate(shots_of(jem, plan, range(last + 1))):
        bases = [shot.configuration, *shot.ghosts]
        np.testing.assert_array_equal(
            [base for base, *_ in bases], [plan.configuration(n)[0] for n in range(k, last + 1)]
        )
        assert (f"pale: stances {k + 1} to {last}" in shot.captions[0]) == (k < last)
        assert shot.captions[0].startswith(f"stance {k} of {last}")
        assert ("the start" in shot.captions[0]) == (k == 0)
        assert ("the goal" in shot.captions[0]) == (k == last)


def test_render_writes_the_file_that_is_named_and_no_other(run, tmp_path, plan_file):
    """Start and goal side by side, and each of them alone."""
    seen = {}
    for name, extra in (
        ("both.png", []),
        ("start.png", ["--stance", "0"]),
        ("goal.png", ["--stance", "4"]),
    ):
        out = tmp_path / name
        arguments = ["--plan", str(plan_file), "--out", str(out), "--size", "80", "40", *extra]
        code, told, _ = run("render", *arguments)
        assert code == 0
        assert f"picture: {out}" in told
        seen[name] = np.asarray(Image.open(out))
        assert {path.name for path in tmp_path.iterdir()} == set(seen)
    if seen["start.png"].shape == (40, 80, 3):  # rendered, not drawn without a GL library
        np.testing.assert_array_equal(
            seen["both.png"], np.hstack([seen["start.png"], seen["goal.png"]])
        )
    assert (seen["start.png"] != seen["goal.png"]).any()
