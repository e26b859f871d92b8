"""Camera roll from level edges in the picture, and checks of a roll stated by the user against them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Check
from rigtwin.measure.geometry.lines import at
from rigtwin.measure.robust import mad_std

STATED_TO = math.radians(0.5)  # accuracy of a stated camera roll


def roll_check(given: float, seen: float, sigma: float, witness: str) -> Check:
    """Check `camera_roll`: stated roll against the one seen in the picture, with its standard uncertainty [rad].

    `witness` names the object that shows the roll, with its verb.
    """
    within = max(3 * sigma, STATED_TO)
    passed = abs(given - seen) < within
    message = (
        f"a camera roll of {math.degrees(given):+.2f} degrees was given, {witness} "
        f"{math.degrees(seen):+.2f} ± {math.degrees(sigma):.2f}"
    )
    turned = abs(-given - seen) < within
    wrong = "the sign may be wrong (positive when the scene looks rotated clockwise)" if turned else "it may be wrong"
    ending = (
        "."
        if passed
        else f": {wrong}, or that object is not level. Check it with a spirit level; if it is level, leave out "
        "--camera-roll."
    )
    return Check("camera_roll", passed, math.degrees(given), math.degrees(seen), message + ending)


def upright_checks(upright: Upright) -> list[Check]:
    """Check `camera_roll`: a stated roll against level edges, or an implausibly large roll found from edges alone."""
    if upright.source == GIVEN_ROLL:
        return [roll_check(upright.roll, *upright.seen, "the level edges in the picture show")] if upright.seen else []
    turned = math.degrees(upright.roll)
    if abs(turned) <= STURDY:
        return []
    message = (
        f"the edges taken as level show a camera roll of {turned:+.1f} degrees, unusually large for a "
        "camera on a stand: they may not be level. If the camera was rotated like this, give "
        f"--camera-roll {turned:.1f}deg."
    )
    return [Check("camera_roll", False, turned, 0.0, message)]


def nothing_level(upright: Upright) -> str:
    """The warning if the roll is neither stated nor found from edges; otherwise empty."""
    if upright.source != NOT_SEEN:
        return ""
    return (
        "camera roll: no level edge was found; a roll of 0 degrees was assumed, with a standard uncertainty of "
        f"{math.degrees(upright.sigma):.0f} degrees. Give --camera-roll (0deg if the camera was levelled)."
    )


STURDY = 7.0  # [deg], largest plausible roll of a camera on a stand

STEEPEST = 25.0  # [deg], steepest edge used; a larger roll is obvious to the user, struts and hopper walls are steeper

SHORTEST = 0.06  # of the picture's width, shortest edge used

LIKE = 0.35  # [deg], width of the vote: edges that differ by less count as parallel

FEWEST = 0.25  # of the picture's width, minimum total length of the edges that agree

ELSEWHERE = 0.3  # weight of an edge that is not part of the stand

WITHOUT = STURDY / 3  # [deg], standard uncertainty of the roll without level edges (STURDY is three of it)

NOT_SEEN = "not seen: the picture is taken as upright"

GIVEN = 0.1  # [deg], standard uncertainty of a roll stated by the user

GIVEN_ROLL = "given"  # `Upright.source` of a stated roll

# [deg], standard uncertainty of "level": objects are not level to better than this, and an oblique view rotates level
# edges by about as much
NOT_LEVEL = 0.2

ROW = 1 / math.sqrt(12)  # [px], standard uncertainty of an edge's end that a codec rounds to a pixel row


@dataclass(frozen=True)
class Upright:
    """Camera roll (rotation about the optical axis)."""

    roll: float  # [rad], positive when the scene looks rotated clockwise in the picture
    sigma: float  # [rad], standard uncertainty
    source: str  # origin of the value
    edges: Array  # [px], shape (n, 4): x1, y1, x2, y2 of the level edges found
    seen: tuple[float, float] | None = None  # [rad], roll from the edges and its standard uncertainty; None: no edges


def upright(
    picture: npt.NDArray[np.float32],
    *,
    given: float | None = None,
    stand: npt.NDArray[np.bool_] | None = None,
    apart_from: npt.NDArray[np.bool_] | None = None,
) -> Upright:
    """The camera's roll from level edges in a grey picture of the background; `given` [rad] overrides it.

    `stand` marks objects known to be level, edges elsewhere have less weight. Edges in `apart_from` are ignored.
    """
    none = np.empty((0, 4))
    if given is not None:
        seen = upright(picture, stand=stand, apart_from=apart_from).seen
        return Upright(given, math.radians(GIVEN), GIVEN_ROLL, none, seen)
    found = _edges(picture)
    if apart_from is not None:
        found = found[_share_in(found, apart_from) < 0.5]
    if len(found) == 0:
        return Upright(0.0, math.radians(WITHOUT), NOT_SEEN, none)
    angle = np.degrees(np.arctan2(found[:, 3] - found[:, 1], found[:, 2] - found[:, 0]))
    length = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
    trust = np.where(_at_middle(found, stand), 1.0, ELSEWHERE) if stand is not None else np.ones(len(found))
    # the square root limits the weight of contrast: a single clear edge may be a block border of the codec, so several
    # agreeing edges must outweigh it; faint edges may be shadows
    weight = trust * length * np.sqrt(_clearness(picture, found)) * _as_on_a_stand(angle)
    middle = float(angle[int(np.argmax(_votes(angle, angle, weight)))])
    for _ in range(5):
        share = weight * _like(angle - middle)
        middle = float(np.sum(share * angle) / np.sum(share))
    agree = np.abs(angle - middle) < 2 * LIKE
    if float(length[agree].sum()) < FEWEST * picture.shape[1]:
        return Upright(0.0, math.radians(WITHOUT), NOT_SEEN, none)
    voting = weight[agree]
    spread = math.sqrt(float(np.average((angle[agree] - middle) ** 2, weights=voting)))
    independent = min(float(voting.sum()) ** 2 / float(np.sum(voting**2)), 3.0)
    on_rows = float(np.average(np.degrees(ROW / length[agree]), weights=voting))
    against = _disagreement(angle, weight, agree, middle)
    sigma = math.hypot(spread / math.sqrt(independent), on_rows, against, NOT_LEVEL)
    seen = math.radians(middle), math.radians(sigma)
    return Upright(*seen, "level edges in the picture", found[agree], seen)


def _as_on_a_stand(angle: Array) -> Array:
    """Prior weight of a roll angle [deg]: steeper edges are less likely to be level objects."""
    return np.asarray((np.maximum(np.abs(angle), STURDY) / STURDY) ** -2.0)


def _like(apart: Array) -> Array:
    """Gaussian similarity of two directions with this difference [deg]."""
    return np.asarray(np.exp(-0.5 * (apart / LIKE) ** 2))


def _votes(directions: Array, angle: Array, weight: Array) -> Array:
    """Sum of the edges' weights for each direction [deg], shape (len(directions),)."""
    return np.asarray((weight[None, :] * _like(directions[:, None] - angle[None, :])).sum(axis=1))


