"""The report of a comparison: one self-contained HTML file with measured and simulated values and their difference."""

from __future__ import annotations

import base64
import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigtwin.compare.deviation import Deviation, headlines, primary_first
from rigtwin.compare.report import figures
from rigtwin.compare.report.figure_file import FigureFile, slug, unique_names
from rigtwin.compare.report.fill_template import filled
from rigtwin.compare.report.methods_text import Methods
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.formatting import percent, reading, relative_uncertainty, siblings, title, uncertainty, z_score
from rigtwin.lab.quantity import Measurement, check_lines
from rigtwin.lab.rigs import SETTINGS

if TYPE_CHECKING:
    from rigtwin.compare.comparison import Comparison, Outcome
    from rigtwin.compare.curve_overlays import Overlay
    from rigtwin.lab.materials import Particle

MOST_STILLS = 4  # pictures shown per experiment; all of them are in the folder of the report
STILL_WIDTH = 1200  # [px], wide enough to judge a bead's outline when the picture is enlarged


@dataclass(frozen=True)
class Row:
    """A row of a table of deviations, formatted."""

    experiment: str
    rig: str
    quantity: str
    which: str
    method: str
    measured: str
    n: int
    simulated: str
    percent: str
    z: str
    verdict: str
    tone: str  # "good", "bad", "doubtful" or "plain"
    notes: tuple[int, ...]  # numbers of the notes below the table
    bar: Bar | None


@dataclass(frozen=True)
class Bar:
    """A percent deviation drawn as a dot with its 95 % whisker; positions in percent of the drawing's width."""

    dot: float
    low: float
    high: float
    beyond: tuple[bool, bool]
    """Whether the whisker goes on beyond the left and the right end of the drawing."""


def drawn_figures(comparison: Comparison) -> dict[str, list[FigureFile]]:
    """Draw all figures of the page.

    Parameters
    ----------
    comparison : Comparison
        Comparison whose figures are drawn.

    Returns
    -------
    dict of str to list of FigureFile
        By name of their experiment; that of all deviations under an empty name.
    """
    rows = headlines(comparison.deviations)
    found = {"": [one] if (one := figures.deviations_figure(rows, _widest(rows))) is not None else []}
    names = unique_names(
        slug(f"{outcome.experiment.id}-{overlay.what}") for outcome in comparison.outcomes for overlay in outcome.shapes
    )
    for outcome in comparison.outcomes:
        found[outcome.experiment.id] = [
            figures.overlay_figure(overlay, next(names), _caption(overlay)) for overlay in outcome.shapes
        ]
    return found


def report(
    comparison: Comparison,
    provenance: Mapping[str, Any],
    out: Path,
    drawn: Mapping[str, Sequence[FigureFile]],
    text: Methods,
) -> str:
    """Return the text of the page.

    Parameters
    ----------
    comparison : Comparison
        Comparison that the page shows.
    provenance : mapping
        Content of ``provenance.json``.
    out : Path
        Folder of the page.
    drawn : mapping of str to sequence of FigureFile
        Its figures, as of `drawn_figures`.
    text : Methods
        Methods text of the comparison.

    Returns
    -------
    str
        HTML text.
    """
    return filled(
        "report.html",
        title=comparison.lab.title,
        made=comparison.started.strftime("%d %B %Y, %H:%M UTC"),
        summary=comparison.headline,
        headlines=_table(headlines(comparison.deviations), "At a glance"),
        overall=drawn[""],
        sections=[_section(outcome, out, drawn[outcome.experiment.id]) for outcome in comparison.outcomes],
        methods=text,
        borrowed=comparison.lab.borrowed,
        notes=comparison.lab.notes,
        remarks=comparison.remarks,
        provenance=provenance,
        command=shlex.join(provenance["command_line"]),
    )


def _section(outcome: Outcome, out: Path, drawn: Sequence[FigureFile]) -> dict[str, Any]:
    experiment = outcome.experiment
    wall = f" on {experiment.wall.name}" if experiment.wall is not None else ""
    stills, more = _stills(outcome.measurements)
    primary, rest = primary_first(outcome.deviations)
    return {
        "id": experiment.id,
        "rig": experiment.rig.title,
        "what": f"{experiment.particle.name}{wall}",
        "settings": _settings(outcome),
        "figures": drawn,
        "stills": stills,
        "more_stills": more,
        "table": _table(primary, f"Deviations of {experiment.id}"),
        "more_rows": _table(rest, f"More deviations of {experiment.id}") if rest else None,
        "checks": check_lines(item.checks for item in outcome.measurements),
        "twin_checks": check_lines(twin.evaluation.checks for twin in outcome.twins),
        "warnings": outcome.warnings,
        "budgets": list(_budgets(outcome.deviations)),
        "repetitions": [_repetition(item, out) for item in outcome.measurements],
        "assumptions": outcome.twins[0].assumptions if outcome.twins else (),
        "without_twin": outcome.without_twin,
        "twin_settings": list(_flat(outcome.twins[0].settings)) if outcome.twins else [],
        "seconds": sum(twin.seconds for twin in outcome.twins),
    }


