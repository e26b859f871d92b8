from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

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

FLAWED = 3.0  # [deg], added to the doubt of an angle whose outline cannot be relied on

GRAINS_PER_CUBE = 0.6 * 6 / math.pi  # of a grain's diameter, at the solid fraction of a loose bed

STEEPEST_FLANK = 60.0  # [deg]; what sticks together may stand steeper, but is no heap of beads

COVERED_BASE = 0.9  # share of a stated base that a heap must cover, below which the base is not its own


@dataclass(frozen=True)
class Observation:
    """One photo's profile, and the same profile under other readings of the photo, one standard deviation away."""

    profile: Profile
    variants: Mapping[str, tuple[Profile, Profile]] = field(default_factory=dict)
    flaw: str = ""  # why the outline is not to be relied on
    grain: float | None = None  # bead diameter, in the unit of the profile
    checks: tuple[Check, ...] = ()  # of the photo
    scale_doubt: float = 0.0  # relative
    unconfirmed: str = ""  # the stated size on which lengths hang and which nothing in the picture checks
    notes: tuple[str, ...] = ()  # what is odd about the photo's file


def evaluate(
    profiles: Sequence[Profile], *, base_diameter: float | None = None, bead_diameter: float | None = None
) -> Evaluation:
    """Angles, height and width of a heap from its profiles (several views of one heap), filmed or simulated.

    A simulated heap's profile is the silhouette of its spheres, not the line through their centres.  Raises
    `NothingToMeasure` when a profile holds no heap.
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
        grain = bead_diameter or seen.grain
        heap = repose_angles.find_parts(seen.profile, base_diameter, grain)
        if heap is None:
            raise NothingToMeasure(
                f"profile {number + 1} ({seen.profile.view}) holds no heap above its base line; "
                "of a table check that height_m is measured upwards from the base."
            )
        found = _quantities_of_view(seen, heap, base_diameter, grain)
        if len(observations) > 1:
            found = [replace(one, detail={**one.detail, "view": seen.profile.view}) for one in found]
        quantities += found
        doubts = sorted({one.doubtful for one in found if one.doubtful})
        doubtful.append(any(one.doubtful for one in found if one.quantity == GRAPHICAL))
        warnings += seen.notes
        whose = f"{seen.profile.view}: " if len(observations) > 1 else ""
        warnings += [whose + doubt for doubt in doubts]
        if seen.unconfirmed and seen.unconfirmed not in warnings:
            warnings.append(seen.unconfirmed)
        uneven = uneven_flanks(seen.profile, heap)
        warnings += [uneven] if uneven else []
        checks += seen.checks
    if len(observations) > 1:
        agree = views_checks(quantities, LINE)
        checks += agree
        odd = [check.message for check in agree if not check.passed]
        if any(doubtful) and not all(doubtful):
            left_out = ", ".join(seen.profile.view for seen, bad in zip(observations, doubtful, strict=True) if bad)
            warnings.append(f"left out of the mean over views, because doubtful: {left_out}.")
            if doubtful.count(False) == 1:
                odd.append(f"one view alone is sound, and none confirms it; left out: {left_out}")
        # a mean over views has the scatter of its sides in its budget
        quantities = [*(doubted(one, "; ".join(odd)) for one in _over_views(quantities)), *quantities]
    if base_diameter is not None and bead_diameter is not None:
        warnings += narrow_base(base_diameter, bead_diameter)
    return Evaluation(tuple(quantities), tuple(checks), tuple(warnings))


def _angles(profile: Profile, base_diameter: float | None, grain: float | None) -> dict[tuple[str, str, str], float]:
    """Every angle [deg] of a profile by (quantity, method, side)."""
    heap = repose_angles.find_parts(profile, base_diameter, grain)
    if heap is None:
        return {}
    angles = {}
    for method, window in ((LINE, repose_angles.WINDOW), (NARROWER, (0.2, 0.8))):
        lines = {side: repose_angles.flank_line(heap, side, window) for side in repose_angles.SIDES}
        sides = {side: line.angle for side, line in lines.items() if line is not None}
        if len(sides) == 2:
            sides["mean"] = (sides["left"] + sides["right"]) / 2
        angles.update({(GRAPHICAL, method, side): angle for side, angle in sides.items()})
    for side in repose_angles.SIDES:
        angles[GEOMETRIC, "apex", side] = repose_angles.apex_angle(heap, side)
        steepest = repose_angles.steepest_third(heap, side)
        if steepest is not None:
            angles[GRAPHICAL, "steepest third", side] = steepest
    angles[GEOMETRIC, "apex", "mean"] = repose_angles.apex_angle(heap)
    angles[GEOMETRIC, "equal area", "mean"] = repose_angles.equal_area_angle(heap)
    return angles


def _quantities_of_view(
    seen: Observation, heap: repose_angles.Heap, base_diameter: float | None, grain: float | None
) -> list[Quantity]:
    angles = _angles(seen.profile, base_diameter, grain)
    varied = {
        name: [_angles(profile, base_diameter, grain) for profile in pair] for name, pair in seen.variants.items()
    }
    flaw = seen.flaw or _flaw_of_profile(heap, angles)
    limited = _base_limited(seen.profile, heap, base_diameter)
    bare = "" if limited else _bare_base(heap)
    grainy = {
        side: (repose_angles.roughness_doubt(heap, side), repose_angles.window_doubt(heap, side))
        for side in repose_angles.SIDES
    }
    quantities = []
    for (name, method, side), angle in angles.items():
        budget = {
            part: _spread([other.get((name, method, side), angle) for other in pair], angle)
            for part, pair in varied.items()
        }
        budget |= _definition_doubt(heap, grainy, angles, name, method, side)
        if name == GEOMETRIC and side == "mean" and base_diameter is not None and seen.profile.base is None:
            # a measured height, or area, over a stated base or its square
            slant = math.sin(2 * math.radians(angle)) * (0.5 if method == "apex" else 1.0)
            budget["scale"] = math.degrees(slant * seen.scale_doubt)
        if flaw:
            budget["unreliable outline"] = FLAWED
        budget = {part: value for part, value in budget.items() if math.isfinite(value) and value > 0}
        detail: dict[str, str | int | float | bool] = {"side": side}
        if side == "mean" and name == GRAPHICAL:
            # how far this heap is from even, not how well its mean is known: repeats of the heap tell that
            detail["left_minus_right_deg"] = round(angles[name, method, "left"] - angles[name, method, "right"], 4)
        if name == GEOMETRIC:
            detail["base_limited"] = limited
        one = Quantity(name, angle, root_sum_of_squares(budget), "deg", method, 1, detail, budget, flaw)
        quantities.append(doubted(one, bare if name == GEOMETRIC and side == "mean" else ""))
    order = [(GRAPHICAL, LINE), (GEOMETRIC, "apex"), (GEOMETRIC, "equal area"), (GRAPHICAL, NARROWER)]
    place = {key: rank for rank, key in enumerate(order)}
    quantities.sort(key=lambda one: place.get((one.quantity, one.method), len(order)))
    leaning = failed(seen.checks, ("camera_roll",))  # what one side gains by a base that leans, the other loses
    quantities = [doubted(one, leaning if one.detail["side"] != "mean" else "") for one in quantities]
    wrong_size = failed(seen.checks, ("base_diameter",))
    return quantities + [doubted(one, wrong_size) for one in _lengths(seen, heap, grain, flaw)]


def _definition_doubt(
    heap: repose_angles.Heap,
    grainy: Mapping[str, tuple[float, float]],
    angles: Mapping[tuple[str, str, str], float],
    name: str,
    method: str,
    side: str,
) -> dict[str, float]:
    """What the grains and the definition itself leave open [deg]."""
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
    # which grain is the foot: a quarter
    per_grain = math.hypot(_summit_scatter(tangent), 0.0 if side == "mean" else 0.25 * tangent) * heap.grain / reach
    doubt = {"grain at apex and foot": math.degrees(per_grain / (1 + tangent * tangent))}
    if side != "mean":
        doubt["place of the apex"] = math.degrees(tangent / (1 + tangent * tangent) * heap.apex_spread / reach)
    return doubt


def _summit_scatter(tangent: float) -> float:
    """Standard deviation, in grains, of how far the highest grain of a cone of this slope lies below its tip.

    Of grains laid at random, n to a grain's cube, n pi h^3 / (3 tan^2) lie within h of the tip on average, so that the
    depth of the first one is Weibull's with the exponent 3.
    """
    depth: float = (3 * tangent**2 / (math.pi * GRAINS_PER_CUBE)) ** (1 / 3)
    return depth * math.sqrt(math.gamma(5 / 3) - math.gamma(4 / 3) ** 2)


def _flaw_of_profile(heap: repose_angles.Heap, angles: Mapping[tuple[str, str, str], float]) -> str:
    missing = [side for side in repose_angles.SIDES if (GRAPHICAL, LINE, side) not in angles]
    if missing:
        return f"the {missing[0]} flank is too short for a line"
    for side in repose_angles.SIDES:
        line = repose_angles.flank_line(heap, side)
        if line is not None and line.angle > STEEPEST_FLANK:
            return (
                f"the {side} flank stands at {line.angle:.0f} deg, as no loose heap does: something hides or adds to it"
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
        if seen.scale_doubt:
            budget["scale"] = seen.scale_doubt * value
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
    """Whether the heap reaches the rim on both sides, so that its width is the dish's and not its own."""
    if profile.base is not None:
        gaps = (heap.feet[0] - profile.base[0], profile.base[1] - heap.feet[1])
        return max(gaps) < heap.grain
    return base_diameter is not None and heap.feet[1] - heap.feet[0] > base_diameter - 2 * heap.grain


