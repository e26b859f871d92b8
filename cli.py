"""The door: parse, call one function, print.

stdout carries the result (a table, or one JSON document with ``--json``), stderr the progress and the errors.
Only typer and rich are imported at the top, so that ``--help`` answers at once.
"""

from __future__ import annotations

import errno
import os
import re
import select
import signal
import sys
import time
import warnings
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Literal

import typer

from rigtwin.commands import calibrate as calibrating
from rigtwin.commands import decks, doctor, labs, log_file, measure, review, runs, simulate
from rigtwin.commands import sweep as sweeping
from rigtwin.commands.display import (
    comparison_warnings,
    print_json,
    reproduction_warnings,
    show_comparison,
    show_reproduction,
)
from rigtwin.commands.options import Cluster, Json, Quiet, Runs, Seed, Threads, out_option
from rigtwin.commands.run_command import Work, finished
from rigtwin.lab.spelling import near
from rigtwin.lab.units import MOST_PARTICLES, MOST_RUNS
from rigtwin.lab.version import __version__

app = typer.Typer(
    name="rigtwin",
    help="Measure granular materials from videos and photos, simulate the same rigs, set the two side by side.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help pages: typer's decorated ones take twice as long to show
    context_settings={"help_option_names": ["--help", "-h"]},
)
app.add_typer(measure.app, name="measure")
app.add_typer(simulate.app, name="simulate")

WORDING = (  # how the parser of options says what we say elsewhere
    (r"^Invalid value for '([^']+)'(?: / '[^']+')*: ", r"\1: "),
    (r"Input should be a valid (?:integer|number), .*", "is not a whole number."),
    (r"Input should be greater than or equal to", "is too small; give at least"),
    (r"Input should be less than or equal to", "is too large; give at most"),
    (r"Value error, ", ""),
)
PROPOSED = r"\. Did you mean .*$| \(Possible options: .*\)$"
UNKNOWN = r"No such command '(.*?)'"

CLEARED_UP = 5.0  # [s] after Ctrl-C, within which files are closed and worker processes ended

Count = Annotated[
    int, typer.Option("--count", min=1, max=MOST_PARTICLES, help="Number of particles poured on the base.")
]
DemoOut = Annotated[Path | None, out_option("Folder for results; out/demo by default.")]
ReproductionOut = Annotated[Path | None, out_option("Folder for results; out/reproduce/hlosta2020 by default.")]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rigtwin {__version__}")
        raise typer.Exit


