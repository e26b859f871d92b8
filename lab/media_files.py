"""Suffixes and first bytes of films, pictures and sound recordings; the order of files whose names have numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

FILMS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".wmv", ".cine")
PICTURES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
SOUNDS = (".wav", ".flac", ".mp3", ".m4a", ".aac", ".ogg", ".opus")
"""Suffixes of files that hold sound and no film."""


def in_order(file: Path) -> tuple[list[Any], str]:
    """Return a key that sorts files naturally: img2 before img10.

    Parameters
    ----------
    file : Path
        File to be sorted by its name.

    Returns
    -------
    tuple
        The key.
    """
    parts = re.split(r"(\d+)", file.name.lower())
    return [(int(part) if part.isdigit() else 0, part) for part in parts], file.name


RIFF, MATROSKA, FILE_TYPE = b"RIFF", b"\x1a\x45\xdf\xa3", b"ftyp"
"""First bytes of a RIFF and a Matroska file; bytes 4 to 8 of a file of the MP4 family (ISO 14496-12)."""

_BEGINNINGS = (
    (rb"\xff\xd8\xff", "a picture (JPEG)", ".jpg"),
    (rb"\x89PNG", "a picture (PNG)", ".png"),
    (rb"II\*\0|MM\0\*", "a picture (TIFF)", ".tif"),
    (rb"BM.{4}\0{4}", "a picture (BMP)", ".bmp"),
    (rb".{4}" + FILE_TYPE + rb"(?:hei[cxms]|mif1|avif)", "a picture (HEIC)", ".heic"),
    (rb".{4}" + FILE_TYPE, "a film (MP4)", ".mp4"),
    (RIFF + rb".{4}AVI ", "a film (AVI)", ".avi"),
    (MATROSKA, "a film (Matroska)", ".mkv"),
    (RIFF + rb".{4}WAVE", "a sound recording (WAV)", ".wav"),
    (rb"fLaC", "a sound recording (FLAC)", ".flac"),
    (rb"OggS", "a sound recording (Ogg)", ".ogg"),
    (rb"ID3[\x02-\x04]", "a sound recording (MP3)", ".mp3"),
    (rb"PK\x03\x04", "a ZIP archive or a spreadsheet", ""),
    (rb"%PDF-", "a PDF document", ""),
)
STL_HEAD, STL_FACET = 84, 50
"""Bytes of a binary STL file: its header with the number of facets, and each facet."""


def kind_of(content: bytes) -> str:
    """Return what a file is by its first bytes, and an STL file by its length.

    Parameters
    ----------
    content : bytes
        The file's content.

    Returns
    -------
    str
        A noun phrase; "" if the kind is not known.

    Examples
    --------
    >>> kind_of(b"\\x89PNG\\r\\n")
    'a picture (PNG)'
    """
    for beginning, kind, _ in _BEGINNINGS:
        if re.match(beginning, content, re.DOTALL):
            return kind
    facets = int.from_bytes(content[STL_HEAD - 4 : STL_HEAD], "little")
    binary = len(content) >= STL_HEAD and len(content) == STL_HEAD + STL_FACET * facets
    text = content.lstrip()[:5].lower() == b"solid" and b"endfacet" in content
    return "an STL file" if binary or text else ""


def ending_of(kind: str) -> str:
    """Return the usual ending of the name of a film, a picture or a sound recording.

    Parameters
    ----------
    kind : str
        As `kind_of` returns it.

    Returns
    -------
    str
        With its dot; "" for other kinds.

    Examples
    --------
    >>> ending_of("a film (MP4)"), ending_of("a PDF document")
    ('.mp4', '')
    """
    return next((ending for _, name, ending in _BEGINNINGS if name == kind), "")
