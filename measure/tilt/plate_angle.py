"""Find a straight arm that turns about a hinge in a video of a still scene, and its angle in every frame.

The arm appears as long straight edges that turn together, for any colour.  Moving edges are collected in a few frames
spread over the clip (Hough transform with gradient direction), and one hinge is found for all of them.  Turned back
about this hinge, the frames give a still picture of the arm.  Every frame is then registered to that picture with one
common turn, and a separate shift of each edge, because edges at different depths shift differently.

Picture coordinates: x right, y down.  An arm's direction is the angle [rad] of its line in the picture, positive if it
falls to the right.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array, FloatImage, GreyImage, Mask
from rigtwin.lab.camera import STATED_SIGMA, Line, Point
from rigtwin.measure.geometry.lines import fullest_run, gradient, straight
from rigtwin.measure.robust import MAD_TO_STD, mad_std
from rigtwin.measure.tilt.onset import LEAST_TURN

STEEPEST = math.radians(65)  # largest slope of an arm
TURN_STEP = math.radians(0.25)  # angular step of the search
SHORTEST = 0.12  # minimum length of an edge over the width of the picture
# longest gap in an edge of the plate, over the width of the picture, where the background has the plate's grey level
# (four of 40 films of tilts by VTK are refused without it), and the usual one; least share of the columns between its
# ends in which the edge is seen, assumed
LONGEST_GAP, USUAL_GAP, LEAST_SEEN = 0.25, 0.083, 0.4
STATED_REACH = 4 * STATED_SIGMA  # [px], distance of an edge from the stated surface of the plate
STATED_TURN = math.radians(1.5)  # largest angle of the plate against its stated surface in the first sample frame
REACH = 4  # [px], rows on each side of an edge that are compared
PARALLEL = math.radians(0.35)  # largest angle between edges of the arm
# slope of the edge in a pixel of the arm's picture beyond which it belongs to no edge of the arm: what stands still in
# the scene turns there by at least half of the arm's turn
ASLANT = math.tan(math.radians(6))
IN_LINE = 1.0  # [px], across the arm, between rises and falls of one edge; borders of a plate are 3 px apart or more
NOT_PARALLEL = math.radians(0.025)  # standard deviation of the angle between edges of an arm


@dataclass(frozen=True)
class Edge:
    """A straight edge of the arm, in the arm's own coordinates."""

    row: float  # [px], across the arm, positive towards the picture's bottom
    start: int  # first column along the arm
    end: int  # last column
    slope: float  # [rad], relative to the arm's coordinates
    strength: float  # [grey/px]


