"""The twin of a rig as a run: settings that decide its result, as plain numbers and texts; quantities and records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.campaign.run import Result, Run
from rigtwin.compare.twins.few_body import FRAME_RATE
from rigtwin.compare.twins.matched import twin_of
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.camera import Camera
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.materials import KnownContact, Material, Particle
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.rigs import SETTINGS

if TYPE_CHECKING:
    from rigtwin.sim.engine.contact import Rolling

FUNCTION = f"{__name__}:simulate"


def twin_run(
    name: str,
    experiment: Experiment,
    model: Model,
    *,
    seed: int,
    count: int | None = None,
    rolling: Rolling | None = None,
    stiffness_factor: float | None = None,
    cost: float = 1.0,
) -> Run:
    """The twin of an experiment under a model as a run on one thread.

    Parameters
    ----------
    name : str
        Name of the run.
    experiment : Experiment
        Rig, particle and wall; its media are not used.
    model : Model
        Contacts of the experiment, and effects.
    seed : int
        Seed of the random numbers.
    count : int, optional
        Number of particles where the experiment states none.
    rolling : Rolling, optional
        Rolling resistance law of a twin of many particles.
    stiffness_factor : float, optional
        Factor on the moduli of a twin of many particles.
    cost : float
        Estimated run time [s].

    Returns
    -------
    Run
        Its result has ``quantities``, ``warnings``, ``profile_N_x``, ``profile_N_height`` [m] and, for each series,
        ``QUANTITY_time`` [s] and ``QUANTITY_value``.
    """
    needs = entry_of(experiment).needs
    contacts = [
        {"pair": list(names), **asdict(model.known_contact(*names).complete(needs, name="-".join(names)))}
        for names in experiment.contacts
    ]
    settings: dict[str, Any] = {
        "rig": experiment.rig_name,
        "rig_settings": asdict(experiment.rig),
        "particle": asdict(experiment.particle),
        "wall": None if experiment.wall is None else asdict(experiment.wall),
        "contacts": contacts,
        "effects": {effect: dict(values) for effect, values in model.effects.items()},
    }
    if entry_of(experiment).many_particles:
        settings |= {"count": count, "seed": seed, "rolling": rolling, "stiffness_factor": stiffness_factor}
    else:
        settings["frame_rate"] = experiment.camera.frame_rate or FRAME_RATE
    return Run(name, FUNCTION, settings, cost)


def simulate(
    *,
    rig: str,
    rig_settings: Mapping[str, Any],
    particle: Mapping[str, Any],
    wall: Mapping[str, Any] | None,
    contacts: Sequence[Mapping[str, Any]],
    effects: Mapping[str, Mapping[str, float]],
    frame_rate: float | None = None,
    count: int | None = None,
    seed: int = 1,
    rolling: Rolling | None = None,
    stiffness_factor: float | None = None,
) -> Result:
    """Run the twin that `twin_run` describes, on one thread."""
    from pydantic import TypeAdapter

    from rigtwin.compare.deviation import over_views

    experiment = Experiment(
        "twin",
        SETTINGS[rig](**rig_settings),
        TypeAdapter(Particle).validate_python(dict(particle)),
        None if wall is None else Material(**wall),
        Camera(frame_rate=frame_rate),
        (),
    )
    model = Model(effects=effects)
    for contact in contacts:
        known = KnownContact(**{one.name: contact[one.name] for one in fields(KnownContact)})
        model = model.with_contact(*contact["pair"], **asdict(known))
    twin = twin_of(
        experiment,
        model=model,
        count=count,
        seed=seed,
        threads=1,
        rolling=rolling,
        stiffness_factor=stiffness_factor,
    )
    found: Result = {
        "quantities": [asdict(quantity) for quantity in over_views(twin.evaluation.quantities)],
        "warnings": [*twin.warnings, *twin.evaluation.warnings],
        "wall_s": twin.seconds,
    }
    for number, profile in enumerate(twin.profiles, start=1):
        found |= {
            f"profile_{number}_x": np.asarray(profile.x),
            f"profile_{number}_height": np.asarray(profile.height),
        }
    for series in twin.series:
        found |= {f"{series.quantity}_time": np.asarray(series.time), f"{series.quantity}_value": series.value}
    return found


def quantities_of(result: Result) -> list[Quantity]:
    """The quantities of a finished twin; a value that is not known is NaN."""
    found = []
    for item in result["quantities"]:
        numbers = {name: float("nan") if item[name] is None else item[name] for name in ("value", "std_uncertainty")}
        found.append(Quantity(**{**item, **numbers}))
    return found
