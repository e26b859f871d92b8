"""``rigtwin compare LAB`` and ``rigtwin diagnose LAB``: a whole lab folder."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rigtwin.commands import simulate
from rigtwin.commands.display import comparison_warnings, show_comparison, show_diagnosis
from rigtwin.commands.options import Again, Cluster, Only, Out, Outside, Runs, Seed, Stiffness, Threads, beside
from rigtwin.commands.run_command import Work, finished
from rigtwin.lab.units import MOST_PARTICLES


@finished(show_comparison, comparison_warnings)
def compare(
    lab: Annotated[Path, typer.Argument(metavar="LAB", help="Lab folder with a lab.toml.")],
    *,
    only: Only = None,
    count: Annotated[
        int | None,
        typer.Option(
            "--count", min=1, max=MOST_PARTICLES, help="Particles of twins of many, where lab.toml gives none."
        ),
    ] = None,
    seed: Seed = 1,
    runs: Runs = 1,
    model: Annotated[
        Path | None,
        typer.Option("--model", metavar="FILE", help="A model.toml: its contacts and effects go before lab.toml's."),
    ] = None,
    threads: Threads = None,
    stiffness_factor: Stiffness = None,
    rolling_model: simulate.RollingOfMany = None,
    simulated: Annotated[
        list[str] | None,
        typer.Option(
            "--simulated",
            metavar="ID=FOLDER",
            help="Take what another code computed from an exported deck as this experiment's twin; may be given again.",
        ),
    ] = None,
    cluster: Cluster = None,
    again: Again = False,
    allow_outside: Outside = False,
    out: Out = None,
) -> Work:
    """Measure a whole lab, run its twins, write percent deviations.

    Every experiment of lab.toml is measured and its matched twin is run. A table, CSV and JSON files and a report show
    the measured value, the simulated value and their difference. Measurements are kept, and so are several runs of a
    twin, which are computed side by side; called again, only missing ones are done. With --only, an OUT that holds
    results of other experiments is refused, so that none is lost.
    """
    from rigtwin.compare.compare_lab import compare as compare_lab

    return partial(
        compare_lab,
        lab,
        beside(lab, out),
        only=only,
        count=count,
        seed=seed,
        runs=runs,
        model=model,
        threads=threads,
        stiffness_factor=stiffness_factor,
        rolling=None if rolling_model is None else simulate.rolling_law(rolling_model),
        simulated=folders_of(simulated or ()),
        cluster=cluster,
        again=again,
        allow_outside=allow_outside,
    )


def folders_of(said: Sequence[str]) -> dict[str, Path]:
    """Folders of decks by experiment, from texts like ``ID=FOLDER``."""
    from rigtwin.lab.errors import BadInput

    found: dict[str, Path] = {}
    for text in said:
        name, equals, folder = text.partition("=")
        if not (name and equals and folder):
            raise BadInput(f"--simulated: {text!r} is not ID=FOLDER; name an experiment and the folder of its deck.")
        if name in found:
            raise BadInput(f"--simulated: {name} is given twice; leave one of them out.")
        found[name] = Path(folder)
    return found


@finished(show_diagnosis, lambda found: found[0].left_out)
def diagnose(
    lab: Annotated[
        Path, typer.Argument(metavar="LAB", help="Folder with a lab.json of tracked repetitions, or a lab.toml.")
    ],
    *,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="ID", help="This experiment of a lab.toml; may be given again."),
    ] = None,
    effect: Annotated[
        list[Path] | None,
        typer.Option("--effect", metavar="FILE", help="Your own effect, one Python file; may be given again."),
    ] = None,
    store: Annotated[
        Path | None,
        typer.Option("--store", metavar="FOLDER", help="Where twins of many particles are kept; OUT/runs by default."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers", min=1, help="Films measured, or twins of many particles run, at a time; one per core."
        ),
    ] = None,
    cluster: Cluster = None,
    seed: Seed = 1,
    allow_outside: Outside = False,
    out: Out = None,
) -> Work:
    """Find where twin and measurement disagree, and what is missing.

    The missing effect is named, added to the model, and the gap before and after is shown. Labs with piles, packings,
    drums and hoppers need up to 40 twins of each condition; called again, only missing ones are run.
    """
    from rigtwin.compare.diagnose.diagnose_folder import diagnose_folder

    return partial(
        diagnose_folder, lab, beside(lab, out), own=effect or (), only=only or (), allow_outside=allow_outside,
        store=store, workers=workers, cluster=cluster, seed=seed,
    )  # fmt: skip
