"""The command `info`."""


def test_info_counts(run):
    code, out, _ = run("info")
    assert code == 0
    assert "331 points on 46 tracks" in out
    assert "43540" in out
    assert "handrails: 18" in out
    code, out, _ = run("info", "--robot", "mlivr4")
    assert code == 0
    assert "4 limbs" in out
