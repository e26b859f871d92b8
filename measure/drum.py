"""A drum that turns slowly, part full of beads, seen from its end: dynamic angle of repose of the flowing surface.

`measure` turns a clip into one profile per frame, `evaluate` profiles into angles; a simulated drum goes through the
same `evaluate`.  A drum's profile has its origin on the drum's axis: x to the right, height up against gravity, so
that the surface of a drum less than half full lies at negative heights; NaN where there is no bed.  Angles are the
magnitude; ``turning`` tells which way the surface rises.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.camera import Camera
from rigtwin.lab.content import sha256
from rigtwin.lab.drum import fill_check, froude_check
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Detail, Evaluation, Measurement, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Profile, Series
from rigtwin.measure.bed import Bed, bed_in_photo, follow_bed
from rigtwin.measure.drum_profiles import credible, hidden_columns, profile_of, without_flights
from rigtwin.measure.drum_turning import stance_checks
from rigtwin.measure.in_view import camera_by_scene
from rigtwin.measure.media import UNSTEADY, Image, Video, open_video, read_photo
from rigtwin.measure.repeats import at_its_pace
from rigtwin.measure.stated_roll import nothing_level, upright_checks
from rigtwin.measure.steady import Avalanches, Mean, find_avalanches, mean_over_time, steady_part
from rigtwin.measure.upright import NOT_SEEN

Array = npt.NDArray[np.float64]

GRAPHICAL, GEOMETRIC = "angle_of_repose_graphical", "angle_of_repose_geometric"
UPPER, LOWER = "angle_of_repose_upper", "angle_of_repose_lower"
FREQUENCY = "avalanche_frequency"
MIDDLE = "line, middle half"
WHOLE = "line, 10-90 %"
TANGENT = "tangent at the axis"
CHORD = "chord, wall to wall"
CHORD_ENDS = 0.05  # of the surface's extent, averaged for each end of the chord: about one bead
AT_WALL = 0.02  # of the radius: a border that near the wall is the wall's, not the surface's
# shares of the surface's horizontal extent, from its lower to its upper end
WINDOWS = {
    (GRAPHICAL, MIDDLE): (0.25, 0.75),
    (GRAPHICAL, WHOLE): (0.1, 0.9),
    (LOWER, "line, 10-50 %"): (0.1, 0.5),
    (UPPER, "line, 50-90 %"): (0.5, 0.9),
}
TANGENT_REACH = 0.2  # of the radius, to both sides of the axis
PHOTOS = (".bmp", ".png", ".jpg", ".jpeg", ".tif", ".tiff")
S_SHAPE = 2.0  # [deg], difference of upper and lower angle below which a surface counts as straight
# [deg], perspective, lens, and beads in flight that hide the bed they have left, most of all at its upper end
VIEW_DOUBT = {GRAPHICAL: 0.25, LOWER: 0.5, UPPER: 1.2, GEOMETRIC: 1.2}
# a line over a bent surface has the mean slope of its two halves, and half of the doubt of each
HALVES_DOUBT = math.hypot(VIEW_DOUBT[LOWER], VIEW_DOUBT[UPPER]) / 2
ONE_MOMENT = 2.0  # [deg], how far a flowing surface is from its mean at one moment: drums of 25 beads width sway so
MOST_BOW = 0.2  # sagitta over length of the surface; S-shapes are odd about the middle, the drum's own arc has 0.5
HIGHEST_STEP = 4.0  # bead diameters over the width of one: a slope of 76 degrees
GLARE = 0.05  # share of the surface under a reflection, from which on lines along parts of it are off
# checks of the record that every angle rests on
RESTS_ON = ("surface_in_view", "steady_flow", "frame_timing", "surface_falls", "froude_number")
SURELY_UP = 3.0  # standard uncertainties by which a half of the surface has to rise the wrong way
SMEARED = 0.25  # share of frames that may be left out before the result is doubtful


@dataclass(frozen=True)
class Observation:
    """What a clip shows: profiles over time, and the same under other readings of it, one standard deviation away."""

    profiles: Sequence[Profile]
    times: Array  # [s]
    radius: float | None  # of the drum, in the unit of the profiles
    variants: Mapping[str, tuple[Sequence[Profile], Sequence[Profile]]] = field(default_factory=dict)
    roll_doubt: float = 0.0  # [deg]
    roll_seen: bool = True  # or stated
    filmed: bool = False
    bead: float | None = None  # bead diameter, in the unit of the profiles


def measure(
    clip: Path,
    camera: Camera,
    *,
    drum_diameter: float | None,
    speed: float | None = None,
    bead_diameter: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Dynamic angle of repose from a clip of a turning drum, or from a single picture of it.

    `drum_diameter` [m] inside, `speed` [rad/s] of turning, `bead_diameter` [m]; pictures go into `out`.  Raises
    `NothingToMeasure` when no drum with a bed is seen.
    """
    _must_be_positive(drum_diameter=drum_diameter, speed=speed, bead_diameter=bead_diameter)
    share = bead_diameter / drum_diameter if bead_diameter and drum_diameter else None
    if share is not None and share > 0.5:
        raise BadInput(
            "measure drum: the bead is larger than half of the drum; check --bead-diameter, --drum-diameter."
        )
    warnings: list[str] = []
    rate, spoilt = None, ""
    shown: Video | Image
    if clip.suffix.lower() in PHOTOS:
        shown, odd = read_photo(clip, camera)
        warnings += odd
        bed = bed_in_photo(shown, roll=camera.roll, bead_share=share, region=camera.region)
        if bed is None:
            raise NothingToMeasure(
                f"{clip}: shows no round drum with a bed that differs in colour from what is above it; "
                "give a picture of the drum's end with the whole rim in view."
            )
        warnings.append("a single picture shows one moment of the flow; film the drum for a mean over time.")
    else:
        shown = at_its_pace(open_video(clip, camera), progress)
        warnings += shown.warnings
        rate, spoilt = shown.frame_rate, shown.spoilt
        bed = follow_bed(shown, roll=camera.roll, bead_share=share, region=camera.region, progress=progress)
    scale, scale_from = _scale(bed, camera, drum_diameter)
    seen = _observation(bed, scale or 1.0, bead_diameter)
    still = camera_by_scene(bed.poses) if bed.poses else ""
    if isinstance(still, str) and still:
        warnings.append(still)
    of_picture = [*_checks_of_picture(bed, still), *stance_checks(bed.aside, bed.turning, _rises(seen.profiles))]
    _must_be_a_drum(clip, of_picture)
    try:
        evaluation = _evaluate(seen, speed, None if scale is None else seen.radius)
    except NothingToMeasure as nothing:
        where = f"in every one of {len(bed.outlines)} frames" if bed.poses else "in this picture"
        raise NothingToMeasure(
            f"{clip}: too little of the bed's surface is seen {where}: something stands in front of it, or bed and "
            "drum look alike where it is dark or strongly compressed; give the original file, light the drum from the "
            "front, keep hands out of the view."
        ) from nothing
    quantities = tuple(
        doubted(doubted(one, failed(of_picture, _rests_on(one, of_picture))), spoilt) for one in evaluation.quantities
    )
    checks = (*of_picture, *evaluation.checks)
    if scale is None:
        warnings.append("scale: not known, so profiles are left out; give --drum-diameter or --scale.")
    if turned := nothing_level(bed.upright):
        warnings.append(turned)
    hidden = sum(outline.hidden for outline in bed.outlines)
    if 0 < hidden <= len(bed.outlines) / 2:
        warnings.append(
            f"in {hidden} of {len(bed.outlines)} frames something passes in front of the drum; they are left out."
        )
    view: dict[str, Any] = {
        "frame_rate_hz": rate,
        "scale_m_per_px": None if scale is None else scale * bed.lens.zoom,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(bed.upright.roll),
        "camera_roll_from": bed.upright.source,
        "drum_centre_px": [float(each) for each in bed.lens.in_clip(np.array([bed.rim.centre]))[0]],
        "drum_radius_px": bed.rim.radius / bed.lens.zoom,
        "frames": len(bed.outlines),
    }
    result = Measurement(
        rig="drum",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=(*warnings, *evaluation.warnings),
        camera=view,
        profiles=tuple(seen.profiles) if scale is not None else (),
    )
    if out is None:
        return result
    from rigtwin.measure.drum_pictures import write_pictures

    return replace(result, files=write_pictures(out, result, shown, bed, scale or 1.0, progress))


