"""A cylinder filled with beads, photographed from the side: bed height and bulk density (Hlosta et al. 2020, fig. 4).

The surface of a bed is a band, not a line.  `bed_height` by the method "surface bead tops", the first, is the mean top
of the beads that form the surface, those with no higher bead whose centre lies within 0.8 diameters sideways of their
own: what is read at a gauge.  "mean surface" is the mean height of the surface with its pits, half a bead lower, to
which the bed fills the cylinder; a bead that is not stated is taken as large as beads look.  What a photo shows is the
"outline": at every place across the cylinder the highest bead along the line of sight, some 0.3 diameters above the
tops.  `evaluate` reads the outline and takes that off.  The bulk density is told for both of the first.

A profile of `measure` runs across the cylinder, x = 0 on its axis; heights are above the cylinder's floor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.camera import Camera
from rigtwin.lab.content import all_different, sha256
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import (
    Check,
    Evaluation,
    Measurement,
    Quantity,
    doubted,
    failed,
    in_a_row,
    root_sum_of_squares,
)
from rigtwin.lab.records import Profile, read_profile
from rigtwin.lab.wording import reading
from rigtwin.measure.bead_size import MISFIT, size_seen, size_unseen
from rigtwin.measure.glass import Bed, find_bed
from rigtwin.measure.media import read_photo
from rigtwin.measure.stated_roll import roll_check
from rigtwin.measure.views import views_check

# How far the mean outline stands above the mean top of the surface beads, and the mean surface with its pits below it,
# in bead diameters; from settled beds of a DEM, of 8 to 13 bead diameters' width and of several frictions.
# The spread is that of layers drawn at random (benchmarks/bulk_coverage.py): 0.067 from bed to bed, 0.05 in the middle.
OUTLINE_ABOVE, OUTLINE_SPREAD = 0.30, 0.08
PITS_BELOW, PITS_SPREAD = 0.50, 0.05
INSIDE = 0.95  # share of the inner radius that is read: at the wall the outline falls with the last bead's side
GIVEN_DOUBT = 0.003  # relative, of a scale read off a length in the plane of the axis
WALL_DOUBT = 0.006  # relative, of a scale read off the cylinder's inner walls
GAUGE_DOUBT = 0.002  # relative, of a scale read off a gauge in the plane of the axis
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
ROUGHEST = 0.6  # bead diameters; outlines of settled beds of a DEM are rough by 0.15 to 0.35
SMOOTHEST = 0.03  # likewise; a straight edge is read to a third of a pixel where beads are a dozen pixels wide
# of beads' round tops at most a third lies on one line, within that many bead diameters; of an edge in front, most
ON_A_LINE, LINE_WIDTH = 0.5, 0.03
ANCHORS = 40  # places through which lines are tried
SPOILING = ("level_bed", "smooth_surface", "views_agree")  # checks without which a height is doubtful
# likewise, of what the picture says of the stated sizes, on which scale, floor, or what is taken off the outline hang
STATED = ("gauge", "bead_size", "walls", "straight_walls", "scale", "camera_roll")
NEARER = 1.05  # the beads in front are nearer to the camera than the axis by a fifteenth or so, those beside them less
BEAD_DOUBT = MISFIT / 2  # relative, of a scale read off the beads or of their size, which nothing else checks then
# Beads are taken to be that many times as large as an outline is rough where only that tells their size; outlines of
# settled beds are rough by 0.15 to 0.35 of them.
OF_ROUGHNESS, ROUGHNESS_DOUBT = 4.0, 0.4  # the latter relative
MOST_BEYOND = 0.08  # share of the beads seen that may lie outside of the walls: reflections in the glass
# share by which a bed may be narrower at its foot than at its top: a cylinder seen from above and near looks so by a
# twentieth; where the walls close in by more the density is off by as much
MOST_NARROWING = 0.15
# relative standard uncertainties of what a person has weighed and gauged; a twin's mass and cylinder are exact
BY_HAND = {"mass": 0.002, "cylinder diameter": 0.003}
ADVISED_RATIO = 5.0  # cylinder over bead diameter


@dataclass(frozen=True)
class Observation:
    """One photo's outline and what the picture leaves in doubt [m]."""

    profile: Profile
    doubts: dict[str, float] = field(default_factory=dict)  # of the mean height
    flaw: str = ""  # why the outline is not to be relied on
    misfit: str = ""  # what speaks against a stated size
    unconfirmed: str = ""  # the stated size on which all hangs and which nothing in the picture checks
    bead: float | None = None  # [m], as large as beads look


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate(
    profiles: Sequence[Profile],
    *,
    cylinder_diameter: float | None,
    total_mass: float | None = None,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    spheres: bool = True,
) -> Evaluation:
    """Bed height and bulk density from outlines of one bed (several views), filmed or simulated.

    A simulated bed's profile is the outline of its spheres seen level and from far away, above the floor.
    `cylinder_diameter` [m] is the inner one, `total_mass` [kg], `bead_diameter` [m], `bead_density` [kg/m^3];
    `spheres` are all of one size.
    """
    seen = [Observation(profile) for profile in profiles]
    return _evaluate(seen, cylinder_diameter, total_mass, bead_diameter, bead_density, {}, spheres)


