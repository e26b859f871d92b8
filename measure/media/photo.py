"""Read photos (JPEG, PNG, TIFF, HEIC) as 8-bit BGR arrays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rigtwin.lab.arrays import FloatImage, Image
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput, UnreadableMedia
from rigtwin.lab.media_files import kind_of
from rigtwin.measure.media import pictures as sources
from rigtwin.measure.media.ignored_regions import covered
from rigtwin.measure.media.picture_size import header_of, must_be_small_enough
from rigtwin.measure.media.undistort import straight
from rigtwin.measure.media.validation import must_exist, must_fit, must_lie_inside

COMPARED_SIDE, COMPARED_PART = 256, 16  # [px], sides of reduced pictures that are compared, and of their parts
STRUCTURED = 0.3  # least power of the fine structure of a part, over the mean of all
# power of the difference of a part over that of its structure: below 0.02 in copies of JPEG quality 30 to 90, above 0.4
# in some part of different pictures
MOST_APART = 0.1


def read_photo(path: Path, camera: Camera | None = None) -> tuple[Image, tuple[str, ...]]:
    """Read a photo, apply its EXIF orientation and correct lens distortion and perspective.

    Parameters
    ----------
    path : Path
        JPEG, PNG, BMP, TIFF, HEIC or any other file that OpenCV or Pillow reads.
    camera : Camera, optional
        Its `lens` corrects distortion and perspective; what it states must lie inside the photo; its regions
        to `ignore` are covered (see `ignored_regions`).

    Returns
    -------
    photo : array, shape (height, width, 3), uint8
        The picture in BGR order.
    notes : tuple of str
        Warnings for the user, e.g. that a 16-bit file uses only some of its bits.

    Raises
    ------
    UnreadableMedia
        The file is missing, empty, a folder, cut off or not a photo.
    BadInput
        The photo's size differs from that of the calibration board, or `camera` names a place outside the photo.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "grey.png"
    ...     _ = path.write_bytes(cv2.imencode(".png", np.full((4, 6), 128, np.uint8))[1].tobytes())
    ...     photo, notes = read_photo(path)
    >>> photo.shape, notes
    ((4, 6, 3), ())
    """
    must_exist(path, "photo")
    # decode from memory: imread would also write its own message about a broken file to stderr
    must_be_small_enough(path)
    stored = np.fromfile(path, dtype=np.uint8)
    image = sources.decoded(path, stored, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if image is not None and image.dtype not in (np.uint8, np.uint16):
        image = sources.decoded(path, stored, cv2.IMREAD_COLOR)
    notes: tuple[str, ...] = ()
    if image is None:
        photo = _phone_photo(path, stored)
    else:
        shift, reduced = sources.bit_shift([image])
        photo = sources.dropped(image, shift)
        if reduced:
            notes = (
                f"{path.name}: its brightest 16-bit pixel has the value {image.max()}, so it was read as a "
                f"{shift + 8}-bit photo, {2 ** (8 - shift)} times brighter; if it is only underexposed, expose longer.",
            )
    if camera is not None:
        if camera.lens is not None:
            must_fit(path, photo.shape, camera.lens)
            photo = straight(photo, camera.lens)
        must_lie_inside(path, camera, photo.shape[1], photo.shape[0])
        photo = covered(photo, camera.ignore) if camera.ignore else photo
    return photo, notes


def all_show_different(pictures: Mapping[Path, Image]) -> None:
    """Refuse photos of which one is the picture of another: smaller, compressed again, mirrored, or the next shot.

    Counted twice it would make the uncertainty of the mean over views too small.  Views of one heap from one place, or
    of two heaps before one background, differ somewhere in what is as fine as grains.
    """
    seen: list[tuple[Path, FloatImage]] = []
    for photo, picture in pictures.items() if len(pictures) > 1 else ():
        fine = _fine_structure(picture)
        for earlier, known in seen:
            mirrored = _same_picture(known, np.ascontiguousarray(fine[:, ::-1]))
            if mirrored or _same_picture(known, fine):
                raise BadInput(
                    f"{photo}: shows the same picture as {earlier}{', mirrored' * mirrored}; a copy is no view of its "
                    "own: take one of them out."
                )
        seen.append((photo, fine))


def _fine_structure(picture: Image) -> FloatImage:
    """The picture reduced to squares of `COMPARED_SIDE`, without what is coarse or as fine as noise."""
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    small = cv2.resize(grey, (COMPARED_SIDE, COMPARED_SIDE), interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), 1.0) - cv2.GaussianBlur(small, (0, 0), 4.0))


def _same_picture(one: FloatImage, other: FloatImage) -> bool:
    """Whether all parts of two pictures agree that show a structure in either."""
    count = COMPARED_SIDE // COMPARED_PART
    first, second = (
        picture.reshape(count, COMPARED_PART, count, COMPARED_PART).swapaxes(1, 2).reshape(count * count, -1)
        for picture in (one, other)
    )
    power = np.maximum(np.mean(first**2, axis=1), np.mean(second**2, axis=1))
    structured = power > max(float(np.mean(power)) * STRUCTURED, 1.0)
    apart = np.mean((first - second) ** 2, axis=1)[structured] / power[structured]
    return bool(apart.size and apart.max() < MOST_APART)


def _phone_photo(path: Path, stored: Image) -> Image:
    """Read formats that OpenCV does not support: HEIC and others that Pillow knows."""
    import pillow_heif
    from PIL import ImageOps

    pillow_heif.register_heif_opener()
    try:
        with header_of(path) as photo:
            upright = ImageOps.exif_transpose(photo).convert("RGB")
    except (UnreadableMedia, MemoryError):
        raise
    except Exception as error:  # decoders raise errors of every kind at damaged files
        if "truncated" in str(error).lower():
            raise UnreadableMedia(f"{path}: {_what_is_left(path)}; copy it again.") from None
        kind = kind_of(stored.tobytes())
        if "picture" in kind:
            raise UnreadableMedia(
                f"{path}: is {kind} that cannot be decoded; copy it again, or save it anew."
            ) from None
        what = f"is {kind} and no photo" if kind else "cannot be decoded as a photo"
        raise UnreadableMedia(f"{path}: {what}; give a JPEG, PNG, TIFF or HEIC file.") from None
    return np.ascontiguousarray(np.asarray(upright)[..., ::-1])


def _what_is_left(path: Path) -> str:
    """Describe how much of a truncated photo can be read."""
    from PIL import ExifTags, ImageFile

    before, ImageFile.LOAD_TRUNCATED_IMAGES = ImageFile.LOAD_TRUNCATED_IMAGES, True
    try:
        with header_of(path) as photo:
            whole = bool(photo.info.get("progressive") or photo.info.get("interlace"))
            turned = photo.getexif().get(ExifTags.Base.Orientation, 1) != 1
            photo.load()
            width, height = photo.size
            there = _rows_above_the_fill(photo)
    except (UnreadableMedia, MemoryError):
        raise
    except Exception:
        return "the file is cut off, and nothing of the photo can be read"
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = before
    size = f"{width} x {height} px"
    # progressive: the whole picture at low resolution; rotated: the missing part is not at the bottom
    if whole or turned or there >= height - 1:
        return f"the file is cut off: a photo of {size}"
    if there == 0:
        return f"the file is cut off: a photo of {size}, of which only the header can be read"
    return f"the file is cut off: a photo of {size}, of which only the upper {there} rows can be read"


def _rows_above_the_fill(photo: Any) -> int:
    """Number of rows above those that are like the last one.

    The decoder fills missing rows with one grey level or repeats the last row.  They are compared one at a time: all
    of them together take as much memory again as the photo.
    """

    def row(number: int) -> bytes:
        return bytes(photo.crop((0, number, photo.width, number + 1)).tobytes())

    last = row(photo.height - 1)
    return next((number + 1 for number in reversed(range(photo.height - 1)) if row(number) != last), 0)
