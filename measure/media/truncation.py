"""Whether a film's file is as long as it says it is: copies and recordings break off."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

MATROSKA = b"\x1a\x45\xdf\xa3"
SEGMENT = b"\x18\x53\x80\x67"  # of Matroska: all pictures are in it
STREAMED = (0, 0xFFFFFFFF)  # lengths of a RIFF file whose writer did not know them
INDEX, PICTURES, FRAGMENT = b"moov", b"mdat", b"moof"  # of the MP4 family
ANNOUNCING = (b"styp", b"sidx", b"ssix", b"prft", b"emsg", FRAGMENT)  # boxes of a fragment ahead of its pictures


def breaks_off(path: Path) -> bool:
    """Whether the file ends before a part of it that says how long it is; False where nothing says so.

    Reads files of the MP4 family (ISO 14496-12), AVI (RIFF) and Matroska.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        if head[:4] == b"RIFF":
            length = int.from_bytes(head[4:8], "little")
            # the length leaves out the 8 bytes up to itself, which some writers forget
            return length not in STREAMED and length > size
        if head[:4] == MATROSKA:
            return _segment_breaks_off(file, size)
        return head[4:8] == b"ftyp" and _boxes_break_off(file, size)


def _boxes_break_off(file: BinaryIO, size: int) -> bool:
    """Of the MP4 family: boxes one behind the other, one of which says where the pictures are.

    Behind these two there may follow what a camera appends, which need be no box; not in a film written in fragments,
    which goes on for as long as it announces another one.
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
        if length < 8:  # none: it reaches to the end of the file
            break
        if place + length > size:
            return not appended
        place += length
    file.seek(place)
    # what announces a fragment is shorter than 16 MiB: its length begins with a zero
    head_cut = FRAGMENT in seen and 0 < size - place < 8 and file.read(1) == b"\0"
    return INDEX not in seen or kind in ANNOUNCING or head_cut


def _segment_breaks_off(file: BinaryIO, size: int) -> bool:
    """Of Matroska: a head, then a segment."""
    file.seek(len(MATROSKA))
    head = _number(file)
    file.seek(head or 0, 1)
    if file.read(4) != SEGMENT:
        return False
    length = _number(file)
    return length is not None and file.tell() + length > size


def _number(file: BinaryIO) -> int | None:
    """A number whose first byte tells by its leading zeros how many follow; None where it is left open."""
    first = file.read(1)
    if not first or first[0] == 0:
        return None
    more = 8 - first[0].bit_length()
    value = int.from_bytes(bytes([first[0] ^ (0x80 >> more)]) + file.read(more), "big")
    return None if value == (1 << 7 * (more + 1)) - 1 else value
