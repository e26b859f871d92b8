"""``rigtwin export`` and ``rigtwin import``: twins that another DEM code computes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigtwin.commands import simulate
from rigtwin.commands.display import print_json, show_twin
from rigtwin.commands.options import (
    Command,
    Json,
    Quiet,
    Stiffness,
    TimeStep,
    default_folder,
    file_option,
    out_option,
    with_options,
)
from rigtwin.commands.run_command import JSON_QUIET, errors_by_option

if TYPE_CHECKING:
    from rigtwin.sim.decks.card import Code as Card
    from rigtwin.sim.decks.deck import Code

OutFile = Annotated[Path | None, file_option("--out", "FILE", "Write it here; standard output by default.")]
# settings of rigtwin's own engine: options of `simulate` that change nothing in a deck
OWN = {"threads": None, "device": "cpu", "checkpoint": None, "trajectory": None}
RIGS = {
    "packing": simulate.simulate_packing,
    "pile": simulate.simulate_pile,
    "drum": simulate.simulate_drum,
    "hopper": simulate.simulate_hopper,
    "custom": simulate.simulate_custom,
}

app = typer.Typer(
    help="Write a twin, or its parameters, for another DEM code.", no_args_is_help=True, rich_markup_mode=None
)


def _card(code: Card) -> Callable[..., None]:
    """The command that writes particle, wall and contacts for a code."""

    def card(
        *,
        particle: simulate.ParticleName = "D6",
        wall: simulate.WallName = "steel",
        lab: simulate.LabFolder = None,
        restitution: simulate.Restitution = None,
        static_friction: simulate.StaticFriction = None,
        rolling_friction: simulate.RollingFriction = None,
        rolling_model: simulate.RollingModel = "C",
        stiffness_factor: Stiffness = 1e-3,
        time_step_fraction: TimeStep = 0.3,
        out: OutFile = None,
        as_json: Json = False,
        quiet: Quiet = False,
    ) -> None:
        from rigtwin.compare.result_files import write_together
        from rigtwin.sim.decks.card import export

        cast = simulate.cast_of(particle, wall, lab, restitution, static_friction, rolling_friction)
        made = export(
            code,
            *cast,
            rolling=simulate.rolling_law(rolling_model),
            stiffness_factor=stiffness_factor or 1e-3,
            time_step_fraction=time_step_fraction,
        )
        if out is not None:
            write_together(out.parent, {out.name: made.text})
        for warning in made.warnings:
            typer.echo(f"rigtwin: {warning}", err=True)
        if as_json:
            print_json(made.to_json())
        elif out is None:
            typer.echo(made.text, nl=False)
        elif not quiet:
            typer.echo(f"wrote {out}")

    return card


def _deck(code: Code, rig: str) -> Command:
    """The command that writes a deck: the options of ``simulate RIG``, those of rigtwin's own engine left out."""
    default = Path(f"out/{code}-{rig}")

    def around(own: Any, *, out: Path | None, as_json: bool, quiet: bool) -> None:
        with errors_by_option(own.keywords):
            deck = deck_of(code, own())
            written = deck.files()
        from rigtwin.compare.result_files import write_together

        folder = out or default_folder(default)
        for stale in ("record.dump", "end.dump"):  # of an earlier deck
            (folder / stale).unlink(missing_ok=True)
        files = write_together(folder, written)
        if as_json:
            print_json({**deck.to_json(), "files": files})
        elif not quiet:
            for warning in deck.warnings:
                typer.echo(f"differs: {warning}")
            typer.echo(f"wrote {folder} ({len(files)} files)")
            parallel = "" if code == "yade" else f", or on two cores: mpirun -np 2 {deck.command}"
            typer.echo(f"run: cd {folder} && {deck.command}{parallel}")
            typer.echo(f"then: rigtwin import {folder}")

    out = (Annotated[Path | None, out_option(f"Folder for the deck; {default} by default.")], None)
    inner: Command = getattr(RIGS[rig], "__wrapped__")  # noqa: B009  # without the options of a run
    return with_options(inner, {"out": out, **JSON_QUIET}, around)


