"""Double pendulum: bead A swings from an angle into bead B at rest (Hlosta et al. 2020, fig. 3c); or into a wall.

`measure` reads a clip or a tracked record; `evaluate` turns tracks, filmed or simulated, into restitution and angles.
Every number that enters the restitution is an angle or a ratio of speeds, so neither scale nor frame rate touch it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from rigtwin.lab.arrays import Array, Mask
from rigtwin.lab.camera import Camera
from rigtwin.lab.content import sha256
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Detail, Evaluation, Measurement, Quantity, doubted, failed
from rigtwin.lab.records import Track, read_tracks, write_tracks
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.channel import LUMA
from rigtwin.measure.follow import Chase, look_again
from rigtwin.measure.lost_frames import Loss, in_time
from rigtwin.measure.media import Video, open_video
from rigtwin.measure.pendulum_checks import (
    contact_angle_check,
    distance_check,
    doubts_of,
    gravity_check,
    length_check,
    lens_check,
    momentum_check,
    residual_check,
    timing_check,
    view_checks,
)
from rigtwin.measure.repeats import without_repeats
from rigtwin.measure.swing import Swings, angles, centres, positions, states_at_collision, turning_points
from rigtwin.measure.swing_fit import Outcome, SwingFit, fit_swings
from rigtwin.measure.swing_losses import find_losses
from rigtwin.measure.swing_pictures import picture_view, write_overlay, write_plot, write_still
from rigtwin.measure.two_beads import Beads, find_beads, relocate
from rigtwin.measure.wall_bead import find_wall_bead, images_by_frame

Variant = Literal["double", "wall"]

# The lit side of a bead turns with its place under the lamp: its centre, fitted as that of an evenly shaded disc,
# shifts by some hundredths of the radius between the ends of a swing.
SHADING = 0.03
# What the texture behind a bead and the codec shift its centre by, as a share of a point's noise, goes with the place
# and not with the frame, or drifts, and does not average out.  By maximum likelihood of the errors of beads in 15 drawn
# films of known truth (benchmarks/ground.py) it was 0.35 to 0.5 without the drifts.  More is taken: restitutions of 71
# drawn films of all hardnesses are off by 0.84 of what is stated, root mean square, and by 0.97 without the drifts; of
# 18 plain ones that were compressed as usual they are 0.0009 too large on average.
GROUND = 0.7
UNCONFIRMED = (
    "scale and frame rate not confirmed: the scale was taken from gravity; give --length or --scale for a check."
)
HEAD_ON = ("momentum", "contact_distance")  # checks that fail where the beads meet off centre or a track is wrong


def measure(
    clip: Path,
    camera: Camera,
    *,
    variant: Variant = "double",
    length: float | None = None,
    bead_diameter: float | None = None,
    bead_mass: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip, or evaluate an already tracked record (``.csv`` with time_s, x_m, y_m, particle).

    `length` [m] from hinge to bead centre, `bead_diameter` [m], `bead_mass` [kg], as far as known.  The scale is the
    camera's where given, else from `length`, else from `bead_diameter` (the centres' distance at the collision), else
    from gravity.  Files go into `out`; None writes none.

    Raises `NothingToMeasure` where no released bead hits a hanging one.
    """
    if clip.suffix.lower() == ".csv":
        return _measure_record(
            clip, variant=variant, length=length, bead_diameter=bead_diameter, bead_mass=bead_mass, out=out
        )
    video = without_repeats(open_video(clip, camera), progress)
    film = (_watch_wall if variant == "wall" else watch)(video, camera, length, progress)
    scale, scale_from = _scale(film, camera, length, bead_diameter)
    roll = -float(film.fit.swings["tilt"]) if camera.roll is None else camera.roll
    tracks, axis = _upright(film, _axis(video), scale, roll)
    fit = _fit_clip(clip, tracks, axis=axis, ground=GROUND)
    evaluation = judge(
        fit,
        None if scale_from == "pendulum length" else length,
        None if scale_from == "bead diameter" else bead_diameter,
        bead_mass,
        shading=SHADING * scale * max(look.radius for look in film.beads.looks),
    )
    timing, lens = timing_check(video, film.losses), lens_check(fit)
    views = view_checks(film.beads, evaluation.checks)
    # gravity checks nothing where the scale is from it
    by_gravity = scale_from == "gravity"
    checks = (*(each for each in evaluation.checks if each.check != "gravity" or not by_gravity), timing, lens, *views)
    spoilt = "; ".join(filter(None, [video.spoilt, failed((timing, lens, *views))]))
    quantities = tuple(doubted(quantity, spoilt) for quantity in evaluation.quantities)
    seen = {
        "frame_rate_hz": video.frame_rate,
        "playback_rate_hz": video.playback_rate,
        "scale_m_per_px": scale,
        "scale_from": scale_from,
        "camera_roll_deg": math.degrees(roll),
    }
    return Measurement(
        rig="pendulum",
        source=clip,
        source_sha256=sha256(clip),
        quantities=quantities,
        checks=checks,
        warnings=(
            *video.warnings,
            *_roll_warning(film.fit, camera),
            *evaluation.warnings,
            *([UNCONFIRMED] if by_gravity else ()),
        ),
        camera=seen,
        tracks=tracks,
        files={} if out is None else _write(out, video, film, fit, quantities, progress=progress),
    )


