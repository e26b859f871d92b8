"""A scene of boxes, spheres and cylinders for `films.py`, drawn by VTK: what stands still once, what moves per frame.

World: x to the right, y away from the camera, z up, in metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import textures
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

Floats = npt.NDArray[np.float64]

GAMMA = 2.2
# light by display value; and what that of a pixel at a border, whose value is the mean of body and nothing, is to be
# multiplied by so that it is the body's light times its share of the pixel
LINEAR = (np.arange(256, dtype=np.float32) / 255) ** np.float32(GAMMA)
BORDER = np.concatenate([[0], (np.arange(1, 256) / 255) ** (1 - GAMMA)]).astype(np.float32)
ROUND = 48  # facets of a round body around its axis


@dataclass
class Camera:
    """A pinhole camera; `size` is width and height [px]."""

    size: tuple[int, int]
    place: Floats
    target: Floats
    roll: float  # [deg], positive where the scene appears turned counter-clockwise
    focal: float  # [px]

    def axes(self) -> Floats:
        """Rows: right, down, forward."""
        forward = (self.target - self.place) / np.linalg.norm(self.target - self.place)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        cos, sin = np.cos(np.radians(self.roll)), np.sin(np.radians(self.roll))
        return np.array([cos * right - sin * up, -(sin * right + cos * up), forward])

    def pixel(self, point: Sequence[float] | Floats) -> Floats:
        """Picture point of a point of the world; the middle of the first pixel is (0, 0)."""
        across, down, away = self.axes() @ (np.asarray(point, dtype=float) - self.place)
        return (np.array(self.size) - 1) / 2 + self.focal * np.array([across, down]) / away

    def vtk(self) -> Any:
        made = vtk.vtkCamera()
        made.SetPosition(*self.place)
        made.SetFocalPoint(*self.target)
        made.SetViewUp(*-self.axes()[1])
        made.SetViewAngle(float(np.degrees(2 * np.arctan(self.size[1] / 2 / self.focal))))
        made.SetClippingRange(0.05, 20.0)
        return made


@dataclass
class Stage:
    """Two sets of bodies: `still` is behind all that moves."""

    rng: np.random.Generator
    camera: Camera
    still: Any = field(default_factory=vtk.vtkRenderer)
    moving: Any = field(default_factory=vtk.vtkRenderer)

    def __post_init__(self) -> None:
        rng = self.rng
        self._window = vtk.vtkRenderWindow()
        self._window.SetOffScreenRendering(1)
        self._window.SetAlphaBitPlanes(1)
        self._window.SetMultiSamples(4)
        self._window.SetSize(*self.camera.size)
        lamps = []
        for _ in range(rng.integers(1, 4)):
            lamp = vtk.vtkLight()
            lamp.SetLightTypeToSceneLight()
            lamp.SetPosition(rng.uniform(-3, 3), rng.uniform(-4, -0.5), rng.uniform(0.5, 4))
            lamp.SetIntensity(float(rng.uniform(0.3, 0.9)))
            lamp.SetColor(*(1 - rng.uniform(0, 0.2, 3)))
            lamps.append(lamp)
        for renderer in (self.still, self.moving):
            renderer.SetActiveCamera(self.camera.vtk())
            renderer.AutomaticLightCreationOff()
            for lamp in lamps:
                renderer.AddLight(lamp)
        self.still.SetBackground(*textures.colour(rng).clip(0, 1))

    def look(self, actor: Any, tint: Floats | None = None, *, shine: float | None = None) -> None:
        """Colour and finish of a body."""
        rng = self.rng
        surface = actor.GetProperty()
        surface.SetColor(*(textures.colour(rng) if tint is None else tint).clip(0, 1))
        surface.SetAmbient(float(rng.uniform(0.15, 0.4)))
        surface.SetDiffuse(float(rng.uniform(0.5, 0.9)))
        surface.SetSpecular(float(rng.uniform(0, 0.8) if shine is None else shine))
        surface.SetSpecularPower(float(np.exp(rng.uniform(1, 4.5))))

    def _add(self, source: Any, *, moving: bool, **look: Any) -> Any:
        mapper = vtk.vtkPolyDataMapper()
        mapper.SetInputConnection(source.GetOutputPort())
        actor = vtk.vtkActor()
        actor.SetMapper(mapper)
        self.look(actor, **look)
        (self.moving if moving else self.still).AddActor(actor)
        return actor

    def box(self, low: Sequence[float], high: Sequence[float], *, moving: bool = False, **look: Any) -> Any:
        source = vtk.vtkCubeSource()
        source.SetBounds(*(value for pair in zip(low, high, strict=True) for value in pair))
        return self._add(source, moving=moving, **look)

    def ball(self, radius: float, *, moving: bool = True, **look: Any) -> Any:
        source = vtk.vtkSphereSource()
        source.SetRadius(radius)
        source.SetThetaResolution(ROUND)
        source.SetPhiResolution(ROUND)
        return self._add(source, moving=moving, **look)

    def rod(
        self, start: Sequence[float], end: Sequence[float], radius: float, *, moving: bool = False, **look: Any
    ) -> Any:
        line = vtk.vtkLineSource()
        line.SetPoint1(*start)
        line.SetPoint2(*end)
        tube = vtk.vtkTubeFilter()
        tube.SetInputConnection(line.GetOutputPort())
        tube.SetRadius(radius)
        tube.SetNumberOfSides(ROUND // 2)
        tube.CappingOn()
        actor = self._add(tube, moving=moving, **look)
        actor.line = line  # to move its ends
        return actor

    def picture(self, corner: Sequence[float], right: Sequence[float], up: Sequence[float], values: Floats) -> Any:
        """A rectangle that shows `values`, shape (rows, columns, 3), from its lower left corner on."""
        plane = vtk.vtkPlaneSource()
        plane.SetOrigin(*corner)
        plane.SetPoint1(*np.add(corner, right))
        plane.SetPoint2(*np.add(corner, up))
        actor = self._add(plane, moving=False, tint=np.ones(3), shine=0.0)
        grey = np.ascontiguousarray(np.asarray(values)[::-1] * 255).astype(np.uint8)
        data = vtk.vtkImageData()
        data.SetDimensions(grey.shape[1], grey.shape[0], 1)
        data.GetPointData().SetScalars(numpy_to_vtk(grey.reshape(-1, 3), deep=True))
        texture = vtk.vtkTexture()
        texture.SetInputDataObject(data)
        texture.InterpolateOn()
        texture.MipmapOn()
        actor.SetTexture(texture)
        return actor

    def room(self, depth: float, level: float, reach: float) -> None:
        """A table at `level` and a wall `depth` behind the rig, with things before it; `reach` is half the view."""
        rng = self.rng
        wide = 3 * reach + depth
        self.picture((-wide, depth, -wide), (2 * wide, 0, 0), (0, 0, 2 * wide), textures.texture(rng))
        self.box((-wide, -0.3, level - 0.03), (wide, depth, level))
        for _ in range(rng.integers(0, 7)):
            x, size = rng.uniform(-1.3, 1.3) * reach, reach * rng.uniform(0.08, 0.4, 3)
            far = rng.uniform(0.4, 1.0) * depth
            if rng.random() < 0.6:
                self.box((x, far - 0.02, level), (x + size[0], far, level + 2 * size[2]))
            else:
                self.rod((x, far, level), (x, far, level + 2 * size[2]), 0.5 * size[0])

    def _drawn(self, renderer: Any) -> npt.NDArray[np.uint8]:
        """RGBA, shape (rows, columns, 4)."""
        self._window.AddRenderer(renderer)
        self._window.Render()
        grab = vtk.vtkWindowToImageFilter()
        grab.SetInput(self._window)
        grab.SetInputBufferTypeToRGBA()
        grab.ReadFrontBufferOff()
        grab.ShouldRerenderOff()
        grab.Update()
        seen = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
        self._window.RemoveRenderer(renderer)
        return np.asarray(seen.reshape(self.camera.size[1], self.camera.size[0], 4)[::-1])

    def behind(self, blur: float) -> npt.NDArray[np.float32]:
        """What stands still, as linear light, out of focus by `blur` [px]."""
        light = LINEAR[self._drawn(self.still)[..., :3]]
        return np.asarray(cv2.GaussianBlur(light, (0, 0), blur) if blur > 0.2 else light)

    def before(self) -> npt.NDArray[np.float32]:
        """What moves, as linear light times its share of the pixel, and that share."""
        self.moving.SetBackground(0, 0, 0)
        self.moving.SetBackgroundAlpha(0)
        seen = self._drawn(self.moving)
        share = seen[..., 3:]
        return np.concatenate([LINEAR[seen[..., :3]] * BORDER[share], share / np.float32(255)], axis=2)