def _table(rows: Sequence[Deviation], name: str) -> dict[str, Any]:
    widest = _widest(rows)
    notes = list(dict.fromkeys(note for row in rows for note in _notes(row)))
    return {"name": name, "rows": [_row(row, widest, notes) for row in rows], "widest": f"{widest:g}", "notes": notes}


def _notes(row: Deviation) -> list[str]:
    doubtful = f"Doubtful: {row.doubtful}." if row.doubtful else ""
    failed = f"Failed checks of the measurement: {row.failed_check}." if row.failed_check and not doubtful else ""
    note = f"{row.note[:1].upper()}{row.note[1:]}." if row.note else ""
    return [text for text in (doubtful, failed, note) if text]


def _row(deviation: Deviation, widest: float, notes: list[str]) -> Row:
    return Row(
        experiment=deviation.experiment,
        rig=SETTINGS[deviation.rig].title,
        quantity=title(deviation.quantity),
        which=siblings(deviation.row()),
        method=deviation.method,
        measured=_in_two(reading(deviation.measured, deviation.measured_std_uncertainty, deviation.unit)),
        n=deviation.measured_n,
        simulated=_in_two(reading(deviation.simulated, deviation.simulated_std_uncertainty, deviation.unit)),
        percent=_in_two(percent(deviation.percent_deviation, deviation.percent_deviation_std)),
        z=z_score(deviation.z, deviation.z_limit),
        verdict=deviation.verdict,
        tone=figures.tone(deviation),
        notes=tuple(1 + notes.index(note) for note in _notes(deviation)),
        bar=_bar(deviation, widest),
    )


def _in_two(words: str) -> str:
    """A reading that a narrow table breaks before its uncertainty and nowhere else."""
    value, sign, rest = words.partition(" ± ")
    whole = "\N{NO-BREAK SPACE}"
    return f"{value} ±{whole}{rest.replace(' ', whole)}" if sign else words


def _bar(row: Deviation, widest: float) -> Bar | None:
    if row.percent_deviation is None or row.percent_deviation_std is None:
        return None

    def place(value: float) -> float:
        return 50 + 46 * max(-1.0, min(1.0, value / widest))

    low, high = figures.interval(row)
    return Bar(place(row.percent_deviation), place(low), place(high), (low < -widest, high > widest))


def _widest(rows: Iterable[Deviation]) -> float:
    """Scale [%] of the drawings of a table, wide enough for each dot: 5, 10, 20, 50, ..."""
    largest = max((abs(row.percent_deviation) for row in rows if row.percent_deviation is not None), default=0.0)
    steps = (factor * 10**power for power in range(6) for factor in (1, 2, 5))
    return float(next((step for step in steps if step >= max(largest, 5)), largest))


def _particle(particle: Particle) -> list[tuple[str, str]]:
    bead = particle.typical
    lines = [("bead", f"{bead.diameter * 1e3:.2f} mm, {bead.mass * 1e3:.3g} g")]
    if particle.shape is not None:
        across = f"{bead.equivalent_diameter * 1e3:.2f} mm as a sphere of its volume"
        lines.append(("clump", f"{len(particle.radii)} spheres, {across}"))
    if particle.sizes is not None:
        span = f"{particle.sizes.smallest * 1e3:.3g} to {particle.sizes.largest * 1e3:.3g} mm"
        lines.append(("sizes", f"{particle.sizes.law}: {span}, median by mass {bead.equivalent_diameter * 1e3:.3g} mm"))
    return lines


