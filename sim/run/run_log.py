"""Log of a bulk simulation: frames of the trajectory, checkpoints, and the energy balance over time."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, SimulationFailed
from rigtwin.lab.output_files import claimed_file
from rigtwin.lab.units import positive
from rigtwin.sim.output.trajectory import Trajectory, begin, write_walls

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.bulk import Bulk
    from rigtwin.sim.engine.bulk.checkpoint import Checkpoint, State
    from rigtwin.sim.engine.bulk.energy_budget import Budget


SNAPSHOT_INTERVAL = 1.0  # [s] of computing time that an interrupt (Ctrl-C) may lose
RISE_LIMIT = 0.01  # spurious energy gain over energy supplied; more means a time step too large for the contacts


@dataclass(frozen=True)
class History:
    """Energy balance and contact statistics of a run over time; arrays of equal length.  Overlaps as in `Budget`."""

    time: Array  # [s]
    kinetic: Array  # [J]
    potential: Array  # [J]
    elastic: Array  # [J]
    supplied: Array  # [J], by the beads poured so far and by moving walls
    risen: Array  # [J], largest spurious gain so far: rounding, or too large a time step
    beads: Array  # [1], in the domain
    contacts: Array  # [1], between beads
    wall_contacts: Array  # [1]
    mean_overlap: Array  # [1]
    largest_overlap: Array  # [1]
    adhesive: Array  # [J], of attractive effects; negative
    in_flight: Array  # [J], work of the effects' forces in flight; negative for drag

    @property
    def dissipated(self) -> Array:
        """Energy [J] dissipated by friction and dashpots, or lost with beads that left the domain."""
        return self.supplied + self.in_flight - self.kinetic - self.potential - self.elastic - self.adhesive


class Logbook:
    """Runs a simulation and logs it; a context manager around the run.

    Parameters
    ----------
    bulk : Bulk
        Simulation that is run.
    settings : mapping
        All that decides the outcome, as JSON data.
    trajectory : Path, optional
        File for the frames, and beside it one for the walls.
    trajectory_interval : float
        Simulated time [s] between two frames.
    checkpoint : Path, optional
        File for checkpoints; an existing one is resumed.
    checkpoint_interval : float
        Computing time [s] between two checkpoints.

    Raises
    ------
    BadInput
        If an interval is not positive (that of checkpoints may be zero).

    Examples
    --------
    ::

        with Logbook(bulk, settings, checkpoint=Path("heap.npz"), trajectory=Path("heap.gsd")) as logbook:
            course = logbook.resume() or {"poured": 0}
            while ...:
                logbook.run(500)
                logbook.look(course)
    """

    def __init__(
        self,
        bulk: Bulk,
        settings: Mapping[str, Any],
        *,
        trajectory: Path | None = None,
        trajectory_interval: float,
        checkpoint: Path | None = None,
        checkpoint_interval: float,
    ) -> None:
        positive(trajectory_interval=trajectory_interval)
        if not checkpoint_interval >= 0:
            positive(checkpoint_interval=checkpoint_interval)
        from rigtwin.sim.engine.bulk.checkpoint import Checkpoint

        self._bulk = bulk
        self._frame_steps = max(1, round(trajectory_interval / bulk.time_step))
        self._checkpoint: Checkpoint | None = None
        if checkpoint is not None:
            self._checkpoint = Checkpoint(checkpoint, settings, checkpoint_interval)
        self._claims = ExitStack()  # of the files that this run writes
        self._film_path = trajectory
        self._film: Trajectory | None = None
        self._added = 0  # beads whose energy is included in the balance
        self._course: dict[str, Any] = {}
        self._moved = False  # whether a step was made since the run began or was resumed
        self._history: list[dict[str, float]] = []
        self._supplied = self._risen = 0.0
        self._total = self._most_dissipated = 0.0  # [J], total at the last entry; largest dissipation so far
        self._work = 0.0  # [J], of moving walls, included in the balance
        self._snapshot: tuple[dict[str, Any], State, float] | None = None  # state newer than the checkpoint file
        self._taken: float | None = None  # [s], time of the latest snapshot
        self._taking = 0.0  # [s], computing time of a snapshot
        self._steps_here, self._seconds_here = 0, 0.0  # steps of this process, and its time [s] for them
        self._began = time.process_time()
        self._computed_before = 0.0  # [s], processor time of the resumed run's earlier processes
        self.first_frame: float | None = None  # [s], start of a trajectory that does not begin with the run

    def resume(self) -> dict[str, Any] | None:
        """Restore the checkpoint and return the state of the run; None for a new run."""
        kept = self._checkpoint.read() if self._checkpoint else None
        frames, course = 0, None
        if kept is not None:
            books, state = kept
            assert self._checkpoint is not None
            try:
                course, frames = dict(books["course"]), int(books["frames"])
                self._history = [{name: float(value) for name, value in dict(one).items()} for one in books["history"]]
                energies = map(float, books["energy"])
                self._supplied, self._risen, self._total, self._most_dissipated, self._work = energies
                first = books["first_frame"]
                self.first_frame = None if first is None else float(first)
                stored = books.get("computing")
                # checkpoints of old versions lack it
                self._computed_before = math.nan if stored is None else float(stored)
                self._bulk.restore(state)
                self._added = self._bulk.added
            except (ValueError, LookupError, TypeError):
                raise BadInput(
                    f"The checkpoint {self._checkpoint.path} holds no state of this run; "
                    "delete it or name another file."
                ) from None
        if self._film_path is not None:
            self._film = begin(self._film_path, self._bulk.kinds, self._bulk.domain, frames=frames)
            walls = self._film_path.with_name(f"{self._film_path.stem}-walls.vtk")
            write_walls(walls, self._bulk.shapes, self._bulk.domain)
            if self._bulk.steps and not self._film.frames:
                self.first_frame = self._bulk.time
        return course

    def run(self, steps: int) -> None:
        """Make time steps and write the frames that fall due.

        Parameters
        ----------
        steps : int
            Number of steps.

        Raises
        ------
        SimulationFailed
            If the simulation breaks down; the message names the checkpoint that is kept, if there is one.
        """
        if self._bulk.added != self._added:
            self._added = self._bulk.added
            self._supplied += self._bulk.budget().total - self._total
        end, began = self._bulk.steps + steps, time.perf_counter()
        self._moved = True
        try:
            while self._bulk.steps < end:
                if self._film and self._bulk.steps % self._frame_steps == 0:
                    self._film.add(self._bulk.beads(), self._bulk.time, self._bulk.steps)
                pause = self._frame_steps - self._bulk.steps % self._frame_steps if self._film else steps
                self._bulk.run(min(end - self._bulk.steps, pause))
        except SimulationFailed as trouble:
            if self._checkpoint is None or self._checkpoint.kept_at is None:
                raise
            raise SimulationFailed(
                f"{trouble} The last good state, of t = {self._checkpoint.kept_at:.6g} s, "
                f"is kept in {self._checkpoint.path}."
            ) from None
        self._steps_here += steps
        self._seconds_here += time.perf_counter() - began
        self._enter(self._bulk.budget())

    def look(self, course: Mapping[str, Any]) -> None:
        """Write a checkpoint if one is due.

        Parameters
        ----------
        course : mapping
            State of the run, as JSON data.
        """
        if self._checkpoint is not None:
            self._course = dict(course)
            if self._checkpoint.due:
                self._checkpoint.write(*self._now())
                self._snapshot = None
            else:
                self._remember()

    @property
    def computing(self) -> float:
        """Processor time [s] of the run so far, including that before its checkpoint."""
        return self._computed_before + time.process_time() - self._began

    @property
    def history(self) -> History:
        """The energy balance so far."""
        return History(
            **{item.name: np.array([entry.get(item.name, 0.0) for entry in self._history]) for item in fields(History)}
        )

    def statistics(self) -> dict[str, float]:
        """Statistics of the run: steps, and last values and extremes of the energy balance."""
        bulk, books = self._bulk, self.history
        course = {
            "time_step_s": bulk.time_step,
            "steps": float(bulk.steps),
            "lists_built": float(bulk.lists_built),
            "largest_overlap": bulk.largest_overlap,
        }
        if self._steps_here:
            course["steps_per_second"] = self._steps_here / max(self._seconds_here, 1e-9)
        if not len(books.time):
            return course
        last = {f"{name}_energy_j": float(getattr(books, name)[-1]) for name in ("kinetic", "potential", "elastic")}
        return {
            **course,
            **last,
            "energy_supplied_j": float(books.supplied[-1]),
            "energy_dissipated_j": float(books.dissipated[-1]),
            "energy_risen_j": float(books.risen[-1]),
            **{
                f"{name}_energy_j": float(getattr(books, name)[-1])
                for name in ("adhesive", "in_flight")
                if getattr(books, name).any()
            },
            "contacts": float(books.contacts[-1]),
            "wall_contacts": float(books.wall_contacts[-1]),
            "mean_overlap": float(books.mean_overlap[-1]),
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the run."""
        warnings = []
        if self._risen > RISE_LIMIT * abs(self._supplied):
            warnings.append(
                f"the energy budget does not close: {self._risen:.3g} J were gained without a source, of "
                f"{self._supplied:.3g} J supplied; give a smaller --time-step-fraction"
            )
        if self.first_frame is not None:
            warnings.append(f"the trajectory begins at t = {self.first_frame:.4g} s, where the run was resumed")
        return tuple(warnings)

    def __enter__(self) -> Logbook:
        kept = None if self._checkpoint is None else self._checkpoint.path
        paths = {"--checkpoint": kept, "--trajectory": self._film_path}
        with ExitStack() as claims:
            for option, path in paths.items():
                if path is not None:
                    why = f"{path}: another run is writing it; wait for that one, or give {option} another name."
                    claims.enter_context(claimed_file(path, why))
            self._claims = claims.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._claims:
            self._end(kind, error)

    def _end(self, kind: type[BaseException] | None, error: BaseException | None) -> None:
        # frames written before a failure help to find its cause, so the file is closed under its name in that case, too
        if self._film is not None:
            if kind is None and self._moved:
                self._film.add(self._bulk.beads(), self._bulk.time, self._bulk.steps)
            self._film.close()
        if self._checkpoint is not None and self._moved:
            if kind is None:
                self._checkpoint.write(*self._now())
            elif kind is KeyboardInterrupt and self._snapshot is not None:
                self._checkpoint.write(*self._snapshot)
        if self._checkpoint is not None and isinstance(error, KeyboardInterrupt):
            error.add_note(self._checkpoint.standing)

    def _enter(self, budget: Budget) -> None:
        self._total = budget.total
        self._supplied += budget.work - self._work
        self._work = budget.work
        # dissipation never decreases; beads that fall out of the domain only remove energy, as they came from above
        dissipated = self._supplied + budget.in_flight - self._total
        self._most_dissipated = max(self._most_dissipated, dissipated)
        self._risen = max(self._risen, self._most_dissipated - dissipated)
        numbers = {name: float(value) for name, value in asdict(budget).items()}
        self._history.append({**numbers, "time": self._bulk.time, "supplied": self._supplied, "risen": self._risen})

    def _remember(self) -> None:
        """Take a snapshot for an interrupt between two checks; limited to 1/20 of the computing time."""
        began = time.perf_counter()
        if self._taken is not None and began - self._taken < max(SNAPSHOT_INTERVAL, 20 * self._taking):
            return
        self._snapshot = self._now()
        first, self._taken = self._taken is None, time.perf_counter()
        # the first snapshot includes the compilation of the kernels that read the state
        self._taking = 0.0 if first else self._taken - began

    def _now(self) -> tuple[dict[str, Any], State, float]:
        """Content of a checkpoint."""
        books = {
            "course": copy.deepcopy(self._course),  # its lists keep growing
            "frames": self._film.frames if self._film else 0,
            "first_frame": self.first_frame if self._film else None,
            "history": list(self._history),
            "computing": self.computing if math.isfinite(self.computing) else None,
            "energy": [self._supplied, self._risen, self._total, self._most_dissipated, self._work],
        }
        return books, self._bulk.state(), self._bulk.time