@dataclass(frozen=True)
class Film:
    """The beads followed through a clip, and their swings fitted in pixels (y up)."""

    beads: Beads
    times: Array  # [s], of every frame
    fit: SwingFit
    losses: tuple[Loss, ...] = ()  # of frames, the sure ones put right in the times


def _measure_record(
    record: Path,
    *,
    variant: Variant,
    length: float | None,
    bead_diameter: float | None,
    bead_mass: float | None,
    out: Path | None,
) -> Measurement:
    tracks = read_tracks(record)
    fit = _fit_clip(record, _in_order(tracks, variant))
    evaluation = judge(fit, length, bead_diameter, bead_mass)
    files = {}
    if out is not None:
        files["plot"] = out / f"{record.stem}-plot.svg"
        write_plot(files["plot"], fit)
    return Measurement(
        "pendulum",
        record,
        sha256(record),
        evaluation.quantities,
        evaluation.checks,
        evaluation.warnings,
        tracks=tracks,
        files=files,
    )


def watch(video: Video, camera: Camera, length: float | None, progress: Progress) -> Film:
    """Both beads of a double pendulum in every frame, and their swings; `length` [m] only serves what is told."""
    beads = find_beads(video, camera.region, stated_length=length, progress=progress)
    times, fit, losses = _swings(video, beads)
    places, velocities, again = _second_look(fit, beads, times)
    beads = relocate(video, beads, places, velocities, again)
    return Film(beads, times, fit, losses)


def _watch_wall(video: Video, camera: Camera, length: float | None, progress: Progress) -> Film:
    chase = find_wall_bead(video, camera.region, stated_length=length, progress=progress)
    beads = _one_bead(chase, video)
    times, fit, losses = _swings(video, beads)
    places, velocities, again = _second_look(fit, beads, times)
    expected = {
        int(beads.frames[k]): ((float(x), float(y)), (float(u), float(v)))
        for k, ((x, y), (u, v)) in enumerate(zip(places[0], velocities[0], strict=True))
        if again[0, k]
    }
    beads = _one_bead(look_again(chase, expected), video)
    return Film(beads, times, _fit_clip(video.path, picture_tracks(beads, times), axis=_axis(video)), losses)


def _swings(video: Video, beads: Beads) -> tuple[Array, SwingFit, tuple[Loss, ...]]:
    """Times [s] of all frames, with frames that were lost put right, the swings, and what was lost."""
    times = video.times[beads.frames]
    losses, fit = find_losses(
        times, picture_tracks(beads, times), lambda tracks: _fit_clip(video.path, tracks, axis=_axis(video))
    )
    return in_time(times, losses), fit, losses


