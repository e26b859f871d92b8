"""The camera in the model: a suspect like any other, with what the experimenter states of it as its prior."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rigtwin.compare.diagnose.labs import TrackedLab
from rigtwin.compare.diagnose.unknowns import Unknown
from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track
from rigtwin.sim.effects import Effect, named
from rigtwin.sim.effects.effect import WIDENING

CALIBRATED = ("frame_rate_error", "scale_error", "camera_roll")


def camera_unknowns(lab: TrackedLab, terms: Sequence[Effect], more: Mapping[str, float]) -> list[Unknown]:
    """Unknowns of the calibration with their stated uncertainty, and of the terms.

    `more` holds the rig's own calibration effects and their standard deviations.  A calibration quantity that is itself
    a term is set free: its prior is lifted.
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
            unknowns.append(
                Unknown(
                    f"{term.name}.{parameter.name}",
                    mean,
                    parameter.typical,
                    prior=mean,
                    sd=sd,
                    low=_wide(parameter.low, parameter.high),
                    high=parameter.high + (parameter.high - parameter.low),
                    effect=term.name,
                )
            )
    return unknowns


def _wide(low: float, high: float) -> float:
    # the fit may leave the physical range, so that an effect of the wrong sign is seen as such and refused
    return low - (high - low)


def is_camera(name: str, terms: Sequence[Effect]) -> bool:
    """Whether an unknown acts between the motion and the picture alone."""
    effect = name.split(".", maxsplit=1)[0]
    return effect in CALIBRATED or any(
        term.name == effect and (term.view is not None or term.exposure is not None) for term in terms
    )


def exposed(time: Array, rows: Array, values: Mapping[str, Array], terms: Sequence[Effect]) -> Array:
    """[s], (settings, rows): the true time of each row.  The observed place serves for a shutter's delay."""
    true = np.asarray(time)[None]
    for effect in _once("exposure", terms):
        own = [values[f"{effect.name}.{p.name}"][:, None] for p in effect.parameters]
        assert effect.exposure is not None
        true = effect.exposure(true, rows[None, :, 0], rows[None, :, 1], *own)
    return true


def viewed(x: Array, y: Array, values: Mapping[str, Array], terms: Sequence[Effect]) -> tuple[Array, Array]:
    """[m] where the camera sees what is at x, y."""
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


def noise_of(lab: TrackedLab, tracks: Sequence[Track]) -> float:
    """[m] one standard deviation of a coordinate: stated, refined by the roughness of the tracks themselves.

    Third differences remove any smooth motion; the median stays clear of impacts.  A coordinate that never changes was
    not measured.
    """
    rough = []
    for track in tracks:
        seen = track.position[:, np.ptp(track.position, axis=0) > 0]
        gap = np.diff(track.time)
        even = np.abs(gap - np.median(gap)) < 0.2 * np.median(gap)
        third = np.abs(np.diff(seen, 3, axis=0))
        # an impact is rough in itself
        calm = (third <= 5 * np.median(third, axis=0)).all(axis=1)
        rough.append(third[even[:-2] & even[1:-1] & even[2:] & calm].ravel())
    differences = np.concatenate(rough)
    if not len(differences):
        if lab.camera.noise > 0:
            return lab.camera.noise
        raise BadInput(
            f"{lab.folder}: no four rows of any track are evenly spaced, so that the tracking noise cannot be read off "
            "them; state tracking_noise_m under camera."
        )
    found = float(np.median(differences)) / 0.6745 / math.sqrt(20.0)
    if not math.isfinite(lab.camera.noise) or lab.camera.noise <= 0:
        return max(found, 1e-7)
    # stated values are rounded; far off they are not believed
    return found if 0.5 < found / lab.camera.noise < 2.0 else max(found, lab.camera.noise)
