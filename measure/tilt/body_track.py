"""Find the body that rests on a turning arm and later runs down it, and follow it with sub-pixel accuracy.

In the arm's coordinates a resting body does not move while the background does.  The object that is still in the first
part of the clip and gone in the rest is the body; its picture at rest is then registered to every frame.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt
import pandas as pd

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.lab.camera import STATED_SIGMA, Point, Seed
from rigtwin.measure.geometry.disc_morphology import odd, opened
from rigtwin.measure.robust import MAD_TO_STD, mad_std
from rigtwin.measure.tilt.plate_angle import Arm

SATURATED = 225.0  # [grey levels], lower limit of the level that counts as saturated
GLARE_SIZE = 0.012  # minimum size of the reflection of a lamp over the longer side of the picture
LEAST_SEEN = 0.35  # minimum mean weight of the body's pixels, which drops with occlusion
STRONG = 0.3  # minimum contrast of a body's pixels over that of the body
PART = 0.2  # minimum area of a part of a body over that of the largest part
LEFT = 3.0  # minimum change at a place of the scene that a body left, in standard deviations of the noise
WINDOW = 7  # [px], over which the change at a place of the scene is averaged: single pixels agree by chance
NEAR = 12.0  # [px], distance from the stated place of a body within which it is found, if the body is not longer
ALIKE = 0.5  # minimum correlation with the picture at rest
FEWEST = 3  # minimum sample frames of a resting or an arriving body: with two, a moving object would pass too
COMES = 0.7  # minimum correlation of an object elsewhere on the plate with a resting body: half the variance
CONTRAST = 0.5  # minimum contrast of that object over that of the body
STEADILY = 0.8  # minimum net displacement down the plate over the path length of an arriving body


@dataclass(frozen=True)
class RestingBody:
    """A body at rest on the arm, in the arm's coordinates."""

    left: int  # first column of its picture in `arm.along`
    top: int  # first row in `arm.across`
    picture: FloatImage = field(repr=False)  # [grey levels]
    weight: FloatImage = field(repr=False)  # 1 / variance on the body, 0 elsewhere
    centre: tuple[float, float]  # [px], along and across
    size: tuple[float, float]  # [px], along and across
    rests: tuple[int, ...]  # sample frames in which it is taken to be at rest, ascending

    def at(self, step: Step) -> Point:
        """Its centre [px] along and across the arm, displaced by `step`."""
        return self.centre[0] + step.along, self.centre[1] + step.across

    def stated(self, at: Point) -> Step:
        """Its displacement to a centre [px] along and across the arm that the user states."""
        return Step(at[0] - self.centre[0], at[1] - self.centre[1], STATED_SIGMA, 1.0)


@dataclass(frozen=True)
class Arrival:
    """A body that comes down the plate, but is not seen at rest before."""

    frame: int  # sample frame in which it has reached its final position


@dataclass(frozen=True)
class Step:
    """Displacement of the body in one frame from its position at rest."""

    along: float  # [px]
    across: float  # [px]
    sigma: float  # [px]
    likeness: float  # correlation with its picture at rest


def glare(pictures: Sequence[FloatImage]) -> npt.NDArray[np.bool_]:
    """Mask of reflections of lamps, which are white in all pictures but one at most; highlights on beads are smaller.

    In one picture something may pass in front of a reflection.  A white body is none if it is absent from two pictures.
    """
    size = max(5, odd(GLARE_SIZE * max(pictures[0].shape)))
    # noise makes each pixel darker in some picture
    smooth = np.stack([cv2.GaussianBlur(picture, (0, 0), size / 4) for picture in pictures])
    second = min(1, len(smooth) - 1)
    picture = np.partition(smooth, second, axis=0)[second]  # the second darkest level of each pixel
    # white is often at 235 in video
    white = max(float(picture.max()) - 3, SATURATED)
    patch = opened((picture >= white).astype(np.uint8), size)
    return np.asarray(cv2.dilate(patch, np.ones((3 * size, 3 * size), np.uint8)) > 0)


