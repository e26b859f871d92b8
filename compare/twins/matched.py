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

import numpy as np

from rigtwin import __version__
from rigtwin.compare.twins.run_warnings import fit_for_a_lab
from rigtwin.compare.twins.twin import Twin, stated
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.materials import PARAMETERS, Contact
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.rigs import (
    GRAVITY,
    DropSettings,
    DrumSettings,
    HopperSettings,
    PackingSettings,
    Pendulum,
    PendulumSettings,
    PileSettings,
    TiltSettings,
)

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling


PILE_COUNT = 1000
"""Number of particles of a pile's twin if neither the lab file nor the command states one."""

BULK = (PackingSettings, PileSettings, DrumSettings, HopperSettings)
"""Rigs of many particles; their twins need no measured input."""

NEEDS = {"drop": ("restitution",), "pendulum": ("restitution",), "tilt": ("static_friction", "rolling_friction")}
"""Contact parameters that the simulation of a rig needs; all of them for other rigs."""

# the quantity whose measured mean is input of the twin if the lab file does not state it
STARTS_FROM = {"drop": "drop_height", "pendulum": "release_angle"}


def needs_measurement(experiment: Experiment) -> bool:
    """Whether the twin needs measured input: its start, its frame rate, or the length of the film."""
    if isinstance(experiment.rig, BULK):
        return False
    stated = stated_start(experiment) is not None and experiment.camera.frame_rate is not None
    return not (isinstance(experiment.rig, DropSettings) and stated)


def takes_count(experiment: Experiment) -> bool:
    """Whether the lab file does not determine the number of particles of the twin."""
    rig = experiment.rig
    if isinstance(rig, (PackingSettings, HopperSettings)):
        return rig.count is None and rig.total_mass is None
    if isinstance(rig, DrumSettings):
        return rig.count is None and rig.fill is None
    return isinstance(rig, BULK) and rig.count is None


def stated_start(experiment: Experiment) -> float | None:
    """Drop height [m] or release angle [deg] as stated in the lab file; None for other rigs or if not stated."""
    rig = experiment.rig
    if isinstance(rig, DropSettings):
        return rig.drop_height
    if isinstance(rig, PendulumSettings) and rig.release_angle is not None:
        return math.degrees(rig.release_angle)
    return None


def measured_start(experiment: Experiment, measurement: Measurement) -> Quantity | None:
    """The measured drop height, or release angle of bead A; a doubtful one only if there is no other."""
    name = STARTS_FROM.get(experiment.rig_name)
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
    """The matched twin of an experiment under a model.

    The twin starts from the stated value, else from the measured mean; `Twin.set_from` records which.  A run of many
    particles writes checkpoints into the folder `kept_in` and continues from them.  Raises `BadInput` if a contact that
    the rig needs is not known.
    """
    rig, particle = experiment.rig, experiment.particle
    contacts = [model.contact(*names, NEEDS.get(experiment.rig_name, PARAMETERS)) for names in experiment.contacts]
    start, set_from = _start(experiment, measurements)
    if isinstance(rig, BULK):
        chosen = stated(stiffness_factor=stiffness_factor, rolling=rolling)
        numerics: dict[str, Any] = {"seed": seed, "threads": threads, "effects": model.effects, **chosen}
        if kept_in is not None:
            numerics["checkpoint"] = _checkpoint(kept_in, experiment, contacts, count, numerics)
        twin = _bulk_twin(experiment, contacts, count=count, **numerics, progress=progress)
        return replace(twin, warnings=fit_for_a_lab(twin.warnings))
    from rigtwin.compare.twins import drop as few_twins
    from rigtwin.compare.twins import pendulum as few_twins_pendulum
    from rigtwin.compare.twins import tilt as few_twins_tilt

    rate = _frame_rate(experiment, measurements)
    if isinstance(rig, DropSettings):
        assert experiment.wall is not None
        twin = few_twins.drop_twin(
            rig.rig(start),
            particle,
            experiment.wall,
            contacts[0],
            frame_rate=rate,
            seed=seed,
            effects=model.effects,
            progress=progress,
        )
    elif isinstance(rig, TiltSettings):
        assert experiment.wall is not None
        twin = few_twins_tilt.tilt_twin(
            rig.rig(),
            particle,
            experiment.wall,
            contacts[0],
            frame_rate=rate,
            effects=model.effects,
            progress=progress,
        )
    else:
        assert isinstance(rig, PendulumSettings)
        pendulum = rig.rig(start)
        watched = _watched(pendulum, rate, measurements)
        twin = few_twins_pendulum.pendulum_twin(
            pendulum,
            particle,
            contacts[0],
            frame_rate=rate,
            wall=experiment.wall,
            duration=watched,
            effects=model.effects,
            progress=progress,
        )
    return replace(twin, set_from=set_from)


def check_settings(experiment: Experiment, *, model: Model, frame_rate: float | None, count: int | None = None) -> None:
    """Raise `BadInput` for settings that the twin would refuse, before anything is measured or computed.

    Settings that depend on a measurement, or on a `frame_rate` [1/s] that is not known (None), are not checked.
    """
    rig, particle, wall = experiment.rig, experiment.particle, experiment.wall
    if isinstance(rig, BULK):
        _check_bulk(experiment, count)
        return
    if frame_rate is None:
        return
    contact = model.contact(*experiment.contacts[0], NEEDS[experiment.rig_name])
    if isinstance(rig, TiltSettings):
        from rigtwin.sim import tilt

        assert wall is not None  # the lab file demands one
        tilt.check(tilt.Trial(rig.rig(), particle, wall, contact, frame_rate))
    elif isinstance(rig, DropSettings) and rig.drop_height is not None:
        from rigtwin.sim import drop

        assert wall is not None
        drop.check(drop.Trial(rig.rig(), particle, wall, contact, frame_rate))
    elif isinstance(rig, PendulumSettings) and rig.release_angle is not None:
        from rigtwin.sim import pendulum

        pendulum.check(pendulum.Trial(rig.rig(), particle, contact, frame_rate, wall))


