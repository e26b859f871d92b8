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
    ON_A_LINE,
    OUTLINE_SPREAD,
    ROUGHEST,
    SMOOTHEST,
    Observation,
    inside_cylinder,
    on_a_line,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rigtwin.lab.records import Profile
    from rigtwin.measure.packing.cylinder import Bed

SAME_PLANE = 0.02  # how far the two may differ when the gauge stands in the plane of the axis

OTHER_PLANE = 0.04  # how far a given scale may be off what the picture tells: lengths in view stand near the axis

USUAL_FRACTION = 0.6  # of a bed's volume that is beads: between loose (0.55) and close random packing (0.64)

# Share of a bed's volume that equal spheres fill at random: from loose (Onoda & Liniger 1990: 0.555) to close packing
# (Scott & Kilgour 1969: 0.637); only a crystal has more, 0.74.
SPHERES = (0.55, 0.64)

# The wall orders the beads next to it and leaves gaps: of a loose bed's 0.6 that takes 0.010 (exp(10.686 d / D) - 1)
# (Zou & Yu 1995, for cylinders of four beads' width and more).
WALL_GAPS, WALL_DEPTH, NARROWEST = 0.010 / 0.6, 10.686, 4.0

# Likewise of other beads: crosses and rods are loose, cubes, clumps that fit into each other, and several sizes dense.
ANY_SHAPE = (0.3, 0.8)

SOLID_DOUBT = 0.03  # relative, of a bead's density: of its volume, by a diameter gauged to 1 %

# [kg/m^3], of a bead's material where it is not stated: all between balsa wood and tungsten; what is lighter is foam
SOLID_DENSITIES = (100.0, 19300.0)

SPOILING = ("level_bed", "smooth_surface", "views_agree")  # checks without which a height is doubtful

# likewise, of what the picture says of the stated sizes, on which scale, floor, or what is taken off the outline hang
STATED = ("gauge", "bead_size", "walls", "straight_walls", "scale", "camera_roll")

NEARER = 1.05  # the beads in front are nearer to the camera than the axis by a fifteenth or so, those beside them less

MOST_BEYOND = 0.08  # share of the beads seen that may lie outside of the walls: reflections in the glass

# share by which a bed may be narrower at its foot than at its top: a cylinder seen from above and near looks so by a
# twentieth; where the walls close in by more the density is off by as much
MOST_NARROWING = 0.15

# relative standard uncertainties of what a person has weighed and gauged; a twin's mass and cylinder are exact
BY_HAND = {"mass": 0.002, "cylinder diameter": 0.003}

ADVISED_RATIO = 5.0  # cylinder over bead diameter


def bed_views_check(seen: Sequence[Observation], heights: Sequence[float], grain: float) -> Check:
    """Views of one bed see other beads in front, and are read each for itself."""
    sigmas = [math.hypot(OUTLINE_SPREAD * grain, *each.doubts.values()) * 1e3 for each in seen]
    return views_check("mean outline", [height * 1e3 for height in heights], sigmas, "mm")


def material_check(density: float) -> Check:
    """Whether beads of any solid can lie as dense as that [kg/m^3]."""
    solid, (low, high) = density / USUAL_FRACTION, SOLID_DENSITIES
    says = f"the bulk has {density:.4g} kg/m^3, as of beads of about {roughly(solid)} kg/m^3"
    ending = (
        f", but only foam is lighter than {low:g} (of such beads give --bead-density), and nothing heavier than "
        f"{high:.0f}: check --total-mass, and --cylinder-diameter."
    )
    passed = low < solid < high
    return Check("bulk_density", passed, solid, math.nan, says + ("." if passed else ending))


def random_packing(ratio: float) -> tuple[float, float]:
    """Shares that equal spheres may fill of a cylinder `ratio` times as wide as they are: loose, and close."""
    loose, close = SPHERES
    gaps = WALL_GAPS * (math.exp(WALL_DEPTH / max(ratio, NARROWEST)) - 1)
    return loose * (1 - gaps), close


