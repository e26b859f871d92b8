"""What a clip, photo or folder of pictures holds, as one number that tells it from any other."""

from __future__ import annotations

import hashlib
from pathlib import Path


def sha256(path: Path) -> str:
    """Hex digest of a file's content; of a folder, of its files' names and contents in the order of their names."""
    if path.is_file():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    whole = hashlib.sha256()
    for one in sorted(file for file in path.iterdir() if file.is_file()):
        whole.update(f"{one.name}\n{sha256(one)}\n".encode())
    return whole.hexdigest()
