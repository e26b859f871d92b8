"""Gain in deviance that a further effect must reach beside the effects named already."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigtwin.compare.diagnose.selection.candidate import Candidate
from rigtwin.sim.effects import Effect

SECOND = 20.0
"""Smallest gain in deviance of a further effect."""
SECOND_SHARE, SECOND_MOST = 0.02, 1500.0
"""Share of the gain so far that a further effect of the same kind must reach, and its limit.  The law of a strong
effect is known to a few percent only, and the rest must not be named as a second effect."""
OTHER_SHARE = 1e-4
"""As `SECOND_SHARE`, for a further effect of another kind, for example in the picture if the first is in the motion."""
ACROSS_MOST = 100.0
"""As `SECOND_MOST`, for an effect across the fall if the first acts along it, or on the onset of sliding if the first
acts during sliding: an error in the law of the first does not show there."""


def price(fewer: Candidate, more: Candidate, rig: str) -> float:
    """Gain in deviance that the further effects of `more` must reach."""
    old = {place for term in fewer.terms for place in _places(term)}
    new = [term for term in more.terms if term.name not in fewer.names]
    alike = any(old & _places(term) for term in new)
    across = _crossed(new, fewer.terms, rig)
    left = (SECOND_SHARE if alike else OTHER_SHARE) * fewer.gain
    asked = min(left, ACROSS_MOST if across else SECOND_MOST, feigned(fewer, more, new, left))
    return max(SECOND, asked)


def feigned(fewer: Candidate, more: Candidate, new: Sequence[Effect], left: float) -> float:
    """Largest gain of freeing a calibration quantity if it absorbed the deviance `left` by the first effects.

    Small if the data determine the quantity far better than its stated uncertainty.  Infinite for other effects.
    """
    stated = {unknown.name: unknown.sd for unknown in fewer.fitted.unknowns if math.isfinite(unknown.sd)}
    names = [f"{term.name}.{parameter.name}" for term in new for parameter in term.parameters]
    if any(name not in stated for name in names):
        return math.inf
    moved = max(math.sqrt(max(left, 0.0)) * more.fitted.std(name) / stated[name] for name in names)
    return (moved + math.sqrt(SECOND)) ** 2


def _crossed(new: Sequence[Effect], old: Sequence[Effect], rig: str) -> bool:
    """Whether the new effects act, to first order, where the old ones do not act at all."""
    if rig == "drop":
        return all(_across(one) for one in new) and not any(_across(one) for one in old)
    # the friction of each repetition is an unknown, which decouples the onset from the sliding
    return rig == "slide" and all(one.onset is not None for one in new) and all(one.sliding is not None for one in old)


def _across(term: Effect) -> bool:
    """Whether an effect acts only across the fall, to first order."""
    return term.geometry in ("level", "release_spin") or term.name == "camera_roll"


def _places(term: Effect) -> set[str]:
    """Where an effect acts: motion, impact, friction, picture, time of the frames, or its geometry."""
    hooks = {
        "motion": (term.force, term.sideways, term.torque),
        "impact": (term.restitution, term.attraction),
        "friction": (term.rolling, term.sliding, term.onset),
        "picture": (term.view,),
        "time": (term.exposure,),
    }
    found = {place for place, own in hooks.items() if any(hook is not None for hook in own)} or {term.geometry}
    return found | {"motion"} if _late_by_place(term) else found


def _late_by_place(term: Effect) -> bool:
    """Whether the delay of a row depends on the bead's position, which resembles a drag; a clock error does not."""
    if term.exposure is None:
        return False
    size = term.parameters[0].typical
    return bool(term.exposure(1.0, 0.0, 0.0, size) != term.exposure(1.0, 0.0, 1.0, size))
