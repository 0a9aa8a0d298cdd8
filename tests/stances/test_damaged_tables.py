"""Tables whose files were altered after they were written: used as before, or built anew."""

import logging
import os
import re
from collections import OrderedDict

import numpy as np
import pytest
from fuzz import damaged, few
from hypothesis import given
from hypothesis import strategies as st
from small_tables import small_table

from mlivr_gym import files
from mlivr_gym.compiled.cached_files import cached_files, mark_used
from mlivr_gym.stances import table_files
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.parts import Parts
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_files import CHECKED, TableError

PAGE = 4096


@pytest.fixture(scope="module")
def known():
    return small_table(3)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache folder, and no table in memory."""
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path))
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    return tmp_path


def found(graph):
    """The table that a new process finds."""
    table_files._memory.clear()
    answer = find_table(graph)
    return answer and answer[1].nodes


def is_equal(table, other):
    return all(np.array_equal(*pair) for pair in zip(table, other, strict=True))


def unpacked(known):
    """A table in the cache folder that was checked, and in compressed form."""
    graph, table = known
    TABLES.write(
        graph, GraphTable(table, False), TABLES.cached(graph).with_name(TABLES.name(graph))
    )
    path = TABLES.cache(graph, GraphTable(table, False))
    assert is_equal(found(graph), table)
    return path


def altered(path, content):
    """Replace the content of a file in place, some time later."""
    state = path.stat()
    path.write_bytes(content)
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns + 1))


@pytest.mark.parametrize("at", [0, 1, 5, -1])
def test_a_page_of_zeros_in_a_mapped_table_is_noticed_and_the_table_unpacked_again(
    known, cache, caplog, at
):
    path, (graph, table) = unpacked(known), known
    content = bytearray(path.read_bytes())
    first = at % (len(content) // PAGE) * PAGE
    content[first : first + PAGE] = bytes(PAGE)
    altered(path, bytes(content))
    again = found(graph)
    assert is_close(again, table)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "is damaged" in caplog.text
    caplog.clear()
    assert is_equal(found(graph), again)
    assert not caplog.records


def is_refused(graph, path):
    try:
        TABLES.read(graph, path)
    except TableError:
        return True
    return False


def is_close(table, other):
    """Whether two tables are equal, base positions up to the resolution of a compressed file."""
    return all(np.allclose(*pair, rtol=0, atol=1e-4) for pair in zip(table, other, strict=True))


@few(0.15)
@given(data=st.data())
def test_a_flipped_bit_changes_no_answer(data, known, tmp_path_factory):
    """Wherever it is: in an array, in a header, or in the head and the directory of the archive."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLIVR_GYM_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(table_files, "_memory", OrderedDict())
        path, (graph, table) = unpacked(known), known
        content = bytearray(path.read_bytes())
        heads = [one.start() for one in re.finditer(b"\x93NUMPY", content)]
        near = st.sampled_from(heads).flatmap(lambda i: st.integers(i - 60, i + 160))
        place = data.draw(st.one_of(st.integers(0, len(content) - 1), near), label="byte")
        place = min(max(place, 0), len(content) - 1)
        content[place] ^= 1 << data.draw(st.integers(0, 7), label="bit")
        altered(path, bytes(content))
        # What was noticed once is not taken for checked.
        assert is_refused(graph, path) == is_refused(graph, path)
        assert is_close(found(graph), table)


