"""How results are shown: tables for a person, one JSON document for a program, progress on stderr."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.markup import escape

from rigtwin.commands.log_file import LOG_EVERY, LOGGER
from rigtwin.lab.formatting import counted

if TYPE_CHECKING:
    from rich.console import Console

    from rigtwin.compare.campaign.store import Kept
    from rigtwin.compare.comparison import Comparison
    from rigtwin.compare.deviation import Deviation
    from rigtwin.compare.diagnose.bulk.diagnose_bulk import BulkDiagnosis
    from rigtwin.compare.diagnose.diagnosis import Diagnosis
    from rigtwin.compare.measure_lab import LabMeasurements
    from rigtwin.compare.measure_repetitions import Measured
    from rigtwin.compare.reproduce.reproduce import Reproduction
    from rigtwin.compare.twins.twin import Twin
    from rigtwin.lab.progress import Progress
    from rigtwin.lab.quantity import Check, Measurement, Quantity


@contextmanager
def progress_bars(hidden: bool) -> Iterator[Progress]:
    """Progress bars on stderr while a person watches; a line now and then where stderr goes to a file."""
    if hidden or not sys.stderr.isatty():
        from rigtwin.lab.progress import silent

        yield silent if hidden else _progress_lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    # runs of a table end minutes apart, and the time left goes by those within the period
    with Progress(*columns, console=Console(stderr=True), transient=True, speed_estimate_period=3600) as bars:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: float, total: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total or None)
            bars.update(tasks[stage], completed=done, total=total or None)

        yield show


def _progress_lines() -> Progress:
    """A line every LOG_EVERY seconds; a command that ends sooner prints none."""
    last = time.monotonic()

    def show(stage: str, done: float, total: float) -> None:
        nonlocal last
        if time.monotonic() - last < LOG_EVERY:
            return
        last = time.monotonic()
        share = f": {100 * done / total:.0f} %" if total else ""
        sys.stderr.write(f"{stage}{share}\n")
        sys.stderr.flush()

    return show


def print_json(document: dict[str, Any]) -> None:
    """One JSON document on stdout."""
    from rigtwin.compare.result_files import plain

    sys.stdout.write(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def _console() -> Console:
    from rich.console import Console

    # a pipe has no width of its own: keep one row of a table on one line
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False)


def show_measurement(measurement: Measurement, as_json: bool, quiet: bool) -> None:
    """What a measurement gave."""
    if as_json:
        print_json(measurement.to_json())
        return
    if quiet:
        return
    console = _console()
    _show_quantities(console, f"{measurement.rig}: {measurement.source.name}", measurement.quantities)
    if measurement.table:
        console.print(f"[dim]table:[/dim] {escape(measurement.table['in_words'])}")
    _show_scale(console, measurement.camera)
    _show_rest(console, measurement.checks, measurement.warnings, measurement.files, measurement.quantities)


def _show_scale(console: Console, camera: Mapping[str, Any]) -> None:
    """What pixels and frames were taken for, and where that is from."""
    from rigtwin.lab.formatting import relative_uncertainty

    views = camera.get("views") or [camera]
    for source in dict.fromkeys(view.get("scale_from") for view in views):
        mine = [view for view in views if view.get("scale_from") == source and view.get("scale_m_per_px")]
        known = ", ".join(f"{1e3 * view['scale_m_per_px']:.4g}" for view in mine)
        if source and known:
            uncertain = relative_uncertainty([view.get("scale_std_rel") for view in mine])
            console.print(f"[dim]scale:[/dim] {known} mm/px{uncertain}, from {escape(str(source))}")


def kept_in_words(checkpoint: Path) -> str:
    """From where a run goes on that was stopped; empty where it begins, or where there is nothing to go on from."""
    if not checkpoint.exists():
        return ""
    from rigtwin.sim.engine.bulk.checkpoint import kept_time

    kept = kept_time(checkpoint)
    return "" if kept is None else f"{checkpoint} is kept at t = {kept:.4g} s; the run goes on from there."


def show_twin(twin: Twin, out: Path, as_json: bool, quiet: bool) -> None:
    """What a twin gave; its record and quantities go into `out`."""
    from rigtwin.compare.twins.twin import write_twin

    files = write_twin(twin, out)
    if as_json:
        print_json({**twin.to_json(), "files": files})
        return
    if quiet:
        return
    console = _console()
    rig = "custom rig" if twin.rig == "custom" else twin.rig
    _show_quantities(console, f"twin of the {rig}", twin.evaluation.quantities)
    for assumption in twin.assumptions:  # what is given is among them
        console.print(f"[dim]taken:[/dim] {escape(assumption)}")
    if twin.cost:
        console.print(f"[dim]computing:[/dim] {escape(twin.cost)}")
    warnings = (*twin.warnings, *twin.evaluation.warnings)
    _show_rest(console, twin.evaluation.checks, warnings, files, twin.evaluation.quantities)


def show_comparison(comparison: Comparison, as_json: bool = False, quiet: bool = False) -> None:
    """Measured beside simulated."""
    if as_json:
        print_json(comparison.to_json())
    elif not quiet:
        _tell_comparison(_console(), comparison)


def comparison_warnings(comparison: Comparison) -> list[str]:
    """Warnings of all experiments, and remarks on the whole."""
    each = [f"{one.experiment.id}: {warning}" for one in comparison.outcomes for warning in one.warnings]
    return [*each, *comparison.remarks]


def _tell_comparison(console: Console, comparison: Comparison) -> None:
    from rich.table import Table

    from rigtwin.compare.deviation import primary_first
    from rigtwin.lab.formatting import percent, reading, siblings, title, z_score

    primary, rest = primary_first(comparison.deviations)
    table = Table(title=escape(comparison.lab.title), title_justify="left")
    for column in ("experiment", "quantity", "which", "measured", "simulated", "deviation", "z (limit)", "verdict"):
        numbers = ("measured", "simulated", "deviation", "z (limit)")
        table.add_column(column, justify="right" if column in numbers else "left")
    for outcome in comparison.outcomes:
        for row in primary:
            if row.experiment != outcome.experiment.id:
                continue
            table.add_row(
                escape(row.experiment),
                f"{title(row.quantity)} [dim]({escape(row.method)})[/dim]",
                escape(siblings(row.row())),
                reading(row.measured, row.measured_std_uncertainty, row.unit),
                reading(row.simulated, row.simulated_std_uncertainty, row.unit),
                percent(row.percent_deviation, row.percent_deviation_std),
                z_score(row.z, row.z_limit),
                escape(", ".join(filter(None, (row.verdict, _check_failed(row))))),
            )
        table.add_section()
    console.print(table)
    console.print(escape(comparison.headline))
    console.print("[dim]z:[/dim] the difference over its standard uncertainty; beyond the limit the two differ")
    _tell_rest(console, rest, "the report and deviations.csv")
    _tell_notes(console, primary)
    _tell_warnings(console, primary, [one.measured for one in comparison.outcomes], comparison_warnings(comparison))
    for sentence in comparison.lab.notes:
        console.print(f"[dim]note:[/dim] {escape(sentence)}")
    for sentence in comparison.lab.borrowed:
        console.print(f"[dim]borrowed:[/dim] {escape(sentence)}")
    for path in comparison.files.values():
        typer.echo(f"wrote {path}")


def _tell_rest(console: Console, rest: Sequence[Deviation], place: str) -> None:
    from rigtwin.compare.deviation import verdict_counts

    if rest:
        counts = verdict_counts(rest).items()
        off = [f"{number} {words}" for words, number in counts if words.endswith(("differ", "differs"))]
        some = f"; of these {', '.join(off)}" if off else ""
        console.print(f"{len(rest)} more (later bounces, single sides, other methods) in {place}{some}")


def _tell_notes(console: Console, rows: Sequence[Deviation]) -> None:
    """The notes of the rows, each once for all quantities of an experiment that have it."""
    from rigtwin.lab.formatting import title

    notes: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        notes.setdefault((row.experiment, row.note), []).append(title(row.quantity))
    for (name, note), quantities in notes.items():
        if note:
            of = ", ".join(dict.fromkeys([name, *quantities]))
            console.print(f"[dim]note:[/dim] {escape(f'{of}: {note}')}")


def _check_failed(row: Deviation) -> str:
    """The mark of a row whose value does not rest on a check that failed; what does is doubtful."""
    return "" if row.doubtful or not row.failed_check else "check failed"


def _tell_warnings(
    console: Console, rows: Sequence[Deviation], measured: Sequence[Measured], warnings: Sequence[str]
) -> None:
    """Why shown rows are doubtful, failed checks and warnings; a failed check that the others state is not repeated."""
    doubted: dict[str, list[str]] = {}
    for row in rows:
        doubted.setdefault(row.experiment, []).append(row.doubtful)
    reasons = [f"{name}: {reason}" for name, every in doubted.items() for reason in _each_once(every)]
    for reason in reasons:
        console.print(f"[yellow]doubtful:[/yellow] {escape(reason)}")
    for one in measured:
        for check in one.failed_checks:
            if not any(check.message.removesuffix(".") in said for said in (*reasons, *warnings)):
                words = f"{one.experiment.id}: {check.name} {check.verdict}: {check.message}"
                console.print(f"[red]check failed:[/red] {escape(words)}")
    for warning in warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(warning)}")


def show_lab_measurements(found: LabMeasurements, as_json: bool, quiet: bool) -> None:
    """The repetitions of each experiment combined."""
    if as_json:
        print_json(found.to_json())
    elif not quiet:
        _tell_lab_measurements(_console(), found)


def _tell_lab_measurements(console: Console, found: LabMeasurements) -> None:
    from rich.table import Table

    from rigtwin.compare.deviation import primary_first
    from rigtwin.lab.formatting import reading, siblings, title, uncertainty

    primary, rest = primary_first(found.means)
    table = Table(title=escape(found.lab.title), title_justify="left")
    for column in ("experiment", "quantity", "which", "mean", "scatter", "n", ""):
        table.add_column(column, justify="right" if column in ("mean", "scatter", "n") else "left")
    for row in primary:
        table.add_row(
            escape(row.experiment),
            f"{title(row.quantity)} [dim]({escape(row.method)})[/dim]",
            escape(siblings(row.row())),
            reading(row.measured, row.measured_std_uncertainty, row.unit),
            uncertainty(row.measured_std, row.unit) if row.measured_n > 1 else "",
            str(row.measured_n),
            "[yellow]doubtful[/yellow]" if row.doubtful else _check_failed(row),
        )
    console.print(table)
    if found.headline:
        console.print(found.headline)
    _tell_rest(console, rest, "measurements.csv")
    _tell_notes(console, primary)
    _tell_warnings(console, primary, found.measured, found.warnings)
    for path in found.files.values():
        typer.echo(f"wrote {path}")


def show_runs(rows: Sequence[Kept], damaged: int, as_json: bool, quiet: bool) -> None:
    """The runs of a store, one row each; `damaged` is the number of rows that are left out."""
    if as_json:
        names = ("key", "name", "function", "version", "state", "message", "seconds", "finished")
        runs = [{name: getattr(row, name) for name in names} for row in rows]
        print_json({"runs": runs, "damaged_rows": damaged})
    elif not quiet:
        from rich.table import Table

        table = Table(title=_totals(rows), title_justify="left")
        for column in ("name", "function", "state", "seconds", "finished (UTC)", "key"):
            table.add_column(column, justify="right" if column == "seconds" else "left", overflow="fold")
        for row in rows:
            function = row.function.rpartition(":")[2]
            finished = row.finished[:19].replace("T", " ")
            table.add_row(escape(row.name), escape(function), row.state, f"{row.seconds:.1f}", finished, row.key)
        _console().print(table)


def _totals(rows: Sequence[Kept]) -> str:
    failed = sum(row.state == "failed" for row in rows)
    seconds = sum(row.seconds for row in rows)
    return f"{counted(len(rows), 'run')}, {failed} of them failed, {seconds:.0f} s of computing"


def show_run(row: Kept, result: Mapping[str, Any], as_json: bool, quiet: bool) -> None:
    """Settings and result of a run, with its arrays."""
    damaged = row.state == "done" and not result
    if as_json:
        known = {name: value for name, value in vars(row).items() if name != "result"}
        print_json({**known, "result": dict(result), "damaged": damaged})
    elif not quiet:
        from rich.table import Table

        table = Table(title=f"{escape(row.name)}: {row.state}, {row.seconds:.1f} s", title_justify="left")
        table.add_column("what")
        table.add_column("value", overflow="fold")
        heads = {name: getattr(row, name) for name in ("key", "function", "version", "finished")}
        settings = {f"settings.{name}": value for name, value in row.settings.items()}
        found = {f"result.{name}": value for name, value in result.items()}
        for name, value in {**heads, **settings, **found}.items():
            table.add_row(escape(name), escape(_short(value)))
        if row.message:
            table.add_row("why it failed", escape(row.message))
        if damaged:
            table.add_row("result", "its arrays are missing or damaged; it is computed again when it is next needed")
        _console().print(table)


def _short(value: Any) -> str:
    """Arrays by their shape, everything else in full."""
    if hasattr(value, "shape"):
        size = f"array of {' x '.join(map(str, value.shape))}"
        return (
            f"{size}, from {value.min():.6g} to {value.max():.6g}" if value.size and value.dtype.kind in "iuf" else size
        )
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def show_reproduction(reproduction: Reproduction, as_json: bool, quiet: bool) -> None:
    """The paper's cells beside ours; leaves with 1 where a run failed by a fault of rigtwin, 2 for want of memory."""
    if as_json:
        print_json(reproduction.to_json())
    elif not quiet:
        _tell_reproduction(_console(), reproduction)
    done = reproduction.done
    runs = len(done.results) + len(done.failures)
    if faults := done.faults:
        for name, trace in faults.items():
            LOGGER.critical("%s: a fault of rigtwin itself\n%s", name, trace.rstrip())
        if os.environ.get("RIGTWIN_DEBUG"):
            sys.stderr.write("\n".join(faults.values()))
        elif not as_json:
            first = next(iter(faults))
            sys.stderr.write(
                f"rigtwin: {len(faults)} of {runs} runs failed, {first} by {done.failures[first]}; the others are kept "
                "and shown; set RIGTWIN_DEBUG=1 and run again to see the traceback.\n"
            )
        raise typer.Exit(1)
    if large := done.out_of_memory:
        if not as_json:
            sys.stderr.write(
                f"rigtwin: {len(large)} of {runs} runs failed, the first being {large[0]}, which "
                f"{done.failures[large[0]].rstrip('.')}; the others are kept and shown.\n"
            )
        raise typer.Exit(2)


