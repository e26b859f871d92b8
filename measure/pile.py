"""A heap on a round base, photographed from the side: angle of repose, graphical and geometric.

`measure` turns photos into profiles, `evaluate` profiles into angles; a simulated heap goes through the same
`evaluate`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import Camera
from rigtwin.lab.content import all_different, sha256
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Evaluation, Measurement, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Profile, read_profile
from rigtwin.measure import slope
from rigtwin.measure.disc import FOCAL_DOUBT, Disc
from rigtwin.measure.media import read_photo
from rigtwin.measure.pile_checks import (
    BASE_DOUBT,
    base_check,
    narrow_base,
    size_checks,
    sizes_against_base,
    uneven_flanks,
    views_checks,
    washed_out,
)
from rigtwin.measure.stated_roll import roll_check
from rigtwin.measure.surface import Silhouette, View, find_heap, undo_view

GRAPHICAL, GEOMETRIC = "angle_of_repose_graphical", "angle_of_repose_geometric"
LINE, NARROWER = "line 15-85 %", "line 20-80 %"
_Draw = Callable[[Path], dict[str, Path]]
"""Writes the pictures of a view into a folder."""

NO_SCALE = "not known"
FLAWED = 3.0  # [deg], added to the doubt of an angle whose outline cannot be relied on
STATED_FOCAL_DOUBT = 0.1  # standard deviation of the logarithm of a focal length that the photo states
FULL_FRAME_DIAGONAL = 43.27  # [mm]
EXIF_IFD, FOCAL_LENGTH_35MM = 0x8769, 0xA405  # EXIF 2.32, tables 4 and 9
BEAD_DOUBT, GIVEN_DOUBT = 0.06, 0.01  # relative, of a scale by beads, or given
GRAINS_PER_CUBE = 0.6 * 6 / math.pi  # of a grain's diameter, at the solid fraction of a loose bed
STEEPEST_FLANK = 60.0  # [deg]; what sticks together may stand steeper, but is no heap of beads
STEEPEST_VIEW = 10.0  # [deg]; heaps come out 1 degree too steep from 12, 2 from 20
COVERED_BASE = 0.9  # share of a stated base that a heap must cover, below which the base is not its own
DOUBTFUL_COVER = 0.83  # share of the heap that circles cover, below which its outline may belong to something else


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


def measure(
    photos: Sequence[Path],
    camera: Camera,
    *,
    base_diameter: float | None = None,
    bead_diameter: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Angles of repose from photos of one heap, one photo per view; a ``.csv`` is a profile that is ready.

    `base_diameter` [m] of the disc the heap stands on, `bead_diameter` [m].  Angles need neither; heights and widths
    need one of them, or a scale in `camera`.  Raises `NothingToMeasure` when a photo shows no heap.
    """
    if not photos:
        raise BadInput("measure pile: no photo given; name one or more photos of the heap.")
    all_different(photos)
    if base_diameter is not None and bead_diameter is not None and bead_diameter >= base_diameter:
        raise BadInput(
            f"beads of {bead_diameter * 1e3:g} mm make no heap on a base of {base_diameter * 1e3:g} mm; "
            "check the base's and the bead's diameter."
        )
    observations, views, draws = [], [], []
    for number, (photo, name) in enumerate(zip(photos, _names(photos), strict=True)):
        progress("looking for the heap", number, len(photos))
        if photo.suffix.lower() == ".csv":
            seen, view, draw = _observe_table(photo, name, base_diameter)
        else:
            seen, view, draw = _observe_photo(photo, name, camera, base_diameter, bead_diameter)
        observations.append(seen)
        views.append(view)
        draws.append(draw)
    progress("looking for the heap", len(photos), len(photos))
    scaled = all(view["scale_from"] != NO_SCALE for view in views)
    evaluation = _evaluate(observations, base_diameter if scaled else None, bead_diameter if scaled else None)
    warnings = list(evaluation.warnings)
    quantities = evaluation.quantities
    if not scaled:
        quantities = tuple(quantity for quantity in quantities if quantity.unit != "m")
        warnings.append(
            "scale: not known, so heights and widths are left out; give --base-diameter, --bead-diameter or --scale."
        )
    return Measurement(
        rig="pile",
        source=photos[0],
        source_sha256=sha256(photos[0]),
        quantities=quantities,
        checks=evaluation.checks,
        warnings=tuple(warnings),
        camera=views[0] if len(views) == 1 else {**views[0], "views": views},
        profiles=tuple(seen.profile for seen in observations) if scaled else (),
        files={} if out is None else _drawn(draws, out),
    )


