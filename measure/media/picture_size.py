"""Size of a picture as its header states it, checked before memory is taken for its pixels."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rigtwin.lab.errors import UnreadableMedia

# a damaged photo is refused in our words; Pillow must not write its own to stderr as well
logging.getLogger("PIL").addHandler(logging.NullHandler())

MOST_PIXELS = 210_000_000  # largest photos of telephones have 200 megapixels; read in colour they take 0.6 GB


def must_have_room(path: Path, width: int, height: int) -> None:
    """Refuse a picture of more than `MOST_PIXELS`."""
    if width * height > MOST_PIXELS:
        raise UnreadableMedia(
            f"{path}: states {width} x {height} px, more than the {MOST_PIXELS // 10**6} megapixels that are read; "
            "make it smaller."
        )


@contextmanager
def header_of(path: Path) -> Iterator[Any]:
    """The photo as Pillow opens it, its pixels still unread.  Refuses one that states too many of them."""
    from PIL import Image

    before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None  # `MOST_PIXELS` takes its place
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged metadata
            with Image.open(path) as photo:
                must_have_room(path, *photo.size)
                yield photo
    finally:
        Image.MAX_IMAGE_PIXELS = before


def must_be_small_enough(path: Path) -> None:
    """Refuse a photo whose header states too many pixels.  A header that cannot be read is the decoder's to refuse."""
    try:
        with header_of(path):
            return
    except (UnreadableMedia, MemoryError):
        raise
    except Exception:  # of a kind that only other libraries read, or damaged
        pass
    with path.open("rb") as file:
        if file.read(4) not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return
    import tifffile

    try:
        with tifffile.TiffFile(path) as stack:
            page: Any = stack.pages[0]
            width, height = int(page.imagewidth), int(page.imagelength)
    except MemoryError:
        raise
    except Exception:
        raise UnreadableMedia(f"{path}: the header of this TIFF file is damaged; save the photo again.") from None
    must_have_room(path, width, height)
