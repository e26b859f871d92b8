"""Run what a store does not contain yet."""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from rigtwin.compare.campaign.run import Done, Result, Run
from rigtwin.compare.campaign.runners import ClusterLost, Pool, Runner, local, perform
from rigtwin.compare.campaign.store import Store
from rigtwin.compare.interrupted import add_note, note_on_interrupt
from rigtwin.lab.errors import BadInput, RigtwinError, SimulationFailed
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.version import __version__

LOOK = 1.0  # [s], between two looks at runs that another process has claimed


class Campaign:
    """Runs of a store on one pool of workers, which stay alive between calls.

    Parameters
    ----------
    store : Store
        Keeps the results.
    runner : Runner
        Opens the pool of workers when the first run is missing; processes of this machine by default.
    """

    def __init__(self, store: Store, runner: Runner = local) -> None:
        self.store = store
        self._runner = runner
        self._opened = ExitStack()
        self._pool: Pool | None = None
        self.computed = 0
        """Number of runs that this campaign has computed itself."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, KeyboardInterrupt):
            folder = self.store.folder
            add_note(error, folder, f"finished runs are kept in {folder}; the same command runs the others.")
        self._opened.__exit__(kind, error, trace)

    def results(
        self, runs: Sequence[Run], progress: Progress = silent, *, stage: str = "running", retry: bool = True
    ) -> Done:
        """Run what the store does not contain, and return all results.

        Parameters
        ----------
        runs : sequence of Run
            Runs with unique names; those with the same function and settings are run once.
        progress : Progress
            Called with step, finished cost [s] and total cost [s].
        stage : str
            Name of the step.
        retry : bool
            Run again what failed in an earlier call.

        Returns
        -------
        Done
            Results and failures by name.

        Raises
        ------
        RigtwinError
            If a worker process or the cluster ends unexpectedly.

        Notes
        -----
        A run that raises a `RigtwinError` is listed with its message, and kept as failed if it would fail again (a
        `BadInput` or `SimulationFailed`); any other exception is listed as a fault of rigtwin.  A run that another
        process computes is awaited.
        """
        kept = self.store.find(runs)
        failed = {} if retry else {run.name: why for run in runs if (why := self.store.failure(run))}
        groups: dict[str, list[Run]] = {}
        missing = [run for run in runs if run.name not in kept and run.name not in failed]
        for run in sorted(missing, key=lambda one: -one.cost):
            groups.setdefault(run.key, []).append(run)
        work = _Work(deque(group[0] for group in groups.values()), failures=failed)
        whole = sum(run.cost for run in runs)
        left = sum(run.cost for group in groups.values() for run in group)
        progress(stage, whole - left, whole)
        folder = self.store.folder

        def note() -> str:
            return f"{len(kept)} of {len(runs)} runs are kept in {folder}; the same command runs the others."

        with note_on_interrupt(folder, note):
            for run, result in self._finished(work, len(groups)):
                for same in groups[run.key]:
                    left -= same.cost
                    if result is not None:
                        kept[same.name] = result
                    else:
                        work.copy_failure(run.name, same.name)
                progress(stage, whole - left, whole)
        finished = {run.name: kept[run.name] for run in runs if run.name in kept}
        return Done(finished, work.failures, work.faults, tuple(work.out_of_memory))

    def _finished(self, work: _Work, jobs: int) -> Iterator[tuple[Run, Result | None]]:
        """Runs with their results as they finish; None for a failed one."""
        while work.waiting or work.pending or work.elsewhere:
            for run in self._hand_out(work, jobs):
                if found := self.store.find([run]):
                    yield run, found[run.name]
                else:  # dropped meanwhile, as by `rigtwin runs STORE drop`
                    work.waiting.append(run)
            if not work.pending:
                if work.elsewhere:
                    time.sleep(LOOK)
                continue
            ended, _ = wait(work.pending, timeout=LOOK if work.elsewhere else None, return_when=FIRST_COMPLETED)
            for job in ended:
                run = work.pending.pop(job)
                yield run, self._taken(run, job, work)

    def _hand_out(self, work: _Work, jobs: int) -> list[Run]:
        """Claim and submit as many runs as there are free slots; returns those that another process has finished."""
        pool = self._started(jobs) if work.waiting else self._pool
        work.waiting.extend(work.elsewhere)
        work.elsewhere.clear()
        done = []
        for _ in range(len(work.waiting)):
            if pool is not None and len(work.pending) >= pool.slots:
                break
            run = work.waiting.popleft()
            claimed = self.store.claim(run)
            if claimed == "done":
                done.append(run)
            elif claimed == "theirs":
                work.elsewhere.append(run)
            else:
                pool = pool or self._started(jobs)
                job = pool.executor.submit(perform, run.function, dict(run.settings), __version__)
                work.pending[job] = run
        return done

    def _taken(self, run: Run, job: Future[tuple[Result, float]], work: _Work) -> Result | None:
        """Keep the result of a job, or why it has none."""
        try:
            result, seconds = job.result()
        except (BrokenProcessPool, ClusterLost):  # the other runs cannot continue either
            raise
        except RigtwinError as error:
            work.failures[run.name] = str(error)
            if isinstance(error, (BadInput, SimulationFailed)):  # it would fail again
                self.store.keep_failure(run, str(error), 0.0)
            else:
                self.store.release(run)
        except MemoryError:
            work.failures[run.name] = "does not fit into memory; close other programs or give fewer --workers."
            work.out_of_memory.append(run.name)
            self.store.release(run)
        except Exception as error:  # a fault in one run must not stop the others
            short = f"{type(error).__name__}: {error}".splitlines()[0]
            work.failures[run.name] = f"a fault of rigtwin itself ({short})"
            work.faults[run.name] = "".join(traceback.format_exception(error))
            self.store.release(run)
        else:
            self.store.keep(run, result, seconds)
            self.computed += 1
            return result
        return None

    def _started(self, jobs: int) -> Pool:
        if self._pool is None:
            self._pool = self._opened.enter_context(self._runner(jobs))
        return self._pool


@dataclass
class _Work:
    """What is left to do in a call."""

    waiting: deque[Run]
    pending: dict[Future[tuple[Result, float]], Run] = field(default_factory=dict)
    elsewhere: list[Run] = field(default_factory=list)  # claimed by another process
    failures: dict[str, str] = field(default_factory=dict)
    faults: dict[str, str] = field(default_factory=dict)
    out_of_memory: list[str] = field(default_factory=list)

    def copy_failure(self, name: str, same: str) -> None:
        self.failures[same] = self.failures[name]
        if name in self.faults:
            self.faults[same] = self.faults[name]
        if name in self.out_of_memory and same not in self.out_of_memory:
            self.out_of_memory.append(same)


def run_all(
    runs: Sequence[Run],
    folder: Path,
    *,
    runner: Runner | None = None,
    only_kept: bool = False,
    progress: Progress = silent,
) -> Done:
    """Run what the store in `folder` does not contain yet, and return all results.

    Parameters
    ----------
    runs : sequence of Run
        Runs with unique names.
    folder : Path
        Folder of the store; created if it does not exist.
    runner : Runner, optional
        Where runs are computed; processes of this machine, one for each core, by default.
    only_kept : bool
        Read kept results only, run nothing.
    progress : Progress
        Called with step, finished cost [s] and total cost [s].

    Returns
    -------
    Done
        Results and failures by name, as of `Campaign.results`.

    Raises
    ------
    BadInput
        If the store cannot be used.
    RigtwinError
        If a worker process or the cluster ends unexpectedly.
    """
    with Store(folder, create=not only_kept) as store:
        if only_kept:
            return Done(store.find(runs), {})
        with Campaign(store, runner or local) as campaign:
            return campaign.results(runs, progress)
