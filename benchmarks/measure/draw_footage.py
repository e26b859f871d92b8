"""Films of shaded beads before a mottled wall, drawn with a pinhole camera, motion blur and one hardness at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Picture = npt.NDArray[np.float32]
Grey = npt.NDArray[np.uint8]

PARTS = 8  # moments at which a moving bead is drawn in one exposure, at least
LENS = 0.7  # [px], standard deviation of the blur of lens and pixel; what moves is drawn in steps no longer than this
CLOCK = 24000  # [1/s], ticks of a stored time stamp


@dataclass(frozen=True)
class View:
    """A pinhole camera whose axis goes along +y through the middle of its picture (x right, z up, metres)."""

    width: int  # [px]
    height: int  # [px]
    scale: float  # [m/px] in the plane of motion
    origin: tuple[float, float]  # [px], where a camera that stands straight sees the origin of the plane of motion
    away: float = 1.5  # [m]
    pitch: float = 0.0  # [rad], positive looks down
    yaw: float = 0.0  # [rad]
    roll: float = 0.0  # [rad], positive when the scene looks turned clockwise
    bend: float = 0.0  # how much further from the middle the lens shows the picture's corners; a barrel's is negative

    def project(self, places: Array) -> tuple[Array, Array]:
        """Picture places [px] of points [m] (x, y away from the camera, z), shape (..., 3), and pixels per metre."""
        middle = np.array([self.width / 2, self.height / 2])
        aim = (middle - self.origin) * [self.scale, -self.scale]
        x, y, z = np.moveaxis(np.asarray(places, dtype=np.float64) - [aim[0], 0, aim[1]], -1, 0)
        x, y = x * math.cos(self.yaw) - y * math.sin(self.yaw), x * math.sin(self.yaw) + y * math.cos(self.yaw)
        y, z = y * math.cos(self.pitch) - z * math.sin(self.pitch), y * math.sin(self.pitch) + z * math.cos(self.pitch)
        size = self.away / (self.away + y) / self.scale
        across, down = x * size, -z * size
        c, s = math.cos(self.roll), math.sin(self.roll)
        off = np.stack([c * across - s * down, s * across + c * down], axis=-1)
        bent = self.bend * np.sum((off / np.hypot(*middle)) ** 2, axis=-1)
        return middle + (1 + bent[..., None]) * off, size * (1 + 2 * bent)


@dataclass(frozen=True)
class Footage:
    """How a film is taken and stored: everything that can make it hard."""

    rate: float = 240.0  # [1/s], of the capture
    exposure: float = 0.25  # of a frame's interval
    noise: float = 2.0  # [grey levels]
    ground: float = 140.0  # [grey levels], of the wall
    mottle: float = 5.0  # [grey levels], of the wall, standard deviation
    bead: float = 60.0  # [grey levels], brightest of a bead without highlight
    shading: float = 0.45  # share of a bead's light that depends on where it faces
    marked: bool = False  # one half of the bead is painted, and it spins
    shine: float = 0.0  # [grey levels], of the highlight
    shadow: float = 0.0  # share of light that a bead's shadow takes from the wall behind it
    glare: float = 0.0  # [grey levels], of a lamp's reflection in the lens
    bar: bool = False  # a rod stands in front of the path
    hand: bool = False  # something else moves about
    shake: float = 0.0  # [px]
    crf: int = 18
    interlaced: bool = False
    stored_rate: float | None = None  # [1/s], None stores the capture rate
    kept: Callable[[int, np.random.Generator], list[int]] = field(default=lambda n, _: list(range(n)))
    stamped: bool = False  # kept frames carry their true times


@dataclass(frozen=True)
class Stage:
    """What is filmed: the beads' places over time, and the still things around them."""

    places: Callable[[Array], Array]  # times [s] -> places [m], shape (n, beads, 3)
    radius: float  # [m]
    view: View
    props: Callable[[Picture, View], None]  # draws plate, stand and the like on the wall
    held: Callable[[Picture, View], None]  # what holds the bead until the release
    release: float  # [s]
    duration: float  # [s]
    hinges: Array | None = None  # [m], where threads hang, shape (beads, 3)
    middle: tuple[float, float] = (0.0, 0.0)  # [px], of what hides or dazzles
    turned: Callable[[Picture, View, float], None] | None = None  # draws what stands otherwise at every time [s]