def find_body(
    arm: Arm,
    frames: dict[int, FloatImage],
    uphill: int,
    hidden: npt.NDArray[np.bool_] | None = None,
    seed: Seed | None = None,
) -> RestingBody | Arrival | None:
    """The body that rests in the first sample frames and is gone in the last ones; None if there is none.

    An `Arrival` if nothing leaves its position, but a body comes to one.

    `uphill` is +1 if the arm rises to the right; `hidden` marks pixels of the scene in which the arm is occluded.
    `seed` states where the body rests.
    """
    numbers = sorted(arm.directions)
    upper = min(edge.row for edge in arm.edges)
    lower = max(edge.row for edge in arm.edges)
    rows = np.flatnonzero(arm.across <= lower + 2)
    columns = np.flatnonzero((arm.along >= arm.span[0] - 4) & (arm.along <= arm.span[1] + 4))
    stack = np.stack(
        [arm.cut(frames[n], arm.directions[n], arm.along[columns], arm.across[rows]) for n in numbers]
    ).astype(np.float32)
    stack = np.stack([cv2.GaussianBlur(cut, (0, 0), 1.0) for cut in stack])
    covered = None
    if hidden is not None and hidden.any():
        # in the arm's coordinates a patch fixed in the scene moves like a body
        parts = [
            arm.cut(hidden.astype(np.float32), arm.directions[n], arm.along[columns], arm.across[rows]) for n in numbers
        ]
        covered = np.stack(parts) > 0.01
        stack = _uncovered(stack, covered)
    noise = _grain(stack)
    surface = float(upper - arm.across[rows[0]])
    changed = _changed_in_scene(arm, frames, numbers, rows, columns, covered)
    gone = [blob for split in range(FEWEST, len(numbers)) for blob in _gone(stack, changed, split, noise, surface)]
    if seed is not None:
        along, _ = arm.place(seed.at, seed.frame)
        gone = [blob for blob in gone if abs(arm.along[columns[0]] + blob.along - along) < max(blob.length, NEAR)]
    if not gone:
        return None
    # the body leaves one position and arrives at a lower one: the uppermost clear one is its rest position
    clearest = max(blob.merit for blob in gone)
    clear = [blob for blob in gone if blob.merit > 0.25 * clearest]
    if seed is not None:
        return _rests(arm, frames, stack, max(clear, key=lambda blob: blob.merit), (int(rows[0]), int(columns[0])))
    # what is seen lower on the plate afterwards is the body; a fast one may be gone from one sample to the next
    times = [_times_seen_lower(stack, blob, uphill) for blob in clear]
    clear = [blob for blob, seen in zip(clear, times, strict=True) if seen >= max(times) / 2]
    highest = max(clear, key=lambda blob: uphill * blob.along)
    there = [blob for blob in clear if abs(blob.along - highest.along) < 0.6 * highest.length]
    best = max(there, key=lambda blob: blob.merit)
    if _arrives(stack, best, uphill):
        return Arrival(numbers[best.split])
    return _rests(arm, frames, stack, best, (int(rows[0]), int(columns[0])))


def _rests(
    arm: Arm, frames: dict[int, FloatImage], stack: npt.NDArray[np.float32], place: _Gone, corner: tuple[int, int]
) -> RestingBody:
    """The body that leaves a place; `corner` is the first row and column of the stack in the arm's coordinates."""
    contrast = np.abs(np.median(stack[: place.split], axis=0) - np.median(stack[place.split :], axis=0))
    return _portrait(arm, frames, sorted(frames)[: place.split], _outline(place.mask, contrast), corner)


@dataclass(frozen=True)
class _Gone:
    """A position that an object left between two sample frames."""

    merit: float  # sum of the score over the mask
    along: float  # [px]
    length: float  # [px]
    split: int  # number of sample frames before it left
    mask: npt.NDArray[np.bool_] = field(repr=False)