def _bare_base(heap: repose_angles.Heap) -> str:
    """What speaks against an angle over a base that the heap does not cover; nothing where that is its own width."""
    share = (heap.feet[1] - heap.feet[0]) / heap.base_width
    if share > COVERED_BASE:
        return ""
    return (
        f"the heap covers {100 * share:.0f} % of the stated base, over which its geometric angle comes out too small; "
        "pour more, or leave --base-diameter out"
    )


def _over_views(quantities: Sequence[Quantity]) -> list[Quantity]:
    """Mean over all views, of an angle over views and sides; the scatter is what repeats give."""
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
    """Mean of the sound ones; of all, doubtful, where none is sound."""
    ones = [one for one in ones if not one.doubtful] or ones
    values = np.array([one.value for one in ones])
    alone = len(ones) == 1
    # a side's roughness is in the scatter; the top grain is one and the same in every view, so its doubt stays
    independent = () if alone else ("grain roughness",)
    parts = sorted({part for one in ones for part in one.budget if part not in independent})
    budget = {part: float(np.mean([one.budget.get(part, 0.0) for one in ones])) for part in parts}
    deviation = 0.0 if alone else float(values.std(ddof=1))
    if not alone:
        budget["scatter of views and sides"] = deviation / math.sqrt(len(values))
    detail: dict[str, str | int | float | bool] = {"side": "mean"} if ones[0].unit == "deg" else {}
    detail["view"] = "all"
    if not alone:
        detail["standard_deviation"] = deviation
    doubts = "; ".join(sorted({one.doubtful for one in ones if one.doubtful}))
    return Quantity(
        name,
        float(values.mean()),
        root_sum_of_squares(budget),
        ones[0].unit,
        method,
        len(values),
        detail,
        budget,
        doubts,
    )


def _spread(values: Sequence[float], middle: float) -> float:
    """Root mean square of the changes that the readings one standard deviation away bring."""
    return math.sqrt(sum((value - middle) ** 2 for value in values) / len(values))