@dataclass(frozen=True)
class Arm:
    """Picture of the arm, turned back about the pivot, with its edges."""

    pivot: tuple[float, float]  # [px], in the still scene
    along: Array  # [px], distance from the pivot of every column, signed as x
    across: Array  # [px], of every row, positive down
    picture: FloatImage = field(repr=False)  # [grey levels], shape (rows, columns)
    edges: tuple[Edge, ...]
    span: tuple[float, float]  # [px], along the arm: begin and end of its edges
    directions: dict[int, float]  # [rad], of the sample frames, from the search

    def cut(self, frame: FloatImage | GreyImage, direction: float, along: Array, across: Array) -> FloatImage:
        """The pixels of a steady frame in the arm's coordinates, shape (rows, columns)."""
        return turned_back(frame, self.pivot, direction, along, across)

    def place(self, at: Point, frame: int) -> Point:
        """A place of the picture [px] in a sample frame or between two of them, along and across the arm."""
        numbers = sorted(self.directions)
        direction = float(np.interp(frame, numbers, [self.directions[n] for n in numbers]))
        return in_arm(at, self.pivot, direction)

    def in_picture(self, at: Point, direction: float) -> Point:
        """A place along and across the arm [px] in the still scene, where the arm has this direction [rad]."""
        cos, sin = math.cos(direction), math.sin(direction)
        x, y = at[0] * cos - at[1] * sin, at[0] * sin + at[1] * cos
        return float(self.pivot[0] + x), float(self.pivot[1] + y)

    @property
    def tilt(self) -> float:
        """Slope of the edges in the arm's coordinates [rad]: the arm's direction at turn zero."""
        weight = np.array([edge.strength**2 * (edge.end - edge.start) ** 3 for edge in self.edges])
        return float(weight @ np.array([edge.slope for edge in self.edges]) / weight.sum())

    @property
    def tilt_sigma(self) -> float:
        """Standard uncertainty of `tilt` [rad] from the scatter between edges (perspective, edges not parallel)."""
        slopes = np.array([edge.slope for edge in self.edges])
        weight = np.array([edge.strength**2 * (edge.end - edge.start) ** 3 for edge in self.edges])
        spread = math.sqrt(float(weight @ (slopes - self.tilt) ** 2 / weight.sum()))
        return spread / math.sqrt(max(len(slopes) - 1, 1))

    @property
    def converging(self) -> tuple[float, float] | None:
        """Change of the edges' slope per row [rad/px] (oblique view) and its standard uncertainty; None if unknown."""
        rows = np.array([edge.row for edge in self.edges])
        if len(rows) < 3 or np.ptp(rows) < 8:
            return None
        slopes = np.array([edge.slope for edge in self.edges])
        weight = np.array([edge.strength * (edge.end - edge.start) for edge in self.edges])
        middle = weight @ rows / weight.sum()
        moment = float(weight @ (rows - middle) ** 2 / weight.sum())
        change = float(weight @ ((rows - middle) * slopes) / weight.sum()) / moment
        # objects on the plate and marks on it have edges of other slopes
        off = slopes - weight @ slopes / weight.sum() - change * (rows - middle)
        scatter = math.sqrt(float(weight @ off**2 / weight.sum()) * len(rows) / (len(rows) - 2))
        return change, math.hypot(NOT_PARALLEL, scatter) / math.sqrt(moment * len(rows))


@dataclass(frozen=True)
class Turn:
    """Direction of the arm in one frame."""

    direction: float  # [rad]
    sigma: float  # [rad]
    shift: float  # [px], across the arm, mean of its edges


