"""Follow the beads of a pendulum through a film, fit their swings in pixels, and find the scale."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rigtwin.lab.arrays import Array, Mask
from rigtwin.lab.camera import STATED_SIGMA, Camera, Point
from rigtwin.lab.errors import BadInput, Mark, NothingToMeasure, Seen, seeing
from rigtwin.lab.progress import Progress
from rigtwin.lab.records import Track
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.media.frame_loss import Loss, in_time
from rigtwin.measure.media.video import Video
from rigtwin.measure.pendulum.evaluate import outcomes_of
from rigtwin.measure.pendulum.lost_frames import find_losses
from rigtwin.measure.pendulum.swing_fit import NO_PIVOTS, StatedPivots, SwingFit, fit_swings
from rigtwin.measure.pendulum.swing_model import angles, centres, positions
from rigtwin.measure.pendulum.track_one_bead import find_wall_bead, images_by_frame
from rigtwin.measure.pendulum.track_two_beads import Beads, find_beads, relocate
from rigtwin.measure.tracking.colour_channel import LUMA
from rigtwin.measure.tracking.follow import Chase, look_again
from rigtwin.measure.tracking.stated_centres import contradictions, moved_to, said, stated_centres, with_stated

# Shift of a bead's centre by the background texture and the codec, over the noise of a point.  It depends on position
# or drifts in time, so it does not average out.  Maximum likelihood of the errors of beads in 15 drawn films of known
# truth (benchmarks/measure/background_bias.py) gave 0.35 to 0.5 without drifts.  A larger value is used: the errors of
# the restitution in 71 drawn films of all hardnesses are 0.84 of the stated uncertainty (root mean square), 0.97
# without drifts; in 18 plain ones with usual compression the restitution is 0.0009 too large on average.
GROUND = 0.7


@dataclass(frozen=True)
class Film:
    """The beads followed through a clip, and their swings fitted in pixels (y up)."""

    beads: Beads
    times: Array  # [s], of every frame
    fit: SwingFit
    losses: tuple[Loss, ...] = ()  # lost frames; `times` are corrected for the certain ones
    warnings: tuple[str, ...] = ()  # on stated centres that disagree with the picture


def observe_film(video: Video, camera: Camera, length: float | None, progress: Progress) -> Film:
    """Both beads of a double pendulum in every frame, and their swings; `length` [m] is used in messages only."""
    by_hand = stated_centres(video, camera, beads=2)
    located = find_beads(video, camera.region, stated_length=length, progress=progress)
    beads = _with_stated(located, by_hand, video)
    times, fit, losses = _swings(video, beads, camera, _contradictions(located, beads, video))
    places, velocities, again = _second_look(fit, beads, times)
    located = relocate(video, beads, places, velocities, again)
    beads = _with_stated(located, by_hand, video)
    return Film(beads, times, fit, losses, _contradictions(located, beads, video))


def observe_wall_film(video: Video, camera: Camera, length: float | None, progress: Progress) -> Film:
    by_hand = stated_centres(video, camera)
    chase = find_wall_bead(video, camera.region, stated_length=length, progress=progress)
    located = _one_bead(chase, video)
    beads = _one_bead(with_stated(chase, by_hand, video.times), video)
    times, fit, losses = _swings(video, beads, camera, _contradictions(located, beads, video))
    places, velocities, again = _second_look(fit, beads, times)
    expected = {
        int(beads.frames[k]): ((float(x), float(y)), (float(u), float(v)))
        for k, ((x, y), (u, v)) in enumerate(zip(places[0], velocities[0], strict=True))
        if again[0, k]
    }
    chase = look_again(chase, expected)
    located, beads = _one_bead(chase, video), _one_bead(with_stated(chase, by_hand, video.times), video)
    remarks = _contradictions(located, beads, video)
    with seeing(tracks_seen(beads), remarks):
        tracks = picture_tracks(beads, times)
        fit = fit_clip(video.path, tracks, axis=camera_axis(video), stated=picture_pivots(camera))
    return Film(beads, times, fit, losses, remarks)


def _swings(
    video: Video, beads: Beads, camera: Camera, remarks: Sequence[str]
) -> tuple[Array, SwingFit, tuple[Loss, ...]]:
    """Times [s] of all frames corrected for lost frames, the swings, and the lost frames."""
    times = video.times[beads.frames]
    with seeing(tracks_seen(beads), remarks):
        stated = picture_pivots(camera)
        losses, fit = find_losses(
            times,
            picture_tracks(beads, times),
            lambda tracks: fit_clip(video.path, tracks, axis=camera_axis(video), stated=stated),
        )
    return in_time(times, losses), fit, losses


def _one_bead(chase: Chase, video: Video) -> Beads:
    look = chase.look
    if look is None:
        path = chase.path
        raise NothingToMeasure(
            f"{video.path}: what moves in frames {path.frames[0]} to {path.frames[-1]} does not fit the picture of a "
            "round bead; film the bead larger or with more light, or leave out what else moves with --region.",
            Seen(frame=path.frames[0], marks=(Mark("", [(spot.x, spot.y) for spot in path.spots]),)),
        )
    frames = np.array([index for index in range(video.first, video.last + 1) if index not in video.skipped])
    images = images_by_frame(chase, frames)
    # frames of a bead at rest are not all cut out: use the pose of the next one that is
    cut = np.array([cut.frame for cut in chase.cuts])
    following = np.clip(np.searchsorted(cut, frames), 0, len(cut) - 1)
    poses = tuple(chase.cuts[k].pose for k in following.tolist())
    looked = np.ones((1, len(frames)), dtype=bool)
    return Beads(frames, (images,), [look], chase.shutter.share, chase.scene, LUMA, poses, looked, {})


def _with_stated(beads: Beads, stated: Mapping[int, tuple[Point, ...]], video: Video) -> Beads:
    """Both beads with their stated centres, each of the bead whose path in the other frames is next to it."""
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    number = {int(frame): k for k, frame in enumerate(beads.frames)}
    apart = {number[frame] for frame in stated}
    seen = [
        {k: image for k, image in enumerate(images) if image is not None and k not in apart} for images in beads.images
    ]
    images = [list(each) for each in beads.images]
    if not all(seen):
        return beads  # one that is seen nowhere else is refused for that later
    nearest = min(look.radius for look in beads.looks)
    for frame, points in stated.items():
        if len(points) > 1 and (between := math.dist(*points)) < nearest:
            both = " and ".join(said(video.in_file(frame), point) for point in points)
            raise BadInput(
                f"{video.path}: {both} are {between:.0f} px apart, and beads with a radius of {nearest:.0f} px cannot "
                "both be there; leave one of them out."
            )
        k = number[frame]
        expected = [
            [np.interp(k, list(each), [getattr(image, axis) for image in each.values()]) for axis in ("x", "y")]
            for each in seen
        ]
        away = cdist(np.array(points) - beads.shakes[k], np.array(expected))
        for point, bead in zip(*linear_sum_assignment(away), strict=True):
            like = seen[bead][min(seen[bead], key=lambda j: abs(j - k))]
            images[bead][k] = moved_to(like, points[point], beads.shakes[k])
    return replace(beads, images=tuple(images))


def _contradictions(located: Beads, beads: Beads, video: Video) -> tuple[str, ...]:
    """Sentences on stated centres of `beads` that are far from where they are located in the same frames."""
    said: list[str] = []
    for before, after, look in zip(located.images, beads.images, beads.looks, strict=True):
        seen: dict[int, Point] = {}
        stated: dict[int, tuple[Point, ...]] = {}
        for k, (one, other) in enumerate(zip(before, after, strict=True)):
            if one is not None and other is not None and (one.x, one.y) != (other.x, other.y):
                frame, (x, y) = int(beads.frames[k]), beads.shakes[k].tolist()
                seen[frame], stated[frame] = (one.x + x, one.y + y), ((other.x + x, other.y + y),)
        said += contradictions(seen, look.radius, stated, video.in_file)
    return tuple(said)


def picture_tracks(beads: Beads, times: Array) -> tuple[Track, ...]:
    """Tracks in pixels, y up."""
    tracks = []
    for body, images in zip("AB", beads.images, strict=False):
        seen = [(time, image) for time, image in zip(times, images, strict=True) if image is not None]
        position = np.array([(image.x, -image.y) for _, image in seen]).reshape(-1, 2)
        sigma = np.array([image.sigma for _, image in seen])
        tracks.append(Track(np.array([time for time, _ in seen]), position, sigma, body))
    return tuple(tracks)


def tracks_seen(beads: Beads) -> Seen:
    """Where the beads were located, for the picture of a refusal."""
    places = [[(image.x, image.y) for image in images if image is not None] for images in beads.images]
    return Seen(marks=tuple(Mark(f"bead {name}", track) for name, track in zip("AB", places, strict=False)))


def _second_look(fit: SwingFit, beads: Beads, times: Array) -> tuple[Array, Array, Mask]:
    """Fitted position [px, y down] and velocity [px/frame] of the beads, and the frames that need a second search.

    These are frames around a collision, where the beads touch, and frames in which a bead was lost or confused.
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