def _one_bead(chase: Chase, video: Video) -> Beads:
    look = chase.look
    if look is None:
        raise NothingToMeasure(f"{video.path}: what moves in this clip does not look like a bead.")
    frames = np.array([index for index in range(video.first, video.last + 1) if index not in video.skipped])
    images = images_by_frame(chase, frames)
    # where the bead rests for long its frames are not cut out, and the next that is tells the pose
    cut = np.array([cut.frame for cut in chase.cuts])
    following = np.clip(np.searchsorted(cut, frames), 0, len(cut) - 1)
    poses = tuple(chase.cuts[k].pose for k in following.tolist())
    looked = np.ones((1, len(frames)), dtype=bool)
    return Beads(frames, (images,), [look], chase.shutter.share, chase.scene, LUMA, poses, looked, {})


def picture_tracks(beads: Beads, times: Array) -> tuple[Track, ...]:
    """Tracks in pixels, y up."""
    tracks = []
    for body, images in zip("AB", beads.images, strict=False):
        seen = [(time, image) for time, image in zip(times, images, strict=True) if image is not None]
        position = np.array([(image.x, -image.y) for _, image in seen]).reshape(-1, 2)
        sigma = np.array([image.sigma for _, image in seen])
        tracks.append(Track(np.array([time for time, _ in seen]), position, sigma, body))
    return tuple(tracks)


def _second_look(fit: SwingFit, beads: Beads, times: Array) -> tuple[Array, Array, Mask]:
    """Where the fitted swings put the beads [px, y down], how fast [px/frame], which frames need a second look.

    These are frames around a collision, where the beads touch, and frames where a bead was lost or another thing found.
    """
    frame = float(np.median(np.diff(times)))
    after, before = (positions(fit.swings, angles(fit.swings, times + side * frame)[0]) for side in (0.5, -0.5))
    middle = ((after + before) / 2)[:, :, 0] * [1, -1]
    velocity = (after - before)[:, :, 0] * [1, -1]
    again = np.zeros((fit.swings.beads, len(times)), dtype=bool)
    for k in range(fit.swings.collisions):
        again |= np.abs(times - float(fit.swings[f"time_{k}"])) < 5 * frame
    for bead, track in enumerate(fit.tracks):
        known = np.searchsorted(times, track.time)
        good = np.zeros(len(times), dtype=bool)
        good[known] = np.hypot(*fit.residuals[bead].T) < 6 * fit.noise
        again[bead] |= ~good
    return middle, velocity, again


def _axis(video: Video) -> tuple[float, float]:
    """Where the camera's axis goes through the picture [px, y up]: its middle, unless the film was cropped."""
    return (video.width - 1) / 2, -(video.height - 1) / 2


def _fit_clip(
    clip: Path, tracks: tuple[Track, ...], *, axis: tuple[float, float] | None = None, ground: float = 0.0
) -> SwingFit:
    try:
        return fit_swings(tracks, axis=axis, ground=ground)
    except NothingToMeasure as error:
        raise NothingToMeasure(f"{clip}: {error}") from None


def _scale(film: Film, camera: Camera, length: float | None, bead_diameter: float | None) -> tuple[float, str]:
    """[m/px] and where it is from."""
    fit = film.fit
    if camera.given_scale is not None:
        return camera.given_scale, camera.scale_from
    found = fit.propagate(_outcomes)
    if length is not None:
        return length / found["length"].value, "pendulum length"
    if bead_diameter is not None:
        # two beads touch at the collision; one alone shows its rim only
        across = found["distance"].value if "distance" in found else 2 * film.beads.looks[0].radius
        return bead_diameter / across, "bead diameter"
    return GRAVITY / found["gravity"].value, "gravity"


def _upright(
    film: Film, axis: tuple[float, float], scale: float, roll: float
) -> tuple[tuple[Track, ...], tuple[float, float]]:
    """Tracks and the camera's axis in metres from where the last bead hangs, x to the right, y against gravity."""
    swings = film.fit.swings
    rest = centres(swings, np.zeros((swings.beads, 1, 1)))[-1, 0, 0]
    back = np.array([[math.cos(roll), math.sin(roll)], [-math.sin(roll), math.cos(roll)]]) * scale
    tracks = tuple(
        replace(track, position=(track.position - rest) @ back, sigma=track.sigma * scale)
        for track in picture_tracks(film.beads, film.times)
    )
    x, y = (np.array(axis) - rest) @ back
    return tracks, (float(x), float(y))