def _drawn(draws: Sequence[_Draw], out: Path) -> dict[str, Path]:
    """The pictures of all views; drawn once none of them can be refused any more, so that nothing is half written."""
    files: dict[str, Path] = {}
    out.mkdir(parents=True, exist_ok=True)
    for number, draw in enumerate(draws):
        written = draw(out)
        files.update(written if number == 0 else {f"{name}_{number + 1}": path for name, path in written.items()})
    return files


def evaluate(
    profiles: Sequence[Profile], *, base_diameter: float | None = None, bead_diameter: float | None = None
) -> Evaluation:
    """Angles, height and width of a heap from its profiles (several views of one heap), filmed or simulated.

    A simulated heap's profile is the silhouette of its spheres, not the line through their centres.  Raises
    `NothingToMeasure` when a profile holds no heap.
    """
    return _evaluate([Observation(profile) for profile in profiles], base_diameter, bead_diameter)


def _evaluate(
    observations: Sequence[Observation], base_diameter: float | None, bead_diameter: float | None
) -> Evaluation:
    quantities: list[Quantity] = []
    checks: list[Check] = []
    warnings: list[str] = []
    doubtful: list[bool] = []
    for number, seen in enumerate(observations):
        grain = bead_diameter or seen.grain
        heap = slope.find_parts(seen.profile, base_diameter, grain)
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
    heap = slope.find_parts(profile, base_diameter, grain)
    if heap is None:
        return {}
    angles = {}
    for method, window in ((LINE, slope.WINDOW), (NARROWER, (0.2, 0.8))):
        lines = {side: slope.flank_line(heap, side, window) for side in slope.SIDES}
        sides = {side: line.angle for side, line in lines.items() if line is not None}
        if len(sides) == 2:
            sides["mean"] = (sides["left"] + sides["right"]) / 2
        angles.update({(GRAPHICAL, method, side): angle for side, angle in sides.items()})
    for side in slope.SIDES:
        angles[GEOMETRIC, "apex", side] = slope.apex_angle(heap, side)
        steepest = slope.steepest_third(heap, side)
        if steepest is not None:
            angles[GRAPHICAL, "steepest third", side] = steepest
    angles[GEOMETRIC, "apex", "mean"] = slope.apex_angle(heap)
    angles[GEOMETRIC, "equal area", "mean"] = slope.equal_area_angle(heap)
    return angles


def _quantities_of_view(
    seen: Observation, heap: slope.Heap, base_diameter: float | None, grain: float | None
) -> list[Quantity]:
    angles = _angles(seen.profile, base_diameter, grain)
    varied = {
        name: [_angles(profile, base_diameter, grain) for profile in pair] for name, pair in seen.variants.items()
    }
    flaw = seen.flaw or _flaw_of_profile(heap, angles)
    limited = _base_limited(seen.profile, heap, base_diameter)
    bare = "" if limited else _bare_base(heap)
    grainy = {side: (slope.roughness_doubt(heap, side), slope.window_doubt(heap, side)) for side in slope.SIDES}
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
    heap: slope.Heap,
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
    reach = heap.base_width / 2 if side == "mean" else abs(heap.apex[0] - heap.feet[slope.SIDES.index(side)])
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


def _flaw_of_profile(heap: slope.Heap, angles: Mapping[tuple[str, str, str], float]) -> str:
    missing = [side for side in slope.SIDES if (GRAPHICAL, LINE, side) not in angles]
    if missing:
        return f"the {missing[0]} flank is too short for a line"
    for side in slope.SIDES:
        line = slope.flank_line(heap, side)
        if line is not None and line.angle > STEEPEST_FLANK:
            return (
                f"the {side} flank stands at {line.angle:.0f} deg, as no loose heap does: something hides or adds to it"
            )
        if line is not None and abs(line.outer - line.inner) < 3 * heap.grain:
            return f"the {side} flank is only {abs(line.outer - line.inner) / heap.grain:.1f} grains long"
        if slope.monotony(heap, side) < 0.6:
            return f"the {side} flank does not fall steadily"
    return ""


def _lengths(seen: Observation, heap: slope.Heap, grain: float | None, flaw: str) -> list[Quantity]:
    def length(name: str, value: float, method: str, share: float) -> Quantity:
        budget = {"grain at apex and foot": 0.25 * heap.grain} if share else {"grain roughness": 0.3 * value}
        scales = [slope.find_parts(profile, None, grain) for pair in seen.variants.values() for profile in pair]
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
    radius = slope.tip_radius(heap)
    if radius is not None:
        lengths.append(length("pile_tip_radius", radius, "parabola through the tip", 0.0))
    return lengths


