"""Detect truncated video files: MP4 family, AVI and Matroska."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from rigtwin.lab.media_files import FILE_TYPE, MATROSKA, RIFF

SEGMENT = b"\x18\x53\x80\x67"  # Matroska element that holds all pictures
STREAMED = (0, 0xFFFFFFFF)  # RIFF lengths written when the length was unknown
INDEX, PICTURES, FRAGMENT = b"moov", b"mdat", b"moof"  # box types of the MP4 family
ANNOUNCING = (b"styp", b"sidx", b"ssix", b"prft", b"emsg", FRAGMENT)  # boxes that precede a fragment's pictures


def breaks_off(path: Path) -> bool:
    """Whether the file is shorter than one of its parts states; False if no length is stated.

    Reads files of the MP4 family (ISO 14496-12), AVI (RIFF) and Matroska.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        if head[:4] == RIFF:
            length = int.from_bytes(head[4:8], "little")
            # the length excludes the 8 bytes of the header; some writers include them
            return length not in STREAMED and length > size
        if head[:4] == MATROSKA:
            return _segment_breaks_off(file, size)
        return head[4:8] == FILE_TYPE and _boxes_break_off(file, size)


def _boxes_break_off(file: BinaryIO, size: int) -> bool:
    """The MP4 family: consecutive boxes, among them the index and the pictures.

    After these two a camera may append data that are not boxes. A fragmented file is complete when its last box does
    not announce another fragment.
    """
    place = 0
    seen: set[bytes] = set()
    kind = b""
    while place + 8 <= size:
        file.seek(place)
        head = file.read(16)
        length, kind = int.from_bytes(head[:4], "big"), head[4:8]
        if not (kind.isascii() and kind.decode("ascii").isprintable()):
            break
        fragments = ANNOUNCING if FRAGMENT in seen else (FRAGMENT,)
        appended = seen >= {INDEX, PICTURES} and kind not in (INDEX, PICTURES, *fragments)
        seen.add(kind)
        if length == 1:
            length = int.from_bytes(head[8:16], "big")
        if length < 8:  # no length: the box extends to the end of the file
            break
        if place + length > size:
            return not appended
        place += length
    file.seek(place)
    # a box that announces a fragment is shorter than 16 MiB, so its length begins with a zero byte
    head_cut = FRAGMENT in seen and 0 < size - place < 8 and file.read(1) == b"\0"
    return INDEX not in seen or kind in ANNOUNCING or head_cut


def _segment_breaks_off(file: BinaryIO, size: int) -> bool:
    """Matroska: a header, then one segment."""
    file.seek(len(MATROSKA))
    head = _number(file) or 0
    if file.tell() + head > size:
        return True
    file.seek(head, 1)
    if file.read(4) != SEGMENT:
        return False
    length = _number(file)
    return length is not None and file.tell() + length > size


def _number(file: BinaryIO) -> int | None:
    """An EBML variable-length integer: the leading zeros of the first byte give the length; None if unknown."""
    first = file.read(1)
    if not first or first[0] == 0:
        return None
    more = 8 - first[0].bit_length()
    value = int.from_bytes(bytes([first[0] ^ (0x80 >> more)]) + file.read(more), "big")
    return None if value == (1 << 7 * (more + 1)) - 1 else value
