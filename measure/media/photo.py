from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from rigtwin.lab.arrays import Image
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import UnreadableMedia
from rigtwin.measure.media import pictures as sources
from rigtwin.measure.media.undistort import straight
from rigtwin.measure.media.validation import must_exist, must_fit, must_lie_inside

PHOTOS = (".bmp", ".png", ".jpg", ".jpeg", ".tif", ".tiff")


def read_photo(path: Path, camera: Camera | None = None) -> tuple[Image, tuple[str, ...]]:
    """A photo as BGR, shape (height, width, 3), 8 bit, with its EXIF orientation applied, straightened by the lens.

    And what is odd about it.  Raises `UnreadableMedia`, or `BadInput` where the camera names places outside of it.
    """
    must_exist(path, "photo")
    # decode from memory: imread reports a broken file on stderr by itself, and once more to us as None
    stored = np.fromfile(path, dtype=np.uint8)
    image = cv2.imdecode(stored, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if image is not None and image.dtype not in (np.uint8, np.uint16):
        image = cv2.imdecode(stored, cv2.IMREAD_COLOR)
    notes: tuple[str, ...] = ()
    if image is None:
        photo = _phone_photo(path)
    else:
        shift, told = sources.bit_shift([image])
        photo = sources.dropped(image, shift)
        if told:
            notes = (
                f"{path.name}: none of its 16-bit pixels is brighter than {image.max()}, so it was read as of "
                f"{shift + 8} bits, {2 ** (8 - shift)} times brighter; if the photo is just dim, expose it longer.",
            )
    if camera is not None:
        if camera.lens is not None:
            must_fit(path, photo.shape, camera.lens)
            photo = straight(photo, camera.lens)
        must_lie_inside(path, camera, photo.shape[1], photo.shape[0])
    return photo, notes


def _phone_photo(path: Path) -> Image:
    """What OpenCV does not read: HEIC, and the rest that Pillow knows."""
    import pillow_heif
    from PIL import Image as Pictures
    from PIL import ImageOps, UnidentifiedImageError

    pillow_heif.register_heif_opener()
    try:
        with Pictures.open(path) as photo:
            upright = ImageOps.exif_transpose(photo).convert("RGB")
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        if "truncated" in str(error).lower():
            raise UnreadableMedia(f"{path}: {_what_is_left(path)}; copy it again.") from None
        raise UnreadableMedia(f"{path}: cannot be decoded as a photo; give a JPEG, PNG, TIFF or HEIC file.") from None
    return np.ascontiguousarray(np.asarray(upright)[..., ::-1])


def _what_is_left(path: Path) -> str:
    """How much can be read of a photo whose file is cut off."""
    from PIL import ExifTags, ImageFile
    from PIL import Image as Pictures

    before, ImageFile.LOAD_TRUNCATED_IMAGES = ImageFile.LOAD_TRUNCATED_IMAGES, True
    try:
        with Pictures.open(path) as photo:
            whole = bool(photo.info.get("progressive") or photo.info.get("interlace"))
            turned = photo.getexif().get(ExifTags.Base.Orientation, 1) != 1
            rows = np.asarray(photo.convert("RGB"))
    except (OSError, ValueError, SyntaxError):
        return "the file is cut off, and nothing of the photo can be read"
    finally:
        ImageFile.LOAD_TRUNCATED_IMAGES = before
    # what is missing is filled with one grey, or goes on as the last row that is there
    seen = np.flatnonzero(np.any(rows != rows[-1], axis=(1, 2)))
    there = int(seen[-1]) + 1 if len(seen) else 0
    size = f"{rows.shape[1]} x {rows.shape[0]} px"
    if whole or turned or there >= len(rows) - 1:  # a coarse whole, a part to one side, or all but the end
        return f"the file is cut off: a photo of {size}"
    if there == 0:
        return f"the file is cut off: a photo of {size}, of which only the head can be read"
    return f"the file is cut off: a photo of {size}, of which only the upper {there} rows can be read"
