"""Find the bead in a clip of a drop and follow it: the path that falls and bounces."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rigtwin.lab.camera import Camera, Point, Seed
from rigtwin.lab.errors import Mark, NothingToMeasure, Seen
from rigtwin.lab.progress import Progress
from rigtwin.lab.records import Track
from rigtwin.measure.drop.bounce_fit import Bounces
from rigtwin.measure.drop.checks import (
    residual_check,
)
from rigtwin.measure.drop.evaluate import fit, heights_of
from rigtwin.measure.drop.fall_in_air import AirDrag
from rigtwin.measure.drop.lost_frames import find_losses
from rigtwin.measure.drop.select_path import join_flights, likeness
from rigtwin.measure.media.frame_loss import Loss, in_time
from rigtwin.measure.media.video import Video
from rigtwin.measure.scene.background import learn_scene
from rigtwin.measure.tracking.find_paths import Movement, find_paths
from rigtwin.measure.tracking.follow import Chase, chase_path, look_again
from rigtwin.measure.tracking.link import SpotPath, path_marks
from rigtwin.measure.tracking.search_by_look import paths_by_look, picture_at, picture_on_path
from rigtwin.measure.tracking.stated_centres import contradictions, stated_centres, with_stated

WHOLE = 0.9  # minimum share of the frames from the first to the last sighting in which the bead is seen
NOISIER = 2.0  # factor on the least noise of all paths up to which the number of bounces decides
FEWEST_SEEN = 8  # a track must have more points
AS_WELL, AS_BRIGHT = 1.3, 0.7  # limits for an unoccluded bead: largest misfit, smallest contrast, over the median

STREAK_OFF = (
    0.5  # [px], error of a bead's motion blur beyond which a frame is fitted again with the motion of the flight
)


@dataclass(frozen=True)
class _Found:
    """The bead of a clip and its fitted bounces."""

    video: Video  # with corrected times if frames were lost
    seen: Chase
    pixels: Track
    repeats: frozenset[int]  # frames that repeat the one before
    losses: tuple[Loss, ...]
    fitted: Bounces | None
    warnings: tuple[str, ...] = ()  # on stated centres that disagree with the picture


def find_bead(video: Video, camera: Camera, drag: AirDrag, bead_diameter: float | None, progress: Progress) -> _Found:
    """Find the bead among everything that moves: the object that falls and bounces.

    Raises `NothingToMeasure` if nothing falls, or no bead can be located.
    """
    centres = stated_centres(video, camera)
    scene = learn_scene(video, quickly=True).scene()
    moves = find_paths(video, scene, camera.region, progress)
    doubled = moves.repeated | video.skipped
    size = None
    if bead_diameter is not None and camera.given_scale is not None:
        size = bead_diameter / 2 / camera.given_scale
    if camera.bead_at is not None:
        ranked = likely = [_path_stated(video, moves, camera, camera.bead_at, size, progress)]
    else:
        ranked, likely = _likely(moves.paths, size)
    if not likely:
        raise _no_path(video, camera, moves.paths)

    def followed(path: SpotPath, *, shadows: bool = False) -> _Tried:
        seen = chase_path(video, path, moves, progress, shadows=shadows)
        found = _in_true_time(video, with_stated(seen, centres, video.times), doubled, drag)
        return _tried(replace(found, warnings=_contradictions(seen, centres, video)))

    tried: list[_Tried] = []
    for path in likely:
        tried.append(followed(path))
        if tried[-1].sound:
            break
    if not (tried[0].sound and tried[0].whole) and camera.bead_at is None:
        # a shadow joins the bead's spot, or an object before it splits it: its picture shows which is which
        bead = picture_on_path(video, ranked[0], moves)
        again = [] if bead is None else paths_by_look(video, bead, moves, camera.region, progress)
        for path in sorted(again, key=lambda path: -likeness(path, size))[:1]:
            tried.append(followed(path, shadows=True))
    found = _best(tried)
    if found.fitted is not None:
        expected = _expected(found.seen, found.pixels, found.fitted, found.video)
        better = look_again(found.seen, {index: at for index, at in expected.items() if index not in doubled})
        warnings = _contradictions(better, centres, video)
        better = with_stated(better, centres, found.video.times)
        return replace(found, seen=better, pixels=_pixel_track(better), warnings=warnings)
    if len(found.pixels.time) <= FEWEST_SEEN:
        path = found.seen.path
        raise NothingToMeasure(
            f"{video.path}: what moves in {len(path.frames)} frames from {path.frames[0]} to {path.frames[-1]} fits "
            f"the picture of a round bead in {len(found.pixels.time)} of them, more than {FEWEST_SEEN} are needed; "
            "film the bead larger or with more light, or state it with --bead-at frame:x,y.",
            Seen(frame=path.frames[len(path.frames) // 2], marks=marks_of([path])),
        )
    return found


def _contradictions(seen: Chase, centres: Mapping[int, tuple[Point, ...]], video: Video) -> tuple[str, ...]:
    places = {each.frame: tuple(np.add(each.place, each.shake).tolist()) for each in seen.sightings}
    return tuple(contradictions(places, seen.radius, centres, video.in_file))


def _no_path(video: Video, camera: Camera, paths: Sequence[SpotPath]) -> NothingToMeasure:
    """The refusal of a clip in which no moving object has a path like that of a bouncing bead."""
    within, advice = "", "film the bead with a still camera, state it with --bead-at frame:x,y, or narrow the search"
    if camera.region is not None:
        region = ",".join(f"{side:g}" for side in camera.region)
        within, advice = f" inside --region {region}", "move the region to where the bead falls, or leave it out"
    frames = f"frames {video.first} to {video.last}"
    found = (
        f"none of the {len(paths)} moving objects that were followed{within} ({frames}) goes up or down smoothly for "
        "8 frames or more, by more than 1.5 times its width"
        if paths
        else f"nothing was found to move{within} ({frames})"
    )
    more = "" if camera.region is not None else " with --region, --start and --end"
    return NothingToMeasure(f"{video.path}: {found}; {advice}{more}.", Seen(marks=marks_of(paths)))


def marks_of(paths: Sequence[SpotPath]) -> tuple[Mark, ...]:
    """The longest paths as lines in the picture, with the frames that they last."""
    return path_marks((path.frames, path.centres) for path in sorted(paths, key=lambda path: -len(path.frames)))


@dataclass(frozen=True)
class _Tried:
    """A path that was followed, and how well it shows a bouncing bead."""

    found: _Found
    sound: bool  # it bounces in free flight
    whole: bool  # the bead was seen in nearly all frames from the first to the last one


def _tried(found: _Found) -> _Tried:
    frames = [sighting.frame for sighting in found.seen.sightings]
    span = frames[-1] - frames[0] + 1 if frames else 1
    sound = found.fitted is not None and residual_check(found.fitted).passed
    return _Tried(found, sound, len(frames) >= WHOLE * span)


def _best(tried: Sequence[_Tried]) -> _Found:
    """The path with the most bounces among those that are free flights with little noise."""
    bouncing = [(each, each.found.fitted) for each in tried if each.found.fitted is not None]
    if not bouncing:
        return max(tried, key=lambda each: len(each.found.seen.sightings)).found
    # other moving things may seem to bounce, but hardly in free flight
    grade = max((each.sound, each.whole) for each, _ in bouncing)
    likely = [(each.found, fitted) for each, fitted in bouncing if (each.sound, each.whole) == grade]
    least = min(fitted.noise for _, fitted in likely)
    return max(
        ((found, fitted) for found, fitted in likely if fitted.noise <= NOISIER * least),
        key=lambda each: (each[1].count, -each[1].noise),
    )[0]


def _likely(paths: Sequence[SpotPath], size: float | None) -> tuple[list[SpotPath], list[SpotPath]]:
    """All paths by their likeness to that of a bouncing bead of this radius [px], and those worth following."""
    ranked = sorted(paths, key=lambda path: -likeness(path, size))
    joined = join_flights(ranked, size)
    first = ranked if joined is None else [joined, *ranked]
    best = max((likeness(path, size) for path in first), default=0.0)
    return ranked, [path for path in first[:3] if likeness(path, size) > 0.02 * best]


def _path_stated(
    video: Video, moves: Movement, camera: Camera, seed: Seed, size: float | None, progress: Progress
) -> SpotPath:
    """The path of what looks like the bead at the stated place and is there in the stated frame."""
    where = f"--bead-at {seed.frame}:{seed.at[0]:g},{seed.at[1]:g}"
    seed = replace(seed, frame=video.frame_of(seed.frame))
    if not video.first <= seed.frame <= video.last:
        raise NothingToMeasure(
            f"{video.path}: {where} is outside the frames that are measured, {video.in_file(video.first)} to "
            f"{video.in_file(video.last)}; state the bead in one of these, or change --start and --end."
        )
    radius = size if size is not None else _radius_at(moves.paths, seed)
    if radius is None:
        there = sum(seed.frame in path.frames for path in moves.paths)
        raise NothingToMeasure(
            f"{video.path}: {where} lies on none of the {there} objects that were found to move in this frame; state "
            "the bead's centre in a frame in which it flies.",
            Seen(frame=seed.frame, marks=marks_of(moves.paths)),
        )
    bead = picture_at(video, seed.frame, seed.at, radius, moves)
    paths = [] if bead is None else paths_by_look(video, bead, moves, camera.region, progress)
    away = {
        k: math.dist(path.centres[path.frames.index(seed.frame)], seed.at)
        for k, path in enumerate(paths)
        if seed.frame in path.frames
    }
    nearest = min(away, key=lambda k: away[k], default=None)
    if nearest is None or away[nearest] > 2 * radius:
        raise NothingToMeasure(
            f"{video.path}: {len(paths)} paths of places that look like {where} were found, but none of them passes "
            f"within {2 * radius:.0f} px of it in this frame; state the bead's centre in a frame that shows it "
            "clearly and alone.",
            Seen(frame=seed.frame, marks=marks_of(paths)),
        )
    return paths[nearest]


def _radius_at(paths: Sequence[SpotPath], seed: Seed) -> float | None:
    """Radius [px] of the moving object at the stated place; None if nothing moves there."""
    spots = [path.spots[path.frames.index(seed.frame)] for path in paths if seed.frame in path.frames]
    there = [
        spot
        for spot in spots
        if abs(spot.x - seed.at[0]) <= spot.width / 2 + 2 and abs(spot.y - seed.at[1]) <= spot.height / 2 + 2
    ]
    return min((min(spot.width, spot.height) / 2 for spot in there), default=None)


def _in_true_time(video: Video, seen: Chase, repeats: frozenset[int], drag: AirDrag) -> _Found:
    """Follow the bead of a path; if its flights show that frames were lost, all later times are corrected."""
    pixels = _pixel_track(seen)
    losses, fitted = find_losses(heights_of(pixels), lambda record: fit(record, drag))
    if not losses:
        return _Found(video, seen, pixels, repeats, losses, fitted)
    times = in_time(video.times, tuple(replace(loss, index=seen.sightings[loss.index].frame) for loss in losses))
    video = replace(video, times=times)
    sightings = tuple(replace(sighting, time=float(times[sighting.frame])) for sighting in seen.sightings)
    cuts = tuple(replace(cut, time=float(times[cut.frame])) for cut in seen.cuts)
    seen = replace(seen, sightings=sightings, cuts=cuts)
    return _Found(video, seen, _pixel_track(seen), repeats, losses, fitted)


def _pixel_track(seen: Chase) -> Track:
    """Track in pixels, y up."""
    frames = np.array([sighting.frame for sighting in seen.sightings])
    # next to an occlusion the bead may be seen only in part
    in_part = _beside_a_gap(frames, np.array(seen.path.frames)) & ~_as_usual(seen)
    factor = np.where(in_part, 5.0, 1.0)
    return Track(
        time=np.array([sighting.time for sighting in seen.sightings]),
        position=np.array([(sighting.image.x, -sighting.image.y) for sighting in seen.sightings]).reshape(-1, 2),
        sigma=factor * np.array([sighting.image.sigma for sighting in seen.sightings]),
    )


def _as_usual(seen: Chase) -> npt.NDArray[np.bool_]:
    """Whether misfit and contrast of each sighting are as in most frames, shape (n,)."""
    if not seen.sightings:
        return np.zeros(0, dtype=bool)
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
    """Position [px] and motion [px/frame] expected by the fit, for the frames that need a second search.

    These are frames in which the bead was lost or confused, and frames fitted with the wrong motion blur: next to a
    bounce the displacement between frames is not the motion within a frame.
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
    """Whether the motion blur used in a frame differs from that of the fitted `motion` [px/frame]."""
    return seen.shutter.share * math.dist(taken, motion) > STREAK_OFF
