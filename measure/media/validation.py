"""Refuse input that cannot be read or does not fit the picture."""

from __future__ import annotations

import math
from pathlib import Path

from rigtwin.lab.camera import Camera, Lens, Line
from rigtwin.lab.errors import BadInput, UnreadableMedia
from rigtwin.lab.input_files import why_not_ordinary

SMALLEST_REGION = 8  # [px], sides of what is searched; filters over a picture of fewer find no grain in it
# share of a base line that must be in the picture: a photo may cut off its ends, a mistyped end lies far outside
MOSTLY = 0.5
FARTHEST = 1e6  # [px], distance of a stated end from the picture; OpenCV takes no larger numbers than 2^31 eighths
SMALLEST = 5  # [px], minimum width and height


def must_lie_inside(path: Path, camera: Camera, width: int, height: int) -> None:
    """Refuse a place that is stated outside the picture, and what is ignored if it is all of the picture."""
    outside = f"outside the picture of {width} x {height} px."
    if camera.region is not None and (camera.region[0] >= width or camera.region[1] >= height):
        raise BadInput(f"{path}: --region begins at {camera.region[0]:g},{camera.region[1]:g}, {outside}")
    if camera.region is not None:
        x, y, wide, tall = camera.region
        wide, tall = min(x + wide, width) - max(x, 0), min(y + tall, height) - max(y, 0)
        if min(wide, tall) < SMALLEST_REGION:
            raise BadInput(
                f"{path}: --region shows {max(wide, 0):g} x {max(tall, 0):g} px of the picture, at least "
                f"{SMALLEST_REGION} x {SMALLEST_REGION} px are needed; give a larger one."
            )
    for option, (x, y) in ((mark.label, point) for mark in camera.places() for point in mark.points):
        if option == "--base" and camera.base is not None and _share_inside(camera.base, width, height) > MOSTLY:
            continue
        if not (-1 <= x <= width and -1 <= y <= height):
            place = f"the row {y:g}" if option == "--floor" else f"a point at {x:g},{y:g}"
            raise BadInput(f"{path}: {option} names {place}, {outside}")
    for x, y, wide, tall in camera.ignore:
        if x >= width or y >= height or x + wide <= 0 or y + tall <= 0:
            raise BadInput(f"{path}: --ignore {x:g},{y:g},{wide:g},{tall:g} lies {outside}")
        if x < 1 and y < 1 and x + wide > width - 1 and y + tall > height - 1:
            raise BadInput(
                f"{path}: --ignore {x:g},{y:g},{wide:g},{tall:g} covers the whole picture; name only what disturbs."
            )
    if camera.circle is not None and camera.circle[2] > max(width, height):
        raise BadInput(
            f"{path}: --circle has a radius of {camera.circle[2]:g} px, more than {width} x {height} px show."
        )


def _share_inside(line: Line, width: int, height: int) -> float:
    """Share of a line that lies inside the picture; 0 where an end is further away than `FARTHEST`."""
    import cv2

    if max(abs(value) for point in line for value in point) > FARTHEST:
        return 0.0
    first, last = ((round(8 * x), round(8 * y)) for x, y in line)  # whole numbers are needed
    crosses, entry, leaving = cv2.clipLine((0, 0, 8 * width, 8 * height), first, last)
    return math.dist(entry, leaving) / 8 / math.dist(*line) if crosses else 0.0


def must_fit(path: Path, shape: tuple[int, ...], lens: Lens) -> None:
    height, width = shape[:2]
    if (width, height) != lens.size:
        raise BadInput(
            f"{path}: has {width} x {height} px, the board was photographed with {lens.size[0]} x {lens.size[1]} px; "
            "photograph the board with the same camera, lens and resolution."
        )


def must_exist(path: Path, kind: str) -> None:
    if not path.exists():
        raise UnreadableMedia(f"{path}: no such file; check the path of the {kind}.")
    if path.is_dir():
        if kind == "video":
            return  # of numbered pictures
        raise UnreadableMedia(f"{path}: is a folder, not a {kind}; give the file itself.")
    if why := why_not_ordinary(path):
        raise UnreadableMedia(f"{path}: {why}; give the {kind} itself.")
    if path.stat().st_size == 0:
        raise UnreadableMedia(f"{path}: is empty (0 bytes); copy the {kind} again.")
