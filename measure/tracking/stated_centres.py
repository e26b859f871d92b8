"""Centres of a bead that the user states in frames in which it is located wrongly or not at all."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.camera import STATED_SIGMA, Camera, Point
from rigtwin.lab.errors import BadInput
from rigtwin.measure.media.video import Video
from rigtwin.measure.tracking.bead_image import BeadImage
from rigtwin.measure.tracking.follow import Chase


def stated_centres(video: Video, camera: Camera, beads: int = 1) -> dict[int, tuple[Point, ...]]:
    """The stated centres by frame.

    Parameters
    ----------
    video : Video
        The film, with the frames that are measured.
    camera : Camera
        What is stated.
    beads : int
        How many beads there are.

    Returns
    -------
    dict of int to tuple of Point
        Places [px] by the index of the frame.

    Raises
    ------
    BadInput
        If one lies in a frame that is not measured, or a frame has more of them than beads.
    """
    found: dict[int, list[Point]] = defaultdict(list)
    for one in camera.centre:
        where = f"{video.path}: {said(one.frame, one.at)}"
        frame = video.frame_of(one.frame)
        if not video.first <= frame <= video.last:
            raise BadInput(
                f"{where} is outside the frames that are measured, {video.in_file(video.first)} to "
                f"{video.in_file(video.last)}; leave it out, or change --start and --end."
            )
        if frame in video.skipped:
            raise BadInput(f"{where} lies in a frame that --exclude leaves out; leave one of them out.")
        found[frame].append(one.at)
        if len(found[frame]) > beads:
            many = "a second centre" if beads == 1 else f"a centre too many for {beads} beads"
            raise BadInput(f"{where} is {many} in this frame; leave one of them out.")
    return {frame: tuple(points) for frame, points in found.items()}


def said(frame: int, at: Point) -> str:
    """A stated centre as the option that states it; `frame` is its number in the file."""
    return f"--centre {frame}:{at[0]:g},{at[1]:g}"


def moved_to(image: BeadImage, at: Point, shake: Array) -> BeadImage:
    """The bead at a stated place of the frame, whose scene is shifted by `shake` [px]."""
    return replace(image, x=at[0] - float(shake[0]), y=at[1] - float(shake[1]), sigma=STATED_SIGMA)


def contradictions(
    seen: Mapping[int, Point], radius: float, centres: Mapping[int, tuple[Point, ...]], in_file: Callable[[int], int]
) -> list[str]:
    """Sentences on stated centres of a body that is seen elsewhere in the same frame, by more than its radius [px].

    `seen` is the place [px] by frame where it is located without them, `in_file` the number of a frame in the file.
    """
    return [
        f"{said(in_file(frame), at)} is used as stated, but lies {away:.0f} px from the body, which is seen at "
        f"{seen[frame][0]:.0f},{seen[frame][1]:.0f} in this frame."
        for frame, stated in centres.items()
        for at in stated
        if frame in seen and (away := math.dist(at, seen[frame])) > radius
    ]


def with_stated(seen: Chase, centres: Mapping[int, tuple[Point, ...]], times: Array) -> Chase:
    """A followed bead with its stated centres, in frames in which it was not seen, too.

    Parameters
    ----------
    seen : Chase
        The bead as it was followed.
    centres : mapping of int to tuple of Point
        One place [px] by frame, from `stated_centres`.
    times : ndarray, shape (frames,)
        Time [s] of every frame.

    Returns
    -------
    Chase
        The same with these sightings, whose standard uncertainty is `STATED_SIGMA`.
    """
    if not centres or not seen.sightings:
        return seen
    sightings = {sighting.frame: sighting for sighting in seen.sightings}
    known = np.array(sorted(sightings))
    shakes = {cut.frame: cut.pose.shake for cut in seen.cuts}
    for frame, (at,) in centres.items():
        like = sightings[int(known[np.argmin(np.abs(known - frame))])]
        shake = shakes.get(frame, like.shake)
        image = moved_to(like.image, at, np.array(shake))
        sightings[frame] = replace(like, frame=frame, time=float(times[frame]), image=image, shake=shake)
    return replace(seen, sightings=tuple(sightings[frame] for frame in sorted(sightings)))