def turned_back(
    frame: FloatImage | GreyImage, pivot: tuple[float, float], direction: float, along: Array, across: Array
) -> FloatImage:
    """Pixels at `along` x `across` in coordinates turned by `direction` about `pivot`, shape (rows, columns)."""
    cos, sin = math.cos(direction), math.sin(direction)
    x = pivot[0] + along[None, :] * cos - across[:, None] * sin
    y = pivot[1] + along[None, :] * sin + across[:, None] * cos
    return np.asarray(
        cv2.remap(frame, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        dtype=np.float32,
    )


def find_arm(frames: dict[int, FloatImage], plate: Line | None = None) -> Arm | None:
    """Find the arm in steady sample frames by frame number; None if nothing straight turns.

    `plate` are the stated ends of the plate's surface in the first frame [px]; None: the plate is searched.
    """
    numbers = sorted(frames)
    pictures = [frames[number] for number in numbers]
    moving = [_moving_edges(pictures, k) for k in range(len(pictures))]
    height, width = pictures[0].shape
    votes = [_votes(x, y, slope, weight, width, height) for x, y, slope, weight in moving]
    if plate is not None:
        votes[0] = _votes_of_line(votes[0], plate, width, height)
    path = _direction_path(np.array([_evidence(vote) for vote in votes]), None if plate is None else _slope_of(plate))
    directions = _GRID[path]
    if float(np.ptp(directions)) < LEAST_TURN:
        return None
    pivot = _pivot(votes, path, width, height)
    if pivot is None:
        return None
    turned = dict(zip(numbers, directions.tolist(), strict=True))
    arm = _picture_of(turned, pivot, frames, plate, _swept(pictures))
    if arm is not None:
        laid = [lay_over(arm, frames[number], arm.directions[number]) for number in numbers]
        seen = [turn.direction for turn in laid if turn is not None]
        if len(seen) > len(numbers) / 2 and float(np.ptp(seen)) >= LEAST_TURN:
            return arm
    # what moves may be the body alone, on a plate at rest
    return _picture_of(turned, pivot, frames, plate)


def arm_at_rest(frames: dict[int, FloatImage], plate: Line) -> Arm | None:
    """The plate along a line [px] in sample frames in which it does not turn; None if no edge lies there."""
    left, right = sorted(plate)
    directions = dict.fromkeys(sorted(frames), _slope_of((left, right)))
    return _picture_of(directions, left, frames, (left, right))


def _slope_of(plate: Line) -> float:
    """Direction [rad] of a stated line, positive if it falls to the right."""
    return math.atan2(plate[1][1] - plate[0][1], plate[1][0] - plate[0][0])


def _votes_of_line(votes: Array, plate: Line, width: int, height: int) -> Array:
    """The votes for lines near a stated one."""
    reach = (votes.shape[1] - 1) // 2
    x, y = (sum(end[k] for end in plate) / 2 for k in (0, 1))
    distance = -(x - width / 2) * np.sin(_GRID) + (y - height / 2) * np.cos(_GRID) + reach
    off = np.abs(np.arange(votes.shape[1])[None, :] - distance[:, None])
    turned = np.abs(_GRID - _slope_of(plate))[:, None]
    return np.where((off <= STATED_REACH) & (turned <= STATED_TURN), votes, 0.0)


_GRID = np.arange(-STEEPEST, STEEPEST + TURN_STEP / 2, TURN_STEP)


def _moving_edges(pictures: Sequence[FloatImage], k: int) -> tuple[Array, Array, Array, Array]:
    """x, y, direction and weight of edge pixels of picture k that are absent in some other picture."""
    here_x, here_y = gradient(pictures[k])
    strength = np.hypot(here_x, here_y)
    others = {0, len(pictures) // 2, len(pictures) - 1} - {k}
    moved = np.zeros_like(strength)
    for other in others:
        there_x, there_y = gradient(pictures[other])
        moved = np.maximum(moved, np.hypot(here_x - there_x, here_y - there_y))
    weight = np.minimum(strength, moved)
    noise = max(3.5 * float(np.median(weight)), 0.5)
    weight[:3] = weight[-3:] = 0
    weight[:, :3] = weight[:, -3:] = 0
    y, x = np.nonzero((weight > noise) & (np.abs(here_x) < math.tan(STEEPEST + 0.1) * np.abs(here_y)))
    direction = np.arctan(-here_x[y, x] / here_y[y, x])
    # cap the weight: length, not contrast, identifies an arm
    capped = np.minimum(weight[y, x], 4 * noise) / noise
    return x.astype(np.float64), y.astype(np.float64), direction.astype(np.float64), capped.astype(np.float64)


def _votes(x: Array, y: Array, direction: Array, weight: Array, width: int, height: int) -> Array:
    """Hough votes by direction and distance of the line from the picture's centre, shape (directions, distances)."""
    reach = math.ceil(math.hypot(width, height) / 2) + 2
    table = np.zeros((len(_GRID), 2 * reach + 1))
    nearest = np.rint((direction + STEEPEST) / TURN_STEP).astype(np.int64)
    for offset in range(-24, 25):
        k = nearest + offset
        fits = (k >= 0) & (k < len(_GRID))
        angle = _GRID[k[fits]]
        distance = -(x[fits] - width / 2) * np.sin(angle) + (y[fits] - height / 2) * np.cos(angle)
        place = k[fits] * table.shape[1] + np.rint(distance).astype(np.int64) + reach
        table += np.bincount(place, weights=weight[fits], minlength=table.size).reshape(table.shape)
    return np.asarray(cv2.blur(table, (3, 1)) * 3)


def _evidence(votes: Array) -> Array:
    """Score of each direction: root sum of squares of its three longest lines, which favours one long line."""
    longest = np.sort(votes[:, ::3], axis=1)[:, -3:]
    return np.asarray(np.sqrt(np.sum(longest**2, axis=1)))


def _direction_path(evidence: Array, begins: float | None) -> npt.NDArray[np.int64]:
    """Index of the direction in every sample frame: high score and steady motion (Viterbi algorithm).

    `begins` is the stated direction in the first one [rad].
    """
    count, grid = evidence.shape
    scale = np.percentile(evidence, 99.5) + 1e-9
    gain = evidence / scale
    step = np.abs(np.arange(grid)[:, None] - np.arange(grid)[None, :])
    price = 0.012 * np.minimum(step, 60)
    total = gain[0] if begins is None else np.where(np.abs(_GRID - begins) <= STATED_TURN, gain[0], -np.inf)
    came = np.zeros((count, grid), dtype=np.int64)
    for k in range(1, count):
        table = total[None, :] - price
        came[k] = np.argmax(table, axis=1)
        total = table[np.arange(grid), came[k]] + gain[k]
    path = np.zeros(count, dtype=np.int64)
    path[-1] = int(np.argmax(total))
    for k in range(count - 1, 0, -1):
        path[k - 1] = came[k, path[k]]
    return path


def _pivot(votes: Sequence[Array], path: npt.NDArray[np.int64], width: int, height: int) -> tuple[float, float] | None:
    """Point about which the line turns: its distance from the line is the same in all sample frames."""
    reach = (votes[0].shape[1] - 1) // 2
    rows = np.arange(-height, height, dtype=np.float64)
    best, pivot = 0.0, None
    for x in np.linspace(-0.8 * width, 0.8 * width, 161):
        # a row y at column x lies on the line of this distance
        total = np.zeros(len(rows))
        for vote, k in zip(votes, path, strict=True):
            angle = _GRID[k]
            distance = -x * math.sin(angle) + rows * math.cos(angle) + reach
            total += np.interp(distance, np.arange(vote.shape[1]), vote[k], left=0.0, right=0.0)
        top = int(np.argmax(total))
        if total[top] > best:
            best, pivot = float(total[top]), (x + width / 2, float(rows[top]) + height / 2)
    return pivot


def _swept(pictures: Sequence[FloatImage]) -> Mask:
    """Where something moves, and what is near to that: an arm that turns little lies beside what it sweeps."""
    smooth = np.stack([cv2.GaussianBlur(picture, (0, 0), 1.5) for picture in pictures])
    change = np.percentile(smooth, 95, axis=0) - np.percentile(smooth, 5, axis=0)
    moves = cv2.morphologyEx(
        (change > 4 * np.median(change) + 4).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    return np.asarray(cv2.dilate(moves, np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)) > 0)


def _picture_of(
    directions: dict[int, float],
    pivot: tuple[float, float],
    frames: dict[int, FloatImage],
    plate: Line | None,
    swept: Mask | None = None,
) -> Arm | None:
    """Median picture of the arm from sample frames turned back; the pivot is refined meanwhile.

    Edges are searched where the scene is `swept`; None: everywhere.
    """
    width = next(iter(frames.values())).shape[1]
    numbers = sorted(frames)
    along = np.arange(-width, width, dtype=np.float64)
    visible = [
        all(-2 <= pivot[0] + s * math.cos(angle) < width + 2 for angle in directions.values()) for s in along.tolist()
    ]
    along = along[np.array(visible)]
    depth = max(0.14 * width, 24)
    across = np.arange(-round(depth), round(depth) + 1, dtype=np.float64)
    if len(along) < SHORTEST * width:
        return None
    arm = None
    for turn in range(4):
        cuts = [turned_back(frames[n], pivot, directions[n], along, across) for n in numbers]
        middle, noise = _still(np.stack(cuts))
        near = np.ones_like(middle)
        if swept is not None:
            parts = [turned_back(swept.astype(np.float32), pivot, directions[n], along, across) for n in numbers]
            near = np.median(parts, axis=0)
        edges, span = _edges(middle, noise, near > 0.5, along, across, width), None
        if plate is not None:
            ends = [in_arm(end, pivot, directions[numbers[0]]) for end in plate]
            surface = float(np.mean([row for _, row in ends]))
            edges = tuple(edge for edge in edges if edge.row > surface - STATED_REACH)
            if turn == 3 and all(edge.row > surface + STATED_REACH for edge in edges):
                return None
            span = min(place for place, _ in ends), max(place for place, _ in ends)
        if not edges:
            return arm
        arm = Arm(pivot, along, across, middle, edges, span or _span(edges, along), dict(directions))
        if turn == 3:
            break
        found = {n: lay_over(arm, frames[n], directions[n], reach=7 - turn) for n in numbers}
        directions = {n: turned.direction if (turned := found[n]) is not None else directions[n] for n in numbers}
        pivot = _shifted_pivot(pivot, directions, {n: each.shift for n, each in found.items() if each is not None})
    return arm


def in_arm(place: Point, pivot: Point, direction: float) -> Point:
    """A place of the picture [px] along and across an arm of this direction [rad]."""
    x, y = place[0] - pivot[0], place[1] - pivot[1]
    cos, sin = math.cos(direction), math.sin(direction)
    return x * cos + y * sin, y * cos - x * sin


def _shifted_pivot(
    pivot: tuple[float, float], directions: dict[int, float], shifts: dict[int, float]
) -> tuple[float, float]:
    """Move the pivot along the arm until the edges no longer shift as it turns."""
    numbers = [n for n in shifts if n in directions]
    if len(numbers) < 4:
        return pivot
    angle = np.array([directions[n] for n in numbers])
    shift = np.array([shifts[n] for n in numbers])
    middle = float(np.median(angle))
    if np.ptp(angle) < 0.01:
        return pivot
    # a pivot that lies d too far along the arm shifts its edges by d times the turn
    slope = float(np.polyfit(angle - middle, shift, 1)[0])
    slope = float(np.clip(slope, -60, 60))
    return pivot[0] - slope * math.cos(middle), pivot[1] - slope * math.sin(middle)


def _still(stack: npt.NDArray[np.float32]) -> tuple[FloatImage, FloatImage]:
    """Median over the stack and the scatter about it."""
    middle = np.median(stack, axis=0).astype(np.float32)
    scatter = np.median(np.abs(stack - middle), axis=0).astype(np.float32) * np.float32(MAD_TO_STD)
    return middle, np.asarray(cv2.blur(scatter, (5, 3)) + np.float32(0.5), dtype=np.float32)


def _edges(
    middle: FloatImage, noise: FloatImage, near: Mask, along: Array, across: Array, width: int
) -> tuple[Edge, ...]:
    """Straight edges along the arm: rows with a gradient across it over a long range of columns.

    `near` marks the pixels near to what moves.
    """
    smooth = cv2.GaussianBlur(middle, (0, 0), sigmaX=2.0, sigmaY=1.0)
    change = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8), dtype=np.float32)
    aslant = np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8), dtype=np.float32)
    clear = np.abs(change) > np.maximum(0.25 * noise, 0.6)
    # what stands still in the scene lies at an angle to the arm
    clear &= near & (np.abs(aslant) < ASLANT * np.abs(change) + 0.3)
    # before a scene with light and dark parts one edge of the arm is a rise here and a fall there
    steep = np.where(clear, change, 0.0)
    strength = cv2.blur(np.minimum(np.abs(steep), 8), (1, 3)).sum(axis=1) / len(along)
    strength[: REACH + 3] = strength[-REACH - 3 :] = 0.0
    found: list[Edge] = []
    order = np.argsort(-strength)
    for row in order[:60]:
        if len(found) == 6 or strength[row] <= 0.12 * strength[order[0]]:
            break
        if any(abs(across[row] - edge.row) < 2 * REACH - 2 for edge in found):
            continue
        edge = _edge_at(int(row), steep, along, across, width)
        if edge is not None:
            found.append(edge)
    slopes = np.array([edge.slope for edge in found])
    length = np.array([edge.strength * (edge.end - edge.start) for edge in found])
    # the arm's edges are parallel; others belong to marks on it or objects beside it
    leader = 0.0 if not found else slopes[int(np.argmax(length))]
    return tuple(edge for edge, slope in zip(found, slopes, strict=True) if abs(slope - leader) < PARALLEL)


