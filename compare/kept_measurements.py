"""Measurements that are kept beside the results, so that no repetition is measured twice.

A measurement is found again by a digest of its media, of all settings that it depends on, of the program, and of the
folder of its pictures, in which another clip of the same name may come to stand.  It is used as long as its checksum
fits and the pictures that were written with it are there as they were: other settings write theirs under the same
names.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.compare.result_files import plain, write_arrays
from rigtwin.lab.camera import Camera
from rigtwin.lab.checksums import json_sha256, sha256
from rigtwin.lab.errors import Mark
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.input_files import DAMAGED, lies_outside
from rigtwin.lab.output_files import replacing
from rigtwin.lab.quantity import Check, Measurement, Quantity
from rigtwin.lab.records import Profile, Series, Track
from rigtwin.lab.version import __version__

FOLDER = "measured"  # in the folder of results
_RECORDS: Mapping[str, tuple[type[Any], tuple[str, ...]]] = {
    "tracks": (Track, ("time", "position", "sigma")),
    "profiles": (Profile, ("x", "height", "sigma")),
    "series": (Series, ("time", "value")),
}
"""Records of a measurement, each with the fields that are arrays."""
_KNOWN = frozenset(
    (
        "id",
        "rig",
        "particle",
        "wall",
        "camera",
        "cameras",
        "rejected",
        "with_rejected",
        "repetitions",
        "table",
        "outside",
        "measured",
        "scatter",
    )
)
"""Fields of an experiment that do not count in measuring, or are in the key already."""


class KeptMeasurements:
    """The measurements that are kept in a folder of results, one JSON document each, with arrays beside it.

    Parameters
    ----------
    out : Path
        Folder of results.
    """

    def __init__(self, out: Path) -> None:
        self._out = out

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return (self._out / FOLDER).is_dir()

    def key(self, experiment: Experiment, views: Sequence[Path], known: Mapping[str, Any], folder: Path) -> str:
        """Return a digest of what decides the measurement of a repetition.

        Parameters
        ----------
        experiment : Experiment
            Experiment of the repetition.
        views : sequence of Path
            Media of the repetition.
        known : mapping
            Keyword arguments of the rig's `measure`.
        folder : Path
            Folder of its pictures, in that of the results.

        Returns
        -------
        str
            20 hexadecimal digits.
        """
        names = {one.name for one in fields(experiment)} - _KNOWN
        further = {name: _of_views(getattr(experiment, name), views) for name in names}
        settings = {
            **further,
            "rig": experiment.rig_name,
            "known": dict(known),
            "cameras": [_plain(experiment.camera_of(view)) for view in views],
            "table": asdict(experiment.table),
            "files": [view.name for view in views],
            "folder": folder.relative_to(self._out).as_posix(),
            "content": [sha256(view) for view in views],
            "version": __version__,
            "code": _code_digest(),
        }
        return json_sha256(plain(settings))[:20]

    def find(self, key: str, views: Sequence[Path]) -> Measurement | str | None:
        """Return a measurement that is kept.

        Parameters
        ----------
        key : str
            Digest from `key`.
        views : sequence of Path
            Media of the repetition.

        Returns
        -------
        Measurement or str or None
            The measurement, or why it failed; None where neither is known.
        """
        try:
            document = dict(json.loads(self._place(key, ".json").read_text(encoding="utf-8")))
            if document.pop("checksum") != json_sha256(document) or document["key"] != key:
                return None
            if not all(_is_there(one, self._out) for one in dict(document["files"]).values()):
                return None
            if "failed" in document:
                return str(document["failed"])
            stored = self._place(key, ".npz").read_bytes()  # a damaged file would stay open
            if document["arrays"] != hashlib.sha256(stored).hexdigest():
                return None
            with np.load(io.BytesIO(stored), allow_pickle=False) as file:
                return _measurement(document, dict(file), views[0], self._out)
        except DAMAGED:  # or none is there
            return None

    def keep(self, key: str, found: Measurement | str, picture: Path | None = None) -> None:
        """Keep a measurement.

        Parameters
        ----------
        key : str
            Digest from `key`.
        found : Measurement or str
            The measurement, or why it failed.
        picture : Path, optional
            Picture of what was seen when it failed.
        """
        (self._out / FOLDER).mkdir(parents=True, exist_ok=True)
        if isinstance(found, str):
            result: dict[str, Any] = {
                "failed": found,
                "files": _pictures({"seen": picture} if picture else {}, self._out),
            }
        else:
            result, arrays = _result(found, self._out)
            result["arrays"] = write_arrays(self._place(key, ".npz"), arrays)
        content = plain({"key": key, **result})
        with replacing(self._place(key, ".json")) as part:
            whole = {**content, "checksum": json_sha256(content)}
            part.write_text(json.dumps(whole, ensure_ascii=False), encoding="utf-8")

    def _place(self, key: str, suffix: str) -> Path:
        return self._out / FOLDER / f"{key}{suffix}"


def _plain(camera: Camera) -> dict[str, Any]:
    """The camera with the content of its board's photo in place of the name."""
    settings = asdict(camera)
    if camera.board is not None:
        settings["board"]["photo"] = sha256(camera.board.photo)
    return settings


