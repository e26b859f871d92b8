"""Find the paths of all moving objects in a clip, and the camera shake."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigtwin.lab.progress import Progress, silent
from rigtwin.measure.media.video import Frame, Video
from rigtwin.measure.scene.pose import Pose, stands_still
from rigtwin.measure.scene.scene import Scene
from rigtwin.measure.tracking.detect import Region, Search, Spot
from rigtwin.measure.tracking.frame_cache import Album
from rigtwin.measure.tracking.link import Linker, SpotPath


@dataclass(frozen=True)
class Movement:
    """Paths of the moving objects in a clip and poses of its frames."""

    paths: list[SpotPath]
    poses: Mapping[int, Pose]  # of the frames relative to `scene`, by frame index
    repeated: frozenset[int]  # frames that repeat the previous one; they are not analysed
    scene: Scene = field(repr=False)
    still: bool = False  # the camera is static; otherwise poses are refined when needed
    album: Album | None = field(default=None, repr=False)  # cached parts of the frames, only with a static camera

    def pose(self, frame: Frame) -> Pose:
        """Pose of a frame at full precision."""
        known = self.poses.get(frame.index)
        if known is not None and self.still:
            return known
        return self.scene.pose(frame.grey, (0.0, 0.0) if known is None else known.shake)


def find_paths(video: Video, scene: Scene, region: Region | None, progress: Progress = silent) -> Movement:
    """Paths of everything that moves, and the camera's shake.

    `region` is x, y, width, height [px] of the searched part; None: the whole frame.
    """
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
    # with a shaking camera the frames are read again for precise poses: drop the cache
    kept = album if still else None
    return Movement(linker.paths(), dict(zip(found, poses, strict=True)), repeated, scene, still, kept)