def _uncovered(stack: npt.NDArray[np.float32], covered: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Fill covered pixels from the nearest frame in which they are visible; constant if there is none."""
    filled = stack.copy()
    never = covered.all(axis=0)
    filled[:, never] = stack[0, never]
    for k in range(len(stack)):
        missing = covered[k].copy()
        for other in sorted(range(len(stack)), key=lambda one: abs(one - k)):
            take = missing & ~covered[other]
            filled[k][take] = stack[other][take]
            missing &= ~take
            if not missing.any():
                break
    return filled


def _changed_in_scene(
    arm: Arm,
    frames: Mapping[int, FloatImage],
    numbers: Sequence[int],
    rows: npt.NDArray[np.int64],
    columns: npt.NDArray[np.int64],
    covered: npt.NDArray[np.bool_] | None,
) -> npt.NDArray[np.float32]:
    """Change [grey levels] of each cut to the later frames at the same places of the scene; shape (n, n, ...).

    It is the distance from the range of the later frame within a pixel, averaged over a window.  What belongs to the
    background is still there when the plate has turned on, what left the plate is not.  NaN where the later frame is
    not later or shows the plate itself at that place, and where something in front `covered` the arm, shape (n, ...).
    """
    smooth = {n: np.asarray(cv2.GaussianBlur(frames[n], (0, 0), 1.0), dtype=np.float32) for n in numbers}
    along, across = np.meshgrid(arm.along[columns], arm.across[rows])
    upper = min(edge.row for edge in arm.edges)
    answer = np.full((len(numbers), len(numbers), *along.shape), np.nan, dtype=np.float32)
    around = np.ones((3, 3), np.uint8)
    for k, n in enumerate(numbers):
        here = arm.cut(smooth[n], arm.directions[n], arm.along[columns], arm.across[rows])
        for m in range(k + 1, len(numbers)):
            turn = arm.directions[n] - arm.directions[numbers[m]]
            # average and range take in no plate
            above = along * math.sin(turn) + across * math.cos(turn) < upper - 2 - WINDOW // 2
            seen = arm.cut(smooth[numbers[m]], arm.directions[n], arm.along[columns], arm.across[rows])
            # edges of the background are met to a pixel
            low, high = cv2.erode(seen, around), cv2.dilate(seen, around)
            change = cv2.blur(np.maximum(np.maximum(low - here, here - high), 0), (WINDOW, WINDOW))
            answer[k, m] = np.where(above if covered is None else above & ~covered[k], change, np.nan)
    return answer


def _grain(stack: npt.NDArray[np.float32]) -> float:
    return mad_std(np.diff(stack, axis=0), centre=0.0) / math.sqrt(2) + 0.3


def _gone(
    stack: npt.NDArray[np.float32], changed: npt.NDArray[np.float32], split: int, noise: float, surface: float
) -> list[_Gone]:
    """Objects that are still before `split` and absent after it, on the plate and at their place in the scene.

    `surface` is the row of the plate's upper edge; `changed` is that of `_changed_in_scene`.
    """
    before, after = stack[:split], stack[split:]
    rest, later = np.median(before, axis=0), np.median(after, axis=0)
    flicker = MAD_TO_STD * np.median(np.abs(before - rest), axis=0)
    worst = np.abs(before - rest).max(axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # places that the plate covers from then on
        left = np.nanmedian(np.nanmin(changed[:split, split:], axis=1), axis=0)
    # these lie right above the plate: what holds above them holds for them
    left = pd.DataFrame(left).ffill().fillna(math.inf).to_numpy()
    score = np.where(left > LEFT * noise, np.abs(rest - later) - 3 * flicker - 0.5 * worst, 0.0)
    mask = cv2.morphologyEx((score > 4 * noise).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    joined = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 9), np.uint8))
    count, labels, stats, centres = cv2.connectedComponentsWithStats(joined, connectivity=8)
    found = []
    for k in range(1, count):
        _, top, width, height, area = (int(value) for value in stats[k])
        if area >= 20 and top + height > surface - max(4, height / 2) and top < surface - 2:
            inside = labels == k
            merit = float(np.sum(np.clip(score[inside], 0, 60)))
            found.append(_Gone(merit, float(centres[k][0]), float(width), split, inside))
    return found


def _arrives(stack: npt.NDArray[np.float32], place: _Gone, uphill: int) -> bool:
    """Whether a position shows the bare plate first, until a body comes down to it.

    The change at the position is then the body that lies there later, and earlier frames show the same body further up
    the plate, lower from one to the next.  If a body leaves the position, nothing moves above it.
    """
    heights = _seen_beside(stack[: place.split], stack[place.split :], place, uphill)
    steps = np.diff(heights)
    down = -float(steps.sum())
    return len(heights) >= FEWEST and down > place.length / 4 and down > STEADILY * float(np.abs(steps).sum())


def _times_seen_lower(stack: npt.NDArray[np.float32], place: _Gone, uphill: int) -> int:
    """Number of later frames that show what left a position further down the plate."""
    return len(_seen_beside(stack[place.split :], stack[: place.split], place, -uphill))


def _seen_beside(
    frames: npt.NDArray[np.float32], with_body: npt.NDArray[np.float32], place: _Gone, side: int
) -> list[int]:
    """Distances along the plate [px] at which `frames` show the body that lies at `place` in `with_body`.

    On one side of the place (1: increasing columns); frames that do not show it there are left out.
    """
    y, x = np.nonzero(place.mask)
    rows, columns = slice(int(y.min()), int(y.max()) + 1), slice(int(x.min()), int(x.max()) + 1)
    bare = np.median(frames, axis=0)
    body = (np.median(with_body, axis=0) - bare)[rows, columns]
    beside = slice(columns.stop, None) if side > 0 else slice(0, columns.start)
    moving = (frames - bare)[:, rows, beside]
    if moving.shape[2] <= body.shape[1]:
        return []
    found = []
    for frame in moving:
        likeness = cv2.matchTemplate(frame, body, cv2.TM_CCOEFF_NORMED)[0]
        at = int(np.argmax(likeness))
        # faint patterns of the background are alike by chance
        clear = np.std(frame[:, at : at + body.shape[1]]) > CONTRAST * np.std(body)
        if likeness[at] > COMES and clear:
            found.append(side * at)
    return found


def _outline(mask: npt.NDArray[np.bool_], contrast: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Convex hull of the parts with strong contrast; a textured background that turns leaves weaker ones."""
    strong = mask & (contrast > STRONG * np.percentile(contrast[mask], 95))
    closed = cv2.morphologyEx(strong.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    parts = 1 + np.flatnonzero(areas > PART * areas.max())
    y, x = np.nonzero(np.isin(labels, parts))
    hull = cv2.convexHull(np.column_stack([x, y]).astype(np.int32))
    return np.asarray(cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), hull, 1) > 0)