def deck_of(code: Code, work: partial[Any]) -> Any:
    """The deck of a twin, from the `work` of its command of ``simulate``."""
    from rigtwin.lab.errors import BadInput, reworded_refusals
    from rigtwin.sim.decks.deck import Deck

    rig, (particle, wall, contact, wall_contact) = work.args
    said = dict(work.keywords)
    for name, usual in OWN.items():
        if said.pop(name, usual) != usual:
            raise BadInput(f"{name}: belongs to rigtwin's own engine and changes nothing in a deck; leave it out.")
    if said.pop("contact_law", "Hertz-Mindlin") != "Hertz-Mindlin":
        raise BadInput("contact_law: decks have Hertz-Mindlin contacts only; leave it out.")
    count = said.pop("count", None)
    settings: dict[str, Any] = {
        name: said.pop(name)
        for name in ("seed", "rolling", "stiffness_factor", "time_step_fraction", "forced")
        if said.get(name) is not None
    }
    settings["surfaces"] = said.pop("surfaces", None) or None
    settings["notes"] = said.pop("notes", ())
    located = said.pop("located", str)
    options = {name: value for name, value in said.items() if value is not None}
    with reworded_refusals(located):
        deck = Deck(code, rig, particle, wall, contact, wall_contact, count, options=options, **settings)
        # what the rig leaves open and a deck must state is part of its rig from here on
        return replace(deck, rig=deck.scene.rig)


def _group(code: Code, title: str, card: Command | None) -> typer.Typer:
    about = f"A deck of a rig for {title}: rigtwin export {code} RIG."
    group = typer.Typer(help=about, rich_markup_mode=None, invoke_without_command=True)
    for rig in RIGS:
        group.command(rig, epilog=f"Example: {EXAMPLES[rig].format(code=code)}")(_deck(code, rig))
    group.callback()(_or_card(code, card))
    return group


EXAMPLES = {
    "packing": "rigtwin export {code} packing --cylinder-diameter 65mm --particle D6 --count 1000",
    "pile": "rigtwin export {code} pile --base-diameter 90mm --rim-height 10mm --count 1000",
    "drum": "rigtwin export {code} drum --drum-diameter 140mm --speed 3rpm --depth 50mm",
    "hopper": "rigtwin export {code} hopper --outlet 30mm --bin-width 80mm --count 1000",
    "custom": "rigtwin export {code} custom my-lab --name mixer",
}


def _or_card(code: Code, card: Command | None) -> Command:
    """What happens where no rig is named: the card of the parameters, or a refusal."""
    if card is None:

        def refuse(context: typer.Context) -> None:
            from rigtwin.lab.errors import BadInput

            if context.invoked_subcommand is None:
                raise BadInput(f"export {code}: names no rig; give one of {', '.join(RIGS)}.")

        return refuse

    def around(own: Command, *, context: typer.Context) -> None:
        if context.invoked_subcommand is None:
            own()

    wrapped = with_options(card, {"context": (typer.Context, None)}, around)
    wrapped.__doc__ = f"Write a deck of a rig for {code}, or without a rig its particle, wall and contacts alone."
    return wrapped


def _described(command: Command, text: str) -> Command:
    command.__doc__ = text
    return command


CARDS = (
    "Rolling friction means different torques in different codes; the value here is the one that gives the same limit."
)

app.command("edem", epilog="Example: rigtwin export edem --particle D6 --wall steel")(
    _described(_card("edem"), f"Write particle, wall and contacts for EDEM's dialogs.\n\n{CARDS}")
)
app.command("csv", epilog="Example: rigtwin export csv --particle D6 --wall steel --out d6-steel.csv")(
    _described(_card("csv"), "Write particle, wall and contacts as a CSV table.")
)
app.add_typer(_group("liggghts", "LIGGGHTS", _card("liggghts")), name="liggghts")
app.add_typer(_group("lammps", "LAMMPS", None), name="lammps")
app.add_typer(_group("yade", "Yade", None), name="yade")


def import_deck(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of an exported deck that has run.")],
    *,
    out: Annotated[Path | None, out_option("Folder for results; FOLDER/twin by default.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Read what another code computed from an exported deck.

    Its records and quantities are written as `rigtwin simulate` writes those of its own twins.
    """
    from rigtwin.commands.output_folder import check_only
    from rigtwin.compare.twins.imported import imported_twin

    place = out or default_folder(folder / "twin")
    twin = imported_twin(folder)
    check_only(twin.rig, place)
    show_twin(twin, place, as_json, quiet)
