"""Twins that another code computed from an exported deck."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare.twins.custom import custom_result
from rigtwin.compare.twins.drum import drum_result
from rigtwin.compare.twins.hopper import hopper_result
from rigtwin.compare.twins.many_body import Cast, Computed
from rigtwin.compare.twins.packing import packing_result
from rigtwin.compare.twins.pile import pile_result
from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.errors import BadInput
from rigtwin.lab.progress import Progress, silent

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.file.model_file import Model
    from rigtwin.sim.decks.deck import Deck

RESULTS = {
    "packing": packing_result,
    "pile": pile_result,
    "drum": drum_result,
    "hopper": hopper_result,
    "custom": custom_result,
}
SAME = 1e-3  # relative difference below which two settings count as equal: they may be rounded to three digits


def imported_twin(folder: Path, progress: Progress = silent) -> Twin:
    """Read what another code wrote in the folder of a deck, and evaluate it as rigtwin's own twin.

    Parameters
    ----------
    folder : Path
        Folder that `rigtwin export` wrote and in which the deck has run.
    progress : Progress
        Called with step, number and count.

    Returns
    -------
    Twin
        The records and quantities that `rigtwin simulate` gives, with the code among the assumptions.

    Raises
    ------
    BadInput
        If there is no deck, it has not run to its end, or its record cannot be evaluated.
    """
    from rigtwin.sim.decks.deck import TITLES, read_deck
    from rigtwin.sim.decks.read import record_of

    begun = time.perf_counter()
    progress("reading", 0, 1)
    deck = read_deck(folder)
    record = record_of(folder, deck)
    cast = Cast(deck.particle, deck.wall, deck.contact, deck.wall_contact)
    computed = Computed(begun, deck.seed, by=TITLES[deck.code])
    result: Any = RESULTS[deck.rig_name]
    more: dict[str, Any] = {"duration": (deck.options or {}).get("duration")} if deck.rig_name == "hopper" else {}
    if deck.rig_name == "custom":
        more = {"surfaces": deck.surfaces}
    twin: Twin = result(deck.rig, cast, record, computed, **more)
    progress("reading", 1, 1)
    return replace(
        twin,
        cost="",  # not recorded
        assumptions=(
            f"computed by: {TITLES[deck.code]}, not by rigtwin ({folder})",
            *twin.assumptions,
            *(f"in {TITLES[deck.code]}: {words}" for words in deck.warnings),
        ),
    )


def imported_for(experiment: Experiment, folder: Path, model: Model) -> tuple[Twin, tuple[str, ...]]:
    """Read the twin of an experiment that another code computed.

    Parameters
    ----------
    experiment : Experiment
        Experiment that the deck must match.
    folder : Path
        Folder of the deck, which has run.
    model : Model
        The model of the lab.

    Returns
    -------
    twin : Twin
        The twin.
    remarks : tuple of str
        Remarks on it.

    Raises
    ------
    BadInput
        If rig, particle, wall or number of particles are not those of the experiment.
    """
    from rigtwin.sim.decks.deck import TITLES, read_deck

    deck = read_deck(folder)
    if differs := next(_differences(experiment, deck), ""):
        raise BadInput(f"--simulated: {folder} is no twin of {experiment.id}: {differs}; export one for it.")
    twin = imported_twin(folder)
    remarks = [f"{experiment.id}: the twin was computed by {TITLES[deck.code]} ({folder}), not by rigtwin"]
    entry = entry_of(experiment)
    mine = [model.contact(*names, entry.needed(experiment)) for names in experiment.contacts]
    for names, wanted, used in zip(experiment.contacts, mine, (deck.wall_contact, deck.contact), strict=True):
        other = [
            f"{name.replace('_', ' ')} {theirs:g} instead of {ours:g}"
            for (name, ours), theirs in zip(asdict(wanted).items(), asdict(used).values(), strict=True)
            if not math.isclose(ours, theirs, rel_tol=SAME)
        ]
        if other:
            remarks.append(f"{experiment.id}: its contact {'-'.join(names)} has {', '.join(other)} as the lab has")
    if model.effects:
        remarks.append(f"{experiment.id}: the effects {', '.join(model.effects)} of the model do not act in its twin")
    return twin, tuple(remarks)


def _differences(experiment: Experiment, deck: Deck) -> Iterator[str]:
    """What the deck has otherwise than the experiment states; settings that the lab leaves open may have any value."""
    if deck.rig_name != experiment.rig_name:
        yield f"its rig is a {deck.rig_name}, not a {experiment.rig_name}"
        return
    entry = entry_of(experiment)
    open_in_labs = {"cylinder_height", "fall_height", "cone_height", "inclination", "slide_angle", "slide_drop"}
    theirs = asdict(deck.rig)
    for name, stated in asdict(entry.rig(experiment).rig()).items():
        if stated is not None and name not in open_in_labs and not _same(stated, theirs[name]):
            yield f"its {name.replace('_', ' ')} is {_shown(theirs[name])}, the lab's {_shown(stated)}"
    for name in ("diameter", "effective_density"):
        mine, other = getattr(experiment.particle, name), getattr(deck.particle, name)
        if experiment.particle.shape != deck.particle.shape or not _same(mine, other):
            names = f"{deck.particle.name} is not {experiment.particle.name}"
            yield f"its particle {names} ({name.replace('_', ' ')} {other:.5g} and {mine:.5g}, SI)"
    if experiment.particle.sizes != deck.particle.sizes:
        yield "the sizes of its particles are others than the lab's"
    if experiment.wall is None or experiment.wall.name != deck.wall.name:
        yield f"its walls are of {deck.wall.name}, the lab's of {getattr(experiment.wall, 'name', 'nothing')}"
    wanted = entry.count(experiment, deck.scene.count)  # type: ignore[attr-defined]
    if wanted is not None and wanted != deck.scene.count:
        yield f"it has {deck.scene.count} particles, the experiment {wanted}"


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, (int, float)):
        return math.isclose(one, other, rel_tol=SAME)
    return bool(one == other)


def _shown(value: Any) -> str:
    return f"{value:.5g} (SI)" if isinstance(value, float) else str(value)
