"""Follow plate and body through a tilt film, and find scale and horizontal (media to record)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.lab.camera import Camera, Line, Point
from rigtwin.lab.errors import Mark, NothingToMeasure, Seen
from rigtwin.lab.progress import Progress
from rigtwin.lab.records import Series, Track
from rigtwin.measure.geometry.horizon import Level, find_level
from rigtwin.measure.media.video import Video
from rigtwin.measure.scene.background import Background, learn_scene
from rigtwin.measure.scene.contrast_stretch import DIMMEST
from rigtwin.measure.scene.pose import Pose
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tilt.body_track import SATURATED, Arrival, RestingBody, Step, find_body, follow, glare
from rigtwin.measure.tilt.checks import LEAST_REST
from rigtwin.measure.tilt.evaluate import NEARBY_LENGTH_UNCERTAINTY, NOMINAL
from rigtwin.measure.tilt.incline import LEAST_FRAMES
from rigtwin.measure.tilt.lost_frames import gaps_by_run, gaps_by_turn
from rigtwin.measure.tilt.occluders import in_front
from rigtwin.measure.tilt.onset import (
    LEAST_TURN,
    Onset,
    Run,
    Way,
    jitter,
)
from rigtwin.measure.tilt.plate_angle import STATED_REACH, Arm, arm_at_rest, find_arm, in_arm, lay_over
from rigtwin.measure.tracking.find_paths import find_paths
from rigtwin.measure.tracking.link import SpotPath
from rigtwin.measure.tracking.stated_centres import contradictions, stated_centres

PERSPECTIVE = math.radians(0.02)  # standard uncertainty for a plate that is not quite parallel to the picture

GIVEN_ROLL = math.radians(0.1)  # standard uncertainty of a stated camera roll

MOVED = 0.08  # [px], registration error of a body that has left the pixels on which it rested

AT_REST = 0.1  # [px], displacement up to which it has not left them

MOST_LOST = 20  # frames without the body after which it is looked for no more, unless its centre is stated

NO_LEVEL = math.radians(1.0)  # standard uncertainty of an unknown camera roll

BEAD_UNCERTAINTY = 0.12  # relative standard uncertainty of a scale from the outline of a body on the plate

MOST_WHITE = 0.25  # share of white pixels beyond which the picture is overexposed: more is no highlight

NOT_STRAIGHT = 0.1  # largest scatter across a body's path over that along it: it does not fly


# ---------------------------------------------------------------------------------------------------- media -> record


@dataclass(frozen=True)
class Film:
    """Arm and body followed through a clip, in picture coordinates."""

    arm: Arm
    level: Level | None
    body: RestingBody
    frames: npt.NDArray[np.int64]  # frame numbers, shape (n,)
    times: Array  # [s], shape (n,)
    directions: Array  # [rad], of the arm in the picture, NaN where it is not seen, shape (n,)
    sigmas: Array  # [rad], of the directions
    steps: tuple[Step | None, ...]  # displacement of the body from its position at rest
    poses: tuple[Pose, ...]  # of the frames relative to the still scene
    uphill: int  # +1 where the arm rises to the right
    picture: FloatImage = field(repr=False)  # the still scene
    missing: npt.NDArray[np.int64]  # frames missing before each frame, shape (n,)
    shown: npt.NDArray[np.bool_]  # whether the plate turns far enough to show a missing frame, shape (n,)
    repeated: int = 0  # frames of the run that repeat the one before and delay all that follow
    lost_in_run: int = 0  # frames of the run that are missing by the motion of the body, but not by the plate's turn
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Horizontal:
    """Direction of the horizontal in the picture at the arm's height."""

    roll: float  # [rad], positive if it falls to the right
    sigma: float  # [rad], standard uncertainty
    source: str
    seen: tuple[float, float] | None  # [rad], direction of the base plate's edges and its standard uncertainty


@dataclass(frozen=True)
class Gauge:
    """Scale and horizontal."""

    scale: float  # [m/px]
    uncertainty: float  # relative standard uncertainty; infinite without a scale
    source: str
    level: Horizontal


