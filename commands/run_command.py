"""How every command ends: progress bars, the work, and what came out kept and shown.

A command decorated here reads its own options and returns its work as a function that is still to be called; options
such as ``--json`` are added to its own.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any

import typer

from rigtwin.commands import log_file
from rigtwin.commands.display import kept_in_words, progress_bars, show_measurement, show_twin
from rigtwin.commands.options import Command, Json, Quiet, default_folder, out_option, with_options

Work = partial[Any]

JSON_QUIET = {"as_json": (Json, False), "quiet": (Quiet, False)}
LOGGED = {"log": (log_file.Log, None), **JSON_QUIET}  # of work that takes long; the file is open when the work begins


def finished(show: Callable[[Any, bool, bool], None], warnings_of: log_file.WarningsOf) -> Callable[[Command], Command]:
    """Do a command's work under progress bars; `show` prints the result, `warnings_of` it goes into ``--log``."""

    def around(own: Command, *, as_json: bool, quiet: bool, **_log: Path | None) -> None:
        show(log_file.warned(_done(own(), hidden=as_json or quiet), warnings_of), as_json, quiet)

    return lambda command: with_options(command, LOGGED, around)


def measured(rig: str) -> Callable[[Command], Command]:
    """Measure; the first argument of the work is the clip, or the list of photos."""

    def folder_text(command: Command) -> str:
        name = "the photo's" if media_of(command) == "photos" else "the clip's"
        return (
            f"Folder for results; by default out/{rig}/NAME (NAME being {name}), "
            "with ~2, ~3 ... behind it where another input's results stand."
        )

    def around(own: Command, *, out: Path | None, as_json: bool, quiet: bool, **_log: Path | None) -> None:
        work: Work = own()
        from rigtwin.commands.output_folder import check_own, claimed, keep, results_folder

        with ExitStack() as claim:
            if out is None:
                default_folder(Path(f"out/{rig}"))
                out = claim.enter_context(results_folder(rig, work.args[0]))
            else:
                claim.enter_context(claimed(out))
                check_own(out, rig, work.args[0])
            measurement = keep(_done(partial(work, out=out), hidden=as_json or quiet), out, work.args[0])
        show_measurement(log_file.warned(measurement, attrgetter("warnings")), as_json, quiet)

    return lambda command: with_options(command, _with_out(folder_text(command)), around)


def media_of(command: Command) -> str:
    """The name of the command's first parameter: "clip", or "photos" of which there may be several."""
    return next(iter(inspect.signature(command).parameters))


def simulated(rig: str) -> Callable[[Command], Command]:
    """Run a twin; its record and quantities go into the results' folder."""
    default = Path(f"out/simulate-{rig}")

    def around(own: Any, *, out: Path | None, as_json: bool, quiet: bool, **_log: Path | None) -> None:
        with errors_by_option(own.keywords):
            work, hidden, folder = own(), as_json or quiet, out or default_folder(default)
            from rigtwin.commands.output_folder import check_only, claimed

            check_only(rig, folder)
            claim = claimed(folder)
        with claim:
            with errors_by_option(own.keywords):
                checkpoint = work.keywords.get("checkpoint")
                going_on = "" if checkpoint is None or hidden else kept_in_words(checkpoint)
                twin = _done(work, hidden=hidden, first=going_on)
            log_file.warned(twin, lambda found: (*found.warnings, *found.evaluation.warnings))
            show_twin(twin, folder, as_json, quiet)

    return lambda command: with_options(command, _with_out(f"Folder for results; {default} by default."), around)


@contextmanager
def errors_by_option(names: Collection[str]) -> Iterator[None]:
    """A refusal that begins with the name of a setting begins with its option instead, where there is one."""
    from rigtwin.lab.errors import BadInput

    try:
        yield
    except BadInput as error:
        name, colon, why = str(error).partition(":")
        if not colon or name not in names:
            raise
        raise BadInput(f"--{name.replace('_', '-')}:{why}") from error


def _done(work: Work, *, hidden: bool, first: str = "") -> Any:
    """Result of the work; `first` is printed at its first progress or its end, so refused work prints nothing."""

    @cache
    def tell() -> None:
        if first:
            typer.echo(first, err=True)

    with progress_bars(hidden) as bars:
        write = log_file.steps()

        def progress(stage: str, done: float, total: float) -> None:
            tell()
            write(stage, done, total)
            bars(stage, done, total)

        try:
            found = work(progress=progress)
            tell()
            return found
        except KeyboardInterrupt as stop:
            if not (kept := getattr(stop, "__notes__", None)):
                raise
            from rigtwin.lab.errors import Interrupted

            raise Interrupted(f"interrupted; {' '.join(kept)}") from stop


def _with_out(help_text: str) -> dict[str, tuple[Any, Any]]:
    return {"out": (Annotated[Path | None, out_option(help_text)], None), **LOGGED}
