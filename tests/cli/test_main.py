"""Usage, exit codes and interruptions of every command."""

import signal
import subprocess
import sys
import time

import pytest

from mlivr_gym.cli.main import main


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan", "--start", "D1a:4", "Q:1"], "'Q:1'"),
        (["plan", "--start", "D1a:4"], "must name 2 points"),
        (["plan", "--goal", "60", "0", "0"], "outside the cabin"),
        (["plan", "--goal", "nan", "0", "0"], "finite"),
        (["plan", "--cost", "fast"], "'fast'"),
        (["plan", "--cost", "weighted"], "regrasp_price"),
        (["plan", "--limb-threshold", "-1"], "limb_threshold"),
        (["plan", "--robot", "robocop"], "'robocop'"),
        (["plan", "--map", "nowhere.json"], "nowhere.json"),
        (["plan", "--out", "no/such/folder/plan.json"], "cannot write"),
        (["render", "--plan", "nowhere.json"], "nowhere.json"),
        (["render", "--size", "1", "1"], "--size"),
        (["render", "--stance", "2"], "--stance needs --plan"),
        (["plan", "--clearance", "1e300"], "clearance is 1e+300, larger than 100 m"),
        (["plan", "--cost", "weighted", "--regrasp-price", "1e300"], "regrasp_price is 1e+300"),
        (["plan", "--box", "3200", "-1000", "-1000", "3500", "1000", "300"], "millimetres"),
        (["plan", "--limit", "0"], "limit is 0"),
        (["evaluate", "--seed", "-1"], "--seed is -1"),
        (["evaluate", "--policy", "astar", "--episodes", "0"], "--episodes is 0"),
        (["evaluate", "--beam", "0"], "--beam is 0"),
        (["train", "--seed", "9" * 30], "--seed is 999"),
        (["dataset", "--episodes", "-3"], "--episodes is -3"),
    ],
)
def test_bad_input_gives_one_sentence_and_code_2(run, arguments, words):
    code, _, err = run(*arguments)
    assert code == 2
    assert words in err
    assert err.startswith("mlivr-gym: ")
    assert err.count("\n") == 1


def test_the_help_tells_the_exit_codes(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capsys.readouterr().out
    assert all(f"\n  {code:<3}  " in out for code in (0, 1, 2, 3, 130))
    assert "no plan" in out


@pytest.mark.parametrize(
    "arguments", [[], ["fly"], ["plan", "--goal", "a", "b", "c"], ["plan", "--wings"]]
)
def test_bad_usage_gives_one_sentence_and_code_2(capsys, arguments):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("command", [[], ["plan"], ["table1"], ["info"], ["render"]])
def test_help(capsys, command):
    with pytest.raises(SystemExit) as stop:
        main([*command, "--help"])
    assert stop.value.code == 0
    out = capsys.readouterr().out
    assert "usage: mlivr-gym" in out
    if command != ["table1"]:
        assert "mlivr-gym plan --start D2a:4 D2b:4" in out


def test_ctrl_c_ends_a_search_with_one_line_and_130(tmp_path):
    """Also in the middle of the compiled search, which would go on for a minute."""
    code = """
import signal
from mlivr_gym import stance_graph
from mlivr_gym.cli.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores the signal
print("ready", flush=True)
exit(main(["plan", "--method", "dijkstra"]))
"""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(2.5)
        process.send_signal(signal.SIGINT)
        began = time.perf_counter()
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert (out, err) == ("", "mlivr-gym: interrupted\n")
    assert time.perf_counter() - began < 10.0


@pytest.mark.parametrize("error", [KeyboardInterrupt(), KeyboardInterrupt("two of three done")])
def test_an_interruption_is_told_in_one_line(run, monkeypatch, error):
    def stop(_):
        raise error

    monkeypatch.setattr("mlivr_gym.cli.info.run", stop)
    code, out, err = run("info")
    assert code == 130
    assert out == ""
    assert err == f"mlivr-gym: {str(error) or 'interrupted'}\n"
