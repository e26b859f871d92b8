"""What can be said of the photos of a heap: sizes that do not fit, an uneven heap, views of different heaps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rigtwin.lab.quantity import Check, Quantity
from rigtwin.measure.bulk.checks import MISFIT, size_seen, size_unseen, views_check
from rigtwin.measure.pile import repose_angles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.lab.records import Profile
    from rigtwin.measure.bulk.outline import Silhouette

ADVISED_RATIO = 25  # base over bead diameter (Hlosta et al. 2020, section 2.1.5 advises more)
BASE_DOUBT = 0.01  # relative, of the base's edges in the picture
NEARER = 1.08  # the beads in front, clearest of all, are nearer to the camera than the base's axis


def narrow_base(base: float, bead: float) -> list[str]:
    """Advice on a base [m] of too few beads [m]: the heap on it is measured, but another one differs from it more."""
    if round(base / bead, 1) >= ADVISED_RATIO:  # as precise as it is told
        return []
    return [
        f"the base is {base / bead:.1f} bead diameters wide; {ADVISED_RATIO} or more are advised: on a smaller one "
        "single beads set the angle, and only the mean of several heaps tells it."
    ]


def uneven_flanks(profile: Profile, heap: repose_angles.Heap) -> str:
    """What is told of a heap whose flanks differ by more than their grains explain, which heaps may; else nothing."""
    left, right = (repose_angles.flank_line(heap, side) for side in repose_angles.SIDES)
    if left is None or right is None:
        return ""
    doubt = math.hypot(*(repose_angles.roughness_doubt(heap, side) for side in repose_angles.SIDES))
    difference = left.angle - right.angle
    if abs(difference) < 2.5 * doubt + 1.0:
        return ""
    return (
        f"left minus right flank ({profile.view}) is {difference:+.1f} deg, its grains explain about {doubt:.1f} deg: "
        "the heap is uneven, or its base not level; more views tell its mean better."
    )


def views_checks(quantities: Sequence[Quantity], line: str) -> list[Check]:
    """Whether the views show one heap, by the angle of the method `line` and by the height.

    An uneven heap's angle differs from view to view by what its sides do; a doubtful view's doubt is wide already.
    """
    checks = []
    for name, method, unit, per in (("angle_of_repose_graphical", line, "deg", 1.0), ("pile_height", "", "mm", 1e3)):
        ones = [
            one
            for one in quantities
            if one.quantity == name
            and (one.method == method or not method)
            and one.detail.get("side", "mean") == "mean"
        ]
        if len(ones) > 1:
            uneven = [float(one.detail.get("left_minus_right_deg", 0.0)) / 2 for one in ones]
            sigmas = [math.hypot(per * one.std_uncertainty, off) for one, off in zip(ones, uneven, strict=True)]
            checks.append(views_check(name.replace("_", " "), [per * one.value for one in ones], sigmas, unit))
    return checks


def size_checks(
    found: Silhouette, scale: float | None, scale_from: str, bead_diameter: float | None, base_diameter: float | None
) -> tuple[tuple[Check, ...], str]:
    """Whether beads look as large as stated; the base is looked for by its size in beads, so angles hang on it, too.

    And in words what hangs on a single size, the other one not stated or not seen.
    """
    if scale is None:
        return (), ""
    if bead_diameter is None or scale_from == "bead diameter":
        if bead_diameter is None:
            advice = "give --bead-diameter too"
        elif base_diameter is None:
            advice = "give --base-diameter too, with the whole base in view"
        else:
            advice = "photograph the whole base, by whose stated diameter it could be checked"
        return (), size_unseen(
            "heights, widths and the tip's radius (but no angle) hang", f"the scale from {scale_from}", advice
        )
    ratio = 2 * found.bead_seen * scale / (NEARER * bead_diameter)
    return (size_seen(ratio, MISFIT, scale_from),), ""


def sizes_against_base(free: Silhouette | None, stated: float) -> str:
    """Why no base `stated` beads wide was found, by the silhouette `free` that is found when none is stated."""
    if free is None or free.disc is None:
        return ""
    seen = free.view.radius / free.bead_seen * NEARER
    if abs(seen / stated - 1) < MISFIT:
        return ""
    return (
        f"the base in the picture is {seen:.1f} beads wide as they look, the stated sizes make it {stated:.1f}, and so "
        "wide a base was not found: check --bead-diameter and --base-diameter"
    )


def base_check(seen: float, scale_doubt: float, stated: float, scale_from: str) -> Check:
    """Whether the base looks as wide as stated [m], where the scale is not from it; angles need neither."""
    passed = abs(seen / stated - 1) < 3 * math.hypot(scale_doubt, BASE_DOUBT)
    message = (
        f"by the scale from {scale_from} the base is {seen * 1e3:.1f} mm wide, {stated * 1e3:.1f} mm are stated"
        f"{'.' if passed else ': the scale or the stated base is wrong, and heights and widths with it.'}"
    )
    return Check("base_diameter", passed, seen, stated, message)