def camera_axis(video: Video) -> tuple[float, float]:
    """Principal point of the picture [px, y up]: its middle, unless the film was cropped."""
    return (video.width - 1) / 2, -(video.height - 1) / 2


def picture_pivots(camera: Camera) -> StatedPivots:
    """Stated pivots [px, y up]."""
    return StatedPivots(tuple((x, -y) for x, y in camera.pivots), STATED_SIGMA)


def fit_clip(
    clip: Path,
    tracks: tuple[Track, ...],
    *,
    axis: tuple[float, float] | None = None,
    ground: float = 0.0,
    stated: StatedPivots = NO_PIVOTS,
) -> SwingFit:
    try:
        return fit_swings(tracks, axis=axis, ground=ground, stated=stated)
    except NothingToMeasure as error:
        raise NothingToMeasure(f"{clip}: {error.message}", error.seen) from None


def scale_of(film: Film, camera: Camera, length: float | None, bead_diameter: float | None) -> tuple[float, str]:
    """Scale [m/px] and its source."""
    fit = film.fit
    if camera.given_scale is not None:
        return camera.given_scale, camera.scale_from
    found = fit.propagate(outcomes_of)
    if length is not None:
        return length / found["length"].value, "pendulum length"
    if bead_diameter is not None:
        # two beads touch at the collision; for one bead only its rim is available
        across = found["distance"].value if "distance" in found else 2 * film.beads.looks[0].radius
        return bead_diameter / across, "bead diameter"
    return GRAVITY / found["gravity"].value, "gravity"


