"""Follow the bead of a wall pendulum through a film: released, thrown back by the wall, repeatedly.

The bead is the object that moves fast to a point and comes back from it (`find_rebound`).  It never leaves its circle,
so every piece of a path on that circle belongs to it.

Picture coordinates: x right, y down, centre of the top-left pixel (0, 0).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.geometry.circle import fit_circle
from rigtwin.measure.media.video import Video
from rigtwin.measure.pendulum.find_collision import (
    LOST,
    Path,
    Region,
    find_paths,
    no_meeting,
    no_swing,
    with_beginning,
)
from rigtwin.measure.pendulum.track_two_beads import as_spots, sample_frames, still_scene
from rigtwin.measure.tracking.bead_image import BeadImage
from rigtwin.measure.tracking.find_paths import Movement
from rigtwin.measure.tracking.follow import Chase, chase_path
from rigtwin.measure.tracking.link import SpotPath


def find_wall_bead(
    video: Video, region: Region | None = None, *, stated_length: float | None = None, progress: Progress = silent
) -> Chase:
    """Locate the bead in every frame; `stated_length` [m] of the pendulum is used in messages only.

    Raises `NothingToMeasure` if nothing is thrown back in the clip.
    """
    samples = sample_frames(video, progress)
    scene = still_scene({index: frame.grey for index, frame in samples.items()})
    paths = find_paths(video, scene, samples, region, progress)
    path = _whole_path(paths, *find_rebound(paths, video, stated_length))
    return chase_path(video, path, Movement([path], {}, frozenset(), scene), progress)


def find_rebound(paths: list[Path], video: Video, stated_length: float | None = None) -> tuple[Path, Path]:
    """The pair of paths of which one ends at high speed where and when the other starts in the opposite direction.

    Raises `NothingToMeasure` when there is none.
    """
    moving = [path for path in paths if path.extent > 3 * float(np.median(path.sizes))]
    if not moving:
        raise no_swing(paths, video)
    best, best_score = None, 0.0
    for fall in [with_beginning(path, paths) for path in moving]:
        for rise in paths:
            score = _rebound(fall, rise)
            if score > best_score:
                best, best_score = (fall, rise), score
    if best is None:
        but = "no path goes back where and when another one ends at speed"
        must = "show the released bead and its way back from the wall (for two beads: variant double)."
        raise no_meeting(moving, video, stated_length, but, must)
    return best


def _rebound(fall: Path, rise: Path) -> float:
    """Score of `rise` as the way back from the end of `fall`; 0 if it is not."""
    wait = rise.frames[0] - fall.frames[-1]
    if not -3 <= wait <= 2 * LOST or len(fall.frames) < 6 or len(rise.frames) < 4:
        return 0.0
    arriving, leaving = fall.velocity(at_end=True), rise.velocity(at_end=False)
    speed = float(np.hypot(*arriving))
    size = float(np.median([*fall.sizes, *rise.sizes]))
    if speed < 1.0 or rise.extent < size or not 0.5 < float(np.median(fall.sizes)) / float(np.median(rise.sizes)) < 2:
        return 0.0
    back = -float(arriving @ leaving) / speed
    if not 0.1 * speed < back < 1.1 * speed or float(np.hypot(*leaving)) > 1.3 * back:
        return 0.0
    # at the end of its swing a pendulum turns back too, but slowly
    fastest = float(np.max(np.hypot(*np.diff(np.array(fall.places), axis=0).T) / np.diff(fall.frames)))
    if speed < 0.5 * fastest or float(np.hypot(*(rise.places[0] - fall.places[-1]))) > size + (abs(wait) + 2) * speed:
        return 0.0
    return (fall.extent + rise.extent) * float(np.sqrt(size))


def _whole_path(paths: list[Path], fall: Path, rise: Path) -> SpotPath:
    """All pieces of paths on the bead's circle with the size of the bead, joined frame by frame."""
    centre, radius = fit_circle(np.array([*fall.places, *rise.places]))
    size = float(np.median([*fall.sizes, *rise.sizes]))
    chosen = {frame: (place, width) for path in (fall, rise) for frame, place, width in _steps(path)}
    for path in paths:
        away = np.abs(np.hypot(*(np.array(path.places) - centre).T) - radius)
        if float(np.median(away)) < 0.3 * size + 1 and 0.6 < float(np.median(path.sizes)) / size < 1.7:
            for frame, place, width in _steps(path):
                chosen.setdefault(frame, (place, width))
    frames = sorted(chosen)
    return as_spots(Path(frames, [chosen[k][0] for k in frames], [chosen[k][1] for k in frames]))


def _steps(path: Path) -> list[tuple[int, Array, float]]:
    return list(zip(path.frames, path.places, path.sizes, strict=True))


def images_by_frame(chase: Chase, frames: npt.NDArray[np.int64]) -> list[BeadImage | None]:
    """Image of the bead in each of `frames`; None where it was not seen."""
    seen = {sighting.frame: sighting.image for sighting in chase.sightings}
    return [seen.get(int(frame)) for frame in frames]
