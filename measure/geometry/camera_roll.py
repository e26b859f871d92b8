"""A camera's roll that is stated, held against the one that the picture shows, and one that only the picture shows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.quantity import Check
from rigtwin.measure.geometry.lines import at

STATED_TO = math.radians(0.5)  # nobody reads a camera's lean better


def roll_check(given: float, seen: float, doubt: float, witness: str) -> Check:
    """A stated roll against that which a `witness` in the picture shows, with its standard uncertainty [rad]."""
    passed = abs(given - seen) < max(3 * doubt, STATED_TO)
    message = (
        f"a camera roll of {math.degrees(given):+.2f} degrees was given, {witness} "
        f"{math.degrees(seen):+.2f} ± {math.degrees(doubt):.2f}"
    )
    ending = (
        "."
        if passed
        else ": its sign may be wrong (positive when the scene looks turned clockwise), or what is seen there is not "
        "level, which a spirit level on it tells; where it is, leave --camera-roll out."
    )
    return Check("camera_roll", passed, math.degrees(given), math.degrees(seen), message + ending)


def upright_checks(upright: Upright) -> list[Check]:
    """Whether level edges bear out a stated roll, or that they alone show one as no camera on a stand has."""
    if upright.source == GIVEN_ROLL:
        return [roll_check(upright.roll, *upright.seen, "the level edges in the picture show")] if upright.seen else []
    turned = math.degrees(upright.roll)
    if abs(turned) <= STURDY:
        return []
    message = (
        f"the edges taken for level show a camera turned by {turned:+.1f} degrees, as none on a stand is: they "
        f"may lie aslant; where it was turned so, give --camera-roll {turned:.1f}deg."
    )
    return [Check("camera_roll", False, turned, 0.0, message)]


def nothing_level(upright: Upright) -> str:
    """What to say where neither a stated roll nor an edge tells how the camera was turned; nothing where one does."""
    if upright.source != NOT_SEEN:
        return ""
    return (
        "camera roll: nothing level is seen, the picture was taken as upright, to "
        f"{math.degrees(upright.sigma):.0f} degrees; give --camera-roll, 0deg where the camera was levelled."
    )


STURDY = 7.0  # [deg], a camera on a stand is not turned by more

STEEPEST = 25.0  # [deg], a picture turned by more is seen to be; struts and the walls of a hopper are steeper

SHORTEST = 0.06  # of the picture's width

LIKE = 0.35  # [deg], edges that differ by less tell of one direction

FEWEST = 0.25  # of the picture's width, total length of the edges that must agree

ELSEWHERE = 0.3  # weight of an edge that is not the stand's

WITHOUT = STURDY / 3  # [deg], how far a camera may be turned where nothing level is seen; few are by thrice that

NOT_SEEN = "not seen: the picture is taken as upright"

GIVEN = 0.1  # [deg], doubt of a roll that the user states

GIVEN_ROLL = "given"  # the source of such a roll

# [deg], nothing is level to better than this, and a camera that looks slightly aside turns level edges by as much
NOT_LEVEL = 0.2

ROW = 1 / math.sqrt(12)  # [px], how far a codec that holds a border on its row may move the end of an edge


@dataclass(frozen=True)
class Upright:
    """How the camera was turned about its axis."""

    roll: float  # [rad], positive when the scene looks turned clockwise in the picture
    sigma: float  # [rad], one standard deviation
    source: str  # what it was told from
    edges: Array  # [px], shape (n, 4): x1, y1, x2, y2 of the level edges found
    seen: tuple[float, float] | None = None  # [rad], the roll that the edges show, and its doubt; None: none are seen


def upright(
    picture: npt.NDArray[np.float32],
    *,
    given: float | None = None,
    stand: npt.NDArray[np.bool_] | None = None,
    apart_from: npt.NDArray[np.bool_] | None = None,
) -> Upright:
    """The camera's roll from level edges in a grey picture of the still scene; `given` [rad] goes before.

    `stand` marks where what is known to be level is; edges elsewhere count less.  Edges in `apart_from` do not count.
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
    # many edges that agree tell more than one long and clear one, which may lie on a border of the codec's blocks; a
    # faint one may be a shadow's
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
    """How likely a camera is turned by so much [deg]: what lies more aslant is rather no level thing."""
    return np.asarray((np.maximum(np.abs(angle), STURDY) / STURDY) ** -2.0)


def _like(apart: Array) -> Array:
    """How far directions that are so far apart [deg] are the same one."""
    return np.asarray(np.exp(-0.5 * (apart / LIKE) ** 2))


def _votes(directions: Array, angle: Array, weight: Array) -> Array:
    """What edges of these angles [deg] say for each of these directions [deg]."""
    return np.asarray((weight[None, :] * _like(directions[:, None] - angle[None, :])).sum(axis=1))


def _disagreement(angle: Array, weight: Array, agree: npt.NDArray[np.bool_], middle: float) -> float:
    """[deg], by which edges of another direction may be the level ones: a rival of half the votes by a quarter."""
    if agree.all():
        return 0.0
    most = float(_votes(np.array([middle]), angle, weight)[0])
    rivals = np.minimum(_votes(angle[~agree], angle[~agree], weight[~agree]) / most, 1.0)
    return float(np.max(rivals**2 * np.abs(angle[~agree] - middle)))


def _at_middle(found: Array, marked: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    return at(marked, (found[:, :2] + found[:, 2:4]) / 2)


def _share_in(found: Array, marked: npt.NDArray[np.bool_]) -> Array:
    """How much of each edge lies where it is marked: a table's edge goes on to both sides of the drum above it."""
    along = np.linspace(0, 1, 24)[:, None, None]
    places = found[:, :2] + along * (found[:, 2:4] - found[:, :2])
    return np.asarray(at(marked, places.reshape(-1, 2)).reshape(len(along), -1).mean(axis=0))


def _clearness(picture: npt.NDArray[np.float32], found: Array) -> Array:
    """Brightness step across every edge, 1 for the clearest one, shape (n,)."""
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
    # a dark film shows its edges as well as a bright one
    low, high = (float(each) for each in np.percentile(picture, (1, 99)))
    grey = np.clip(np.rint((picture - low) * 255 / max(high - low, 8.0)), 0, 255).astype(np.uint8)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    lines: object = detector.detect(grey)[0]  # None where there is no line, whatever the stubs say
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
    """The same edge, laid through the places of steepest brightness across it (the detector's ends are rough)."""
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
        kept = miss <= max(2.5 * 1.4826 * float(np.median(miss)), 0.1)
    return np.array([x[0], np.polyval(line, x[0]), x[-1], np.polyval(line, x[-1])])