def _edge_at(row: int, change: Array, along: Array, across: Array, width: int) -> Edge | None:
    """The edge near a row, with its range of columns and its slope; None if it is too short.

    `change` is the gradient across the arm where it may be an edge, else 0.  Rises and falls are one edge where they
    lie in one line; else, as at both borders of a thin plate, the stronger ones are.
    """
    band = change[row - 3 : row + 4]
    rises, falls = np.maximum(band, 0), np.maximum(-band, 0)
    rows = across[row - 3 : row + 4]
    middle = [float(np.sum(part**2 * rows[:, None]) / max(np.sum(part**2), 1e-9)) for part in (rises, falls)]
    steep = np.abs(band)
    if rises.any() and falls.any() and abs(middle[0] - middle[1]) > IN_LINE:
        steep = rises if rises.sum() > falls.sum() else falls
    support = np.max(steep, axis=0)
    covered = support > 0.3 * np.percentile(support[support > 0], 75) if np.any(support > 0) else support > 0
    columns = _columns_of(covered, round(LONGEST_GAP * width), width)
    if columns is None:  # a long gap may join the edge to specks far from it
        columns = _columns_of(covered, round(USUAL_GAP * width), width)
    if columns is None:
        return None
    weight = steep[:, columns] ** 2
    centre = (weight * rows[:, None]).sum(axis=0) / (weight.sum(axis=0) + 1e-9)
    line, _, kept = straight(along[columns], centre, weight.sum(axis=0))
    if kept < 0.5:
        return None
    mean = float(np.mean(support[columns]))
    return Edge(float(across[row]), int(columns[0]), int(columns[-1]), float(line[1]), mean)


