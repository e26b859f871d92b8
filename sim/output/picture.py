"""Pictures of runs: shaded spheres and walls in parallel projection, drawn with NumPy."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rigtwin.lab.arrays import Array, Image
from rigtwin.lab.errors import BadInput
from rigtwin.lab.records import Track
from rigtwin.lab.units import positive

LIGHT = np.array([-0.4, 0.6, 0.7]) / math.sqrt(1.01)  # direction to the light: upper left, in front of the image plane
AMBIENT = 0.35
PAPER = 255
BEAD_COLOUR = (205, 160, 105)
WALL_COLOUR = (165, 175, 190)
WALL_VEIL = 0.45  # opacity of walls
MARGIN = 0.04


def draw(
    centres: Array,
    radii: Array,
    *,
    walls: Array | None = None,
    width: int = 640,
    height: int = 480,
    turn: float = 30.0,
    tilt: float = 20.0,
    colours: Array | None = None,
) -> Image:
    """Draw spheres and walls, scaled to show all of them.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres of the spheres [m], z up.
    radii : ndarray, shape (n,)
        Their radii [m].
    walls : ndarray, shape (m, 3, 3), optional
        Triangles [m], as of `rigtwin.sim.output.trajectory.triangles`.
    width, height : int
        Size of the image [px].
    turn : float
        Direction of view [deg]: along y, rotated about z.
    tilt : float
        Height of the view above the horizon [deg].
    colours : ndarray, shape (n, 3), optional
        RGB of each sphere, 0 to 255.

    Returns
    -------
    Image, shape (height, width, 3)
        RGB image.

    Raises
    ------
    BadInput
        If there is nothing to draw, or width or height is not positive.
    """
    positive(width=width, height=height)
    centres, radii = np.asarray(centres, dtype=float).reshape(-1, 3), np.broadcast_to(radii, len(centres))
    walls = np.zeros((0, 3, 3)) if walls is None else walls
    if not (len(centres) or len(walls)):
        raise BadInput("picture: there is nothing to draw, neither a bead nor a wall.")
    axes = _axes(turn, tilt)
    seen, corners = centres @ axes.T, walls @ axes.T
    scale, shift = _fit(seen, radii, corners.reshape(-1, 3), width, height)
    tints = np.broadcast_to(BEAD_COLOUR if colours is None else colours, (len(centres), 3))

    image = np.full((height, width, 3), float(PAPER))
    depth = np.full((height, width), -np.inf)
    for k in np.argsort(-seen[:, 2]):  # nearest first, so that hidden spheres are not shaded
        _sphere(image, depth, seen[k] * scale + shift, radii[k] * scale, tints[k])
    for triangle in corners * scale + shift:
        _veil(image, depth, triangle)
    return np.asarray(np.clip(np.rint(image), 0, 255), dtype=np.uint8)


def strobe(
    tracks: Sequence[Track],
    radii: Array | Sequence[float],
    offsets: Array | Sequence[Sequence[float]] = ((0.0, 0.0, 0.0),),
    *,
    walls: Array | None = None,
    flashes: int = 40,
) -> Image:
    """Draw bodies that do not rotate at several times; later flashes are darker.

    Parameters
    ----------
    tracks : sequence of Track
        Paths of the bodies, in x and y.
    radii : ndarray, shape (n,)
        Radii of the spheres of which each body consists [m].
    offsets : ndarray, shape (n, 3)
        Their centres from the centre of the body [m], z up.
    walls : ndarray, shape (m, 3, 3), optional
        Triangles [m] as for `draw`, with y into the image; see `slab`.
    flashes : int
        Number of times over the longest track.

    Returns
    -------
    Image
        RGB image.
    """
    lasts = max(float(np.ptp(track.time)) for track in tracks)
    centres, shades = [], []
    for track in tracks:
        at = np.arange(track.time[0], track.time[-1] + 0.5 * lasts / flashes, lasts / flashes)
        across, up = (np.interp(at, track.time, track.position[:, axis]) for axis in (0, 1))
        centres.append(np.stack([across, np.zeros(len(at)), up], axis=1))
        shades.append(1.0 - 0.5 * (at - at[0])[:, None] / max(lasts, 1e-9) * np.ones(3))
    tint = np.concatenate(shades) * np.array(BEAD_COLOUR)
    place = (np.concatenate(centres) + np.asarray(offsets, dtype=float)[:, None]).reshape(-1, 3)  # by sphere and flash
    each = len(tint)
    return draw(
        place, np.repeat(radii, each), walls=walls, turn=0.0, tilt=0.0, colours=np.tile(tint, (len(offsets), 1))
    )


def slab(low: Sequence[float], high: Sequence[float], *, turned: float = 0.0) -> Array:
    """Return the front view of a plate as two triangles.

    Parameters
    ----------
    low, high : sequence of float
        Opposite corners (right, up) [m].
    turned : float
        Angle [rad] by which the plate is rotated about the origin, anticlockwise in the image.

    Returns
    -------
    ndarray, shape (2, 3, 3)
        The triangles [m].

    Examples
    --------
    >>> slab((0, 0), (2, 1)).shape
    (2, 3, 3)
    """
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1])], dtype=float)
    turn = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
    corners = np.insert(corners @ turn.T, 1, 0.0, axis=1)
    return corners[[[0, 1, 2], [0, 2, 3]]]


def _axes(turn: float, tilt: float) -> Array:
    """Unit vectors to the right, up and towards the viewer, as rows."""
    a, b = math.radians(turn), math.radians(tilt)
    right = [math.cos(a), math.sin(a), 0.0]
    towards = [math.sin(a) * math.cos(b), -math.cos(a) * math.cos(b), math.sin(b)]
    return np.array([right, np.cross(towards, right), towards])


def _fit(seen: Array, radii: Array, corners: Array, width: int, height: int) -> tuple[float, Array]:
    """Pixels per metre, and the shift that centres the scene in the image."""
    low = np.concatenate([seen - radii[:, None], corners])[:, :2].min(axis=0)
    high = np.concatenate([seen + radii[:, None], corners])[:, :2].max(axis=0)
    room = np.array([width, height]) * (1 - 2 * MARGIN)
    scale = float(np.min(room / np.maximum(high - low, 1e-12)))
    middle = (low + high) / 2 * scale
    return scale, np.array([width / 2 - middle[0], height / 2 - middle[1], 0.0])


def _patch(depth: Array, low: Array, high: Array) -> tuple[slice, slice, Array, Array] | None:
    """Pixels from `low` to `high` (x, y; y up) as slices, with their centres; None outside the image."""
    rows, columns = depth.shape
    left, right = max(0, math.floor(low[0])), min(columns, math.ceil(high[0]))
    bottom, top = max(0, math.floor(low[1])), min(rows, math.ceil(high[1]))
    if left >= right or bottom >= top:
        return None
    x = np.arange(left, right) + 0.5
    y = np.arange(top - 1, bottom - 1, -1)[:, None] + 0.5
    return slice(rows - top, rows - bottom), slice(left, right), x, y


def _sphere(image: Array, depth: Array, centre: Array, radius: float, tint: Array) -> None:
    patch = _patch(depth, centre - radius, centre + radius)
    if patch is None:
        return
    rows, columns, x, y = patch
    across, up = (x - centre[0]) / radius, (y - centre[1]) / radius
    out2 = 1 - across**2 - up**2
    out = np.sqrt(np.maximum(out2, 0.0))
    surface = centre[2] + radius * out
    shown = (out2 > 0) & (surface > depth[rows, columns])
    shade = AMBIENT + (1 - AMBIENT) * np.maximum(0.0, across * LIGHT[0] + up * LIGHT[1] + out * LIGHT[2])
    image[rows, columns][shown] = (shade[..., None] * tint)[shown]
    depth[rows, columns][shown] = surface[shown]


def _veil(image: Array, depth: Array, triangle: Array) -> None:
    """Draw a translucent wall: in front of beads it dims them, behind beads it shows between them."""
    patch = _patch(depth, triangle.min(axis=0), triangle.max(axis=0))
    (x0, y0, z0), one, other = triangle[0], triangle[1] - triangle[0], triangle[2] - triangle[0]
    twice = one[0] * other[1] - one[1] * other[0]
    if patch is None or abs(twice) < 1e-9:  # seen edge-on
        return
    rows, columns, x, y = patch
    a = ((x - x0) * other[1] - (y - y0) * other[0]) / twice
    b = (one[0] * (y - y0) - one[1] * (x - x0)) / twice
    # flat pieces of a round wall cut slightly into beads in contact with it; tolerance of one pixel
    before = z0 + a * one[2] + b * other[2] + 1 > depth[rows, columns]
    # half-open edges, so that neighbours do not draw their common pixels twice
    shown = (a >= 0) & (b > 0) & (a + b <= 1) & before
    view = image[rows, columns]
    view[shown] += WALL_VEIL * (np.array(WALL_COLOUR) - view[shown])