def _portrait(
    arm: Arm,
    frames: dict[int, FloatImage],
    numbers: Sequence[int],
    mask: npt.NDArray[np.bool_],
    corner: tuple[int, int],
) -> RestingBody:
    y, x = np.nonzero(mask)
    margin = 5
    height, width = mask.shape
    left, right = max(int(x.min()) - margin, 0), min(int(x.max()) + margin + 1, width)
    top, bottom = max(int(y.min()) - margin, 0), min(int(y.max()) + margin + 1, height)
    rows = arm.across[corner[0] + top : corner[0] + bottom]
    columns = arm.along[corner[1] + left : corner[1] + right]
    cuts = np.stack([arm.cut(frames[n], arm.directions[n], columns, rows) for n in numbers])
    picture = np.median(cuts, axis=0).astype(np.float32)
    flicker = np.median(np.abs(cuts - picture), axis=0) * MAD_TO_STD
    usual = float(np.median(flicker)) + 0.5
    near = cv2.dilate(mask[top:bottom, left:right].astype(np.uint8), np.ones((5, 5), np.uint8))
    weight = near / (usual**2 + cv2.blur(flicker.astype(np.float32), (3, 3)) ** 2)
    return RestingBody(
        corner[1] + left,
        corner[0] + top,
        picture,
        weight.astype(np.float32),
        (float(arm.along[corner[1]] + x.mean()), float(arm.across[corner[0]] + y.mean())),
        (float(x.max() - x.min() + 1), float(y.max() - y.min() + 1)),
        tuple(numbers),
    )


def follow(
    arm: Arm, body: RestingBody, frame: FloatImage, direction: float, near: Sequence[float], reach: float
) -> Step | None:
    """Locate the body in one steady frame, near its expected displacement `near` (along, across) within `reach` [px].

    None if no match is found there.
    """
    place = np.array(near, dtype=np.float64)
    if reach > 1.5:
        found = _searched(arm, body, frame, direction, place, reach)
        if found is None:
            return None
        place = found
    return _laid(arm, body, frame, direction, place)