def observe_film(video: Video, camera: Camera, progress: Progress) -> Film:
    """Find arm and body and follow them through the clip.

    Raises `NothingToMeasure` if no straight arm turns, or no body rests on it first and leaves later.
    """
    centres = stated_centres(video, camera)
    learnt = learn_scene(video)
    scene = learnt.scene()
    stack = np.stack(list(_registered_samples(scene, learnt).values()))
    moved = np.percentile(stack, 90, axis=0) - np.percentile(stack, 10, axis=0)
    still = moved < 6 * float(np.median(moved)) + 6
    # in a scene with few edges the turning arm would bias the camera pose
    scene = replace(scene, moving=~still)
    samples = _registered_samples(scene, learnt)
    progress("looking for the arm", 0, 1)
    arm = find_arm(samples, camera.plate)
    if arm is None or not arm.edges:
        line = camera.plate or line_of_motion(find_paths(video, scene, camera.region, progress).paths)
        arm = None if line is None else arm_at_rest(samples, line)
    if (arm is None or not arm.edges) and camera.plate is not None:
        raise NothingToMeasure(
            f"{video.path}: no straight edge is found within {STATED_REACH:g} px of --plate (frames {video.first} to "
            f"{video.last}); state two points of the plate's surface as it is in the first frame.",
            Seen(frame=video.first),
        )
    if arm is None or not arm.edges:
        raise NothingToMeasure(
            f"{video.path}: {_exposure_in_words(samples)}no straight edge that turns by {math.degrees(LEAST_TURN):.1f} "
            f"degrees or more was found in {len(samples)} pictures from frame {video.first} to {video.last}, and "
            "nothing that moves along an edge at rest; film the plate from the side with a still camera, or state its "
            "surface with --plate x1,y1,x2,y2.",
            Seen(frame=video.first),
        )
    lowest = arm.pivot[1] + max(edge.row for edge in arm.edges) + 4
    level = find_level(scene.picture, still, lowest, arm.converging)
    horizontal = 0.0 if level is None else level.slope
    usual = float(np.median(list(arm.directions.values()))) + arm.tilt
    uphill = 1 if usual < horizontal else -1
    seed = camera.bead_at and replace(camera.bead_at, frame=video.frame_of(camera.bead_at.frame))
    body = find_body(arm, samples, uphill, glare(list(samples.values())) | in_front(arm, still), seed)
    if body is None and camera.bead_at is not None:
        x, y = camera.bead_at.at
        raise NothingToMeasure(
            f"{video.path}: what is at --bead-at {camera.bead_at.frame}:{x:g},{y:g} does not leave its place on the "
            f"plate in frames {video.first} to {video.last}; state the body's centre in a frame in which it rests.",
            _arm_seen(arm, video.frame_of(camera.bead_at.frame)),
        )
    if body is None and camera.plate is not None:
        raise NothingToMeasure(
            f"{video.path}: nothing is seen that rests on the edge at --plate at first and leaves its place in frames "
            f"{video.first} to {video.last}; state two points of the plate's surface as it is in the first frame.",
            _arm_seen(arm, video.first),
        )
    if body is None:
        raise NothingToMeasure(
            f"{video.path}: {_exposure_in_words(samples)}{_turn_in_words(arm)}, but nothing was found on its upper "
            f"side that leaves its place for good between two of {len(samples)} pictures; film on until the body has "
            "slid or rolled down, with good contrast, or state where the body rests with --bead-at frame:x,y.",
            _arm_seen(arm, video.first),
        )
    if isinstance(body, Arrival):
        raise NothingToMeasure(
            f"{video.path}: a body has come to a place on the plate by {video.times[body.frame]:.3f} s (frame "
            f"{body.frame}), but no place higher on the plate was found that it left; state where it rests with "
            f"--bead-at frame:x,y, or let the record begin at least 0.2 s before the body lets go.",
            _arm_seen(arm, body.frame),
        )
    return _follow(video, scene, arm, level, body, uphill, centres, progress)


