"""Checks and warnings of a heap: stated sizes, uneven flanks, washed-out outlines, agreement of views."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from rigtwin.lab.quantity import Check, Quantity
from rigtwin.measure.bulk.checks import MISFIT, size_seen, size_unseen, views_check
from rigtwin.measure.pile import repose_angles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.lab.records import Profile
    from rigtwin.measure.bulk.outline import Silhouette

ADVISED_RATIO = 25  # base over bead diameter (Hlosta et al. 2020, section 2.1.5 advises more)
BASE_UNCERTAINTY = 0.01  # relative standard uncertainty of the base's width in the picture
NEARER = 1.08  # the beads in front, which are the clearest, are nearer to the camera than the axis of the base


def narrow_base(base: float, bead: float) -> list[str]:
    """Warning if the base [m] is few beads [m] wide: heaps on a narrow base differ more from each other."""
    if round(base / bead, 1) >= ADVISED_RATIO:  # rounded as in the message
        return []
    return [
        f"the base is {base / bead:.1f} bead diameters wide; {ADVISED_RATIO} or more are advised: on a smaller base "
        "single beads change the angle, so use the mean of several heaps."
    ]


def uneven_flanks(profile: Profile, heap: repose_angles.Heap) -> str:
    """Warning if the flanks differ by more than grain roughness explains, or ""."""
    left, right = (repose_angles.flank_line(heap, side) for side in repose_angles.SIDES)
    if left is None or right is None:
        return ""
    uncertainty = math.hypot(*(repose_angles.roughness_uncertainty(heap, side) for side in repose_angles.SIDES))
    difference = left.angle - right.angle
    if abs(difference) < 2.5 * uncertainty + 1.0:
        return ""
    return (
        f"left minus right flank ({profile.view}) is {difference:+.1f} deg, grain roughness explains "
        f"{uncertainty:.1f} deg: the heap is uneven, or its base is not level; take more views to average over."
    )


def views_checks(quantities: Sequence[Quantity], line: str) -> list[Check]:
    """Check that the views show one heap, by the angle of the method `line` and by the height.

    The angle of an uneven heap varies between views by half the difference of its flanks, which is added to the
    standard uncertainty.
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
    """Check the apparent bead size against the stated one, or else a warning about the one size that sets the scale."""
    if scale is None:
        return (), ""
    if bead_diameter is None or scale_from == "bead diameter" or not math.isfinite(found.bead_seen):
        if not math.isfinite(found.bead_seen):
            advice = "no round bead shows its size"
        elif bead_diameter is None:
            advice = "give --bead-diameter too"
        elif base_diameter is None:
            advice = "give --base-diameter too, with the whole base in view"
        else:
            advice = "photograph the whole base, so that its stated diameter can be compared"
        return (), size_unseen(
            "heights, widths and the tip's radius (but no angle) depend", f"the scale from {scale_from}", advice
        )
    check = size_seen(2 * found.bead_seen * scale / NEARER, bead_diameter, MISFIT, scale_from)
    if not check.passed and scale_from == "base diameter" and base_diameter is not None:
        by_beads = f"{base_diameter / check.value * 1e3:.3g} mm, {base_diameter * 1e3:.4g} mm are stated"
        check = replace(check, message=f"{check.message[:-1]}; by the stated beads the base is {by_beads}.")
    return (check,), ""


def base_check(seen: float, scale_uncertainty: float, stated: float, scale_from: str) -> Check:
    """Check the apparent width of the base against the stated one [m]; angles need neither."""
    passed = abs(seen / stated - 1) < 3 * math.hypot(scale_uncertainty, BASE_UNCERTAINTY)
    message = (
        f"by the scale from {scale_from} the base is {seen * 1e3:.1f} mm wide, {stated * 1e3:.1f} mm are stated"
        f"{'.' if passed else ': the scale or the stated base is wrong, and so are heights and widths.'}"
    )
    return Check("base_diameter", passed, seen, stated, message)
