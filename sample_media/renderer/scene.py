"""A small ray caster for bench scenes: boxes, cylinders, spheres and a bench top under many soft lights.

World in millimetres: x to the right, y away from the camera, z up.  Colours are linear light.  Picture coordinates:
u to the right, v down, the centre of the top-left pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating]
Colour = Callable[[Floats], Floats]  # points in the body's own axes, shape (n, 3) -> albedo, shape (n, 3)

PASSES = 9  # one ray per pixel and pass, each pass with its own share of the lights


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels looking along +y, pitched and rolled by small angles."""

    position: tuple[float, float, float]  # [mm]
    focal: float  # [px]
    width: int  # [px]
    height: int  # [px]
    pitch: float = 0.0  # [rad], positive looks down
    roll: float = 0.0  # [rad], positive makes the scene look turned clockwise

    @property
    def axes(self) -> Floats:
        """Rows: picture right, picture down, forward, in the world."""
        c, s = np.cos(self.pitch), np.sin(self.pitch)
        right, down, forward = np.array([1.0, 0, 0]), np.array([0, -s, -c]), np.array([0, c, -s])
        cr, sr = np.cos(self.roll), np.sin(self.roll)
        return np.array([cr * right - sr * down, sr * right + cr * down, forward])

    @property
    def centre(self) -> tuple[float, float]:
        """Principal point [px]."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    def project(self, points: Floats) -> Floats:
        """World points [mm], shape (..., 3), to picture points [px], shape (..., 2)."""
        local = (np.asarray(points, dtype=float) - self.position) @ self.axes.T
        return local[..., :2] / local[..., 2:] * self.focal + np.array(self.centre)

    def rays(self, u: Floats, v: Floats) -> Floats:
        """Unit directions through picture points, shape (..., 3)."""
        local = np.stack(
            [(u - self.centre[0]) / self.focal, (v - self.centre[1]) / self.focal, np.ones_like(u)], axis=-1
        )
        local /= np.linalg.norm(local, axis=-1, keepdims=True)
        return (local @ self.axes).astype(np.float32)


@dataclass(frozen=True)
class Surface:
    """How a body answers to light: its colour, how it mirrors the room, how sharp its highlights are."""

    colour: Colour
    mirror: float = 0.0  # share of the room seen in it
    gloss: float = 0.03  # strength of highlights
    shine: float = 30.0  # sharpness of highlights


def plain(red: float, green: float, blue: float) -> Colour:
    """One albedo everywhere."""
    return lambda p: np.broadcast_to(np.array([red, green, blue], dtype=np.float32), (len(p), 3))


@dataclass(frozen=True)
class Body:
    """A body with its own axes (rows of `turn`, in the world) about `middle`."""

    middle: tuple[float, float, float]  # [mm]
    surface: Surface
    turn: Floats = field(default_factory=lambda: np.eye(3))
    behind: bool = False  # far out of focus: neither throws nor catches shadows
    casts: bool = True

    @property
    def reach(self) -> float:
        """Radius of a ball round `middle` that holds the body [mm]."""
        raise NotImplementedError

    def local(self, points: Floats) -> Floats:
        return ((points - np.array(self.middle, dtype=np.float32)) @ self.turn.T.astype(np.float32)).astype(np.float32)

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        """Distance along rays given in the body's own axes, inf where they miss."""
        raise NotImplementedError

    def normal(self, local: Floats) -> Floats:
        """Outward normals at points of the surface, both in the body's own axes."""
        raise NotImplementedError


@dataclass(frozen=True)
class Box(Body):
    """A box of three half edges."""

    half: tuple[float, float, float] = (1.0, 1.0, 1.0)  # [mm]

    @property
    def reach(self) -> float:
        return float(np.linalg.norm(self.half))

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        half = np.array(self.half, dtype=np.float32)
        safe = np.where(np.abs(direction) < 1e-9, np.float32(1e-9), direction)
        one, two = (-half - origin) / safe, (half - origin) / safe
        enter = np.minimum(one, two).max(axis=-1)
        leave = np.maximum(one, two).min(axis=-1)
        return np.where((enter <= leave) & (enter > 0), enter, np.inf)

    def normal(self, local: Floats) -> Floats:
        share = np.abs(local) / np.array(self.half, dtype=np.float32)
        face = share.argmax(axis=-1)
        normal = np.zeros_like(local)
        rows = np.arange(len(local))
        normal[rows, face] = np.sign(local[rows, face])
        return normal