def _of_views(value: Any, views: Sequence[Path]) -> Any:
    """What a field says of these files, where it says something of each file."""
    if isinstance(value, Mapping) and all(isinstance(name, Path) for name in value):
        return {view.name: value[view] for view in views if view in value}
    return value


@cache
def _code_digest() -> str:
    """Digest of the code and models that measure, which change within a version while it is developed."""
    whole = hashlib.sha256()
    package = Path(__file__).resolve().parents[1]
    for folder in ("lab", "measure"):
        for file in sorted((package / folder).rglob("*")):
            if file.suffix in (".py", ".onnx"):
                whole.update(f"{file.relative_to(package).as_posix()}\n".encode())
                whole.update(file.read_bytes())
    return whole.hexdigest()


def _pictures(files: Mapping[str, Path], out: Path) -> dict[str, dict[str, str]]:
    """Names of the files in the folder of results, with what they hold."""
    return {
        kind: {
            "path": path.resolve().relative_to(out.resolve()).as_posix(),
            "sha256": sha256(path) if path.is_file() else "",  # it was taken away since
        }
        for kind, path in files.items()
    }


def _is_there(picture: Mapping[str, str], out: Path) -> bool:
    """Whether a picture lies in the folder of results, and is still the one that was kept."""
    path = out / picture["path"]
    return not lies_outside(path, out) and path.is_file() and sha256(path) == picture["sha256"]


def _result(found: Measurement, out: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The document of a measurement, and its arrays."""
    result: dict[str, Any] = {
        "rig": found.rig,
        "sha256": found.source_sha256,
        "quantities": [asdict(one) for one in found.quantities],
        "checks": [asdict(one) for one in found.checks],
        "warnings": list(found.warnings),
        "camera": dict(found.camera),
        "table": dict(found.table),
        "frame_times": list(found.frame_times),
        "files": _pictures(found.files, out),
        "marks": [asdict(mark) for mark in found.marks],
    }
    arrays: dict[str, Any] = {}
    for kind, (_, names) in _RECORDS.items():
        records = getattr(found, kind)
        result[kind] = [
            {name: value for name, value in vars(record).items() if name not in names} for record in records
        ]
        for number, record in enumerate(records):
            arrays |= {f"{kind}_{number}_{name}": np.asarray(getattr(record, name)) for name in names}
    return result, arrays


def _measurement(result: Mapping[str, Any], arrays: Mapping[str, Any], source: Path, out: Path) -> Measurement:
    records: dict[str, tuple[Any, ...]] = {}
    for kind, (record, names) in _RECORDS.items():
        records[kind] = tuple(
            record(**_tupled(one), **{name: arrays[f"{kind}_{number}_{name}"] for name in names})
            for number, one in enumerate(result[kind])
        )
    return Measurement(
        result["rig"],
        source,
        result["sha256"],
        tuple(_quantity(one) for one in result["quantities"]),
        tuple(
            Check(**{**one, **{name: _number(one[name]) for name in ("value", "expected")}}) for one in result["checks"]
        ),
        tuple(result["warnings"]),
        result["camera"],
        table=result["table"],
        files={kind: out / one["path"] for kind, one in result["files"].items()},
        marks=tuple(_mark(one) for one in result["marks"]),
        frame_times=tuple(result["frame_times"]),
        **records,
    )


def _quantity(one: Mapping[str, Any]) -> Quantity:
    numbers = {name: float(_number(one[name])) for name in ("value", "std_uncertainty")}
    budget = {part: float(_number(value)) for part, value in one["budget"].items()}
    detail = {name: _number(value) for name, value in one["detail"].items()}
    return Quantity(**{**one, **numbers, "budget": budget, "detail": detail})


def _mark(one: Mapping[str, Any]) -> Mark:
    return Mark(**{**one, "points": [(x, y) for x, y in one["points"]], "frames": tuple(one["frames"])})


def _tupled(values: Mapping[str, Any]) -> dict[str, Any]:
    """JSON has lists in place of tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def _number(value: Any) -> Any:
    """JSON has null in place of a number that is not finite."""
    return float("nan") if value is None else value
