"""The twin of a rig as a run: settings that decide its result, as plain numbers and texts; quantities and records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from rigtwin.compare.campaign.run import Result, Run
from rigtwin.compare.deviation import over_views
from rigtwin.compare.twins.few_body import FRAME_RATE
from rigtwin.compare.twins.matched import twin_of
from rigtwin.compare.twins.registry import entry_of
from rigtwin.compare.twins.twin import Twin
from rigtwin.lab.camera import Camera
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.file.model_file import Model
from rigtwin.lab.materials import KnownContact, Material, Particle
from rigtwin.lab.quantity import Check, Evaluation, Quantity
from rigtwin.lab.records import Profile, Series
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
        Its result has ``quantities``, ``checks``, ``warnings``, ``settings``, ``profile_N_x``, ``profile_N_height``,
        ``profile_N_sigma`` [m] and, for each series, ``QUANTITY_time`` [s] and ``QUANTITY_value``.
    """
    needs = entry_of(experiment).needed(experiment)
    contacts = [
        {"pair": list(names), **asdict(model.known_contact(*names).complete(needs, name="-".join(names)))}
        for names in experiment.contacts
    ]
    settings: dict[str, Any] = {
        "rig": experiment.rig_name,
        "rig_settings": asdict(experiment.rig),
        "particle": _plain(experiment.particle),
        "wall": None if experiment.wall is None else asdict(experiment.wall),
        "contacts": contacts,
        "effects": {effect: dict(values) for effect, values in model.effects.items()},
    }
    if entry_of(experiment).many_particles:
        settings |= {"count": count, "seed": seed, "rolling": rolling, "stiffness_factor": stiffness_factor}
    else:
        settings["frame_rate"] = experiment.camera.frame_rate or FRAME_RATE
    return Run(name, FUNCTION, settings, cost)


def _plain(particle: Particle) -> dict[str, Any]:
    """The particle as plain data; a single size is left out, as in runs that were kept before there were others."""
    return {name: value for name, value in asdict(particle).items() if name != "sizes" or value is not None}


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
    """Run the twin that `twin_run` describes, on one thread.

    Parameters
    ----------
    rig : str
        Name of the rig.
    rig_settings, particle : mapping
        Fields of its settings and of the particle, in SI.
    wall : mapping or None
        Fields of the material of the wall, in SI.
    contacts : sequence of mapping
        Of each contact the ``pair`` and its coefficients [1].
    effects : mapping of str to mapping
        Parameters of each effect, in SI.
    frame_rate : float, optional
        Frames per second [1/s] of a twin of few bodies.
    count : int, optional
        As for `twin_run`.
    seed : int
        As for `twin_run`.
    rolling : Rolling, optional
        As for `twin_run`.
    stiffness_factor : float, optional
        As for `twin_run`.

    Returns
    -------
    Result
        As `twin_run` describes it.
    """
    from pydantic import TypeAdapter

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
    return _result_of(twin)


def _result_of(twin: Twin) -> Result:
    found: Result = {
        "rig": twin.rig,
        "quantities": [asdict(quantity) for quantity in twin.evaluation.quantities],
        "checks": [asdict(check) for check in twin.evaluation.checks],
        "warnings": [*twin.warnings, *twin.evaluation.warnings],
        "settings": twin.settings,
        "assumptions": list(twin.assumptions),
        "profiles": [{"base": profile.base, "view": profile.view} for profile in twin.profiles],
        "series": [{"quantity": series.quantity, "unit": series.unit} for series in twin.series],
        "wall_s": twin.seconds,
        "failed": twin.failed,
    }
    for number, profile in enumerate(twin.profiles, start=1):
        for name in ("x", "height", "sigma"):
            found[f"profile_{number}_{name}"] = np.asarray(getattr(profile, name))
    for series in twin.series:
        found |= {f"{series.quantity}_time": np.asarray(series.time), f"{series.quantity}_value": series.value}
    return found


def twin_from(result: Result) -> Twin:
    """Return the twin of many particles that gave a result.

    Parameters
    ----------
    result : Result
        What the run of the twin returned.

    Returns
    -------
    Twin
        The twin, without its picture and the surfaces over time.
    """
    checks = tuple(
        Check(**{**one, "value": _number(one["value"]), "expected": _number(one["expected"])})
        for one in result["checks"]
    )
    profiles = tuple(
        Profile(
            result[f"profile_{number}_x"],
            result[f"profile_{number}_height"],
            result[f"profile_{number}_sigma"],
            base=None if one["base"] is None else tuple(one["base"]),
            view=one["view"],
        )
        for number, one in enumerate(result["profiles"], start=1)
    )
    series = tuple(
        Series(result[f"{one['quantity']}_time"], result[f"{one['quantity']}_value"], **one) for one in result["series"]
    )
    return Twin(
        result["rig"],
        Evaluation(tuple(_quantities(result)), checks),
        result["settings"],
        profiles=profiles,
        series=series,
        assumptions=tuple(result["assumptions"]),
        warnings=tuple(result["warnings"]),
        failed=result.get("failed", ""),
        seconds=result["wall_s"],
    )


def quantities_of(result: Result) -> list[Quantity]:
    """Return the quantities of a finished twin, the views of each combined.

    Parameters
    ----------
    result : Result
        What the run of the twin returned.

    Returns
    -------
    list of Quantity
        A value that is not known is NaN.
    """
    return over_views(_quantities(result))


def _quantities(result: Result) -> list[Quantity]:
    found = []
    for item in result["quantities"]:
        numbers = {name: _number(item[name]) for name in ("value", "std_uncertainty")}
        budget = {part: _number(value) for part, value in item["budget"].items()}
        found.append(Quantity(**{**item, **numbers, "budget": budget}))
    return found


def _number(value: float | None) -> float:
    """The number; JSON has none that is not finite."""
    return float("nan") if value is None else value