@dataclass(frozen=True)
class Cylinder(Body):
    """A capped cylinder about its own z axis."""

    radius: float = 1.0  # [mm]
    half: float = 1.0  # [mm]

    @property
    def reach(self) -> float:
        return float(np.hypot(self.radius, self.half))

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        origin, direction = np.broadcast_arrays(origin, direction)
        ox, oy, oz = np.moveaxis(origin, -1, 0)
        dx, dy, dz = np.moveaxis(direction, -1, 0)
        a = dx * dx + dy * dy + np.float32(1e-12)
        b = ox * dx + oy * dy
        inside = b * b - a * (ox * ox + oy * oy - self.radius**2)
        side = (-b - np.sqrt(np.maximum(inside, 0))) / a
        side = np.where((inside > 0) & (side > 0) & (np.abs(oz + side * dz) <= self.half), side, np.inf)
        cap = (np.sign(oz) * self.half - oz) / np.where(np.abs(dz) < 1e-9, np.float32(1e-9), dz)
        on_cap = (cap > 0) & ((ox + cap * dx) ** 2 + (oy + cap * dy) ** 2 <= self.radius**2) & (np.abs(oz) > self.half)
        return np.minimum(side, np.where(on_cap, cap, np.inf))

    def normal(self, local: Floats) -> Floats:
        normal = local / self.radius
        normal[:, 2] = 0
        cap = np.abs(local[:, 2]) > self.half * 0.9999 - 1e-3
        normal[cap] = np.stack([np.zeros(cap.sum()), np.zeros(cap.sum()), np.sign(local[cap, 2])], axis=-1)
        return normal


@dataclass(frozen=True)
class Ball(Body):
    """A sphere."""

    radius: float = 1.0  # [mm]

    @property
    def reach(self) -> float:
        return self.radius

    def hit(self, origin: Floats, direction: Floats) -> Floats:
        b = np.sum(origin * direction, axis=-1)
        inside = b * b - np.sum(origin * origin, axis=-1) + self.radius**2
        t = -b - np.sqrt(np.maximum(inside, 0))
        return np.where((inside > 0) & (t > 0), t, np.inf)

    def normal(self, local: Floats) -> Floats:
        return local / self.radius


def along(axis: tuple[float, float, float]) -> Floats:
    """Axes of a body whose own z lies along `axis`."""
    z = np.array(axis, dtype=float) / np.linalg.norm(axis)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


@dataclass(frozen=True)
class Lights:
    """Many far lights; a lamp is a cluster of them, the room the rest."""

    direction: Floats  # unit, towards the light, shape (n, 3)
    radiance: Floats  # shape (n, 3), already divided by the number of lights of its lamp

    def share(self, k: int) -> Lights:
        """Every PASSES-th light, made brighter to stand for all."""
        return Lights(self.direction[k::PASSES], self.radiance[k::PASSES] * PASSES)


def room_lights(lamp: tuple[float, float, float], width: float, strength: float, seed: int) -> Lights:
    """A soft box towards `lamp` with half-angle `width` [rad], and a room brighter at the ceiling and the window."""
    rng = np.random.default_rng(seed)
    n = 4 * PASSES
    golden = np.pi * (3 - np.sqrt(5))
    k = np.arange(n)
    spread = np.sqrt((k + 0.5) / n) * np.tan(width)
    frame = along(lamp)
    cluster = frame[2] + spread[:, None] * (
        np.cos(golden * k)[:, None] * frame[0] + np.sin(golden * k)[:, None] * frame[1]
    )
    cluster /= np.linalg.norm(cluster, axis=1, keepdims=True)
    m = 8 * PASSES
    z = (np.arange(m) + 0.5) / m
    angle = golden * np.arange(m)
    dome = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)
    lamp_light = np.tile(np.array([1.0, 0.96, 0.90]) * strength / n, (n, 1))
    direction = np.concatenate([cluster, dome])
    radiance = np.concatenate([lamp_light, room(dome) * 1.9 / m])
    # each pass must see a fair sample of the lamp and of the room
    order = np.concatenate([rng.permutation(n).reshape(-1, PASSES), n + rng.permutation(m).reshape(-1, PASSES)]).ravel()
    return Lights(direction[order].astype(np.float32), radiance[order].astype(np.float32))


