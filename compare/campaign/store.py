"""A folder that keeps finished runs, and lets several processes share the work.

``ledger.sqlite`` has one row for each finished run: name, function, settings, inputs, version, result and run time, as
text in JSON; another table has the checksums of rows.  Arrays of a result are in ``arrays/KEY.npz``, written before
the row that holds their checksum.  A process claims a run before it starts it.  A claim holds as long as its owner
lives: the owner holds a lock on its file in ``owners``, which the operating system releases when the process ends,
however it ends.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import sqlite3
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from rigtwin.compare.campaign.run import Result, Run, same_inputs
from rigtwin.compare.result_files import plain, write_arrays
from rigtwin.lab.checksums import json_sha256
from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import DAMAGED
from rigtwin.lab.output_files import locked, remove_leftovers, replacing
from rigtwin.lab.version import __version__

if TYPE_CHECKING:
    import pandas as pd

LEDGER = "ledger.sqlite"
# columns that hold texts; only `seconds` is a number
TEXTS = ("key", "name", "function", "settings", "inputs", "version", "state", "result", "message", "finished")
CONTENT = (*TEXTS, "seconds")  # what the checksum of a row is taken of
JOINED = "runs.*, checksum from runs left join checksums on runs.key = checksums.key"
PATIENCE = 60.0  # [s], waiting for another process that writes to the ledger

TABLES = """
create table if not exists runs (
    key text primary key, name text, function text, settings text, inputs text, version text, state text,
    result text, message text, seconds real, finished text
);
create table if not exists checksums (key text primary key, checksum text);
create table if not exists claims (key text primary key, owner text);
"""


State = Literal["done", "failed"]


@dataclass(frozen=True)
class Kept:
    """A row of the ledger."""

    key: str
    name: str
    function: str
    settings: Mapping[str, Any]
    inputs: Mapping[str, Any]
    version: str
    state: State
    result: Result
    message: str  # why it failed
    seconds: float  # [s], wall-clock time of the run
    finished: str  # UTC, ISO 8601


class Store:
    """A store of runs in a folder.

    Parameters
    ----------
    folder : Path
        Folder of the store.
    create : bool
        Make it if it does not exist.

    Raises
    ------
    BadInput
        If there is no store and `create` is false, or the ledger cannot be opened.
    """

    def __init__(self, folder: Path, *, create: bool = True) -> None:
        self.folder = folder
        path = folder / LEDGER
        if not create and not path.is_file():
            raise BadInput(f"{folder}: is no store of runs (it has no {LEDGER}); check the path.")
        with self._in_words():
            folder.mkdir(parents=True, exist_ok=True)
            self._ledger = sqlite3.connect(path, timeout=PATIENCE, isolation_level=None, check_same_thread=False)
            self._ledger.row_factory = sqlite3.Row
            self._ledger.text_factory = lambda stored: stored.decode(errors="replace")  # damaged text is shown as such
            try:
                self._ledger.execute("pragma journal_mode = wal")
                self._ledger.executescript(TABLES)
                self._need_columns()
            except BaseException:
                self._ledger.close()
                raise
        self._owner = _Owner(folder / "owners")

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give back all claims and close the ledger."""
        if self._owner.started:
            with suppress(BadInput), self._transaction():
                self._ledger.execute("delete from claims where owner = ?", (self._owner.token,))
                self._tidy()
        self._owner.end()
        self._ledger.close()

    def find(self, runs: Iterable[Run]) -> dict[str, Result]:
        """Return the results of the runs that have finished.

        Parameters
        ----------
        runs : iterable of Run
            Runs that are looked up.

        Returns
        -------
        dict of str to Result
            By the name of the run.
        """
        found = {}
        for run in runs:
            row = self._row(run)
            if row is not None and (result := self._result(row)):
                found[run.name] = result
        return found

    def failure(self, run: Run) -> str:
        """Return why a run failed before.

        Parameters
        ----------
        run : Run
            Run that may have failed.

        Returns
        -------
        str
            Empty where it did not.
        """
        row = self._row(run, "failed")
        return "" if row is None else str(row["message"])

    def keep(self, run: Run, result: Result, seconds: float) -> None:
        """Keep the result of a finished run; its claim ends.

        Parameters
        ----------
        run : Run
            Run that has finished.
        result : Result
            What the run returned.
        seconds : float
            Its run time [s].
        """
        arrays = {name: value for name, value in result.items() if isinstance(value, np.ndarray)}
        others = {name: value for name, value in result.items() if name not in arrays}
        listed = {"names": list(arrays), "sha256": write_arrays(self._arrays(run.key), arrays)} if arrays else {}
        self._insert(run, "done", json.dumps({**plain(others), "arrays": listed}), "", seconds)

    def keep_failure(self, run: Run, message: str, seconds: float) -> None:
        """Keep why a run failed; its claim ends.

        Parameters
        ----------
        run : Run
            Run that failed.
        message : str
            Why it failed.
        seconds : float
            Its run time [s].
        """
        self._insert(run, "failed", "{}", message, seconds)

    def claim(self, run: Run) -> Literal["ours", "theirs", "done"]:
        """Claim a run for this process, unless it has finished or another living process has claimed it.

        Parameters
        ----------
        run : Run
            Run to be computed.

        Returns
        -------
        {"ours", "theirs", "done"}
            Who has it.
        """
        with self._transaction():
            if not self._owner.started:
                self._tidy()
                self._owner.start()
            row = self._row(run)
            if row is not None and self._result(row):
                return "done"
            held = self._ledger.execute("select owner from claims where key = ?", (run.key,)).fetchone()
            if held is not None and self._owner.another_lives(held["owner"]):
                return "theirs"
            self._ledger.execute("insert or replace into claims values (?, ?)", (run.key, self._owner.token))
        return "ours"

    def release(self, run: Run) -> None:
        """End the claim of a run that has no result.

        Parameters
        ----------
        run : Run
            Run that was claimed.
        """
        with self._in_words():
            self._ledger.execute("delete from claims where key = ? and owner = ?", (run.key, self._owner.token))

    def rows(self) -> list[Kept]:
        """All runs of the ledger, oldest first; results without their arrays; damaged rows are left out."""
        return [
            Kept(
                row["key"], row["name"], row["function"], _parsed(row["settings"]), _parsed(row["inputs"]),
                row["version"], row["state"], _parsed(row["result"]), row["message"], float(row["seconds"]),
                row["finished"],
            )
            for row in self._all() if _whole(row)
        ]  # fmt: skip

    def damaged(self) -> int:
        """Number of rows that cannot be read, or were changed since; their runs are computed again."""
        return sum(not _whole(row) for row in self._all())

    def drop_damaged(self) -> int:
        """Delete the rows that cannot be read, or were changed since; returns their number."""
        with self._transaction():
            damaged = [row for row in self._all() if not _whole(row)]
            self._ledger.executemany("delete from runs where rowid = ?", [(row["number"],) for row in damaged])
            self._ledger.executemany("delete from checksums where key = ?", [(row["key"],) for row in damaged])
        for row in damaged:
            if isinstance(row["key"], str) and row["key"].isalnum():
                self._arrays(row["key"]).unlink(missing_ok=True)
        return len(damaged)

    def _all(self) -> list[sqlite3.Row]:
        with self._in_words():
            return self._ledger.execute(f"select runs.rowid as number, {JOINED} order by finished, runs.key").fetchall()

    def _need_columns(self) -> None:
        columns = {row["name"] for row in self._ledger.execute("pragma table_info(runs)")}
        if missing := [name for name in CONTENT if name not in columns]:
            raise BadInput(
                f"{self.folder / LEDGER}: is damaged, it has no {' and no '.join(missing)}; put a copy of the store "
                "back, or name another folder."
            )

    def result(self, key: str) -> Result:
        """Return a result with its arrays.

        Parameters
        ----------
        key : str
            Key of the run.

        Returns
        -------
        Result
            Empty if its arrays are damaged.

        Raises
        ------
        KeyError
            If there is no such run.
        """
        with self._in_words():
            row = self._ledger.execute(f"select {JOINED} where runs.key = ?", (key,)).fetchone()
        if row is None:
            raise KeyError(key)
        return self._result(row)

    def drop(self, keys: Sequence[str]) -> None:
        """Forget runs and delete their arrays.

        Parameters
        ----------
        keys : sequence of str
            Keys of the runs.
        """
        with self._transaction():
            self._ledger.executemany("delete from runs where key = ?", [(key,) for key in keys])
            self._ledger.executemany("delete from checksums where key = ?", [(key,) for key in keys])
        for key in keys:
            self._arrays(key).unlink(missing_ok=True)

    def to_frame(self) -> pd.DataFrame:
        """One row for each run: settings and results as flat columns (``settings.count``, ``result.bed_height``)."""
        import pandas as pd

        heads = ("key", "name", "function", "version", "state", "message", "seconds", "finished")
        rows = []
        for kept in self.rows():
            result = {name: value for name, value in kept.result.items() if name != "arrays"}
            head = {name: getattr(kept, name) for name in heads}
            rows.append(head | _flat({"settings": kept.settings, "result": result}))
        return pd.DataFrame(rows) if rows else pd.DataFrame(columns=list(heads))

    def export(self, file: Path) -> int:
        """Write `to_frame` as Parquet or CSV, by the ending of the name.

        Parameters
        ----------
        file : Path
            ``.parquet`` or ``.csv``; replaced when the new one is whole.

        Returns
        -------
        int
            Number of runs.

        Raises
        ------
        BadInput
            For another ending.

        Notes
        -----
        In Parquet a column has one type: one that holds texts and numbers is written as text in JSON.
        """
        ending = file.suffix.lower()
        if ending not in (".parquet", ".csv"):
            raise BadInput(f"{file}: the name ends neither in .parquet nor in .csv; give one of the two.")
        frame = self.to_frame()
        with replacing(file) as part:
            if ending == ".csv":
                frame.to_csv(part, index=False)
            else:
                _one_type_each(frame).to_parquet(part, engine="pyarrow", index=False)
        return len(frame)

    def _tidy(self) -> None:
        """Remove what killed processes have left, unless another process lives; in a transaction, so none starts."""
        if self._owner.alone():
            remove_leftovers(self.folder / "arrays")

    def _row(self, run: Run, state: State = "done") -> sqlite3.Row | None:
        """The row of a run in this state, unless it is damaged or of other inputs."""
        with self._in_words():
            row: sqlite3.Row | None = self._ledger.execute(
                f"select {JOINED} where runs.key = ? and state = ?", (run.key, state)
            ).fetchone()
        return row if row is not None and _whole(row) and same_inputs(_parsed(row["inputs"]), run.inputs) else None

    def _result(self, row: sqlite3.Row) -> Result:
        """The result of a row, with its arrays; empty if it is damaged."""
        result = _parsed(row["result"])
        listed = result.pop("arrays", {})
        if not listed:
            return result
        if isinstance(listed, list):  # an earlier version kept no checksum
            listed = {"names": listed}
        try:
            content = self._arrays(row["key"]).read_bytes()
            if listed.get("sha256") not in (None, hashlib.sha256(content).hexdigest()):
                return {}
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                return result | {name: file[name] for name in listed["names"]}
        except DAMAGED:
            return {}

    def _insert(self, run: Run, state: str, result: str, message: str, seconds: float) -> None:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        settings, inputs = json.dumps(plain(run.settings)), json.dumps(plain(run.inputs))
        row = {
            "key": run.key, "name": run.name, "function": run.function, "settings": settings, "inputs": inputs,
            "version": __version__, "state": state, "result": result, "message": message, "finished": now,
            "seconds": float(seconds),
        }  # fmt: skip
        columns, places = ", ".join(row), ", ".join(f":{name}" for name in row)
        with self._transaction():
            self._ledger.execute(f"insert or replace into runs ({columns}) values ({places})", row)
            self._ledger.execute("insert or replace into checksums values (?, ?)", (run.key, _checksum(row)))
            self._ledger.execute("delete from claims where key = ?", (run.key,))

    def _arrays(self, key: str) -> Path:
        return self.folder / "arrays" / f"{key}.npz"

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        with self._in_words():
            self._ledger.execute("begin immediate")
            try:
                yield
            except BaseException:
                with suppress(sqlite3.Error):  # a full disk has rolled it back already
                    self._ledger.execute("rollback")
                raise
            self._ledger.execute("commit")

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        path = self.folder / LEDGER
        try:
            yield
        except sqlite3.OperationalError as error:
            raise BadInput(
                f"{path}: the ledger cannot be used ({error}); check its permissions and the free space, nothing that "
                "was kept is lost."
            ) from None
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # the latter of damaged names of columns
            raise BadInput(
                f"{path}: cannot be read as a ledger of runs ({error}); put a copy of the store back, name another "
                "folder, or delete this one to compute its runs again."
            ) from None


