"""Checkpoints: the full state of a simulation in one file, which is replaced atomically.

A run resumed from its checkpoint gives the same bits as an uninterrupted one, on any number of threads.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import DAMAGED
from rigtwin.lab.output_files import replacing
from rigtwin.lab.version import __version__
from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.bulk import table_layout as at
from rigtwin.sim.engine.bulk.arena import Arena

State = dict[str, npt.NDArray[Any]]
"""Arrays by name."""

# fields that are written before they are read, or set up with the run; every other field of an arena is saved, so that
# fields added later are saved by default
SCRATCH = frozenset(
    {
        "cell_first",
        "cell_of",
        "order",
        "listed",
        "spare_member",
        "brake",
        "body_new",
        "chosen",
        "desk",
        "gathering",
        "shares",
    }
) | {
    f"walls.{name}"
    for name in (
        *("elements", "cell_first", "items", "grid", "grid_shape", "law", "constants"),
        *("state", "turned", "pivot", "velocity", "spin", "facing", "mark"),
    )
}


def read_arena(arena: Arena) -> State:
    """Every field of `arena` that a step reads, truncated to the beads and pairs in use."""
    counts = arena.counts.to_numpy()
    beads, listed = int(counts[at.BEADS]), int(counts[at.LISTED])
    pairs = int(arena.first[int(counts[at.LIVE_LIST]), listed])
    used = {
        arena.capacity: max(beads, listed),
        arena.capacity + 1: max(beads, listed) + 1,
        arena.pair_capacity: max(pairs, int(counts[at.PAIRS])),
    }
    # a field's length identifies what it is indexed by; if two lengths are equal the larger part is saved
    near = arena.walls.near_capacity
    used[near] = max(used.get(near, 0), int(arena.walls.first[int(counts[at.LIVE_LIST]), listed]))
    state: State = {}
    for name, field in _fields(arena):
        whole = field.to_numpy()
        state[name] = whole[tuple(slice(min(length, used.get(length, length))) for length in whole.shape)].copy()
    return state


def write_arena(arena: Arena, state: State) -> None:
    """Fill `arena`, which must have the sizes of the one that `state` was read from."""
    for name, most in {"first": arena.pair_capacity, "walls.first": arena.walls.near_capacity}.items():
        if name in state and "counts" in state:
            listed, live = (int(state["counts"][column]) for column in (at.LISTED, at.LIVE_LIST))
            # before a list is built its memory holds what other runs have left
            places = state[name][live, : listed + 1] if listed else np.zeros(1)
            if not (0 <= listed < state[name].shape[1] and np.all((places >= 0) & (places <= most))):
                raise ValueError(f"{name} holds a place outside of its list")  # a step would read what is not there
    cut = (arena.capacity, arena.capacity + 1, arena.pair_capacity, arena.walls.near_capacity)
    for name, field in _fields(arena):
        whole, part = np.zeros_like(field.to_numpy()), state.get(name)
        if (
            part is None
            or part.dtype != whole.dtype
            or not np.all(np.isfinite(part))
            or part.ndim != whole.ndim
            or not all(
                length == full or (length < full and full in cut)
                for length, full in zip(part.shape, whole.shape, strict=True)
            )
        ):
            raise BadInput("The checkpoint was written by an earlier rigtwin; delete it or name another.")
        whole[tuple(slice(length) for length in part.shape)] = part
        field.from_numpy(whole)


def _fields(arena: Arena) -> Iterator[tuple[str, Any]]:
    own = {**vars(arena), **{f"walls.{name}": value for name, value in vars(arena.walls).items()}}
    for name, value in own.items():
        if isinstance(value, ti.Field) and name not in SCRATCH:
            yield name, value


class Checkpoint:
    """One run's checkpoint file."""

    def __init__(self, path: Path, settings: Mapping[str, Any], interval: float) -> None:
        """`settings` hold all that decides the outcome of the run, as JSON data; `interval` is computing time [s]."""
        self.path = path
        self.kept_at: float | None = None  # [s], simulated, of the state in the file
        self._settings = json.loads(json.dumps({"rigtwin": __version__, **settings}))
        self._interval = interval
        self._written = time.monotonic()

    @property
    def due(self) -> bool:
        """Whether the interval has passed."""
        return time.monotonic() - self._written >= self._interval

    @property
    def standing(self) -> str:
        """State of the file in words, for a run that is interrupted."""
        if self.kept_at is None:
            return f"nothing of this run was kept yet in {self.path}; the same command begins it anew."
        return f"the run is kept up to t = {self.kept_at:.4g} s in {self.path}; the same command resumes it there."

    def write(self, course: Mapping[str, Any], state: State, now: float) -> None:
        """Replace the file by this state at the simulated time `now` [s]; `course` is the rest, as JSON data."""
        words = json.dumps({"settings": self._settings, "course": course, "time_s": now})
        digest = _digest(words, state)
        try:
            with replacing(self.path) as part, part.open("wb") as file:
                arrays: dict[str, Any] = {f"state_{name}": array for name, array in state.items()}
                np.savez(file, words=np.array(words), digest=np.array(digest), **arrays)
                file.flush()
                os.fsync(file.fileno())
        except OSError as trouble:
            raise BadInput(
                f"The checkpoint {self.path} cannot be written ({trouble.strerror}); name another place."
            ) from None
        self.kept_at = now
        self._written = time.monotonic()

    def read(self) -> tuple[dict[str, Any], State] | None:
        """Read the course and the state; None if there is no file yet.

        Raises `BadInput` if the file is not a checkpoint, or belongs to a run with other settings.
        """
        if not self.path.exists():
            return None
        try:
            written, digest, state = _members(self.path)
            words = json.loads(written)
            settings, course, now = words["settings"], words["course"], float(words["time_s"])
        except DAMAGED:
            raise BadInput(f"{self.path} is not a checkpoint of rigtwin, or is damaged; name another file.") from None
        if settings != self._settings:
            raise BadInput(
                f"The checkpoint {self.path} belongs to another run ({_difference(settings, self._settings)}); "
                "name another file, or delete it to begin anew."
            )
        if not digest:
            raise BadInput(f"The checkpoint {self.path} was written by an earlier rigtwin; delete it or name another.")
        if digest != _digest(written, state):
            raise BadInput(
                f"The checkpoint {self.path} does not hold what was written into it; delete it or name another file."
            )
        self.kept_at = now
        return course, state