def line_of_motion(paths: Sequence[SpotPath]) -> Line | None:
    """The line [px] below the body that moves furthest along a straight path; None if there is none.

    Paths that rise by more than they go sideways, or go sideways alone, are none on a plate.
    """
    best, line = 0.0, None
    for path in paths:
        if len(path.frames) < LEAST_FRAMES:
            continue
        centres = path.centres
        middle = np.median(centres, axis=0)
        _, size, directions = np.linalg.svd(centres - middle, full_matrices=False)
        along = directions[0] * np.sign(directions[0][0] or 1.0)
        way = (centres - middle) @ along
        length = float(np.ptp(way))
        if size[1] > NOT_STRAIGHT * size[0] or length < max(4 * path.radius, best):
            continue
        # the normal that points down in the picture
        below = np.array([-along[1], along[0]]) * path.radius
        ends = [tuple(float(value) for value in middle + place * along + below) for place in (way.min(), way.max())]
        best, line = length, (ends[0], ends[1])
    return line  # type: ignore[return-value]


def _turn_in_words(arm: Arm) -> str:
    directions = [math.degrees(direction + arm.tilt) for direction in arm.directions.values()]
    if max(directions) - min(directions) < math.degrees(LEAST_TURN):
        return f"an edge stands at {directions[0]:.1f} degrees in the picture"
    return f"an edge turns from {min(directions):.1f} to {max(directions):.1f} degrees in the picture"


def _arm_seen(arm: Arm, frame: int) -> Seen:
    """The edges of the arm that were found, for the picture of a refusal."""
    nearest = min(arm.directions, key=lambda number: abs(number - frame))
    direction = arm.directions[nearest]
    marks = []
    for edge in arm.edges:
        ends = [(float(arm.along[column]), edge.row) for column in (edge.start, edge.end)]
        marks.append(Mark("", [arm.in_picture(end, direction) for end in ends]))
    return Seen(frame=nearest, marks=(*marks, Mark("axis", [arm.pivot])))


def body_seen(film: Film) -> tuple[Mark, ...]:
    """Arm and track of the body as far as it was followed, for the picture of a refusal."""
    track = []
    for direction, step in zip(film.directions, film.steps, strict=True):
        if step is not None and math.isfinite(direction):
            track.append(film.arm.in_picture(film.body.at(step), direction))
    return (*_arm_seen(film.arm, int(film.frames[0])).marks, Mark("body", track))


def _exposure_in_words(samples: Mapping[int, FloatImage]) -> str:
    """Begin of a message on poor exposure of the pictures; empty if there is none."""
    blank = sum(float(np.ptp(np.percentile(picture, (0.5, 99.5)))) < DIMMEST for picture in samples.values())
    if blank:
        rest = "in what remains " if blank < len(samples) else ""
        return f"{blank} of {len(samples)} pictures looked at show nothing but one brightness; {rest}"
    # white is often at 235 in video
    white = float(np.mean([np.mean(picture >= max(picture.max() - 3, SATURATED)) for picture in samples.values()]))
    return f"{100 * white:.0f} % of the picture is white, overexposed; " if white > MOST_WHITE else ""


def _registered_samples(scene: Scene, learnt: Background) -> dict[int, FloatImage]:
    return {number: scene.view(frame).grey for number, frame in learnt.samples().items()}


@dataclass(frozen=True)
class _Expected:
    """Where the body may be in one frame, and how fast: what it is looked for by in the next one."""

    place: Array  # [px], along and across the arm, from its place at rest
    speed: float = 0.0  # [px/interval]
    slack: float = 0.0  # [px], how far from there it is looked for beyond what it may have moved

    def seen(self, step: Step, lasts: float, slack: float = 0.0) -> _Expected:
        """After `lasts` intervals, at the end of which it is seen there."""
        moved = (step.along - self.place[0]) / max(lasts, 0.5)
        return _Expected(np.array([step.along, step.across]), moved if abs(moved) > 0.5 else 0.0, slack)

    def lost(self, lasts: float, slack: float = 0.0) -> _Expected:
        """After `lasts` intervals without a sight of it."""
        return _Expected(self.place + np.array([self.speed * lasts, 0.0]), self.speed, slack)


