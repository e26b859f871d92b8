"""The lab and its measurements as JSON for the page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import Mark
from rigtwin.lab.file.lab_file import Experiment, Lab, lab_of
from rigtwin.lab.file.schema import Document, FileEntry, LabFile, keys_of_camera, read_document, validated
from rigtwin.lab.formatting import reading, siblings, title
from rigtwin.lab.media_files import PICTURES
from rigtwin.lab.quantity import Measurement, Quantity
from rigtwin.lab.tracked.table import is_table
from rigtwin.measure.media.sound import is_sound
from rigtwin.review.compared import comparison, figures, result_files, row_json
from rigtwin.review.remeasure import Beside, Remeasured


@dataclass(frozen=True)
class OpenLab:
    """A lab as it stands on disk at this moment, with its rejected files."""

    document: Document
    lab: Lab
    file: LabFile

    @classmethod
    def read(cls, path: Path, *, allow_outside: bool) -> OpenLab:
        """Raises `BadLabFile` if it is not valid."""
        document = read_document(path)
        return cls(document, lab_of(document, allow_outside=allow_outside), validated(document, LabFile))

    def views(self, experiment: int, repetition: int) -> tuple[Path, ...]:
        """All media of a repetition, rejected ones too.  Raises `LookupError`."""
        if min(experiment, repetition) < 0:
            raise LookupError
        return self.lab.experiments[experiment].with_rejected[repetition]

    def all_views(self) -> Iterator[tuple[str, Path]]:
        """Every medium, with its place: numbers of experiment, repetition and view."""
        for number, one in enumerate(self.lab.experiments):
            for repetition, views in enumerate(one.with_rejected):
                for view, medium in enumerate(views):
                    yield f"{number}/{repetition}/{view}", medium

    def measured_views(self, experiment: int, repetition: int) -> tuple[Path, ...]:
        """Media of a repetition that are measured: those that are not rejected, or all if none is left."""
        views, rejected = self.views(experiment, repetition), self.lab.experiments[experiment].rejected
        return tuple(view for view in views if view not in rejected) or views

    def to_json(self) -> dict[str, Any]:
        """All that the page shows of the lab."""
        return {
            "title": self.lab.title,
            "path": str(self.lab.path),
            "experiments": [
                {
                    "id": one.id,
                    "rig": one.rig_name,
                    "variant": getattr(one.rig, "variant", ""),
                    "particle": one.particle.name,
                    "twin_in_step": has_twin_in_step(one),
                    "keys": sorted(keys_of_camera(one.rig_name)),
                    "common": sorted(entry.camera.model_fields_set),
                    "repetitions": [
                        [_view_json(one, view, self.lab.folder, entry.files) for view in views]
                        for views in one.with_rejected
                    ],
                }
                for one, entry in zip(self.lab.experiments, self.file.experiments, strict=True)
            ],
            "results": result_files(self.lab.folder),
            "figures": figures(self.lab.folder),
            "compared": comparison(self.lab.path),
        }


def kind_of(experiment: Experiment, view: Path) -> str:
    """Whether a medium is a "photo" or a "clip", or has no picture: "table" or "sound"."""
    if is_table(view):
        return "table"
    if is_sound(view):
        return "sound"
    photo = entry_of(experiment).is_photo(view) or (experiment.rig_name == "drum" and view.suffix.lower() in PICTURES)
    return "photo" if photo else "clip"


def has_twin_in_step(experiment: Experiment) -> bool:
    """Whether the twin moves as the bodies in the film do: it starts from where they were seen to start."""
    entry = entry_of(experiment)
    return not entry.many_particles and entry.starts_from is not None


def _view_json(experiment: Experiment, view: Path, folder: Path, files: Mapping[str, FileEntry]) -> dict[str, Any]:
    within = str(view.relative_to(folder)) if view.is_relative_to(folder) else str(view)
    # as it stands in lab.toml already, like "./r01.mp4"
    name, file = next(((name, file) for name, file in files.items() if folder / name == view), (within, None))
    return {
        "name": name,
        "kind": kind_of(experiment, view),
        "rejected": experiment.rejected.get(view, ""),
        "stated": _stated(experiment.camera_of(view)),
        "own": [] if file is None else sorted(file.model_fields_set),
    }


def _stated(camera: Camera) -> dict[str, Any]:
    """What is stated of the camera, by the keys of lab.toml; places in pixels, lengths in metres, angles in radians."""
    known = asdict(camera)
    known["pivot"], known["camera_roll"] = known.pop("pivots"), known.pop("roll")
    if known.pop("lens") is not None or known["board"] is not None:
        known["board"] = camera.board.kind if camera.board else ""
    return {name: value for name, value in known.items() if value not in (None, (), False)}


def result_json(key: str, done: Remeasured, measured: Sequence[Path], shown: Sequence[Path]) -> dict[str, Any]:
    """What a measurement gave, and where in which of the media that are shown; not all of them may be `measured`."""
    found = done.found
    document: dict[str, Any] = {"key": key, "seconds": round(done.seconds, 3)}
    if not isinstance(found, Measurement):
        seen = found.seen
        view = shown.index(seen.medium) if seen is not None and seen.medium in shown else shown.index(measured[0])
        marks = [] if seen is None else [_mark_json(mark, view) for mark in seen.marks]
        frame = None if seen is None else seen.frame
        return {**document, "refused": found.message, "frame": frame, "marks": marks}
    return {
        **document,
        "quantities": [_quantity_json(quantity) for quantity in found.quantities],
        "checks": [check.to_json() for check in found.checks],
        "warnings": list(found.warnings),
        "scale": _scale_in_words(found.camera),
        "marks": [_mark_json(mark, shown.index(measured[mark.view])) for mark in found.marks],
    }


def beside_json(found: Beside) -> dict[str, Any]:
    """A repetition beside its twin."""
    return {
        "rows": [row_json(row.row())[1] for row in found.rows],
        "marks": [_mark_json(mark, 0) for mark in found.marks],
        "refused": found.refused,
    }


def _quantity_json(quantity: Quantity) -> dict[str, Any]:
    which = siblings(quantity.detail)
    return {
        **quantity.to_json(),
        "title": f"{title(quantity.quantity)}{which and f', {which}'}",
        "text": reading(quantity.value, quantity.std_uncertainty, quantity.unit),
    }


def _scale_in_words(camera: Mapping[str, Any]) -> str:
    size = camera.get("scale_m_per_px")
    return f"{1e3 * size:.4g} mm/px, from {camera.get('scale_from')}" if size else ""


def _mark_json(mark: Mark, view: int) -> dict[str, Any]:
    points = [
        [round(float(x), 2), round(float(y), 2)] if math.isfinite(x) and math.isfinite(y) else None
        for x, y in mark.points
    ]
    return {
        "label": mark.label,
        "kind": mark.kind,
        "points": points,
        "radius": round(float(mark.radius), 2),
        "frames": [int(frame) for frame in mark.frames],
        "view": view,
    }