@few(0.15)
@given(data=st.data())
def test_a_cut_or_patched_file_changes_no_answer(data, known, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLIVR_GYM_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(table_files, "_memory", OrderedDict())
        path, (graph, table) = unpacked(known), known
        altered(path, data.draw(damaged(path.read_bytes())))
        assert is_close(found(graph), table)


HEADERS = [
    b"{'descr': '<u2', 'fortran_order': False, 'shape': (",
    b"{'descr': '<u2', 'shape': (3,)\n   if", b"(" * 60, b"\\N{x}", b"{'descr': [('a', 'O')]}",
    b"{'descr': '<u2', 'fortran_order': False, 'shape': (-3, 3), }",
    b"{'descr': '<u2', 'fortran_order': False, 'shape': (99999999999999999999, 3), }",
    b"{[]: 1}", b"\xff\xfe", b"__import__('os')", b"'''", b"1if 1else", b"0x",
]  # fmt: skip


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize("mapped", [True, False])
def test_a_header_of_another_kind_is_one_clear_error(known, cache, header, mapped):
    """Also if the checksums of the archive are those of the altered content."""
    graph, table = known
    path = TABLES.cached(graph) if mapped else cache / "given.npz"
    write_with_header(graph, table, path, header, mapped)
    with pytest.raises(TableError, match="is damaged, or not of format"):
        TABLES.read(graph, path)


def write_with_header(graph, table, path, header, mapped):
    """Write a table whose first array has another header."""
    write = np.lib.format.write_array

    def other(stream, array, **_):
        padded = header.ljust(117) + b"\n"
        stream.write(b"\x93NUMPY\x01\x00" + len(padded).to_bytes(2, "little") + padded)
        stream.write(array.tobytes())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.lib.format, "write_array", other)
        arrays = table._asdict() if mapped else TABLES.encode(graph, GraphTable(table, False))
        compression = 0 if mapped else TABLES.compression
        path.write_bytes(TABLES.pack(graph, arrays, compression))
    assert np.lib.format.write_array is write


def test_a_part_of_another_kind_is_computed_again(known, cache):
    parts = Parts.of(known[0], table_files.__file__)
    for header in HEADERS:
        parts.get("first", lambda: [np.arange(5)])
        (file,) = parts.folder.iterdir()
        content = file.read_bytes()
        at = content.index(b"\x93NUMPY") + 10
        file.write_bytes(content[:at] + header.ljust(118)[:118] + content[at + 118 :])
        assert parts.get("first", lambda: [np.arange(7)])[0].tolist() == list(range(7))
        file.unlink()


def test_a_mapped_table_is_checked_once_and_again_when_its_time_differs(known, cache, monkeypatch):
    counted = []
    whole = table_files.zipfile.ZipFile.testzip
    monkeypatch.setattr(
        table_files.zipfile.ZipFile, "testzip", lambda one: counted.append(1) or whole(one)
    )
    path, (graph, _) = unpacked(known), known
    assert len(counted) == 1
    for _ in range(2):
        found(graph)
        mark_used(path)
    assert len(counted) == 1
    os.utime(path)
    found(graph)
    found(graph)
    assert len(counted) == 2
    path.with_name(path.name + CHECKED).unlink()
    found(graph)
    assert len(counted) == 3
    assert path.with_name(path.name + CHECKED) in {one.path for one in cached_files()}


def test_a_table_whose_size_alone_differs_is_checked_again(known, cache):
    """As where it was cut off, and its time was put back."""
    path, (graph, table) = unpacked(known), known
    found(graph)
    content, state = path.read_bytes(), path.stat()
    path.write_bytes(content + bytes(64))
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    checked = path.with_name(path.name + CHECKED)
    before = checked.read_bytes()
    assert is_close(found(graph), table)
    assert checked.read_bytes() != before


def test_a_table_is_on_the_disk_before_it_has_its_name(known, cache, monkeypatch):
    """As a power cut would show: the content first, then the name, then the folder's entry."""
    events = []
    sync, replace = os.fsync, os.replace

    def synced(handle):
        kind = "folder" if os.path.isdir(f"/proc/self/fd/{handle}") else "file"
        events.append((kind, os.fstat(handle).st_size if kind == "file" else 0))
        sync(handle)

    monkeypatch.setattr(files.os, "fsync", synced)
    monkeypatch.setattr(
        files.os, "replace", lambda *names: events.append(("name", 0)) or replace(*names)
    )
    path = TABLES.cache(known[0], GraphTable(known[1], False))
    assert events == [("file", path.stat().st_size), ("name", 0), ("folder", 0)]