def evaluate(
    profiles: Sequence[Profile],
    times: Array,
    *,
    drum_diameter: float | None,
    speed: float | None = None,
    bead_diameter: float | None = None,
) -> Evaluation:
    """Angles of a drum's surface from its profiles over time, filmed or simulated.

    The origin of a profile is the drum's axis.  A simulated surface is the upper edge of its spheres.  Raises
    `NothingToMeasure` when no profile holds a surface, `BadInput` when profiles and times do not fit together.
    """
    _must_be_positive(drum_diameter=drum_diameter, speed=speed, bead_diameter=bead_diameter)
    if len(profiles) != len(times):
        raise BadInput(f"drum: {len(profiles)} profiles but {len(times)} times; give one time for each profile.")
    times = np.asarray(times, dtype=np.float64)
    if len(times) > 1 and not np.all(np.diff(times) > 0):
        raise BadInput("drum: times do not rise from profile to profile; sort the profiles by time.")
    radius = drum_diameter / 2 if drum_diameter is not None else None
    return _evaluate(Observation(profiles, times, radius, bead=bead_diameter), speed, radius)


def angles_over_time(profiles: Sequence[Profile], times: Array, *, drum_diameter: float) -> tuple[Series, Series]:
    """The graphical angle (line, middle half) and the geometric one (chord) of each profile, NaN where it is not seen.

    In degrees, rising as the surface mostly does; `evaluate` takes their means over the steady part.
    """
    _must_be_positive(drum_diameter=drum_diameter)
    free = _without_wall(profiles, drum_diameter / 2)
    angles = _angles(free, _rises(free), drum_diameter / 2)
    graphical, geometric = angles[GRAPHICAL, MIDDLE], angles[GEOMETRIC, CHORD]
    return Series(times, graphical, GRAPHICAL, "deg"), Series(times, geometric, GEOMETRIC, "deg")


