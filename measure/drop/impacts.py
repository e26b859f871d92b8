"""Impacts of a bouncing body in a sound recording: onsets of energy, and which of them are its bounces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.measure.media.sound import Sound

BAND = (1000.0, 16000.0)  # [Hz], of the click of an impact; voices, steps and mains hum lie below

AFTER, BEFORE, GUARD = 2e-3, 10e-3, 1e-3  # [s], windows of the energy that are compared, and the gap between them

APART = 15e-3  # [s], shortest flight: of a rebound of 0.3 mm

SURE = 8.0  # robust standard deviations of the usual change of energy: noise alone exceeds 5 about once in an hour

LOUDER = math.log(2.0)  # least logarithmic rise of energy, so that a recording without noise shows no rounding errors

PRE_ECHO = 0.05  # share of a click's highest energy below which lossy codecs spread it over milliseconds before it

LOSSY = 2e-4  # [s], standard uncertainty of an onset in AAC: rms error of 60 synthesised clicks at 48 kHz, rounded up

MOST = 60  # loudest onsets that are looked at

STEADY = 0.2  # largest relative change of the restitution from bounce to bounce

HIGHEST, LOWEST = 0.99, 0.05  # restitution of a bouncing body


@dataclass(frozen=True)
class Onsets:
    """Beginnings of clicks in a recording."""

    times: Array  # [s], shape (n,), rising
    sigmas: Array  # [s], shape (n,), standard uncertainty
    rises: Array  # shape (n,), natural logarithm of the energy after over before


def find_onsets(sound: Sound) -> Onsets:
    """Onsets of energy in the band of clicks.

    Parameters
    ----------
    sound : Sound
        The recording.

    Returns
    -------
    Onsets
        Times at which the energy rises more than it does in the noise, refined to the sample.

    Notes
    -----
    The logarithmic ratio of the energies in a window after and before each sample is compared with its own median and
    median absolute deviation, which are those of noise and of decaying clicks.  The time is the change point with the
    largest likelihood of two Gaussian noises of different variance (the AIC picker of seismology); samples within one
    unit of the least -2 log likelihood, and half a period of the click, are its standard uncertainty.
    """
    from scipy.signal import butter, find_peaks, sosfilt
    from scipy.stats import median_abs_deviation

    rate = sound.rate
    none = Onsets(np.zeros(0), np.zeros(0), np.zeros(0))
    high = min(BAND[1], 0.45 * rate)
    n_after, n_before, guard = (max(2, round(each * rate)) for each in (AFTER, BEFORE, GUARD))
    if high <= BAND[0] or len(sound.samples) < 4 * (n_after + n_before + guard):
        return none
    clicks = np.asarray(sosfilt(butter(4, (BAND[0], high), "bandpass", fs=rate, output="sos"), sound.samples))
    energy = np.concatenate([[0.0], np.cumsum(clicks**2)])
    # digital silence has no energy at all: a share of the whole keeps the ratio finite
    least = max(float(energy[-1]) / len(clicks) * 1e-9, np.finfo(float).tiny)
    at = np.arange(n_before + guard, len(clicks) - n_after)
    after = (energy[at + n_after] - energy[at]) / n_after + least
    before = (energy[at - guard] - energy[at - guard - n_before]) / n_before + least
    rise = np.log(after / before)
    usual = float(np.median(rise))
    scatter = float(median_abs_deviation(rise, scale="normal"))
    peaks, _ = find_peaks(rise, height=max(usual + SURE * scatter, LOUDER), distance=max(1, round(APART * rate)))
    picked = [_pick(clicks, int(at[peak]), n_before, n_after) for peak in peaks]
    times = sound.start + np.array([time for time, _ in picked]) / rate
    sigmas = np.hypot(np.array([sigma for _, sigma in picked]) / rate, LOSSY if sound.lossy else 0.0)
    return Onsets(times, sigmas, rise[peaks]) if picked else none


def _pick(signal: Array, near: int, before: int, after: int) -> tuple[float, float]:
    """Sample at which a click begins, and its standard uncertainty in samples."""
    first, last = max(near - before, 0), min(near + 2 * after, len(signal))
    # the click is loudest soon after it begins: what follows its loudest sample does not belong to the onset
    last = first + int(np.argmax(np.abs(signal[first:last]))) + 2
    part = signal[first:last] ** 2
    n = len(part)
    k = np.arange(2, n - 1)
    if len(k) < 2:
        return float(near), float(after)
    total = np.cumsum(part)
    tiny = PRE_ECHO * float(np.max(part)) + np.finfo(float).tiny
    misfit = k * np.log(total[k - 1] / k + tiny) + (n - k) * np.log((total[-1] - total[k - 1]) / (n - k) + tiny)
    likely = k[misfit - misfit.min() < 1.0]
    crossings = int(np.sum(np.diff(np.signbit(signal[near : near + 2 * after]))))
    # a click that emerges from noise is seen from its first half period on, anywhere in it
    half_period = 2 * after / max(crossings, 1)
    sigma = math.hypot(float(np.ptp(likely)) / 2, half_period / math.sqrt(12))
    return float(first + k[np.argmin(misfit)]), max(sigma, 1 / math.sqrt(12))


def bounces_among(onsets: Onsets) -> list[int]:
    """Indices of the longest series of onsets whose intervals shrink as the flights of one bouncing body do.

    The ratio of neighbouring intervals is the restitution, which changes little from bounce to bounce; other sounds in
    between are passed over.  Empty if no three onsets make such a series.
    """
    order = np.sort(np.argsort(onsets.rises)[-MOST:])
    times = onsets.times[order]
    best: list[int] = []
    best_misfit = math.inf
    for i in range(len(times) - 2):
        for j in range(i + 1, len(times) - 1):
            for k in range(j + 1, len(times)):
                ratio = (times[k] - times[j]) / (times[j] - times[i])
                if ratio > HIGHEST:
                    break
                if ratio < LOWEST or len(times) - k + 2 < len(best):
                    continue
                series, misfit = _follow(times, [i, j, k])
                if len(series) > len(best) or (len(series) == len(best) and misfit < best_misfit):
                    best, best_misfit = series, misfit
    return [int(order[each]) for each in best]


def _follow(times: Array, series: Sequence[int]) -> tuple[list[int], float]:
    """The series with the onsets that continue it, and the mean square change of the restitution along it."""
    found = list(series)
    changes: list[float] = []
    while True:
        last, flight = times[found[-1]], times[found[-1]] - times[found[-2]]
        ratio = flight / (times[found[-2]] - times[found[-3]])
        wanted = ratio * flight
        nearest = int(np.argmin(np.abs(times - (last + wanted))))
        change = (times[nearest] - last) / wanted - 1
        if nearest <= found[-1] or abs(change) > STEADY or times[nearest] - last >= HIGHEST * flight:
            break
        changes.append(change)
        found.append(nearest)
    return found, float(np.mean(np.square(changes))) if changes else math.inf
