"""Several processes at work: spawned, never forked, for a simulation may already run in this one."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from rigtwin.lab.errors import RigtwinError

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def spawned(jobs: int, workers: int | None = None) -> Iterator[ProcessPoolExecutor]:
    """A pool of at most `workers` processes (one per core by default) for `jobs` jobs.

    Whatever ends the block early, Ctrl-C among it, ends the processes too.  Submit inside `interrupts_held`.
    """
    workers = max(1, min(workers or os.cpu_count() or 1, jobs))
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_start_worker)
    try:
        yield pool
    except BrokenProcessPool:
        raise RigtwinError(
            "a process ended before its time, most likely for want of memory; "
            "close other programs and run again, or ask for less at once."
        ) from None
    except BaseException:
        # nobody will read what is still being worked on: do not let the person wait for it
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Processes started inside begin with Ctrl-C held back, until they are ready to die of it without a traceback.

    They do linear algebra in one thread, as the pool already uses every core.
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
    """What a process is born with; NumPy's linear algebra reads it once, at its import."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]


def _start_worker() -> None:
    """Ctrl-C ends a worker at once and without words: the main process does the talking, and they end with it."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    import cv2

    cv2.setNumThreads(1)  # the pool already uses every core


def _end_with_parent() -> None:
    """A process that is killed cannot end its workers: they would compute for hours what nobody keeps."""
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)