def _columns_of(covered: Mask, gap: int, width: int) -> npt.NDArray[np.int64] | None:
    """Columns in which an edge is seen, with gaps up to `gap` px between them; None if these are few."""
    run = fullest_run(covered, gap=gap)
    if run is None:
        return None
    columns = run[0] + np.flatnonzero(covered[run[0] : run[1] + 1])
    few = len(columns) < max(LEAST_SEEN * (run[1] - run[0]), SHORTEST * width)
    return None if few else columns


def _span(edges: tuple[Edge, ...], along: Array) -> tuple[float, float]:
    return (
        float(along[int(np.median([edge.start for edge in edges]))]),
        float(along[int(np.median([edge.end for edge in edges]))]),
    )


def lay_over(arm: Arm, frame: FloatImage, direction: float, *, reach: int = REACH) -> Turn | None:
    """The arm's direction in a steady frame, from a first guess [rad]; None if its edges are not found near it."""
    found: Turn | None = None
    shifts = np.zeros(len(arm.edges))
    for step in range(4):
        parts = [
            _edge_shift(arm, edge, frame, direction, shift, reach if step == 0 else min(reach, REACH))
            for edge, shift in zip(arm.edges, shifts, strict=True)
        ]
        along = np.concatenate([part[0] for part in parts])
        shift = np.concatenate([part[1] for part in parts])
        weight = np.concatenate([part[2] for part in parts])
        which = np.concatenate([np.full(len(part[0]), k) for k, part in enumerate(parts)])
        if np.sum(weight > 0) < 20:
            return None
        turn, moved, sigma, good = _common_turn(along, shift, weight, which, len(parts))
        if good < 0.3:
            return None
        direction += turn
        shifts = shifts + moved
        found = Turn(direction, sigma, float(np.average(shifts, weights=[edge.strength for edge in arm.edges])))
        if abs(turn) < 2e-5 and np.max(np.abs(moved)) < 0.02:
            break
    return found


