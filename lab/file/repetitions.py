"""The files of the repetitions of an experiment: names, patterns ("clips/*.mp4") and folders ("clips/")."""

from __future__ import annotations

from collections.abc import Sequence
from glob import has_magic
from pathlib import Path

from rigtwin.lab.errors import BadInput
from rigtwin.lab.input_files import lies_outside
from rigtwin.lab.media_files import FILMS, PICTURES, SOUNDS, in_order
from rigtwin.lab.tracked.table import is_table

Views = tuple[Path, ...]


def expanded(folder: Path, names: Sequence[str], *, together: bool, photos: bool, outside: bool) -> list[Views]:
    """Return the repetitions that one entry of ``repetitions`` names, in natural order.

    Parameters
    ----------
    folder : Path
        The lab's folder.
    names : sequence of str
        File names, patterns or folders.
    together : bool
        Whether all files are views of one repetition.
    photos : bool
        Whether a repetition of the rig is a photo, so that a folder of pictures holds several; else it is one clip.
    outside : bool
        Whether files outside the lab's folder are read.

    Returns
    -------
    list of tuple of Path
        The files of each repetition.

    Raises
    ------
    BadInput
        If a pattern matches nothing, or a folder has nothing that can be measured.
    """
    every = [_files(folder, name, photos=photos, outside=outside) for name in names]
    views = tuple(view for views in every for view in views)
    return [views] if together else [(view,) for view in views]


def _files(folder: Path, name: str, *, photos: bool, outside: bool) -> list[Path]:
    place = folder / name
    beyond = not outside and (".." in Path(name).parts or lies_outside(place, folder))
    if beyond or place.is_file():
        return [place]
    if has_magic(name):
        found = _matching(folder, Path(name))
        if not found:
            raise BadInput(f"no file matches {name!r}; put the media there or correct the pattern.")
        return sorted(found, key=_in_order)
    if not place.is_dir():
        return [place]
    inside = [file for file in place.iterdir() if not file.name.startswith(".")]
    pictures = [file for file in inside if file.suffix.lower() in PICTURES]
    others = [file for file in inside if file.suffix.lower() in (*FILMS, *SOUNDS) or is_table(file)]
    found = [*others, *pictures] if photos else others or ([place] if pictures else [])
    if not found and not photos:  # folders of numbered pictures
        found = [each for each in inside if each.is_dir()]
    if not found:
        raise BadInput(f"nothing in the folder {name!r} can be measured; put the media there or correct the name.")
    return sorted(found, key=_in_order)


def _matching(folder: Path, pattern: Path) -> list[Path]:
    base = folder if pattern.anchor == "" else Path(pattern.anchor)
    try:
        found = base.glob(str(pattern.relative_to(pattern.anchor)))
        return [file for file in found if not file.name.startswith(".")]
    except (ValueError, OSError):  # "**" within a name; a folder that may not be read
        return []


def _in_order(file: Path) -> tuple[object, ...]:
    return (*(in_order(Path(part)) for part in file.parts[:-1]), in_order(file))
