"""The twin of an experiment: the same rig simulated, and evaluated by the same function as the film.

Each rig's twin runs ``sim.<rig>`` and passes the record to ``measure.<rig>.evaluate``, which also evaluates the filmed
record.  The twin is an ideal rig in a vacuum with frictionless pivots: its evaluation gets no density and no mass, so
that no drag is corrected that the simulation did not have.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.twins.run_warnings import fit_for_a_lab
from rigtwin.compare.twins.twin import Twin, stated
from rigtwin.lab.errors import reword
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.file.option_names import naming_lab_keys
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.version import __version__

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling


def stated_start(experiment: Experiment) -> float | None:
    """Return the stated start of a twin.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose twin is started.

    Returns
    -------
    float or None
        Drop height [m] or release angle [deg]; None for other rigs, or where it is not stated.
    """
    return entry_of(experiment).stated_start(experiment)


def set_by_hand(experiment: Experiment) -> dict[str, str]:
    """Return the quantity that the experimenter sets, so that its scatter is no property of the rig.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose rig is asked.

    Returns
    -------
    dict of str to str
        As `Twin.set_from`, without a source, for an experiment that has no twin.
    """
    return {name: "" for name in [entry_of(experiment).starts_from] if name}


def measured_start(experiment: Experiment, measurement: Measurement) -> Quantity | None:
    """Return the measured start of a twin.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose twin is started.
    measurement : Measurement
        One of its repetitions.

    Returns
    -------
    Quantity or None
        Drop height, or release angle of bead A; a doubtful one only where there is no other.
    """
    name = entry_of(experiment).starts_from
    mine = [q for q in measurement.quantities if q.quantity == name and math.isfinite(q.value)]
    return min(mine, key=lambda quantity: bool(quantity.doubtful), default=None)


def twin_of(
    experiment: Experiment,
    *,
    model: Model,
    measurements: Sequence[Measurement] = (),
    count: int | None = None,
    seed: int = 1,
    threads: int | None = None,
    stiffness_factor: float | None = None,
    rolling: Rolling | None = None,
    kept_in: Path | None = None,
    progress: Progress = silent,
) -> Twin:
    """Run the matched twin of an experiment under a model.

    The twin starts from the stated value, else from the measured mean; `Twin.set_from` records which.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose twin is run.
    model : Model
        Contacts and effects.
    measurements : sequence of Measurement
        Measured repetitions of the experiment.
    count : int, optional
        Number of particles where lab.toml states none.
    seed : int
        Seed of a run of many particles.
    threads : int, optional
        CPU threads.  Default: all.
    stiffness_factor : float, optional
        Factor on the moduli in a run of many particles [1].
    rolling : Rolling, optional
        Rolling resistance law of a run of many particles.
    kept_in : Path, optional
        Folder into which a run of many particles writes checkpoints, and from which it continues.
    progress : Progress
        Called with step, number and count.

    Returns
    -------
    Twin
        The twin.

    Raises
    ------
    BadInput
        If a contact that the rig needs is not known, or a setting is not possible.
    """
    entry = entry_of(experiment)
    contacts = [model.contact(*names, entry.needed(experiment)) for names in experiment.contacts]
    start, set_from = _start(experiment, measurements)
    numerics: dict[str, Any] = {}
    if entry.many_particles:
        chosen = stated(stiffness_factor=stiffness_factor, rolling=rolling)
        numerics = {"threads": threads, **chosen}
        if kept_in is not None:
            decides = {"seed": seed, "threads": threads, "effects": model.effects, **chosen}
            numerics["checkpoint"] = _checkpoint(kept_in, experiment, contacts, count, decides)
    with naming_lab_keys(experiment.rig_name, experiment.particle_place):
        twin = entry.twin(
            experiment,
            contacts,
            measurements=measurements,
            start=start,
            count=count,
            seed=seed,
            effects=model.effects,
            progress=progress,
            numerics=numerics,
        )
        if entry.many_particles:
            return replace(twin, warnings=fit_for_a_lab(map(reword, twin.warnings)))
    return replace(twin, set_from=set_from)


def as_seen(experiment: Experiment, measurements: Sequence[Measurement], count: int | None) -> tuple[Experiment, str]:
    """Fill in settings that the media of an experiment show and lab.toml does not state.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose gaps are filled.
    measurements : sequence of Measurement
        Measured repetitions, from whose media the settings are taken.
    count : int or None
        Number of particles that the user gives; it takes precedence over that which the media show.

    Returns
    -------
    experiment : Experiment
        The experiment with these settings.
    seen : str
        What they are, in words; empty where there are none.
    """
    entry = entry_of(experiment)
    if count is not None and entry.takes_count(experiment):
        return experiment, ""
    return entry.completed(experiment, measurements)


def checkpoints(folder: Path, experiment: Experiment) -> list[Path]:
    """Return the checkpoints of an experiment's twins.

    Parameters
    ----------
    folder : Path
        Folder of checkpoints.
    experiment : Experiment
        Experiment whose twins are run.

    Returns
    -------
    list of Path
        The files.
    """
    return sorted(folder.glob(f"{_digest(experiment.id)}-*.npz"))


def _checkpoint(folder: Path, experiment: Experiment, *decides: object) -> Path:
    """Checkpoint file of a run, a different one for each combination of settings; a damaged file is deleted."""
    from rigtwin.sim.engine.bulk.checkpoint import kept_time

    what = _digest(__version__, experiment.rig, experiment.particle, experiment.wall, decides)
    path = folder / f"{_digest(experiment.id)}-{what}.npz"
    if path.is_file() and kept_time(path) is None:
        path.unlink()
    return path


def _digest(*what: object) -> str:
    return hashlib.sha256(repr(what).encode()).hexdigest()[:12]


def _start(experiment: Experiment, measurements: Sequence[Measurement]) -> tuple[float | None, dict[str, str]]:
    """Mean of the measured starts in their unit (None where none was measured), and the source of the twin's start."""
    name = entry_of(experiment).starts_from
    if name is None:
        return None, {}
    set_from = {name: "measured" if stated_start(experiment) is None else "stated"}
    found = [quantity for item in measurements if (quantity := measured_start(experiment, item)) is not None]
    sound = [quantity.value for quantity in found if not quantity.doubtful] or [quantity.value for quantity in found]
    return (fmean(sound) if sound else None), set_from
