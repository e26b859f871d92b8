"""Figures of a diagnosis: measurement, twin before and twin with the effect, with the noise band."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.diagnosis import Diagnosis
from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.compare.diagnose.models.drop import DropBench
from rigtwin.compare.diagnose.models.pendulum import PendulumBench
from rigtwin.compare.diagnose.models.rows import coefficients
from rigtwin.compare.diagnose.models.slide import SlideBench
from rigtwin.compare.diagnose.selection.gap import names
from rigtwin.compare.report.figure_file import FigureFile, figure_file
from rigtwin.compare.report.plot_style import MEASURED, TWIN, canvas, thin
from rigtwin.lab.arrays import Array

_Table = tuple[list[dict[str, Any]], tuple[str, ...]]

BEFORE, NOISE = "#4d4d4d", "#9aa5b0"
"""Greys of the twin before and of the noise band, dark and light beside the blue and the orange of `plot_style`."""
BINS = 48  # of the time axis; 6 for each of the 8 regions of `locate`
OF_A_PERIOD = 12  # bins in a period of a pendulum, so that a swing is not averaged out
FEWEST = 3  # rows in a bin below which its mean is not drawn
SEEN = 2.0  # mean square of the means in units of their noise above which they differ from the twin; 1 is noise
MOST_PANELS = 12
SLICES = 40  # time bins of the overview
MOST_PAIRS = 4  # panels of restitution
NEAR_TURN = 0.9  # share of the amplitude above which rows belong to a turning point
SETTLED = 60  # steps of the fixed-point iteration for the impact speed, which converges within ten


def figures(diagnosis: Diagnosis) -> dict[str, FigureFile]:
    """Draw the figures of a diagnosis; none where nothing was fitted.

    Parameters
    ----------
    diagnosis : Diagnosis
        Diagnosis whose data and fits are drawn.

    Returns
    -------
    dict of str to FigureFile
        By name, the leading one first.  ``residual``: measurement and twin over time in the condition and coordinate in
        which the twin before is worst.  ``restitution`` (drops): restitution against impact speed.  ``contact`` (other
        rigs with a contact): deviations from the contact law.  ``amplitude`` (single pendulums): amplitude over time.
        ``overview``: mean residuals of all conditions.

    Notes
    -----
    Every impact and every slip has a restitution or friction of its own in the fit, so a wrong contact law leaves no
    residual over time.  Where there is none, the figure of the contact leads.
    """
    if diagnosis.naming is None:
        return {}
    residual, shows = _residual(diagnosis)
    found = {"residual": residual}
    if isinstance(diagnosis.bench, PendulumBench):
        found["amplitude"] = _amplitude(diagnosis)
    elif isinstance(diagnosis.bench, DropBench):
        if diagnosis.bench.active.any():  # a bead may land without a rebound
            found["restitution"] = _restitution(diagnosis)
    else:
        found["contact"] = _contact(diagnosis)
    leading = [name for name in found if name != "residual"] if not shows else []
    return {name: found[name] for name in (*leading, *found)} | {"overview": _overview(diagnosis)}


# ---------------------------------------------------------------------------------------------------------- residual


@dataclass(frozen=True)
class _View:
    """The rows of one body in one condition, seen along one coordinate."""

    condition: int
    body: int
    axis: int
    repetitions: list[Any]  # row numbers of each repetition


@dataclass(frozen=True)
class _Means:
    """Means over rows and repetitions in bins of time, all relative to the twin before [m]."""

    time: Array  # [s]
    measured: Array
    after: Array | None
    noise: Array  # standard deviation of a mean
    rows: Array
    width: float  # [s], of a bin


def _residual(diagnosis: Diagnosis) -> tuple[FigureFile, bool]:
    """The figure, and whether the twin before misses the measurement by more than noise anywhere in it."""
    bench, before, after = _fits(diagnosis)
    views = _views(bench)
    clock = _since(bench, before)
    width = _width(bench, clock)
    means = [_means(bench, view, clock, before, after, width) for view in views]
    excess = [float(np.mean((mean.measured / mean.noise) ** 2)) for mean in means]
    worst = int(np.argmax(excess))
    view, mean = views[worst], means[worst]
    axis, condition = "xy"[view.axis], bench.condition_names[view.condition]
    effect = _effect(diagnosis)
    label = f"Measurement and twin over time in {condition}, coordinate {axis}"
    with canvas(5.2) as (figure, _):
        figure.clear()
        path, apart = figure.subplots(2, 1, sharex=True, height_ratios=[1, 1.7])
        rows = view.repetitions[0]
        path.plot(clock[rows], 1e3 * bench.rows[rows, view.axis], ".", ms=3, color=MEASURED)
        path.plot(clock[rows], 1e3 * before.seen[rows, view.axis], "--", lw=1.2, color=BEFORE)
        if after is not None:
            path.plot(clock[rows], 1e3 * after.seen[rows, view.axis], "-", lw=1.2, color=TWIN)
        path.set(ylabel=f"{axis} [mm]")
        path.set_title(f"{condition}: one repetition", fontsize=9, loc="left")
        for number, rows in enumerate(view.repetitions):
            off = 1e3 * (bench.rows[rows, view.axis] - before.seen[rows, view.axis])
            centre, single, _ = _binned(clock[rows], off, width)
            apart.plot(centre, single, "-", lw=0.6, color=MEASURED, alpha=0.4, label=None if number else "repetitions")
        middle = 0 * mean.time if mean.after is None else mean.after
        band = 1e3 * (middle - 2 * mean.noise), 1e3 * (middle + 2 * mean.noise)
        apart.fill_between(mean.time, *band, color=NOISE, alpha=0.45, lw=0, label="noise of a mean, ± 2 std")
        apart.axhline(0.0, ls="--", lw=1.4, color=BEFORE, label="twin before")
        if mean.after is not None:
            apart.plot(mean.time, 1e3 * mean.after, "-", lw=1.6, color=TWIN, label=f"twin {effect}")
        apart.plot(mean.time, 1e3 * mean.measured, "o", ms=3.2, color=MEASURED, label="measured, mean")
        apart.set(xlabel=f"time since the {_event(bench)} [s]", ylabel=f"{axis} less twin before [mm]")
        apart.set_title(f"difference from the twin before: mean of {_repetitions(view)}", fontsize=9, loc="left")
        figure.legend(*apart.get_legend_handles_labels(), loc="outside lower center", fontsize=8, ncols=3)
        shows = excess[worst] > SEEN
        caption = _residual_caption(diagnosis, bench, view, mean, shows=shows)
        return figure_file(figure, "diagnosis-residual", label, *_residual_rows(mean), caption), shows


def _residual_caption(diagnosis: Diagnosis, bench: Any, view: _View, mean: _Means, *, shows: bool) -> str:
    def size(off: Array) -> str:
        return f"{1e3 * math.sqrt(float(np.mean(off**2))):.3g} mm"

    bead = f", bead {'AB'[view.body]}" if bench.bodies > 1 else ""
    where = f"{bench.condition_names[view.condition]}{bead}, coordinate {'xy'[view.axis]}"
    quiet = ", though within the noise: what disagrees are single repetitions, or quantities pulled off what was stated"
    text = (
        f"{where}, where the twin before is worst{'' if shows else quiet}. "
        f"Points: means over {_repetitions(view)} in steps of {1e3 * mean.width:.3g} ms; thin lines: "
        "single repetitions; dashed: the calibrated twin before; band: two "
        f"standard deviations of such a mean by the tracking noise of {1e3 * bench.noise:.3g} mm. The means differ by "
        f"{size(mean.measured)} (root mean square) from the twin before"
    )
    if mean.after is None:
        return f"{text}; the noise alone gives {size(mean.noise)}. Nothing was added to the twin."
    left = size(mean.measured - mean.after)
    return f"{text} and by {left} from the twin {_effect(diagnosis)}; the noise alone gives {size(mean.noise)}."


def _residual_rows(mean: _Means) -> _Table:
    columns = {
        "time_s": mean.time,
        "measured_minus_before_m": mean.measured,
        "effect_minus_before_m": np.full(len(mean.time), math.nan) if mean.after is None else mean.after,
        "noise_of_mean_m": mean.noise,
        "rows": mean.rows,
    }
    return _table(columns)


def _views(bench: Any) -> list[_View]:
    body = getattr(bench, "body", np.zeros(len(bench.rows), dtype=int))
    views = []
    for condition in range(len(bench.condition_names)):
        spans = [bench.spans[r] for r in np.flatnonzero(bench.condition == condition)]
        for number in range(bench.bodies):
            runs = [span.start + np.flatnonzero(body[span] == number) for span in spans]
            views += [_View(condition, number, axis, runs) for axis in (0, 1)]
    return views


def _since(bench: Any, fitted: Fit) -> Array:
    """Time [s] of each row since the release or the slip of its repetition."""
    if isinstance(bench, SlideBench):
        begin = (fitted.local[:, 1] - bench.start) / bench.rate
    else:
        begin = fitted.local[:, bench.onset]
    return np.asarray(bench.time - begin[bench.owner])


def _event(bench: Any) -> str:
    return "slip" if isinstance(bench, SlideBench) else "release"


def _width(bench: Any, clock: Array) -> float:
    """Width [s] of a bin of time, a frame at least."""
    widest = float(np.ptp(clock)) / BINS
    if hasattr(bench, "length"):
        widest = min(widest, 2 * math.pi * math.sqrt(float(np.min(bench.length)) / bench.lab.gravity) / OF_A_PERIOD)
    return float(max(widest, 1 / bench.lab.camera.frame_rate))


def _means(bench: Any, view: _View, clock: Array, before: Fit, after: Fit | None, width: float) -> _Means:
    rows = np.concatenate(view.repetitions)
    time, axis = clock[rows], view.axis
    centre, measured, count = _binned(time, bench.rows[rows, axis] - before.seen[rows, axis], width)
    added = None
    if after is not None:
        _, added, _ = _binned(time, after.seen[rows, axis] - before.seen[rows, axis], width)
    return _Means(centre, measured, added, bench.noise / np.sqrt(count), count, width)


def _binned(time: Array, value: Array, width: float) -> tuple[Array, Array, Any]:
    """Mean time, mean value and number of rows of each bin that has some; all bins if none has `FEWEST` rows."""
    number = np.floor(time / width).astype(int)
    number -= number.min()
    count = np.bincount(number)
    kept = count >= (FEWEST if np.any(count >= FEWEST) else 1)
    sums = [np.bincount(number, weights=one)[kept] for one in (time, value)]
    return sums[0] / count[kept], sums[1] / count[kept], count[kept]


def _repetitions(view: _View) -> str:
    number = len(view.repetitions)
    return "one repetition" if number == 1 else f"{number} repetitions"


# ------------------------------------------------------------------------------------------------------- restitution


def _restitution(diagnosis: Diagnosis) -> FigureFile:
    """Restitution against impact speed: impacts, their means for each condition and impact, and the contact law."""
    bench, before, after = _fits(diagnosis)
    fits = [("twin before", before, "--", BEFORE)]
    if after is not None:
        fits.append((f"twin {_effect(diagnosis)}", after, "-", TWIN))
    shown = _by_impacts(bench)[:MOST_PAIRS]
    effect, label = _effect(diagnosis), "Restitution against impact speed, measured and by the contact law"
    speed, e = _impacts(bench, fits[-1][1])
    seen = f"with the twin {effect}" if after is not None else "with the twin before"
    caption = (
        "Restitution of single impacts (small points) and their means over the repetitions of a condition with the "
        f"standard deviation between repetitions (bars), for each bead on each plate; flights reconstructed {seen}. "
        "Dashed: contact law of the twin before"
        + (f"; line: that of the twin {effect}." if after is not None else ".")
        + (f" {len(bench.pairs) - len(shown)} more pairs are not drawn." if len(bench.pairs) > len(shown) else "")
    )
    rows: list[dict[str, Any]] = []
    with canvas(1.2 + 1.9 * math.ceil(len(shown) / 2)) as (figure, _):
        figure.clear()
        panels = figure.subplots(math.ceil(len(shown) / 2), min(len(shown), 2), squeeze=False).ravel()
        for panel in panels[len(shown) :]:
            panel.axis("off")
        for panel, pair in zip(panels, shown, strict=False):
            mine = (bench.pair == pair)[:, None] & bench.active
            panel.plot(speed[mine], e[mine], ".", ms=2.5, color=MEASURED, alpha=0.35, label="impacts")
            groups = list(_groups(bench, pair, speed, e))
            rows += groups
            where, value, std = (np.array([one[key] for one in groups]) for key in ("speed_m_s", "restitution", "std"))
            panel.errorbar(where, value, std, fmt="o", ms=3.5, lw=1, color=MEASURED, label="mean ± scatter")
            grid = np.linspace(float(speed[mine].min()), float(speed[mine].max()), 60)
            for name, fitted, style, colour in fits:
                panel.plot(grid, _law(bench, fitted, pair, grid), style, lw=1.5, color=colour, label=name)
            panel.set_title(bench.pairs[pair], fontsize=9, loc="left")
            panel.set(xlabel="impact speed [m/s]", ylabel="restitution [1]")
        handles = panels[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", fontsize=8, ncols=len(handles[1]))
        columns = ("pair", "condition", "impact", "speed_m_s", "restitution", "std")
        return figure_file(figure, "diagnosis-restitution", label, rows, columns, caption)


def _by_impacts(bench: DropBench) -> list[int]:
    """Numbers of the pairs of bead and plate that have an impact, most impacts first."""
    count = [int(bench.active[bench.pair == pair].sum()) for pair in range(len(bench.pairs))]
    return [pair for pair in sorted(range(len(count)), key=lambda one: -count[one]) if count[pair]]


def _impacts(bench: DropBench, fitted: Fit) -> tuple[Array, Array]:
    """Speed [m/s] before each impact and its restitution, both (R, impacts).

    The fit has the speed after an impact and the deviation of its restitution from the law, which depends on the speed
    before: up / speed = law(speed) + deviation.
    """
    up = np.maximum(fitted.local[:, 4 : 4 + bench.impacts], 1e-3)
    off = fitted.soft[:, : bench.impacts]
    e = np.ones_like(up)
    for _ in range(SETTLED):
        e = np.maximum(_law_of_each(bench, fitted, up / e) + off, 0.05)
    return up / e, e


def _law_of_each(bench: DropBench, fitted: Fit, speed: Array) -> Array:
    """Restitution by the law at speeds (R, n), the pair of each repetition."""
    known = {u.name: np.array([float(v)]) for u, v in zip(fitted.unknowns, fitted.values, strict=True)}
    plain = np.stack(list(bench.restitutions(known).values()), axis=-1)[:, bench.pair, None]
    e = plain + 0 * speed[None]
    for term in fitted.terms:
        if term.restitution is not None:
            own = coefficients(term, known, bench.lab, bench.conditions)
            e = term.restitution(e, speed[None], bench.radius[:, None], bench.mass[:, None], *own)
    return np.asarray(e[0])


def _law(bench: DropBench, fitted: Fit, pair: int, speed: Array) -> Array:
    first = int(np.flatnonzero(bench.pair == pair)[0])
    return np.asarray(_law_of_each(bench, fitted, np.tile(speed, (len(bench.pair), 1)))[first])


def _groups(bench: DropBench, pair: int, speed: Array, e: Array) -> Iterator[dict[str, Any]]:
    """Mean and scatter over the repetitions of each condition and impact number."""
    for condition, name in enumerate(bench.condition_names):
        here = (bench.condition == condition) & (bench.pair == pair)
        for impact in range(bench.impacts):
            runs = here & bench.active[:, impact]
            if runs.any():
                own = e[runs, impact]
                yield {
                    "pair": bench.pairs[pair],
                    "condition": name,
                    "impact": impact + 1,
                    "speed_m_s": float(speed[runs, impact].mean()),
                    "restitution": float(own.mean()),
                    "std": _std(own),
                }


# ----------------------------------------------------------------------------------------------------------- contact


def _contact(diagnosis: Diagnosis) -> FigureFile:
    """Deviations of the friction or restitution of single repetitions from the contact law, by condition."""
    bench, before, after = _fits(diagnosis)
    what = "restitution" if hasattr(bench, "impacts") else "friction"
    fits = [("twin before", before, BEFORE, -0.15)]
    if after is not None:
        fits.append((f"twin {_effect(diagnosis)}", after, TWIN, 0.15))
    single = "impacts" if what == "restitution" else "repetitions"
    caption = (
        f"Measured {what} less that of the contact law: single {single} (small points) and the mean of each condition "
        f"with two standard errors by the scatter of its {single}. Dark: law of the twin before"
        + (f"; orange: law of the twin {_effect(diagnosis)}." if after is not None else ".")
    )
    rows: list[dict[str, Any]] = []
    with canvas(1.2 + 0.32 * len(bench.condition_names)) as (figure, axes):
        axes.axvline(0.0, lw=1, color=BEFORE)
        for name, fitted, colour, shift in fits:
            for condition, title in enumerate(bench.condition_names):
                own = _deviations(bench, fitted, condition)
                if not len(own):
                    continue
                rows.append(
                    {"twin": name, "condition": title, "mean": own.mean(), "std": _std(own), "number": len(own)}
                )
                axes.plot(own, np.full(len(own), condition + shift), ".", ms=3, color=colour, alpha=0.4)
                error = 2 * _std(own) / math.sqrt(len(own))
                label = name if condition == 0 else None
                axes.errorbar(own.mean(), condition + shift, xerr=error, fmt="o", ms=4, color=colour, label=label)
        axes.set_yticks(range(len(bench.condition_names)), bench.condition_names, fontsize=8)
        axes.invert_yaxis()
        axes.set_xlabel(f"{what} less contact law [1]")
        figure.legend(loc="outside lower center", fontsize=8, ncols=2)
        label = f"Deviations of the {what} from the contact law in each condition"
        columns = ("twin", "condition", "mean", "std", "number")
        return figure_file(figure, "diagnosis-contact", label, rows, columns, caption)


def _deviations(bench: Any, fitted: Fit, condition: int) -> Array:
    """Deviations (n,) from the contact law in one condition: of each impact, or of each slip or ride."""
    mine = bench.condition == condition
    if hasattr(bench, "impacts"):
        return np.asarray(fitted.soft[mine][bench.active[mine]])
    return np.asarray(fitted.soft[mine, 0])


def _std(own: Array) -> float:
    return float(own.std(ddof=1)) if len(own) > 1 else 0.0


# --------------------------------------------------------------------------------------------------------- amplitude


def _amplitude(diagnosis: Diagnosis) -> FigureFile:
    """Amplitude of the swings over time in the condition with the worst amplitudes, and its difference."""
    bench, before, after = _fits(diagnosis)
    series = [_turning_points(bench, condition, before, after) for condition in range(len(bench.condition_names))]
    off = [float(np.mean((one[1] - one[2]) ** 2)) if len(one[0]) else -1.0 for one in series]
    worst = int(np.argmax(off))
    time, measured, plain, added, std = series[worst]
    condition, effect = bench.condition_names[worst], _effect(diagnosis)
    label = f"Amplitude of the swings over time in {condition}"
    caption = (
        f"Amplitude at the turning points of {condition}, means over its repetitions; below the difference from the "
        "twin before, bars: two standard errors by the tracking noise. Dashed: twin before"
        + (f"; line: twin {effect}." if after is not None else ".")
    )
    columns = {
        "time_s": time, "measured_deg": measured, "before_deg": plain,
        "effect_deg": added if after is not None else np.full(len(time), math.nan), "std_deg": std,
    }  # fmt: skip
    with canvas(4.4) as (figure, _):
        figure.clear()
        whole, apart = figure.subplots(2, 1, sharex=True)
        whole.plot(time, measured, "o", ms=3, color=MEASURED, label="measured")
        whole.plot(time, plain, "--", lw=1.3, color=BEFORE, label="twin before")
        apart.axhline(0.0, ls="--", lw=1.3, color=BEFORE)
        apart.errorbar(time, measured - plain, 2 * std, fmt="o", ms=3, lw=0.8, color=MEASURED)
        if after is not None:
            whole.plot(time, added, "-", lw=1.3, color=TWIN, label=f"twin {effect}")
            apart.plot(time, added - plain, "-", lw=1.5, color=TWIN)
        whole.set(ylabel="amplitude [deg]")
        apart.set(xlabel="time since the release [s]", ylabel="less twin before [deg]")
        whole.legend(fontsize=8)
        return figure_file(figure, "diagnosis-amplitude", label, *_table(columns), caption)


def _turning_points(
    bench: PendulumBench, condition: int, before: Fit, after: Fit | None
) -> tuple[Array, Array, Array, Array, Array]:
    """Time [s] and amplitude [deg] measured, before and after at each turning point, and its standard error.

    The amplitude is the vertex of a parabola through the rows near the turning point of the twin before, the same rows
    for all; the vertex of a parabola through n evenly spaced points has 1.5 times the error of their mean.
    """
    found: dict[int, list[tuple[float, ...]]] = {}
    clock = _since(bench, before)
    for run in np.flatnonzero(bench.condition == condition):
        rows = np.arange(bench.spans[run].start, bench.spans[run].stop)
        rows = rows[clock[rows] >= 0]
        angles = [_angle(one[rows]) for one in (bench.rows, before.seen, (after or before).seen)]
        edges = [0, *(np.flatnonzero(np.diff(np.sign(angles[1])) != 0) + 1)]
        for swing, (start, end) in enumerate(pairwise(edges)):
            size = np.abs(angles[1][start:end])
            near = start + np.flatnonzero(size > NEAR_TURN * size.max())
            if len(near) > FEWEST:
                means = [_vertex(clock[rows][near], np.abs(angle[near])) for angle in angles]
                noise = 1.5 * math.degrees(bench.noise / bench.length[run]) / math.sqrt(len(near))
                found.setdefault(swing, []).append((float(clock[rows][near].mean()), *means, noise))
    rows_ = [np.array(one) for _, one in sorted(found.items())]
    means_ = np.array([one.mean(axis=0) for one in rows_]).reshape(-1, 5)
    number = np.array([len(one) for one in rows_])
    return means_[:, 0], means_[:, 1], means_[:, 2], means_[:, 3], means_[:, 4] / np.sqrt(np.maximum(number, 1))


def _vertex(time: Array, value: Array) -> float:
    """Extreme value of the parabola through some points, or its largest value within them."""
    since = time - time.mean()
    bend, slope, middle = np.polyfit(since, value, 2)
    where = -slope / (2 * bend) if bend else 0.0
    where = min(max(where, float(since[0])), float(since[-1]))
    return float(middle + slope * where + bend * where**2)


def _angle(place: Array) -> Array:
    """Angle [deg] of a bob from the vertical, for positions (n, 2) relative to the pivot."""
    return np.asarray(np.degrees(np.arctan2(place[:, 0], -place[:, 1])))


# ---------------------------------------------------------------------------------------------------------- overview


def _overview(diagnosis: Diagnosis) -> FigureFile:
    """Mean residual over repetitions against time, before and after, one panel per condition and coordinate."""
    bench, before, after = _fits(diagnosis)
    order = {one.experiment: rank for rank, one in reversed(list(enumerate(diagnosis.where)))}
    every = list(bench.condition_names)
    shown = sorted(range(len(every)), key=lambda c: order.get(every[c], 999))[: MOST_PANELS // 2]
    rows: list[dict[str, Any]] = []
    caption = (
        "Mean residual (measured less twin) over the repetitions of a condition, in standard errors; the band is two "
        "standard errors."
    )
    with canvas(1.6 * len(shown) + 0.4) as (figure, _):
        figure.clear()
        panels: Any = figure.subplots(len(shown), 2, squeeze=False)
        for row, condition in enumerate(shown):
            for k, axis in enumerate("xy"):
                panel = panels[row, k]
                panel.axhspan(-2, 2, color=NOISE, alpha=0.35, lw=0)
                fits = [(before, BEFORE, "before"), *([(after, TWIN, "after")] if after is not None else [])]
                for fitted, colour, label in fits:
                    time, mean = _slices(bench, fitted, condition, k)
                    panel.plot(time, mean, ".-", ms=3, lw=0.8, color=colour, label=label)
                    known = {"condition": every[condition], "axis": axis, "twin": label}
                    rows += [
                        {**known, "time_s": at, "mean_residual_standard_errors": value}
                        for at, value in zip(time.tolist(), mean.tolist(), strict=True)
                    ]
                panel.set_title(f"{every[condition]}: {axis}", fontsize=8, loc="left")
                panel.tick_params(labelsize=7)
        panels[-1, 0].set_xlabel("time [s]", fontsize=8)
        panels[0, 0].set_ylabel("standard errors", fontsize=7)
        panels[0, 0].legend(fontsize=7)
        label = "Mean residuals over time of each condition, before and after the effect is added"
        columns = ("condition", "axis", "twin", "time_s", "mean_residual_standard_errors")
        return figure_file(figure, "diagnosis-overview", label, rows, columns, caption)


def _slices(bench: Any, fitted: Fit, condition: int, axis: int) -> tuple[Array, Array]:
    """Time [s] and mean residual in standard errors, in slices of time."""
    spans = [bench.spans[r] for r in np.flatnonzero(bench.condition == condition)]
    time = np.concatenate([bench.time[span] for span in spans])
    residual = np.concatenate([fitted.residual[span, axis] for span in spans])
    centre, mean, count = _binned(time, residual, (float(np.ptp(time)) + 1e-9) / SLICES)
    return thin(centre, mean * np.sqrt(count))


# ------------------------------------------------------------------------------------------------------------- parts


def _fits(diagnosis: Diagnosis) -> tuple[Any, Fit, Fit | None]:
    assert diagnosis.naming is not None
    return diagnosis.bench, diagnosis.naming.base, diagnosis.chosen.fitted if diagnosis.chosen else None


def _effect(diagnosis: Diagnosis) -> str:
    """What was added to the twin, in words."""
    return f"with {names(diagnosis.chosen.terms)}" if diagnosis.chosen else ""


def _table(columns: dict[str, Array]) -> _Table:
    """Columns as rows, and their names."""
    rows: list[dict[str, Any]] = [
        {name: float(value[k]) for name, value in columns.items()} for k in range(len(columns["time_s"]))
    ]
    return rows, tuple(columns)
