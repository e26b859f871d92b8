"""Make `import rigtwin` work from a bare clone as it does from an install."""

import importlib.util
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# each process of pytest-xdist has one core: threads for a second one cost time and gain none
if "PYTEST_XDIST_WORKER" in os.environ:
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
        os.environ.setdefault(threads, "1")

# the first call of a heavy library takes longer than any deadline; the same examples every time
settings.register_profile("rigtwin", deadline=None, derandomize=True)
settings.load_profile("rigtwin")

if importlib.util.find_spec("rigtwin") is None:
    root = Path(__file__).parents[1]
    spec = importlib.util.spec_from_file_location(
        "rigtwin", root / "__init__.py", submodule_search_locations=[str(root)]
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["rigtwin"] = module
    spec.loader.exec_module(module)


# each process compiles the engine's kernels and weighs the paper's clumps anew: one runs all tests that need them
ENGINE = ("tests/sim/", "tests/compare/", "tests/test_cli.py", "tests/test_api.py", "tests/lab/test_clumps.py")
NO_ENGINE = ("tests/compare/diagnose/",)
# next to nothing is shared among these: they fill up the process that would be ready first
SINGLE = ("tests/measure/hopper/", "tests/measure/drum/")


def process_of(test: str) -> str:
    """The name of the group of tests that one process runs: by default those of one file, which share its fixtures."""
    if test.startswith(ENGINE) and not test.startswith(NO_ENGINE):
        return "engine"
    return test if test.startswith(SINGLE) else test.partition("::")[0]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """What `--dist loadscope` hands to a process at a time; the largest groups come first."""
    from xdist.scheduler import LoadScopeScheduling

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return process_of(nodeid)

    return Groups(config, log) if config.getoption("dist") == "loadscope" else None


@pytest.fixture(autouse=True)
def usual_ctrl_c() -> None:
    """Every test begins with Python's own handling of Ctrl-C: the command line, run in this process, sets another."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


class AtOnce(Executor):
    """Does each job where it is submitted."""

    size = 1

    def submit(self, job: Callable[..., Any], /, *arguments: Any, **settings: Any) -> Future[Any]:
        done: Future[Any] = Future()
        try:
            done.set_result(job(*arguments, **settings))
        except Exception as error:
            done.set_exception(error)
        return done


@contextmanager
def _in_one_process() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for place in ("measure_repetitions", "campaign.runners"):
            patch.setattr(f"rigtwin.compare.{place}.spawned", lambda *_, **__: nullcontext(AtOnce()))
        yield


@pytest.fixture(scope="session")
def one_process() -> Callable[..., AbstractContextManager[None]]:
    """`with one_process():` as `in_this_process`, for fixtures that several tests share."""
    return _in_one_process


@pytest.fixture
def in_this_process() -> Iterator[None]:
    """`compare` and `reproduce` work here: for tests of what they find, not of the processes that find it."""
    with _in_one_process():
        yield


class PowerCut(Exception):
    """What breaks a run off."""


@pytest.fixture
def broken_off() -> Callable[..., None]:
    """`broken_off(run, look, **settings)`: the run until the power fails at the `look`-th report of its progress."""

    def broken_off(run: Callable[..., Any], look: int, **settings: Any) -> None:
        looks = 0

        def progress(_stage: str, _done: float, _total: float) -> None:
            nonlocal looks
            looks += 1
            if looks == look:
                raise PowerCut

        with pytest.raises(PowerCut):
            run(progress=progress, **settings)

    return broken_off