def _roll_warning(fit: SwingFit, camera: Camera) -> tuple[str, ...]:
    if camera.roll is None:
        return ()
    found = math.degrees(-float(fit.swings["tilt"]))
    if abs(found - math.degrees(camera.roll)) < 0.3:
        return ()
    return (
        f"camera roll: {math.degrees(camera.roll):.2f} degrees were given, but the beads hang at {found:.2f} degrees; "
        "angles are measured from where they hang",
    )


def _write(
    out: Path, video: Video, film: Film, fit: SwingFit, found: Sequence[Quantity], *, progress: Progress
) -> dict[str, Path]:
    clip = video.path
    out.mkdir(parents=True, exist_ok=True)
    endings = {"overlay": "overlay.mp4", "still": "still.png", "plot": "plot.svg", "record": "track.csv"}
    files = {kind: out / f"{clip.stem}-{ending}" for kind, ending in endings.items()}
    view = picture_view(film.fit, film.times)
    turning = float(turning_points(film.fit.swings, 0)[1][-1, 0])
    best = int(film.beads.frames[np.argmin(np.abs(film.times - turning))])
    still = write_overlay(files["overlay"], video, film.beads, view, still=best, progress=progress)
    write_still(files["still"], still, film.beads, view, film.fit, found=found)
    write_plot(files["plot"], fit)
    write_tracks(files["record"], fit.tracks)
    return files


def evaluate(
    tracks: Sequence[Track],
    *,
    variant: Variant = "double",
    length: float | None = None,
    bead_diameter: float | None = None,
    bead_mass: float | None = None,
) -> Evaluation:
    """Restitution, release and rebound angles of a pendulum record, with checks of momentum, gravity and lengths.

    `tracks` hold beads "A" (released) and "B" (hanging), or one bead for the wall; `length` [m] from hinge to bead
    centre, `bead_diameter` [m] and `bead_mass` [kg] are what was stated beforehand and only serve the checks.

    - ``restitution_pair``, method "velocity", per collision: e = (v_B' - v_A') / (v_A - v_B) with the speeds at the
      contact from the fitted equation of motion, so damping does not count as restitution.
    - ``restitution_pair``, method "angle": e = (sin(b'/2) - sin(a'/2)) / sin(a/2) with release angle a and the turning
      angles a', b' of A and B, A's negative where it bounces back; losses of the swing between do count.
    - ``energy_ratio_root``, method "height": sqrt(h_B' / h_A), the paper's eq. 5 applied to the two beads.  For equal
      masses it is (1 + e) / 2, not e.
    - ``restitution_wall`` for the wall: "velocity" v'/v; "angle" sin(a'/2) / sin(a/2), which supposes that the bead
      hangs plumb where it touches the wall; "height" sqrt(h'/h) with the heights above the place of the hit.

    Raises `NothingToMeasure` when there is no release, no second bead or no collision in the record.
    """
    return judge(fit_swings(_in_order(tracks, variant)), length, bead_diameter, bead_mass)


def judge(
    fit: SwingFit,
    length: float | None = None,
    bead_diameter: float | None = None,
    bead_mass: float | None = None,
    *,
    shading: float = 0.0,
) -> Evaluation:
    """The evaluation of fitted swings; arguments as in `evaluate`.

    `shading` [m] is how far a filmed bead's centre seems to shift from place to place with the light that falls on it.
    """
    outcomes = _with_shading(fit.propagate(_outcomes), shading)
    residuals = residual_check(fit)
    checks = [gravity_check(outcomes), residuals]
    checks.insert(0, momentum_check(outcomes, bead_mass) if fit.swings.beads == 2 else contact_angle_check(outcomes))
    if length is not None:
        checks.append(length_check(outcomes["length"], length))
    if bead_diameter is not None and fit.swings.beads == 2:
        checks.append(distance_check(outcomes["distance"], bead_diameter))
    doubts = doubts_of(fit, outcomes)
    if not residuals.passed:
        doubts = {name: "; ".join(filter(None, [doubt, residuals.message])) for name, doubt in doubts.items()}
    if fit.swings.beads == 1 and not checks[0].passed:
        doubts["plumb"] = checks[0].message
    if fit.swings.beads == 2:
        off_centre = [check.message for check in checks if check.check in HEAD_ON and not check.passed]
        doubts["collision"] = "; ".join(filter(None, [doubts["collision"], *off_centre]))
    quantities = [*_restitutions(fit, outcomes, doubts), *_angles(outcomes, doubts)]
    warnings = [check.message for check in checks if not check.passed]
    return Evaluation(tuple(quantities), tuple(checks), tuple(warnings))