def reproduction_warnings(reproduction: Reproduction) -> list[str]:
    """Warnings of the runs, and the runs that failed with their reasons."""
    done = reproduction.done
    failed = [f"{name} failed: {words}" for name, words in done.failures.items()]
    return [*reproduction.warnings, *reproduction.missing, *failed]


def _tell_reproduction(console: Console, reproduction: Reproduction) -> None:
    from rich.table import Table

    from rigtwin.compare.reproduce.reproduce import number
    from rigtwin.lab.formatting import percent, title

    for score, rows in zip(reproduction.scores, reproduction.tables.values(), strict=True):
        law = score["rolling_model"]
        table = Table(title=f"Table {score['table']}, rolling resistance of {law}", title_justify="left")
        for column in (
            "cell",
            "quantity",
            "paper experiment",
            "paper DEM",
            "ours",
            "runs",
            "paper DEM off",
            "ours off",
            "ours to paper DEM",
        ):
            table.add_column(column, justify="left" if column in ("cell", "quantity") else "right")
        for row in rows:
            table.add_row(
                row["row"],
                f"{title(row['quantity'])} [dim]{escape(row['unit'])}[/dim]",
                number(row["paper_experiment"], row["paper_experiment_std"]),
                number(row["paper_dem"], row["paper_dem_std"]),
                number(row["ours"], row["ours_std"]) + (" [yellow]?[/yellow]" if row["doubtful"] else ""),
                str(row["runs"]),
                percent(row["paper_dem_percent_deviation"], None),
                percent(row["ours_percent_deviation"], None),
                percent(row["ours_against_paper_dem_percent"], None),
            )
        console.print(table)
        for row in rows:
            if row["doubtful"]:
                cell = f"{row['row']}, {title(row['quantity'])}"
                console.print(f"[yellow]doubtful:[/yellow] {escape(cell)}: {escape(row['doubtful'])}")
        if score["judged"]:
            console.print(
                f"{score['no_further']} of {score['judged']} cells no further from the experiment than the paper's DEM"
            )
    _tell_studies(console, reproduction)
    for words in reproduction.assumptions.values():
        console.print(f"[dim]assumed:[/dim] {escape(words)}")
    for words in reproduction.warnings:
        console.print(f"[yellow]warning:[/yellow] {escape(words)}")
    for words in reproduction.missing:
        console.print(f"[yellow]missing:[/yellow] {escape(words)}")
    if reproduction.replaced:
        console.print(f"[yellow]replaced:[/yellow] {escape(reproduction.replaced)}")
    for name, words in reproduction.done.failures.items():
        console.print(f"[red]failed[/red] {escape(name)}: {escape(words)}")
    for path in reproduction.files.values():
        typer.echo(f"wrote {path}")


