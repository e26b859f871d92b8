"""Find what rests on a turning arm and later runs down it, and follow it along the arm to a part of a pixel.

Seen in the arm's own coordinates a resting body stands still while all behind it moves.  What stood still in the first
part of the clip and is gone in the rest is the body; its picture at rest is then laid over every frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage
from rigtwin.measure.tilt.plate_angle import Arm

SATURATED = 225.0  # [grey levels], least of what may be
GLARE_SIZE = 0.012  # of the picture's longer side, of a saturated patch that is a lamp's
LEAST_SEEN = 0.35  # share of the body's picture that must not be hidden
STRONG = 0.3  # of a body's contrast, that its pixels have at least
PART = 0.2  # of the largest part of a body, that another one is at least
ALIKE = 0.5  # correlation below which what is found is not the body
FEWEST = 3  # sample frames of a body at rest, and of one that comes: two would make a picture of what moves as well
COMES = 0.7  # correlation from which on what is seen up the plate is what later lies lower down: over half its variance
STEADILY = 0.8  # of the way it is seen to go, that a body must come down the plate


@dataclass(frozen=True)
class Passenger:
    """A body at rest on the arm, in the arm's coordinates."""

    left: int  # first column of its picture in `arm.along`
    top: int  # first row in `arm.across`
    picture: FloatImage = field(repr=False)  # [grey levels]
    weight: FloatImage = field(repr=False)  # 1 / variance on the body, 0 elsewhere
    centre: tuple[float, float]  # [px], along and across
    size: tuple[float, float]  # [px], along and across
    rests: tuple[int, ...]  # sample frames in which it is taken to be at rest, rising


@dataclass(frozen=True)
class Arrival:
    """A body that is seen to come down the plate, but at no place to rest before."""

    frame: int  # sample frame in which it has come to the place where it stays


@dataclass(frozen=True)
class Step:
    """Where the body is in one frame, against its place at rest."""

    along: float  # [px]
    across: float  # [px]
    sigma: float  # [px]
    likeness: float  # correlation with its picture at rest


def glare(picture: FloatImage) -> npt.NDArray[np.bool_]:
    """Where lamps are mirrored for all of the clip; highlights on beads are smaller."""
    size = max(5, round(GLARE_SIZE * max(picture.shape)) | 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    # a film's brightness often ends at 235
    white = max(float(picture.max()) - 3, SATURATED)
    patch = cv2.morphologyEx((picture >= white).astype(np.uint8), cv2.MORPH_OPEN, kernel)
    return np.asarray(cv2.dilate(patch, np.ones((3 * size, 3 * size), np.uint8)) > 0)


def find_passenger(
    arm: Arm, frames: dict[int, FloatImage], uphill: int, hidden: npt.NDArray[np.bool_] | None = None
) -> Passenger | Arrival | None:
    """The body that rests in the first and is gone in the last of the sample frames; None when there is none.

    An `Arrival` where nothing leaves a place, but a body comes to one.

    `uphill` is +1 where the arm rises to the right; `hidden` marks pixels of the still scene that show nothing of it.
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
    if hidden is not None and hidden.any():
        # in the arm's own picture a patch fixed in the scene wanders like a body
        covered = np.stack(
            [
                arm.cut(hidden.astype(np.float32), arm.directions[n], arm.along[columns], arm.across[rows])
                for n in numbers
            ]
        )
        stack = _uncovered(stack, covered > 0.01)
    noise = _grain(stack)
    surface = float(upper - arm.across[rows[0]])
    gone = [blob for split in range(FEWEST, len(numbers)) for blob in _gone(stack, split, noise, surface)]
    if not gone:
        return None
    # the body leaves one place and arrives at another, lower one: the uppermost clear place is where it stood
    clearest = max(blob.merit for blob in gone)
    clear = [blob for blob in gone if blob.merit > 0.25 * clearest]
    highest = max(clear, key=lambda blob: uphill * blob.along)
    there = [blob for blob in clear if abs(blob.along - highest.along) < 0.6 * highest.length]
    best = max(there, key=lambda blob: blob.merit)
    if _arrives(stack, best, uphill):
        return Arrival(numbers[best.split])
    contrast = np.abs(np.median(stack[: best.split], axis=0) - np.median(stack[best.split :], axis=0))
    outline = _outline(best.mask, contrast)
    return _portrait(arm, frames, numbers[: best.split], outline, (int(rows[0]), int(columns[0])))


@dataclass(frozen=True)
class _Gone:
    """A place that something left between two sample frames."""

    merit: float  # how clearly
    along: float  # [px]
    length: float  # [px]
    split: int  # number of sample frames before it left
    mask: npt.NDArray[np.bool_] = field(repr=False)


def _uncovered(stack: npt.NDArray[np.float32], covered: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """What is covered in a frame as it is in the nearest frame in which it is not; where there is none, still."""
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


def _grain(stack: npt.NDArray[np.float32]) -> float:
    step = np.abs(np.diff(stack, axis=0))
    return 1.4826 * float(np.median(step)) / math.sqrt(2) + 0.3


def _gone(stack: npt.NDArray[np.float32], split: int, noise: float, surface: float) -> list[_Gone]:
    """What stood still before `split` and is not there after it; `surface` is the row of the plate's upper edge."""
    before, after = stack[:split], stack[split:]
    rest, later = np.median(before, axis=0), np.median(after, axis=0)
    flicker = 1.4826 * np.median(np.abs(before - rest), axis=0)
    worst = np.abs(before - rest).max(axis=0)
    score = np.abs(rest - later) - 3 * flicker - 0.5 * worst
    mask = (score > 4 * noise).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    joined = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 9), np.uint8))
    count, labels, stats, centres = cv2.connectedComponentsWithStats(joined, connectivity=8)
    found = []
    for k in range(1, count):
        _, top, width, height, area = (int(value) for value in stats[k])
        if area >= 20 and top + height > surface - 4 and top < surface - 2:
            inside = labels == k
            merit = float(np.sum(np.clip(score[inside], 0, 60)))
            found.append(_Gone(merit, float(centres[k][0]), float(width), split, inside))
    return found