def film(path: Path, stage: Stage, footage: Footage, rng: np.random.Generator) -> Path:
    """Draw the film and store it as H.264."""
    count = int(stage.duration * footage.rate)
    return stored(path, list(_pictures(stage, footage, count, rng)), footage, rng)


def stored(path: Path, pictures: Sequence[Grey], footage: Footage, rng: np.random.Generator) -> Path:
    """Pictures, grey or BGR, as a film of H.264."""
    kept = footage.kept(len(pictures), rng)
    rate = Fraction(footage.stored_rate or footage.rate).limit_denominator(1001)
    options = {"crf": str(footage.crf), "preset": "veryfast", "threads": "1"}
    if footage.interlaced:
        options["x264-params"] = "tff=1"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options=options)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        if footage.stamped:
            stream.codec_context.time_base = Fraction(1, CLOCK)
        for k in kept:
            grey = pictures[k].ndim == 2
            colour = cv2.cvtColor(pictures[k], cv2.COLOR_GRAY2BGR) if grey else pictures[k]
            frame = av.VideoFrame.from_ndarray(colour, format="bgr24")
            if footage.stamped:
                frame.pts, frame.time_base = round(k / footage.rate * CLOCK), Fraction(1, CLOCK)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def _pictures(stage: Stage, footage: Footage, count: int, rng: np.random.Generator) -> Iterator[Grey]:
    wall = _wall(stage, footage, rng)
    moved = sway(count, footage.shake, rng)
    for k in range(count):
        fields = [k / footage.rate]
        if footage.interlaced:
            fields.append((k + 0.5) / footage.rate)
        seen = [_picture(wall, stage, footage, begun, moved[k]) for begun in fields]
        picture = seen[0]
        if footage.interlaced:
            picture[1::2] = seen[1][1::2]
        noisy = picture + footage.noise * rng.standard_normal(picture.shape, dtype=np.float32)
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _wall(stage: Stage, footage: Footage, rng: np.random.Generator) -> Picture:
    shape = (stage.view.height, stage.view.width)
    mottle = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), 5)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    wall = footage.ground * (1 + 0.08 * x / shape[1] - 0.06 * y / shape[0])
    wall = (wall + footage.mottle * mottle / mottle.std()).astype(np.float32)
    stage.props(wall, stage.view)
    return wall


def sway(count: int, size: float, rng: np.random.Generator) -> Array:
    """[px], how a camera held by hand moves from frame to frame, shape (count, 2)."""
    k = np.arange(count)
    slow = np.stack([np.sin(k / 9.0), np.cos(k / 6.0)], axis=1) * size
    return np.asarray(slow + 0.4 * size * rng.standard_normal((count, 2)))


def _picture(wall: Picture, stage: Stage, footage: Footage, begun: float, sway: Array) -> Picture:
    moments = begun + _parts(stage, footage, begun) * footage.exposure / footage.rate
    at, size = stage.view.project(stage.places(moments))
    picture = wall.copy()
    if begun < stage.release:
        stage.held(picture, stage.view)
    if stage.turned is not None:
        stage.turned(picture, stage.view, begun + footage.exposure / footage.rate / 2)
    if footage.hand:
        _hand(picture, begun)
    if footage.shadow:
        _shadows(picture, at, stage.radius * size, footage.shadow)
    if stage.hinges is not None:
        hung, _ = stage.view.project(stage.hinges)
        _threads(picture, hung, at[len(moments) // 2])
    for bead in range(at.shape[1]):
        _bead(picture, at[:, bead], stage.radius * size[:, bead], moments, footage)
    if footage.bar:
        x, y = (round(each) for each in stage.middle)
        picture[y - 11 : y + 11] = 0.55 * footage.ground
    if footage.glare:
        y, x = np.mgrid[: picture.shape[0], : picture.shape[1]].astype(np.float32)
        away = (x - stage.middle[0] - 4) ** 2 + (y - stage.middle[1]) ** 2
        picture += footage.glare * np.exp(-away / (2 * 18.0**2))
    if footage.shake:
        move = np.array([[1, 0, sway[0]], [0, 1, sway[1]]])
        size_of = (picture.shape[1], picture.shape[0])
        picture = cv2.warpAffine(picture, move, size_of, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), LENS), dtype=np.float32)