def room(direction: Floats) -> Floats:
    """Light of the room from a direction, shape (n, 3): bright ceiling, a window on the left, dark floor."""
    x, y, z = np.moveaxis(direction, -1, 0)
    ceiling = 0.20 + 0.45 * np.clip(z, 0, 1) - 0.12 * np.clip(-z, 0, 1)
    window = 1.5 * np.exp(-(((x + 0.85) / 0.22) ** 2) - ((z - 0.3) / 0.35) ** 2 - ((y + 0.3) / 0.6) ** 2)
    tube = 1.2 * np.exp(-(((x - 0.35) / 0.10) ** 2) - ((z - 0.75) / 0.2) ** 2)
    return (
        ceiling[..., None] * np.array([0.96, 0.99, 1.0])
        + window[..., None] * np.array([0.88, 0.96, 1.08])
        + tube[..., None] * np.array([1.0, 0.98, 0.93])
    )


Occluder = Callable[[Floats, Floats], npt.NDArray[np.bool_]]


@dataclass(frozen=True)
class Scene:
    """Bodies, lights, and an optional further thing that shades (a cloud of beads)."""

    bodies: tuple[Body, ...]
    lights: Lights
    shade: Occluder | None = None

    def trace(self, origin: Floats, direction: Floats) -> tuple[Floats, npt.NDArray[np.int_]]:
        """Distance to the nearest body and its number (-1: none) for rays from one point."""
        distance = np.full(len(direction), np.inf, dtype=np.float32)
        which = np.full(len(direction), -1)
        for number, body in enumerate(self.bodies):
            offset = np.array(body.middle) - origin
            ahead = direction @ offset.astype(np.float32)
            near = np.flatnonzero(offset @ offset - ahead * ahead < body.reach**2 * 1.001)
            if not len(near):
                continue
            turn = body.turn.astype(np.float32)
            t = body.hit(-(turn @ offset.astype(np.float32)), direction[near] @ turn.T)
            closer = t < distance[near]
            distance[near[closer]] = t[closer]
            which[near[closer]] = number
        return distance, which

    def lit(self, points: Floats, direction: Floats) -> npt.NDArray[np.bool_]:
        """Which points see the far light in `direction`."""
        free = np.ones(len(points), dtype=bool)
        if self.shade is not None:
            free &= ~self.shade(points, direction)
        for body in self.bodies:
            if body.behind or not body.casts:
                continue
            offset = np.array(body.middle, dtype=np.float32) - points
            ahead = offset @ direction
            apart = np.einsum("ij,ij->i", offset, offset) - ahead * ahead
            maybe = np.flatnonzero((apart < body.reach**2) & (ahead > -body.reach) & free)
            if len(maybe):
                turn = body.turn.astype(np.float32)
                free[maybe] &= ~np.isfinite(body.hit(-(offset[maybe] @ turn.T), turn @ direction))
        return free

    def shaded(self, points: Floats, normal: Floats, view: Floats, albedo: Floats, *, body: Body, k: int) -> Floats:
        """Light that leaves points of a body towards the camera in pass `k`."""
        lights, surface = self.lights.share(k), body.surface
        diffuse = np.zeros_like(points)
        highlight = np.zeros_like(points)
        start = points + normal * np.float32(0.02)
        for direction, radiance in zip(lights.direction, lights.radiance, strict=True):
            cosine = normal @ direction
            facing = np.flatnonzero(cosine > 0)
            if not len(facing):
                continue
            if not body.behind:
                facing = facing[self.lit(start[facing], direction)]
            diffuse[facing] += cosine[facing, None] * radiance
            half = direction - view[facing]
            half /= np.linalg.norm(half, axis=1, keepdims=True)
            lobe = np.clip(np.einsum("ij,ij->i", half, normal[facing]), 0, 1) ** surface.shine
            highlight[facing] += (lobe * surface.shine / 8)[:, None] * radiance
        # light that other surfaces throw back is never quite zero in a room
        out = albedo * (diffuse * (1 + 0.35 * albedo) + 0.10) + surface.gloss * highlight
        if surface.mirror:
            mirrored = view - 2 * np.einsum("ij,ij->i", view, normal)[:, None] * normal
            out += surface.mirror * room(mirrored).astype(np.float32)
        return out