class _Owner:
    """The process as an owner of claims: a token, and a locked file that shows that it lives."""

    def __init__(self, folder: Path) -> None:
        self.token = f"{os.getpid()}-{uuid.uuid4().hex[:12]}"
        self._folder = folder
        self._file: IO[bytes] | None = None

    @property
    def started(self) -> bool:
        return self._file is not None

    def start(self) -> None:
        if self._file is None:
            self._folder.mkdir(exist_ok=True)
            self._file = (self._folder / self.token).open("wb")
            locked(self._file.fileno())

    def end(self) -> None:
        if self._file is not None:
            self._file.close()  # before it is deleted: Windows does not delete an open file
            self._file = None
            (self._folder / self.token).unlink(missing_ok=True)

    def alone(self) -> bool:
        """Whether no other owner lives; files of dead ones are removed."""
        tokens = [path.name for path in self._folder.iterdir()] if self._folder.is_dir() else []
        return not [token for token in tokens if self.another_lives(token)]

    def another_lives(self, token: str) -> bool:
        """Whether `token` is another owner whose process has not ended."""
        if token == self.token:
            return False
        path = self._folder / token
        try:
            with path.open("rb+") as file:
                locked(file.fileno())
        except BlockingIOError:
            return True
        except OSError:  # it has ended and its file is gone
            return False
        path.unlink(missing_ok=True)
        return False