def _check_bulk(experiment: Experiment, count: int | None) -> None:
    rig, particle, filled = experiment.rig, experiment.particle, _filled(experiment, count)
    if isinstance(rig, DrumSettings):
        from rigtwin.sim import drum

        drum.check(rig.rig(), particle, count=filled)
        return
    assert filled is not None  # a drum alone may be filled to a part
    if isinstance(rig, PileSettings):
        from rigtwin.sim.pile import pile

        pile.check(rig.rig(), particle, count=filled)
    elif isinstance(rig, HopperSettings):
        from rigtwin.sim import hopper

        hopper.check(rig.rig(), particle, count=filled)
    elif isinstance(rig, PackingSettings):
        from rigtwin.sim import packing

        packing.check(rig.rig(), particle, count=filled)


def _filled(experiment: Experiment, count: int | None) -> int | None:
    """Number of particles of the twin: from the lab file, else `count`; None if the fill of a drum determines it."""
    rig = experiment.rig
    if isinstance(rig, DrumSettings):
        return rig.count or (count if takes_count(experiment) else None)
    if isinstance(rig, PileSettings):
        return rig.count or count or PILE_COUNT
    assert isinstance(rig, (PackingSettings, HopperSettings))
    weighed = None if rig.total_mass is None else round(rig.total_mass / experiment.particle.mass)
    if weighed == 0 and not rig.count:
        raise BadInput("total_mass: is less than half the mass of one particle; state the mass of all particles.")
    filled = rig.count or weighed or count
    if not filled:
        raise BadInput("the number of particles is not known; add total_mass or count to the experiment.")
    return filled


def checkpoints(folder: Path, experiment: Experiment) -> list[Path]:
    """Checkpoints of an experiment's twins in `folder`."""
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


def _bulk_twin(experiment: Experiment, contacts: Sequence[Contact], *, count: int | None, **run: Any) -> Twin:
    """The twin of a rig of many particles; `contacts` with the wall first."""
    from rigtwin.compare.twins import drum as bulk_twins_drum
    from rigtwin.compare.twins import hopper as bulk_twins_hopper
    from rigtwin.compare.twins import many_body as bulk_twins_many_body
    from rigtwin.compare.twins import packing as bulk_twins
    from rigtwin.compare.twins import pile as bulk_twins_pile

    rig, particle, wall = experiment.rig, experiment.particle, experiment.wall
    assert wall is not None  # the lab file demands a wall for these rigs
    cast = bulk_twins_many_body.Cast(particle, wall, contacts[1], contacts[0])
    filled = _filled(experiment, count)
    if isinstance(rig, DrumSettings):
        return bulk_twins_drum.drum_twin(rig.rig(), cast, count=filled, **run)
    assert filled is not None  # a drum alone may be filled to a part
    if isinstance(rig, PileSettings):
        return bulk_twins_pile.pile_twin(rig.rig(), cast, count=filled, **run)
    assert isinstance(rig, (PackingSettings, HopperSettings))
    if isinstance(rig, HopperSettings):
        return bulk_twins_hopper.hopper_twin(rig.rig(), cast, count=filled, **run)
    return bulk_twins.packing_twin(bulk_twins.cylinder_for(rig.rig(), particle, filled), cast, count=filled, **run)


def _start(experiment: Experiment, measurements: Sequence[Measurement]) -> tuple[float | None, dict[str, str]]:
    """The measured start in SI units (None if there is none), and the source of the start of the twin."""
    name = STARTS_FROM.get(experiment.rig_name)
    if name is None:
        return None, {}
    set_from = {name: "measured" if stated_start(experiment) is None else "stated"}
    found = [quantity for item in measurements if (quantity := measured_start(experiment, item)) is not None]
    sound = [quantity.value for quantity in found if not quantity.doubtful] or [quantity.value for quantity in found]
    if not sound:
        return None, set_from
    return (math.radians(fmean(sound)) if name == "release_angle" else fmean(sound)), set_from


def _frame_rate(experiment: Experiment, measurements: Sequence[Measurement]) -> float:
    """Frame rate [1/s] as stated, else that of the clips, else from the time steps of tracked records."""
    if experiment.camera.frame_rate is not None:
        return experiment.camera.frame_rate
    rates = [float(rate) for item in measurements if (rate := item.camera.get("frame_rate_hz"))]
    rates = rates or [1 / float(np.median(np.diff(track.time))) for item in measurements for track in item.tracks]
    if not rates:
        raise BadInput(
            f"{experiment.id}: the frame rate is neither stated nor measured; "
            'add frame_rate = "240 Hz" under [experiments.camera].'
        )
    return fmean(rates)


def _watched(rig: Pendulum, rate: float, measurements: Sequence[Measurement]) -> float:
    """Length of the record [s]: that of the longest film, and at least until the beads turn back."""
    film = max((float(np.ptp(track.time)) for item in measurements for track in item.tracks), default=0.0)
    period = 2 * math.pi * math.sqrt(rig.length / GRAVITY) * (1 + rig.release_angle**2 / 16)
    return max(film, 0.6 * period + 5 / rate)