@dataclass(frozen=True)
class Region:
    """Columns and rows of the picture that are wanted."""

    left: int
    top: int
    width: int
    height: int


def jitter(k: int) -> tuple[float, float]:
    """Where inside the pixel pass `k` looks: the same for all pixels, so a part of a picture equals the whole."""
    return (k % 3 - 1) / 3, (k // 3 - 1) / 3


def draw(scene: Scene, camera: Camera, region: Region) -> tuple[Floats, Floats]:
    """Linear light, shape (h, w, 3), and depth along the view [mm], shape (h, w)."""
    light = np.zeros((region.height * region.width, 3), dtype=np.float32)
    depth = np.full(region.height * region.width, np.inf, dtype=np.float32)
    u, v = np.meshgrid(
        np.arange(region.left, region.left + region.width, dtype=np.float32),
        np.arange(region.top, region.top + region.height, dtype=np.float32),
    )
    origin = np.array(camera.position)
    forward = camera.axes[2].astype(np.float32)
    for k in range(PASSES):
        du, dv = jitter(k)
        rays = camera.rays(u + du, v + dv).reshape(-1, 3)
        distance, which = scene.trace(origin, rays)
        # a pixel on an edge belongs to the nearer body, so that edges in focus stay sharp
        depth = np.minimum(depth, np.where(np.isfinite(distance), distance, 3000) * (rays @ forward))
        for number, body in enumerate(scene.bodies):
            mine = np.flatnonzero(which == number)
            if not len(mine):
                continue
            points = (origin + rays[mine] * distance[mine, None]).astype(np.float32)
            local = body.local(points)
            normal = (body.normal(local) @ body.turn).astype(np.float32)
            albedo = body.surface.colour(local).astype(np.float32)
            light[mine] += scene.shaded(points, normal, rays[mine], albedo, body=body, k=k) / PASSES
    return light.reshape(region.height, region.width, 3), depth.reshape(region.height, region.width)


def lens_blur(light: Floats, depth: Floats, focus: float, aperture: float) -> Floats:
    """Blur by depth: circle of confusion of radius aperture |z - focus| / z [px], far layers first."""
    confusion = (depth - focus) / np.maximum(depth, 1) * aperture
    centres = np.array([-6.0, -3, -1.5, 0, 0.8, 1.6, 3, 5, 8, 12])
    position = np.interp(confusion, centres, np.arange(len(centres)))
    out: Floats | None = None
    nearer = np.ones_like(depth)
    for k in range(len(centres) - 1, -1, -1):
        weight = np.clip(1 - np.abs(position - k), 0, 1).astype(np.float32)
        if weight.max() <= 0:
            continue
        kernel = _disc(abs(float(centres[k])))
        mass = cv2.filter2D(weight, -1, kernel)[..., None]
        colour = cv2.filter2D(light * weight[..., None], -1, kernel) / np.maximum(mass, 1e-4)
        cover = cv2.filter2D(nearer, -1, kernel)[..., None] * np.clip(mass * 50, 0, 1)
        out = colour if out is None else out * (1 - cover) + colour * cover
        nearer = np.clip(nearer - weight, 0, 1).astype(np.float32)
    assert out is not None
    return out


def _disc(radius: float) -> Floats:
    size = int(np.ceil(radius + 0.5))
    y, x = np.mgrid[-size : size + 1, -size : size + 1]
    disc = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1)
    if radius < 0.5:
        disc = (np.hypot(x, y) == 0).astype(float)
    return (disc / disc.sum()).astype(np.float32)
