"""The camera in the model: calibration errors as unknowns with their stated uncertainties as priors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.models.unknown import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect, named
from rigtwin.sim.effects.effect import WIDENING

CALIBRATED = ("frame_rate_error", "scale_error", "camera_roll")


def camera_unknowns(lab: TrackedLab, terms: Sequence[Effect], more: Mapping[str, float]) -> list[Unknown]:
    """Unknowns of the calibration with their stated standard uncertainties, and those of the terms.

    `more` maps the rig's own calibration effects to their standard uncertainties.  A calibration quantity that is
    itself a term has no prior.
    """
    camera = lab.camera
    stated = {
        "frame_rate_error": camera.clock_rel,
        "scale_error": camera.scale_rel,
        "camera_roll": camera.roll,
        **more,
    }
    wanted = {term.name: term for term in terms}
    unknowns = []
    for name, sd in stated.items():
        parameter = named(name).parameters[0]
        lifted = name in wanted
        unknowns.append(
            Unknown(
                f"{name}.{parameter.name}",
                0.0,
                parameter.typical,
                sd=math.inf if lifted else max(sd, 1e-9),
                low=parameter.low,
                high=parameter.high,
                effect=name if lifted else "",
            )
        )
    for term in terms:
        if term.name in stated or term.geometry in WIDENING:
            continue
        for parameter in term.parameters:
            mean, sd = parameter.assumed or (0.0, math.inf)
            # beyond the physical range an effect of the wrong sign is found and refused
            beyond = 0.0 if parameter.bounded else parameter.high - parameter.low
            unknowns.append(
                Unknown(
                    f"{term.name}.{parameter.name}",
                    mean,
                    parameter.typical,
                    prior=mean,
                    sd=sd,
                    low=parameter.low - beyond,
                    high=parameter.high + beyond,
                    effect=term.name,
                )
            )
    return unknowns


def is_camera(name: str, terms: Sequence[Effect]) -> bool:
    """Whether an unknown changes only the picture of the motion, not the motion."""
    effect = name.split(".", maxsplit=1)[0]
    return effect in CALIBRATED or any(
        term.name == effect and (term.view is not None or term.exposure is not None) for term in terms
    )


def exposed(time: Array, rows: Array, values: Mapping[str, Array], terms: Sequence[Effect]) -> Array:
    """True time [s] of each row, shape (settings, rows).  A shutter's delay is computed at the observed position."""
    true = np.asarray(time)[None]
    for effect in _once("exposure", terms):
        own = [values[f"{effect.name}.{p.name}"][:, None] for p in effect.parameters]
        assert effect.exposure is not None
        true = effect.exposure(true, rows[None, :, 0], rows[None, :, 1], *own)
    return true


def viewed(x: Array, y: Array, values: Mapping[str, Array], terms: Sequence[Effect]) -> tuple[Array, Array]:
    """Position [m] at which the camera sees the point x, y."""
    for effect in _once("view", terms):
        own = [values[f"{effect.name}.{p.name}"][:, None] for p in effect.parameters]
        assert effect.view is not None
        x, y = effect.view(x, y, *own)
    return x, y


def _once(hook: str, terms: Sequence[Effect]) -> list[Effect]:
    """The camera effects with this hook: those of the terms, then the calibration, each once."""
    always = [named(name) for name in CALIBRATED]
    extra = [term for term in terms if term.name not in CALIBRATED]
    return [effect for effect in (*extra, *always) if getattr(effect, hook) is not None]