def _tell_studies(console: Console, reproduction: Reproduction) -> None:
    from rich.table import Table

    from rigtwin.compare.reproduce.reproduce import number

    for study in reproduction.studies:
        found = {(reading, at): rest for reading, points in reproduction.points(study).items() for at, *rest in points}
        if not found:
            continue
        table = Table(title=f"{escape(study.title)}, rolling resistance of {study.rolling}", title_justify="left")
        for column in (study.x_label, "reading", "angle, deg", "runs"):
            table.add_column(column, justify="left" if column == "reading" else "right")
        for place in study.places:
            for reading in study.readings:
                mean, std, runs = found.get((reading, place), (None, None, 0))
                table.add_row(str(place), reading, number(mean, std), str(runs))
            table.add_section()
        console.print(table)


def show_diagnosis(found: tuple[Diagnosis | BulkDiagnosis, Mapping[str, Path]], as_json: bool, quiet: bool) -> None:
    """The verdict, where and what, and the gap before and after."""
    diagnosis, files = found
    if as_json:
        print_json({**diagnosis.to_json(), "files": files})
    elif not quiet:
        _tell_diagnosis(_console(), diagnosis, files)


def _tell_diagnosis(console: Console, diagnosis: Diagnosis | BulkDiagnosis, files: Mapping[str, Path]) -> None:
    from rigtwin.compare.diagnose.fitting.strained import in_words
    from rigtwin.lab.formatting import unit_of

    document = diagnosis.to_json()
    if document["strained"]:
        console.print(f"[yellow]{escape(in_words(document['strained']))}[/yellow]")
    console.print(f"[bold]{escape(diagnosis.verdict)}[/bold]: {escape(diagnosis.reason)}")
    for one in diagnosis.left_out:
        console.print(f"[yellow]{escape(one)}[/yellow]")
    console.print(f"where: {escape(document['where_in_words'])}")
    for effect in document["effects"]:
        for name, found in effect["parameters"].items():
            console.print(
                f"{escape(effect['title'])}: {name} = {found['value']:.4g} ± {found['std']:.2g}{unit_of(found['unit'])}"
            )
    if diagnosis.form:
        console.print(f"form: {escape(diagnosis.form)}")
    if diagnosis.gap is not None:
        gap = diagnosis.gap
        console.print(f"gap: {gap.before:.4g} before, {gap.after:.4g} after, noise alone {gap.noise_floor:.4g}")
    if diagnosis.stability is not None:
        console.print(f"stable: {escape(diagnosis.stability.in_words())}")
    if diagnosis.next_experiment:
        console.print(f"next: {escape(diagnosis.next_experiment)}")
    for path in files.values():
        typer.echo(f"wrote {path}")