def _edge_shift(
    arm: Arm, edge: Edge, frame: FloatImage, direction: float, shift: float, reach: int
) -> tuple[Array, Array, Array]:
    """Offset of an edge from its position in the arm's picture: position along the arm, offset [px], weight."""
    columns = np.arange(edge.start, edge.end + 1)
    row = int(np.argmin(np.abs(arm.across - edge.row)))
    low, high = max(row - reach - 1, 0), min(row + reach + 2, len(arm.across))
    rows = np.arange(low, high)
    width = 5  # columns are averaged in groups: less noise, less work
    model = _grouped(arm.picture[np.ix_(rows, columns)], width)
    seen = _grouped(turned_back(frame, arm.pivot, direction, arm.along[columns], arm.across[rows] + shift), width)
    along = _grouped(arm.along[columns][None, :].astype(np.float32), width)[0]
    slope = np.gradient(model, axis=0)
    model, seen = model - model.mean(axis=0), seen - seen.mean(axis=0)
    power = np.sum(slope * slope, axis=0)
    # the brightness of the arm changes as it turns: compare profiles without level and gain
    gain = np.clip(np.sum(model * seen, axis=0) / (np.sum(model * model, axis=0) + 1e-6), 0.3, 3.0)
    miss = seen - gain * model
    offset = -np.sum(slope * miss, axis=0) / (gain * power + 1e-6)
    error = np.sum(miss * miss, axis=0) / (np.sum(seen * seen, axis=0) + 1e-6)
    worth = np.where((np.abs(offset) < reach) & (error < 0.7), power, 0.0)
    return along.astype(np.float64), offset.astype(np.float64), worth.astype(np.float64)


