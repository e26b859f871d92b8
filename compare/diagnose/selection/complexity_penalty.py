"""What one more effect must gain beside those that are named already."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigtwin.compare.diagnose.selection.candidate import Candidate
from rigtwin.sim.effects import Effect

SECOND = 20.0
"""Least further gain for one more effect ..."""
SECOND_SHARE, SECOND_MOST = 0.02, 1500.0
"""... and this share of what was gained before, up to a limit, where it could be what is left of the first: a strong
effect whose law is known to a few percent leaves something that is no second effect."""
OTHER_SHARE = 1e-4
"""As `SECOND_SHARE`, for one more effect that acts elsewhere: in the picture, where the first acts on the motion."""
ACROSS_MOST = 100.0
"""As `SECOND_MOST`, for one that acts across a drop where the first acts along it, or on when a clump slips where the
first acts on how it slides: no law of the one shows there."""


def price(fewer: Candidate, more: Candidate, rig: str) -> float:
    """What one more effect must gain."""
    old = {place for term in fewer.terms for place in _places(term)}
    new = [term for term in more.terms if term.name not in fewer.names]
    alike = any(old & _places(term) for term in new)
    across = _crossed(new, fewer.terms, rig)
    left = (SECOND_SHARE if alike else OTHER_SHARE) * fewer.gain
    asked = min(left, ACROSS_MOST if across else SECOND_MOST, feigned(fewer, more, new, left))
    return max(SECOND, asked)


def feigned(fewer: Candidate, more: Candidate, new: Sequence[Effect], left: float) -> float:
    """What it gains to set a stated calibration quantity free, where all `left` of the first effects went to it.

    Data that know it far better than it is stated move it by little, whatever is left over.
    """
    stated = {unknown.name: unknown.sd for unknown in fewer.fitted.unknowns if math.isfinite(unknown.sd)}
    names = [f"{term.name}.{parameter.name}" for term in new for parameter in term.parameters]
    if any(name not in stated for name in names):
        return math.inf
    moved = max(math.sqrt(max(left, 0.0)) * more.fitted.std(name) / stated[name] for name in names)
    return (moved + math.sqrt(SECOND)) ** 2


def _crossed(new: Sequence[Effect], old: Sequence[Effect], rig: str) -> bool:
    """Whether the new effects show, to first order, where the old ones do not show at all."""
    if rig == "drop":
        return all(_across(one) for one in new) and not any(_across(one) for one in old)
    # each run's own friction stands between when it slips and how it slides
    return rig == "slide" and all(one.onset is not None for one in new) and all(one.sliding is not None for one in old)


def _across(term: Effect) -> bool:
    """Whether an effect shows across the fall alone, to first order."""
    return term.geometry in ("level", "release_spin") or term.name == "camera_roll"


def _places(term: Effect) -> set[str]:
    """Where an effect acts: in motion, at impacts, in friction, in the picture, in the time of the frames."""
    hooks = {
        "motion": (term.force, term.torque),
        "impact": (term.restitution, term.attraction),
        "friction": (term.rolling, term.sliding, term.onset),
        "picture": (term.view,),
        "time": (term.exposure,),
    }
    found = {place for place, own in hooks.items() if any(hook is not None for hook in own)} or {term.geometry}
    return found | {"motion"} if _late_by_place(term) else found


def _late_by_place(term: Effect) -> bool:
    """Whether rows are late by where the bead is, which looks like a drag; a wrong clock is wrong alike everywhere."""
    if term.exposure is None:
        return False
    size = term.parameters[0].typical
    return bool(term.exposure(1.0, 0.0, 0.0, size) != term.exposure(1.0, 0.0, 1.0, size))
