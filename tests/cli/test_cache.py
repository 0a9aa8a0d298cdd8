"""The command `cache`: what it lists, and what it removes and leaves alone."""

import json
import os

import pytest

FILES = {
    f"pairs-{'a' * 20}.npz": (3_000, 400),
    f"nodes-{'b' * 20}-unpacked.npz": (49_000, 100),
    f"nodes-{'b' * 20}.npz": (900, 500),
    f"nodes-{'e' * 20}-5.npy": (1_000, 80),
    f"nodes-{'e' * 20}.xz": (100, 550),
    f"sets-{'c' * 20}-{'d' * 16}.npz": (2_000, 300),
    f".pairs-{'a' * 20}.npz.x_1y2z3w": (700, 50),
    f"parts-{'f' * 20}-{'0' * 16}/rows-0-0.npz": (600, 450),
    f"kernels/{'9' * 16}/compiled/one.nbc": (10_000, 350),
    f"kernels/{'8' * 16}/compiled/two.nbc": (20_000, 60),
}
"""Size, and when it was used last, of what is kept."""

OTHERS = (
    "notes.txt",
    "pairs.npz",
    "kernels/readme",
    "photos/one.npz",
    "pairs-a.npz.old",
    "nodes-backup/x",
)
"""Files of the user in the same folder."""


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A folder with all kinds of what is kept, and other files."""
    for k, (name, (size, when)) in enumerate({**FILES, **dict.fromkeys(OTHERS, (9, 1))}.items()):
        path = tmp_path / "cache" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(size))
        # To be read is a use, and so is to be written, where reading is not recorded.
        os.utime(path, (when, 1) if k % 2 else (1, when))
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def left(folder):
    """Files that are there, those of the user aside, which must be."""
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert found >= set(OTHERS)
    return found - set(OTHERS)


def test_what_is_kept_is_listed(run, folder):
    code, out, _ = run("cache")
    assert code == 0
    *lines, total = out.splitlines()
    assert len(lines) == len(FILES) - 1  # machine code in one line
    assert total == f"87.3 kB in {folder}"
    assert any("49 kB" in line and "nodes-bbb" in line and "1970-01-01" in line for line in lines)
    assert "30 kB" in lines[-1]
    assert lines[-1].endswith("kernels  machine code")
    told = json.loads(run("cache", "--json")[1])
    assert told["bytes"] == sum(size for size, _ in FILES.values())
    assert {one["used"] for one in told["tables"]} == {400, 100, 80, 500, 550, 300, 50, 450}
    assert left(folder) == set(FILES)


def test_all_of_it_is_removed_and_nothing_else(run, folder):
    code, out, _ = run("cache", "--clear")
    assert code == 0
    assert out.splitlines() == [f"removed: {len(FILES)} files, 87.3 kB", f"0 B in {folder}"]
    assert not left(folder)


@pytest.mark.parametrize("limit", ["91.2kB", "20 KB", "5e-9 GB", "0"])
def test_what_was_not_used_for_longest_is_removed_until_it_fits(run, folder, limit):
    code, _, err = run("cache", "--limit", limit)
    if "e" in limit:
        assert code == 2
        assert "it must be a size such as 500MB or 2GB" in err
        return
    most = {"91.2kB": 91_200, "20 KB": 20_000, "0": 0}[limit]
    by_use, stay, size = sorted(FILES.items(), key=lambda one: -one[1][1]), set(), 0
    for name, (more, _) in by_use:  # truth: the newest that fit together
        size += more
        if size > most:
            break
        stay.add(name)
    assert code == 0
    assert left(folder) == stay