def _show_quantities(console: Console, heading: str, quantities: Sequence[Quantity]) -> None:
    from rich.table import Table

    from rigtwin.lab.formatting import reading, siblings, title

    table = Table(title=escape(heading), title_justify="left")
    for column in ("quantity", "which", "value ± standard uncertainty", "method", ""):
        table.add_column(column, justify="right" if column.startswith("value") else "left")
    shown = _shown(quantities)
    for quantity in shown:
        table.add_row(
            title(quantity.quantity),
            escape(siblings(quantity.detail)),
            reading(quantity.value, quantity.std_uncertainty, quantity.unit),
            escape(quantity.method),
            "[yellow]doubtful[/yellow]" if quantity.doubtful else "",
        )
    console.print(table)
    if len(shown) < len(quantities):
        console.print(f"{len(quantities) - len(shown)} more (view by view, left and right): add --json")
    for reason in _each_once([quantity.doubtful for quantity in shown]):
        console.print(f"[yellow]doubtful:[/yellow] {escape(reason)}")


def _each_once(reasons: Sequence[str]) -> list[str]:
    """Each reason once; where it continues another reason, only what it adds."""
    from rigtwin.compare.deviation import OF_THE_TWIN

    said: list[str] = []
    for reason in dict.fromkeys(filter(None, reasons)):
        before = max((one for one in reasons if one and reason.startswith(f"{one}; ")), key=len, default="")
        if before:
            whose = OF_THE_TWIN if reason.startswith(OF_THE_TWIN) else ""
            said.append(whose + reason.removeprefix(f"{before}; "))
        else:
            said.append(reason)
    return list(dict.fromkeys(said))


def _shown(quantities: Sequence[Quantity]) -> Sequence[Quantity]:
    over_views = [quantity for quantity in quantities if quantity.detail.get("view") == "all"]
    return over_views or quantities


def _show_rest(
    console: Console,
    checks: Sequence[Check],
    warnings: Sequence[str],
    files: Mapping[str, Path],
    quantities: Sequence[Quantity],
) -> None:
    """Checks and warnings; what doubtful `quantities` or a failed check already stated is not repeated."""
    shown = [quantity.doubtful for quantity in _shown(quantities)]

    def again(sentence: str) -> bool:
        return any(sentence.removesuffix(".") in each for each in shown)

    for passed, name, message in dict.fromkeys((check.passed, check.check, check.message) for check in checks):
        mark = "[green]passed[/green]" if passed else "[red]failed[/red]"
        words = "as stated above" if not passed and again(message) else message
        console.print(f"{mark} {escape(name.replace('_', ' '))}: {escape(words)}")
    shown += [check.message for check in checks if not check.passed]
    for warning in warnings:
        if not again(warning):
            console.print(f"[yellow]warning:[/yellow] {escape(warning)}")
    for path in dict.fromkeys(files.values()):
        typer.echo(f"wrote {path}")
