"""Checks of a packing measurement: outline, stated sizes, scale, and whether the bulk density is possible."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigtwin.lab.quantity import (
    Check,
    Quantity,
)
from rigtwin.measure.bulk.checks import MISFIT, size_seen, views_check
from rigtwin.measure.packing.bed_profile import (
    LINE_WIDTH,
    NEARER,
    ON_A_LINE,
    OUTLINE_SPREAD,
    PITCH_RANGE,
    ROUGHEST,
    SAME_PLANE,
    SMOOTHEST,
    Observation,
    inside_cylinder,
    on_a_line,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.lab.records import Profile
    from rigtwin.measure.packing.cylinder import Bed


# [standard uncertainties], of a stated floor from the foot of the grains: 2.2 at most in 28 photos by a path tracer
FLOOR_APART = 3.0
WALLS_APART = 0.05  # relative, of stated walls from those that are seen: three of their standard uncertainties

OTHER_PLANE = 0.04  # largest relative error of a given scale: a length in view may stand before or behind the axis

USUAL_FRACTION = 0.6  # solid fraction of a bed, between loose (0.55) and close random packing (0.64)

# Solid fraction of equal spheres packed at random: from loose (Onoda & Liniger 1990: 0.555) to close packing
# (Scott & Kilgour 1969: 0.637); only a crystal has more, 0.74.
SPHERES = (0.55, 0.64)

# The wall orders the beads next to it and leaves gaps.  They reduce the solid fraction 0.6 of a loose bed by
# 0.010 (exp(10.686 d / D) - 1) (Zou & Yu 1995, for cylinders at least four beads wide).
WALL_GAPS, WALL_DEPTH, NARROWEST = 0.010 / 0.6, 10.686, 4.0

# Solid fractions of other beads: crosses and rods pack loosely; cubes, interlocking clumps and mixed sizes pack
# densely.
ANY_SHAPE = (0.3, 0.8)

SOLID_UNCERTAINTY = (
    0.03  # relative standard uncertainty of a bead's density: from its volume, with a diameter known to 1 %
)

# [kg/m^3], possible densities of a bead's material: from balsa wood to tungsten; what is lighter is foam
SOLID_DENSITIES = (100.0, 19300.0)

SPOILING = ("level_bed", "smooth_surface", "views_agree")  # if one of these checks fails the height is doubtful

# the same for checks of the stated sizes, which set scale, floor and the offsets from the outline
STATED = ("stated_floor", "stated_walls", "gauge", "bead_size", "walls", "straight_walls", "scale", "camera_roll")

MOST_BEYOND = 0.08  # largest share of beads found outside the walls: reflections in the glass look like beads

# Largest relative narrowing of a bed from top to foot.  Perspective from above and near makes a cylinder narrower by
# about 1/20; where the walls really converge by more the density is wrong by as much.
MOST_NARROWING = 0.15

# relative standard uncertainties of a weighed mass and a gauged diameter; those of a simulation are exact
BY_HAND = {"mass": 0.002, "cylinder diameter": 0.003}

ADVISED_RATIO = 5.0  # least cylinder diameter over bead diameter without a visible wall effect


def bed_views_check(seen: Sequence[Observation], heights: Sequence[float], grain: float) -> Check:
    """Check that views of one bed agree; each shows different beads in front, so their offsets are independent."""
    sigmas = [math.hypot(OUTLINE_SPREAD * grain, *each.uncertainties.values()) * 1e3 for each in seen]
    return views_check("mean outline", [height * 1e3 for height in heights], sigmas, "mm")


def material_check(density: float) -> Check:
    """Check that the bulk density [kg/m^3] is possible for a solid material at the usual solid fraction."""
    solid, (low, high) = density / USUAL_FRACTION, SOLID_DENSITIES
    says = f"the bulk density is {density:.4g} kg/m^3, which implies beads of about {roughly(solid)} kg/m^3"
    ending = (
        f", but only foam is lighter than {low:g} (for foam give --bead-density), and no material is heavier than "
        f"{high:.0f}: check --total-mass and --cylinder-diameter."
    )
    passed = low < solid < high
    return Check("bulk_density", passed, solid, math.nan, says + ("." if passed else ending))


def random_packing(ratio: float) -> tuple[float, float]:
    """Loose and close solid fraction of equal spheres; `ratio` is cylinder over bead diameter."""
    loose, close = SPHERES
    gaps = WALL_GAPS * (math.exp(WALL_DEPTH / max(ratio, NARROWEST)) - 1)
    return loose * (1 - gaps), close


def fraction_check(density: Quantity, solid: float, among: tuple[float, float], spheres: bool) -> Check:
    """Check the solid fraction of the bed below its mean surface; `solid` is the density of the beads [kg/m^3]."""
    fraction = density.value / solid
    # the limits are widened so that the 95 % interval may touch the possible range
    slack = 2 * math.hypot(density.std_uncertainty / density.value, SOLID_UNCERTAINTY)
    low, high = among[0] * (1 - slack), among[1] * (1 + slack)
    passed = low < fraction < high
    says = (
        f"the bulk density is {density.value:.4g} kg/m^3: beads of {solid:g} kg/m^3 fill {100 * fraction:.3g} % of it"
    )
    kind = "equal spheres poured at random into such a cylinder" if spheres else "poured beads of any shape"
    wrong = (
        f", but {kind} fill {100 * among[0]:.0f} to {100 * among[1]:.0f} %: --total-mass is too "
        f"{'low' if fraction < low else 'high'} for this bed, or the bead density, --cylinder-diameter or the height "
        "is wrong"
    )
    others = (
        "; for beads of other shapes or of several sizes leave --bead-density out, this range does not apply to them"
    )
    ending = "." if passed else wrong + (others if spheres else "") + "."
    return Check("bulk_density", passed, fraction, USUAL_FRACTION, says + ending)


def roughly(density: float) -> str:
    """Density [kg/m^3] rounded to two digits: the solid fraction is known only roughly."""
    return f"{float(f'{density:.2g}'):g}"


def checks_of(
    seen: Sequence[Observation],
    heights: Sequence[tuple[float, float]],
    cylinder: float | None,
    bead: float | None,
) -> list[Check]:
    checks = []
    if cylinder is not None and bead is not None:
        ratio = cylinder / bead
        ending = "." if ratio > ADVISED_RATIO else ": the wall orders the beads and the bed is looser than a wide one."
        checks.append(
            Check(
                "cylinder_bead_ratio",
                ratio > ADVISED_RATIO,
                ratio,
                ADVISED_RATIO,
                f"the cylinder is {ratio:.1f} bead diameters wide{ending}",
            )
        )
    for each, (mean, rough) in zip(seen, heights, strict=True):
        finite = np.isfinite(each.profile.height)
        lean = float(np.polyfit(each.profile.x[finite], each.profile.height[finite], 1)[0])
        degrees = math.degrees(math.atan(lean))
        passed = abs(degrees) < 6
        ending = "." if passed else ": the bed is not level; level it, or take views from more sides."
        checks.append(
            Check(
                "level_bed",
                passed,
                degrees,
                0.0,
                f"the outline ({each.profile.view}) leans by {degrees:+.1f} deg and has an rms roughness of "
                f"{rough * 1e3:.2f} mm about its mean of {mean * 1e3:.1f} mm{ending}",
            )
        )
        if bead is not None:  # without it the bead size is estimated from the roughness, which would be circular
            checks.append(_surface_check(each.profile, rough / bead, cylinder, bead))
    return checks


def _surface_check(profile: Profile, rough: float, cylinder: float | None, bead: float) -> Check:
    """Check that the outline is that of beads: roughness (in bead diameters) and share on one straight line."""
    straight = on_a_line(*inside_cylinder(profile, cylinder), LINE_WIDTH * bead)
    odd = "smooth" if rough < SMOOTHEST else "rough" if rough > ROUGHEST else "straight" if straight > ON_A_LINE else ""
    ending = f": a settled bed is never so {odd}; is something in front of it?" if odd else "."
    message = (
        f"the outline ({profile.view}) has a roughness of {rough:.2f} bead diameters, {100 * straight:.0f} % of it lie "
        f"on one straight line{ending}"
    )
    return Check("smooth_surface", not odd, rough, 0.25, message)


def gauge_pitch(bed: Bed) -> float:
    """Scale [m/px] of the gauge at half the height of the bed."""
    assert bed.gauge is not None
    return bed.gauge.pitch(bed.floor - float(np.mean(bed.outline[1])) / 2)


def picture_checks(bed: Bed, scale: float, source: str, cylinder: float | None, bead: float | None) -> list[Check]:
    checks = []
    same = False
    if bed.gauge is None and math.isfinite(bed.elsewhere):
        near = abs(math.log(bed.elsewhere)) <= math.log(PITCH_RANGE)  # it can be no further before or behind the axis
        ending = (
            "the gauge stands before or behind the axis, or the photo is squeezed to other proportions; the gauge was "
            "not used, neither for the floor."
            if near
            else "check --cylinder-diameter and --bead-diameter."
        )
        message = (
            f"the gauge's scale is {bed.elsewhere:.3f} times the cylinder's, and the size of the beads agrees with the "
            f"cylinder: {ending}"
        )
        checks.append(Check("gauge", near, bed.elsewhere, 1.0, message))
    elif bed.gauge is None:
        checks.append(
            Check(
                "gauge",
                True,
                0.0,
                1.0,
                "no graduations of a length gauge were found; scale and floor come from the cylinder and its beads.",
            )
        )
    elif cylinder is not None:
        ratio = gauge_pitch(bed) / (cylinder / bed.width)
        same = abs(ratio - 1) < SAME_PLANE
        ending = (
            ", so both stand in the plane of the axis."
            if same
            else ": check --cylinder-diameter."
            if abs(math.log(ratio)) > math.log(PITCH_RANGE)
            else ": the gauge stands before or behind the axis and was not used, or --cylinder-diameter is wrong."
        )
        checks.append(
            Check("gauge", same, ratio, 1.0, f"the gauge's millimetre is {ratio:.3f} times the cylinder's{ending}")
        )
    known = gauge_pitch(bed) if bed.gauge is not None else None if cylinder is None else cylinder / bed.width
    if known is not None and source not in ("gauge", "cylinder diameter"):
        ratio = scale / known
        passed = abs(ratio - 1) < OTHER_PLANE
        by, other = "--cylinder-diameter", "--cylinder-diameter"
        if bed.gauge is not None:
            by, other = "the gauge", "that the gauge stands beside the axis, neither before nor behind it"
        ending = "." if passed else f": check the scale (from {source}), and {other}."
        checks.append(Check("scale", passed, ratio, 1.0, f"the scale is {ratio:.3f} times that by {by}{ending}"))
    if bead is not None and source != "bead diameter" and math.isfinite(bed.bead_seen):
        checks.append(size_seen(2 * bed.bead_seen * scale / NEARER, bead, MISFIT, source))
    within = same or bed.beyond < MOST_BEYOND
    known = bed.stated.walls is not None
    ending = (
        "." if within else f": check {'--cylinder' if known else 'the walls in the overlay; --cylinder states them'}."
    )
    ending = "; the gauge confirms the distance of the walls." if same else ending
    walls = f"the cylinder's walls as {'stated' if known else 'found'}"
    message = f"{100 * bed.beyond:.0f} % of the beads lie outside {walls}{ending}"
    if math.isfinite(bed.bead_seen):
        checks.append(Check("walls", within, bed.beyond, 0.0, message))
    if bed.stated.walls is not None:
        ratio = bed.seen_width / bed.width
        alike = ratio - 1 < WALLS_APART  # a wall may be hidden, so that less is seen
        message = f"the walls that are seen are {ratio:.2f} times as far apart as the stated ones"
        ending = "." if alike else ": check --cylinder."
        checks.append(Check("stated_walls", alike, ratio, 1.0, message + ending))
    if bed.stated.walls is not None or bed.stated.floor is not None:
        apart, way = abs(bed.floor_apart), "below" if bed.floor_apart > 0 else "above"
        message = f"the stated floor lies {apart:.1f} standard uncertainties {way} the foot of the grains that are seen"
        ending = "." if apart < FLOOR_APART else f": check {bed.stated.options}."
        checks.append(Check("stated_floor", apart < FLOOR_APART, bed.floor_apart, 0.0, message + ending))
    slants = abs(bed.narrowing) > MOST_NARROWING
    message = f"the bed is {100 * abs(bed.narrowing):.0f} % {'narrower' if bed.narrowing > 0 else 'wider'} at its foot"
    ending = ", on both sides: this is no cylinder, so its scale and density are not valid." if slants else "."
    checks.append(Check("straight_walls", not slants, bed.narrowing, 0.0, message + ending))
    checks.append(
        Check(
            "outline",
            not bed.flaw,
            bed.contrast,
            1.0,
            bed.flaw or f"the contrast of the outline is {bed.contrast:.2f} of the clearest edge in the picture.",
        )
    )
    return checks
