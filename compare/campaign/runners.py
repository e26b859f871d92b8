"""Where runs are computed: processes of this machine, workers of a Dask cluster, jobs of a batch system.

Each runner is a context manager that gives an `Executor` and the number of runs to hand out at a time.  Every run is
computed by one thread and gives the same result everywhere.
"""

from __future__ import annotations

import asyncio
import re
import socket
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rigtwin.compare.campaign.run import Result
from rigtwin.compare.result_files import plain
from rigtwin.compare.worker_processes import Workers, need_number_of_processes, spawned
from rigtwin.lab.errors import BadInput, RigtwinError, WorkerEnded
from rigtwin.lab.version import __version__

ANSWER = 10.0  # [s], within which a Dask scheduler must answer
AHEAD = 2  # runs handed out to a Dask worker: one that it computes and one that waits
POLL = 0.5  # [s], between two looks at the jobs of a batch system
JOBS = 200  # jobs of a batch system at a time


class _Submits(Protocol):
    """The part of `concurrent.futures.Executor` that a campaign uses."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]: ...


@dataclass(frozen=True)
class Pool:
    """Where runs go."""

    executor: _Submits
    slots: int  # runs handed out at a time


Runner = Callable[[int], AbstractContextManager[Pool]]
"""Opens a pool for so many runs."""


class ClusterLost(BadInput):
    """The cluster has ended, and with it the runs that it had not finished."""


def perform(function: str, settings: dict[str, Any], version: str) -> tuple[Result, float]:
    """Compute a run.

    Parameters
    ----------
    function : str
        ``module:function``.
    settings : dict
        Keyword arguments of the function.
    version : str
        Version of rigtwin that the campaign has.

    Returns
    -------
    result : Result
        The result.
    seconds : float
        Run time [s].

    Raises
    ------
    RigtwinError
        If this process has another version of rigtwin.
    """
    if version != __version__:
        raise RigtwinError(f"a worker has rigtwin {__version__}, this campaign {version}; install the same on all.")
    if threading.current_thread() is not threading.main_thread():  # a worker of Dask
        return _in_own_process(function, settings, version)
    module, name = function.split(":")
    begun = time.perf_counter()
    found = dict(getattr(import_module(module), name)(**settings))
    return {
        str(name): value if isinstance(value, np.ndarray) and value.ndim else plain(value)
        for name, value in found.items()
    }, time.perf_counter() - begun


def _in_own_process(function: str, settings: dict[str, Any], version: str) -> tuple[Result, float]:
    """Compute a run in a process that this one keeps for it, because an engine starts in a main thread only."""
    try:
        job: Future[tuple[Result, float]] = _own_process().submit(perform, function, settings, version)
        return job.result()
    except BrokenProcessPool:
        _own_process.cache_clear()
        raise WorkerEnded("its process ended without a result, most likely because memory ran out.") from None


@cache
def _own_process() -> Workers:
    return Workers(1)


def runner(cluster: str | None, workers: int | None, folder: Path, *, option: str = "--workers") -> Runner:
    """Return the runner that the option ``--cluster`` names.

    Parameters
    ----------
    cluster : str, optional
        None: processes of this machine; ``tcp://host:port``: a Dask scheduler; ``slurm`` or ``slurm:key=value,...``: a
        batch system, with parameters of submitit.
    workers : int, optional
        Number of processes of this machine; one for each core by default.
    folder : Path
        Folder of the store, where a batch system keeps its logs.
    option : str
        The option that `workers` comes from, for the refusal.

    Returns
    -------
    Runner
        The runner.

    Raises
    ------
    BadInput
        For another text, `workers` that are not a whole number from 1 upwards, or `workers` together with a cluster.
    """
    need_number_of_processes(workers, option)
    if cluster is None:
        return lambda jobs: local(jobs, workers)
    if workers is not None:
        raise BadInput(f"{option}: is for this machine, and the cluster decides for itself; leave it or --cluster out.")
    name, _, rest = cluster.partition(":")
    if name == "slurm":
        parameters = _parameters(rest)
        return lambda jobs: batch(jobs, folder / "jobs", parameters)
    if re.fullmatch(r"(tcp|tls)://[^\s/]+:\d{1,5}", cluster):
        return lambda jobs: dask(jobs, cluster)
    raise BadInput(
        f"--cluster: {cluster!r} is neither the address of a Dask scheduler like tcp://host:8786 nor slurm; correct it."
    )


@contextmanager
def local(jobs: int, workers: int | None = None) -> Iterator[Pool]:
    """Open processes of this machine.

    Parameters
    ----------
    jobs : int
        Number of runs.
    workers : int, optional
        Largest number of processes.  Default: one for each core.

    Yields
    ------
    Pool
        The processes.
    """
    with spawned(jobs, workers, work="ran a twin") as pool:
        yield Pool(pool, pool.size)


@contextmanager
def dask(jobs: int, address: str) -> Iterator[Pool]:
    """Open the workers of a Dask scheduler.

    Parameters
    ----------
    jobs : int
        Number of runs.
    address : str
        Address of the scheduler, ``tcp://host:port`` or ``tls://host:port``.

    Yields
    ------
    Pool
        The workers.

    Raises
    ------
    BadInput
        If Dask is not installed, the scheduler does not answer or has no workers, or a worker has another rigtwin or
        may not start a process.
    """
    try:
        import distributed
    except ImportError:
        raise BadInput('--cluster: needs Dask; install it with pip install "rigtwin[dask]".') from None
    security: Any = distributed.Security()  # type: ignore[no-untyped-call]
    if address.startswith("tls:") and not security.get_connection_args("client").get("ssl_context"):
        raise BadInput(
            "--cluster: tls:// needs certificates; name them in Dask's configuration (distributed.comm.tls)."
        )
    try:
        _knock(address)
        with ThreadPoolExecutor(1) as thread:  # this one may run an event loop already, as in a notebook
            thread.submit(asyncio.run, asyncio.wait_for(_asked(address, security), ANSWER)).result()
        client: Any = distributed.Client(address, timeout=ANSWER, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise BadInput(
            f"--cluster: no Dask scheduler answers at {address} ({_reason(error)}); start one with `dask scheduler` "
            "or correct the address."
        ) from None

    def version() -> str:  # sent as code, because a worker may have a rigtwin without this module
        from rigtwin.lab.version import __version__ as found

        return str(found)

    def without_children() -> bool:
        import multiprocessing

        return multiprocessing.current_process().daemon

    try:
        threads = {worker: int(number) for worker, number in client.nthreads().items()}
        if not threads:
            raise BadInput(f"--cluster: the scheduler at {address} has no workers; start some with `dask worker`.")
        _same_version(client.run(version, on_error="return"))
        if any(client.run(without_children).values()):
            raise BadInput(
                "--cluster: a worker may not start a process, which each twin needs; start the workers with "
                "`dask worker --no-nanny`."
            )
        workers = _DaskWorkers(client.get_executor(pure=False), address)
        yield Pool(workers, min(jobs, AHEAD * sum(threads.values())))
    finally:
        with suppress(Exception):  # the scheduler may have ended
            client.close(timeout=ANSWER)


def _knock(address: str) -> None:
    """Raise `OSError` where nothing listens: Dask itself would try again until its time is over."""
    host, _, port = address.partition("://")[2].rpartition(":")
    socket.create_connection((host.strip("[]"), min(int(port), 65535)), timeout=ANSWER).close()


async def _asked(address: str, security: Any) -> None:
    """Return when a scheduler has answered: Dask's client waits without end for a listener that says nothing."""
    from distributed.core import rpc

    connection: Any = rpc(address, connection_args=security.get_connection_args("client"))  # type: ignore[no-untyped-call]
    async with connection as scheduler:
        await scheduler.identity()


