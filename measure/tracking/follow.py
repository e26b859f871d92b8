"""Follow one bead of known path through a clip: fit its image in every frame.

The pixels around the bead come from the cache of the search (`frame_cache`) or, if that is not sufficient, from another
pass over the video. The video is never held in memory as a whole. The bead is then fitted in these cut-outs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigtwin.lab.arrays import Array, GreyImage, Mask
from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.robust import mad_std
from rigtwin.measure.scene.background import Background
from rigtwin.measure.scene.pose import Pose, rounded, shakes_of
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking.bead_image import BeadFit, Look
from rigtwin.measure.tracking.colour_channel import LUMA, best_channel, channel_without_shadows, luma_is_clear
from rigtwin.measure.tracking.consistency import in_steady_light, scatter
from rigtwin.measure.tracking.cutouts import (
    Cut,
    Sighting,
    around,
    busy,
    cut_around,
    cut_out,
    inside_picture,
    occluders,
    shows,
)
from rigtwin.measure.tracking.detect import Box
from rigtwin.measure.tracking.exposure_time import (
    CLOSER,
    LEAST_SHARE,
    NOT_MEASURED,
    ROUGHLY,
    TRIED,
    Shutter,
    fast_frames,
    shutter_of,
)
from rigtwin.measure.tracking.find_paths import Movement
from rigtwin.measure.tracking.link import SpotPath, place_on
from rigtwin.measure.tracking.refine import common_look, fit_bead

GROWS = 0.03  # minimum relative change of the apparent size over a path: below, the fit's own freedom of 1 % covers it
SURELY = 4.0  # minimum of that change over its standard uncertainty
FEWEST_SIZES = 10  # minimum number of radii for their change over time
BADLY = 2.0  # times the median misfit; a fit above it may be at a wrong position


@dataclass(frozen=True)
class Growth:
    """Apparent size of a bead that moves towards the camera or away from it.

    At constant speed along the line of sight, 1 / size is linear in time (pinhole camera).
    """

    rate: float = 0.0  # [1/frame], of 1 / size
    rate_sigma: float = math.inf  # standard uncertainty
    middle: float = 0.0  # frame in which the size is 1

    def size(self, frame: Array | float) -> Array:
        """Size relative to the frame `middle`."""
        return np.asarray(1 / np.maximum(1 + self.rate * (np.asarray(frame) - self.middle), 0.2))

    @property
    def known(self) -> bool:
        """Whether the bead changes its size at all."""
        return self.rate != 0


STEADY = Growth()


@dataclass(frozen=True)
class Chase:
    """A bead followed through a clip."""

    sightings: tuple[Sighting, ...]
    path: SpotPath
    poses: tuple[Pose, ...]  # one per frame
    shutter: Shutter
    radius: float  # [px]
    scene: Scene = field(repr=False)
    cuts: tuple[Cut, ...] = field(repr=False)
    look: Look | None = field(repr=False)
    hidden: Mask | None = field(repr=False)
    growth: Growth = STEADY

    @property
    def shakes(self) -> Array:
        """Camera shake in every frame [px], shape (frames, 2)."""
        return shakes_of(self.poses)


def _spread(first: int, last: int, count: int) -> set[int]:
    return set(np.unique(np.linspace(first, last, count).round().astype(int)).tolist())


def _spread_along(path: SpotPath, count: int = 12) -> set[int]:
    """Frames of a path at equal distances along it."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path.centres, axis=0).T))])
    places = np.searchsorted(way, np.linspace(0, way[-1], count)).clip(0, len(way) - 1)
    return {path.frames[k] for k in places.tolist()}


