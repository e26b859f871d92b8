"""Evaluate profiles of a heap: angles of repose, height, width and tip radius with their uncertainty budgets."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigtwin.lab.camera import Flank
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.quantity import Check, Evaluation, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Profile
from rigtwin.measure.pile import repose_angles
from rigtwin.measure.pile.checks import (
    narrow_base,
    uneven_flanks,
    views_checks,
)

GRAPHICAL, GEOMETRIC = "angle_of_repose_graphical", "angle_of_repose_geometric"

LINE, NARROWER = "line 15-85 %", "line 20-80 %"

NEAR = 0.3  # [deg], by which a mean may lie beside both sides without a remark: rounding and the sub-pixel foot
FLAWED = 3.0  # [deg], added to the uncertainty of an angle whose outline is unreliable

GRAINS_PER_CUBE = 0.6 * 6 / math.pi  # grains per cubed grain diameter, at the solid fraction 0.6 of a loose bed

OVERHANG = 3.0  # [grains], by which a heap may be wider than its base: less than one at each end, and one for reading
COVERED_BASE = 0.9  # share of a stated base that a heap must cover for a geometric angle over that base


@dataclass(frozen=True)
class Observation:
    """Profile of one photo, and the profiles that other readings of the photo give, one standard deviation away."""

    profile: Profile
    variants: Mapping[str, tuple[Profile, Profile]] = field(default_factory=dict)
    flaw: str = ""  # why the outline is unreliable
    grain: float | None = None  # bead diameter, in the unit of the profile
    checks: tuple[Check, ...] = ()  # of the photo
    scale_uncertainty: float = 0.0  # relative standard uncertainty of the scale
    unconfirmed: str = ""  # warning about a stated size that nothing in the picture confirms
    notes: tuple[str, ...] = ()  # warnings about the photo's file
    flank: Flank | None = None  # the flanks that are measured, where they are stated
    unsure_base: str = ""  # why the base line's height is doubtful, on which slopes along the flanks do not depend


def evaluate(
    profiles: Sequence[Profile], *, base_diameter: float | None = None, bead_diameter: float | None = None
) -> Evaluation:
    """Evaluate angles, height and width of a heap from its profiles, filmed or simulated.

    Parameters
    ----------
    profiles : sequence of Profile
        One profile per view: x along the base [m], height above the base [m].  The profile of a simulated heap is the
        silhouette of its spheres, not the line through their centres.
    base_diameter : float, optional
        Diameter of the base [m]; the geometric angle then refers to it instead of to the width of the heap.
    bead_diameter : float, optional
        Bead diameter [m]; a tenth of the heap's height where it is not given.

    Returns
    -------
    Evaluation
        Angles [deg] and lengths [m] of every view; with several views, first their means over views.

    Raises
    ------
    NothingToMeasure
        If a profile contains no heap.

    Notes
    -----
    With apex height H, base width B and area S of the silhouette::

        graphical            slope of a line along a flank, 15 to 85 % of the height
        geometric, apex      atan(2 H / B), as in ISO 4324
        geometric, equal area  atan(4 S / B^2)

    Examples
    --------
    >>> import numpy as np
    >>> from rigtwin.lab.records import Profile
    >>> x = np.linspace(-0.1, 0.1, 401)
    >>> triangle = Profile(x, 0.05 - 0.5 * np.abs(x), np.full(401, 1e-5))
    >>> found = evaluate([triangle], bead_diameter=0.002)
    >>> [one.value for one in found.quantities if one.detail == {"side": "left"}][0].__round__(1)
    26.6
    """
    return evaluate_views([Observation(profile) for profile in profiles], base_diameter, bead_diameter)


def evaluate_views(
    observations: Sequence[Observation], base_diameter: float | None, bead_diameter: float | None
) -> Evaluation:
    quantities: list[Quantity] = []
    checks: list[Check] = []
    warnings: list[str] = []
    doubtful: list[bool] = []
    for number, seen in enumerate(observations):
        grain = _grain(seen, bead_diameter)
        heap = repose_angles.find_parts(seen.profile, base_diameter, grain)
        if heap is None:
            known = seen.profile.height[np.isfinite(seen.profile.height) & np.isfinite(seen.profile.x)]
            points, above = len(known), int(np.sum(known > 0))
            raise NothingToMeasure(
                f"profile {number + 1} ({seen.profile.view}) has {points} points of known height, of which "
                f"{above} lie above its base line, and shows no heap there; check that heights are measured upwards "
                "from the base, or state the base of a photo with --base x1,y1,x2,y2."
            )
        found = _quantities_of_view(seen, heap, base_diameter, grain)
        if len(observations) > 1:
            found = [replace(one, detail={**one.detail, "view": seen.profile.view}) for one in found]
        quantities += found
        doubtful.append(any(one.doubtful for one in found if one.quantity == GRAPHICAL))
        warnings += seen.notes
        whose = f"{seen.profile.view}: " if len(observations) > 1 else ""
        if whose:  # else the reasons stand at the quantities
            warnings += [whose + reason for reason in sorted({one.doubtful for one in found if one.doubtful})]
        sides = repose_angles.free_flanks(heap, seen.flank)
        if short := _too_short(heap, sides):
            warnings.append(f"{whose}graphical angle of repose: not given, because {short}.")
        if seen.unconfirmed and seen.unconfirmed not in warnings:
            warnings.append(seen.unconfirmed)
        uneven = uneven_flanks(seen.profile, heap) if len(sides) == 2 else ""
        warnings += [uneven] if uneven else []
        if len(sides) == 1 and seen.flank is None:
            warnings.append(
                f"{whose}only the {sides[0]} flank is measured: the other is steeper than a loose heap, as against a "
                "wall; give --flank both if it is a slope."
            )
        warnings += [whose + words for words in _mean_beside_its_sides(found)]
        checks += seen.checks
    if len(observations) > 1:
        agree = views_checks(quantities, LINE)
        checks += agree
        odd = [check.message for check in agree if not check.passed]
        if any(doubtful) and not all(doubtful):
            left_out = ", ".join(seen.profile.view for seen, bad in zip(observations, doubtful, strict=True) if bad)
            warnings.append(f"left out of the mean over views because doubtful: {left_out}.")
            if doubtful.count(False) == 1:
                odd.append(f"only one view is not doubtful, and no other view confirms it; left out: {left_out}")
        # the scatter of the sides is already in the budget of a mean over views
        quantities = [*(doubted(one, "; ".join(odd)) for one in _over_views(quantities)), *quantities]
    if base_diameter is not None and bead_diameter is not None:
        warnings += narrow_base(base_diameter, bead_diameter)
    return Evaluation(tuple(quantities), tuple(checks), tuple(warnings))


def _grain(seen: Observation, stated: float | None) -> float | None:
    """Bead diameter in the unit of the profile: as beads look where that contradicts the `stated` one."""
    if stated is None:
        return seen.grain
    return stated * next((one.value for one in seen.checks if one.check == "bead_size" and not one.passed), 1.0)


def _angles(
    profile: Profile, base_diameter: float | None, grain: float | None, flanks: Sequence[str]
) -> dict[tuple[str, str, str], float]:
    """Every angle [deg] of a profile by (quantity, method, side); means only of two flanks."""
    heap = repose_angles.find_parts(profile, base_diameter, grain)
    if heap is None:
        return {}
    angles = {}
    for method, window in ((LINE, repose_angles.WINDOW), (NARROWER, (0.2, 0.8))):
        lines = {side: repose_angles.flank_line(heap, side, window) for side in flanks}
        sides = {side: line.angle for side, line in lines.items() if line is not None}
        # with a flank that is none of a heap, "mean" would be a number without a meaning
        if len(sides) == 2 and all(0 < angle <= repose_angles.STEEPEST_FLANK for angle in sides.values()):
            sides["mean"] = (sides["left"] + sides["right"]) / 2
        angles.update({(GRAPHICAL, method, side): angle for side, angle in sides.items()})
    for side in flanks:
        angles[GEOMETRIC, "apex", side] = repose_angles.apex_angle(heap, side)
        steepest = repose_angles.steepest_third(heap, side)
        if steepest is not None:
            angles[GRAPHICAL, "steepest third", side] = steepest
    if len(flanks) == 2:
        angles[GEOMETRIC, "apex", "mean"] = repose_angles.apex_angle(heap)
        angles[GEOMETRIC, "equal area", "mean"] = repose_angles.equal_area_angle(heap)
    return angles


def _mean_beside_its_sides(quantities: Sequence[Quantity]) -> Iterator[str]:
    """A warning where the geometric angles of both flanks lie on one side of the mean, which has another base.

    There is none if the mean is already doubtful.
    """
    angles = {one.detail["side"]: one for one in quantities if (one.quantity, one.method) == (GEOMETRIC, "apex")}
    sides = [angles[side].value for side in repose_angles.SIDES if side in angles]
    if len(sides) < 2 or "mean" not in angles or angles["mean"].doubtful:
        return
    mean = angles["mean"].value
    if not min(sides) - NEAR <= mean <= max(sides) + NEAR:
        yield (
            f"geometric angle of repose: the mean, {mean:.1f} deg, is that of the width of the base, and the angles "
            f"of the flanks, {sides[0]:.1f} and {sides[1]:.1f} deg, are those to the feet that are seen; "
            "check the base in the overlay, or state it with --base."
        )


def _quantities_of_view(
    seen: Observation, heap: repose_angles.Heap, base_diameter: float | None, grain: float | None
) -> list[Quantity]:
    sides = repose_angles.free_flanks(heap, seen.flank)
    angles = _angles(seen.profile, base_diameter, grain, sides)
    varied = {
        name: [_angles(profile, base_diameter, grain, sides) for profile in pair]
        for name, pair in seen.variants.items()
    }
    flaw = seen.flaw or _flaw_of_profile(heap, sides)
    limited = _base_limited(seen.profile, heap, base_diameter)
    ill_based = _base_flaw(heap, limited=limited)
    grainy = {
        side: (repose_angles.roughness_uncertainty(heap, side), repose_angles.window_uncertainty(heap, side))
        for side in sides
    }
    quantities = []
    for (name, method, side), angle in angles.items():
        budget = {
            part: _spread([other.get((name, method, side), angle) for other in pair], angle)
            for part, pair in varied.items()
        }
        budget |= _definition_uncertainty(heap, grainy, angles, name, method, side)
        if name == GEOMETRIC and side == "mean" and base_diameter is not None and seen.profile.base is None:
            # change of atan(2 H / B) or atan(4 S / B^2) by an error of the scale: H and S are measured, B is stated
            slant = math.sin(2 * math.radians(angle)) * (0.5 if method == "apex" else 1.0)
            budget["scale"] = math.degrees(slant * seen.scale_uncertainty)
        reason = flaw or (seen.unsure_base if name == GEOMETRIC else "")
        if reason:
            budget["unreliable outline"] = FLAWED
        budget = {part: value for part, value in budget.items() if math.isfinite(value) and value > 0}
        detail: dict[str, str | int | float | bool] = {"side": side}
        if side == "mean" and name == GRAPHICAL:
            # how uneven this heap is; it is not the uncertainty of its mean
            detail["left_minus_right_deg"] = round(angles[name, method, "left"] - angles[name, method, "right"], 4)
        if name == GEOMETRIC:
            detail["base_limited"] = limited
        one = Quantity(name, angle, root_sum_of_squares(budget), "deg", method, 1, detail, budget, reason)
        quantities.append(doubted(one, ill_based if name == GEOMETRIC and side == "mean" else ""))
    order = [(GRAPHICAL, LINE), (GEOMETRIC, "apex"), (GEOMETRIC, "equal area"), (GRAPHICAL, NARROWER)]
    place = {key: rank for rank, key in enumerate(order)}
    quantities.sort(key=lambda one: place.get((one.quantity, one.method), len(order)))
    leaning = failed(seen.checks, ("camera_roll",))  # a tilted base line adds to one side what it takes from the other
    quantities = [doubted(one, leaning if one.detail["side"] != "mean" else "") for one in quantities]
    wrong_size = failed(seen.checks, ("base_diameter", "bead_size"))
    return quantities + [doubted(one, wrong_size) for one in _lengths(seen, heap, grain, flaw or seen.unsure_base)]


def _definition_uncertainty(
    heap: repose_angles.Heap,
    grainy: Mapping[str, tuple[float, float]],
    angles: Mapping[tuple[str, str, str], float],
    name: str,
    method: str,
    side: str,
) -> dict[str, float]:
    """Standard uncertainties from the grains and from the definition of the angle [deg]."""
    if name == GRAPHICAL:
        if side != "mean":
            return dict(zip(("grain roughness", "window of the line"), grainy[side], strict=True))
        rough, window = (math.hypot(*both) / 2 for both in zip(*grainy.values(), strict=True))
        return {
            "grain roughness": rough,
            "window of the line": window,
        }
    reach = heap.base_width / 2 if side == "mean" else abs(heap.apex[0] - heap.feet[repose_angles.SIDES.index(side)])
    tangent = math.tan(math.radians(angles[name, method, side]))
    # the foot is uncertain by a quarter of a grain
    per_grain = math.hypot(_summit_scatter(tangent), 0.0 if side == "mean" else 0.25 * tangent) * heap.grain / reach
    uncertainties = {"grain at apex and foot": math.degrees(per_grain / (1 + tangent * tangent))}
    if side != "mean":
        uncertainties["place of the apex"] = math.degrees(tangent / (1 + tangent * tangent) * heap.apex_spread / reach)
    return uncertainties


def _summit_scatter(tangent: float) -> float:
    """Standard deviation, in grain diameters, of the depth of the highest grain below the tip of a cone.

    With n grains per cubed diameter placed at random, n pi h^3 / (3 tan^2) grains lie within depth h of the tip on
    average.  The depth of the first one therefore has a Weibull distribution with exponent 3.
    """
    depth: float = (3 * tangent**2 / (math.pi * GRAINS_PER_CUBE)) ** (1 / 3)
    return depth * math.sqrt(math.gamma(5 / 3) - math.gamma(4 / 3) ** 2)


def _too_short(heap: repose_angles.Heap, sides: Sequence[str]) -> str:
    """Which flanks have no line, so that their graphical angles and the mean are missing, or ""."""
    missing = [side for side in sides if repose_angles.flank_line(heap, side) is None]
    if not missing:
        return ""
    return f"the {' and the '.join(missing)} flank {'is' if len(missing) == 1 else 'are'} too short to fit a line"


def _flaw_of_profile(heap: repose_angles.Heap, sides: Sequence[str]) -> str:
    if short := _too_short(heap, sides):
        return short
    for side in sides:
        line = repose_angles.flank_line(heap, side)
        if line is not None and line.angle > repose_angles.STEEPEST_FLANK:
            return (
                f"the {side} flank has {line.angle:.0f} deg, steeper than a loose heap: something hides or adds to it"
            )
        if line is not None and abs(line.outer - line.inner) < 3 * heap.grain:
            return f"the {side} flank is only {abs(line.outer - line.inner) / heap.grain:.1f} grains long"
        if repose_angles.monotony(heap, side) < 0.6:
            return f"the {side} flank does not fall steadily"
    return ""


def _lengths(seen: Observation, heap: repose_angles.Heap, grain: float | None, flaw: str) -> list[Quantity]:
    def length(name: str, value: float, method: str, share: float) -> Quantity:
        budget = {"grain at apex and foot": 0.25 * heap.grain} if share else {"grain roughness": 0.3 * value}
        scales = [repose_angles.find_parts(profile, None, grain) for pair in seen.variants.values() for profile in pair]
        if seen.scale_uncertainty:
            budget["scale"] = seen.scale_uncertainty * value
        if name == "pile_height" and scales:
            budget["outline and base line"] = float(np.std([part.apex[1] for part in scales if part is not None]))
        if flaw:
            budget["unreliable outline"] = heap.grain
        return Quantity(name, value, root_sum_of_squares(budget), "m", method, 1, {}, budget, flaw)

    lengths = [
        length("pile_height", heap.apex[1], "95 % of the top grain band", 1.0),
        length("pile_base_width", heap.feet[1] - heap.feet[0], "outermost outline points", 1.0),
    ]
    radius = repose_angles.tip_radius(heap)
    if radius is not None:
        lengths.append(length("pile_tip_radius", radius, "parabola through the tip", 0.0))
    return lengths


def _base_limited(profile: Profile, heap: repose_angles.Heap, base_diameter: float | None) -> bool:
    """Whether the heap reaches the rim on both sides, so that the dish limits its width."""
    if profile.base is not None:
        gaps = (heap.feet[0] - profile.base[0], profile.base[1] - heap.feet[1])
        return max(gaps) < heap.grain
    return base_diameter is not None and heap.feet[1] - heap.feet[0] > base_diameter - 2 * heap.grain


def _base_flaw(heap: repose_angles.Heap, *, limited: bool) -> str:
    """Reason why the geometric angle over a base is doubtful, or "".

    The heap is wider than the base, or it is narrower and not `limited` by its rim.
    """
    across = heap.feet[1] - heap.feet[0]
    if across - heap.base_width > OVERHANG * heap.grain:
        return (
            f"the heap is {across / heap.base_width:.2f} times as wide as its base, more than beads can overhang: "
            "an end of the base line or the base's diameter is wrong"
        )
    if limited or across > COVERED_BASE * heap.base_width:
        return ""
    share = f"{100 * across / heap.base_width:.0f} %"
    return (
        f"the heap covers {share} of the stated base, so its geometric angle is too small; "
        "pour until it reaches the rim, or correct the base if it does"
    )


def _over_views(quantities: Sequence[Quantity]) -> list[Quantity]:
    """Means over all views, for graphical angles over views and sides; their scatter gives the uncertainty."""
    groups: dict[tuple[str, str], list[Quantity]] = {}
    for one in quantities:
        per_side = any(
            other.detail.get("side") == "left" and (other.quantity, other.method) == (one.quantity, one.method)
            for other in quantities
        )
        if not (per_side and one.detail.get("side") == "mean" and one.quantity == GRAPHICAL) and (
            one.quantity != GEOMETRIC or one.detail.get("side") == "mean"
        ):
            groups.setdefault((one.quantity, one.method), []).append(one)
    return [_combined(name, method, ones) for (name, method), ones in groups.items()]


def _combined(name: str, method: str, ones: Sequence[Quantity]) -> Quantity:
    """Mean of the values that are not doubtful; if all are, the doubtful mean of all."""
    ones = [one for one in ones if not one.doubtful] or ones
    values = np.array([one.value for one in ones])
    alone = len(ones) == 1
    # the roughness of a side is in the scatter; all views show the same top grain: its part stays
    independent = "" if alone else "grain roughness"
    parts = sorted({part for one in ones for part in one.budget if part != independent})
    budget = {part: float(np.mean([one.budget.get(part, 0.0) for one in ones])) for part in parts}
    deviation = 0.0 if alone else float(values.std(ddof=1))
    if not alone:
        budget["scatter of views and sides"] = deviation / math.sqrt(len(values))
    detail: dict[str, str | int | float | bool] = {"side": "mean"} if ones[0].unit == "deg" else {}
    detail["view"] = "all"
    if not alone:
        detail["standard_deviation"] = deviation
    reasons = "; ".join(sorted({one.doubtful for one in ones if one.doubtful}))
    return Quantity(
        name,
        float(values.mean()),
        root_sum_of_squares(budget),
        ones[0].unit,
        method,
        len(values),
        detail,
        budget,
        reasons,
    )


def _spread(values: Sequence[float], middle: float) -> float:
    """Root mean square difference from `middle` of the values one standard deviation away."""
    return math.sqrt(sum((value - middle) ** 2 for value in values) / len(values))