class _DaskWorkers:
    """Workers of a Dask scheduler, with its own errors in words."""

    def __init__(self, executor: _Submits, address: str) -> None:
        self._executor = executor
        self._address = address

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()

        def take(job: Future[Any]) -> None:
            try:
                future.set_result(job.result())
            except Exception as error:
                future.set_exception(self._in_words(error))

        self._executor.submit(function, *arguments).add_done_callback(take)
        return future

    def _in_words(self, error: Exception) -> Exception:
        if isinstance(error, CancelledError):
            return ClusterLost(
                f"--cluster: the scheduler at {self._address} has ended or was restarted; start it again, and the same "
                "command runs what is not kept yet."
            )
        if type(error).__name__ == "KilledWorker":
            return RigtwinError("its workers ended one after the other, most likely because memory ran out.")
        return error


def _same_version(found: dict[str, Any]) -> None:
    for worker, version in found.items():
        if isinstance(version, Exception):
            raise BadInput(f"--cluster: the worker {worker} has no rigtwin ({version}); install {__version__} there.")
        if version != __version__:
            raise BadInput(
                f"--cluster: the worker {worker} has rigtwin {version}, this is {__version__}; install the same on all."
            )


@contextmanager
def batch(jobs: int, folder: Path, parameters: dict[str, Any]) -> Iterator[Pool]:
    """Open jobs of a batch system, one for each run.

    Parameters
    ----------
    jobs : int
        Number of runs.
    folder : Path
        Folder of the logs.
    parameters : dict
        Those of submitit, for example ``slurm_partition``; ``cluster`` "local" makes processes of this machine instead,
        to try a campaign out.

    Yields
    ------
    Pool
        The jobs.

    Raises
    ------
    BadInput
        If submitit is not installed, or the batch system cannot be used.
    """
    try:
        import submitit
    except ImportError:
        raise BadInput('--cluster: needs submitit; install it with pip install "rigtwin[slurm]".') from None
    chosen = dict(parameters)
    try:
        executor = submitit.AutoExecutor(folder, cluster=chosen.pop("cluster", "slurm"))
        executor.update_parameters(**{"name": "rigtwin", "cpus_per_task": 1, "timeout_min": 60, **chosen})
    except Exception as error:  # submitit raises RuntimeError, NameError, ValueError and its own
        raise BadInput(f"--cluster: slurm cannot be used ({_reason(error)}); check that sbatch works here.") from None
    queue = _Queue(executor)
    try:
        yield Pool(queue, min(jobs, JOBS))
    finally:
        queue.end()


