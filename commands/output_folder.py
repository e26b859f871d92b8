"""Where results go, so that nothing of another clip or another rig's twin is overwritten.

Beside a measurement's pictures and records stands ``NAME-measurement.json``, the document of ``--json``; it shows whose
results these are: where none is asked for, only the same rig measured from the same content comes to the same folder
again; into one that is asked for no other clip of the same name is measured.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import BadInput, Claimed
from rigtwin.lab.output_files import claimed_folder
from rigtwin.lab.quantity import Measurement


@contextmanager
def results_folder(rig: str, media: Path | Sequence[Path]) -> Iterator[Path]:
    """The first of ``out/drop/r01``, ``r01~2`` ... without another input's results, claimed for this run."""
    every = _each(media)
    first = Path("out") / rig / _name(every[0])
    places = itertools.chain([first], (first.with_name(f"{first.name}~{k}") for k in itertools.count(2)))
    with ExitStack() as claim:
        for place in places:
            if not _free(place, rig, every):
                continue
            with suppress(Claimed):
                claim.enter_context(claimed_folder(place, "taken"))
                if _free(place, rig, every):  # another run may have written there meanwhile
                    break
                claim.close()
        yield place


def claimed(folder: Path) -> AbstractContextManager[None]:
    """Keep the folder of ``--out`` for one run."""
    return claimed_folder(
        folder,
        f"--out: another run of rigtwin is writing into {folder}; wait for it, or give --out a folder of its own.",
    )


def keep(measurement: Measurement, folder: Path, media: Path | Sequence[Path]) -> Measurement:
    """Write the document that shows whose results stand in `folder`."""
    from rigtwin.compare.result_files import document, write_together

    path = _document(folder, measurement.source)
    kept = replace(measurement, files={**measurement.files, "measurement": path})
    written = {**kept.to_json(), "media_sha256": [measurement.source_sha256, *map(sha256, _each(media)[1:])]}
    write_together(folder, {path.name: document(written)})
    return kept


def check_own(folder: Path, rig: str, media: Path | Sequence[Path]) -> None:
    """Refuse a folder with results of another rig, or of media of the same name that are not measured again now."""
    from rigtwin.compare.result_files import would_be_lost

    every = _each(media)
    path = _document(folder, every[0])
    try:
        known = _results(path)
    except (OSError, ValueError, LookupError, TypeError):  # none, or not of ours
        return
    if all(one.is_file() for one in every):
        again = {sha256(one) for one in every}
        if known.rig != rig or not again.issuperset(known.contents):
            raise would_be_lost(folder, known.source, path)


def check_only(rig: str, folder: Path) -> None:
    """Refuse a folder with another rig's twin, whose files would stay beside a document that is not theirs."""
    try:
        other = json.loads((folder / "quantities.json").read_text(encoding="utf-8"))["rig"]
    except (OSError, ValueError, LookupError, TypeError):  # none, or not of ours
        return
    if other != rig:
        raise BadInput(f"--out: {folder} holds results of a {other}; give this twin a folder of its own.")


def _each(media: Path | Sequence[Path]) -> list[Path]:
    return [media] if isinstance(media, Path) else list(media)


def _document(folder: Path, source: Path) -> Path:
    return folder / f"{_name(source)}-measurement.json"


def _name(source: Path) -> str:
    """Of a clip, or of the folder that "." stands for."""
    return source.resolve().stem


class _Results(NamedTuple):
    """Whose results stand in a folder."""

    rig: str
    source: str
    contents: list[str]
    """Digests of all media."""


def _results(path: Path) -> _Results:
    known = json.loads(path.read_text(encoding="utf-8"))
    return _Results(known["rig"], known["source"]["file"], list(known["media_sha256"]))


def _free(folder: Path, rig: str, media: Sequence[Path]) -> bool:
    try:
        known = _results(_document(folder, media[0]))
    except FileNotFoundError:
        return True
    except (ValueError, KeyError, TypeError, NotADirectoryError):  # not of ours
        return False
    if not all(one.exists() for one in media):
        return True
    return (known.rig, known.contents) == (rig, [sha256(one) for one in media])
