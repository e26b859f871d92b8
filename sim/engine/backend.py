"""Import and start of Taichi, in one place.

Taichi prints on stdout (a banner at import, a line at start).  stdout is reserved for results, so both are suppressed.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import inspect
import linecache
import os
import stat
import sys
import tempfile
import textwrap
import threading
import types
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigtwin.lab.errors import BadInput, RigtwinError
from rigtwin.sim.engine.device import DEVICES, Device, usual_device

GRAIN = 512  # smallest number of iterations of a parallel loop that Taichi gives to a thread on CPUs

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
# kernels print nothing; without this Taichi prints a notice where stdout has been replaced
os.environ.setdefault("TI_ENABLE_PYBUF", "0")


@contextlib.contextmanager
def _no_collecting() -> Iterator[None]:
    """Pause the garbage collector: many small objects are created, all of which stay alive."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextlib.contextmanager
def _quick_frames() -> Iterator[None]:
    """Replace `inspect.getframeinfo` by a version without a search through all modules.

    Taichi's decorators call it some hundred times during the import.
    """

    def quick(frame: Any, context: int = 1) -> Any:
        code, line = frame.f_code, frame.f_lineno
        return inspect.Traceback(code.co_filename, line, code.co_name, [linecache.getline(code.co_filename, line)], 0)

    thorough = inspect.getframeinfo
    inspect.getframeinfo = quick
    try:
        yield
    finally:
        inspect.getframeinfo = thorough


@contextlib.contextmanager
def _left_out() -> Iterator[None]:
    """Replace two modules that Taichi imports, and that are not needed here, by empty ones.

    `taichi._version_check` asks a server for a newer version at the first start of a day, to which the user has not
    agreed, and imports Python's network libraries for it.  `dill` finds the source of functions typed into a shell.
    """
    empty = {name: types.ModuleType(name) for name in ("taichi._version_check", "dill") if name not in sys.modules}
    for module in empty.values():
        module.start_version_check_thread = lambda: None  # type: ignore[attr-defined]
    sys.modules.update(empty)
    try:
        yield
    finally:
        for name in empty:
            del sys.modules[name]


with warnings.catch_warnings(), _quick_frames(), _no_collecting(), _left_out():
    warnings.simplefilter("ignore")  # Taichi 1.7 asks for a deprecated locale call while it loads
    import taichi

ti: Any = taichi
LEAN = (1, 7, 4)  # version of Taichi for which the start is patched


def _make_start_lean() -> None:
    """Patch Taichi to avoid work that it repeats at each start for every line of every kernel, cached or not.

    Taichi formats the source of each expression for error messages, searches all modules to find out whether a
    function belongs to a class, and reads and wraps a function's source again at each call: together more than half of
    the time that a start spends in Python.  The results are the same, except for the layout of error messages.
    """
    from taichi.lang import kernel_impl
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

    def position(context: Any, node: Any) -> str:
        line = f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:'
        return f"{line}\n{context.src[node.lineno - 1]}\n"

    def inside_class(level_of_class_stackframe: int) -> bool:
        return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals

    def unfolded(line: str, **_settings: int) -> str:
        return line.rstrip("\n").expandtabs(4)

    @functools.cache
    def source(function: Any) -> tuple[list[str], int]:
        """Source lines and number of the first; faster than `inspect`, which tokenises the source to find the last."""
        code = function.__code__
        last = max(end or 0 for _, end, _, _ in code.co_positions())
        return linecache.getlines(code.co_filename)[code.co_firstlineno - 1 : last], code.co_firstlineno

    thorough = kernel_impl.Kernel.materialize

    def materialize(self: Any, *arguments: Any, **settings: Any) -> None:
        with _no_collecting():
            thorough(self, *arguments, **settings)

    kernel_impl.Kernel.materialize = materialize
    ASTTransformerContext.get_pos_info = position
    kernel_impl._inside_class = inside_class
    kernel_impl.getsourcelines = source
    kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
    kernel_impl.textwrap = types.SimpleNamespace(fill=unfolded, dedent=textwrap.dedent)


if taichi.__version__ == LEAN:
    _make_start_lean()


@dataclass(frozen=True)
class Backend:
    """Where the kernels run."""

    device: Device
    threads: int
    note: str = ""  # reason if the device is not the requested one


_running: Backend | None = None


