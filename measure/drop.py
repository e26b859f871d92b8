"""A bead falls on a plate and bounces: drop and rebound heights, restitution per bounce (Hlosta et al. 2020, eq. 5).

`measure` turns a clip into a track and the track into quantities; `evaluate` does the second half for any track, filmed
or simulated.  Restitutions are told apart: by ``height`` sqrt(h_{k+1}/h_k), which air drag lowers; by ``velocity``,
the ratio of the speeds across the plate at the contact itself; by ``time``, the ratio of neighbouring flight times;
and where the body leaves sideways, as one that is no sphere does, by ``all directions``, the ratio of the speeds with
what goes along the plate (section 3.2), which takes two views; of one view it is by ``picture plane``.

In a track of `measure` y = 0 is the bead's centre at its first contact, so y is the height of its lowest point above
the plate; x = 0 is where it first hits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import Camera
from rigtwin.lab.content import sha256
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Check, Detail, Evaluation, Measurement, Quantity, doubted, failed, root_sum_of_squares
from rigtwin.lab.records import Track, read_tracks
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.air import AirDrag
from rigtwin.measure.drop_checks import (
    fall_check,
    gravity_check,
    plane_check,
    residual_check,
    size_check,
    timing_check,
    view_checks,
)
from rigtwin.measure.drop_gauge import Gauge, find_gauge, radius_doubt, to_metres
from rigtwin.measure.falling import join_flights, likeness
from rigtwin.measure.flights import Bounces, Heights, Reader, find_contacts, fit_bounces, third_difference_noise
from rigtwin.measure.follow import Chase, chase_path, find_paths, learn_scene, look_again
from rigtwin.measure.lost_frames import Loss, find_losses, in_time
from rigtwin.measure.media import Video, open_video
from rigtwin.measure.repeats import at_its_pace, repeated
from rigtwin.measure.stated_roll import roll_check

AS_WELL, AS_BRIGHT = 1.3, 0.7  # times the usual misfit and contrast, up and down to which a bead is seen whole
STREAK_OFF = 0.5  # [px], of a bead's streak, from which on a frame is fitted again with the one that its flight makes
RATE_UNJUDGED = (
    "the scale is from gravity and the frame rate from the file: if the film plays slower than it was captured, "
    "heights are too large; give --frame-rate or --scale"
)
RATE_UNCONFIRMED = (
    "frame rate not confirmed: the scale was taken from gravity, so that all lengths hang on --frame-rate alone, with "
    "its square; give --bead-diameter or --scale"
)
HEIGHTS_REST_ON = ("first_fall", "lost_frames", "gravity", "flight_residuals", "out_of_plane")
GAIN = "a restitution above 1 cannot be: the track is wrong there"
ONE_VIEW = "seen from one side: what goes across the view is left out"
SPUN = "it leaves the plate faster than it came down: its spin drives it up, which is no restitution"


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate(
    track: Track,
    *,
    side: Track | None = None,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
) -> Evaluation:
    """Quantities and checks of one track; y up, against gravity.

    `side` is the same body at the same times as one sees it from the side, its x away from the viewer of `track`.
    `bead_diameter` [m] and `bead_density` [kg/m^3] fix the air drag; without them its strength is fitted.  A `sigma`
    of NaN means unknown: the noise is taken from the residuals.  Raises `NothingToMeasure` when there is no bounce.
    """
    rate = _rate(track)
    drag = AirDrag(bead_diameter, bead_density)
    whole = track
    track, repeats, losses, fitted = _readable(track, drag)
    if side is not None:  # a body that turns meets the plate higher and lower: that is no loss of frames
        track, losses, fitted = whole, (), None
    bounces = _bounces(track, drag, str(track.body), fitted=fitted, in_metres=True)
    return _evaluation(track, bounces, side=side, scale_doubt=0.0, rate=rate, repeats=repeats, losses=losses)


def _readable(track: Track, drag: AirDrag) -> tuple[Track, int, tuple[Loss, ...], Bounces | None]:
    """The track without points that are blank or repeat the one before, how many these were, and its bounces.

    Its times are true then, also where frames were surely lost.
    """
    finite = np.isfinite(track.time) & np.all(np.isfinite(track.position), axis=1)
    time, position = track.time[finite], track.position[finite]
    again = np.zeros(len(time), dtype=bool)
    if len(time) > 12:
        steps = np.diff(position, axis=0)
        onwards = np.sum(steps[:-2] * steps[2:], axis=1) > 0  # not where the bead turns round
        lengths = np.hypot(*steps.T)
        lengths[1:-1][~onwards] = np.max(lengths)
        again[1:] = repeated(lengths)
    kept = Track(time[~again], position[~again], track.sigma[finite][~again], track.body)
    losses, fitted = find_losses(_record(kept), lambda record: _fit(record, drag))
    return replace(kept, time=in_time(kept.time, losses)), int(np.sum(again)), losses, fitted


def _rate(track: Track) -> float:
    """[1/s]"""
    return 1 / float(np.nanmedian(np.diff(track.time))) if len(track.time) > 1 else math.nan


def _bounces(
    track: Track,
    drag: AirDrag,
    name: str,
    *,
    fitted: Bounces | None = None,
    in_metres: bool = False,
    filmed: bool = False,
) -> Bounces:
    """The bounces of a track, as `fitted` already where they are."""
    record = _record(track, filmed=filmed)
    if fitted is None and len(record.time) > 12:
        fitted = _fit(record, drag)
    if fitted is None:
        raise NothingToMeasure(f"{name}: {_why_no_bounce(record)}")
    if in_metres and drag.known and abs(fitted.read(lambda at: at.size)[0] - 1) > 0.2:
        # the air's drag on the bead is known in true metres and seconds only
        return fit_bounces(record, AirDrag()) or fitted
    return fitted


def _record(track: Track, *, filmed: bool = False) -> Heights:
    return Heights(track.time, track.position[:, 1], track.sigma, track.position[:, 0] if filmed else None)


def _fit(record: Heights, drag: AirDrag) -> Bounces | None:
    """With the known drag, or, where that fits nothing because time runs at another rate, with a free one."""
    fitted = fit_bounces(record, drag)
    return fit_bounces(record, AirDrag()) if fitted is None and drag.known else fitted


def _why_no_bounce(record: Heights) -> str:
    if len(record.time) < 8 or np.ptp(record.height) <= 12 * third_difference_noise(record):
        return "the particle hardly moves; give a clip in which it falls and bounces."
    top, low = int(np.argmax(record.height)), int(np.argmin(record.height))
    if len(find_contacts(record)) == 0:
        return (
            f"the particle moves (highest at {record.time[top]:.3f} s, lowest at {record.time[low]:.3f} s) but no "
            "rebound follows before the record ends; film longer, until it has bounced at least once, or move --end."
        )
    return (
        f"the particle turns round at {record.time[low]:.3f} s, but what comes before and after is no free flight of "
        "at least five frames; if this is a drop, film at a higher frame rate, or move --start and --end to the fall "
        "and the bounces."
    )


def _evaluation(
    track: Track,
    bounces: Bounces,
    *,
    side: Track | None = None,
    scale_doubt: float,
    rate: float,
    repeats: int,
    losses: tuple[Loss, ...],
) -> Evaluation:
    """`repeats` frames that showed the same as the one before are left out, sure `losses` mended in the times."""
    share = repeats / max(repeats + len(track.time), 1)
    checks = (
        gravity_check(bounces, scale_doubt, rate, share),
        residual_check(bounces),
        plane_check(track, bounces, side),
        fall_check(track, bounces),
        timing_check(track, bounces, repeats, losses),
    )
    failed = {check.check: check.message for check in checks if not check.passed}
    if not all(loss.sure for loss in losses):
        failed["lost_frames"] = failed["frame_timing"]
    along = [_Along(track, None, bounces)] if side is not None or "out_of_plane" in failed else []
    along += [] if side is None else [_Along(track, side, bounces)]
    turns = side is not None
    wrong_from = math.inf if turns else _wrong_from(bounces)
    quantities = [
        *_restitutions(bounces, failed, along, wrong_from),
        *_heights(bounces, scale_doubt, failed, wrong_from),
    ]
    return Evaluation(tuple(quantities), checks)


class _Along:
    """How fast the body goes along the plate before and after its bounces, in the unit of the record per second."""

    def __init__(self, track: Track, side: Track | None, bounces: Bounces) -> None:
        self.method = "picture plane" if side is None else "all directions"
        contacts = bounces.contact_times
        starts = [float(track.time[0]), *contacts]
        ends = [*contacts, float(track.time[-1])]
        places = [track.position[:, 0], *([] if side is None else [side.position[:, 0]])]
        flights = [
            bounces.used & (track.time > start) & (track.time < end) for start, end in zip(starts, ends, strict=True)
        ]
        lines = [[_slope(track.time[flight], x[flight]) for x in places] for flight in flights]
        self.speeds = [math.hypot(*(slope for slope, _ in line)) for line in lines]
        self.doubts = [math.hypot(*(doubt for _, doubt in line)) for line in lines]


def _slope(time: Array, x: Array) -> tuple[float, float]:
    """Slope of a straight line [1/s] and its standard uncertainty; infinite doubt where there are too few points."""
    if len(time) < 4:
        return 0.0, math.inf
    (slope, _), covariance = np.polyfit(time - time.mean(), x, 1, cov=True)
    return float(slope), math.sqrt(float(covariance[0, 0]))


def _restitutions(
    bounces: Bounces, failed: dict[str, str], along: Sequence[_Along], wrong_from: float
) -> list[Quantity]:
    doubt = "; ".join(failed[name] for name in ("first_fall", "flight_residuals", "frame_timing") if name in failed)
    height_doubt = "; ".join(text for text in (doubt, failed.get("out_of_plane", "")) if text)
    speed_doubt = doubt
    if "gravity" in failed and abs(bounces.read(lambda at: at.size)[0] - 1) > 0.1:
        drag = "how much the air slows the bead is not known, as scale or frame rate contradict gravity"
        speed_doubt = "; ".join(text for text in (doubt, drag) if text)
    found = []
    for k in range(1, bounces.count + 1):
        speed, parts = bounces.read(_impact_speed(k))
        detail: dict[str, Detail] = {
            "bounce": k,
            "impact_speed_m_s": round(speed, 6),
            "impact_speed_std_m_s": round(root_sum_of_squares(parts), 6),
            "contact_time_s": round(float(bounces.contact_times[k - 1]), 7),
        }
        by_height, by_speed = bounces.read(_height_ratio(k)), bounces.read(_speed_ratio(k))
        mine = [
            _quantity("restitution_wall", by_height, "1", "height", detail, height_doubt),
            _quantity("restitution_wall", by_speed, "1", "velocity", detail, speed_doubt),
        ]
        if k > 1:
            mine.append(_quantity("restitution_wall", bounces.read(_time_ratio(k)), "1", "time", detail, height_doubt))
        gains = GAIN if k >= wrong_from else SPUN if along and _gains(bounces, k) else ""
        found += [doubted(quantity, gains) for quantity in mine]
        found += [
            doubted(_with_speed_along(bounces, one, k, detail, speed_doubt), GAIN if k >= wrong_from else "")
            for one in along
            if math.isfinite(one.doubts[k - 1] + one.doubts[k])
        ]
    return found


def _with_speed_along(bounces: Bounces, along: _Along, k: int, detail: dict[str, Detail], doubt: str) -> Quantity:
    """Speed after over speed before, with what goes along the plate; the energy in the spin is no part of it."""
    before, after = along.speeds[k - 1], along.speeds[k]

    def ratio(at: Reader) -> float:
        return math.hypot(at.rebound_speed(k) * at.size, after) / math.hypot(at.impact_speed(k) * at.size, before)

    value, parts = bounces.read(ratio)
    fast = bounces.read(_impact_speed(k))[0] ** 2 + before**2
    parts["along the plate"] = math.hypot(after * along.doubts[k] / value, value * before * along.doubts[k - 1]) / fast
    if along.method == "picture plane":
        doubt = "; ".join(text for text in (doubt, ONE_VIEW) if text)
    return _quantity("restitution_wall", (value, parts), "1", along.method, detail, doubt)


def _wrong_from(bounces: Bounces) -> float:
    """The bounce before the first that seems to leave the plate faster than it came: they share a contact.

    0 where that is the first of all: then the fall to it is not to be trusted either.
    """
    return next((k - 1 for k in range(1, bounces.count + 1) if _gains(bounces, k)), math.inf)


def _gains(bounces: Bounces, bounce: int) -> bool:
    """Whether it seems to leave the plate faster than it came down."""
    value, parts = bounces.read(_speed_ratio(bounce))
    return value - 2 * root_sum_of_squares(parts) > 1


def _impact_speed(bounce: int) -> Callable[[Reader], float]:
    return lambda at: at.impact_speed(bounce) * at.size


def _height_ratio(bounce: int) -> Callable[[Reader], float]:
    """sqrt(h_{k+1} / h_k) (Hlosta et al. 2020, eq. 5)."""
    return lambda at: math.sqrt(at.heights[bounce] / at.heights[bounce - 1])


def _speed_ratio(bounce: int) -> Callable[[Reader], float]:
    return lambda at: at.rebound_speed(bounce) / at.impact_speed(bounce)


def _time_ratio(bounce: int) -> Callable[[Reader], float]:
    return lambda at: float(at.flight_times[bounce - 1] / at.flight_times[bounce - 2])


def _apex_height(bounce: int) -> Callable[[Reader], float]:
    return lambda at: float(at.heights[bounce]) * at.size


def _heights(bounces: Bounces, scale_doubt: float, failed: dict[str, str], wrong_from: float) -> list[Quantity]:
    doubt = "; ".join(failed[name] for name in HEIGHTS_REST_ON if name in failed)
    found = []
    for k in range(bounces.count + 1):
        value, parts = bounces.read(_apex_height(k))
        if scale_doubt > 0:
            parts["scale"] = abs(value) * float(scale_doubt)
        name = "rebound_height" if k else "drop_height"
        detail: dict[str, Detail] = {"bounce": k} if k else {}
        height = _quantity(name, (value, parts), "m", "height", detail, doubt)
        found.append(doubted(height, GAIN if k >= wrong_from else ""))
    return found


def _quantity(
    name: str,
    read: tuple[float, dict[str, float]],
    unit: str,
    method: str,
    detail: dict[str, Detail],
    doubtful: str,
) -> Quantity:
    value, parts = read
    found = Quantity(name, value, root_sum_of_squares(parts), unit, method, detail=dict(detail), budget=parts)
    return doubted(found, doubtful)


def _with_doubts(
    quantity: Quantity, checks: tuple[Check, ...], drag: AirDrag, *, film: str, lengths: str, scales: str
) -> Quantity:
    """The quantity with the failed checks of the film that it rests on; those of the flights it has already.

    `film` is what makes all doubtful, `lengths` what makes lengths doubtful, `scales` what makes time or size doubtful.
    """
    in_metres = quantity.unit == "m"
    # the bead's size is in the air's drag where that is known and not fitted
    of_size = in_metres or (quantity.method == "velocity" and drag.known)
    rests_on = {"bead_in_view": True, "static_camera": True, "camera_roll": in_metres, "bead_size": of_size}
    seen = failed(checks, [name for name, rests in rests_on.items() if rests])
    doubts = [seen, film, lengths if in_metres else "", scales if of_size else ""]
    return doubted(quantity, "; ".join(filter(None, doubts)))


# ---------------------------------------------------------------------------------------------------- media -> record


def measure(
    clip: Path,
    camera: Camera,
    *,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    out: Path | None = None,
    progress: Progress = silent,
) -> Measurement:
    """Measure a clip of a bouncing bead, or evaluate a track already made (``.csv``).

    Raises `UnreadableMedia` for a file that is no video, `NothingToMeasure` when no bead falls and bounces in it.
    """
    drag = AirDrag(bead_diameter, bead_density)
    if clip.suffix.lower() == ".csv":
        return _measure_record(clip, drag, out)
    video = at_its_pace(open_video(clip, camera), progress)
    found = _find_bead(video, camera, drag, bead_diameter, progress)
    video, seen, pixels, repeats = found.video, found.seen, found.pixels, found.repeats
    fitted = _bounces(pixels, drag, str(clip), filmed=True)
    gauge = find_gauge(pixels, fitted, seen, camera, bead_diameter)
    track = to_metres(pixels, fitted, gauge)
    if bead_diameter is None:
        drag = AirDrag(2 * seen.radius * gauge.scale, bead_density)
    bounces = _bounces(track, drag, str(clip), in_metres=True, filmed=True)
    evaluation = _evaluation(
        track,
        bounces,
        scale_doubt=gauge.doubt,
        rate=video.frame_rate,
        repeats=len(repeats - video.skipped),
        losses=found.losses,
    )
    checks = _with_gravity_told(evaluation.checks, gauge) + view_checks(video, seen, fitted, repeats)
    if camera.roll is not None:
        checks = (*checks, roll_check(camera.roll, *gauge.fall, "the bead's fall shows"))
    if bead_diameter is not None and not gauge.source.startswith("bead diameter"):
        checks = (*checks, size_check(2 * seen.radius * gauge.scale, radius_doubt(seen), bead_diameter))
    unconfirmed = (f"{RATE_UNCONFIRMED}; {gauge.cross_check}.",) if gauge.source == "gravity" else ()
    unjudged = RATE_UNJUDGED if gauge.source == "gravity" and camera.frame_rate is None else ""
    measurement = Measurement(
        rig="drop",
        source=clip,
        source_sha256=sha256(clip),
        quantities=tuple(
            _with_doubts(quantity, checks, drag, film=video.spoilt, lengths=unjudged, scales=gauge.contradiction)
            for quantity in evaluation.quantities
        ),
        checks=checks,
        warnings=(*video.warnings, *evaluation.warnings, *unconfirmed),
        camera={
            "frame_rate_hz": video.frame_rate,
            "playback_rate_hz": video.playback_rate,
            "scale_m_per_px": gauge.scale,
            "scale_std_rel": gauge.doubt,
            "scale_from": gauge.source,
            "camera_roll_deg": math.degrees(gauge.roll),
            "camera_roll_std_deg": math.degrees(gauge.roll_doubt),
            "exposure_fraction": seen.shutter.share if seen.shutter.told else None,
            "exposure_fraction_std": seen.shutter.doubt if seen.shutter.told else None,
            "bead_radius_px": seen.radius,
        },
        tracks=(track,),
    )
    if out is None:
        return measurement
    from rigtwin.measure.drop_pictures import write_pictures

    files = write_pictures(out, measurement, bounces, fitted, video, seen, progress)
    return replace(measurement, files=files)


def _measure_record(path: Path, drag: AirDrag, out: Path | None) -> Measurement:
    tracks = read_tracks(path)
    longest = max(tracks, key=lambda each: len(each.time))
    track, repeats, losses, fitted = _readable(longest, drag)
    bounces = _bounces(track, drag, str(path), fitted=fitted, in_metres=True)
    evaluation = _evaluation(track, bounces, scale_doubt=0.0, rate=_rate(longest), repeats=repeats, losses=losses)
    warnings = evaluation.warnings
    if len(tracks) > 1:
        warnings = (*warnings, f"{path.name} holds {len(tracks)} bodies; evaluated {track.body!r}, the longest.")
    if drag.density is not None and drag.diameter is None:
        told = "bead density: not used, for the air's drag needs the diameter too; it was fitted. Give --bead-diameter."
        warnings = (*warnings, told)
    measurement = Measurement(
        rig="drop",
        source=path,
        source_sha256=sha256(path),
        quantities=evaluation.quantities,
        checks=evaluation.checks,
        warnings=warnings,
        tracks=(track,),
    )
    if out is None:
        return measurement
    from rigtwin.measure.drop_pictures import write_plot

    return replace(measurement, files={"plot": write_plot(out, measurement, bounces)})


@dataclass(frozen=True)
class _Found:
    """The bead of a clip."""

    video: Video  # with true times, where frames were lost
    seen: Chase
    pixels: Track
    repeats: frozenset[int]  # frames that show the same as the one before
    losses: tuple[Loss, ...]
    fitted: Bounces | None


def _find_bead(video: Video, camera: Camera, drag: AirDrag, bead_diameter: float | None, progress: Progress) -> _Found:
    """The bead among all that moves: the thing that falls and bounces."""
    scene = learn_scene(video, quickly=True).scene()
    moves = find_paths(video, scene, camera.region, progress)
    paths, doubled = moves.paths, moves.repeated | video.skipped
    size = None
    if bead_diameter is not None and camera.given_scale is not None:
        size = bead_diameter / 2 / camera.given_scale
    ranked = sorted(paths, key=lambda path: -likeness(path, size))
    joined = join_flights(ranked, size)
    ranked = ranked if joined is None else [joined, *ranked]
    best_likeness = max((likeness(path, size) for path in ranked), default=0.0)
    likely = [path for path in ranked[:3] if likeness(path, size) > 0.02 * best_likeness]
    if not likely and camera.region is not None:
        region = ",".join(f"{side:g}" for side in camera.region)
        raise NothingToMeasure(
            f"{video.path}: nothing falls inside --region {region} (frames {video.first} to {video.last}); "
            "move it to where the bead falls, or leave it out."
        )
    if not likely:
        raise NothingToMeasure(
            f"{video.path}: nothing falls in this clip (frames {video.first} to {video.last}); film the bead with a "
            "still camera, or narrow the search with --region, --start and --end."
        )
    best, bouncing = None, []
    for path in likely:
        found = _in_true_time(video, chase_path(video, path, moves, progress), doubled, drag)
        if len(found.pixels.time) > 8 and best is None:
            best = found
        if found.fitted is not None:
            bouncing.append((residual_check(found.fitted), found, found.fitted))
            if bouncing[-1][0].passed:
                break
    if bouncing:
        # what else moves may seem to bounce as well, but hardly in free flight
        _, found, fitted = min(bouncing, key=lambda each: (not each[0].passed, each[0].value))
        expected = _expected(found.seen, found.pixels, fitted, found.video)
        better = look_again(found.seen, {index: at for index, at in expected.items() if index not in doubled})
        return replace(found, seen=better, pixels=_pixel_track(better))
    if best is None:
        raise NothingToMeasure(
            f"{video.path}: something moves, but no bead could be made out in it; use a larger or better lit picture "
            "of the bead, or narrow the search with --region."
        )
    return best


def _in_true_time(video: Video, seen: Chase, repeats: frozenset[int], drag: AirDrag) -> _Found:
    """The bead of a path; where its flights show that frames were lost, the times of all that comes after are moved."""
    pixels = _pixel_track(seen)
    losses, fitted = find_losses(_record(pixels), lambda record: _fit(record, drag))
    if not losses:
        return _Found(video, seen, pixels, repeats, losses, fitted)
    times = in_time(video.times, tuple(replace(loss, index=seen.sightings[loss.index].frame) for loss in losses))
    video = replace(video, times=times)
    sightings = tuple(replace(sighting, time=float(times[sighting.frame])) for sighting in seen.sightings)
    cuts = tuple(replace(cut, time=float(times[cut.frame])) for cut in seen.cuts)
    seen = replace(seen, sightings=sightings, cuts=cuts)
    return _Found(video, seen, _pixel_track(seen), repeats, losses, fitted)


def _pixel_track(seen: Chase) -> Track:
    """In pixels, y up."""
    frames = np.array([sighting.frame for sighting in seen.sightings])
    # where the bead was lost from sight, what is seen just before and after may be only a part of it
    in_part = _beside_a_gap(frames, np.array(seen.path.frames)) & ~_as_usual(seen)
    doubted = np.where(in_part, 5.0, 1.0)
    return Track(
        time=np.array([sighting.time for sighting in seen.sightings]),
        position=np.array([(sighting.image.x, -sighting.image.y) for sighting in seen.sightings]).reshape(-1, 2),
        sigma=doubted * np.array([sighting.image.sigma for sighting in seen.sightings]),
    )


def _as_usual(seen: Chase) -> npt.NDArray[np.bool_]:
    """Whether each sighting is of a bead as bright and as well explained as in most frames, shape (n,)."""
    misfits = np.array([sighting.fit.misfit for sighting in seen.sightings])
    contrasts = np.abs([sighting.image.contrast for sighting in seen.sightings])
    explained = misfits < AS_WELL * np.median(misfits)
    return np.asarray(explained & (contrasts > AS_BRIGHT * np.median(contrasts)))


def _beside_a_gap(frames: npt.NDArray[np.intp], path: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    """Whether each frame lies in, or within two frames of, a stretch of two or more frames without a moving spot."""
    beside = np.zeros(len(frames), dtype=bool)
    for k in np.flatnonzero(np.diff(path) > 2):
        beside |= (frames > path[k] - 2) & (frames < path[k + 1] + 2)
    return beside


def _expected(
    seen: Chase, pixels: Track, fitted: Bounces, video: Video
) -> dict[int, tuple[tuple[float, float], tuple[float, float]]]:
    """Where the bead should be in the frames of the flights that are worth another look.

    These are those whose bead was lost or taken for something else, and those fitted with another streak than the
    flight makes: beside a bounce the way from frame to frame is not that within a frame.
    """
    good = fitted.used
    known = {sighting.frame for sighting, used in zip(seen.sightings, good, strict=True) if used}
    steps = {cut.frame: cut.step for cut in seen.cuts}
    half = 1 / video.frame_rate / 2
    expected = {}
    for index in range(video.first, video.last + 1):
        time = float(video.times[index])
        if not pixels.time[good][0] <= time <= pixels.time[good][-1]:
            continue
        moments = np.array([time - half, time, time + half])
        heights = fitted.curve(moments)
        x = np.interp(moments, pixels.time[good], pixels.position[good, 0])
        motion = (float(x[2] - x[0]), float(heights[0] - heights[2]))
        if np.all(np.isfinite(heights)) and (index not in known or _streak_off(seen, steps[index], motion)):
            expected[index] = ((float(x[1]), -float(heights[1])), motion)
    return expected


def _streak_off(seen: Chase, taken: tuple[float, float], motion: tuple[float, float]) -> bool:
    """Whether a frame was fitted with another streak than the bead's motion [px/frame] makes."""
    return seen.shutter.share * math.dist(taken, motion) > STREAK_OFF


def _with_gravity_told(checks: tuple[Check, ...], gauge: Gauge) -> tuple[Check, ...]:
    """With what the bead's diameter says of gravity; without that check where gravity itself gave the scale."""
    gravity, *others = checks
    if gauge.gravity is not None:
        value, doubt = gauge.gravity
        message = f"with the scale of the bead's diameter free flight gives g = {value:.2f} ± {doubt:.2f} m/s²"
        message += f" instead of {GRAVITY}: {gauge.contradiction}" if gauge.contradiction else ": they agree"
        gravity = replace(gravity, passed=not gauge.contradiction, value=value, message=message)
    elif gauge.source == "gravity":
        return tuple(others)
    return replace(gravity, message=f"{gravity.message.rstrip('.')}; {gauge.cross_check}."), *others
