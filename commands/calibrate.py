"""``rigtwin calibrate LAB``: one set of parameters for all experiments of a lab."""

from __future__ import annotations

from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigtwin.commands import simulate
from rigtwin.commands.display import print_json
from rigtwin.commands.options import Cluster, Outside, Seed, default_folder, out_option
from rigtwin.commands.run_command import Work, finished
from rigtwin.lab.units import MOST_PARTICLES

if TYPE_CHECKING:
    from rigtwin.compare.campaign.calibration import Calibration
    from rigtwin.compare.reproduce.calibrated import Calibrated


def show(found: Calibration, as_json: bool, quiet: bool) -> None:
    """Print the posterior and the predictions, or the JSON document."""
    if as_json:
        print_json(found.to_json())
        return
    if quiet:
        return
    for name, one in found.intervals.items():
        typer.echo(
            f"{name}: best {found.best[name]:.4g}, median {one['median']:.4g}, "
            f"95 % interval {one['low']:.4g} to {one['high']:.4g}"
        )
    for sentence in found.ambiguous:
        typer.echo(sentence)
    for row in found.next_experiments:
        typer.echo(
            f"further experiment: {row['experiment']}: its {row['quantity']} ({row['method']}) would be "
            f"{row['one']:.4g} or {row['other']:.4g} {row['unit']}, {row['apart']:.1f} standard deviations apart"
        )
    for row in found.predictions:
        if row["curve"]:  # a number without a meaning of its own
            continue
        kind = "held out" if row["held_out"] else "fitted"
        percent = "" if row["percent_deviation"] is None else f" ({row['percent_deviation']:+.1f} %)"
        unit = "" if row["unit"] == "1" else f" {row['unit']}"
        value = "no twin of the best set gives it" if row["predicted"] is None else f"predicted {row['predicted']:.4g}"
        typer.echo(
            f"{row['experiment']}, {row['quantity']} ({row['method']}), {kind}: measured {row['measured']:.4g}{unit}, "
            f"{value}{unit if row['predicted'] is not None else ''}{percent}"
        )
    for sentence in found.lab.borrowed:
        typer.echo(f"borrowed: {sentence}")
    if found.fits and not found.tested:
        typer.echo("there are no more measurements than parameters, so that the fit is no test of the model")
    if not found.fits:
        typer.echo(found.no_fit)
    for remark in found.remarks:
        typer.echo(f"warning: {remark}")
    typer.echo(f"{found.runs} runs; {found.stopped}; wrote {found.files['calibration.json'].parent}")


def show_paper(found: Calibrated, as_json: bool, quiet: bool) -> None:
    """Print the paper's cells beside the calibrated twins, or the JSON document."""
    if as_json:
        print_json(found.to_json())
        return
    if quiet:
        return
    for row in found.sets:
        paper = "" if row["paper"] is None else f"; the paper's {row['paper']:.4g}"
        typer.echo(
            f"{row['particle']}, {row['parameter']}: best {row['best']:.4g}, 95 % interval {row['low']:.4g} to "
            f"{row['high']:.4g}{paper}"
        )
    for row in found.cells:
        kind = "held out" if row["held_out"] else "fitted"
        ours = "none" if row["ours"] is None else f"{row['ours']:.4g} ({row['ours_percent_deviation']:+.1f} %)"
        typer.echo(
            f"{row['particle']}, {row['experiment']}, {row['quantity']} [{row['unit']}], {kind}: experiment "
            f"{row['paper_experiment']:.4g}, paper's DEM {row['paper_dem']:.4g} "
            f"({row['paper_dem_percent_deviation']:+.1f} %), ours {ours}"
        )
    for name, one in found.found.items():
        for sentence in (*one.ambiguous, *(() if one.fits else ("no set fits",)), *one.remarks):
            typer.echo(f"{name}: {sentence}")
    scores = found.scores
    typer.echo(
        f"{scores['fitted_near']} of {scores['fitted']} fitted cells within one standard deviation of the experiment, "
        f"or no further from it than the paper's DEM; {scores['discharge_times_within_10_percent']} of "
        f"{scores['discharge_times']} discharge times within 10 %; wrote {found.files['calibrated.csv']}"
    )


@finished(show, attrgetter("remarks"))
def calibrate(
    lab: Annotated[Path, typer.Argument(metavar="LAB", help="Lab folder with a lab.toml.")],
    *,
    fit: Annotated[
        list[str] | None,
        typer.Option(
            "--fit",
            metavar="NAME[=RANGE]",
            help="A parameter, named as in `rigtwin sweep`, like static_friction=0.1..0.9; may be given again. "
            "Static and rolling friction between the particles by default.",
        ),
    ] = None,
    hold_out: Annotated[
        list[str] | None,
        typer.Option("--hold-out", metavar="ID", help="Predict this experiment, do not fit it; may be given again."),
    ] = None,
    budget: Annotated[int, typer.Option("--budget", min=1, help="Largest number of twins for the fit.")] = 60,
    count: Annotated[
        int | None, typer.Option("--count", min=1, max=MOST_PARTICLES, help="Particles, where lab.toml gives none.")
    ] = None,
    rolling_model: simulate.RollingOfMany = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Runs at a time; one per core.")] = None,
    cluster: Cluster = None,
    seed: Seed = 1,
    allow_outside: Outside = False,
    out: Annotated[Path | None, out_option("Folder for results; LAB/calibration by default.")] = None,
) -> Work:
    """Find one set of parameters for all experiments of a lab.

    Experiments with many particles are fitted; coefficients that the lab measures directly (drop, pendulum, tilt) are
    priors. The result is a posterior: best set, 95 % intervals, correlations, predictions. Called again, only missing
    twins are run.
    """
    from rigtwin.compare.campaign.calibrate import calibrate as run

    return partial(
        run,
        lab,
        out or default_folder((lab if lab.is_dir() else lab.parent) / "calibration"),
        fit=fit,
        hold_out=hold_out or (),
        budget=budget,
        count=count,
        seed=seed,
        rolling=None if rolling_model is None else simulate.rolling_law(rolling_model),
        workers=workers,
        cluster=cluster,
        allow_outside=allow_outside,
    )
