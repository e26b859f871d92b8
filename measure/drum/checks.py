"""Checks of a drum's picture: rim, fill, shape of the surface, glare, and whether the whole bed is in view."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rigtwin.lab.drum_flow import fill_check
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.quantity import Check, Quantity
from rigtwin.measure.drum.bed import Bed, circle_of
from rigtwin.measure.drum.evaluate import FREQUENCY, HIGHEST_STEP, MOST_BOW
from rigtwin.measure.geometry.camera_roll import upright_checks

GLARE = 0.05  # share of the surface under a reflection above which lines along parts of it are wrong


def _runs_out(bed: Bed) -> bool:
    """Whether the surface ends at the edge of the picture, within a bead, instead of at the drum's wall."""
    heights = np.array([outline.height for outline in bed.outlines])
    seen = np.flatnonzero(np.isfinite(heights).mean(axis=0) > 0.5)
    if len(seen) < 2:
        return False
    ends = seen[[0, -1]]
    x, height = bed.outlines[0].x[ends], np.nanmedian(heights[:, ends], axis=0)
    cos, sin = math.cos(bed.upright.roll), math.sin(bed.upright.roll)
    places = np.column_stack([x * cos + height * sin, x * sin - height * cos]) + np.array(bed.rim.centre)
    far = np.array(bed.shape[1::-1]) - 1.0 - places
    at_edge = np.minimum(places, far).min(axis=1) < bed.bead
    return bool(np.any(at_edge & (np.hypot(x, height) < 0.9 * bed.rim.radius)))


def _checks_of_shape(bed: Bed) -> list[Check]:
    """Check that the median outline can be the surface of flowing beads."""
    heights = np.array([outline.height for outline in bed.outlines])
    seen = np.flatnonzero(np.isfinite(heights).mean(axis=0) > 0.5)
    if len(seen) < 8:
        return []
    x, height = bed.outlines[0].x[seen], np.nanmedian(heights[:, seen], axis=0)
    length = float(np.ptp(x))
    inner = np.abs(x - (x[0] + x[-1]) / 2) < 0.4 * length
    x, height = x[inner], height[inner]
    if len(x) < 8:
        return []
    bow = abs(float(np.polyfit(x, height, 2)[0])) * length / 4
    apart = max(1, round(bed.bead))
    near = x[apart:] - x[:-apart] < 1.5 * apart  # not across a gap left by something in front of the bed
    step = float(np.abs(height[apart:] - height[:-apart])[near].max(initial=0.0)) / bed.bead
    return [
        Check(
            "surface_shape",
            bow < MOST_BOW,
            bow,
            0.0,
            f"the surface bows by {bow:.2f} of its length"
            + (
                "." if bow < MOST_BOW else ": a flowing bed bows less; the drum itself may have been taken for the bed."
            ),
        ),
        Check(
            "surface_steps",
            step < HIGHEST_STEP,
            step,
            0.0,
            f"from one bead to the next the surface rises by at most {step:.1f} bead diameters"
            + ("." if step < HIGHEST_STEP else ": beads cannot form such a step; something is in front of them."),
        ),
    ]


def _how_found(bed: Bed) -> str:
    edge = f"an edge was found along {100 * bed.rim.support:.0f} % of"
    if bed.rim.seen is not None:
        other = f"{100 * bed.rim.seen.support:.0f} % of {circle_of(bed.rim.seen, bed.lens)}"
        return f"{edge} {circle_of(bed.rim, bed.lens)}, but along {other}: check --circle."
    if bed.rim.stated:
        return f"the drum's circle was stated; {edge} it."
    if bed.rim_seen:
        return f"{edge} the drum's circle."
    return "no edge of the drum's rim was found; its circle was fitted to the lower border of what moves."


def rests_on(one: Quantity, of_picture: Sequence[Check]) -> set[str]:
    """Names of the checks that a quantity depends on: the avalanche frequency is independent of the camera roll."""
    return {each.check for each in of_picture} - ({"camera_roll"} if one.quantity == FREQUENCY else set())


def must_be_a_drum(clip: Path, checks: Sequence[Check]) -> None:
    """Refuse a clip in which neither the rim of a drum nor the surface of a bed was found."""
    wrong = {each.check: each for each in checks if each.passed is False}
    if {"rim_found", "surface_shape"} <= set(wrong):
        raise NothingToMeasure(
            f"{clip}: an edge was found along {100 * wrong['rim_found'].value:.0f} % of the drum's circle only, and "
            f"the upper border of what moves bows by {wrong['surface_shape'].value:.2f} of its length ({MOST_BOW} at "
            "most is that of a flowing bed); film the end of the drum with its whole rim, or state its inner rim with "
            "--circle cx,cy,r."
        )


def checks_of_picture(bed: Bed, still: Check | str) -> list[Check]:
    seen = [outline.area for outline in bed.outlines if not outline.hidden]
    areas = np.array(seen if 2 * len(seen) >= len(bed.outlines) else [outline.area for outline in bed.outlines])
    swing = float(np.std(areas) / max(float(np.mean(areas)), 1.0))
    fill = float(np.median(areas) / (math.pi * bed.rim.radius**2))
    checks = [
        Check(
            "rim_found",
            bed.rim_seen and bed.rim.seen is None,
            bed.rim.support,
            1.0,
            _how_found(bed),
        ),
        fill_check(fill, "the bed fills"),
        *_checks_of_shape(bed),
        *([still] if isinstance(still, Check) else []),
    ]
    whole = not _runs_out(bed)
    ending = "inside the picture." if whole else "at the edge of the picture, so lines fit only a part; film all of it."
    checks.append(Check("bed_in_view", whole, float(whole), 1.0, f"the bed's surface ends {ending}"))
    checks += upright_checks(bed.upright)
    if math.isfinite(bed.glare):
        checks.append(
            Check(
                "even_light",
                bed.glare < GLARE,
                bed.glare,
                0.0,
                f"{100 * bed.glare:.0f} % of the surface is brighter than the rest, as under a reflection"
                + ("." if bed.glare < GLARE else ": a lamp's reflection hides it; turn the lamp or the camera."),
            )
        )
    if bed.shows_motion:
        checks.append(
            Check(
                "same_bed",
                swing < 0.12,
                swing,
                0.0,
                f"the bed's area varies by {100 * swing:.1f} % from frame to frame"
                + ("." if swing < 0.12 else ": something passes in front of it, or bead and drum look alike."),
            )
        )
    return checks