def available_threads() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start(threads: int | None = None, device: Device | None = None) -> Backend:
    """Start Taichi once per process and return the backend; later calls return the running one.

    Without a `device`: the running one, else `usual_device()`.  float64, no fast-math; compiled kernels are cached on
    disk between processes.  `device` "cuda" falls back to the CPU with a note if there is no CUDA device; "auto" uses
    the running backend, else CUDA if there is one.  A process has one device, which holds all fields.  Do not fork
    after this call: a forked child hangs; spawn it instead.
    """
    global _running  # noqa: PLW0603  Taichi itself is one global per process
    if device is None:
        device = _running.device if _running is not None else usual_device()
    if device not in DEVICES:
        raise BadInput(f"device: {device!r} is unknown; use {', '.join(map(repr, DEVICES))}.")
    if threads is not None and threads < 1:
        raise BadInput(f"threads: {threads} is too few; give at least 1.")
    if _running is not None:
        if device == "cuda" and _running.device == "cpu" and not _running.note:
            raise RigtwinError("The engine already runs on the CPU in this process; start a new process for CUDA.")
        if device == "cpu" and _running.device == "cuda":
            raise RigtwinError("The engine already runs on CUDA in this process; start a new process for the CPU.")
        return _running
    if threading.current_thread() is not threading.main_thread():
        raise RigtwinError("The engine must be started in the main thread; call it there, or in a process of its own.")
    wanted, note = device, ""
    if wanted != "cpu":
        device = "cuda" if _cuda_present() else "cpu"
    if wanted == "cuda" and device == "cpu":
        note = "no CUDA device was found; the engine runs on the CPU"
    workers = threads or available_threads()
    os.environ[CACHE] = _cache_folder()  # Taichi prefers the variable to an argument
    with _quiet_stdout():
        ti.init(
            arch=ti.cuda if device == "cuda" else ti.cpu,
            default_fp=ti.f64,
            fast_math=False,
            offline_cache=True,
            # measured: this pass takes longer than all others together and gains nothing over LLVM's own
            cfg_optimization=False,
            cpu_max_num_threads=workers,
            log_level=ti.ERROR,
            random_seed=0,
        )
    _running = Backend(device, workers, note)
    return _running


CACHE = "TI_OFFLINE_CACHE_FILE_PATH"  # environment variable of Taichi: folder of compiled kernels


def _cache_folder() -> str:
    """Folder in which Taichi keeps compiled kernels: the stated or its usual one, else one for temporary files.

    Where it cannot write into its folder, Taichi ends the process with a segmentation fault.
    """
    with contextlib.suppress(OSError, RuntimeError):  # no home, a read-only one
        usual = Path(os.environ.get(CACHE) or Path.home() / ".cache" / "taichi" / "ticache")
        usual.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=usual):
            return str(usual)
    if hasattr(os, "getuid"):
        own = Path(tempfile.gettempdir()) / f"rigtwin-kernels-{os.getuid()}"
        with contextlib.suppress(OSError):
            own.mkdir(mode=0o700, exist_ok=True)
            state = own.lstat()
            # code is run from there: no other user may have made it or write into it
            if stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not state.st_mode & 0o077:
                return str(own)
    return tempfile.mkdtemp(prefix="rigtwin-kernels-")


def running() -> Backend:
    """The running backend of this process; started on the CPU if there is none yet."""
    return _running or start()


def prepared(kernel: Any, *arguments: Any) -> Callable[..., None]:
    """Return a launcher of a kernel, which takes new values for those of the `arguments` that are no templates.

    These must be numbers.  At an ordinary call Taichi looks up arguments and code again, which may take longer than a
    step of few beads.
    """
    inner = kernel._primal
    templates = [isinstance(one.annotation, ti.template) for one in inner.arguments[1:]]  # the first is the owner
    if taichi.__version__ != LEAN:

        def ordinary(*values: float) -> None:
            given = iter(values)
            kernel(*(one if fixed else next(given) for one, fixed in zip(arguments, templates, strict=True)))

        return ordinary
    compiled = inner.compiled_kernels[inner.ensure_compiled(kernel._kernel_owner, *arguments)]
    program = inner.runtime.prog
    code = program.compile_kernel(program.config(), program.get_device_caps(), compiled)
    context = compiled.make_launch_context()
    numbers = [one.annotation for one, fixed in zip(inner.arguments[1:], templates, strict=True) if not fixed]
    setters = [context.set_arg_float if one in (ti.f32, ti.f64) else context.set_arg_int for one in numbers]

    def launch(*values: float) -> None:
        for place, (setter, value) in enumerate(zip(setters, values, strict=True)):
            setter((place,), value)
        program.launch_kernel(code, context)

    return launch


def _cuda_present() -> bool:
    with _quiet_stdout(), contextlib.suppress(Exception):
        ti.set_logging_level(ti.ERROR)  # Taichi warns on standard error where there is no driver
        return bool(taichi.lang.misc.is_arch_supported(ti.cuda))
    return False


@contextlib.contextmanager
def _quiet_stdout() -> Iterator[None]:
    """Discard what Python or Taichi's library prints in this context."""
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):  # noqa: PTH123
        yield