def _in_order(tracks: Sequence[Track], variant: Variant) -> tuple[Track, ...]:
    """Bead A, then bead B."""
    named = {track.body.strip().upper(): track for track in tracks}
    if variant == "wall":
        if len(tracks) != 1 and "A" not in named:
            raise BadInput(f"A wall pendulum has one bead; this record holds {len(tracks)} ({', '.join(named)}).")
        return (named.get("A", tracks[0]),)
    if len(tracks) == 1:
        raise NothingToMeasure(
            "Only one bead moves in this record; a double pendulum needs bead A and bead B (for a wall: variant wall)."
        )
    if not {"A", "B"} <= set(named):
        raise BadInput(
            f"The record names its beads {', '.join(named)}; name the released bead A and the hanging one B."
        )
    return named["A"], named["B"]


def _outcomes(swings: Swings) -> dict[str, Array]:
    """All that is derived from the swings; speeds and angles count positive in A's direction of approach."""
    lengths, outcomes = swings.per_bead("length"), {}
    for k in range(swings.collisions):
        angle, before = states_at_collision(swings, k)
        v, v_after = before * lengths, swings.after(k) * lengths
        if swings.beads == 1:
            outcomes[f"restitution_{k}"] = -v_after[0] / v[0]
        else:
            outcomes[f"restitution_{k}"] = (v_after[1] - v_after[0]) / (v[0] - v[1])
        outcomes[f"approach_{k}"] = np.abs(v[0] - (v[1] if swings.beads > 1 else 0))
        if k == 0:
            way = np.sign(v[0])
            outcomes |= _first_collision(swings, angle, way * v, way * v_after, way)
    return outcomes


def _first_collision(swings: Swings, angle: Array, v: Array, v_after: Array, way: Array) -> dict[str, Array]:
    turning = way * turning_points(swings, 0)[0]
    release = np.abs(swings["release_angle"])
    from_angles = np.sin(turning / 2) / np.sin(release / 2)
    outcomes = {
        "release": release,
        "turning_0": turning[0],
        "gravity": swings["gravity"],
        "pull": swings["gravity"] / swings["length_0"],
        "length": np.mean(swings.per_bead("length"), axis=0),
        "way": way,
    }
    if swings.beads == 1:
        hit, (start, turned) = way * angle[0], (np.cos(release), np.cos(turning[0]))
        heights = np.maximum(np.cos(hit) - turned, 0) / (np.cos(hit) - start)
        return outcomes | {"from_angles": -from_angles[0], "from_heights": np.sqrt(heights), "contact_angle": hit}
    place = centres(swings, angle[:, None])[:, 0]
    rise = swings["length_1"] * (1 - np.cos(turning[1])) / (swings["length_0"] * (1 - np.cos(release)))
    return outcomes | {
        "turning_1": turning[1],
        "from_angles": from_angles[1] - from_angles[0],
        "energy_ratio_root": np.sqrt(np.maximum(rise, 0)),
        "angle_ratio": turning[1] / release,
        "speed": v[0],
        "speeds_after": v_after[0] + v_after[1],
        "momentum": (v_after[0] + v_after[1]) / v[0],
        "distance": np.hypot(*np.moveaxis(place[1] - place[0], -1, 0)),
    }


