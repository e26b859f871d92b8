"""Follow one bead through a clip of a still scene: find what moves, link it into paths, fit the bead in every frame.

Passes over the video, none of which holds it in memory: learn the scene, find the moving spots and keep what is around
them, and, where that is not enough, cut out the bead; then the bead is fitted in the cut-outs.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage, Mask
from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.album import Album
from rigtwin.measure.bead import BeadFit, BeadImage, Look, common_look, fit_bead
from rigtwin.measure.channel import LUMA, Channel, best_channel, luma_is_clear
from rigtwin.measure.light import in_steady_light
from rigtwin.measure.media import Frame, Video
from rigtwin.measure.scene import Background, Pose, Scene, rounded, shakes_of, stands_still
from rigtwin.measure.shutter import CLOSER, LEAST_SHARE, NOT_TOLD, ROUGHLY, TRIED, Shutter, fast_frames, shutter_of
from rigtwin.measure.spots import Box, Linker, Region, Search, Spot, SpotPath, Where, place_on

BADLY = 2.0  # times the usual misfit, from which on a fit may lie in a wrong place
REST = 25  # frames of a bead at rest that are worth a look before and after it moves
CREEPS = 0.25  # [px/frame], up to which a codec may repeat a bead where it was
FEWEST_DIFFERENCES = 12  # of the places of seven frames, from which their scatter is told
SIXTH = (1, -6, 15, -20, 15, -6, 1)  # difference, and its factors
BOUNCES = 5.0  # times the usual difference: of normal numbers one in a thousand is as large
QUICK = 1 / 100  # [s], from frame to frame: over two, 400 px of a swing of 8 rad/s differ by 0.007 px


@dataclass(frozen=True)
class Sighting:
    """The bead in one frame, in the pixels of the still scene."""

    frame: int
    time: float  # [s]
    image: BeadImage
    shake: tuple[float, float]  # [px], add it to a scene position to draw on the frame
    fit: BeadFit = field(repr=False)  # to this frame alone

    @property
    def place(self) -> tuple[float, float]:
        """[px]"""
        return self.image.x, self.image.y


@dataclass(frozen=True)
class Chase:
    """A bead followed through a clip."""

    sightings: tuple[Sighting, ...]
    path: SpotPath
    poses: tuple[Pose, ...]  # of every frame
    shutter: Shutter
    radius: float  # [px]
    scene: Scene = field(repr=False)
    cuts: tuple[Cut, ...] = field(repr=False)
    look: Look | None = field(repr=False)
    hidden: Mask | None = field(repr=False)

    @property
    def shakes(self) -> Array:
        """[px], of the camera in every frame, shape (frames, 2)"""
        return shakes_of(self.poses)


def learn_scene(video: Video, *, quickly: bool = False) -> Background:
    """Background from frames spread evenly over the clip, of a long film such as are soon read where wanted."""
    background = Background()
    for frame in video.single(video.spread(Background.capacity, quickly=quickly)):
        background.add(frame.index, frame.grey)
    return background


def frames_of(video: Video, indices: Collection[int]) -> list[Frame]:
    """Some frames of a video; what lies before the first and behind the last of them is not read."""
    return [frame for frame in video.frames(min(indices), max(indices)) if frame.index in indices]


def _spread(first: int, last: int, count: int) -> set[int]:
    return set(np.unique(np.linspace(first, last, count).round().astype(int)).tolist())


@dataclass(frozen=True)
class Movement:
    """What moves in a clip."""

    paths: list[SpotPath]
    poses: Mapping[int, Pose]  # of the frames against the scene in which the paths were found
    repeated: frozenset[int]  # frames that only repeat the one before; nothing is looked for in them
    scene: Scene = field(repr=False)
    still: bool = False  # whether the camera is known to stand still; else its shake is looked at again where it counts
    album: Album | None = field(default=None, repr=False)  # what was kept of the frames of a camera that stands still

    def pose(self, frame: Frame) -> Pose:
        """Where a frame lies, as exactly as it shows."""
        known = self.poses.get(frame.index)
        if known is not None and self.still:
            return known
        return self.scene.pose(frame.grey, (0.0, 0.0) if known is None else known.shake)


def find_paths(video: Video, scene: Scene, region: Region | None, progress: Progress = silent) -> Movement:
    """Paths of everything that moves, and the camera's shake."""
    search, album = Search(scene, region), Album()
    found: dict[int, list[Spot]] = {}
    for frame in video.frames():
        found[frame.index] = search.spots(frame)
        album.add(frame, found[frame.index])
        progress("finding what moves", frame.index - video.first + 1, video.last - video.first + 1)
    linker, repeated = Linker(), search.repeats.frames()
    for index, spots in found.items():
        if index not in repeated:
            linker.add(index, spots)
    seen = search.all_poses()
    still = stands_still(seen)
    poses = [pose.standing() if still else pose for pose in seen]
    # a shaking camera's frames are read again for their shake, and the album's room is free
    kept = album if still else None
    return Movement(linker.paths(), dict(zip(found, poses, strict=True)), repeated, scene, still, kept)


