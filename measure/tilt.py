"""A plate is tilted until a body on it slides or rolls: friction from the angle at the onset.

Hlosta et al. 2020, eqs. 3 and 4: mu = tan(alpha) where motion begins.

`measure` turns a clip into the plate's angle and the body's track, `evaluate` does the rest for any such record, filmed
or simulated.  The onset is found by running the body's motion back to rest (`measure.onset`), not by a threshold.

A track is fixed in space, its origin on the axis about which the plate turns: x points to where the plate rises, y up.
The angle is that of the plate against the horizontal, positive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.lab.camera import Camera
from rigtwin.lab.content import sha256
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Evaluation, Measurement, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Series, Track
from rigtwin.measure.arm import LEAST_TURN, Arm, find_arm, lay_over
from rigtwin.measure.exposure import DIMMEST
from rigtwin.measure.follow import learn_scene
from rigtwin.measure.in_front import in_front
from rigtwin.measure.in_view import camera_by_scene
from rigtwin.measure.level import Level, find_level
from rigtwin.measure.media import UNSTEADY, Video, open_video
from rigtwin.measure.onset import (
    FACTOR,
    LEAST_DOUBT,
    USUAL_DRIFT,
    Onset,
    Run,
    Variant,
    Way,
    find_onset,
    find_run,
    jitter,
)
from rigtwin.measure.passenger import FEWEST, SATURATED, Arrival, Passenger, Step, find_passenger, follow, glare
from rigtwin.measure.repeats import at_its_pace
from rigtwin.measure.scene import Background, Pose, Scene
from rigtwin.measure.starved import compression_check
from rigtwin.measure.stated_roll import roll_check
from rigtwin.measure.tilt_checks import BEGIN_EARLIER, LEAST_REST, checks_of
from rigtwin.measure.turning import gaps_by_run, gaps_by_turn

FRICTION = {"slide": "static_friction", "roll": "rolling_friction"}
PERSPECTIVE = math.radians(0.02)  # a plate that is not quite parallel to the picture
GIVEN_ROLL = math.radians(0.1)  # standard uncertainty of a stated camera roll
MOVED = 0.08  # [px], how far a body that has left the pixels on which it rested lies off its picture
AT_REST = 0.1  # [px], within which it has not left them
NO_LEVEL = math.radians(1.0)  # standard uncertainty of a camera roll that nothing tells
GIVEN_DOUBT = 0.02  # relative, of a scale read off a length in view, or of a record that somebody tracked
BEAD_DOUBT = 0.12  # relative, of a scale from the outline of a body on the plate
CLUMP = 2.3  # length over height of a body on the plate, from which on it is no single bead, smeared by what it crept
WRONG_SCALE = 0.3  # relative misfit of the acceleration from which on the scale is not believed
STARVED = 0.006  # bits per pixel, below which a film in which so little moves leaves out what is faint
MOSTLY = 0.8  # of the frames before the onset, in which a missing one must show to be told
MOST_WHITE = 0.25  # of the picture: more is no highlight
NOMINAL = 3e-4  # [m/px], where no scale is known: only a unit
# checks that every number rests on
BEHIND_ALL = {
    "variant",
    "creep",
    "steady_rise",
    "run_residuals",
    "rest_seen",
    "picture_at_rest",
    "onset_certainty",
    "shape",
    "arm_in_view",
    "static_camera",
}
ANGLES_ON = {"level", "camera_roll", "proportions"}
# and those that it rests on besides: an angle needs no clock and no scale, a moment no horizontal
RESTS_ON = {
    "static_friction": BEHIND_ALL | ANGLES_ON,
    "static_friction_angle": BEHIND_ALL | ANGLES_ON,
    "rolling_friction": BEHIND_ALL | ANGLES_ON,
    "rolling_friction_angle": BEHIND_ALL | ANGLES_ON,
    "onset_time": BEHIND_ALL | {"gravity", "frame_timing", "compression"},
    "kinetic_friction": BEHIND_ALL | {"gravity", "frame_timing"} | ANGLES_ON,
}


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate(
    angle: Series, tracks: Sequence[Track], *, variant: Variant, bead_diameter: float | None = None
) -> Evaluation:
    """Friction and its angle at the onset of motion, with the time of the onset.

    `angle` is the plate's angle against the horizontal over time ("rad" or "deg"); `tracks` hold the body, or the
    bodies of one rigid clump, fixed in space with the origin on the plate's axis.  Raises `NothingToMeasure` when
    nothing starts to move.
    """
    _check_variant(variant)
    way = _way(angle, tracks, variant, bead_diameter, scale_doubt=GIVEN_DOUBT)
    run, onset = _onset(way, "the record")
    return _evaluation(way, run, onset, variant, bead_diameter)


def _check_variant(variant: str) -> None:
    if variant not in FRICTION:
        raise BadInput(f"measure tilt: variant {variant!r} is unknown; give 'slide' or 'roll'.")


def _way(
    angle: Series, tracks: Sequence[Track], variant: Variant, bead_diameter: float | None, scale_doubt: float
) -> Way:
    """How far the body came down the plate: its track turned back by the plate's angle."""
    if not tracks:
        raise BadInput("measure tilt: the record holds no track of the body; give one beside the angle.")
    if any(len(track.time) == 0 for track in tracks):
        raise NothingToMeasure(
            "measure tilt: what is on the plate is seen in no frame together with the plate's angle; is this a clip of "
            "a tilting plate, with the body in view?"
        )
    turned = np.radians(angle.value) if angle.unit == "deg" else np.asarray(angle.value)
    known = np.isfinite(turned) & np.isfinite(angle.time)
    if known.sum() < 8:
        raise NothingToMeasure(
            f"measure tilt: the plate's angle is known in only {int(known.sum())} frames; is this a clip of a tilting "
            "plate, seen from the side, and light enough?"
        )
    time = tracks[0].time
    ways, sigmas = [], []
    alpha = np.interp(time, angle.time[known], turned[known], left=np.nan, right=np.nan)
    for track in tracks:
        x = np.interp(time, track.time, track.position[:, 0])
        y = np.interp(time, track.time, track.position[:, 1])
        up = x * np.cos(alpha) + y * np.sin(alpha)
        ways.append(-(up - np.nanmedian(up[: max(3, len(up) // 20)])))
        sigmas.append(np.interp(time, track.time, track.sigma))
    seen = np.isfinite(alpha) & np.all(np.isfinite(ways), axis=0)
    if seen.sum() < 8:
        raise NothingToMeasure(
            f"measure tilt: body and angle are known together in only {int(seen.sum())} frames; "
            "give records that overlap in time."
        )
    return Way(
        time[seen],
        alpha[seen],
        np.mean(ways, axis=0)[seen],
        np.mean(sigmas, axis=0)[seen],
        FACTOR[variant],
        scale_doubt,
        bead_diameter or USUAL_DRIFT,
        float(np.median([np.hypot(track.position[0, 0], track.position[0, 1]) for track in tracks])),
    )


def _onset(way: Way, whose: str) -> tuple[Run, Onset]:
    run = find_run(way)
    if run is None:
        first, last = (math.degrees(angle) for angle in (way.angle[0], way.angle[-1]))
        if abs(last - first) < math.degrees(LEAST_TURN):
            raise NothingToMeasure(
                f"{whose}: what is taken for the body is seen only while the plate stands at {first:.1f} degrees, and "
                "stays where it is; is the clip whole, sharp and one of a tilting plate?"
            )
        rises = last > first
        advice = "film on until it has run down the plate." if rises else "is the clip played backwards?"
        raise NothingToMeasure(
            f"{whose}: the body stays where it is while the plate {'rises' if rises else 'sinks'} from {first:.1f} to "
            f"{last:.1f} degrees; {advice}"
        )
    onset = find_onset(way, run)
    if onset is not None and math.isfinite(way.scale_doubt) and abs(onset.gain - 1) > WRONG_SCALE:
        # a scale that far off must not pull the onset along: let the run tell its own
        onset = find_onset(replace(way, scale_doubt=math.inf), run)
    if onset is None:
        raise NothingToMeasure(
            f"{whose}: the body is already moving, or hardly seen, when it starts down the plate at "
            f"{way.time[run.start]:.3f} s; let the clip begin at least 0.2 s before and end after the run."
        )
    return run, onset


def _evaluation(
    way: Way,
    run: Run,
    onset: Onset,
    variant: Variant,
    bead_diameter: float | None,
    geometry: Mapping[str, float] | None = None,
    timing: Mapping[str, float] | None = None,
) -> Evaluation:
    """`geometry` and `timing` hold what a film adds to the doubt of the angle [rad] and of the time [s]."""
    geometry = geometry or {}
    judged = checks_of(way, onset, variant, bead_diameter)
    checks = tuple(each for each in judged if isinstance(each, Check))
    name = FRICTION[variant]
    budget = {"onset": onset.angle_sigma, **geometry}
    slope = 1 + math.tan(onset.angle) ** 2
    degrees = {part: math.degrees(value) for part, value in budget.items()}
    tangent = {part: slope * value for part, value in budget.items()}
    quantities = [
        _quantity(name, math.tan(onset.angle), "1", tangent),
        _quantity(f"{name}_angle", math.degrees(onset.angle), "deg", degrees),
        _quantity("onset_time", onset.time, "s", {"onset": onset.time_sigma, **(timing or {})}),
    ]
    if variant == "slide" and math.isfinite(way.scale_doubt):
        # the acceleration, which the friction of the moving body falls short of the slope by, goes with the scale
        scale = min(way.scale_doubt, LEAST_DOUBT) * abs(math.tan(onset.angle) - onset.moving_friction)
        turned = {part: slope * value for part, value in geometry.items()}
        moving = {"acceleration": onset.moving_sigma, "scale": scale, **turned}
        quantities.append(
            Quantity(
                "kinetic_friction",
                onset.moving_friction,
                root_sum_of_squares(moving),
                "1",
                "acceleration",
                budget=moving,
            )
        )
    warnings = tuple(each for each in judged if isinstance(each, str))
    return Evaluation(_judged(quantities, checks), checks, warnings)


def _judged(quantities: Sequence[Quantity], checks: Sequence[Check]) -> tuple[Quantity, ...]:
    return tuple(doubted(quantity, failed(checks, RESTS_ON[quantity.quantity])) for quantity in quantities)


def _quantity(name: str, value: float, unit: str, budget: dict[str, float]) -> Quantity:
    return Quantity(name, value, root_sum_of_squares(budget), unit, "onset", budget=budget)


# ---------------------------------------------------------------------------------------------------- media -> record


@dataclass(frozen=True)
class Film:
    """Arm and body followed through a clip; directions and shifts as the picture shows them."""

    arm: Arm
    level: Level | None
    body: Passenger
    frames: npt.NDArray[np.int64]  # frame numbers, shape (n,)
    times: Array  # [s], shape (n,)
    directions: Array  # [rad], of the arm in the picture, NaN where it is not seen, shape (n,)
    sigmas: Array  # [rad], of the directions
    steps: tuple[Step | None, ...]  # the body against its place at rest
    poses: tuple[Pose, ...]  # of the frames over the still scene
    uphill: int  # +1 where the arm rises to the right
    picture: FloatImage = field(repr=False)  # the still scene
    missing: npt.NDArray[np.int64]  # frames that the film lacks before each, shape (n,)
    told: npt.NDArray[np.bool_]  # whether the plate turns so far that one which is missing stands out, shape (n,)
    repeated: int = 0  # frames of the run that repeat the one before and put off all that follow
    lost_in_run: int = 0  # frames that are missing there by how far the body moves, and not by the plate's turn


@dataclass(frozen=True)
class Horizontal:
    """How the horizontal runs through the picture at the arm's height."""

    roll: float  # [rad], positive where it falls to the right
    sigma: float  # [rad], one standard deviation
    source: str
    seen: tuple[float, float] | None  # [rad], that of the base plate's edges and its standard deviation


@dataclass(frozen=True)
class Gauge:
    """Scale and horizontal."""

    scale: float  # [m/px]
    doubt: float  # relative standard uncertainty; infinite without a scale
    source: str
    level: Horizontal


def measure(
    clip: Path,
    camera: Camera,
    *,
    variant: Variant,
    bead_diameter: float | None = None,
    arm_length: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip of a tilting plate with a body on it.

    `bead_diameter` [m] or `arm_length` [m, hinge to tip] give the scale, which only the acceleration check and the
    kinetic friction need; the angle needs none.  The base plate under the arm is taken to be level, unless the
    camera's roll is given.  Raises `NothingToMeasure` when no straight arm turns or nothing moves on it.
    """
    _check_variant(variant)
    video = at_its_pace(open_video(clip, camera), progress)
    film = _watch(video, camera, progress)
    gauge = _gauge(film, camera, bead_diameter, arm_length)

    def read(film: Film, gauge: Gauge) -> tuple[Series, Track, Way, Run, Onset]:
        angle, track = _record(film, gauge)
        way = _way(angle, [track], variant, bead_diameter, gauge.doubt)
        return angle, track, way, *_onset(way, str(clip))

    angle, track, way, run, onset = read(film, gauge)
    by_turn_alone, film = film, _by_the_run(film, way, run, onset, video)
    if np.any(film.missing != by_turn_alone.missing):
        angle, track, way, run, onset = read(film, gauge)
    if not math.isfinite(gauge.doubt):
        # only now, for it hangs on the square of all times
        gauge = replace(gauge, scale=gauge.scale / onset.gain, source="gravity")
        angle, track, way, run, onset = read(film, gauge)
    geometry = {
        "level": gauge.level.sigma,
        "arm": max(film.arm.tilt_sigma, float(np.nanmedian(film.sigmas))),
        "perspective": PERSPECTIVE,
    }
    # an exposure lasts up to a frame, and a time stamp tells its start
    timing = {"exposure": 0.2 / video.frame_rate}
    if put_right := int(np.sum(film.missing[film.times <= onset.time] > 0)):
        # a jerk of the plate looks like a frame that is missing
        timing["missing frames"] = 0.5 * math.sqrt(put_right) / video.frame_rate
    evaluation = _evaluation(way, run, onset, variant, bead_diameter, geometry, timing)
    still = camera_by_scene(film.poses)
    of_film = (
        _shape_check(film.body, variant),
        *_portrait_check(film, onset),
        *_view_checks(film, gauge, video, onset),
        compression_check(video, STARVED),
        *([still] if isinstance(still, Check) else []),
    )
    checks = (*evaluation.checks, *of_film)
    quantities = _judged([doubted(each, video.spoilt) for each in evaluation.quantities], of_film)
    measurement = Measurement(
        rig="tilt",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=(*video.warnings, *evaluation.warnings, *([still] if isinstance(still, str) else [])),
        camera={
            "frame_rate_hz": video.frame_rate,
            "playback_rate_hz": video.playback_rate,
            "scale_m_per_px": gauge.scale,
            "scale_from": gauge.source,
            "camera_roll_deg": math.degrees(gauge.level.roll),
            "camera_roll_std_deg": math.degrees(gauge.level.sigma),
            "camera_roll_from": gauge.level.source,
        },
        tracks=(track,),
        series=(angle,),
    )
    if out is None:
        return measurement
    from rigtwin.measure.tilt_pictures import write_pictures

    return replace(measurement, files=write_pictures(out, measurement, video, film, way, onset, angle, progress))


def _watch(video: Video, camera: Camera, progress: Progress) -> Film:
    learnt = learn_scene(video)
    scene = learnt.scene()
    stack = np.stack(list(_laid_over(scene, learnt).values()))
    moved = np.percentile(stack, 90, axis=0) - np.percentile(stack, 10, axis=0)
    still = moved < 6 * float(np.median(moved)) + 6
    # of a scene with few edges of its own the arm as it turns would pull the frames along
    scene = replace(scene, moving=~still)
    samples = _laid_over(scene, learnt)
    progress("looking for the arm", 0, 1)
    arm = find_arm(samples)
    if arm is None or not arm.edges:
        raise NothingToMeasure(
            f"{video.path}: {_poorly_lit(samples)}no straight arm turns by {math.degrees(LEAST_TURN):.1f} degrees or "
            "more in the clip; film the plate from the side with a still camera, from before the tilt to after the run."
        )
    lowest = arm.pivot[1] + max(edge.row for edge in arm.edges) + 4
    level = find_level(scene.picture, still, lowest, arm.converging)
    horizontal = 0.0 if level is None else level.slope
    usual = float(np.median(list(arm.directions.values()))) + arm.tilt
    uphill = 1 if usual < horizontal else -1
    body = find_passenger(arm, samples, uphill, glare(scene.picture) | in_front(arm, still))
    if body is None:
        raise NothingToMeasure(
            f"{video.path}: {_poorly_lit(samples)}an arm turns, but nothing is seen to rest on its upper side at first "
            "and to have left its place at the end; film on until the body has slid or rolled down, in contrast."
        )
    if isinstance(body, Arrival):
        raise NothingToMeasure(
            f"{video.path}: what comes down the plate by {video.times[body.frame]:.3f} s is not seen at rest before: "
            f"it moves in the first pictures already. {BEGIN_EARLIER}"
        )
    return _follow(video, scene, arm, level, body, uphill, progress)


def _poorly_lit(samples: Mapping[int, FloatImage]) -> str:
    """What is wrong with the pictures themselves, as the beginning of a sentence; empty where nothing is."""
    blank = sum(float(np.ptp(np.percentile(picture, (0.5, 99.5)))) < DIMMEST for picture in samples.values())
    if blank:
        rest = "in what remains " if blank < len(samples) else ""
        return f"{blank} of {len(samples)} pictures looked at show nothing but one brightness; {rest}"
    # a film's brightness often ends at 235
    white = float(np.mean([np.mean(picture >= max(picture.max() - 3, SATURATED)) for picture in samples.values()]))
    return f"{100 * white:.0f} % of the picture is white, overexposed; " if white > MOST_WHITE else ""


def _laid_over(scene: Scene, learnt: Background) -> dict[int, FloatImage]:
    return {number: scene.view(frame).grey for number, frame in learnt.samples().items()}


def _follow(
    video: Video, scene: Scene, arm: Arm, level: Level | None, body: Passenger, uphill: int, progress: Progress
) -> Film:
    """Arm and body in every frame, each predicted from the frames before."""
    numbers, directions, sigmas, steps, poses = [], [], [], [], []
    shake = (0.0, 0.0)
    known = sorted(arm.directions)
    sampled = np.array([arm.directions[n] for n in known])
    place, speed, lost = np.zeros(2), 0.0, 0
    usual, before = float(np.median(np.diff(video.times))), math.nan
    for frame in video.frames():
        # where frames are missing it goes as much further
        lasts = 1.0 if math.isnan(before) else (video.times[frame.index] - before) / usual
        before = video.times[frame.index]
        view = scene.view(frame.grey, shake)
        shake = view.shake
        guess = float(np.interp(frame.index, known, sampled))
        turn = lay_over(arm, view.grey, guess, reach=6)
        direction = guess if turn is None else turn.direction
        step = None
        if lost < 20:
            # downhill it may speed up by a good part of its size from frame to frame
            expected = place + np.array([speed * lasts, 0.0])
            step = follow(arm, body, view.grey, direction, expected.tolist(), 1.0)
            if step is None or abs(speed) > 1.0 or abs(step.along - place[0]) > 1.0:
                reach = 6.0 + 0.6 * abs(speed) * lasts + 1.5 * lost
                wide = follow(arm, body, view.grey, direction, expected.tolist(), reach)
                if wide is None or step is None or wide.likeness > step.likeness + 0.01:
                    step = wide if wide is not None else step
            if step is not None:
                moved = (step.along - place[0]) / max(lasts, 0.5)
                speed = moved if abs(moved) > 0.5 else 0.0
                place, lost = np.array([step.along, step.across]), 0
            elif frame.index > body.rests[-1]:
                lost += 1
                place = expected
        numbers.append(frame.index)
        directions.append(math.nan if turn is None else turn.direction)
        sigmas.append(math.nan if turn is None else turn.sigma)
        steps.append(step)
        poses.append(view.pose)
        progress("following arm and body", frame.index - video.first + 1, video.last - video.first + 1)
    index = np.array(numbers)
    gaps = gaps_by_turn(video.times[index], np.array(directions))
    return Film(
        arm,
        level,
        body,
        index,
        video.times[index] + np.cumsum(gaps.missing) / video.frame_rate,
        np.array(directions),
        np.array(sigmas),
        tuple(steps),
        tuple(poses),
        uphill,
        scene.picture,
        gaps.missing,
        gaps.told,
    )


def _by_the_run(film: Film, way: Way, run: Run, onset: Onset, video: Video) -> Film:
    """The film with the frames that are missing by the body's run where that tells, and else by the plate's turn."""
    first = int(np.searchsorted(way.time, onset.time))
    rest = float(np.median(way.down[max(first - LEAST_REST, 0) : first + 1]))
    frames = np.searchsorted(film.times, way.time[first : run.end])
    raw = video.times[film.frames]
    gaps = gaps_by_run(raw[frames], way.down[first : run.end] - rest, way.sigma[first : run.end])
    lost = np.maximum(gaps.missing, 0)
    missing = film.missing.copy()
    missing[frames[gaps.told]] = lost[gaps.told]
    return replace(
        film,
        missing=missing,
        times=raw + np.cumsum(missing) / video.frame_rate,
        repeated=int(np.sum(gaps.missing < 0)),
        lost_in_run=int(lost[film.missing[frames] == 0].sum()),
    )


def _gauge(film: Film, camera: Camera, bead_diameter: float | None, arm_length: float | None) -> Gauge:
    level = _horizontal(film, camera)
    if camera.given_scale is not None:
        doubt = camera.scale_doubt(GIVEN_DOUBT)
        return Gauge(camera.given_scale, doubt, camera.scale_from, level)
    if arm_length is not None:
        tip = film.arm.span[1] if film.uphill > 0 else -film.arm.span[0]
        # the arm's front is nearer to the camera than the body on its middle
        return Gauge(arm_length / tip, 0.05, "arm length", level)
    if bead_diameter is not None:
        # a clump is one bead high; what glare leaves of its picture has notches, which no circle may be fitted between
        return Gauge(bead_diameter / film.body.size[1], BEAD_DOUBT, "bead diameter", level)
    return Gauge(NOMINAL, math.inf, "not known", level)


def _horizontal(film: Film, camera: Camera) -> Horizontal:
    """The horizontal at the arm's height in the picture."""
    usual = float(np.nanmedian(film.directions)) if np.any(np.isfinite(film.directions)) else 0.0
    x, y = (film.picture.shape[1] - 1) / 2, (film.picture.shape[0] - 1) / 2
    # an edge that runs through the picture's middle is seen at its own slope, wherever the camera looks
    row = y + (film.arm.pivot[1] - y) * math.cos(usual) - (film.arm.pivot[0] - x) * math.sin(usual)
    seen = None if film.level is None else film.level.at(row)
    if camera.roll is not None:
        # where the picture shows another horizontal, either may be right: a bench may slope, a reading may be off
        apart = 0.0 if seen is None else abs(camera.roll - seen[0])
        return Horizontal(camera.roll, math.hypot(GIVEN_ROLL, apart / 2), "given", seen)
    if seen is None:
        return Horizontal(0.0, NO_LEVEL, "not known", None)
    return Horizontal(*seen, "base plate", seen)


def _shape_check(body: Passenger, variant: Variant) -> Check:
    """Whether the body can do what is stated: beads glued together do not roll."""
    ratio = body.size[0] / body.size[1]
    passed = variant == "slide" or ratio < CLUMP
    ending = "." if passed else ": it is no single bead, so that it slides; give --variant slide."
    return Check("shape", passed, ratio, 1.0, f"the body is {ratio:.1f} times as long as high{ending}")


def _portrait_check(film: Film, onset: Onset) -> tuple[Check, ...]:
    """Whether the body rests in the frames of which its picture at rest is made, where it does not."""
    body = film.body
    resting = int(np.sum(film.times[np.isin(film.frames, body.rests)] < onset.time))
    if resting >= max(FEWEST, len(body.rests) / 2):
        return ()
    message = (
        f"of the {len(body.rests)} frames that show the body at its first place only {resting} are before the onset: "
        f"too little of its rest is seen. {BEGIN_EARLIER}"
    )
    return (Check("picture_at_rest", False, float(resting), float(FEWEST), message),)


def _record(film: Film, gauge: Gauge) -> tuple[Series, Track]:
    """The plate's angle, and the body's track in metres about the axis."""
    sign = film.uphill
    angle = -sign * (film.directions + film.arm.tilt - gauge.level.roll)
    seen = np.array([step is not None for step in film.steps]) & np.isfinite(angle)
    kept = [step for step in film.steps if step is not None]
    both = np.array([step is not None for step in film.steps])
    along = np.full(len(both), np.nan)
    across = np.full(len(both), np.nan)
    sigma = np.full(len(both), np.nan)
    along[both] = [film.body.centre[0] + step.along for step in kept]
    across[both] = [film.body.centre[1] + step.across for step in kept]
    sigma[both] = [step.sigma for step in kept]
    sigma = np.hypot(sigma, _wander(along - film.body.centre[0]))
    up, high = sign * along[seen] * gauge.scale, -across[seen] * gauge.scale
    cos, sin = np.cos(angle[seen]), np.sin(angle[seen])
    position = np.column_stack([up * cos - high * sin, up * sin + high * cos])
    series = Series(film.times[np.isfinite(angle)], angle[np.isfinite(angle)], "plate_angle", "rad")
    return series, Track(film.times[seen], position, sigma[seen] * gauge.scale, "body")


def _wander(moved: Array) -> Array:
    """[px], doubt of the place of a body that has moved off the pixels it rested on by `moved` [px].

    It lies over its picture to a part of a pixel only, and all along one pixel wrong alike: the many frames in which it
    is slow tell no more than one.
    """
    moved = np.maximum(np.abs(moved) - max(AT_REST, 4 * jitter(moved)), 0.0)
    near = np.sort(moved[np.isfinite(moved)])
    alike = np.searchsorted(near, moved + 0.5) - np.searchsorted(near, moved - 0.5)
    return np.asarray(MOVED * np.minimum(moved, 1.0) * np.sqrt(np.maximum(alike, 1)))


def _view_checks(film: Film, gauge: Gauge, video: Video, onset: Onset) -> tuple[Check, ...]:
    seen = float(np.mean(np.isfinite(film.directions)))
    arm = Check(
        "arm_in_view",
        seen > 0.8,
        seen,
        1.0,
        f"the plate's edges are found in {100 * seen:.0f} % of the frames"
        + ("." if seen > 0.8 else ": something hides them; keep hands and cables out of the view."),
    )
    return arm, _timing_check(film, video, onset), _level_check(gauge.level, len(film.level.lines) if film.level else 0)


def _timing_check(film: Film, video: Video, onset: Onset) -> Check:
    """Whether the frames follow each other as their times say, as far as plate and body show."""
    steps = np.diff(video.times[video.first : video.last + 1])
    odd = int(np.sum(np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)))
    message = f"{odd} of {len(steps)} frame intervals are odd" + ("; the file's own times were used" if odd else "")
    if lost := int(film.missing.sum()):
        at = film.times[film.missing > 0]
        by = {0: "the plate turns", lost: "the body moves"}.get(film.lost_in_run, "plate and body move")
        message += (
            f"; {lost} more {'is' if lost == 1 else 'are'} missing by how far {by} at {at[0]:.3f} s"
            f"{'' if len(at) == 1 else f' and {len(at) - 1} times after'}, and the times were put right"
        )
    told = film.told[film.times < onset.time]
    seen = float(np.mean(told)) if len(told) else 0.0
    hidden = (
        f"in {100 * (1 - seen):.0f} % of the frames before the onset the plate turns too little to show a missing one"
    )
    passed = False
    if doubled := film.repeated:
        ending = (
            f", but in the run {doubled} frame{'' if doubled == 1 else 's'} just like the one before put off "
            "what follows, so that times come out too long: use the camera's original file."
        )
    elif film.lost_in_run:
        # what the plate's turn does not show there it need not show before the onset
        ending = ", but others may be before the onset, where only the plate moves: use the camera's original file."
    elif odd >= UNSTEADY * len(steps):
        ending = ", but so many may be wrong: use the camera's original file."
    else:
        passed, ending = True, "." if seen >= MOSTLY else f"; {hidden}."
    return Check("frame_timing", passed, float(odd), 0.0, message + ending)


def _level_check(level: Horizontal, edges: int) -> Check:
    """Whether the horizontal is known, and a stated one is that of the base plate."""
    degrees, doubt = math.degrees(level.roll), math.degrees(level.sigma)
    if level.source == "not known":
        message = "no level edge of a base plate is seen, so the camera is taken to be upright; give --camera-roll."
        return Check("level", False, 0.0, 0.0, message)
    if level.source == "given" and level.seen is not None:
        return roll_check(level.roll, *level.seen, f"{edges} level edges of the base plate run at")
    where = "as given" if level.source == "given" else f"from {edges} level edges"
    message = f"the horizontal runs at {degrees:+.2f} ± {doubt:.2f} deg in the picture, {where}."
    return Check("level", True, degrees, 0.0, message)