def _base_limited(profile: Profile, heap: slope.Heap, base_diameter: float | None) -> bool:
    """Whether the heap reaches the rim on both sides, so that its width is the dish's and not its own."""
    if profile.base is not None:
        gaps = (heap.feet[0] - profile.base[0], profile.base[1] - heap.feet[1])
        return max(gaps) < heap.grain
    return base_diameter is not None and heap.feet[1] - heap.feet[0] > base_diameter - 2 * heap.grain


def _bare_base(heap: slope.Heap) -> str:
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


def _names(photos: Sequence[Path]) -> list[str]:
    """A name for every photo's view and files: its stem, numbered where an earlier photo has the same."""
    names: list[str] = []
    for photo in photos:
        taken = (f"{photo.stem}-{number}" for number in itertools.count(2))
        names.append(photo.stem if photo.stem not in names else next(name for name in taken if name not in names))
    return names


def _observe_table(path: Path, name: str, base_diameter: float | None) -> tuple[Observation, dict[str, Any], _Draw]:
    profile = replace(read_profile(path), view=name)
    if base_diameter is not None:
        profile = replace(profile, base=(-base_diameter / 2, base_diameter / 2))

    def draw(out: Path) -> dict[str, Path]:
        from rigtwin.measure.pile_pictures import write_plot

        return {"plot": write_plot(out / f"{name}-plot.svg", profile, base_diameter, None, "m")}

    view = {"scale_m_per_px": None, "scale_from": "profile table", "camera_roll_deg": None}
    return Observation(profile), view, draw


def _observe_photo(
    photo: Path, name: str, camera: Camera, base_diameter: float | None, bead_diameter: float | None
) -> tuple[Observation, dict[str, Any], _Draw]:
    image, odd = read_photo(photo, camera)
    ratio = base_diameter / bead_diameter if base_diameter and bead_diameter else None
    focal_length = _focal_length(photo, image)
    look = partial(find_heap, image, roll=camera.roll, region=camera.region, focal_length=focal_length)
    found = look(beads_across=ratio)
    if found is None:
        raise NothingToMeasure(
            f"{photo}: shows no heap of beads standing out from what is behind it; "
            "give a side view of the whole heap, or point at it with --region x,y,width,height."
        )
    scale, scale_from = _scale(found, camera, base_diameter, bead_diameter)
    unit = scale if scale is not None else 1.0
    profile = _profile(found, found.view, found.height, unit, name)
    sizes, unconfirmed = size_checks(found, scale, scale_from, bead_diameter, base_diameter)
    contradicted = sizes_against_base(look(), ratio) if found.disc is None and ratio is not None else ""
    misfit = failed(sizes)
    if base_diameter is not None and scale is not None and found.disc is not None and scale_from != "base diameter":
        across = 2 * found.view.radius * scale
        sizes = (*sizes, base_check(across, _scale_doubt(scale_from, camera), base_diameter, scale_from))
    if camera.roll is not None and found.disc is not None:
        seen_turn = found.view.roll, found.base_line_doubt[1]
        sizes = (*sizes, roll_check(camera.roll, *seen_turn, "the base that the angles count from shows"))
    heap = slope.find_parts(profile, None, 2 * found.bead_radius * unit)
    hidden = washed_out(found, image) if heap is not None and uneven_flanks(profile, heap) else ""
    seen = Observation(
        profile,
        _variants(found, unit, name, FOCAL_DOUBT if focal_length is None else STATED_FOCAL_DOUBT),
        contradicted or _flaw_of_picture(found) or misfit or hidden,
        2 * found.bead_radius * unit,
        sizes,
        _scale_doubt(scale_from, camera),
        unconfirmed,
        odd,
    )
    view = {
        "scale_m_per_px": None if scale is None else scale * found.zoom,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(found.view.roll),
        "looking_down_deg": found.view.looking_down,
        "base_found": found.disc is not None,
    }

    def draw(out: Path) -> dict[str, Path]:
        from rigtwin.measure.pile_pictures import write_pictures

        evaluation = _evaluate([seen], base_diameter if scale else None, bead_diameter if scale else None)
        return write_pictures(out, name, image, found, profile, evaluation, base_diameter, scale, seen.grain)

    return seen, view, draw


def _focal_length(photo: Path, image: npt.NDArray[np.uint8]) -> float | None:
    """Focal length [px] by the photo's own note of its 35 mm equivalent, which goes by the diagonal (CIPA DCG-001)."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(photo) as file:
            equivalent = file.getexif().get_ifd(EXIF_IFD).get(FOCAL_LENGTH_35MM)
    except (UnidentifiedImageError, Image.DecompressionBombError):  # of a kind, or a size, that OpenCV alone reads
        return None
    if not equivalent:
        return None
    return float(equivalent) / FULL_FRAME_DIAGONAL * math.hypot(*image.shape[:2])


def _scale(
    found: Silhouette, camera: Camera, base_diameter: float | None, bead_diameter: float | None
) -> tuple[float | None, str]:
    """[m/px] of the measured picture in the plane through the base's axis, and where it comes from."""
    if camera.given_scale is not None:
        return camera.given_scale / found.zoom, camera.scale_from
    if base_diameter is not None and found.disc is not None:
        return base_diameter / (2 * found.view.radius), "base diameter"
    if bead_diameter is not None:
        return bead_diameter / (2 * found.bead_radius), "bead diameter"
    return None, NO_SCALE


