"""``rigtwin sweep LAB|RIG``: the twin over ranges of its parameters."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rigtwin.commands import simulate
from rigtwin.commands.display import print_json
from rigtwin.commands.options import Cluster, Outside, Seed, Stiffness, default_folder, out_option
from rigtwin.commands.run_command import Work, finished
from rigtwin.lab.units import MOST_PARTICLES, MOST_RUNS

if TYPE_CHECKING:
    from rigtwin.compare.campaign.sweep import Sweep


def show(found: Sweep, as_json: bool, quiet: bool) -> None:
    """Print the table of a sweep, or its JSON document."""
    if as_json:
        print_json(found.to_json())
        return
    if quiet:
        return
    import pandas as pd

    from rigtwin.lab.formatting import siblings

    names = [one.name for one in found.varied]
    rows = [row for row in found.rows if row.get("simulated") is not None]
    frame = pd.DataFrame([{**row, "which": siblings(row)} for row in rows])
    groups = () if frame.empty else frame.groupby(["quantity", "method", "which", "unit"], sort=False)
    for (quantity, method, which, unit), mine in groups:
        typer.echo(f"{quantity}{', ' if which else ''}{which} ({method}) in {unit}")
        # every column as text of one width, so that a mark stands behind its number and the numbers stay in line
        marks = mine["doubtful"].map(lambda why: " doubtful" if why else "")
        width = marks.map(len).max()
        shown = mine.assign(simulated=mine["simulated"].map("{:.4g}".format) + marks.str.ljust(width))
        columns = [*names, "simulated", *(name for name in ("measured", "percent_deviation") if name in mine)]
        if len(names) == 2 and len(mine) == len(mine.drop_duplicates(names)) and "measured" not in mine:
            typer.echo(shown.pivot(index=names[0], columns=names[1], values="simulated").fillna("").to_string())
        else:
            typer.echo(shown[columns].to_string(index=False, float_format="%.4g"))
    for reason in dict.fromkeys(row["doubtful"] for row in rows if row["doubtful"]):
        typer.echo(f"doubtful: {reason}")
    for words in warnings(found):
        typer.echo(words)
    typer.echo(f"{found.runs - len(found.failures)} of {found.runs} runs; wrote {found.files['sweep.csv'].parent}")


def warnings(found: Sweep) -> list[str]:
    """The runs without a result, each with its reason, and remarks on the files."""
    return [*(f"{name} failed: {why}" for name, why in found.failures.items()), *found.remarks]


@finished(show, warnings)
def sweep(
    subject: Annotated[
        str, typer.Argument(metavar="LAB|RIG", help="Lab folder with a lab.toml, or the name of a rig.")
    ],
    *,
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary",
            metavar="NAME=VALUES",
            help="static_friction=0.05..1.5:8 (a range and its levels) or outlet=30mm,40mm; may be given again. An "
            "effect's parameter is named like cohesion_sjkr.energy_density.",
        ),
    ],
    only: Annotated[str | None, typer.Option("--only", metavar="ID", help="The experiment of the lab.")] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A setting of the rig, as in lab.toml; may be given again."),
    ] = None,
    particle: Annotated[str | None, typer.Option("--particle", metavar="NAME", help="Particle in the rig; D6.")] = None,
    wall: Annotated[str | None, typer.Option("--wall", metavar="NAME", help="Material of the rig; steel.")] = None,
    lab: simulate.LabFolder = None,
    design: Annotated[
        Literal["grid", "sobol", "latin"], typer.Option("--design", help="All combinations, or a space-filling design.")
    ] = "grid",
    points: Annotated[
        int | None, typer.Option("--points", min=1, max=MOST_RUNS, help="Points of a space-filling design.")
    ] = None,
    repetitions: Annotated[
        int, typer.Option("--repetitions", min=1, max=MOST_RUNS, help="Runs with different seeds at each point.")
    ] = 1,
    count: Annotated[
        int | None,
        typer.Option("--count", min=1, max=MOST_PARTICLES, help="Particles, where the experiment gives none."),
    ] = None,
    rolling_model: simulate.RollingOfMany = None,
    stiffness_factor: Stiffness = None,
    workers: Annotated[int | None, typer.Option("--workers", min=1, help="Runs at a time; one per core.")] = None,
    cluster: Cluster = None,
    seed: Seed = 1,
    allow_outside: Outside = False,
    out: Annotated[Path | None, out_option("Folder for results; out/sweep/NAME by default.")] = None,
) -> Work:
    """Run the twin over ranges of its parameters.

    Of a lab the experiment is measured, too, and the figures show where twin and measurement agree. A run is kept when
    it ends; called again, only missing ones are run.
    """
    from rigtwin.compare.campaign.sweep import lab_setting, stated_setting
    from rigtwin.compare.campaign.sweep import sweep as run
    from rigtwin.lab.errors import BadInput
    from rigtwin.lab.rigs import RIGS
    from rigtwin.lab.spelling import suggestion

    measured = None
    if subject in RIGS and not Path(subject, "lab.toml").is_file():
        if only is not None:
            raise BadInput("--only: belongs to a lab; leave it out, or give a lab folder.")
        walled = None if subject == "pendulum" and "variant=double" in (setting or ()) else wall or "steel"
        where = stated_setting(subject, setting or (), particle=particle or "D6", wall=walled, lab=lab)
    elif not Path(subject).exists():
        raise BadInput(f"{subject}: no such file or folder, and no such rig; {suggestion(subject, RIGS)}.")
    else:
        for option, given in {"--set": setting, "--particle": particle, "--wall": wall, "--lab": lab}.items():
            if given:
                raise BadInput(f"{option}: belongs to a rig ({', '.join(RIGS)}); a lab states it in lab.toml.")
        measured, where = lab_setting(Path(subject), only, allow_outside=allow_outside)
    return partial(
        run,
        where,
        vary,
        out or default_folder(Path("out/sweep") / Path(subject).name),
        lab=measured,
        design=design,
        number=points,
        repetitions=repetitions,
        count=count,
        seed=seed,
        rolling=None if rolling_model is None else simulate.rolling_law(rolling_model),
        stiffness_factor=stiffness_factor,
        workers=workers,
        cluster=cluster,
    )
