"""Figures are written as PNG and as SVG, with the same bytes each time."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from mlivr_gym.files import FileError
from mlivr_gym.pictures.figures import figure_files, save_figure, save_image


def drawn():
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
        save_figure(drawn(), folder / "plan.png")
        assert {path.name for path in folder.iterdir()} == {"plan.png", "plan.svg"}
        seen.append([(folder / f"plan.{kind}").read_bytes() for kind in ("png", "svg")])
    assert seen[0] == seen[1]
    png, svg = seen[0]
    assert png.startswith(b"\x89PNG")
    assert svg.startswith(b"<?xml")
    assert b"a line" in svg
    assert b"<dc:date>" not in svg


@pytest.mark.parametrize(
    ("given", "files"),
    [
        ("a/plan.png", ("a/plan.png", "a/plan.svg")),
        ("a/plan.svg", ("a/plan.png", "a/plan.svg")),
        ("plan.v2.PNG", ("plan.v2.PNG", "plan.v2.svg")),
        ("plan", ("plan", "plan.svg")),
    ],
)
def test_either_file_names_both(tmp_path, given, files):
    assert figure_files(tmp_path / given) == tuple(tmp_path / name for name in files)


@pytest.mark.parametrize("name", ["plan.jpg", "plan.v2"])
def test_a_name_that_promises_another_format_is_refused(tmp_path, name):
    words = f"cannot write a picture as '.*{name}'; valid endings are '.png'"
    with pytest.raises(FileError, match=words):
        save_figure(drawn(), tmp_path / name)
    with pytest.raises(FileError, match=words):
        save_image(np.zeros((4, 4, 3), dtype=np.uint8), tmp_path / name)
    assert not list(tmp_path.iterdir())