def surface_line(profile: Profile, window: tuple[float, float]) -> tuple[float, float, float, float] | None:
    """Slope, height at x = 0 and the ends of the least-squares line over a share of the surface's extent.

    `window` counts from the left end to the right one; None where too little of the surface is seen there.
    """
    ends = surface_ends(profile)
    if ends is None:
        return None
    low, high = (ends[0] + share * (ends[1] - ends[0]) for share in window)
    slope, offset = _line(profile, low, high)
    return (slope, offset, low, high) if math.isfinite(slope) else None


def surface_ends(profile: Profile) -> tuple[float, float] | None:
    """x where the surface begins and ends."""
    seen = np.isfinite(profile.height)
    if np.sum(seen) < 8:
        return None
    x = profile.x[seen]
    return float(x[0]), float(x[-1])


# ------------------------------------------------------------------------------------------------- record -> quantities


def _evaluate(seen: Observation, speed: float | None, radius: float | None) -> Evaluation:
    """`speed` [rad/s] and `radius` [m] of the drum, where they are known."""
    if seen.radius is not None:
        variants = {
            name: (_without_wall(one, seen.radius), _without_wall(other, seen.radius))
            for name, (one, other) in seen.variants.items()
        }
        seen = replace(seen, profiles=_without_wall(seen.profiles, seen.radius), variants=variants)
    rises = _rises(seen.profiles)
    angles = _angles(seen.profiles, rises, seen.radius)
    main = angles[GRAPHICAL, MIDDLE]
    if not np.isfinite(main).any():
        raise NothingToMeasure(
            "no profile holds the surface of a bed: heights must be finite over at least eight points of x."
        )
    first, last = steady_part(seen.times, main)
    kept = slice(first, last + 1)
    avalanches = find_avalanches(seen.times[kept], main[kept], None if speed is None else math.degrees(abs(speed)))
    varied = {
        name: [_angles(profiles, rises, seen.radius) for profiles in pair] for name, pair in seen.variants.items()
    }
    means = {
        key: mean_over_time(seen.times[kept], series[kept])
        for key, series in angles.items()
        if np.isfinite(series[kept]).sum() > 0
    }
    s_shaped = _s_shaped(means)
    quantities = []
    for key, mean in means.items():
        doubt = {
            part: _spread([_shift(other[key][kept], angles[key][kept]) for other in pair])
            for part, pair in varied.items()
        }
        quantities.append(_quantity(key, mean, doubt, seen, int(np.isfinite(angles[key][kept]).sum()), rises, s_shaped))
    warnings = []
    if isinstance(avalanches, str):
        warnings.append(f"avalanche frequency and angles: none given, for {avalanches}.")
    else:
        quantities += _of_avalanches(avalanches, quantities[0].budget)
    checks = [*_checks(seen, main, first, last, means.get((GRAPHICAL, MIDDLE)), speed), *_falls_check(quantities)]
    if speed is not None and radius is not None:
        checks.append(froude_check(speed, radius))
    quantities = [doubted(one, failed(checks, RESTS_ON)) for one in quantities]
    if last - first + 1 < len(seen.times):
        warnings.append(
            f"steady part: {seen.times[first]:.3f} s to {seen.times[last]:.3f} s; before and after it the surface lies "
            "clearly elsewhere, and these frames are left out."
        )
    return Evaluation(tuple(quantities), tuple(checks), tuple(warnings))