def _settings(outcome: Outcome) -> list[tuple[str, str]]:
    experiment = outcome.experiment
    n = len(outcome.measurements)
    lines = []
    if experiment.repetitions:
        left_out = f", {len(outcome.failures)} left out" if outcome.failures else ""
        rejected = f", {len(experiment.rejected)} rejected" if experiment.rejected else ""
        lines.append(("repetitions", f"{n} measured{left_out}{rejected}"))
    if experiment.measured:
        names = dict.fromkeys(title(one.quantity) for one in experiment.measured)
        lines.append(("stated in lab.toml", ", ".join(names)))
    lines += _particle(experiment.particle)
    lines += [(one.name, one.text) for one in entry_of(experiment).stated(experiment) if one.text]
    rates = {
        round(float(item.camera["frame_rate_hz"]), 2)
        for item in outcome.measurements
        if item.camera.get("frame_rate_hz")
    }
    if rates:
        lines.append(("frame rate", ", ".join(f"{rate:g} Hz" for rate in sorted(rates))))
    scales = [
        float(item.camera["scale_m_per_px"]) for item in outcome.measurements if item.camera.get("scale_m_per_px")
    ]
    if scales:
        sources = {str(item.camera["scale_from"]) for item in outcome.measurements if item.camera.get("scale_from")}
        origin = f" ({', '.join(sorted(sources))})" if sources else ""
        uncertain = relative_uncertainty([item.camera.get("scale_std_rel") for item in outcome.measurements])
        lines.append(("scale", f"{1e3 * sum(scales) / len(scales):.4f} mm/px{uncertain}{origin}"))
    put_in = outcome.twins[0].settings["contacts"] if outcome.twins else {}
    for pair, contact in put_in.items():
        needed = entry_of(experiment).needed(experiment)
        values = ", ".join(f"{name.replace('_', ' ')} {contact[name]:g}" for name in needed)
        lines.append((f"put into the twin, {pair}:", values))
    return lines


def _caption(overlay: Overlay) -> str:
    unit = {"deg": "°", "%": " %"}.get(overlay.unit, f" {overlay.unit}")
    beads = "" if overlay.bead is None else f" ({overlay.distance / overlay.bead:.2g} bead diameters)"
    scatter = overlay.scatter(overlay.measured)
    own = "" if scatter is None else f"; single measured curves scatter by {scatter:.2g}{unit} about their mean"
    return (
        f"{overlay.what[:1].upper()}{overlay.what[1:]}: measured and simulated means lie {overlay.distance:.2g}{unit} "
        f"apart{beads}, root mean square, {overlay.offset:+.2g}{unit} on average{own}."
    )


def _stills(measurements: Sequence[Measurement]) -> tuple[list[dict[str, Any]], int]:
    """Overlay pictures as data URLs, and the number of further ones."""
    paths = dict.fromkeys(path for item in measurements for path in item.files.values() if path.is_file())
    pictures = [
        (re.sub(r"-(still|overlay)$", "", path.stem), path) for path in paths if path.suffix in (".png", ".jpg")
    ]
    shown = [{"name": name, **_embedded(path)} for name, path in pictures[:MOST_STILLS]]
    return shown, len(pictures) - len(shown)


def _embedded(path: Path) -> dict[str, Any]:
    """A picture at the report's size as a data URL, and whether it is wider than high."""
    import cv2
    import numpy as np

    picture = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        return {"source": "", "wide": True}
    height, width = picture.shape[:2]
    shrink = min(1.0, STILL_WIDTH / width, 1.2 * STILL_WIDTH / height)
    if shrink < 1:
        size = (max(1, round(width * shrink)), max(1, round(height * shrink)))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    _, packed = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 86])
    data = base64.b64encode(packed.tobytes()).decode("ascii")
    return {"source": f"data:image/jpeg;base64,{data}", "wide": width > height}


def _budgets(rows: Sequence[Deviation]) -> Iterable[dict[str, Any]]:
    for row in rows:
        total = row.measured_std_uncertainty
        if not row.budget or not math.isfinite(total) or total <= 0:
            continue
        parts = sorted(row.budget.items(), key=lambda part: -part[1])
        yield {
            "quantity": title(row.quantity),
            "which": ", ".join(word for word in (siblings(row.row()), row.method) if word),
            "total": uncertainty(total, row.unit),
            "parts": [
                {
                    "name": name.replace("_", " "),
                    "value": uncertainty(value, row.unit),
                    "share": 100 * (value / total) ** 2,
                }
                for name, value in parts
                if value > 0.02 * total
            ],
        }


def _repetition(measurement: Measurement, out: Path) -> dict[str, Any]:
    kinds: dict[Path, str] = {}
    for kind, path in measurement.files.items():  # overlay and still of a photo are the same file
        kinds.setdefault(path.resolve(), kind.replace("_", " "))
    here = out.resolve()  # only files in the folder of the report stay linked when it is moved
    files = [(kind, path.relative_to(here).as_posix()) for path, kind in kinds.items() if path.is_relative_to(here)]
    return {
        "name": measurement.source.name,
        "quantities": [
            {
                "quantity": title(quantity.quantity),
                "which": siblings(quantity.detail),
                "method": quantity.method,
                "reading": reading(quantity.value, quantity.std_uncertainty, quantity.unit),
                "doubtful": quantity.doubtful,
            }
            for quantity in measurement.quantities
        ],
        "files": files,
    }


def _flat(settings: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    """Nested settings as lines: ``particle, diameter``, ``0.0062``."""
    for name, value in settings.items():
        words = f"{prefix}{name.replace('_', ' ')}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{words}, ")
        elif value is not None:
            yield words, f"{value:.6g}" if isinstance(value, float) else str(value)