def kept_time(path: Path) -> float | None:
    """Simulated time [s] of the checkpoint in this file; None if it holds none."""
    try:
        with ZipFile(path) as file:
            return float(json.loads(str(_array(file, "words.npy")))["time_s"])
    except DAMAGED:
        return None  # a damaged file is reported when the run reads it


def _members(path: Path) -> tuple[str, str, State]:
    """Words, digest and arrays of a checkpoint.  Raises `ValueError` and others if it is none."""
    with ZipFile(path) as file:
        names = [name.removesuffix(".npy") for name in file.namelist()]
        if len(set(names)) != len(names):
            raise ValueError("a member stands there twice")
        arrays = {name: _array(file, f"{name}.npy") for name in names}
    words, digest = str(arrays.pop("words")), str(arrays.pop("digest", ""))
    return words, digest, {name.removeprefix("state_"): array for name, array in arrays.items()}


def _array(file: ZipFile, name: str) -> npt.NDArray[Any]:
    """An array of a checkpoint, stored as it is: one that states to be larger than the file takes no memory."""
    about = file.getinfo(name)
    if about.compress_type != ZIP_STORED or about.file_size != about.compress_size:
        raise ValueError(f"{name} is compressed")
    with file.open(about) as member:
        stored = io.BytesIO(member.read())  # checks the sum of the member
    version = np.lib.format.read_magic(stored)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, in_columns, kind = read(stored)
    if kind.hasobject or math.prod(shape) * kind.itemsize != about.file_size - stored.tell():
        raise ValueError(f"{name} has another size than it states")
    values = np.frombuffer(stored.getvalue(), kind, offset=stored.tell())
    return values.reshape(shape, order="F" if in_columns else "C")


def _digest(words: str, state: State) -> str:
    """Checksum of all that is in a checkpoint."""
    found = hashlib.sha256(words.encode())
    for name, array in sorted(state.items()):
        found.update(f"{name} {array.dtype.str} {array.shape}".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()


def _difference(there: Any, here: Any, name: str = "") -> str:
    """Description of the first setting that differs."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in [*here, *(key for key in there if key not in here)]:
            if there.get(key) != here.get(key):
                return _difference(there.get(key), here.get(key), f"{name}.{key}" if name else key)
    said = ["not said" if value is None else value for value in (there, here)]
    what = " of the ".join(reversed(name.split("."))).replace("_", " ")
    return f"{what}: {said[0]} there, {said[1]} here"
