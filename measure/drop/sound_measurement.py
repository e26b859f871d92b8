"""Measure a bouncing body by the sound of its impacts, and compare a film with its own sound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.checksums import sha256
from rigtwin.lab.errors import NothingToMeasure, RigtwinError
from rigtwin.lab.quantity import Check, Detail, Measurement, Quantity, doubted, root_sum_of_squares
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drop.impacts import Onsets, bounces_among, find_onsets
from rigtwin.measure.media.sound import Sound, has_sound, read_sound

METHOD = "sound"

ONE_BODY = 4  # impacts from which a series is surely that of one bouncing body: any three shrinking intervals fit

RELEASE = 0.1  # largest relative difference of the restitution of the first bounce from that of the second

CONTRADICT = 3.0  # standard uncertainties between film and sound

SAME_PACE = 0.01  # relative difference of flight times; the clocks of camera and microphone differ by far less

FEW = (
    "only three impacts were found, and any two sounds behind a first one fit a bouncing body if their intervals shrink"
)


def measure_sound(path: Path, *, out: Path | None = None) -> Measurement:
    """Measure the restitution of a bouncing body from the sound of its impacts.

    Parameters
    ----------
    path : Path
        Sound recording, or a film with sound.
    out : Path, optional
        Folder for the plot; None writes no file.

    Returns
    -------
    Measurement
        ``restitution_wall`` [1] and ``rebound_height`` [m] by the method "sound", and ``drop_height`` [m] where a sound
        before the first impact fits the release.

    Raises
    ------
    UnreadableMedia
        If the file holds no sound.
    NothingToMeasure
        If no three impacts with shrinking intervals are heard.

    Notes
    -----
    Without air a flight of duration T between two impacts reaches h = g T^2 / 8, and e = T_{n+1} / T_n at the impact
    between two flights.  The first impact has no flight before it, so that bounces count from 1 at the first one heard.
    """
    sound = read_sound(path)
    onsets = find_onsets(sound)
    series = bounces_among(onsets)
    if not series:
        raise NothingToMeasure(
            f"{path}: {len(onsets.times)} clicks stand out of the noise of the sound, but no three of them have the "
            "shrinking intervals of a bouncing body."
        )
    times, sigmas = onsets.times[series], onsets.sigmas[series]
    others = len(onsets.times) - len(series)
    reason = FEW if len(times) < ONE_BODY else ""
    quantities = [*_restitutions(times, sigmas, reason), *_heights(times, sigmas, reason)]
    release = _release(onsets, times)
    warnings = []
    if release is not None:
        quantities.append(_drop_height(onsets, release, times, sigmas))
    else:
        warnings.append("drop height: not given, because no sound before the first impact fits a release.")
    if others:
        warnings.append(f"{others} other clicks in the recording are not of the bouncing body and were left out.")
    measurement = Measurement(
        rig="drop",
        source=path,
        source_sha256=sha256(path),
        quantities=tuple(quantities),
        checks=(_steady_check(times, sigmas),),
        warnings=tuple(warnings),
        camera={"sound_rate_hz": sound.rate, "impacts_s": [round(float(time), 6) for time in times]},
    )
    if out is None:
        return measurement
    return replace(measurement, files={"plot": _write_plot(out / f"{path.stem}-sound.svg", sound, onsets, times)})


def with_sound(film: Measurement) -> Measurement:
    """A film's measurement with the quantities of its sound and a check of both against each other.

    Where the sound cannot be evaluated a warning says why.
    """
    if not has_sound(film.source):
        return replace(film, warnings=(*film.warnings, "sound: the film has no sound track."))
    try:
        heard = measure_sound(film.source)
    except RigtwinError as error:
        return replace(film, warnings=(*film.warnings, f"sound: not evaluated, because {error}"))
    check = _film_check(film, heard)
    warnings = heard.warnings if check.passed else (*heard.warnings, f"film and sound contradict: {check.message}")
    return replace(
        film,
        quantities=(*film.quantities, *heard.quantities),
        checks=(*film.checks, *heard.checks, check),
        warnings=(*film.warnings, *warnings),
        camera={**film.camera, **heard.camera},
    )


def _restitutions(times: Array, sigmas: Array, reason: str) -> list[Quantity]:
    found = []
    for k in range(1, len(times) - 1):
        before, after = times[k] - times[k - 1], times[k + 1] - times[k]
        ratio = float(after / before)
        # e = (t3 - t2) / (t2 - t1)
        slopes = np.array([ratio / before, -(1 + ratio) / before, 1 / before])
        timing = float(np.linalg.norm(slopes * sigmas[k - 1 : k + 2]))
        detail: dict[str, Detail] = {"bounce": k + 1, "contact_time_s": round(float(times[k]), 7)}
        found.append(
            doubted(Quantity("restitution_wall", ratio, timing, "1", METHOD, 1, detail, {"timing": timing}), reason)
        )
    return found


def _heights(times: Array, sigmas: Array, reason: str) -> list[Quantity]:
    found = []
    for k in range(1, len(times)):
        flight = float(times[k] - times[k - 1])
        timing = GRAVITY * flight / 4 * float(np.hypot(sigmas[k], sigmas[k - 1]))
        height = GRAVITY * flight**2 / 8
        found.append(
            doubted(
                Quantity("rebound_height", height, timing, "m", METHOD, 1, {"bounce": k}, {"timing": timing}), reason
            )
        )
    return found


def _release(onsets: Onsets, times: Array) -> int | None:
    """The sound before the first impact from which a fall gives the first bounce the restitution of the second."""
    second = float((times[2] - times[1]) / (times[1] - times[0]))
    earlier = np.flatnonzero(onsets.times < times[0])
    if not len(earlier):
        return None
    first = (times[1] - times[0]) / (2 * (times[0] - onsets.times[earlier]))
    off = np.abs(first / second - 1)
    nearest = int(np.argmin(off))
    return int(earlier[nearest]) if off[nearest] < RELEASE else None


def _drop_height(onsets: Onsets, release: int, times: Array, sigmas: Array) -> Quantity:
    fall = float(times[0] - onsets.times[release])
    budget = {"timing": GRAVITY * fall * float(np.hypot(sigmas[0], onsets.sigmas[release]))}
    found = Quantity("drop_height", GRAVITY * fall**2 / 2, root_sum_of_squares(budget), "m", METHOD, 1, {}, budget)
    heard = f"the click at {onsets.times[release]:.3f} s is taken for the release, as the restitution then fits"
    return doubted(found, heard)


def _steady_check(times: Array, sigmas: Array) -> Check:
    """Check that the restitution changes smoothly: a missed or a foreign impact makes it jump."""
    flights = np.diff(times)
    ratios = flights[1:] / flights[:-1]
    change = float(np.max(np.abs(np.diff(np.log(ratios))))) if len(ratios) > 1 else 0.0
    message = (
        f"{len(times)} impacts are heard between {times[0]:.3f} and {times[-1]:.3f} s, timed to "
        f"{1e3 * float(np.median(sigmas)):.2f} ms; from bounce to bounce the restitution changes by at most "
        f"{100 * change:.1f} %."
    )
    return Check("impacts_heard", True, float(len(times)), float(len(times)), message)


def _film_check(film: Measurement, heard: Measurement) -> Check:
    """Compare flight times and restitutions of the film with those of its sound, bounce by bounce."""
    seen_times = _contacts(film.quantities)
    heard_times = np.asarray(heard.camera["impacts_s"])
    flights, others = np.diff(seen_times), np.diff(heard_times)
    if len(flights) == 0:
        return Check("film_and_sound", True, math.nan, 1.0, "the film shows one bounce: no flight time to compare.")
    shifts = range(-(len(flights) - 1), len(others))
    shift = min(shifts, key=lambda each: _apart(flights, others, each))
    pairs = [(k, k + shift) for k in range(len(flights)) if 0 <= k + shift < len(others)]
    pace = float(np.exp(np.mean([math.log(others[b] / flights[a]) for a, b in pairs])))
    worst = 0.0
    compared = 0
    for quantity in film.quantities:
        if quantity.quantity != "restitution_wall" or quantity.method != "time":
            continue
        bounce = int(quantity.detail["bounce"]) + shift
        other = next(
            (q for q in heard.quantities if q.quantity == "restitution_wall" and q.detail["bounce"] == bounce), None
        )
        if other is not None:
            compared += 1
            difference = (quantity.value - other.value) / math.hypot(quantity.std_uncertainty, other.std_uncertainty)
            worst = max(worst, abs(difference), key=abs)
    same_pace = abs(pace - 1) < SAME_PACE
    message = f"flights of the sound last {pace:.4f} times those of the film"
    message += f"; {compared} restitutions differ by at most {worst:.1f} standard uncertainties" if compared else ""
    if not same_pace:
        message += "; the frame rate, or the time scale of the film, is wrong by that factor"
    return Check("film_and_sound", same_pace and worst < CONTRADICT, pace, 1.0, message + ".")


def _contacts(quantities: Sequence[Quantity]) -> Array:
    by_bounce = {
        int(each.detail["bounce"]): float(each.detail["contact_time_s"])
        for each in quantities
        if each.quantity == "restitution_wall" and "contact_time_s" in each.detail
    }
    return np.array([by_bounce[bounce] for bounce in sorted(by_bounce)])


def _apart(flights: Array, others: Array, shift: int) -> float:
    """Spread of the logarithmic ratios of flights that are paired with a shift, with a preference for many pairs.

    Ratios and not differences, as a film with a wrong frame rate has the same flights at another pace; of a series with
    a constant restitution every shift fits, and the pace nearest to one is taken.
    """
    ratios = [math.log(others[k + shift] / flights[k]) for k in range(len(flights)) if 0 <= k + shift < len(others)]
    return float(np.mean(np.abs(ratios))) / math.sqrt(len(ratios))


def _write_plot(path: Path, sound: Sound, onsets: Onsets, times: Array) -> Path:
    """Sound pressure over time with the impacts."""
    from matplotlib.figure import Figure

    from rigtwin.measure.drawing import save_plot

    figure = Figure(figsize=(8, 3))
    axes = figure.subplots()
    # the envelope of the sound: a screen has fewer columns than a recording has samples
    step = max(1, len(sound.samples) // 4000)
    n = len(sound.samples) // step * step
    blocks = sound.samples[:n].reshape(-1, step)
    time = sound.start + np.arange(len(blocks)) * step / sound.rate
    axes.fill_between(time, blocks.min(axis=1), blocks.max(axis=1), color="0.6", lw=0)
    for each in onsets.times:
        axes.axvline(each, color="0.8", lw=0.8, zorder=0)
    for each in times:
        axes.axvline(each, color="#D55E00", lw=0.8)
    axes.set_xlabel("time / s")
    axes.set_ylabel("sound pressure")
    axes.set_title(f"{len(times)} impacts", fontsize=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_plot(path, figure)
    return path
