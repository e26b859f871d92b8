"""Pools of worker processes, spawned and not forked, because a simulation may already run in this process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from rigtwin.lab.errors import BadInput, WorkerEnded

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_STARTING = threading.RLock()


class Workers:
    """A limited number of worker processes, each started when a job finds none free.

    Parameters
    ----------
    size : int
        Largest number of processes.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._pool = ProcessPoolExecutor(size, multiprocessing.get_context("spawn"), initializer=_start_worker)

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        """Hand out a job.

        Parameters
        ----------
        function : callable
            Function that a worker can import.
        *arguments : object
            Its arguments.

        Returns
        -------
        concurrent.futures.Future
            Its result.

        Raises
        ------
        BrokenProcessPool
            If a worker has ended unexpectedly.
        """
        with _interrupts_held():
            try:
                return self._pool.submit(function, *arguments)
            except OSError as error:  # the pool closes its connections if a worker ends while another is started
                raise BrokenProcessPool("a process cannot be started") from error

    def close(self, *, wait: bool = False) -> None:
        """Start no more jobs, and let the processes end after the ones that run.

        Parameters
        ----------
        wait : bool
            Whether to wait for their end.
        """
        self._pool.shutdown(wait=wait, cancel_futures=True)


def need_number_of_processes(workers: object, option: str = "--workers") -> None:
    """Refuse a number of processes that is not a whole number from 1 upwards.

    Parameters
    ----------
    workers : int or None
        Number of processes, None for one per core.
    option : str
        The option that it comes from.

    Raises
    ------
    BadInput
        If it is neither None nor a whole number of at least 1.
    """
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise BadInput(f"{option}: {workers!r} is not a whole number from 1 upwards; leave it out for one per core.")


@contextmanager
def spawned(
    jobs: int, workers: int | None = None, *, work: str = "worked", less: str = "use fewer --workers"
) -> Iterator[Workers]:
    """Keep worker processes for the block.

    An exception in the block, including Ctrl-C, ends the processes too.

    Parameters
    ----------
    jobs : int
        Number of jobs; there are no more processes than jobs.
    workers : int, optional
        Largest number of processes.  Default: one per core.
    work : str
        What a process did, for the error message: a verb in the past tense.
    less : str
        How to need less memory, for the error message.

    Yields
    ------
    Workers
        The processes.

    Raises
    ------
    BadInput
        If `workers` is not a whole number from 1 upwards.
    WorkerEnded
        If one of them ends unexpectedly.
    """
    need_number_of_processes(workers)
    others = set(multiprocessing.active_children())
    pool = Workers(max(1, min(workers or os.cpu_count() or 1, jobs)))
    try:
        yield pool
        # Python 3.11 prints a traceback at its end if it wakes the pool while that closes its pipe
        pool.close(wait=True)
    except BaseException as error:
        # the results of running jobs are lost, so do not wait for them; a broken pool itself waits without end for a
        # process that was being started when another ended
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        if not isinstance(error, BrokenProcessPool):
            raise
        raise WorkerEnded(
            f"a process that {work} ended without a result, most likely because memory ran out; "
            f"close other programs and run again, or {less}."
        ) from None
    finally:
        pool.close()


@contextmanager
def _without_the_script() -> Iterator[None]:
    """Start processes that do not read the script of this one, which would run it again; their jobs are rigtwin's."""
    main: dict[str, Any] = vars(sys.modules["__main__"])
    with _STARTING:  # another thread would put the names back too early
        known: dict[str, Any] = {name: main[name] for name in ("__file__", "__spec__") if name in main}
        main.pop("__file__", None)
        main["__spec__"] = None
        try:
            yield
        finally:
            main.update(known)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Start processes with Ctrl-C blocked, until they can end on it without a traceback; it takes effect afterwards.

    They use one thread for linear algebra, as the pool already uses every core.
    """
    with _one_thread_each(), _without_the_script(), _interrupt_afterwards():
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # the new processes inherit it
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _interrupt_afterwards() -> Iterator[None]:
    """Let Ctrl-C in this process wait for the end of the block, also where another thread of it takes the signal."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    caught: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: caught.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if caught:
            signal.raise_signal(signal.SIGINT)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Set the thread counts in the environment of new processes, which BLAS libraries read once at import."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]


def _start_worker() -> None:
    """Let Ctrl-C end a worker silently, as the main process reports it, and end the worker with the main process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if not sys.warnoptions:  # as the command line
        warnings.simplefilter("ignore")
    import cv2

    cv2.setNumThreads(1)  # the pool already uses every core


def _end_with_parent() -> None:
    """End this worker when the main process ends, because a killed main process cannot end its workers."""
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)