def _arrives(stack: npt.NDArray[np.float32], place: _Gone, uphill: int) -> bool:
    """Whether it is the bare plate that rests at a place first, until a body comes down to it.

    What changes at the place is then the body that lies there later, and the frames before show just that up the plate,
    lower from one to the next.  Where a body leaves a place there is nothing above it that moves.
    """
    y, x = np.nonzero(place.mask)
    rows, columns = slice(int(y.min()), int(y.max()) + 1), slice(int(x.min()), int(x.max()) + 1)
    early = stack[: place.split]
    body = (np.median(stack[place.split :], axis=0) - np.median(early, axis=0))[rows, columns]
    above = slice(columns.stop, None) if uphill > 0 else slice(0, columns.start)
    moving = (early - np.median(early, axis=0))[:, rows, above]
    if moving.shape[2] <= body.shape[1]:
        return False
    heights = []
    for frame in moving:
        likeness = cv2.matchTemplate(frame, body, cv2.TM_CCOEFF_NORMED)[0]
        if float(likeness.max()) > COMES:
            heights.append(uphill * int(np.argmax(likeness)))
    steps = np.diff(heights)
    down = -float(steps.sum())
    return len(heights) >= FEWEST and down > place.length / 4 and down > STEADILY * float(np.abs(steps).sum())


def _outline(mask: npt.NDArray[np.bool_], contrast: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """What is hulled by the strong parts of a place: a mottled background that turns behind it leaves weaker ones."""
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
) -> Passenger:
    y, x = np.nonzero(mask)
    margin = 5
    height, width = mask.shape
    left, right = max(int(x.min()) - margin, 0), min(int(x.max()) + margin + 1, width)
    top, bottom = max(int(y.min()) - margin, 0), min(int(y.max()) + margin + 1, height)
    rows = arm.across[corner[0] + top : corner[0] + bottom]
    columns = arm.along[corner[1] + left : corner[1] + right]
    cuts = np.stack([arm.cut(frames[n], arm.directions[n], columns, rows) for n in numbers])
    picture = np.median(cuts, axis=0).astype(np.float32)
    flicker = np.median(np.abs(cuts - picture), axis=0) * 1.4826
    usual = float(np.median(flicker)) + 0.5
    near = cv2.dilate(mask[top:bottom, left:right].astype(np.uint8), np.ones((5, 5), np.uint8))
    weight = near / (usual**2 + cv2.blur(flicker.astype(np.float32), (3, 3)) ** 2)
    return Passenger(
        corner[1] + left,
        corner[0] + top,
        picture,
        weight.astype(np.float32),
        (float(arm.along[corner[1]] + x.mean()), float(arm.across[corner[0]] + y.mean())),
        (float(x.max() - x.min() + 1), float(y.max() - y.min() + 1)),
        tuple(numbers),
    )


def follow(
    arm: Arm, body: Passenger, frame: FloatImage, direction: float, near: Sequence[float], reach: float
) -> Step | None:
    """The body in one steady frame; `near` is where it is expected (along, across) and `reach` how far off [px].

    None when what is found there is not like the body.
    """
    place = np.array(near, dtype=np.float64)
    if reach > 1.5:
        found = _searched(arm, body, frame, direction, place, reach)
        if found is None:
            return None
        place = found
    return _laid(arm, body, frame, direction, place)


def _window(arm: Arm, body: Passenger, place: Array, margin: int = 0) -> tuple[Array, Array]:
    height, width = body.picture.shape
    first = arm.along[0] + body.left + place[0] - margin
    upper = arm.across[0] + body.top + place[1] - margin
    return first + np.arange(width + 2 * margin), upper + np.arange(height + 2 * margin)


def _searched(
    arm: Arm, body: Passenger, frame: FloatImage, direction: float, place: Array, reach: float
) -> Array | None:
    """The place of the best likeness to the whole pixel."""
    margin = math.ceil(reach) + 1
    along, across = _window(arm, body, place, margin)
    keep = slice(max(margin - 3, 0), len(across) - max(margin - 3, 0))  # it cannot leave the plate
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


def _laid(arm: Arm, body: Passenger, frame: FloatImage, direction: float, place: Array) -> Step | None:
    """Gauss-Newton on the pixels of the body; what hides a part of it counts little."""
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
            spread = max(1.4826 * float(np.median(np.abs(miss))), 0.7)
            usual = 1 / (1 + (miss / (3 * spread)) ** 2) ** 2
        gain = answer[2] if abs(answer[2]) > 0.15 else 0.15
        # the frame shows the model moved by m: values = gain * (model - slope * m)
        change = np.clip(-answer[:2] / gain, -1.5, 1.5)
        place = place + change
        w = base[known] * usual
        inverse = np.linalg.inv((columns * w[:, None]).T @ columns + 1e-9 * np.eye(4))
        scatter = inverse @ ((columns * (w**2 * spread**2)[:, None]).T @ columns) @ inverse
        # compression ties neighbouring pixels together
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
