"""Capture times of the frames from the file's time stamps, its stated rate and the given capture rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

ROUNDED = 0.01  # [s], tolerance of --end beyond the end of the clip; durations are often rounded to this

COARSE = 0.01  # of the frame interval; coarser time stamps are corrected for their rounding

FRAME_LIKE = 0.3  # of the frame interval; with coarser ticks a lost frame looks like rounding

WHOLE = 0.002  # [ticks], a frame interval this close to a whole number of ticks counts as whole

FULL_RATE = 5  # [%], percentile of the frame intervals taken as the shortest one

UNSTEADY = 0.5  # share of irregular frame intervals above which the file's times are not used

SAME_RATE = 0.03  # relative tolerance within which two rates count as equal

WRONG_HEADER = 0.01  # relative tolerance between the rate in the file header and the time stamps


def time_base(
    stamps: Sequence[float | None], stated: float, tick: float, given: float | None
) -> tuple[npt.NDArray[np.float64], float, list[str]]:
    """Capture time of every picture [s], shape (n,), playback rate [1/s], and warnings about the time stamps.

    `stated` is the file's rate [1/s], `given` the capture rate if known [1/s], `tick` the resolution of the stamps [s].
    """
    rate = given or stated
    index = np.arange(len(stamps), dtype=np.float64)
    if all(stamp is None for stamp in stamps):  # single pictures have no time stamps
        return index / rate, stated, []
    if any(stamp is None for stamp in stamps):
        note = "frame times: the file has pictures without a time stamp; used frame index / frame rate instead."
        return index / rate, stated, [note]
    times = np.array(stamps, dtype=np.float64)
    times = times - times[0]
    if backwards := int(np.sum(np.diff(times) <= 0)):
        return (
            index / rate,
            stated,
            [
                f"frame times: {backwards} of the file's time stamps run backwards or repeat "
                "(typical of H.264 with B-frames in AVI); used frame index / frame rate instead."
            ],
        )
    if _even(times, tick, [known for known in (given, stated) if known]):
        plays_at, notes = _played(float(np.polyfit(index, times, 1)[0]), stated, tick / times[-1])
        rate = given or plays_at
        return index / rate, plays_at, notes + _stored_slow(plays_at, given)
    times = _unrounded(times, tick, stated)
    steps = np.diff(times)
    step, lost = _full_step(steps)
    plays_at, notes = _played(step, stated, tick / times[-1], 1 / float(np.mean(steps)))
    odd = int(np.sum(np.abs(steps - step) > 0.05 * step))
    rates = [1 / step, 1 / float(np.median(steps)), 1 / float(np.mean(steps)), plays_at]
    if given is None or any(abs(real / given - 1) < SAME_RATE for real in rates):
        # a file that plays at its capture rate has true time stamps, even with lost frames
        used = "the file's own time stamps were used"
    else:
        times = times / step / given
        used = f"the file's own time stamps were used, stretched from {1 / step:.4g} Hz to {given:.4g} Hz"
    missing = f"; {lost} frame{'s' * (lost != 1)} between them {'are' if lost != 1 else 'is'} missing" if lost else ""
    irregular = (
        f"frame times: {odd} of {len(steps)} frame intervals differ by more than 5 % from {step * 1e3:.2f} ms{missing}"
    )
    return times, plays_at, [*notes, f"{irregular}; {used}."]


def _even(times: npt.NDArray[np.float64], tick: float, known: Sequence[float]) -> bool:
    """Whether the frame intervals are equal within the rounding of the stamps to ticks; `known` are rates [1/s]."""
    steps = np.diff(times)
    index = np.arange(len(times))
    if tick < FRAME_LIKE * float(np.median(steps)):
        line = np.polyfit(index, times, 1)
        return bool(np.max(np.abs(np.polyval(line, index) - times)) <= max(0.8 * tick, 0.02 * line[0]))
    # with ticks about as long as a frame, losing every fourth picture looks like rounded steps a third longer; uneven
    # steps count as rounding only if a known rate is not a whole number of ticks
    if np.ptp(steps) < 0.5 * tick:
        return True
    rounded = [rate for rate in known if abs(1 / rate / tick - round(1 / rate / tick)) > WHOLE]
    return any(float(np.ptp(times - index / rate)) <= (1 + COARSE) * tick for rate in rounded)


def _played(step: float, stated: float, uncertainty: float, mean: float = 0.0) -> tuple[float, list[str]]:
    """Playback rate [1/s] of a file with this frame interval [s], and a warning if its header disagrees.

    `uncertainty` is the relative uncertainty of `step`; `mean` is the mean rate including lost frames [1/s]. The stated
    rate is more precise and is used unless the stamps contradict it.
    """
    if not stated > 0:
        return 1 / step, []
    if abs(step * stated - 1) <= WRONG_HEADER + uncertainty or (mean and abs(stated / mean - 1) <= SAME_RATE):
        return stated, []
    return 1 / step, [
        f"frame times: the file header states {stated:.4g} Hz, its time stamps are {step * 1e3:.2f} ms apart, which is "
        f"{1 / step:.4g} Hz; the time stamps were used."
    ]


def _stored_slow(plays_at: float, given: float | None) -> list[str]:
    if given is None or abs(plays_at / given - 1) < SAME_RATE:
        return []
    why = "a high-speed recording stored at a lower rate" if given > plays_at else "a time lapse, or frames shown twice"
    return [
        f"frame times: the file plays at {plays_at:.4g} Hz, --frame-rate gives {given:.4g} Hz: read as {why}; "
        "if it plays in real time, leave out --frame-rate."
    ]


def _full_step(steps: npt.NDArray[np.float64]) -> tuple[float, int]:
    """Frame interval without losses [s] and the total number of lost frames.

    The median interval, unless all intervals are whole multiples of a shorter one: then most places lost every second
    frame.
    """
    usual = float(np.median(steps))
    for guess in (float(np.percentile(steps, FULL_RATE)), usual):
        whole = np.maximum(np.rint(steps / guess), 1)
        step = float(np.sum(steps) / np.sum(whole))
        # the stamps may have been rounded to milliseconds before they were stored in this file
        if np.mean(np.abs(steps / step - whole) < 0.25) > 0.95:
            return step, int(np.sum(whole - 1))
    return usual, 0


def _unrounded(times: npt.NDArray[np.float64], tick: float, stated: float) -> npt.NDArray[np.float64]:
    """Replace stamps rounded to coarse ticks [s] by multiples of one interval if all of them fit.

    Matroska stores milliseconds: a quarter of a frame at 240 Hz, in which a fast bead moves several pixels.
    """
    steps = np.diff(times)
    if tick < COARSE * float(np.median(steps)):
        return times
    for guess in (float(np.median(steps)), float(np.percentile(steps, FULL_RATE))):
        interval = guess
        for _ in range(3):  # the median step is rounded to ticks: refine it
            places = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / interval), 1))])
            interval, first = (float(each) for each in np.polyfit(places, times, 1))
        if np.max(np.abs(first + interval * places - times)) <= 0.8 * tick:
            # within the stamps' resolution the stated rate is the more precise one
            return places * (1 / stated if abs(interval * stated - 1) < tick / times[-1] else interval)
    return times