def chase(path: SpotPath, moves: Movement, scene: Scene, cuts: Sequence[Cut], progress: Progress = silent) -> Chase:
    """Fit the bead of a path in every cut-out, also before and after its motion.

    Two rounds: the first finds radius, exposure time and occlusions along the path; the second uses them as known.
    """
    cuts = [cut for cut in cuts if cut.frame not in moves.repeated]
    poses = tuple(moves.poses.values())
    moving = [cut for cut in cuts if path.frames[0] <= cut.frame <= path.frames[-1]]
    few = moving[:: max(1, len(moving) // 40)]
    first = _fit_cuts(few, scene, path.radius, progress=progress)
    good = [sighting for sighting in first if sighting.fit.image.sigma < max(0.3, 0.04 * path.radius)]
    if len(good) < 5:
        return Chase(tuple(first), path, poses, NOT_MEASURED, path.radius, scene, tuple(cuts), None, None)
    shutter = NOT_MEASURED
    hidden = occluders(cuts, good, path.radius, scene)
    radius = float(np.median([sighting.image.radius for sighting in good]))
    # learn the look from slow frames; motion blur hides it in fast ones
    slow = sorted(few, key=lambda cut: math.hypot(*cut.step))[: max(15, len(few) // 2)]
    look, growth = None, _growth(good, path)
    for _ in range(2):
        calm = _fit_cuts(slow, scene, radius, growth=growth, shutter=shutter, hidden=hidden, progress=progress)
        if len(calm) < 3:
            break
        look = common_look([_at_size_one(sighting, growth) for sighting in calm])
        radius = look.radius
        cuts, slow = (_moved_by(_off(calm, slow), some) for some in (cuts, slow))
        shutter = measured_shutter(cuts, path, scene, look, hidden, shutter, growth)
    sightings = _fit_cuts(
        cuts, scene, radius, growth=growth, shutter=shutter, hidden=hidden, look=look, progress=progress
    )
    found = Chase(tuple(sightings), path, poses, shutter, radius, scene, tuple(cuts), look, hidden, growth)
    return _steadied(found if look is None else _started_again(found))


def _growth(sightings: Sequence[Sighting], path: SpotPath) -> Growth:
    """Change of the apparent size over sightings whose radii were fitted one by one; none unless it is significant.

    From the slower half of the bead's motion: fingers hold a bead at rest, and motion blur widens a fast one.
    """
    from scipy.stats import theilslopes

    frames, centres = np.array(path.frames), path.centres
    gone = np.flatnonzero(np.hypot(*(centres - np.median(centres[:5], axis=0)).T) > 2 * path.radius)
    begins = frames[gone[0]] if len(gone) else frames[-1]
    speed = np.hypot(*np.gradient(centres, axis=0).T) / np.maximum(np.gradient(frames), 1)
    usual = float(np.median(speed[frames >= begins]))
    at = {frame: k for k, frame in enumerate(path.frames)}
    sightings = [each for each in sightings if each.frame in at and each.frame >= begins]
    sightings = [each for each in sightings if speed[at[each.frame]] <= 1.2 * usual]
    frames = np.array([sighting.frame for sighting in sightings], dtype=np.float64)
    inverse = 1 / np.array([sighting.image.radius for sighting in sightings])
    if len(frames) < FEWEST_SIZES:
        return STEADY
    slope, base, *_ = theilslopes(inverse, frames)
    scatter = mad_std(inverse - base - slope * frames, centre=0.0)
    sigma = scatter / (math.sqrt(len(frames)) * max(float(np.std(frames)), 1e-9))
    middle = float(np.median(frames))
    level = float(base + slope * middle)
    growth = Growth(float(slope) / level, sigma / level, middle)
    change = abs(growth.rate) * float(np.ptp(frames))
    return growth if change > GROWS and abs(growth.rate) > SURELY * growth.rate_sigma else STEADY


def _at_size_one(sighting: Sighting, growth: Growth) -> BeadFit:
    size = float(growth.size(sighting.frame))
    return replace(sighting.fit, look=replace(sighting.fit.look, radius=sighting.fit.look.radius / size))


def _started_again(chase: Chase) -> Chase:
    """Refit frames with a large misfit, starting from the position interpolated between the good frames.

    An object that touches the bead (e.g. a holder) may cause a second local minimum.
    """
    misfits = np.array([sighting.fit.misfit for sighting in chase.sightings])
    good = [sighting for sighting in chase.sightings if sighting.fit.misfit <= BADLY * float(np.median(misfits))]
    if not good:
        return chase
    frames = [sighting.frame for sighting in good]
    places = np.array([(sighting.image.x, sighting.image.y) for sighting in good])
    bad = [
        replace(
            cut,
            near=(float(np.interp(cut.frame, frames, places[:, 0])), float(np.interp(cut.frame, frames, places[:, 1]))),
        )
        for cut in chase.cuts
        if cut.frame not in frames
    ]
    found = {sighting.frame: sighting for sighting in chase.sightings}
    for sighting in _fit_again(chase, bad):
        before = found.get(sighting.frame)
        if before is None or sighting.fit.misfit < before.fit.misfit:
            found[sighting.frame] = sighting
    return replace(chase, sightings=tuple(found[frame] for frame in sorted(found)))


def _off(sightings: Sequence[Sighting], cuts: Sequence[Cut]) -> tuple[float, float]:
    """Median offset of the fitted centres from the expected ones [px]; a shaded bead is not brightest at its centre."""
    near = {cut.frame: cut.near for cut in cuts}
    off = [(each.image.x - near[each.frame][0], each.image.y - near[each.frame][1]) for each in sightings]
    x, y = np.median(np.array(off), axis=0).tolist()
    return x, y


def _moved_by(off: tuple[float, float], cuts: Sequence[Cut]) -> list[Cut]:
    return [replace(cut, near=(cut.near[0] + off[0], cut.near[1] + off[1])) for cut in cuts]


def chase_path(
    video: Video, path: SpotPath, moves: Movement, progress: Progress = silent, *, shadows: bool = False
) -> Chase:
    """Follow the bead of a path: learn the background without the bead, choose the best channel, then `chase`.

    With `shadows` the channel is the one that separates the bead from all that changes around it.
    """
    kept = None if shadows else _from_album(path, moves)
    if kept is not None:
        scene, cuts = kept
        return chase(path, moves, scene, cuts, progress)
    begin, end = busy(path)
    chosen = _spread(max(path.frames[0], begin), min(path.frames[-1], end), Background.capacity)
    along = _spread_along(path) if shadows else set()
    seen, cuts = _seen_and_cut(video, path, moves, chosen | along, progress)
    spread = [frame for frame, _ in seen if frame.index in along] if shadows else [frame for frame, _ in seen[::2]]
    channel = channel_without_shadows(spread, path) if shadows else best_channel(spread, path)
    # gain and offset were found in luma; for another channel the background estimates them again
    layers = {
        frame.index: rounded(
            (pose if channel == LUMA else replace(pose, gain=1.0, offset=0.0)).seen(channel.grey(frame))
        )
        for frame, pose in seen
    }
    del seen, spread  # free the memory of the colour pictures
    scene = _scene_behind(path, layers)
    if channel != LUMA:
        cuts = cut_out(video, path, scene, channel, progress)
    return chase(path, moves, scene, cuts, progress)


def _scene_behind(path: SpotPath, layers: Mapping[int, GreyImage]) -> Scene:
    """Background without the bead of a path, from registered frames."""
    background = _background(layers)
    return background.scene(_bead_in(path, background.indices), reach=_reach(path))


def _scene_within(path: SpotPath, layers: Mapping[int, GreyImage], box: Box, scene: Scene) -> Scene:
    """The background with the part `box` learned again without the bead, from registered frames of this part."""
    background = _background(layers)
    left, top, right, bottom = box
    bead = {index: (x - left, y - top) for index, (x, y) in _bead_in(path, background.indices).items()}
    part = background.scene(bead, reach=_reach(path), laid_over=True)
    picture, noise = scene.picture.copy(), scene.noise.copy()
    picture[top:bottom, left:right], noise[top:bottom, left:right] = part.picture, part.noise
    return Scene(picture, noise)


def _background(layers: Mapping[int, GreyImage]) -> Background:
    background = Background()
    for index, layer in layers.items():
        background.add(index, layer)
    return background


def _bead_in(path: SpotPath, indices: Sequence[int]) -> dict[int, tuple[float, float]]:
    """Interpolated centres [px] of the bead of a path by frame index."""
    frames, centres = np.array(path.frames), path.centres
    return {
        index: (float(np.interp(index, frames, centres[:, 0])), float(np.interp(index, frames, centres[:, 1])))
        for index in indices
    }


def _reach(path: SpotPath) -> float:
    """[px], radius around the centre within which the bead may cover the background."""
    return 1.6 * path.radius + 6


def _from_album(path: SpotPath, moves: Movement) -> tuple[Scene, list[Cut]] | None:
    """Background and cut-outs from the cache; None if it is incomplete or luma has too little contrast."""
    if moves.album is None:
        return None
    album, where = moves.album, place_on(path)
    begin, end = busy(path)
    greys = album.greys(max(path.frames[0], begin), min(path.frames[-1], end))
    if not greys or not luma_is_clear(greys, path):
        return None
    cuts: list[Cut] = []
    shape = moves.scene.picture.shape
    for index in range(begin, end + 1):
        near, step = where(index)
        box = inside_picture(around(path, near, step), shape)
        part = None if box is None else album.cut(index, box)
        if part is not None and box is not None:
            seen = moves.poses[index].seen(part)
            cuts.append(Cut(index, album.times[index], seen, box[0], box[1], near, step, moves.poses[index]))
        elif box is not None and path.frames[0] <= index <= path.frames[-1] and index in moves.poses:
            return None
    if not cuts:
        return None
    left, top = min(cut.left for cut in cuts), min(cut.top for cut in cuts)
    right = max(cut.left + cut.grey.shape[1] for cut in cuts)
    bottom = max(cut.top + cut.grey.shape[0] for cut in cuts)
    within = (left, top, right, bottom)  # only this part of the frames is needed
    layers = {index: rounded(moves.poses[index].seen(grey, within)) for index, grey in greys.items()}
    return _scene_within(path, layers, within, moves.scene), cuts


def _seen_and_cut(
    video: Video, path: SpotPath, moves: Movement, chosen: set[int], progress: Progress
) -> tuple[list[tuple[Frame, Pose]], list[Cut]]:
    """The chosen frames with their poses, and in the same pass the cut-outs in luma."""
    where = place_on(path)
    seen, cuts = [], []
    for frame in video.frames(*busy(path)):
        pose = moves.pose(frame)
        if frame.index in chosen:
            seen.append((frame, pose))
        cuts += cut_around(frame, frame.grey, pose, path, where)
        progress("cutting out the bead", frame.index - video.first + 1, video.last - video.first + 1)
    return seen, cuts


def _fit_again(chase: Chase, cuts: Sequence[Cut]) -> list[Sighting]:
    """Refit cut-outs with the known look, exposure time and occlusions, starting at their expected centre."""
    return _fit_cuts(
        cuts,
        chase.scene,
        chase.radius,
        shutter=chase.shutter,
        hidden=chase.hidden,
        look=chase.look,
        growth=chase.growth,
        surely_near=True,
        progress=silent,
    )


def look_again(chase: Chase, expected: Mapping[int, tuple[tuple[float, float], tuple[float, float]]]) -> Chase:
    """Refit some frames, starting at the expected position.

    `expected` maps frame indices to centre [px] and motion [px/frame]. A frame without a bead at the expected position
    loses its sighting, because the one found elsewhere was not the bead.
    """
    renewed = {sighting.frame: sighting for sighting in chase.sightings if sighting.frame not in expected}
    cuts = [
        replace(cut, near=expected[cut.frame][0], step=expected[cut.frame][1])
        for cut in chase.cuts
        if cut.frame in expected and shows(cut, expected[cut.frame][0])
    ]
    again = _fit_again(chase, cuts)
    for sighting in again:
        (x, y), _ = expected[sighting.frame]
        if math.hypot(sighting.image.x - x, sighting.image.y - y) < 0.7 * chase.radius:
            renewed[sighting.frame] = sighting
    return _steadied(replace(chase, sightings=tuple(renewed[frame] for frame in sorted(renewed))))


def _steadied(chase: Chase) -> Chase:
    """Apply the common shading and the scatter of the positions (see `consistency`) to all sightings."""
    frames = np.array([each.frame for each in chase.sightings])
    images = in_steady_light([each.fit for each in chase.sightings], frames)
    more = scatter(np.array([each.time for each in chase.sightings]), frames, images)
    seen = [
        replace(each, image=replace(image, sigma=more * image.sigma))
        for each, image in zip(chase.sightings, images, strict=True)
    ]
    return replace(chase, sightings=tuple(seen))


def _fit_cuts(
    cuts: Sequence[Cut],
    scene: Scene,
    radius: float,
    *,
    shutter: Shutter = NOT_MEASURED,
    hidden: Mask | None = None,
    look: Look | None = None,
    growth: Growth = STEADY,
    room: float | None = None,
    surely_near: bool = False,
    streaks_held: bool = False,
    progress: Progress,
) -> list[Sighting]:
    found: list[Sighting] = []
    for done, cut in enumerate(cuts):
        size = float(growth.size(cut.frame))
        ahead = _onwards(found[-3:], cut.frame)
        window = np.s_[cut.top : cut.top + cut.grey.shape[0], cut.left : cut.left + cut.grey.shape[1]]
        fit = fit_bead(
            cut.grey,
            scene.picture[window],
            (cut.near[0] - cut.left, cut.near[1] - cut.top),
            radius * size,
            blur_guess=shutter.streak(cut.step),
            blur_uncertainty=None if streaks_held else shutter.streak_uncertainty(cut.step),
            hidden=None if hidden is None else hidden[window],
            look=None if look is None else replace(look, radius=look.radius * size),
            room=room,
            surely_near=surely_near,
            onwards=None if ahead is None else (ahead[0] - cut.left, ahead[1] - cut.top),
        )
        if fit is not None:
            fit = replace(fit, image=replace(fit.image, x=fit.image.x + cut.left, y=fit.image.y + cut.top))
            found.append(Sighting(cut.frame, cut.time, fit.image, cut.pose.shake, fit))
        progress("measuring the bead", done + 1, len(cuts))
    return found


def _onwards(last: Sequence[Sighting], frame: int) -> tuple[float, float] | None:
    """Quadratic extrapolation of the centre [px] from the three previous frames; None if one is missing."""
    if [each.frame for each in last] != [frame - 3, frame - 2, frame - 1]:
        return None
    first, second, third = (each.image for each in last)
    return 3 * (third.x - second.x) + first.x, 3 * (third.y - second.y) + first.y


def measured_shutter(
    cuts: Sequence[Cut],
    path: SpotPath,
    scene: Scene,
    look: Look,
    hidden: Mask | None,
    known: Shutter = NOT_MEASURED,
    growth: Growth = STEADY,
) -> Shutter:
    """The exposure time with the smallest misfit in the fastest frames of a path, searched near `known` if set."""
    ways = fast_frames(path)
    fast = [cut for cut in cuts if cut.frame in ways]
    if len(fast) < 3:
        return NOT_MEASURED
    tried = np.maximum(known.share + CLOSER, LEAST_SHARE * np.arange(1, len(CLOSER) + 1)) if known.measured else TRIED
    misfits = _misfits(fast, tried, max(ways.values()) / 2, scene, look, hidden, growth)
    found = shutter_of(tried[: len(misfits)], misfits, np.array([ways[cut.frame] for cut in fast]))
    return found if known.measured else replace(found, uncertainty=math.hypot(found.uncertainty, ROUGHLY))


def _misfits(
    fast: Sequence[Cut], tried: Array, room: float, scene: Scene, look: Look, hidden: Mask | None, growth: Growth
) -> Array:
    """Misfits [grey levels] with streaks of the shares in `tried`, shape (shares, cuts).

    All shares use the same pixels, with a margin `room` [px] for the longest streak; otherwise a patch with more
    background would have the smaller misfit. Each share starts from the centres of the previous one. The search stops
    after two shares in a row that are worse than the best one.
    """
    misfits: list[list[float]] = []
    for share in tried.tolist():
        sightings = _fit_cuts(
            fast,
            scene,
            look.radius,
            shutter=Shutter(share, 0.0),
            hidden=hidden,
            look=look,
            growth=growth,
            room=room,
            surely_near=bool(misfits),
            streaks_held=True,
            progress=silent,
        )
        found = {sighting.frame: sighting for sighting in sightings}
        misfits.append([found[cut.frame].fit.misfit if cut.frame in found else np.nan for cut in fast])
        fast = [replace(cut, near=found[cut.frame].place) if cut.frame in found else cut for cut in fast]
        seen = np.array(misfits)[:, np.all(np.isfinite(misfits), axis=0)]
        if seen.size and int(np.argmin(np.median(seen, axis=1))) < len(seen) - 2:
            break
    return np.array(misfits)
