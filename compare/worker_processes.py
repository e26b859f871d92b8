"""Pools of worker processes, spawned and not forked, because a simulation may already run in this process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from rigtwin.lab.errors import WorkerEnded

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def spawned(
    jobs: int, workers: int | None = None, *, work: str = "worked", less: str = "use fewer --workers"
) -> Iterator[ProcessPoolExecutor]:
    """A pool of at most `workers` processes (one per core by default) for `jobs` jobs.

    `WorkerEnded` is raised if one of them ends unexpectedly; its message says what it did (`work`, a verb in the past
    tense) and how to need less memory (`less`).  An exception in the block, including Ctrl-C, ends the processes too.
    Submit jobs inside `interrupts_held`.
    """
    workers = max(1, min(workers or os.cpu_count() or 1, jobs))
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=start_worker)
    try:
        yield pool
    except BrokenProcessPool:
        raise WorkerEnded(
            f"a process that {work} ended without a result, most likely because memory ran out; "
            f"close other programs and run again, or {less}."
        ) from None
    except BaseException:
        # the results of running jobs are lost, so do not wait for them
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Start processes with Ctrl-C blocked, until they can end on it without a traceback.

    They use one thread for linear algebra, as the pool already uses every core.
    """
    with _one_thread_each():
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


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


def start_worker() -> None:
    """Let Ctrl-C end a worker silently, as the main process reports it, and end the worker with the main process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    import cv2

    cv2.setNumThreads(1)  # the pool already uses every core


def _end_with_parent() -> None:
    """End this worker when the main process ends, because a killed main process cannot end its workers."""
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)