def _with_shading(outcomes: dict[str, Outcome], shading: float) -> dict[str, Outcome]:
    """Angles, each seen somewhere else, with the doubt about where the bead's centre is there."""
    if not shading > 0:
        return outcomes
    step = shading / outcomes["length"].value  # [rad]
    turns = [outcomes[name].value for name in ("turning_0", "turning_1") if name in outcomes]
    half = np.sin(outcomes["release"].value / 2)
    rise = [math.cos(turn / 2) / 2 * step / half for turn in turns]
    fall = step / (2 * math.tan(outcomes["release"].value / 2))
    steps = dict.fromkeys(("release", "turning_0", "turning_1"), step)
    steps["from_angles"] = math.hypot(*rise, fall * outcomes["from_angles"].value)
    steps["from_heights"] = steps["from_angles"]
    if "energy_ratio_root" in outcomes:
        steps["energy_ratio_root"] = math.hypot(rise[1], fall * outcomes["energy_ratio_root"].value)
    return {
        name: Outcome(outcome.value, outcome.budget | ({"shading": steps[name]} if name in steps else {}))
        for name, outcome in outcomes.items()
    }


def _restitutions(fit: SwingFit, outcomes: dict[str, Outcome], doubts: dict[str, str]) -> list[Quantity]:
    name = "restitution_pair" if fit.swings.beads == 2 else "restitution_wall"
    found = []
    for k in range(fit.swings.collisions):
        e = outcomes[f"restitution_{k}"]
        detail: dict[str, Detail] = {
            "collision": k + 1,
            "impact_speed_m_per_s": round(outcomes[f"approach_{k}"].value, 5),
        }
        doubt = doubts["collision"]
        if e.value - 2 * e.std > 1:
            doubt = "; ".join(filter(None, [doubt, "a restitution above 1 cannot be: a track is wrong"]))
        found.append(_quantity(name, e, "1", "velocity", detail, doubtful=doubt))
    by_speed, by_angle = outcomes["restitution_0"], outcomes["from_angles"]
    # what the swings lose on their way counts as restitution here: the fit knows how much
    losses = {"swing_losses": abs(by_speed.value - by_angle.value)}
    detail = {"collision": 1}
    seen = "; ".join(filter(None, [doubts["collision"], doubts["release"], doubts["turning"]]))
    plumb = "; ".join(filter(None, [seen, doubts.get("plumb", "")]))
    found.append(
        _quantity(name, Outcome(by_angle.value, by_angle.budget | losses), "1", "angle", detail, doubtful=plumb)
    )
    if fit.swings.beads == 1:
        by_height = outcomes["from_heights"]
        losses = {"swing_losses": abs(by_speed.value - by_height.value)}
        whole = Outcome(by_height.value, by_height.budget | losses)
        found.append(_quantity(name, whole, "1", "height", detail, doubtful=seen))
    else:
        ratio: dict[str, Detail] = {
            "collision": 1,
            "angle_ratio": round(outcomes["angle_ratio"].value, 5),
            "equals": "(1+e)/2, not e",
        }
        found.append(_quantity("energy_ratio_root", outcomes["energy_ratio_root"], "1", "height", ratio, doubtful=seen))
    return found


def _angles(outcomes: dict[str, Outcome], doubts: dict[str, str]) -> list[Quantity]:
    way = outcomes["way"].value
    quantities = [
        _quantity(
            "release_angle",
            _degrees(outcomes["release"]),
            "deg",
            "swing",
            {"body": "A", "side": "left" if way > 0 else "right"},
            doubtful=doubts["release"],
        )
    ]
    for bead, body in enumerate("AB"):
        if (turning := outcomes.get(f"turning_{bead}")) is not None:
            detail: dict[str, Detail] = {"body": body, "side": "right" if turning.value * way > 0 else "left"}
            angle = _degrees(replace(turning, value=abs(turning.value)))
            quantities.append(_quantity("rebound_angle", angle, "deg", "swing", detail, doubtful=doubts["turning"]))
    return quantities


def _degrees(outcome: Outcome) -> Outcome:
    return Outcome(math.degrees(outcome.value), {k: math.degrees(part) for k, part in outcome.budget.items()})


def _quantity(
    name: str, outcome: Outcome, unit: str, method: str, detail: dict[str, Detail], *, doubtful: str
) -> Quantity:
    found = Quantity(name, outcome.value, outcome.std, unit, method, detail=detail, budget=dict(outcome.budget))
    return doubted(found, doubtful)