def fraction_check(density: Quantity, solid: float, among: tuple[float, float], spheres: bool) -> Check:
    """Whether beads of that density [kg/m^3] can fill so much of the bed, its pits left out."""
    fraction = density.value / solid
    # the interval of 95 % is to reach what beads fill
    slack = 2 * math.hypot(density.std_uncertainty / density.value, SOLID_DOUBT)
    low, high = among[0] * (1 - slack), among[1] * (1 + slack)
    passed = low < fraction < high
    says = f"the bulk has {density.value:.4g} kg/m^3, beads of {solid:g} kg/m^3 fill {100 * fraction:.3g} % of it"
    kind = "equal spheres poured at random into such a cylinder" if spheres else "poured beads of whatever shape"
    wrong = (
        f", but {kind} fill {100 * among[0]:.0f} to {100 * among[1]:.0f} %: --total-mass is too "
        f"{'low' if fraction < low else 'high'} for this bed, or the bead's density, --cylinder-diameter or the height "
        "of the bed is wrong"
    )
    others = "; of beads of other shapes or of several sizes, which this does not hold for, leave --bead-density out"
    ending = "." if passed else wrong + (others if spheres else "") + "."
    return Check("bulk_density", passed, fraction, USUAL_FRACTION, says + ending)


def roughly(density: float) -> str:
    """Two digits of a density [kg/m^3], for a bed may be looser or denser than is usual."""
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
        ending = "." if ratio > ADVISED_RATIO else ": the wall orders the beads and the bed is looser than in bulk."
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
        ending = "." if passed else ": the bed lies askew; level it, or take views from more sides."
        checks.append(
            Check(
                "level_bed",
                passed,
                degrees,
                0.0,
                f"the outline ({each.profile.view}) leans by {degrees:+.1f} deg and is {rough * 1e3:.2f} mm rough "
                f"about its mean of {mean * 1e3:.1f} mm{ending}",
            )
        )
        if bead is not None:  # else the outline's roughness is all that tells the bead's size
            checks.append(_surface_check(each.profile, rough / bead, cylinder, bead))
    return checks


def _surface_check(profile: Profile, rough: float, cylinder: float | None, bead: float) -> Check:
    """Whether the outline is that of beads, `rough` [bead diameters] and nowhere drawn with a ruler."""
    straight = on_a_line(*inside_cylinder(profile, cylinder), LINE_WIDTH * bead)
    odd = "smooth" if rough < SMOOTHEST else "rough" if rough > ROUGHEST else "straight" if straight > ON_A_LINE else ""
    ending = f": no settled bed is so {odd}; is something in front of it?" if odd else "."
    message = (
        f"the outline ({profile.view}) is rough by {rough:.2f} bead diameters, {100 * straight:.0f} % of it lie on one "
        f"straight line{ending}"
    )
    return Check("smooth_surface", not odd, rough, 0.25, message)


def gauge_pitch(bed: Bed) -> float:
    """[m/px] of the gauge in the middle of the bed's height."""
    assert bed.gauge is not None
    return bed.gauge.pitch(bed.floor - float(np.mean(bed.outline[1])) / 2)


def picture_checks(bed: Bed, scale: float, source: str, cylinder: float | None, bead: float | None) -> list[Check]:
    checks = []
    same = False
    if bed.gauge is None:
        checks.append(
            Check(
                "gauge",
                True,
                0.0,
                1.0,
                "no graduations of a length gauge were made out; scale and floor come from the cylinder and its beads.",
            )
        )
    elif cylinder is not None:
        ratio = gauge_pitch(bed) / (cylinder / bed.width)
        same = abs(ratio - 1) < SAME_PLANE
        ending = (
            ", as in the plane of the axis."
            if same
            else ": it stands before or behind the axis and was not used, or --cylinder-diameter is wrong."
        )
        checks.append(
            Check("gauge", same, ratio, 1.0, f"the gauge's millimetre is {ratio:.3f} of the cylinder's{ending}")
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
    if bead is not None and source != "bead diameter":
        ratio = 2 * bed.bead_seen * scale / (NEARER * bead)
        checks.append(size_seen(ratio, MISFIT, source))
    within = same or bed.beyond < MOST_BEYOND
    ending = "." if within else ": check --cylinder-diameter and --bead-diameter, by which walls were looked for."
    ending = ", whose distance the gauge confirms." if same else ending
    message = f"{100 * bed.beyond:.0f} % of the beads lie beyond what was taken for the cylinder's walls{ending}"
    checks.append(Check("walls", within, bed.beyond, 0.0, message))
    slants = abs(bed.narrowing) > MOST_NARROWING
    message = f"the bed is {100 * abs(bed.narrowing):.0f} % {'narrower' if bed.narrowing > 0 else 'wider'} at its foot"
    ending = ", on both sides: this is no cylinder, and neither its scale nor its density holds." if slants else "."
    checks.append(Check("straight_walls", not slants, bed.narrowing, 0.0, message + ending))
    checks.append(
        Check(
            "outline",
            not bed.flaw,
            bed.contrast,
            1.0,
            bed.flaw or f"the outline's clearness is {bed.contrast:.2f} of the clearest edge in the picture.",
        )
    )
    return checks
