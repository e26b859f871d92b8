"""What rigtwin has written itself and reads again: checkpoints, stores of runs, measurements, results."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import sqlite3
import tempfile
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from rigtwin.benchmarks.fuzz_cases.case import Case, out, written
from rigtwin.benchmarks.fuzz_cases.labs import FILMED, LAB
from rigtwin.benchmarks.fuzz_cases.mutations import NUMBERS, in_bytes, in_words, number
from rigtwin.benchmarks.fuzz_cases.tables import table

HEAP = ("simulate", "pile", "--base-diameter", "30mm", "--count", "6", "--threads", "1")


def _ran(command: list[str]) -> None:
    from rigtwin.cli import run

    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        run([*command, "--quiet"])


@cache
def checkpoint() -> bytes:
    """The checkpoint of a heap of six beads."""
    with tempfile.TemporaryDirectory() as name:
        _ran([*HEAP, "--checkpoint", f"{name}/heap.npz", *out(Path(name))])
        return Path(name, "heap.npz").read_bytes()


def damaged_checkpoint(chance: Random, folder: Path) -> Case:
    """A checkpoint with changed bytes; its checksums do not fit."""
    path = written(folder, "heap.npz", in_bytes(chance, checkpoint()))
    return Case([*HEAP, "--checkpoint", path, *out(folder)])


def mended_checkpoint(chance: Random, folder: Path) -> Case:
    """A checkpoint with other numbers, sizes, types or words, whose checksums fit."""
    from rigtwin.sim.engine.bulk import checkpoint as kept

    path = Path(written(folder, "heap.npz", checkpoint()))
    words, _, state = kept._members(path)
    state = {name: array.copy() for name, array in state.items()}
    for _ in range(chance.choice((1, 1, 3))):
        if chance.random() < 0.4:
            words = in_words(chance, words).decode(errors="replace").replace("\0", "")
            continue
        name = chance.choice(list(state))
        state[name] = _other(chance, state[name])
        if chance.random() < 0.05:
            del state[name]
    arrays: dict[str, Any] = {f"state_{name}": array for name, array in state.items()}
    with path.open("wb") as file:
        np.savez(file, words=np.array(words), digest=np.array(kept._digest(words, state)), **arrays)
    return Case([*HEAP, "--checkpoint", str(path), *out(folder)])


def _other(chance: Random, array: Any) -> Any:
    kind = chance.randrange(8)
    if kind == 0:
        return array.astype(chance.choice((np.int32, np.float64, np.int64, np.uint8, np.float32)))
    if kind == 1:
        return array.reshape(-1)[: array.size // 2]
    if kind == 2:
        return np.concatenate([array, array]) if array.ndim else array
    if array.size and array.dtype.kind in "fiu":
        whole = array.dtype.kind != "f"
        place = chance.randrange(array.size)
        limits = np.iinfo(array.dtype) if whole else None
        value: Any = chance.choice((0, -1, 1, *NUMBERS)) if whole else chance.choice((0.0, -1.0, 1e9, 1e300, np.inf))
        if limits is not None:
            value = min(max(value, int(limits.min)), int(limits.max))
        with np.errstate(over="ignore"):
            array.reshape(-1)[place] = value
    return array


@cache
def store() -> Path:
    """A folder with a store of three runs, one of them failed."""
    from rigtwin.compare.campaign.run import Run
    from rigtwin.compare.campaign.store import Store

    folder = Path(tempfile.mkdtemp(prefix="rigtwin-fuzz-store-"))
    with Store(folder / "runs") as kept:
        for k in range(2):
            run = Run(f"bed-{k}", "rigtwin.benchmarks.fuzz:none", {"count": k, "rig": {"outlet": 0.03}}, {"seed": k})
            kept.keep(run, {"height": 0.1 + k, "profile": np.arange(6.0), "words": ["a", "b"]}, 1.5)
        kept.keep_failure(Run("bed-2", "rigtwin.benchmarks.fuzz:none", {"count": 2}, {}), "it does not settle.", 0.5)
    with contextlib.closing(sqlite3.connect(folder / "runs" / "ledger.sqlite")) as ledger:
        ledger.execute("pragma wal_checkpoint(truncate)")
    return folder


def damaged_store(chance: Random, folder: Path) -> Case:
    """A store of runs with a damaged ledger, damaged cells of it, or damaged arrays."""
    place = Path(shutil.copytree(store(), folder / "store"))
    ledger = place / "runs" / "ledger.sqlite"
    kind = chance.randrange(3)
    if kind == 0:
        ledger.write_bytes(in_bytes(chance, ledger.read_bytes()))
    elif kind == 1:
        with contextlib.closing(sqlite3.connect(ledger)) as opened, opened:
            column = chance.choice(("settings", "inputs", "result", "state", "seconds", "finished", "message", "name"))
            kept = opened.execute(f"select {column} from runs limit 1").fetchone()[0]
            text = in_words(chance, str(kept))
            value: Any = chance.choice((text, text.decode(errors="replace"), None, number(chance), 1e300))
            opened.execute(f"update runs set {column} = ?", (value,))
    else:
        arrays = chance.choice(sorted(place.rglob("*.npz")))
        arrays.write_bytes(in_bytes(chance, arrays.read_bytes()))
    action = chance.choice((["list"], ["show", "bed-0"], ["export", str(folder / "runs.csv")], ["drop", "--failed"]))
    if chance.random() < 0.2:
        action = ["export", str(folder / "runs.parquet")]
    return Case(["runs", str(place), *action])


@cache
def measured() -> Path:
    """A lab of one table with its kept measurement."""
    folder = Path(tempfile.mkdtemp(prefix="rigtwin-fuzz-lab-"))
    written(folder, "lab.toml", LAB + FILMED)
    written(folder, "r01.csv", table())
    _ran(["measure", str(folder), "--workers", "1", *out(folder)])
    return folder


def kept_measurement(chance: Random, folder: Path) -> Case:
    """A lab that is measured again, one file of its earlier results damaged."""
    place = Path(shutil.copytree(measured(), folder / "lab"))
    files = sorted(file for file in (place / "out").rglob("*") if file.suffix in (".json", ".csv", ".npz"))
    file = chance.choice(files)
    data = file.read_bytes()
    file.write_bytes(in_words(chance, data.decode()) if file.suffix != ".npz" else in_bytes(chance, data))
    return Case([chance.choice(("measure", "measure", "compare")), str(place), *out(place)])


def earlier_results(chance: Random, folder: Path) -> Case:
    """A folder of results in which the document of an earlier run is damaged."""
    path = written(folder, "r01.csv", table())
    known = {"rig": "drop", "source": {"file": "r01.csv", "sha256": "0"}, "media_sha256": ["0"]}
    written(folder, "out/r01-measurement.json", in_words(chance, json.dumps(known)))
    written(folder, "out/quantities.json", in_words(chance, json.dumps({"rig": "drop"})))
    if chance.random() < 0.5:
        return Case(["measure", "drop", path, *out(folder)])
    return Case(["simulate", "drop", "--drop-height", "20mm", "--bounces", "1", *out(folder)])