def _window(arm: Arm, body: RestingBody, place: Array, margin: int = 0) -> tuple[Array, Array]:
    height, width = body.picture.shape
    first = arm.along[0] + body.left + place[0] - margin
    upper = arm.across[0] + body.top + place[1] - margin
    return first + np.arange(width + 2 * margin), upper + np.arange(height + 2 * margin)


def _searched(
    arm: Arm, body: RestingBody, frame: FloatImage, direction: float, place: Array, reach: float
) -> Array | None:
    """Position of the best correlation, to a whole pixel."""
    margin = math.ceil(reach) + 1
    along, across = _window(arm, body, place, margin)
    keep = slice(max(margin - 3, 0), len(across) - max(margin - 3, 0))  # the body stays on the plate
    region = arm.cut(frame, direction, along, across[keep])
    mask = (body.weight > 0).astype(np.float32)
    if np.ptp(region) < 1:
        return None
    scores: FloatImage = np.array(cv2.matchTemplate(region, body.picture, cv2.TM_CCOEFF_NORMED, mask=mask), np.float32)
    scores[~np.isfinite(scores)] = -1.0
    down, right = divmod(int(np.argmax(scores)), scores.shape[1])
    if float(np.max(scores)) < 0.8 * ALIKE:
        return None
    return place + np.array([right - margin, down - min(margin, 3)], dtype=np.float64)


def _laid(arm: Arm, body: RestingBody, frame: FloatImage, direction: float, place: Array) -> Step | None:
    """Sub-pixel registration: Gauss-Newton on the pixels of the body, with robust weights against occlusion."""
    model = body.picture.astype(np.float64)
    base = body.weight.astype(np.float64)
    known = base > 0
    slope_y = np.asarray(np.gradient(model, axis=0), dtype=np.float64)
    slope_x = np.asarray(np.gradient(model, axis=1), dtype=np.float64)
    sigma, likeness = math.inf, 0.0
    start = place.copy()
    for _ in range(6):
        along, across = _window(arm, body, place)
        seen = arm.cut(frame, direction, along, across).astype(np.float64)
        columns = np.stack([slope_x[known], slope_y[known], model[known], np.ones(int(known.sum()))], axis=1)
        usual = np.ones(len(columns))
        values = seen[known]
        answer = np.array([0.0, 0.0, 1.0, 0.0])
        for _ in range(4):
            w = base[known] * usual
            normal = (columns * w[:, None]).T @ columns + 1e-9 * np.eye(4)
            answer = np.linalg.solve(normal, columns.T @ (w * values))
            miss = values - columns @ answer
            spread = max(mad_std(miss, centre=0.0), 0.7)
            usual = 1 / (1 + (miss / (3 * spread)) ** 2) ** 2
        gain = answer[2] if abs(answer[2]) > 0.15 else 0.15
        # the frame shows the model moved by m: values = gain * (model - slope * m)
        change = np.clip(-answer[:2] / gain, -1.5, 1.5)
        place = place + change
        w = base[known] * usual
        inverse = np.linalg.inv((columns * w[:, None]).T @ columns + 1e-9 * np.eye(4))
        scatter = inverse @ ((columns * (w**2 * spread**2)[:, None]).T @ columns) @ inverse
        # factor 2: compression correlates neighbouring pixels
        sigma = 2 * math.sqrt(max(float(scatter[0, 0]), 1e-8)) / abs(gain)
        likeness = _likeness(values, model[known], w)
        if float(usual.mean()) < LEAST_SEEN or answer[2] < 0.15:
            return None
        if float(np.max(np.abs(change))) < 0.004:
            break
    if likeness < ALIKE or float(np.hypot(*(place - start))) > 4:
        return None
    return Step(float(place[0]), float(place[1]), max(sigma, 0.01), likeness)


def _likeness(one: Array, other: Array, weight: Array) -> float:
    total = weight.sum()
    a, b = one - weight @ one / total, other - weight @ other / total
    return float(weight @ (a * b) / math.sqrt(float((weight @ (a * a)) * (weight @ (b * b))) + 1e-12))