def _evaluate(
    seen: Sequence[Observation],
    cylinder: float | None,
    mass: float | None,
    bead: float | None,
    solid: float | None,
    stated: Mapping[str, float],
    spheres: bool,
) -> Evaluation:
    """`stated` are the relative standard uncertainties of mass and cylinder, where they are not exact."""
    if not seen:
        raise BadInput("measure packing: no profile given; give at least one outline of the bed.")
    for name, value in (
        ("cylinder_diameter", cylinder),
        ("total_mass", mass),
        ("bead_diameter", bead),
        ("bead_density", solid),
    ):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise BadInput(f"measure packing: {name} must be positive, got {value:g}.")
    heights = [_mean_outline(each.profile, cylinder) for each in seen]
    outline = float(np.mean([height for height, _ in heights]))
    rough = float(np.mean([rough for _, rough in heights]))
    grain, unknown = (bead, 0.0) if bead else _bead_seen(seen, rough)
    parts = _view_doubts(seen, [height for height, _ in heights])
    below = OUTLINE_ABOVE + PITS_BELOW
    tops = {**parts, "outline to tops": OUTLINE_SPREAD * grain, "bead diameter": unknown * OUTLINE_ABOVE}
    pits = {
        **parts,
        "outline to surface": math.hypot(OUTLINE_SPREAD, PITS_SPREAD) * grain,
        "bead diameter": unknown * below,
    }
    checks = _checks(seen, heights, cylinder, bead)
    if len(seen) > 1:
        checks.append(_views_check(seen, [height for height, _ in heights], grain))
    flaw = _flaw(seen, checks)
    found = [
        _height(outline - OUTLINE_ABOVE * grain, "surface bead tops", tops, len(seen), flaw),
        _height(outline - below * grain, "mean surface", pits, len(seen), flaw),
        _height(outline, "outline", parts, len(seen), flaw),
    ]
    if found[1].value <= 0:
        raise NothingToMeasure(
            f"the outline lies at {outline * 1e3:.1f} mm, not above the floor by a bead; check height_m and its zero."
        )
    warnings = list(dict.fromkeys(each.unconfirmed for each in seen if each.unconfirmed))
    if bead is None:
        warnings.append(
            f"bead diameter not stated: what lies between outline, tops and mean surface was worked out for beads of "
            f"{reading(grain, unknown, 'm')}, by the look of the bed; give --bead-diameter."
        )
    if mass is not None and cylinder is not None:
        densities = [_density(height, mass, cylinder, stated) for height in found[:2]]
        if solid is None:
            checks.append(_material_check(densities[0].value))
        else:
            among = _random_packing(cylinder / grain) if spheres else ANY_SHAPE
            checks.append(_fraction_check(densities[1], solid, among, spheres))
        if solid is None and stated:
            material = _roughly(densities[0].value / USUAL_FRACTION)
            warnings.append(
                f"mass not confirmed: bulk density hangs on --total-mass {mass * 1e3:g} g alone, by which beads have "
                f"about {material} kg/m^3; give --bead-density to check it."
            )
        found += [doubted(one, failed(checks, ["bulk_density", "cylinder_bead_ratio"])) for one in densities]
    else:
        missing = "total_mass" if mass is None else "cylinder_diameter"
        warnings.append(f"bulk density is left out; give --{missing.replace('_', '-')}.")
    return Evaluation(tuple(found), tuple(checks), tuple(warnings))