def _scale_doubt(scale_from: str, camera: Camera) -> float:
    """Relative standard uncertainty of the scale; 0 where there is none."""
    by_sizes = {"base diameter": BASE_DOUBT, "bead diameter": BEAD_DOUBT, NO_SCALE: 0.0}
    return by_sizes.get(scale_from, camera.scale_doubt(GIVEN_DOUBT))


def _profile(found: Silhouette, view: View, height: Array, unit: float, name: str) -> Profile:
    """The outline as a section through the heap, in metres (in px where `unit` is 1)."""
    seen = np.isfinite(height)
    x, level = found.x[seen], height[seen]
    raw = slope.find_parts(Profile(x, level, level), None, 2 * found.bead_radius)
    if raw is not None:
        lines = [slope.flank_line(raw, side) for side in slope.SIDES]
        left, right = (max(math.tan(math.radians(line.angle)), 0.1) if line else 0.5 for line in lines)
        x, level = undo_view(x, level, view, (left, right))
    order = np.argsort(x)
    x, level = x[order], level[order]
    base = (-view.radius * unit, view.radius * unit) if view.radius > 0 else None
    return Profile(x * unit, level * unit, np.full(len(x), found.sigma * unit), base, name)


def _variants(found: Silhouette, unit: float, name: str, focal_doubt: float) -> dict[str, tuple[Profile, Profile]]:
    """Other readings of the same photo, each pair one standard deviation to either side."""
    view, height = found.view, found.height
    raised, turned = found.base_line_doubt
    pairs = {
        "outline level": ((view, found.looser), (view, found.stricter)),
        "base line height": ((view, height + raised), (view, height - raised)),
        "base line angle": ((view, height + turned * found.x), (view, height - turned * found.x)),
    }
    if found.disc is not None:
        factor = math.exp(focal_doubt)
        (far, far_lift), (near, near_lift) = (
            _other_distance(view, found.disc, stretch) for stretch in (factor, 1 / factor)
        )
        pairs["camera distance"] = (far, height + far_lift), (near, height + near_lift)
    return {
        part: (_profile(found, *first, unit, name), _profile(found, *second, unit, name))
        for part, (first, second) in pairs.items()
    }


def _other_distance(view: View, disc: Disc, factor: float) -> tuple[View, float]:
    """The view with the camera `factor` times as far away, and how much higher heights then are [px].

    Lower rim and front of the face are what was seen.  From further away the lower rim bulges less beyond the upper
    one, so that the upper one must bulge more, and the axis meets the base plane elsewhere (see `Disc`).
    """
    near, other = disc.nearness, disc.nearness / factor
    deepening, changed = near / (1 - near * near), other / (1 - other * other)
    thickness = disc.thickness * (1 + deepening) / (1 + changed)
    bulge = max(disc.bulge + disc.thickness * deepening - thickness * changed, 0.0)
    lift = (disc.thickness - thickness) + near * disc.bulge - other * bulge
    radius = disc.half_width * math.sqrt(1 - other * other)
    seen = replace(view, radius=radius, camera_height=bulge / changed, camera_distance=radius / other)
    return seen, lift


def _flaw_of_picture(found: Silhouette) -> str:
    if found.cut_off:
        return "the outline touches the edge of the picture"
    if found.contrast < 0.3:
        return "the outline is hardly to be told from the background"
    if found.covered < DOUBTFUL_COVER or found.unexplained > 0.04:
        return "beads were made out in only part of the heap"
    if found.disc is None:
        return "the base disc was not found, so the base line is taken from the outermost beads"
    if found.view.looking_down > STEEPEST_VIEW:
        down = found.view.looking_down
        return (
            f"the camera looks down by {down:.0f} degrees and sees no section; film from less than {STEEPEST_VIEW:.0f}"
        )
    if found.disc.doubtful:
        return "the edges of the base disc are unclear, so the base line may be off"
    apart = np.abs(found.looser - found.stricter)
    if float(np.nanmean(apart > found.bead_radius)) > 0.1:
        return "more than a tenth of the outline depends on the level at which beads are told from the background"
    return ""
