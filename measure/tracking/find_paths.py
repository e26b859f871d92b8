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