def _grouped(values: npt.NDArray[np.float32], width: int) -> npt.NDArray[np.float64]:
    count = values.shape[1] // width
    return np.asarray(values[:, : count * width].reshape(values.shape[0], count, width).mean(axis=2), dtype=np.float64)


def _common_turn(
    along: Array, shift: Array, weight: Array, which: npt.NDArray[np.int64], count: int
) -> tuple[float, Array, float, float]:
    """Robust fit of one turn and a shift per edge: turn [rad], shifts [px], standard error [rad], share of inliers."""
    design = np.zeros((len(along), count + 1))
    design[:, 0] = along
    design[np.arange(len(along)), which + 1] = 1.0
    size = np.array([np.abs(along).max() + 1.0, *np.ones(count)])
    design /= size
    usual = np.ones_like(shift)
    answer, miss, scale = np.zeros(count + 1), shift, 1.0
    normal = np.eye(count + 1)
    for _ in range(10):
        w = weight * usual
        normal = (design * w[:, None]).T @ design + 1e-6 * np.eye(count + 1) * (w.sum() + 1e-9)
        answer = np.linalg.solve(normal, design.T @ (w * shift))
        miss = np.abs(shift - design @ answer)
        known = weight > 0
        scale = max(mad_std(miss[known], centre=0.0), 0.02)
        usual = 1 / (1 + (miss / (2.5 * scale)) ** 2) ** 2
    w = weight * usual
    inverse = np.linalg.inv(normal)
    spread = inverse @ ((design * (w**2 * scale**2)[:, None]).T @ design) @ inverse
    good = float(np.mean(miss[weight > 0] < max(3 * scale, 0.5))) * float(np.mean(weight > 0))
    return float(answer[0] / size[0]), answer[1:], math.sqrt(float(spread[0, 0])) / float(size[0]), good