def upright(
    film: Film, axis: tuple[float, float], scale: float, roll: float
) -> tuple[tuple[Track, ...], tuple[float, float], StatedPivots]:
    """Tracks, principal point and stated pivots in metres from the rest position of the last bead, y up."""
    swings = film.fit.swings
    rest = centres(swings, np.zeros((swings.beads, 1, 1)))[-1, 0, 0]
    back = np.array([[math.cos(roll), math.sin(roll)], [-math.sin(roll), math.cos(roll)]]) * scale
    tracks = tuple(
        replace(track, position=(track.position - rest) @ back, sigma=track.sigma * scale)
        for track in picture_tracks(film.beads, film.times)
    )
    x, y = (np.array(axis) - rest) @ back
    hinges = tuple((float(u), float(v)) for u, v in (np.array(film.fit.stated.places).reshape(-1, 2) - rest) @ back)
    return tracks, (float(x), float(y)), StatedPivots(hinges, film.fit.stated.sigma * scale)


def roll_warning(fit: SwingFit, camera: Camera) -> tuple[str, ...]:
    if camera.roll is None:
        return ()
    found = math.degrees(-float(fit.swings["tilt"]))
    if abs(found - math.degrees(camera.roll)) < 0.3:
        return ()
    return (
        f"camera roll: {math.degrees(camera.roll):.2f} degrees were given, but the fitted swings show {found:.2f} "
        "degrees; angles are measured from the fitted vertical",
    )