def _without_wall(profiles: Sequence[Profile], radius: float) -> list[Profile]:
    """Without the ends of an outline that run along the wall, as they do where the bed reaches above the axis."""
    cut = []
    for profile in profiles:
        free = np.flatnonzero(np.hypot(profile.x, profile.height) < (1 - AT_WALL) * radius)
        inner = np.zeros(len(profile.x), dtype=bool)
        if len(free):
            inner[free[0] : free[-1] + 1] = True
        cut.append(replace(profile, height=np.where(inner, profile.height, np.nan)))
    return cut


def _rises(profiles: Sequence[Profile]) -> float:
    """+1 where the surface rises to the right, -1 where it rises to the left."""
    slopes = [line[0] for line in (surface_line(profile, (0.1, 0.9)) for profile in profiles) if line is not None]
    return -1.0 if slopes and float(np.median(slopes)) < 0 else 1.0


def _angles(profiles: Sequence[Profile], rises: float, radius: float | None) -> dict[tuple[str, str], Array]:
    """Every angle [deg] by (quantity, method), one number per profile, NaN where it is not seen."""
    table: dict[tuple[str, str], list[float]] = {key: [] for key in WINDOWS}
    table[GEOMETRIC, CHORD] = []
    if radius is not None:
        table[GRAPHICAL, TANGENT] = []
    for profile in profiles:
        for key, (low, high) in WINDOWS.items():
            line = surface_line(profile, (low, high) if rises > 0 else (1 - high, 1 - low))
            table[key].append(math.nan if line is None else rises * math.degrees(math.atan(line[0])))
        table[GEOMETRIC, CHORD].append(rises * _chord(profile))
        if radius is not None:
            slope, _ = _line(profile, -TANGENT_REACH * radius, TANGENT_REACH * radius)
            table[GRAPHICAL, TANGENT].append(rises * math.degrees(math.atan(slope)))
    return {key: np.array(values) for key, values in table.items()}


