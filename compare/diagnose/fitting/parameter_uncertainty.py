"""Standard uncertainty of the coefficients of an effect, from the fit and from the stated uncertainty of the sizes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import Bead, TrackedLab
from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.sim.effects import Effect

SPEED = 1.0  # [m/s], speed at which forces are compared
HIGH = 1.0  # [m], height above the plate at which forces are compared


def parameters(lab: TrackedLab, fitted: Fit, terms: Sequence[Effect]) -> dict[str, dict[str, Any]]:
    """Value, standard uncertainty and unit of each coefficient, by name."""
    found: dict[str, dict[str, Any]] = {}
    for term in terms:
        for parameter in term.parameters:
            if term.geometry == "jitter":
                found[parameter.name] = {"value": fitted.jitter, "std": fitted.jitter_std, "unit": "s"}
                continue
            if term.geometry == "scatter":
                value = float(fitted.scatter[-1])
                found[parameter.name] = {
                    "value": value,
                    "std": value / math.sqrt(2 * max(fitted.kicks, 1)),
                    "unit": "1",
                }
                continue
            name = f"{term.name}.{parameter.name}"
            value = fitted.value(name)
            stated = {f"{c.bead.name}-{c.wall}": lab.stated_for(c, parameter) for c in lab.conditions}
            if any(one is not None for one in stated.values()):
                each = {pair: value if one is None else one for pair, one in stated.items()}
                mean = float(np.mean(list(each.values())))
                found[parameter.name] = {"value": mean, "std": 0.0, "unit": parameter.unit}
                if len(set(each.values())) > 1:
                    found[parameter.name]["by_pair"] = each
                continue
            std = math.hypot(fitted.std(name), value * _by_size(lab, fitted, term))
            found[parameter.name] = {"value": value, "std": std, "unit": parameter.unit}
    return found


def _by_size(lab: TrackedLab, fitted: Fit, term: Effect) -> float:
    """Relative uncertainty of a force's coefficient from the diameter uncertainty of the bead that it moves most.

    Zero where that diameter is an unknown of the fit: the covariance of the fit then contains its uncertainty.
    """
    if term.force is None or len(term.parameters) != 1:
        return 0.0
    beads = {condition.bead.name: condition.bead for condition in lab.conditions}.values()
    bead = max(beads, key=lambda one: _force(term, one, one.radius) / one.mass)
    if lab.rig != "drop" and any(unknown.name == f"diameter.{bead.name}" for unknown in fitted.unknowns):
        return 0.0
    stated = bead.about.get("diameter_uncertainty_m", 0.0)
    plain = _force(term, bead, bead.radius)
    if not isinstance(stated, (int, float)) or plain == 0.0:
        return 0.0
    power = math.log(_force(term, bead, 1.01 * bead.radius) / plain) / math.log(1.01)
    return abs(power) * float(stated) / bead.diameter


def _force(term: Effect, bead: Bead, radius: float) -> float:
    """Force [N] on a bead at the speed and height above."""
    assert term.force is not None
    fx, fy = term.force(SPEED, 0.0, HIGH, radius, bead.mass, term.parameters[0].typical)
    return math.hypot(fx, fy)