def _follow(
    video: Video,
    scene: Scene,
    arm: Arm,
    level: Level | None,
    body: RestingBody,
    uphill: int,
    centres: Mapping[int, tuple[Point, ...]],
    progress: Progress,
) -> Film:
    """Arm and body in every frame, each predicted from the frames before; in some the body's centre is stated."""
    numbers, directions, sigmas, steps, poses = [], [], [], [], []
    shake = (0.0, 0.0)
    known = sorted(arm.directions)
    sampled = np.array([arm.directions[n] for n in known])
    last = _Expected(np.zeros(2))  # where the body was last seen
    guesses, lost, since = [last], 0, 0.0  # the likeliest first; frames and intervals since the body was last seen
    seen_instead: dict[int, Point] = {}  # where the body is seen in frames in which its centre is stated
    usual, before = float(np.median(np.diff(video.times))), math.nan
    for frame in video.frames():
        # number of frame intervals since the last frame: the body moves further if frames are missing
        lasts = 1.0 if math.isnan(before) else (video.times[frame.index] - before) / usual
        before = video.times[frame.index]
        view = scene.view(frame.grey, shake)
        shake = view.shake
        guess = float(np.interp(frame.index, known, sampled))
        turn = lay_over(arm, view.grey, guess, reach=6)
        direction = guess if turn is None else turn.direction
        step, since = None, since + lasts
        for one in guesses if lost < MOST_LOST else ():
            step = _find_near(arm, body, view.grey, direction, one, lasts)
            if step is not None:
                guesses = [one.seen(step, lasts)]
                break
        else:
            if frame.index > body.rests[-1]:
                lost += 1
                guesses = [each.lost(lasts, 1.5 * lost) for each in guesses]
        for at in centres.get(frame.index, ()):
            if step is not None:
                seen_instead[frame.index] = view.pose.in_frame(arm.in_picture(body.at(step), direction))
            # the mean speed since the body was last seen; where it is not seen next, it is looked for as without
            unstated = guesses if step is not None else []
            step = body.stated(in_arm(view.pose.in_background(at), arm.pivot, direction))
            guesses = [last.seen(step, since, STATED_REACH), *unstated]
        if step is not None:
            last, lost, since = guesses[0], 0, 0.0
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
        gaps.shown,
        warnings=tuple(contradictions(seen_instead, min(body.size) / 2, centres, video.in_file)),
    )


def _find_near(
    arm: Arm, body: RestingBody, grey: FloatImage, direction: float, guess: _Expected, lasts: float
) -> Step | None:
    """The body in a frame, `lasts` intervals after the one before."""
    expected = guess.lost(lasts).place.tolist()
    step = follow(arm, body, grey, direction, expected, 1.0)
    if step is None or abs(guess.speed) > 1.0 or abs(step.along - guess.place[0]) > 1.0:
        # from frame to frame it may accelerate by a large share of its size
        reach = 6.0 + 0.6 * abs(guess.speed) * lasts + guess.slack
        wide = follow(arm, body, grey, direction, expected, reach)
        if wide is None or step is None or wide.likeness > step.likeness + 0.01:
            step = wide if wide is not None else step
    return step


def timed_by_the_run(film: Film, way: Way, run: Run, onset: Onset, video: Video) -> Film:
    """The film with missing frames from the run of the body where it shows them, else from the plate's turn."""
    first = int(np.searchsorted(way.time, onset.time))
    rest = float(np.median(way.down[max(first - LEAST_REST, 0) : first + 1]))
    frames = np.searchsorted(film.times, way.time[first : run.end])
    raw = video.times[film.frames]
    gaps = gaps_by_run(raw[frames], way.down[first : run.end] - rest, way.sigma[first : run.end])
    lost = np.maximum(gaps.missing, 0)
    missing = film.missing.copy()
    missing[frames[gaps.shown]] = lost[gaps.shown]
    return replace(
        film,
        missing=missing,
        times=raw + np.cumsum(missing) / video.frame_rate,
        repeated=int(np.sum(gaps.missing < 0)),
        lost_in_run=int(lost[film.missing[frames] == 0].sum()),
    )


