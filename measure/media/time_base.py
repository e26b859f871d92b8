from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

ROUNDED = 0.01  # [s], by which a stated end may lie beyond that of the clip

COARSE = 0.01  # of a frame's interval, above which the rounding of time stamps moves what is seen

FRAME_LIKE = 0.3  # of a frame's interval, above which a tick is so long that a lost frame looks like rounding

WHOLE = 0.002  # ticks, by which a frame's interval is off a whole number of them at most where it is meant to be one

FULL_RATE = 5  # [%], percentile of the steps between pictures: the shortest that are no chance

UNSTEADY = 0.5  # share of odd frame intervals, from which on a file's own times are not believed

SAME_RATE = 0.03  # relative, by which two rates may differ that are meant to be one

WRONG_HEADER = 0.01  # relative, by which the rate in a file's head may differ from its time stamps


def time_base(
    stamps: Sequence[float | None], stated: float, tick: float, given: float | None
) -> tuple[npt.NDArray[np.float64], float, list[str]]:
    """Capture time of every picture, the rate at which the file plays, and what is odd about the file's own stamps.

    `stated` is the file's rate, `given` the capture rate where it is known [1/s], `tick` the unit of the stamps [s].
    """
    rate = given or stated
    index = np.arange(len(stamps), dtype=np.float64)
    if all(stamp is None for stamp in stamps):  # stills know no time
        return index / rate, stated, []
    if any(stamp is None for stamp in stamps):
        note = "frame times: the file has pictures without a time stamp; frames are counted instead."
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
        # stamps of a file that plays as fast as it was captured are true times, dropped frames or not
        used = "the file's own time stamps were used"
    else:
        times = times / step / given
        used = f"the file's own time stamps were used, stretched from {1 / step:.4g} Hz to {given:.4g} Hz"
    missing = f"; {lost} frame{'s' * (lost != 1)} between them {'are' if lost != 1 else 'is'} missing" if lost else ""
    told = (
        f"frame times: {odd} of {len(steps)} frame intervals differ by more than 5 % from {step * 1e3:.2f} ms{missing}"
    )
    return times, plays_at, [*notes, f"{told}; {used}."]


def _even(times: npt.NDArray[np.float64], tick: float, known: Sequence[float]) -> bool:
    """Whether the steps are equal but for the rounding of the stamps to ticks; `known` rates [1/s]."""
    steps = np.diff(times)
    index = np.arange(len(times))
    if tick < FRAME_LIKE * float(np.median(steps)):
        line = np.polyfit(index, times, 1)
        return bool(np.max(np.abs(np.polyval(line, index) - times)) <= max(0.8 * tick, 0.02 * line[0]))
    # in ticks about as long as a frame every fourth picture lost looks like rounded steps a third longer: only a rate
    # that is known to be no whole number of ticks makes rounded steps of them
    if np.ptp(steps) < 0.5 * tick:
        return True
    rounded = [rate for rate in known if abs(1 / rate / tick - round(1 / rate / tick)) > WHOLE]
    return any(float(np.ptp(times - index / rate)) <= (1 + COARSE) * tick for rate in rounded)


def _played(step: float, stated: float, doubt: float, mean: float = 0.0) -> tuple[float, list[str]]:
    """Rate at which a film of such a step [s] plays; `doubt` of the step, relative, `mean` rate with all that is lost.

    The stated rate is the sharper one as long as the stamps do not contradict it.
    """
    if not stated > 0:
        return 1 / step, []
    if abs(step * stated - 1) <= WRONG_HEADER + doubt or (mean and abs(stated / mean - 1) <= SAME_RATE):
        return stated, []
    return 1 / step, [
        f"frame times: the file's head states {stated:.4g} Hz, its time stamps are {step * 1e3:.2f} ms apart, which is "
        f"{1 / step:.4g} Hz; the time stamps were believed."
    ]


def _stored_slow(plays_at: float, given: float | None) -> list[str]:
    if given is None or abs(plays_at / given - 1) < SAME_RATE:
        return []
    why = "high-speed footage stored slow" if given > plays_at else "a time lapse, or frames shown twice"
    return [
        f"frame times: the file plays at {plays_at:.4g} Hz, --frame-rate gives {given:.4g} Hz: read as {why}; "
        "if it plays in real time, leave out --frame-rate."
    ]


def _full_step(steps: npt.NDArray[np.float64]) -> tuple[float, int]:
    """The step [s] between pictures of which none is lost between them, and how many are lost in all.

    The usual one, unless shorter ones occur of which all are whole multiples: then every second is lost in most places.
    """
    usual = float(np.median(steps))
    for guess in (float(np.percentile(steps, FULL_RATE)), usual):
        whole = np.maximum(np.rint(steps / guess), 1)
        step = float(np.sum(steps) / np.sum(whole))
        # stamps may have been rounded to milliseconds before they came into this file
        if np.mean(np.abs(steps / step - whole) < 0.25) > 0.95:
            return step, int(np.sum(whole - 1))
    return usual, 0


def _unrounded(times: npt.NDArray[np.float64], tick: float, stated: float) -> npt.NDArray[np.float64]:
    """Stamps in coarse ticks [s], from 0, put back to whole multiples of one interval where they all fit such ones.

    Matroska counts milliseconds: a quarter of a frame at 240 Hz, in which a fast bead goes several pixels.
    """
    steps = np.diff(times)
    if tick < COARSE * float(np.median(steps)):
        return times
    for guess in (float(np.median(steps)), float(np.percentile(steps, FULL_RATE))):
        interval = guess
        for _ in range(3):  # the step itself is a whole number of ticks
            places = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / interval), 1))])
            interval, first = (float(each) for each in np.polyfit(places, times, 1))
        if np.max(np.abs(first + interval * places - times)) <= 0.8 * tick:
            # the stated rate is the truer one where the stamps, each a tick off at most, cannot tell the two apart
            return places * (1 / stated if abs(interval * stated - 1) < tick / times[-1] else interval)
    return times
