"""Suffixes of films, pictures and sound recordings, and the order of files whose names have numbers."""

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
        The file.

    Returns
    -------
    tuple
        The key.
    """
    parts = re.split(r"(\d+)", file.name.lower())
    return [(int(part) if part.isdigit() else 0, part) for part in parts], file.name