def _line(profile: Profile, low: float, high: float) -> tuple[float, float]:
    """Slope and height at x = 0 of the least-squares line between two x."""
    part = np.isfinite(profile.height) & (profile.x >= low) & (profile.x <= high)
    x, height = profile.x[part], profile.height[part]
    # a line needs most of its window: half of it hidden would be another window
    if np.sum(part) < 4 or np.ptp(x) < 0.7 * (high - low):
        return math.nan, math.nan
    slope, offset = np.polyfit(x, height, 1)
    return float(slope), float(offset)


def _chord(profile: Profile) -> float:
    """Angle [deg] of the straight line between the places where the surface meets the wall."""
    ends = surface_ends(profile)
    if ends is None:
        return math.nan
    seen = np.isfinite(profile.height)
    x, height = profile.x[seen], profile.height[seen]
    reach = CHORD_ENDS * (ends[1] - ends[0])
    (ax, ay), (bx, by) = (
        (float(np.mean(x[part])), float(np.mean(height[part]))) for part in (x <= ends[0] + reach, x >= ends[1] - reach)
    )
    return math.degrees(math.atan2(by - ay, bx - ax))


def _s_shaped(means: Mapping[tuple[str, str], Mean]) -> bool:
    upper, lower = (
        next((mean for (name, _), mean in means.items() if name == wanted), None) for wanted in (UPPER, LOWER)
    )
    if upper is None or lower is None:
        return False
    apart = abs(upper.value - lower.value)
    return apart > max(S_SHAPE, 2 * math.hypot(upper.std_error, lower.std_error))


def _quantity(
    key: tuple[str, str],
    mean: Mean,
    doubt: Mapping[str, float],
    seen: Observation,
    frames: int,
    rises: float,
    s_shaped: bool,
) -> Quantity:
    name, method = key
    # neighbours that agree may all show one moment: a mean over time counts at least three moments, even in a record
    # that never comes back to its mean, so that two of them tell nothing
    moments = max(mean.independent - 2, 1.0)
    # their scatter is told by them as far as they are many, else it is the usual one
    scatter2 = ((moments - 1) * mean.deviation**2 + ONE_MOMENT**2) / moments
    budget = {"flow over time": max(mean.std_error, math.sqrt(scatter2 / moments))}
    budget |= {"camera roll" if seen.roll_seen else "camera roll, not measured": seen.roll_doubt, **doubt}
    if seen.filmed:
        budget["perspective, beads in flight"] = HALVES_DOUBT if method == WHOLE else VIEW_DOUBT[name]
    budget = {part: float(value) for part, value in budget.items() if math.isfinite(value) and value > 0}
    this_clip = root_sum_of_squares({part: value for part, value in budget.items() if part != "flow over time"})
    detail: dict[str, Detail] = {
        "turning": "anticlockwise" if rises > 0 else "clockwise",
        "standard_deviation": mean.deviation,
        "frames": frames,
        "independent_frames": round(mean.independent, 1),
        "std_uncertainty_of_this_clip": this_clip,
    }
    if name in (UPPER, LOWER):
        detail["s_shaped"] = s_shaped
    return Quantity(name, mean.value, root_sum_of_squares(budget), "deg", method, 1, detail, budget)


def _of_avalanches(found: Avalanches, budget: Mapping[str, float]) -> list[Quantity]:
    error = {"scatter of intervals": found.frequency_error}
    angle = {part: value for part, value in budget.items() if part != "flow over time"}
    angle["scatter of avalanches"] = budget.get("flow over time", 0.0)
    detail: dict[str, Detail] = {"avalanches": found.count}
    total = root_sum_of_squares(angle)
    return [
        Quantity(FREQUENCY, found.frequency, found.frequency_error, "Hz", "maxima", 1, detail, error),
        Quantity("avalanche_start_angle", found.start_angle, total, "deg", MIDDLE, 1, detail, angle),
        Quantity("avalanche_stop_angle", found.stop_angle, total, "deg", MIDDLE, 1, detail, angle),
    ]


