"""Running a study: blocks are computed by an engine, and stored as they are finished.

The folder of a study holds its design, and while it runs one file for each finished block; in the
end a single file, `study.parquet`, with one row for each run. An interrupted study goes on where it
stopped, and only the process that runs the study writes files, each whole: so no run is lost, and
none is there twice.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, as_completed
from pathlib import Path

from mlivr_gym import __version__
from mlivr_gym.arguments import checked
from mlivr_gym.engines import ENGINES, executor_of
from mlivr_gym.errors import SettingError, path_shown
from mlivr_gym.extensions.studies.design import RunBlock, StudyDesign, is_function
from mlivr_gym.extensions.studies.rows import Row, function_run, rows_of
from mlivr_gym.extras import require
from mlivr_gym.files import FileError, read_json, write_whole
from mlivr_gym.schema import Choice, FieldPath
from mlivr_gym.settings import GRAPH_RULES

DESIGN, RESULT, BLOCKS = "design.json", "study.parquet", "blocks"
"""Names of the files of a study, and of the folder of its finished blocks."""

Progress = Callable[[int, int], None]
"""Called with the number of finished runs, and with that of all."""


@checked()
def run_study(
    design: StudyDesign,
    folder: str | Path,
    engine: str | Executor = "local",
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = lambda done, total: None,
    notify: Callable[[str], None] = lambda address: None,
) -> Path:
    """Run a study, or what is left of it, and return the file of its results.

    The rows depend on the design and on the version of the package alone, except for the column
    `seconds`, and for plans of more than two limbs, which a time limit cuts short.

    Parameters
    ----------
    design
        The design.
    folder
        Folder of the study, which is made. It may hold a part of the same study.
    engine
        `"local"`: processes of this machine; `"dask"`; or any executor of `concurrent.futures`,
        such as that of mpi4py, or of a Dask client whose cluster you start yourself.
    workers
        Number of processes; by default one for each core. Of no effect with `scheduler`.
    scheduler
        Address of a running Dask scheduler, such as `"tcp://10.0.0.1:8786"`.
    progress
        Called with the numbers of finished runs and of all runs.
    notify
        Called with the address of Dask's dashboard.

    Raises
    ------
    MlivrError
        If an argument cannot be used, a file cannot be written, the folder holds another study, or
        a process ended.
    """
    if not isinstance(engine, Executor):
        Choice(ENGINES).read(engine, FieldPath("engine", SettingError))
    if scheduler is not None and engine != "dask":
        raise SettingError(f"scheduler={scheduler!r} needs engine='dask'")
    require("pyarrow", extra="study")
    if is_function(design.kind):
        function_run(design.kind, {})
    path = Path(folder)
    _prepare(design, path)
    if (path / RESULT).exists():
        return path / RESULT
    blocks = {block.number: block for block in design.blocks}
    todo = [block for block in blocks.values() if not _file(path, block.number).exists()]
    total = len(design.combinations) * design.tasks
    done = total - sum(len(block.tasks) for block in todo)
    progress(done, total)
    with executor_of(engine, workers, scheduler, notify) as executor:
        for number, rows in _computed(executor, design, todo):
            _write(_file(path, number), rows)
            done += len(rows)
            progress(done, total)
    return _finish(path, len(blocks))


def _computed(
    executor: Executor, design: StudyDesign, todo: list[RunBlock]
) -> Iterator[tuple[int, list[Row]]]:
    """Yield number and rows of each block as soon as it is computed."""
    waiting = {executor.submit(rows_of, design, block): block.number for block in todo}
    for job in as_completed(waiting):
        try:
            yield waiting.pop(job), job.result()
        except BrokenExecutor:
            raise SettingError(
                "a process of the study ended; what is finished is stored, so run the study again "
                "to go on, with fewer workers if memory was short"
            ) from None


def _prepare(design: StudyDesign, path: Path) -> None:
    """Make the folder of a study, or check that it holds a part of the same study."""
    try:
        (path if (path / RESULT).exists() else path / BLOCKS).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise FileError(f"cannot create folder {path_shown(path)}: {reason}") from None
    made_by = {"design": design.to_data(), "version": __version__, "rules": GRAPH_RULES}
    if not (path / DESIGN).exists():
        write_whole(path / DESIGN, json.dumps(made_by, indent=1) + "\n")
        return
    found = read_json(path / DESIGN, "design of a study")
    different = [name for name, value in made_by.items() if found.get(name) != value]
    if different:
        raise SettingError(
            f"folder {str(path)!r} holds a study with another {' and '.join(different)}; "
            "choose another folder"
        )


def _file(path: Path, number: int) -> Path:
    """Return the file of a block."""
    return path / BLOCKS / f"{number:06d}.parquet"


def _write(path: Path, rows: list[Row]) -> None:
    """Write rows to a Parquet file; the types of its columns are those of their values."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    blank = dict.fromkeys(name for row in rows for name in row)
    stream = io.BytesIO()
    pq.write_table(pa.Table.from_pylist([blank | row for row in rows]), stream)
    write_whole(path, stream.getvalue())


def _read(path: Path) -> list[Row]:
    """Return the rows of a Parquet file; raise a `FileError` if it cannot be read."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        rows: list[Row] = pq.read_table(pa.BufferReader(path.read_bytes())).to_pylist()  # no URI
    except (pa.ArrowException, OSError) as fault:
        reason = str(fault).splitlines()[0]
        raise FileError(
            f"cannot read rows of a study: {path_shown(path)} is damaged ({reason}); remove it, "
            "and run the study again"
        ) from None
    return rows


def _finish(path: Path, blocks: int) -> Path:
    """Write the rows of all blocks to one file, and remove those of the blocks."""
    files = [_file(path, number) for number in range(blocks)]
    rows = [row for file in files for row in _read(file)]
    _write(path / RESULT, rows)
    for file in files:
        file.unlink()
    (path / BLOCKS).rmdir()
    return path / RESULT


@checked()
def read_study(folder: str | Path) -> list[Row]:
    """Return the rows of a study that is finished, in the order of its runs.

    Other programs read `study.parquet` with Arrow, pandas, Polars or DuckDB.

    Raises a `FileError` if the folder holds no finished study, or its file cannot be read.
    """
    require("pyarrow", extra="study")
    path = Path(folder) / RESULT
    if not os.path.isfile(path):
        raise FileError(f"folder {path_shown(folder)} holds no finished study: no file {RESULT!r}")
    return _read(path)
