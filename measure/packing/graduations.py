"""Find a length gauge in a photo and read it in millimetres at every row, without clicks.

Graduations are periodic.  Along the gauge the grey level is a wave with a period of one millimetre.  Its unwrapped
phase is the reading; perspective, which makes distant millimetres smaller, is contained in the phase.  The longer marks
show which graduations are whole centimetres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, GreyImage
from rigtwin.measure.packing.bed_profile import PITCH_RANGE

BENDING = 0.05  # largest relative change of the pitch from end to end, by perspective
LEAST_LENGTH = 25.0  # [mm], shortest visible length of a gauge
CLEAR = 7.0  # least amplitude of the wave over that expected for noise
LONGER_MARKS = 5.0  # least score of the longer marks at whole centimetres
CLEAR_PART = 8.0  # [mm], shortest separate stretch of graduations that is accepted
FEW_MARKS = 3.0  # [mm], the same where its marks are as clear as the clearest of the gauge
FINEST = 2.2  # [px], smallest millimetre that can be resolved
PADDED = (
    4  # zero padding of a wave in multiples of its length; resolves its rate to a quarter of a turn over its length
)
BENDS = 11  # number of bends tried within +-`BENDING`
PROMISING = 12  # number of columns for which all bends are tried


@dataclass(frozen=True)
class Gauge:
    """A graduated line in the picture; `row` is counted along the direction of the gauge."""

    column: float  # [px], column of the gauge at row 0
    lean: float  # [rad], angle between gauge and picture columns, positive where its foot is further right
    rate: tuple[float, float, float]  # reading [mm] = a + b row + c row^2, decreasing with the row
    first: float  # [px], first row with visible graduations
    last: float  # [px], last row with visible graduations
    strength: float  # amplitude of the wave over that expected for noise
    lowest: float  # [px], row of the lowest graduations, including those below a gap

    def reading(self, row: Array | float) -> Array:
        """Reading [mm] at a picture row [px] on the gauge."""
        a, b, c = self.rate
        return np.asarray(a + b * np.asarray(row) + c * np.asarray(row) ** 2, dtype=np.float64)

    def row_of(self, reading: float) -> float:
        """Picture row [px] of a reading [mm]."""
        a, b, c = self.rate
        row = (reading - a) / b
        for _ in range(20):
            row = (reading - a - c * row * row) / b
        return float(row)

    def pitch(self, row: float) -> float:
        """Size of a pixel [m/px] at a picture row [px]."""
        return abs(self.rate[1] + 2 * self.rate[2] * row) * 1e-3

    def column_at(self, row: float) -> float:
        """Picture column [px] of the gauge at a row."""
        return self.column + math.tan(self.lean) * row


def find_gauge(
    grey: GreyImage, columns: Array, lean: Array, expected: float, floor: float, floor_tolerance: float
) -> Gauge | None:
    """Find the clearest gauge in picture columns.

    `columns`, shape (n,) [px], are searched; `lean`, shape (n,) [rad], is the direction of a gauge there.  `expected`
    is the size of a millimetre [px].  `floor` is the approximate row of the gauge's zero [px] and `floor_tolerance` the
    largest distance from it [mm].  Returns None if no graduations are found.
    """
    if expected * PITCH_RANGE < FINEST or len(columns) == 0:
        return None
    waves = [_wave(grey, float(column), float(turn)) for column, turn in zip(columns, lean, strict=True)]
    strength, k, (rate, bend) = _clearest(np.stack(waves), expected)
    if strength < CLEAR:
        return None
    wave = waves[k]
    phase, first, last, lowest = _phase(wave, rate, bend)
    if (last - first) * abs(rate) < LEAST_LENGTH:
        return None
    at_row_0 = _whole(waves, k, (phase, rate, bend), (first, last), floor, floor_tolerance)
    if at_row_0 is None:
        return None
    # readings increase upwards, rows downwards
    return Gauge(float(columns[k]), float(lean[k]), (at_row_0, -rate, -bend), first, last, strength, lowest)


def other_sizes(expected: float, rows: int) -> list[float]:
    """Sizes of a millimetre [px] with which `find_gauge` searches all that a picture of `rows` shows but `expected`.

    A gauge is found so although the stated size is wrong by more than `PITCH_RANGE`.
    """
    least, most = FINEST / PITCH_RANGE, rows / LEAST_LENGTH * PITCH_RANGE
    lowest, highest = (math.log(size / expected) / (2 * math.log(PITCH_RANGE)) for size in (least, most))
    return [expected * PITCH_RANGE ** (2 * k) for k in range(math.ceil(lowest), math.floor(highest) + 1) if k != 0]


def _wave(grey: GreyImage, column: float, lean: float, half_width: int = 2) -> Array:
    """Grey level along the gauge, high-pass filtered and divided by its local rms."""
    rows = np.arange(grey.shape[0], dtype=np.float32)
    across = np.arange(-half_width, half_width + 1, dtype=np.float32)
    x = column + math.tan(lean) * rows[:, None] + across[None, :]
    y = np.broadcast_to(rows[:, None], x.shape)
    values = cv2.remap(grey, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    line = values.astype(np.float64).mean(axis=1)
    slow = cv2.GaussianBlur(line.reshape(-1, 1), (1, 37), sigmaX=0.1, sigmaY=6.0).ravel()
    fast = line - slow
    size = np.sqrt(cv2.blur(np.square(fast).reshape(-1, 1), (1, 61)).ravel().clip(0)) + 0.7
    return np.asarray(fast / size)


def _turns(rows: Array, rate: float, bend: float) -> Array:
    return np.asarray(np.exp(-2j * math.pi * (rate * rows + bend * rows * rows)))


def _clearest(waves: Array, expected: float) -> tuple[float, int, tuple[float, float]]:
    """Strength, index, rate [1/px] and bend [1/px^2] of the clearest millimetre wave; `waves` is (n, rows)."""
    bends = np.linspace(-BENDING, BENDING, BENDS) / (2 * waves.shape[1] * expected)
    few = bends[[BENDS // 4, BENDS // 2, BENDS - 1 - BENDS // 4]]
    first = np.max([_spectrum(waves, expected, float(bend))[0] for bend in few], axis=0)
    promising = np.argsort(first)[::-1][:PROMISING]
    best, place, k = 0.0, (0.0, 0.0), 0
    for bend in bends.tolist():
        strength, rates = _spectrum(waves[promising], expected, bend)
        top = int(np.argmax(strength))
        if strength[top] > best:
            best, place, k = float(strength[top]), (float(rates[top]), bend), int(promising[top])
    rate, bend = place
    # convert the bend about the middle to reading = a + rate row + bend row^2
    return best, k, (rate - bend * waves.shape[1], bend)


def _spectrum(waves: Array, expected: float, bend: float) -> tuple[Array, Array]:
    """Strength (amplitude over that of noise) and rate [1/px] of the clearest period of every wave, bend removed."""
    from scipy.fft import fft, next_fast_len

    rows = waves.shape[1]
    chirp = np.exp(-2j * math.pi * bend * (np.arange(rows) - rows / 2) ** 2)
    count = next_fast_len(PADDED * rows)
    lowest, highest = 1 / expected / PITCH_RANGE, min(PITCH_RANGE / expected, 1 / FINEST)
    part = slice(math.floor(lowest * count), math.ceil(highest * count) + 1)
    size = np.abs(fft((waves * chirp).astype(np.complex64), count, axis=1)[:, part])
    top = np.argmax(size, axis=1)
    strength = size[np.arange(len(waves)), top] / np.maximum(np.sqrt(np.sum(waves**2, axis=1)), 1e-9)
    return np.asarray(strength, dtype=np.float64), (part.start + top) / count


def _phase(wave: Array, rate: float, bend: float) -> tuple[float, float, float, float]:
    """Phase at row 0 [turns], first and last row of the visible wave, and the lowest row of any clear part."""
    rows = np.arange(len(wave), dtype=np.float64)
    mixed = wave * _turns(rows, rate, bend)
    window = 15
    local = np.convolve(mixed, np.ones(window) / window, mode="same")
    whole = mixed.sum()
    agreeing = np.real(local * np.conj(whole)) / (abs(whole) + 1e-9)
    clear = float(np.percentile(agreeing, 90))
    seen = agreeing > max(0.35 * clear, 0.0)
    runs = np.flatnonzero(seen)
    if len(runs) == 0:
        return 0.0, 0.0, 0.0, 0.0
    pieces = np.split(runs, np.flatnonzero(np.diff(runs) > 40) + 1)
    best = max(pieces, key=len)
    inside = slice(int(best[0]), int(best[-1]) + 1)

    def no_accident(piece: npt.NDArray[np.int64]) -> bool:
        length = len(piece) * rate
        return length > CLEAR_PART or (length > FEW_MARKS and float(agreeing[piece].max()) > clear)

    lowest = max(int(piece[-1]) for piece in pieces if piece is best or no_accident(piece))
    return float(np.angle(mixed[inside].sum()) / (2 * math.pi)), float(best[0]), float(best[-1]), float(lowest)


def _whole(
    waves: list[Array],
    k: int,
    law: tuple[float, float, float],
    ends: tuple[float, float],
    floor: float,
    floor_tolerance: float,
) -> float | None:
    """Reading at row 0 [mm], or None if it is ambiguous.

    Marks lie on whole millimetres, longer ones on whole centimetres, and the zero lies near the floor.
    """
    phase, rate, bend = law
    rows = np.arange(len(waves[0]), dtype=np.float64)
    inside = (rows >= ends[0] - 8) & (rows <= ends[1] + 8)
    fallen = rate * rows + bend * rows * rows
    middle = rate * floor + bend * floor * floor
    best, answer = LONGER_MARKS, None
    for j in range(max(k - 14, 0), min(k + 15, len(waves))):
        wave = waves[j][inside]
        # marks take the smaller part of a period: dark on light, or light on dark
        sign = -1.0 if float(np.mean(wave**3)) < 0 else 1.0
        nearest = math.ceil(middle - floor_tolerance)
        start = -phase + (0.5 if sign < 0 else 0.0)
        for whole in np.arange(nearest - 1, middle + floor_tolerance + 1):
            at_row_0 = whole + (start - math.floor(start))
            if abs(at_row_0 - middle) > floor_tolerance:
                continue
            reading = at_row_0 - fallen[inside]
            long, half = (_tooth(reading + shift) for shift in (0.0, 5.0))
            score = sign * float(wave @ (long - half)) / math.sqrt(float(long @ long + half @ half) + 1e-9)
            if score > best:
                best, answer = score, at_row_0
    return answer


def _tooth(reading: Array) -> Array:
    """Weight that is 1 at whole centimetres and 0 from half a millimetre off."""
    return np.asarray(np.exp(-0.5 * ((reading - 10 * np.round(reading / 10)) / 0.25) ** 2))