def _checks(
    seen: Observation, main: Array, first: int, last: int, mean: Mean | None, speed: float | None
) -> list[Check]:
    count = last - first + 1
    checks = []
    if len(main) > 1:
        share = count / len(main)
        # how far is told, not judged: a film may begin long after the drum did
        turns = None if speed is None else abs(speed) * float(seen.times[last] - seen.times[first]) / (2 * math.pi)
        checks.append(
            Check(
                "steady_flow",
                share > 0.5,
                share,
                1.0,
                f"{100 * share:.0f} % of the record is steady flow, worth "
                f"{mean.independent if mean else 0:.0f} independent moments"
                f"{'' if turns is None else f' in {turns:.2g} turns'}; a longer one tells more where these are few.",
            )
        )
    measured = float(np.isfinite(main[first : last + 1]).mean())
    checks.append(
        Check(
            "surface_in_view",
            measured > 1 - SMEARED,
            measured,
            1.0,
            f"the surface was measured in {100 * measured:.0f} % of {count} frames"
            + ("." if measured > 1 - SMEARED else ": something hides it."),
        )
    )
    if len(seen.times) > 2:
        steps = np.diff(seen.times)
        odd = float(np.mean(np.abs(steps / np.median(steps) - 1) > 0.25))
        checks.append(
            Check(
                "frame_timing",
                odd < UNSTEADY,
                odd,
                0.0,
                f"{100 * odd:.0f} % of the frame intervals differ by more than a quarter from the usual one; "
                "means are taken over time, not over frames.",
            )
        )
    return checks


def _falls_check(quantities: Sequence[Quantity]) -> list[Check]:
    """Whether both halves of the surface fall the same way: beads flow down, and at a toe that hangs back level out."""
    halves = [one for one in quantities if one.quantity in (LOWER, UPPER)]
    if len(halves) < 2:
        return []
    least = min(halves, key=lambda one: one.value + SURELY_UP * one.std_uncertainty)
    passed = least.value + SURELY_UP * least.std_uncertainty > 0
    message = (
        f"the {'upper' if least.quantity == UPPER else 'lower'} half of the surface falls by {least.value:.0f} "
        f"± {least.std_uncertainty:.0f} deg"
    )
    ending = "." if passed else ", against the other half: no bed flows so; something else was taken for it."
    return [Check("surface_falls", passed, least.value, 0.0, message + ending)]


def _shift(other: Array, usual: Array) -> float:
    """How another reading moves the angle: frame by frame, so that the few frames in which it fails do not count."""
    both = np.isfinite(other) & np.isfinite(usual)
    return float(np.median(other[both] - usual[both])) if both.any() else math.nan


def _spread(changes: Sequence[float]) -> float:
    """Root mean square of the changes that the readings one standard deviation away bring."""
    known = [change for change in changes if math.isfinite(change)]
    return math.sqrt(sum(change * change for change in known) / len(known)) if known else 0.0


def _must_be_positive(**given: float | None) -> None:
    for name, value in given.items():
        if value is not None and not (math.isfinite(value) and (value > 0 or (name == "speed" and value != 0))):
            raise BadInput(f"drum: {name.replace('_', ' ')} must be positive, got {value:g}.")


# ----------------------------------------------------------------------------------------------------- media -> record


def _scale(bed: Bed, camera: Camera, drum_diameter: float | None) -> tuple[float | None, str]:
    """[m/px] of the measured picture, and where it comes from."""
    if camera.given_scale is not None:
        return camera.given_scale / bed.lens.zoom, camera.scale_from
    if drum_diameter is not None:
        return drum_diameter / (2 * bed.rim.radius), "drum diameter"
    return None, "not known"