def chase(path: SpotPath, moves: Movement, scene: Scene, cuts: Sequence[Cut], progress: Progress = silent) -> Chase:
    """Fit the bead of a path in every frame, also before and after the path where it rests.

    Two rounds on the pixels cut out around the bead: the first finds radius and exposure, and what stands in front of
    the bead's path; the second fits again knowing these.
    """
    cuts = [cut for cut in cuts if cut.frame not in moves.repeated]
    poses = tuple(moves.poses.values())
    moving = [cut for cut in cuts if path.frames[0] <= cut.frame <= path.frames[-1]]
    few = moving[:: max(1, len(moving) // 40)]
    first = _fit_cuts(few, scene, path.radius, progress=progress)
    good = [sighting for sighting in first if sighting.fit.image.sigma < max(0.3, 0.04 * path.radius)]
    if len(good) < 5:
        return Chase(tuple(first), path, poses, NOT_TOLD, path.radius, scene, tuple(cuts), None, None)
    shutter = NOT_TOLD
    hidden = _occluders(cuts, good, path.radius, scene)
    radius = float(np.median([sighting.image.radius for sighting in good]))
    # slow frames show the look; fast ones smear it
    slow = sorted(few, key=lambda cut: math.hypot(*cut.step))[: max(15, len(few) // 2)]
    look = None
    for _ in range(2):
        calm = _fit_cuts(slow, scene, radius, shutter=shutter, hidden=hidden, progress=progress)
        if len(calm) < 3:
            break
        look = common_look([sighting.fit for sighting in calm])
        radius = look.radius
        cuts, slow = (_moved_by(_off(calm, slow), some) for some in (cuts, slow))
        shutter = told_shutter(cuts, path, scene, look, hidden, shutter)
    sightings = _fit_cuts(cuts, scene, radius, shutter=shutter, hidden=hidden, look=look, progress=progress)
    found = Chase(tuple(sightings), path, poses, shutter, radius, scene, tuple(cuts), look, hidden)
    return _steadied(found if look is None else _started_again(found))


def _started_again(chase: Chase) -> Chase:
    """Frames whose pixels are badly explained are fitted again from where the bead is in those before and after.

    Something that touches the bead, what holds it say, makes a second place where a disc seems to fit.
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
    """How far beads lie off where their cut-outs have them [px]: the middle of a shaded bead is not its brightest."""
    near = {cut.frame: cut.near for cut in cuts}
    off = [(each.image.x - near[each.frame][0], each.image.y - near[each.frame][1]) for each in sightings]
    x, y = np.median(np.array(off), axis=0).tolist()
    return x, y


def _moved_by(off: tuple[float, float], cuts: Sequence[Cut]) -> list[Cut]:
    return [replace(cut, near=(cut.near[0] + off[0], cut.near[1] + off[1])) for cut in cuts]


def chase_path(video: Video, path: SpotPath, moves: Movement, progress: Progress = silent) -> Chase:
    """`chase` in the best channel, before the scene without the bead, wherever it rests."""
    kept = _from_album(path, moves)
    if kept is not None:
        scene, cuts = kept
        return chase(path, moves, scene, cuts, progress)
    begin, end = _busy(path)
    chosen = _spread(max(path.frames[0], begin), min(path.frames[-1], end), Background.capacity)
    seen, cuts = _seen_and_cut(video, path, moves, chosen, progress)
    channel = best_channel([frame for frame, _ in seen[::2]], path)
    # another mix of colours has another gain: the background finds it
    layers = {
        frame.index: rounded(
            (pose if channel == LUMA else replace(pose, gain=1.0, offset=0.0)).seen(channel.grey(frame))
        )
        for frame, pose in seen
    }
    del seen  # colour pictures are large
    scene = _scene_behind(path, layers)
    if channel != LUMA:
        cuts = _cut_out(video, path, scene, channel, progress)
    return chase(path, moves, scene, cuts, progress)


def _scene_behind(path: SpotPath, layers: Mapping[int, GreyImage]) -> Scene:
    """What the frames, laid over each other, show behind the bead of a path."""
    background = _background(layers)
    return background.scene(_bead_in(path, background.indices), reach=_reach(path))


def _scene_within(path: SpotPath, layers: Mapping[int, GreyImage], box: Box, scene: Scene) -> Scene:
    """The scene with what is behind the bead of a path, learnt from this part of frames that lie over it already."""
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
    """Where the bead of a path is in some frames [px]."""
    frames, centres = np.array(path.frames), path.centres
    return {
        index: (float(np.interp(index, frames, centres[:, 0])), float(np.interp(index, frames, centres[:, 1])))
        for index in indices
    }


def _reach(path: SpotPath) -> float:
    """[px], how far from its centre the bead may cover the scene."""
    return 1.6 * path.radius + 6


def _from_album(path: SpotPath, moves: Movement) -> tuple[Scene, list[Cut]] | None:
    """Scene and cut-outs without reading the film again: where the camera stands still and luma shows the bead well."""
    if moves.album is None:
        return None
    album, where = moves.album, place_on(path)
    begin, end = _busy(path)
    greys = album.greys(max(path.frames[0], begin), min(path.frames[-1], end))
    if not greys or not luma_is_clear(greys, path):
        return None
    cuts: list[Cut] = []
    shape = moves.scene.picture.shape
    for index in range(begin, end + 1):
        near, step = where(index)
        box = _inside(_around(path, near, step), shape)
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
    within = (left, top, right, bottom)  # the rest of the frames need not be copied
    layers = {index: rounded(moves.poses[index].seen(grey, within)) for index, grey in greys.items()}
    return _scene_within(path, layers, within, moves.scene), cuts


def _seen_and_cut(
    video: Video, path: SpotPath, moves: Movement, chosen: set[int], progress: Progress
) -> tuple[list[tuple[Frame, Pose]], list[Cut]]:
    """The chosen frames and how they lie, and in the same pass the cut-outs of luma."""
    where = place_on(path)
    seen, cuts = [], []
    for frame in video.frames(*_busy(path)):
        pose = moves.pose(frame)
        if frame.index in chosen:
            seen.append((frame, pose))
        cuts += _cut(frame, frame.grey, pose, path, where)
        progress("cutting out the bead", frame.index - video.first + 1, video.last - video.first + 1)
    return seen, cuts


def _fit_again(chase: Chase, cuts: Sequence[Cut]) -> list[Sighting]:
    """Cuts fitted with all that is known of the bead by now, which is surely near the place that they name."""
    return _fit_cuts(
        cuts,
        chase.scene,
        chase.radius,
        shutter=chase.shutter,
        hidden=chase.hidden,
        look=chase.look,
        surely_near=True,
        progress=silent,
    )


def look_again(chase: Chase, expected: Mapping[int, tuple[tuple[float, float], tuple[float, float]]]) -> Chase:
    """Fit some frames again, started where the bead is expected.

    `expected` maps frames to centre [px] and motion [px/frame].  A frame in which no bead is found there loses its
    sighting: what was found elsewhere was not the bead.
    """
    renewed = {sighting.frame: sighting for sighting in chase.sightings if sighting.frame not in expected}
    cuts = [
        replace(cut, near=expected[cut.frame][0], step=expected[cut.frame][1])
        for cut in chase.cuts
        if cut.frame in expected and _shows(cut, expected[cut.frame][0])
    ]
    again = _fit_again(chase, cuts)
    for sighting in again:
        (x, y), _ = expected[sighting.frame]
        if math.hypot(sighting.image.x - x, sighting.image.y - y) < 0.7 * chase.radius:
            renewed[sighting.frame] = sighting
    return _steadied(replace(chase, sightings=tuple(renewed[frame] for frame in sorted(renewed))))


def _steadied(chase: Chase) -> Chase:
    """With what the frames of a clip say of each other: how the bead is lit, and how far its places scatter."""
    frames = np.array([each.frame for each in chase.sightings])
    images = in_steady_light([each.fit for each in chase.sightings], frames)
    more = scatter(np.array([each.time for each in chase.sightings]), frames, images)
    seen = [
        replace(each, image=replace(image, sigma=more * image.sigma))
        for each, image in zip(chase.sightings, images, strict=True)
    ]
    return replace(chase, sightings=tuple(seen))


def scatter(times: Array, frames: npt.NDArray[np.int64], images: Sequence[BeadImage]) -> float:
    """How many times their sigma the places of a moving bead scatter about a smooth way; 1 where that is not told.

    `times` [s].  A codec smears the rim of a bead along with the noise, so that single frames seem surer than they
    are.  Of a flight or a swing sixth differences leave nothing but the scatter, at 25 frames a second too.  A codec
    that predicts a frame from the last keeps its error for a while, which differences over every second frame show
    better; a swing's own sixth difference is 64 times larger there, so that they are taken of quick frames only.
    """
    if len(frames) < FEWEST_DIFFERENCES:
        return 1.0
    places = np.array([(image.x, image.y) for image in images])
    variance = np.array([image.sigma**2 for image in images])
    strides = (1, 2) if float(np.median(np.diff(times))) < QUICK else (1,)
    return max(_scatter_over(stride, frames, places, variance) for stride in strides)


def _scatter_over(stride: int, frames: npt.NDArray[np.int64], places: Array, variance: Array) -> float:
    """As `scatter`, of places that lie `stride` sightings apart."""
    reach = 6 * stride
    if len(frames) <= reach:
        return 1.0
    parts = [np.s_[k * stride : len(frames) - reach + k * stride] for k in range(7)]
    off = sum(factor * places[part] for factor, part in zip(SIXTH, parts, strict=True))
    expected = sum(factor**2 * variance[part] for factor, part in zip(SIXTH, parts, strict=True))
    moves = np.hypot(*(places[reach:] - places[:-reach]).T) > reach * CREEPS
    told = moves & (frames[reach:] - frames[:-reach] == reach)
    if np.count_nonzero(told) < FEWEST_DIFFERENCES:
        return 1.0
    apart = (np.abs(off) / np.sqrt(expected)[:, None])[told]
    # those across a bounce stand out far; what is left tells more together than its median does
    usual = apart[apart < BOUNCES * np.median(apart)]
    return max(float(np.sqrt(np.mean(usual**2))), 1.0) if len(usual) else 1.0


def _shows(cut: Cut, place: tuple[float, float]) -> bool:
    return bool(
        cut.left <= place[0] < cut.left + cut.grey.shape[1] and cut.top <= place[1] < cut.top + cut.grey.shape[0]
    )


@dataclass(frozen=True)
class Cut:
    """The pixels around the bead in one frame."""

    frame: int
    time: float
    grey: npt.NDArray[np.float32]
    left: int
    top: int
    near: tuple[float, float]  # [px], in the scene
    step: tuple[float, float]  # [px/frame], motion
    pose: Pose


def _cut_out(video: Video, path: SpotPath, scene: Scene, channel: Channel, progress: Progress) -> list[Cut]:
    where = place_on(path)
    cuts = []
    shake = (0.0, 0.0)
    for frame in video.frames(*_busy(path)):
        grey = channel.grey(frame)
        pose = scene.pose(grey, shake)
        shake = pose.shake
        cuts += _cut(frame, grey, pose, path, where)
        progress("cutting out the bead", frame.index - video.first + 1, video.last - video.first + 1)
    return cuts


def _cut(frame: Frame, grey: GreyImage, pose: Pose, path: SpotPath, where: Where) -> list[Cut]:
    """What is around the bead in one frame; empty where that lies outside."""
    near, step = where(frame.index)
    box = _inside(_around(path, near, step), grey.shape)
    if box is None:
        return []
    return [Cut(frame.index, frame.time, pose.seen(grey, box), *box[:2], near, step, pose)]


def _inside(box: Box, shape: tuple[int, ...]) -> Box | None:
    """The part of a box that a picture of this shape shows; None where that is too little to fit a bead in."""
    left, top, right, bottom = box[0], box[1], min(box[2], shape[1]), min(box[3], shape[0])
    return (left, top, right, bottom) if min(right - left, bottom - top) > 4 else None


def _around(path: SpotPath, near: tuple[float, float], step: tuple[float, float]) -> Box:
    """Left, top, right and bottom of a cut-out."""
    reach = 2.2 * path.radius + 8 + abs(step[0]) + abs(step[1])
    left, top = max(int(near[0] - reach), 0), max(int(near[1] - reach), 0)
    return left, top, max(int(near[0] + reach) + 2, 0), max(int(near[1] + reach) + 2, 0)


def _busy(path: SpotPath) -> tuple[int, int]:
    """First and last frame of interest: while the bead moves, and a while before and after."""
    frames, centres = path.frames, path.centres
    moved = 0.3 * path.radius + 1
    begun = np.flatnonzero(np.hypot(*(centres - np.median(centres[:5], axis=0)).T) > moved)
    going = np.flatnonzero(np.hypot(*(centres - np.median(centres[-5:], axis=0)).T) > moved)
    first = frames[begun[0]] if len(begun) else frames[0]
    last = frames[going[-1]] if len(going) else frames[-1]
    return first - REST, last + REST


def _fit_cuts(
    cuts: Sequence[Cut],
    scene: Scene,
    radius: float,
    *,
    shutter: Shutter = NOT_TOLD,
    hidden: Mask | None = None,
    look: Look | None = None,
    room: float | None = None,
    surely_near: bool = False,
    streaks_held: bool = False,
    progress: Progress,
) -> list[Sighting]:
    found: list[Sighting] = []
    for done, cut in enumerate(cuts):
        ahead = _onwards(found[-3:], cut.frame)
        window = np.s_[cut.top : cut.top + cut.grey.shape[0], cut.left : cut.left + cut.grey.shape[1]]
        fit = fit_bead(
            cut.grey,
            scene.picture[window],
            (cut.near[0] - cut.left, cut.near[1] - cut.top),
            radius,
            blur_guess=shutter.streak(cut.step),
            blur_doubt=None if streaks_held else shutter.streak_doubt(cut.step),
            hidden=None if hidden is None else hidden[window],
            look=look,
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
    """Where the bead of the three frames before is next, if it falls on as it did [px]."""
    if [each.frame for each in last] != [frame - 3, frame - 2, frame - 1]:
        return None
    first, second, third = (each.image for each in last)
    return 3 * (third.x - second.x) + first.x, 3 * (third.y - second.y) + first.y


def told_shutter(
    cuts: Sequence[Cut], path: SpotPath, scene: Scene, look: Look, hidden: Mask | None, known: Shutter = NOT_TOLD
) -> Shutter:
    """The exposure whose streaks fit the fastest frames of a path best; looked for near the one `known` where told."""
    ways = fast_frames(path)
    fast = [cut for cut in cuts if cut.frame in ways]
    if len(fast) < 3:
        return NOT_TOLD
    tried = np.maximum(known.share + CLOSER, LEAST_SHARE * np.arange(1, len(CLOSER) + 1)) if known.told else TRIED
    misfits = _misfits(fast, tried, max(ways.values()) / 2, scene, look, hidden)
    told = shutter_of(tried[: len(misfits)], misfits, np.array([ways[cut.frame] for cut in fast]))
    return told if known.told else replace(told, doubt=math.hypot(told.doubt, ROUGHLY))


def _misfits(fast: Sequence[Cut], tried: Array, room: float, scene: Scene, look: Look, hidden: Mask | None) -> Array:
    """[grey levels], with streaks of the shares in `tried`, shape (shares, cuts); the same pixels for all.

    Else the emptier patch would win; `room` [px] is what the longest streak needs.  Each share is begun where the one
    before has put the beads.  Once two in a row did worse than the best before them, no longer streak is tried.
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


def _occluders(cuts: list[Cut], sightings: list[Sighting], radius: float, scene: Scene) -> Mask | None:
    """Pixels that keep showing the scene where the bead should hide it: something stands in front of the path."""
    centres = _without_jumps(sightings)
    if len(centres) < 4:
        return None
    bright = _brightness(cuts, sightings, scene)
    seen = np.zeros(scene.picture.shape, dtype=np.float32)
    missing = np.zeros(scene.picture.shape, dtype=np.float32)
    for cut in cuts:
        if not sightings[0].frame <= cut.frame <= sightings[-1].frame:
            continue
        x, y = (float(np.interp(cut.frame, centres[:, 0], centres[:, k])) for k in (1, 2))
        window = np.s_[cut.top : cut.top + cut.grey.shape[0], cut.left : cut.left + cut.grey.shape[1]]
        behind = scene.picture[window]
        rows, columns = np.mgrid[: cut.grey.shape[0], : cut.grey.shape[1]]
        slack = np.hypot(*cut.step) / 2 + 1.5
        inside = np.hypot(columns + cut.left - x, rows + cut.top - y) < max(radius - slack, 0)
        contrast = np.abs(bright - behind)
        telling = inside & (contrast > 8 * scene.noise[window])
        gone = telling & (np.abs(cut.grey - behind) < 0.25 * contrast)
        seen[window] += telling
        missing[window] += gone
    hidden = (seen >= 2) & (missing > 0.7 * seen)
    hidden = cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    if not np.any(hidden):
        return None
    return np.asarray(cv2.dilate(hidden.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)


def _without_jumps(sightings: list[Sighting]) -> Array:
    """Frame, x, y of the sightings without those that leave the line between their neighbours."""
    table = np.array([(sighting.frame, sighting.image.x, sighting.image.y) for sighting in sightings])
    if len(table) < 7:
        return table
    middle = (table[2:, 1:] + table[:-2, 1:]) / 2
    off = np.concatenate([[0], np.linalg.norm(table[1:-1, 1:] - middle, axis=1), [0]])
    return table[off < max(6 * float(np.median(off)), 2.0)]


def _brightness(cuts: list[Cut], sightings: list[Sighting], scene: Scene) -> float:
    """Grey level of the bead's middle, median over the clip."""
    by_frame = {cut.frame: cut for cut in cuts}
    levels = []
    for sighting in sightings:
        cut = by_frame[sighting.frame]
        row, column = round(sighting.image.y) - cut.top, round(sighting.image.x) - cut.left
        if 0 <= row < cut.grey.shape[0] and 0 <= column < cut.grey.shape[1]:
            levels.append(float(cut.grey[row, column]))
    return float(np.median(levels)) if levels else 0.0
