"""When a name that the diagnosis gave means an effect that was hidden, and which number of its own is which of ours."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from rigtwin.benchmarks.diagnose.lab_effects import ALL
from rigtwin.benchmarks.diagnose.lab_motion import AIR_VISCOSITY


def words(text: str) -> list[str]:
    return re.findall(r"[a-z0-9^']+", text.lower().replace("centred", "centre"))


def means(name: str, synonym: str) -> bool:
    """Whether a name is a synonym: the same words, or for "a&b&!c" the words a and b and not c.

    >>> means("air_drag", "air drag"), means("rolling shutter", "roll"), means("pivot viscous", "pivot&!dry")
    (True, False, True)
    """
    said = words(name)
    if "&" not in synonym:
        return said == words(synonym)
    parts = [part.strip() for part in synonym.split("&")]
    wanted = [part for part in parts if not part.startswith("!")]
    unwanted = [part[1:] for part in parts if part.startswith("!")]
    return all(part in said for part in wanted) and not any(part in said for part in unwanted)


def is_named(name: str, truth: Mapping[str, Any], effect: str) -> bool:
    """Whether a name in an answer means this hidden effect; names that no data of this rig could split count too."""
    if any(means(name, synonym) for synonym in truth["synonyms"][effect]):
        return True
    return any(means_effect(name, other) for other in truth["also_acceptable"].get(effect, ()))


def means_effect(name: str, effect: str) -> bool:
    if effect not in ALL:
        return means(name, effect)
    return any(means(name, synonym) for synonym in (effect, *ALL[effect].synonyms))


def canonical(name: str) -> str:
    """The catalogue's name for what the diagnosis called by one of its own."""
    if name in ALL:
        return name
    return next((effect for effect in ALL if means_effect(name, effect)), name)


# effect and parameter of the diagnosis -> the hidden number and how to turn it into that parameter
TRUE_VALUES: dict[tuple[str, str], tuple[str, Callable[[float], float]]] = {
    ("air_drag", "drag_coefficient"): ("kd", lambda kd: kd / 1.2),
    ("air_drag_schiller_naumann", "multiplier"): ("c_D", float),
    ("air_drag_standard", "multiplier"): ("c_D", float),
    ("buoyancy", "multiplier"): ("fluid_density", lambda density: density / 1.2),
    ("electrostatic", "charge"): ("charge", float),
    ("length_error", "offset"): ("length_error", float),
    ("linear_drag", "multiplier"): ("linear_drag", lambda c: c / (3 * math.pi * AIR_VISCOSITY)),
    ("perspective", "gradient"): ("perspective", float),
    ("pivot_friction", "moment"): ("tau_c", float),
    ("pivot_viscous", "damping"): ("c_pivot", float),
    ("release_spin", "spin"): ("release_spin", float),
    ("restitution_viscoelastic", "share"): ("fvisc", float),
    ("rod_mass", "mass_per_length"): ("thread_density", float),
    ("rolling_shutter", "delay"): ("shutter", float),
    ("timestamp_jitter", "std"): ("jitter", float),
}


# what the diagnosis gives of these is the whole deviation from what is stated, the ordinary part of it included
WHOLE: dict[tuple[str, str], Callable[[Mapping[str, float]], float]] = {
    ("camera_roll", "angle"): lambda world: world["cam_roll"],
    ("frame_rate_error", "relative"): lambda world: world["cam_q"] - 1,
    ("scale_error", "relative"): lambda world: world["cam_s"] - 1,
    ("plate_tilt", "angle"): lambda world: math.radians(world["level_deg"]) + world.get("plate_tilt", 0.0),
}


def true_value(truth: Mapping[str, Any], effect: str, parameter: str) -> float | None:
    """The true value of a parameter of the diagnosis; None where it has no counterpart among the hidden numbers."""
    if (whole := WHOLE.get((effect, parameter))) is not None:
        return whole(truth["world"])
    number, convert = TRUE_VALUES.get((effect, parameter), ("", float))
    hidden = truth["parameters"].get(number)
    return None if hidden is None else convert(hidden)