def _disagreement(angle: Array, weight: Array, agree: npt.NDArray[np.bool_], middle: float) -> float:
    """Uncertainty [deg] from edges with another direction: share of votes squared times difference of the angles."""
    if agree.all():
        return 0.0
    most = float(_votes(np.array([middle]), angle, weight)[0])
    rivals = np.minimum(_votes(angle[~agree], angle[~agree], weight[~agree]) / most, 1.0)
    return float(np.max(rivals**2 * np.abs(angle[~agree] - middle)))


def _at_middle(found: Array, marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    return at(marked, (found[:, :2] + found[:, 2:4]) / 2)


def _share_in(found: Array, marked: npt.NDArray[np.bool_]) -> Array:
    """Share of each edge inside the mask, shape (n,); e.g. a table's edge extends beyond the drum in front of it."""
    along = np.linspace(0, 1, 24)[:, None, None]
    places = found[:, :2] + along * (found[:, 2:4] - found[:, :2])
    return np.asarray(at(marked, places.reshape(-1, 2)).reshape(len(along), -1).mean(axis=0))


def _clearness(picture: npt.NDArray[np.float32], found: Array) -> Array:
    """Brightness gradient across every edge relative to the strongest one, shape (n,)."""
    slope = np.abs(cv2.Sobel(cv2.GaussianBlur(picture, (0, 0), 1.5), cv2.CV_32F, 0, 1, scale=1 / 8))
    steps = []
    for x1, y1, x2, y2 in found:
        x = np.linspace(x1, x2, 24).astype(np.float32)
        y = np.linspace(y1, y2, 24).astype(np.float32)
        steps.append(float(np.median(cv2.remap(slope, x[None], y[None], cv2.INTER_LINEAR))))
    clear = np.array(steps)
    return np.asarray(clear / max(float(clear.max()), 1e-9))


def _edges(picture: npt.NDArray[np.float32]) -> Array:
    """Nearly level straight edges, shape (n, 4)."""
    # normalise the contrast, so that dark recordings work as well as bright ones
    low, high = (float(each) for each in np.percentile(picture, (1, 99)))
    grey = np.clip(np.rint((picture - low) * 255 / max(high - low, 8.0)), 0, 255).astype(np.uint8)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    lines: object = detector.detect(grey)[0]  # None without lines, contrary to the type stubs
    if lines is None:
        return np.empty((0, 4))
    segments = np.asarray(lines, dtype=np.float64).reshape(-1, 4)
    swap = segments[:, 0] > segments[:, 2]
    segments[swap] = segments[swap][:, [2, 3, 0, 1]]
    across, up = segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]
    level = (np.hypot(across, up) > SHORTEST * picture.shape[1]) & (
        np.abs(np.degrees(np.arctan2(up, np.maximum(across, 1e-9)))) < STEEPEST
    )
    return np.array([_sharpened(picture, segment) for segment in segments[level]]).reshape(-1, 4)


def _sharpened(picture: npt.NDArray[np.float32], segment: Array) -> Array:
    """The same edge refined by a robust line through the steepest gradients (the detector's ends are inaccurate)."""
    x = np.linspace(segment[0], segment[2], max(int(segment[2] - segment[0]), 8))
    y = np.interp(x, segment[[0, 2]], segment[[1, 3]])
    across = np.arange(-3.0, 3.5, 0.5)
    smooth = cv2.GaussianBlur(picture, (0, 0), 1.0)
    columns = np.broadcast_to(x, (len(across), len(x))).astype(np.float32)
    rows = (y + across[:, None]).astype(np.float32)
    slope = np.gradient(cv2.remap(smooth, columns, rows, cv2.INTER_LINEAR).astype(np.float64), axis=0)
    strength = np.abs(slope) ** 2
    off = np.sum(strength * across[:, None], axis=0) / np.maximum(strength.sum(axis=0), 1e-9)
    kept = np.ones(len(x), dtype=bool)
    line = np.zeros(2)
    for _ in range(3):
        line = np.polyfit(x[kept], (y + off)[kept], 1)
        miss = np.abs(y + off - np.polyval(line, x))
        kept = miss <= max(2.5 * mad_std(miss, centre=0.0), 0.1)
    return np.array([x[0], np.polyval(line, x[0]), x[-1], np.polyval(line, x[-1])])