def _checksum(row: Mapping[str, Any] | sqlite3.Row) -> str:
    return json_sha256([row[name] for name in CONTENT])


def _whole(row: sqlite3.Row) -> bool:
    """Whether a row is as it was kept: texts, among them three JSON objects, a known state, a time, their checksum."""
    if not all(isinstance(row[name], str) for name in TEXTS) or not isinstance(row["seconds"], int | float):
        return False
    try:
        objects = [json.loads(row[name]) for name in ("settings", "inputs", "result")]
    except (ValueError, RecursionError):
        return False
    known = all(isinstance(one, dict) for one in objects) and row["state"] in get_args(State)
    return known and row["checksum"] in (None, _checksum(row))  # an earlier version kept none


def _parsed(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (TypeError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _one_type_each(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with columns of several types as text in JSON."""
    import pyarrow as pa

    def single(column: pd.Series[Any]) -> pd.Series[Any]:
        try:
            pa.Array.from_pandas(column)
        except (pa.ArrowException, OverflowError):
            return column.map(json.dumps)
        return column

    return frame.apply(single) if len(frame) else frame


def _flat(value: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Nested dictionaries as one, with dotted names; lists as text."""
    found: dict[str, Any] = {}
    for name, item in value.items():
        place = f"{above}{name}"
        if isinstance(item, Mapping):
            found |= _flat(item, f"{place}.")
        else:
            found[place] = json.dumps(item) if isinstance(item, list) else item
    return found
