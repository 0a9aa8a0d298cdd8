"""What tells how far a command is: on a terminal alone, and with the time that remains."""

import io
from types import SimpleNamespace

import pytest

from mlivr_gym.cli import progress
from mlivr_gym.cli.progress import Bar, counter, timed_bar

LINE = "\r\x1b[K"


class Stream(io.StringIO):
    """Standard error that is a terminal, or not."""

    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal


@pytest.fixture(params=[True, False], ids=["terminal", "file"])
def stream(request, monkeypatch):
    stream = Stream(request.param)
    monkeypatch.setattr(progress, "sys", SimpleNamespace(stderr=stream))
    return stream


def test_a_timed_bar_shows_share_and_remaining_time(stream, monkeypatch):
    """Ten seconds for a quarter leave thirty for the rest; the end ends the line."""
    clock = [100.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: clock[0])
    show = timed_bar("train")
    show(0, 8, "")
    clock[0] = 110.0
    show(2, 8, "loss 1")
    show(8, 8, "")
    show(0, 0, "")
    shown = [
        f"{LINE}train [{'.' * 24}] 0/8 0<0 s ",
        f"{LINE}train [{'#' * 6}{'.' * 18}] 2/8 10<30 s loss 1",
        f"{LINE}train [{'#' * 24}] 8/8 10<0 s \n",
        f"{LINE}train [{'.' * 24}] 0/0 10<0 s \n",
    ]
    assert stream.getvalue() == ("".join(shown) if stream.terminal else "")


def test_a_bar_is_cleared(stream):
    bar = Bar("steps", 4)
    bar.show(3)
    bar.close()
    shown = [
        f"{LINE}[{'.' * 30}] 0/4 steps",
        f"{LINE}[{'#' * 22}{'.' * 8}] 3/4 steps",
        LINE,
    ]
    assert stream.getvalue() == ("".join(shown) if stream.terminal else "")


def test_a_counter_goes_away_with_a_number_below_zero(stream):
    show = counter("states")
    show(12)
    show(-1)
    assert stream.getvalue() == (f"\r12 states{LINE}" if stream.terminal else "")