def _observation(bed: Bed, unit: float, bead_diameter: float | None) -> Observation:
    outlines = credible(bed.outlines)
    hidden = hidden_columns(outlines)
    outlines = without_flights(outlines, bed.bead)
    half_bead = 0.25 * bed.bead

    def profiles(which: str, shorter: float = 0.0) -> list[Profile]:
        return [profile_of(outline, which, hidden, unit, shorter, bed.bead) for outline in outlines]

    variants = {"outline level": (profiles("looser"), profiles("stricter"))}
    variants["ends of the surface"] = (profiles("height", half_bead), profiles("height", 2 * half_bead))
    return Observation(
        profiles("height"),
        np.array([outline.time for outline in outlines]),
        bed.rim.radius * unit,
        variants,
        math.degrees(bed.upright.sigma),
        bed.upright.source != NOT_SEEN,
        True,
        bead_diameter or bed.bead * unit,
    )


def _runs_out(bed: Bed) -> bool:
    """Whether the surface ends where the picture does, within a bead, and not at the drum's wall."""
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
    """Whether the median outline can be the surface of flowing beads."""
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
    near = x[apart:] - x[:-apart] < 1.5 * apart  # not across what stands in front of the bed
    step = float(np.abs(height[apart:] - height[:-apart])[near].max(initial=0.0)) / bed.bead
    return [
        Check(
            "surface_shape",
            bow < MOST_BOW,
            bow,
            0.0,
            f"the surface bows by {bow:.2f} of its length"
            + ("." if bow < MOST_BOW else ": no flowing bed does; the drum itself may have been taken for the bed."),
        ),
        Check(
            "surface_steps",
            step < HIGHEST_STEP,
            step,
            0.0,
            f"from one bead to the next the surface rises by {step:.1f} bead diameters at most"
            + ("." if step < HIGHEST_STEP else ": beads cannot stand so; something is in front of them."),
        ),
    ]


def _rests_on(one: Quantity, of_picture: Sequence[Check]) -> set[str]:
    """What a number needs of the picture: how often the bed slides is seen in one that leans as well."""
    return {each.check for each in of_picture} - ({"camera_roll"} if one.quantity == FREQUENCY else set())


def _must_be_a_drum(clip: Path, checks: Sequence[Check]) -> None:
    """Refuse a film that shows neither the rim of a drum nor the surface of a bed."""
    wrong = {each.check: each for each in checks if each.passed is False}
    if {"rim_found", "surface_shape"} <= set(wrong):
        raise NothingToMeasure(
            f"{clip}: no turning drum is seen: what moves has no round rim about it, and its upper border bows by "
            f"{wrong['surface_shape'].value:.2f} of its length, as no flowing bed does; film the drum's end, the whole "
            "rim in view."
        )


def _checks_of_picture(bed: Bed, still: Check | str) -> list[Check]:
    seen = [outline.area for outline in bed.outlines if not outline.hidden]
    areas = np.array(seen if 2 * len(seen) >= len(bed.outlines) else [outline.area for outline in bed.outlines])
    swing = float(np.std(areas) / max(float(np.mean(areas)), 1.0))
    fill = float(np.median(areas) / (math.pi * bed.rim.radius**2))
    checks = [
        Check(
            "rim_found",
            bed.rim_seen,
            bed.rim.support,
            1.0,
            f"an edge was seen along {100 * bed.rim.support:.0f} % of the drum's circle."
            if bed.rim_seen
            else "the drum's rim shows no edge; its circle was laid through the lower border of the bed.",
        ),
        fill_check(fill, "the bed fills"),
        *_checks_of_shape(bed),
        *([still] if isinstance(still, Check) else []),
    ]
    whole = not _runs_out(bed)
    ending = "inside the picture." if whole else "at the picture's edge: its line is of a part; film the whole drum."
    checks.append(Check("bed_in_view", whole, float(whole), 1.0, f"the bed's surface ends {ending}"))
    checks += upright_checks(bed.upright)
    if math.isfinite(bed.glare):
        checks.append(
            Check(
                "even_light",
                bed.glare < GLARE,
                bed.glare,
                0.0,
                f"light lies over {100 * bed.glare:.0f} % of the surface, brighter than elsewhere"
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