def gauge_of(film: Film, camera: Camera, bead_diameter: float | None, arm_length: float | None) -> Gauge:
    """Scale and horizontal; the scale is that of the camera, else from the arm, else from the bead."""
    level = _horizontal(film, camera)
    if camera.given_scale is not None:
        uncertainty = camera.scale_uncertainty(NEARBY_LENGTH_UNCERTAINTY)
        return Gauge(camera.given_scale, uncertainty, camera.scale_from, level)
    if arm_length is not None:
        tip = film.arm.span[1] if film.uphill > 0 else -film.arm.span[0]
        # 5 %: the front of the arm is nearer to the camera than the body on its middle
        return Gauge(arm_length / tip, 0.05, "arm length", level)
    if bead_diameter is not None:
        # the height is used, as a clump is one bead high; no circle is fitted, as glare leaves notches in the outline
        return Gauge(bead_diameter / film.body.size[1], BEAD_UNCERTAINTY, "bead diameter", level)
    return Gauge(NOMINAL, math.inf, "not known", level)


def _horizontal(film: Film, camera: Camera) -> Horizontal:
    """The horizontal at the arm's height in the picture."""
    usual = float(np.nanmedian(film.directions)) if np.any(np.isfinite(film.directions)) else 0.0
    x, y = (film.picture.shape[1] - 1) / 2, (film.picture.shape[0] - 1) / 2
    # an edge through the middle of the picture has its true slope for any viewing direction
    row = y + (film.arm.pivot[1] - y) * math.cos(usual) - (film.arm.pivot[0] - x) * math.sin(usual)
    seen = None if film.level is None else film.level.at(row)
    if camera.roll is not None:
        # if the picture shows another horizontal, either may be right: the base may slope, the reading may be wrong
        apart = 0.0 if seen is None else abs(camera.roll - seen[0])
        return Horizontal(camera.roll, math.hypot(GIVEN_ROLL, apart / 2), "given", seen)
    if seen is None:
        return Horizontal(0.0, NO_LEVEL, "not known", None)
    return Horizontal(*seen, "base plate", seen)


def record(film: Film, gauge: Gauge) -> tuple[Series, Track]:
    """Angle of the plate [rad], and track of the body [m] relative to the axis."""
    sign = film.uphill
    angle = -sign * (film.directions + film.arm.tilt - gauge.level.roll)
    found = np.array([step is not None for step in film.steps])
    seen = found & np.isfinite(angle)
    kept = [step for step in film.steps if step is not None]
    along, across, sigma = np.full((3, len(found)), np.nan)
    along[found] = [film.body.centre[0] + step.along for step in kept]
    across[found] = [film.body.centre[1] + step.across for step in kept]
    sigma[found] = [step.sigma for step in kept]
    sigma = np.hypot(sigma, _off_pixels_sigma(along - film.body.centre[0]))
    up, high = sign * along[seen] * gauge.scale, -across[seen] * gauge.scale
    cos, sin = np.cos(angle[seen]), np.sin(angle[seen])
    position = np.column_stack([up * cos - high * sin, up * sin + high * cos])
    series = Series(film.times[np.isfinite(angle)], angle[np.isfinite(angle)], "plate_angle", "rad")
    return series, Track(film.times[seen], position, sigma[seen] * gauge.scale, "body")


def _off_pixels_sigma(moved: Array) -> Array:
    """Standard uncertainty [px] of the position of a body that has moved by `moved` [px] off its pixels at rest.

    The registration has an error of a fraction of a pixel, which is constant along one pixel: many frames of a slow
    body carry no more information than one.
    """
    moved = np.maximum(np.abs(moved) - max(AT_REST, 4 * jitter(moved)), 0.0)
    near = np.sort(moved[np.isfinite(moved)])
    alike = np.searchsorted(near, moved + 0.5) - np.searchsorted(near, moved - 0.5)
    return np.asarray(MOVED * np.minimum(moved, 1.0) * np.sqrt(np.maximum(alike, 1)))