@app.callback()
def _rigtwin(
    *,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and leave.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Options that stand before the command."""


@app.command(epilog="Example: rigtwin demo --out out/demo")
@finished(show_comparison, comparison_warnings)
def demo(*, out: DemoOut = None, count: Count = 1000, seed: Seed = 1, runs: Runs = 1, threads: Threads = None) -> Work:
    """Measure the sample media, run their twins, write a report."""
    from rigtwin.lab.errors import BadInput

    lab = Path(__file__).parent / "sample_media"
    if not (lab / "lab.toml").is_file():
        raise BadInput(
            f"{lab}: the sample media are missing from this installation; install rigtwin again, or run "
            "`rigtwin compare LAB` on a lab folder of your own."
        )
    from rigtwin.compare.compare_lab import compare as compare_lab

    return partial(compare_lab, lab, out or Path("out/demo"), count=count, seed=seed, runs=runs, threads=threads)


@app.command(epilog="Example: rigtwin init my-lab")
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The new lab folder.")],
    *,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make a new lab folder with a commented lab.toml."""
    from rigtwin.lab.file.lab_file import new_lab

    written = new_lab(folder)
    if as_json:
        print_json({"lab": str(folder), "files": [str(path) for path in written]})
    elif not quiet:
        typer.echo(
            f"Wrote {', '.join(map(str, written))}. Describe your rigs there, put the media beside it, then: "
            f"rigtwin compare {folder}"
        )


app.command(epilog="Example: rigtwin compare my-lab --only drop-D6-steel --out results")(labs.compare)
app.command(
    epilog="Example: rigtwin sweep packing --set cylinder_diameter=65mm --wall PMMA --count 800 "
    "--vary static_friction=0.05..1.5:8 --vary rolling_friction=0.01..0.3:7"
)(sweeping.sweep)
app.command(epilog="Example: rigtwin calibrate my-lab --fit static_friction --hold-out hopper-34mm")(
    calibrating.calibrate
)
app.command(epilog="Example: rigtwin diagnose tracked-lab --out diagnosis")(labs.diagnose)
app.command(epilog="Example: rigtwin review my-lab")(review.review)


app.command(epilog="Example: rigtwin doctor --json")(doctor.doctor)
app.command(epilog="Example: rigtwin runs out/reproduce/hlosta2020 export runs.parquet")(runs.runs)
app.add_typer(decks.app, name="export")
app.command("import", epilog="Example: rigtwin import out/liggghts-pile")(decks.import_deck)


def _show_reproduction(found: Any, as_json: bool, quiet: bool) -> None:
    show = show_reproduction if _of_tables(found) else calibrating.show_paper
    show(found, as_json, quiet)


def _reproduction_warnings(found: Any) -> Sequence[str]:
    if _of_tables(found):
        return reproduction_warnings(found)
    return [remark for one in found.found.values() for remark in one.remarks]


def _of_tables(found: Any) -> bool:
    """Whether the result holds the paper's tables, not a calibration on its measurements."""
    from rigtwin.compare.reproduce.reproduce import Reproduction

    return isinstance(found, Reproduction)


@app.command(epilog="Example: rigtwin reproduce hlosta2020 --table 14 --repetitions 3")
@finished(_show_reproduction, _reproduction_warnings)
def reproduce(
    reference: Annotated[Literal["hlosta2020"], typer.Argument(help="The published tables: hlosta2020.")],
    *,
    table: Annotated[
        list[int] | None, typer.Option("--table", metavar="N", help="Only this table; may be given again.")
    ] = None,
    study: Annotated[
        list[str] | None, typer.Option("--study", metavar="NAME", help="An influence study: number, base, evaluation.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A representative part, in minutes; of a study one heap a point.")
    ] = False,
    kept: Annotated[bool, typer.Option("--kept", help="Run nothing; show what earlier runs gave.")] = False,
    calibrated: Annotated[
        bool,
        typer.Option(
            "--calibrated", help="Calibrate on the paper's measurements first; its parameters are not used then."
        ),
    ] = False,
    particle: Annotated[
        list[str] | None,
        typer.Option("--particle", metavar="NAME", help="Calibrate only this particle; may be given again."),
    ] = None,
    budget: Annotated[
        int | None, typer.Option("--budget", min=1, help="Largest number of twins for a calibration; 60 by default.")
    ] = None,
    rolling_model: simulate.RollingModel = "A",
    repetitions: Annotated[
        int | None,
        typer.Option(
            "--repetitions", min=1, max=MOST_RUNS, help="Runs with different seeds per cell or point of a study."
        ),
    ] = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Runs at a time; one per core.")] = None,
    cluster: Cluster = None,
    seed: Seed = 1,
    out: ReproductionOut = None,
) -> Work:
    """Published tables beside what the twins give.

    The twins run with the published parameters. A run is kept when it ends; called again, only missing ones are run.
    """
    from rigtwin.compare.reproduce.reproduce import reproduce as fill
    from rigtwin.lab.errors import BadInput

    if calibrated:
        of_tables = {"--table": table, "--study": study, "--quick": quick, "--kept": kept, "--repetitions": repetitions}
        for option, value in of_tables.items():
            if value:
                raise BadInput(f"{option}: does not go with --calibrated; leave one of them out.")
        from rigtwin.compare.reproduce.calibrated import reproduce_calibrated

        return partial(
            reproduce_calibrated,
            out or Path("out/reproduce") / reference,
            particles=particle,
            budget=budget or 60,
            rolling=simulate.rolling_law(rolling_model),
            seed=seed,
            workers=workers,
            cluster=cluster,
        )
    for option, given in {"--particle": particle, "--budget": budget}.items():
        if given:
            raise BadInput(f"{option}: belongs to --calibrated; add that, or leave it out.")
    return partial(
        fill,
        out or Path("out/reproduce") / reference,
        tables=table,
        study=study,
        quick=quick,
        only_kept=kept,
        rolling=simulate.rolling_law(rolling_model),
        repetitions=repetitions,
        seed=seed,
        workers=workers,
        cluster=cluster,
    )


def main() -> None:
    """Entry point of the command ``rigtwin``; leaves with 0, 1 (our fault), 2 (bad input) or 130 (interrupted)."""
    if sys.stdout is None:  # started with stdout closed: results still go into files
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # what it says of damaged pictures stands in our sentence
    signal.signal(signal.SIGINT, _Interrupts())
    if not sys.warnoptions:  # numbers that are no use are refused in words
        warnings.simplefilter("ignore")
    code = run(sys.argv[1:])
    # what is left is the end of Python, which Ctrl-C may cut short, but not to change the exit code of an interrupt
    signal.signal(signal.SIGINT, signal.SIG_IGN if code == 130 else signal.SIG_DFL)
    sys.exit(code)


class _Interrupts:
    """Ctrl-C as ever; again while that is being handled it changes nothing, and after that time it ends the process."""

    def __init__(self) -> None:
        self._first: float | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if self._first is None:
            self._first = time.monotonic()
            signal.default_int_handler(number, frame)
        if time.monotonic() - self._first > CLEARED_UP:
            os._exit(130)


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code; every error becomes one sentence, or one JSON document."""
    code = _run(arguments)
    log_file.end(code)
    return code


@cache
def _command() -> Any:
    """All commands with their options.

    Cached: a process that runs many commands, such as the tests, would read them off the functions in 0.1 s each time.
    """
    return typer.main.get_command(app)


def _run(arguments: list[str]) -> int:
    as_json = "--json" in arguments
    try:
        code = _command()(arguments, prog_name="rigtwin", standalone_mode=False)
    except typer.TyperException as error:  # unknown option, missing argument
        if type(error).__name__ == "NoArgsIsHelpError":  # a group alone: its words are the whole help page
            typer.echo(error.format_message(), err=True)
            return 2
        return _fail("usage", _usage(error), 2, as_json)
    except SystemExit as leaving:  # so typer ends where it cannot print
        if isinstance(leaving.__context__, BrokenPipeError) and _reader_left():
            return 0
        raise
    except KeyboardInterrupt:  # typer turns only one that comes while a command runs into a code
        return _interrupted(as_json)
    except Exception as error:
        return _fault(error, as_json, arguments)
    if code == 130:  # typer's word for Ctrl-C
        return _interrupted(as_json)
    return code if isinstance(code, int) else 0


def _engine_without_memory(error: Exception) -> bool:
    """Whether Taichi, on a processor or a graphics card, was given no memory."""
    words = r"memory allocation|allocate memory|out of memory"
    return isinstance(error, RuntimeError) and re.search(words, str(error), re.IGNORECASE) is not None


def _reader_left() -> bool:
    """Whether no one reads stdout any more, as in `rigtwin ... | head`."""
    if not hasattr(select, "poll"):  # Windows
        return False
    stdout = select.poll()
    stdout.register(1, select.POLLOUT)
    broken = any(state & select.POLLERR for _, state in stdout.poll(0))
    return broken or os.path.samestat(os.fstat(1), Path(os.devnull).stat())  # rich has turned to the latter


def _interrupted(as_json: bool) -> int:
    return _fail("interrupted", "interrupted; results of earlier runs are as they were.", 130, as_json)


def _less_memory(arguments: list[str]) -> str:
    """What to ask less of, by the command that was running."""
    if "simulate" in arguments or "reproduce" in arguments:
        return "ask for fewer particles, a shorter time or a lower frame rate"
    if "measure" in arguments:
        return "give a shorter clip (cut it, or choose its part with --start and --end) or smaller pictures"
    return "close other programs, or name fewer experiments with --only"


def _fault(error: Exception, as_json: bool, arguments: list[str]) -> int:
    from rigtwin.lab.errors import Interrupted, RigtwinError
    from rigtwin.lab.output_files import FULL

    if os.environ.get("RIGTWIN_DEBUG"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, Interrupted):
        return _fail("interrupted", str(error), error.exit_code, as_json)
    if isinstance(error, RigtwinError):
        return _fail(type(error).__name__, str(error), error.exit_code, as_json, error)
    number = getattr(error, "errno", None)
    if isinstance(error, ImportError) and "failed to map segment" in str(error):  # the system's loader
        library = str(error).partition(":")[0]
        message = f"{library}: cannot be loaded, for want of memory or because programs may not be run from its folder"
        return _fail("memory", f"{message}; {_less_memory(arguments)}.", 2, as_json)
    if isinstance(error, MemoryError) or number == errno.ENOMEM or _engine_without_memory(error):
        return _fail("memory", f"this does not fit into memory; {_less_memory(arguments)}.", 2, as_json)
    if number == errno.EAGAIN or str(error) == "can't start new thread":  # where memory is short for its stack, too
        message = (
            "the system gives no further thread, for want of memory or by a limit; close other programs, or raise the "
            "limit (`ulimit -a` shows it)."
        )
        return _fail("memory", message, 2, as_json)
    if isinstance(error, OSError) and (error.filename is not None or number in FULL):  # a folder that cannot be made
        reason = (error.strerror or "cannot be used").lower()
        advice = (
            "free some space, or name a place on another disk"
            if number in FULL
            else "check the path and its permissions"
        )
        where = f"{error.filename}: " if error.filename is not None else "a file could not be written: "
        return _fail("file", f"{where}{reason}; {advice}.", 2, as_json)
    reason = f"{type(error).__name__}: {error}".splitlines()[0]
    message = f"a fault of rigtwin itself ({reason}); set RIGTWIN_DEBUG=1 and run again to see the traceback."
    return _fail("fault", message, 1, as_json, error)


def _fail(kind: str, message: str, code: int, as_json: bool, error: Exception | None = None) -> int:
    from rigtwin.lab.errors import BadLabFile

    sentence = _printable(message)
    log_file.failure(sentence, code, error)
    faults = [_printable(fault) for fault in error.faults] if isinstance(error, BadLabFile) else []
    if as_json:
        several = {"faults": faults} if faults else {}
        print_json({"error": {"type": kind, "message": sentence, "exit_code": code, **several}})
    elif isinstance(error, BadLabFile) and faults:
        typer.echo("\n  ".join([f"rigtwin: {_printable(error.headed)}:", *faults]), err=True)
    else:
        typer.echo(f"rigtwin: {sentence}", err=True)
    return code


def _printable(message: str) -> str:
    """The message on one line; what a terminal would take as a command is escaped."""
    line = " ".join(message.split())
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in line)


def _meant(error: Any, context: Any) -> str:
    """What to give in place of an unknown command or option: the one that is near, or all commands."""
    if option := getattr(error, "option_name", ""):
        meant, known = near(option, [name for one in context.command.get_params(context) for name in one.opts]), []
    elif unknown := re.match(UNKNOWN, error.format_message()):
        known = context.command.list_commands(context)
        meant = near(unknown[1], known)
    else:
        return ""
    return f"; did you mean {meant!r}" if meant else f"; there are {', '.join(known)}" if known else ""


def _usage(error: typer.TyperException) -> str:
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "rigtwin"
    words = error.format_message()
    for theirs, ours in WORDING:
        words = re.sub(theirs, ours, words)
    words = re.sub(PROPOSED, "", words).rstrip(".?")
    meant = _meant(error, context) if context is not None else ""
    return f"{words}{meant}; see `{command} --help`."


if __name__ == "__main__":
    main()