def _parts(stage: Stage, footage: Footage, begun: float) -> Array:
    """The moments of an exposure at which it is drawn, as shares of it."""
    coarse = (np.arange(PARTS) + 0.5) / PARTS
    at, _ = stage.view.project(stage.places(begun + coarse * footage.exposure / footage.rate))
    way = float(np.max(np.sum(np.linalg.norm(np.diff(at, axis=0), axis=-1), axis=0)))
    count = max(PARTS, math.ceil(way * PARTS / (PARTS - 1) / LENS))
    return np.asarray((np.arange(count) + 0.5) / count)


def _bead(picture: Picture, at: Array, radius: Array, moments: Array, footage: Footage) -> None:
    """A lit sphere averaged over the exposure."""
    reach = float(radius.max()) + 2
    left, top = (max(math.floor(each), 0) for each in at.min(axis=0) - reach)
    right, bottom = (max(math.ceil(each) + 1, 0) for each in at.max(axis=0) + reach)
    part = picture[top:bottom, left:right]
    if part.size == 0:
        return
    y, x = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
    light, cover = np.zeros(part.shape), np.zeros(part.shape)
    for (cx, cy), r, moment in zip(at, radius, moments, strict=True):
        u, v = (x - cx) / r, (y - cy) / r
        out = np.sqrt(np.clip(1 - u * u - v * v, 0, 1))
        facing = np.clip(-0.35 * u - 0.6 * v + 0.72 * out, 0, 1)
        shade = footage.bead * (1 - footage.shading + footage.shading * facing)
        if footage.marked:
            angle = 2 * math.pi * 4 * moment
            shade = np.where(u * math.cos(angle) + v * math.sin(angle) > 0, shade, 0.45 * shade)
        shade = shade + footage.shine * np.exp(-((u + 0.3) ** 2 + (v + 0.45) ** 2) / 0.02)
        mine = np.clip((1 - np.hypot(u, v)) * r + 0.5, 0, 1)
        light += mine * shade
        cover += mine
    part += (light - cover * part) / len(at)


def _shadows(picture: Picture, at: Array, radius: Array, depth: float) -> None:
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]].astype(np.float32)
    for bead in range(at.shape[1]):
        r = float(radius[:, bead].mean())
        cx, cy = at[:, bead].mean(axis=0) + np.array([2.0, 0.9]) * r
        picture *= 1 - depth / (1 + np.exp((np.hypot(x - cx, y - cy) - r) / (0.12 * r)))


def _hand(picture: Picture, now: float) -> None:
    """A pale blob that comes in from the right and goes again, beside the beads."""
    x = picture.shape[1] - 22 - 10 * math.sin(9 * now)
    y = 0.5 * picture.shape[0] + 60 * math.sin(7 * now + 1)
    cv2.ellipse(picture, (round(x) + 20, round(y)), (34, 26), 20, 0, 360, 205.0, -1, cv2.LINE_AA)


def _threads(picture: Picture, hung: Array, at: Array) -> None:
    for (x, y), (u, v) in zip(hung, at, strict=True):
        veil = np.zeros(picture.shape, np.uint8)
        ends = [(round(16 * float(a)), round(16 * float(b))) for a, b in ((x, y), (u, v))]
        cv2.line(veil, ends[0], ends[1], 255, 1, cv2.LINE_AA, 4)
        picture += veil * np.float32(0.35 / 255) * (60 - picture)


def box(
    picture: Picture, view: View, low: Sequence[float], high: Sequence[float], *, light: float, turn: float = 0.0
) -> None:
    """Fill the rectangle between two points (x, z) [m] of the plane of motion, turned left about its origin [rad]."""
    corners = np.array([[low[0], 0, low[1]], [high[0], 0, low[1]], [high[0], 0, high[1]], [low[0], 0, high[1]]])
    c, s = math.cos(turn), math.sin(turn)
    at, _ = view.project(corners @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    cv2.fillConvexPoly(picture, np.rint(at * 16).astype(np.int32), light, cv2.LINE_AA, 4)
