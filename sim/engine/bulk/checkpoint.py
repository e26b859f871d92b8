"""Checkpoints: the full state of a simulation in one file, which is replaced atomically.

A run resumed from its checkpoint gives the same bits as an uninterrupted one, on any number of threads.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import BadInput
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
    cut = (arena.capacity, arena.capacity + 1, arena.pair_capacity, arena.walls.near_capacity)
    for name, field in _fields(arena):
        whole, part = np.zeros_like(field.to_numpy()), state.get(name)
        if (
            part is None
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
        try:
            with replacing(self.path) as part, part.open("wb") as file:
                arrays: dict[str, Any] = {f"state_{name}": array for name, array in state.items()}
                np.savez(file, words=np.array(words), **arrays)
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
            with self.path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                words = json.loads(str(file["words"]))
                state = {name.removeprefix("state_"): file[name] for name in file.files if name != "words"}
            settings, course, now = words["settings"], words["course"], words["time_s"]
        except (OSError, ValueError, KeyError, EOFError, TypeError, BadZipFile):
            raise BadInput(f"{self.path} is not a checkpoint of rigtwin, or is damaged; name another file.") from None
        if settings != self._settings:
            raise BadInput(
                f"The checkpoint {self.path} belongs to another run ({_difference(settings, self._settings)}); "
                "name another file, or delete it to begin anew."
            )
        self.kept_at = now
        return course, state


def kept_time(path: Path) -> float | None:
    """Simulated time [s] of the checkpoint in this file; None if it holds none."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return float(json.loads(str(file["words"]))["time_s"])
    except (OSError, ValueError, KeyError, EOFError, TypeError, IndexError, BadZipFile):
        return None  # a damaged file is reported when the run reads it


def _difference(there: Any, here: Any, name: str = "") -> str:
    """Description of the first setting that differs."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in [*here, *(key for key in there if key not in here)]:
            if there.get(key) != here.get(key):
                return _difference(there.get(key), here.get(key), f"{name}.{key}" if name else key)
    said = ["not said" if value is None else value for value in (there, here)]
    what = " of the ".join(reversed(name.split("."))).replace("_", " ")
    return f"{what}: {said[0]} there, {said[1]} here"