def _bead_seen(seen: Sequence[Observation], rough: float) -> tuple[float, float]:
    """Diameter of a bead that is not stated and its standard uncertainty, both in m."""
    looks = [each.bead for each in seen if each.bead is not None]
    if looks:  # views show the same beads alike
        return float(np.median(looks)), BEAD_DOUBT * float(np.median(looks))
    return OF_ROUGHNESS * rough, ROUGHNESS_DOUBT * OF_ROUGHNESS * rough


def _flaw(seen: Sequence[Observation], checks: Sequence[Check]) -> str:
    """Why the heights are not to be relied on."""
    outline = [each.flaw for each in seen if each.flaw]
    # an outline that something covers is likely to be askew or smooth for that
    odd = [] if outline else [each.message for each in checks if not each.passed and each.check in SPOILING]
    return in_a_row([*outline, *odd, *(each.misfit for each in seen)])


def _inside(profile: Profile, cylinder: float | None) -> tuple[Array, Array]:
    """The outline where it is read, rising in x [m]; too little of it to read is possible."""
    finite = np.isfinite(profile.height) & np.isfinite(profile.x)
    x, height = profile.x[finite], profile.height[finite]
    if cylinder is not None:
        inside = np.abs(x) < INSIDE * cylinder / 2
    elif len(x):
        reach = INSIDE * float(np.ptp(x)) / 2
        inside = np.abs(x - (x.max() + x.min()) / 2) < reach
    else:
        inside = np.zeros(0, dtype=bool)
    order = np.argsort(x[inside])
    return x[inside][order], height[inside][order]


def _mean_outline(profile: Profile, cylinder: float | None) -> tuple[float, float]:
    """Mean height of the outline inside the cylinder and its roughness about a slope, both in m."""
    x, height = _inside(profile, cylinder)
    if len(x) < 8 or np.ptp(x) <= 0:
        raise NothingToMeasure(
            f"profile {profile.view!r} shows too little of the bed's surface inside the cylinder; "
            "give x_m from the axis and height_m above the floor."
        )
    # even steps: a profile may be denser at some places
    places = np.linspace(x.min(), x.max(), 400)
    level = np.interp(places, x, height)
    return float(level.mean()), float(np.std(level - np.polyval(np.polyfit(places, level, 2), places)))


def _on_a_line(x: Array, height: Array, width: float) -> float:
    """Largest share of the points that lie within `width` of one straight line."""
    ends = np.unique(np.linspace(0, len(x) - 1, ANCHORS).round().astype(int))
    first, second = (ends[k] for k in np.triu_indices(len(ends), k=1))
    apart = x[second] - x[first]
    first, second = first[apart > 4 * width], second[apart > 4 * width]
    slope = (height[second] - height[first]) / (x[second] - x[first])
    off = height - height[first, None] - slope[:, None] * (x - x[first, None])
    return float(np.max(np.mean(np.abs(off) < width, axis=1), initial=0.0))