class _Queue:
    """Jobs of submitit as futures."""

    def __init__(self, executor: Any) -> None:
        self._executor = executor
        self._waiting: dict[Future[Any], Any] = {}
        self._change = threading.Lock()
        self._ended = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()
        try:
            job = self._executor.submit(_caught, function, *arguments)
        except Exception as error:  # submitit raises its own, RuntimeError and OSError
            raise ClusterLost(
                f"--cluster: slurm takes no job ({_reason(error)}); check that sbatch works here."
            ) from None
        with self._change:
            self._waiting[future] = job
        return future

    def end(self) -> None:
        """Cancel what has not finished."""
        self._ended.set()
        with self._change:
            for job in self._waiting.values():
                with suppress(Exception):
                    job.cancel(check=False)

    def _watch(self) -> None:
        while not self._ended.wait(POLL):
            with self._change:
                finished = {future: job for future, job in self._waiting.items() if _is_done(job)}
                for future in finished:
                    del self._waiting[future]
            for future, job in finished.items():
                try:
                    found = job.result()
                except Exception as error:
                    log = job.paths.stderr
                    found = RigtwinError(f"its job ended without a result ({_reason(error)}); its log is {log}.")
                if isinstance(found, Exception):
                    future.set_exception(found)
                else:
                    future.set_result(found)


def _caught(function: Callable[..., Any], *arguments: Any) -> Any:
    """The result, or the exception with its traceback as a note: submitit itself would give its text only."""
    try:
        return function(*arguments)
    except Exception as error:
        error.add_note(traceback.format_exc())
        return error


def _is_done(job: Any) -> bool:
    try:
        return bool(job.done())
    except Exception:  # the batch system does not answer for the moment
        return False


def _reason(error: Exception) -> str:
    lines = str(error).splitlines()
    return lines[0].rstrip(".: ") if lines else type(error).__name__


def _parameters(text: str) -> dict[str, Any]:
    """``partition=long,timeout_min=120`` as parameters of submitit."""
    found: dict[str, Any] = {}
    for item in filter(None, text.split(",")):
        name, equals, value = (part.strip() for part in item.partition("="))
        if not (name and equals and value):
            raise BadInput(f"--cluster: {item!r} is not like partition=long; correct it.")
        known = name if name in ("cluster", "timeout_min", "mem_gb", "cpus_per_task") else f"slurm_{name}"
        found[known] = int(value) if value.isdecimal() else value
    return found
