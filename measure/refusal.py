"""The picture that a refused measurement leaves: the frame or photo with what was found in it.

Every measurement of a film or photo that ends with `NothingToMeasure` writes ``NAME-seen.png`` into its folder: stated
places, what changes over a film, and the marks that the refusal carries (`rigtwin.lab.errors.Seen`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial, wraps
from pathlib import Path
from typing import ParamSpec

import cv2
import numpy as np

from rigtwin.lab.arrays import Image, Mask
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import (
    BadInput,
    Mark,
    NothingToMeasure,
    RigtwinError,
    Seen,
    UnreadableMedia,
    rename_options,
    reword,
)
from rigtwin.lab.quantity import Measurement, reworded
from rigtwin.lab.rigs import RIGS
from rigtwin.lab.tracked.table import is_table
from rigtwin.measure.drawing import (
    ORANGE,
    SKY,
    YELLOW,
    Colour,
    draw_circle,
    draw_cross,
    draw_path,
    draw_text,
    line_width,
    save_picture,
    with_strip_below,
)
from rigtwin.measure.media.photo import read_photo
from rigtwin.measure.media.pictures import CUT_OFF
from rigtwin.measure.media.truncation import breaks_off
from rigtwin.measure.media.video import open_video
from rigtwin.measure.robust import mad_std

P = ParamSpec("P")

SMALLEST, LARGEST = 700, 1600  # [px], longest side of the picture: text is legible, details of a photo are kept
MOST_NAMED = 4  # stated places that a message lists
LOOKED_AT = 12  # frames of a film in which changes are searched
LEAST_CHANGE = 12.0  # [grey levels], between two frames; codecs change still regions by less
ABOVE_NOISE = 6.0  # of the noise between frames; the largest of a dozen noisy values reaches 4


def shows_refusals(measure: Callable[P, Measurement]) -> Callable[P, Measurement]:
    """Let a refused measurement leave a picture of what was seen, and name it at the end of the message.

    Parameters
    ----------
    measure : callable
        Function whose first two arguments are the medium (or photos) and the camera; its keyword `out` is the folder.

    Returns
    -------
    callable
        The same function. Without a folder, or for a medium that cannot be decoded, the message stays as it is. A
        measurement that succeeds removes the picture of an earlier refusal; where its reasons, checks and warnings name
        a stated place, they have its value.
    """

    @wraps(measure)
    def shown(*args: P.args, **kwargs: P.kwargs) -> Measurement:
        given, camera, out = args[0], args[1], kwargs.get("out")
        media = [each for each in (given if isinstance(given, Sequence) else [given]) if isinstance(each, Path)]
        try:
            found = measure(*args, **kwargs)
        except BadInput as error:
            if isinstance(error, NothingToMeasure):
                error.message = _with_medium(media, error)
                error.message = _with_stated(media, camera, error)
                error.message = _with_lost_end(media, error)
            if isinstance(out, Path) and (isinstance(error, NothingToMeasure) or error.seen is not None):
                seen = error.seen or Seen()
                medium = seen.medium or (media[0] if len(media) == 1 else None)
                if medium is not None:
                    error.picture = _write(out, medium, _camera(camera, media, medium), seen, error.message)
            raise
        if isinstance(out, Path):
            for medium in media:
                picture_of(medium, out).unlink(missing_ok=True)
        return _with_values(found, camera)

    return shown


def _with_values(found: Measurement, camera: object) -> Measurement:
    """The measurement with the value of each place that all views state alike, where a sentence names none."""
    cameras = camera if isinstance(camera, Sequence) else [camera]
    views = [set(each.stated_options if isinstance(each, Camera) else ()) for each in cameras]
    values = Counter(option.split()[0] for option in set().union(*views))
    alike = set.intersection(*views)
    clear = {name: option for option in alike if values[name := option.split()[0]] == 1}

    def valued(name: str, value: str) -> str | None:
        return None if value else clear.get(f"--{name.replace('_', '-')}")

    clearer: Measurement = reworded(found, partial(rename_options, instead=valued))
    return clearer


def _with_medium(media: Sequence[Path], error: NothingToMeasure) -> str:
    """The message of a refusal with the file: an evaluation, which works on records, names the rig at most."""
    if len(media) != 1 or error.message.startswith(f"{media[0]}: "):
        return error.message
    words = re.sub(rf"^(measure )?({'|'.join(RIGS)}): ", "", error.message)
    return error.message if f"{media[0]}:" in words else f"{media[0]}: {words}"


def _with_lost_end(media: Sequence[Path], error: NothingToMeasure) -> str:
    """The message of a refusal; of a film of which the end is missing it begins with that."""
    medium = media[0] if len(media) == 1 else None
    if medium is None or medium.is_dir() or CUT_OFF in error.message or not breaks_off(medium):
        return error.message
    return f"{medium}: {CUT_OFF} What is left was not measured: {error.message.removeprefix(f'{medium}: ')}"


def _with_stated(media: Sequence[Path], camera: object, error: NothingToMeasure) -> str:
    """The message of a refusal with the stated places that may be its reason: contradicted ones first, others last."""
    medium = (error.seen or Seen()).medium or (media[0] if len(media) == 1 else None)
    if medium is None:
        return error.message
    why = error.message.removeprefix(f"{medium}: ")
    named = f"{medium}: " if error.remarks or why != error.message else ""
    if error.remarks:
        it = "it" if len(error.remarks) == 1 else "them"
        contradicted = "; ".join(each.rstrip(".") for each in error.remarks)
        why = f"{contradicted}: leave {it} out, or correct {it}, first. With {it} nothing was measured: {why}"
    others = [option for option in _camera(camera, media, medium).stated_options if not _names(why, option)]
    if others:
        listed = ", ".join(others[:MOST_NAMED]) + (" ..." if len(others) > MOST_NAMED else "")
        why = f"{why.rstrip('.')}; used as stated: {listed}; what is left out is searched in the picture."
    return named + why


def _names(text: str, option: str) -> bool:
    """Whether a text has an option with this value, not with a longer one that begins like it (``--floor 100``)."""
    return re.search(rf"{re.escape(option)}(?![\w.,:-]*\w)", text) is not None


def _camera(given: object, media: Sequence[Path], medium: Path) -> Camera:
    """The camera of one medium; one of which nothing is stated where it is not among the media."""
    if isinstance(given, Sequence):
        given = dict(zip(media, given, strict=False)).get(medium)
    return given if isinstance(given, Camera) else Camera()


def picture_of(medium: Path, out: Path) -> Path:
    """Where the picture of a refusal is written."""
    return out / f"{medium.stem}-seen.png"


def _write(out: Path, medium: Path, camera: Camera, seen: Seen, why: str) -> Path | None:
    """Write the picture; None if the medium shows none."""
    if is_table(medium):
        return None
    with suppress(RigtwinError):  # a damaged film: the refusal itself matters more
        try:
            picture, when, changed = _of_film(medium, camera, seen.frame)
        except UnreadableMedia:  # a photo
            picture, when, changed = read_photo(medium, camera)[0], "", None
        reason = reword(why).removeprefix(f"{medium}: ").rstrip(".")
        path = picture_of(medium, out)
        save_picture(path, _drawn(picture, changed, camera, seen.marks, [f"not measured: {reason}", when]))
        return path
    return None


def _of_film(clip: Path, camera: Camera, frame: int | None) -> tuple[Image, str, Mask | None]:
    """One frame of a film, when it was taken, and where the film changes."""
    video = open_video(clip, camera)
    chosen = (video.first + video.last) // 2 if frame is None else min(max(frame, video.first), video.last)
    spread = video.spread(LOOKED_AT)
    frames = video.single(spread | {chosen})
    # of a picture that repeats the one before only that one may be there
    shown = min(frames, key=lambda each: abs(each.index - chosen))
    stack = np.stack([cv2.GaussianBlur(each.grey, (0, 0), 1.0) for each in frames]).astype(np.float32)
    change = np.ptp(stack, axis=0)
    noise = mad_std((stack[1] - stack[0]).ravel())
    changed = np.asarray(change > max(LEAST_CHANGE, ABOVE_NOISE * noise))
    when = (
        f"frame {shown.index}, {shown.time:.4f} s; outlined in blue: what differs between {len(frames)} frames "
        f"from {frames[0].index} to {frames[-1].index}"
    )
    return shown.colour, when, changed


def _drawn(picture: Image, changed: Mask | None, camera: Camera, marks: Sequence[Mark], lines: Sequence[str]) -> Image:
    longest = max(picture.shape[:2])
    zoom = min(max(1.0, SMALLEST / longest), LARGEST / longest)
    way = cv2.INTER_AREA if zoom < 1 else cv2.INTER_CUBIC
    drawn = np.array(cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=way), dtype=np.uint8)
    if changed is not None:
        wide = cv2.resize(changed.astype(np.uint8), drawn.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        edges, _ = cv2.findContours(wide, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, edges, -1, SKY, line_width(drawn))
    for mark in _stated(camera):
        _draw(drawn, mark, zoom, YELLOW)
    for mark in marks:
        _draw(drawn, mark, zoom, ORANGE)
    return with_strip_below(drawn, [line for line in lines if line])


def _draw(picture: Image, mark: Mark, zoom: float, colour: Colour) -> None:
    # the centre of the top-left pixel is 0, 0 in both pictures
    points = [((x + 0.5) * zoom - 0.5, (y + 0.5) * zoom - 0.5) for x, y in mark.points]
    if not points:
        return
    if len(points) > 1:
        draw_path(picture, points, colour)
    elif mark.radius > 0:
        draw_circle(picture, points[0], mark.radius * zoom, colour)
    else:
        draw_cross(picture, points[0], 8.0, colour)
    x, y = min(points, key=lambda point: point[1])
    draw_text(picture, reword(mark.label), (x + 4, y - mark.radius * zoom - 4), colour)


def _stated(camera: Camera) -> Iterator[Mark]:
    """Everything that the user stated in the picture."""
    boxes = [("--ignore", box) for box in camera.ignore] + ([("--region", camera.region)] if camera.region else [])
    for option, (x, y, width, height) in boxes:
        yield Mark(option, [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)])
    for mark in camera.places():
        if mark.frames:
            yield replace(mark, label=f"{mark.label}, frame {mark.frames[0]}")
        elif mark.label == "--floor":
            yield replace(mark, points=[*mark.points, (1e5, mark.points[0][1])])
        else:
            yield mark