def _view_doubts(seen: Sequence[Observation], heights: Sequence[float]) -> dict[str, float]:
    """What the pictures leave in doubt; views share scale and floor, so only scatter averages out."""
    names = dict.fromkeys(name for each in seen for name in each.doubts)
    parts = {name: max(each.doubts.get(name, 0.0) for each in seen) for name in names}
    sigmas = [float(np.nanmedian(each.profile.sigma)) for each in seen]
    noise = max((sigma for sigma in sigmas if math.isfinite(sigma)), default=0.0)
    parts["outline"] = 0.3 * noise
    if len(heights) > 1:
        parts["views"] = float(np.std(heights, ddof=1)) / math.sqrt(len(heights))
    return parts


def _height(value: float, method: str, budget: dict[str, float], count: int, flaw: str) -> Quantity:
    budget = {name: part for name, part in budget.items() if part > 0}
    if flaw:
        budget["unreliable outline"] = 2 * root_sum_of_squares(budget)
    return Quantity("bed_height", value, root_sum_of_squares(budget), "m", method, count, {}, budget, flaw)


def _density(height: Quantity, mass: float, cylinder: float, stated: Mapping[str, float]) -> Quantity:
    """Mass over the filled volume, pi/4 D^2 h."""
    value = mass / (math.pi / 4 * cylinder**2 * height.value)
    power = {"mass": 1, "cylinder diameter": 2}
    budget = {name: value * part / height.value for name, part in height.budget.items()}
    budget |= {name: value * power[name] * part for name, part in stated.items()}
    sigma = root_sum_of_squares(budget)
    return Quantity(
        "bulk_density", value, sigma, "kg/m^3", height.method, height.n, budget=budget, doubtful=height.doubtful
    )


def _views_check(seen: Sequence[Observation], heights: Sequence[float], grain: float) -> Check:
    """Views of one bed see other beads in front, and are read each for itself."""
    sigmas = [math.hypot(OUTLINE_SPREAD * grain, *each.doubts.values()) * 1e3 for each in seen]
    return views_check("mean outline", [height * 1e3 for height in heights], sigmas, "mm")


def _material_check(density: float) -> Check:
    """Whether beads of any solid can lie as dense as that [kg/m^3]."""
    solid, (low, high) = density / USUAL_FRACTION, SOLID_DENSITIES
    says = f"the bulk has {density:.4g} kg/m^3, as of beads of about {_roughly(solid)} kg/m^3"
    ending = (
        f", but only foam is lighter than {low:g} (of such beads give --bead-density), and nothing heavier than "
        f"{high:.0f}: check --total-mass, and --cylinder-diameter."
    )
    passed = low < solid < high
    return Check("bulk_density", passed, solid, math.nan, says + ("." if passed else ending))


def _random_packing(ratio: float) -> tuple[float, float]:
    """Shares that equal spheres may fill of a cylinder `ratio` times as wide as they are: loose, and close."""
    loose, close = SPHERES
    gaps = WALL_GAPS * (math.exp(WALL_DEPTH / max(ratio, NARROWEST)) - 1)
    return loose * (1 - gaps), close


def _fraction_check(density: Quantity, solid: float, among: tuple[float, float], spheres: bool) -> Check:
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


def _roughly(density: float) -> str:
    """Two digits of a density [kg/m^3], for a bed may be looser or denser than is usual."""
    return f"{float(f'{density:.2g}'):g}"


