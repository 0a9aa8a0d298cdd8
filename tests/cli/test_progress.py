"""What tells how far a command is: a line that is drawn anew, or lines in a log."""

import io
from types import SimpleNamespace

import pytest

from mlivr_gym.cli import progress
from mlivr_gym.cli.progress import Progress


@pytest.fixture
def clock(monkeypatch):
    """Its time; displays are shown after 2 s, as they ship."""
    now = [100.0]
    monkeypatch.setattr(progress, "SHOW_AFTER", 2.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    return now


def standard_error(monkeypatch, is_terminal):
    stream = io.StringIO()
    stream.isatty = lambda: is_terminal
    monkeypatch.setattr(progress, "sys", SimpleNamespace(stderr=stream))
    return stream


def test_a_log_gets_a_line_now_and_then(clock, monkeypatch):
    """After 2 s, then each time the time has doubled, and once a minute in the end."""
    stream = standard_error(monkeypatch, False)
    shown, told = Progress("states explored"), []
    for second in range(400):
        clock[0] = 100.0 + second
        shown.show(10 * second)
        if len(stream.getvalue().splitlines()) > len(told):
            told.append(second)
    assert told == [2, 4, 8, 16, 32, 64, 124, 184, 244, 304, 364]
    assert stream.getvalue().splitlines()[1] == "40 states explored, 4 s"
    shown.begin("pictures", 5)
    shown.show(0)
    assert len(stream.getvalue().splitlines()) == len(told)
    clock[0] += 30.0
    shown.show(2)
    assert stream.getvalue().splitlines()[-1].endswith("] 2/5, 30 s, 45 s remain")


def test_a_line_says_while_something_is_compiled(clock, monkeypatch):
    """In place of the work for which it is compiled alone, which seems to hang."""
    stream = standard_error(monkeypatch, True)
    monkeypatch.setattr(progress, "compilation", SimpleNamespace(text="compiling check_all"))
    with Progress("building the stance graph") as shown:
        assert progress.displays == [shown]
        clock[0] += 197.0
        shown.show(0)
        told = "\r\x1b[Kbuilding the stance graph, 197 s; compiling check_all"
        assert stream.getvalue() == told
        clock[0] += 1.0
        shown.show(0, "bound 1.2")
        assert stream.getvalue().endswith("graph, 198 s; bound 1.2; compiling check_all")
    assert progress.displays == []


CARRY = """carry --robot mlivr3 --cargo 9 0.2 0.2 0.2 --start D3a:8 D3a:1 D3a:4 --pick D2b:3
--stow F2b:4 --limb 0"""
LINES = """
info                      : mlivr_gym.stances.build.list_stances
simulate --plan PLAN      : mlivr_gym.stances.build.list_stances
simulate --plan PLAN      : mlivr_gym.simulation.timing.plan_trajectory
simulate --plan PLAN      : mlivr_gym.simulation.execution.execute
plan                      : mlivr_gym.planners.Planner.plan
plan --refined            : mlivr_gym.planners.Planner.refined
plan --tolerance 1e-5     : mlivr_gym.planners.Planner.why_not
render                    : mlivr_gym.cli.render.draw
build                     : mlivr_gym.cli.build.build_table
CARRY                     : mlivr_gym.extensions.cargo.cargo_mission.CargoMission.execute
"""


class Reached(BaseException):
    """What takes long has begun."""


@pytest.mark.parametrize("line", LINES.strip().splitlines())
def test_what_takes_long_is_begun_under_a_line_that_says_what_it_is(
    line, run, monkeypatch, plan_file, tmp_path
):
    words, _, place = line.partition(" : ")
    words = words.replace("PLAN", str(plan_file)).replace("CARRY", CARRY)

    def begun(*_, **__):
        assert progress.displays
        raise Reached

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(place.strip(), begun)
    with pytest.raises(Reached):
        run(words)