def _checks(
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
    straight = _on_a_line(*_inside(profile, cylinder), LINE_WIDTH * bead)
    odd = "smooth" if rough < SMOOTHEST else "rough" if rough > ROUGHEST else "straight" if straight > ON_A_LINE else ""
    ending = f": no settled bed is so {odd}; is something in front of it?" if odd else "."
    message = (
        f"the outline ({profile.view}) is rough by {rough:.2f} bead diameters, {100 * straight:.0f} % of it lie on one "
        f"straight line{ending}"
    )
    return Check("smooth_surface", not odd, rough, 0.25, message)


# ---------------------------------------------------------------------------------------------------- media -> record


def measure(
    photos: Sequence[Path],
    camera: Camera,
    *,
    cylinder_diameter: float | None,
    total_mass: float | None = None,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    spheres: bool = True,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Bed height and bulk density from photos of one bed (one per view); a ``.csv`` is a profile that is ready.

    A gauge beside the cylinder gives scale and zero where its graduations are seen; else the inner diameter of the
    cylinder gives the scale, and the lowest beads the floor.  Where `spheres` is false, beads may fill more or less of
    the bed than spheres of one size can.  Raises `NothingToMeasure` when no bed is seen.
    """
    if not photos:
        raise BadInput("measure packing: no photo given; name one or more photos of the cylinder.")
    all_different(photos)
    if cylinder_diameter is not None and not (math.isfinite(cylinder_diameter) and cylinder_diameter > 0):
        raise BadInput(f"measure packing: cylinder_diameter must be positive, got {cylinder_diameter:g}.")
    seen, views, checks = [], [], []
    beds: list[tuple[Image, Bed] | None] = []
    warnings: list[str] = []
    for number, photo in enumerate(photos):
        progress("looking for the bed", number, len(photos))
        if photo.suffix.lower() == ".csv":
            seen.append(Observation(replace(read_profile(photo), view=photo.stem)))
            views.append({"scale_m_per_px": None, "scale_from": "profile table", "camera_roll_deg": None})
            beds.append(None)
            continue
        image, odd = read_photo(photo, camera)
        warnings += odd
        bed, observation, view, found = _observe(photo, image, camera, cylinder_diameter, bead_diameter)
        seen.append(observation)
        views.append(view)
        checks += found
        beds.append((image, bed))
    progress("looking for the bed", len(photos), len(photos))
    evaluation = _evaluate(seen, cylinder_diameter, total_mass, bead_diameter, bead_density, BY_HAND, spheres)
    measurement = Measurement(
        rig="packing",
        source=photos[0],
        source_sha256=sha256(photos[0]),
        quantities=evaluation.quantities,
        checks=(*checks, *evaluation.checks),
        warnings=(*warnings, *evaluation.warnings),
        camera=views[0] if len(views) == 1 else {**views[0], "views": views},
        profiles=tuple(each.profile for each in seen),
    )
    if out is None:
        return measurement
    from rigtwin.measure.packing_pictures import write_pictures

    files: dict[str, Path] = {}
    for number, (photo, each, pair) in enumerate(zip(photos, seen, beds, strict=True)):
        written = write_pictures(out, photo.stem, each.profile, pair, measurement)
        files.update(written if number == 0 else {f"{name}_{number + 1}": path for name, path in written.items()})
    return replace(measurement, files=files)


def _observe(
    photo: Path, image: Image, camera: Camera, cylinder: float | None, bead: float | None
) -> tuple[Bed, Observation, dict[str, Any], list[Check]]:
    bed = find_bed(image, cylinder=cylinder, bead=bead, roll=camera.roll, region=camera.region)
    if bed is None:
        raise NothingToMeasure(
            f"{photo}: shows no bed of beads in a cylinder; photograph it from the side, the beads a dozen pixels wide "
            "or more, or point at it with --region x,y,width,height."
        )
    scale, doubt, source = _scale(photo, bed, camera, cylinder, bead)
    x, above = bed.outline
    if bed.gauge is not None and source == "gauge":
        height = bed.gauge.reading(bed.gauge_rows(x, above)) * 1e-3
        floor_doubt, floor_from = 0.15e-3, "gauge"
    else:
        height = above * scale
        floor_doubt, floor_from = bed.floor_sigma * scale, "lowest beads"
    steep = bed.steepness()
    grain = 2 * bed.bead_radius * scale
    # seen from above or below, the near or the far side of the bed stands out over the middle
    raised = 0.25 * steep[0] ** 2 * grain
    spread = max(0.25 * steep[1] * math.hypot(2 * steep[0], math.sqrt(2) * steep[1]), 0.02) * grain
    profile = Profile(x * scale, height - raised, np.full(len(x), 0.8 * scale), view=photo.stem)
    mean = float(np.nanmean(height))
    doubts = {
        "scale": doubt * mean,
        "floor": floor_doubt,
        "outline level": bed.outline_doubt * scale,
        "camera height": spread,
    }
    view = {
        "scale_m_per_px": scale,
        "scale_from": source,
        "floor_from": floor_from,
        "camera_roll_deg": math.degrees(bed.roll),
        "bead_radius_px": bed.bead_radius,
    }
    checks = _picture_checks(bed, scale, source, cylinder, bead)
    if camera.roll is not None and bed.roll_seen is not None:
        checks.append(roll_check(camera.roll, *bed.roll_seen, "the upright edges in the picture show"))
    misfit = failed(checks, STATED)
    observation = Observation(
        profile, doubts, bed.flaw, misfit, _unconfirmed(bed, source, cylinder, bead), 2 * bed.bead_seen * scale / NEARER
    )
    return bed, observation, view, checks


def _unconfirmed(bed: Bed, source: str, cylinder: float | None, bead: float | None) -> str:
    """What hangs on one stated size that nothing else in the picture checks; empty where something does."""
    if bed.gauge is not None:
        return ""  # its millimetres are known
    if source == "cylinder diameter" and bead is None:
        what, advice = "bed height and, by its third power, bulk density hang", "--bead-diameter"
        given = f"--cylinder-diameter {(cylinder or 0) * 1e3:g} mm"
    elif source == "bead diameter":
        what, advice, given = "bed height hangs", "--cylinder-diameter", f"--bead-diameter {(bead or 0) * 1e3:g} mm"
    elif bead is None and cylinder is None:
        what, advice, given = "bed height hangs", "--cylinder-diameter or --bead-diameter", "the given scale"
    else:
        return ""
    return size_unseen(what, given, f"give {advice} too, or photograph a length gauge beside the cylinder")


def _scale(
    photo: Path, bed: Bed, camera: Camera, cylinder: float | None, bead: float | None
) -> tuple[float, float, str]:
    """[m/px] in the plane of the axis at the bed's middle, its relative doubt, and where it is from."""
    if camera.given_scale is not None:
        return camera.given_scale, camera.scale_doubt(GIVEN_DOUBT), camera.scale_from
    wall = None if cylinder is None else cylinder / bed.width
    doubt = WALL_DOUBT
    if bed.gauge is not None:
        pitch = _gauge_pitch(bed)
        if wall is None or abs(pitch / wall - 1) < SAME_PLANE:
            return pitch, GAUGE_DOUBT, "gauge"
        # the truth lies anywhere between the two
        doubt = math.hypot(WALL_DOUBT, (pitch / wall - 1) / math.sqrt(3))
    if wall is not None:
        return wall, doubt, "cylinder diameter"
    if bead is not None:
        return NEARER * bead / (2 * bed.bead_seen), BEAD_DOUBT, "bead diameter"
    raise BadInput(
        f"{photo}: no scale; give --cylinder-diameter, --scale, or a photo with a graduated gauge beside the cylinder."
    )


def _gauge_pitch(bed: Bed) -> float:
    """[m/px] of the gauge in the middle of the bed's height."""
    assert bed.gauge is not None
    return bed.gauge.pitch(bed.floor - float(np.mean(bed.outline[1])) / 2)


def _picture_checks(bed: Bed, scale: float, source: str, cylinder: float | None, bead: float | None) -> list[Check]:
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
        ratio = _gauge_pitch(bed) / (cylinder / bed.width)
        same = abs(ratio - 1) < SAME_PLANE
        ending = (
            ", as in the plane of the axis."
            if same
            else ": it stands before or behind the axis and was not used, or --cylinder-diameter is wrong."
        )
        checks.append(
            Check("gauge", same, ratio, 1.0, f"the gauge's millimetre is {ratio:.3f} of the cylinder's{ending}")
        )
    known = _gauge_pitch(bed) if bed.gauge is not None else None if cylinder is None else cylinder / bed.width
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
