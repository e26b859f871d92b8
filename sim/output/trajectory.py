"""Trajectory files for OVITO (GSD) or ParaView (temporal VTKHDF), and the walls as a mesh in a file beside them.

During a run the frames are in `<name>.part`, which is readable after every frame; closing renames the file.  Numbers
are float32, with a resolution of 1e-7 of the size of the rig.
"""

from __future__ import annotations

import errno
import io
import math
import os
import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.output_files import replacing

if TYPE_CHECKING:
    from rigtwin.sim.engine.bulk.particle_state import Beads
    from rigtwin.sim.engine.walls.shapes import Shape


AROUND = 72  # corners of a circle in the mesh of a round wall
CHUNK = 4096  # rows of a compressed block of a dataset


class Trajectory(ABC):
    """A file to which frames are added.

    Parameters
    ----------
    path : Path
        The file; its folder is made.
    frames : int
        Number of frames that it has already.
    """

    def __init__(self, path: Path, frames: int) -> None:
        self.path = path
        self.part = path.with_name(path.name + ".part")
        self.frames = frames
        self.broken = False  # a frame could not be written
        path.parent.mkdir(parents=True, exist_ok=True)

    def add(self, beads: Beads, time: float, step: int) -> None:
        """Add a frame.

        Parameters
        ----------
        beads : Beads
            Spheres at that time.
        time : float
            Time [s].
        step : int
            Number of steps so far.

        Raises
        ------
        OSError
            If it cannot be written; the error names the file.
        """
        with self._whole():
            self._append(beads, time, step)
            self.frames += 1

    @abstractmethod
    def _append(self, beads: Beads, time: float, step: int) -> None:
        """Write a frame to the disk."""

    @abstractmethod
    def _finish(self) -> None:
        """Write pending data and close the file."""

    def close(self) -> None:
        """Close the file and give it its final name; an existing file is replaced.

        A file that could not be written to its end is removed: its index does not fit what is in it.
        """
        if self.broken:
            with suppress(OSError, RuntimeError):
                self._finish()
            self.part.unlink(missing_ok=True)
            return
        try:
            with self._whole():
                self._finish()
        except OSError:
            self.part.unlink(missing_ok=True)
            raise
        self.part.replace(self.path)

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """Note that a frame could not be written; what a library raises then becomes an error that names the file."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            self.broken = True
            number = error.errno if isinstance(error, OSError) and error.errno else errno.ENOSPC
            raise OSError(number, os.strerror(number), str(self.path)) from error


def begin(path: Path, kinds: Sequence[str], domain: tuple[Array, Array], *, frames: int = 0) -> Trajectory:
    """Open a trajectory in the format of the suffix, .gsd or .vtkhdf.

    Parameters
    ----------
    path : Path
        Path of the trajectory.
    kinds : sequence of str
        Names of the kinds of particles.
    domain : tuple of ndarray
        Low and high corner [m] of the box that contains all of them.
    frames : int
        Number of its frames after which an existing file is continued; if there is none a new one begins.

    Returns
    -------
    Trajectory
        The open file.

    Raises
    ------
    BadInput
        If the suffix is unknown, or the file cannot be written or continued.
    """
    if path.suffix not in FORMATS:
        raise BadInput(f"trajectory: {path.name} has no known suffix; use .gsd (OVITO) or .vtkhdf (ParaView).")
    part = path.with_name(path.name + ".part")
    copied = frames > 0 and path.exists() and not part.exists()
    if copied:
        shutil.copyfile(path, part)
    if not frames or not part.exists():
        part.unlink(missing_ok=True)
        frames = 0
    try:
        return FORMATS[path.suffix](path, kinds, domain, frames)
    except (OSError, RuntimeError, KeyError, EOFError) as trouble:
        part.with_name(part.name + ".cut").unlink(missing_ok=True)
        if copied or not frames:  # what is left behind would be taken for that of an interrupted run
            part.unlink(missing_ok=True)
        broken = part if part.exists() else path
        raise BadInput(
            f"The trajectory {broken} cannot be written or continued ({trouble}); move it away or name another."
        ) from None


class _Gsd(Trajectory):
    """GSD in HOOMD's schema: position, velocity, diameter, mass, type, and as body the clump of a bead.

    Spin, number of each bead and time are logs.  The schema's box is centred on the origin; it is the smallest such box
    that contains the domain.
    """

    def __init__(self, path: Path, kinds: Sequence[str], domain: tuple[Array, Array], frames: int) -> None:
        import gsd.hoomd

        super().__init__(path, frames)
        self._frame = gsd.hoomd.Frame
        self._kinds = list(kinds)
        self._box = [*(2 * np.maximum(*np.abs(domain))), 0, 0, 0]
        if frames:
            self._cut(frames)
        self._file = gsd.hoomd.open(self.part, mode="r+" if frames else "w")

    def _cut(self, frames: int) -> None:
        import gsd.hoomd

        shorter = self.part.with_name(self.part.name + ".cut")
        with gsd.hoomd.open(self.part, mode="r") as old:
            _enough(len(old), frames)
            if len(old) == frames:
                return
            with gsd.hoomd.open(shorter, mode="w") as new:
                for k in range(frames):
                    new.append(old[k])
        shorter.replace(self.part)

    def _append(self, beads: Beads, time: float, step: int) -> None:
        frame = self._frame()
        frame.configuration.step = step
        frame.configuration.box = self._box
        frame.particles.N = len(beads.ident)
        frame.particles.types = self._kinds
        frame.particles.typeid = beads.kind
        frame.particles.position = beads.position
        frame.particles.velocity = beads.velocity
        frame.particles.diameter = 2 * beads.radius
        frame.particles.mass = beads.mass
        if beads.grain is not None:
            frame.particles.body = beads.grain
        frame.log["particles/spin"] = beads.spin.astype(np.float32)
        frame.log["particles/ident"] = beads.ident.astype(np.int32)
        frame.log["time_s"] = np.array([time])
        self._file.append(frame)
        self._file.flush()

    def _finish(self) -> None:
        self._file.close()


class _Disk(io.RawIOBase):
    """A file that HDF5 writes, with errors kept until they are asked for.

    HDF5 cannot close a file that it failed to write: the process ends with a segmentation fault.  After an error
    nothing more is written, HDF5 sees no error, and `check` raises the error.
    """

    def __init__(self, path: Path, *, keep: bool) -> None:
        self._file = path.open("r+b" if keep else "w+b", buffering=0)
        self._error: OSError | None = None
        self._place = self._end = 0

    def check(self) -> None:
        """Raise the first error of writing."""
        if self._error is not None:
            raise self._error

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        if self._error is None:
            self._place = self._file.seek(offset, whence)
            self._end = max(self._end, self._place)
        else:  # where HDF5 believes to be
            self._place = offset + (0, self._place, self._end)[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        self._file.seek(self._place)
        count = self._file.readinto(view) or 0
        view[count:] = bytes(len(view) - count)
        self._place += len(view)
        return len(view)

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        done = 0
        while self._error is None and done < len(view):
            try:
                done += self._file.write(view[done:]) or 0
            except OSError as error:
                self._error = error
        self._place += len(view)
        self._end = max(self._end, self._place)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        end = self._place if size is None else size
        if self._error is None:
            try:
                self._file.truncate(end)
            except OSError as error:
                self._error = error
        self._end = end
        return end

    def flush(self) -> None:
        """Nothing waits to be written."""

    def close(self) -> None:
        self._file.close()
        super().close()


class _VtkHdf(Trajectory):
    """Temporal VTKHDF, type PolyData: beads as points with radius, velocity, spin, ident, kind and grain.

    `grain` is the particle to which a bead belongs.  Every frame has one vertex cell per bead.  The numbering of the
    cells is the same in all frames, so that they share one table, as long as the largest frame.
    """

    DATA = (
        ("radius", 1),
        ("velocity", 3),
        ("spin", 3),
        ("ident", 0),
        ("kind", 0),
        ("grain", 0),
    )  # components; 0: a whole number

    def __init__(self, path: Path, kinds: Sequence[str], domain: tuple[Array, Array], frames: int) -> None:
        import h5py

        super().__init__(path, frames)
        self._disk = _Disk(self.part, keep=frames > 0)
        try:
            self._file: Any = h5py.File(self._disk, "r+" if frames else "w")
        except BaseException:
            self._disk.close()
            raise
        try:
            if frames:
                self._cut(frames)
            else:
                self._lay_out()
            self._file.flush()
            self._disk.check()
        except BaseException:
            self._file.close()
            self._disk.close()
            if not frames:
                self.part.unlink(missing_ok=True)
            raise

    def _lay_out(self) -> None:
        root = self._file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 1], dtype=np.int64)
        root.attrs.create("Type", np.bytes_("PolyData"))
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(0)
        _growing(root, "Points", np.float32, 3, packed=True)
        _growing(root, "NumberOfPoints", np.int64)
        for cells in ("Vertices", "Lines", "Polygons", "Strips"):
            group = root.create_group(cells)
            for name in ("NumberOfCells", "NumberOfConnectivityIds", "Offsets", "Connectivity"):
                _growing(group, name, np.int64)
            # the reader needs the first offset even of an empty table
            _append(group["Offsets"], np.zeros(1, dtype=np.int64))
        _growing(steps, "Values", np.float64)
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            _growing(steps, name, np.int64)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            _growing(steps, name, np.int64, 4)
        data, offsets = root.create_group("PointData"), steps.create_group("PointDataOffsets")
        for name, components in self.DATA:
            dtype = np.float32 if components else np.int32
            _growing(data, name, dtype, components if components > 1 else 0, packed=True)
            _growing(offsets, name, np.int64)

    def _cut(self, frames: int) -> None:
        root = self._file["VTKHDF"]
        steps = root["Steps"]
        _enough(int(steps.attrs["NSteps"]), frames)
        points = int(root["NumberOfPoints"][:frames].sum())
        steps.attrs["NSteps"] = np.int64(frames)
        for group in (steps, steps["PointDataOffsets"]):
            for dataset in group.values():
                if hasattr(dataset, "shape"):
                    dataset.resize(frames, axis=0)
        for dataset in (root["Points"], *root["PointData"].values()):
            dataset.resize(points, axis=0)
        root["NumberOfPoints"].resize(frames, axis=0)
        for cells in ("Vertices", "Lines", "Polygons", "Strips"):
            for name in ("NumberOfCells", "NumberOfConnectivityIds"):
                root[cells][name].resize(frames, axis=0)

    def _append(self, beads: Beads, time: float, step: int) -> None:
        root = self._file["VTKHDF"]
        steps = root["Steps"]
        count, before = len(beads.ident), len(root["Points"])
        _append(root["Points"], beads.position)
        _append(root["NumberOfPoints"], [count])
        for cells in ("Vertices", "Lines", "Polygons", "Strips"):
            for name in ("NumberOfCells", "NumberOfConnectivityIds"):
                _append(root[cells][name], [count if cells == "Vertices" else 0])
        known = len(root["Vertices"]["Connectivity"])
        _append(root["Vertices"]["Connectivity"], np.arange(known, count))
        _append(root["Vertices"]["Offsets"], np.arange(known, count) + 1)
        _append(steps["Values"], [time])
        _append(steps["PartOffsets"], [self.frames])
        _append(steps["NumberOfParts"], [1])
        _append(steps["PointOffsets"], [before])
        _append(steps["CellOffsets"], [[0, 0, 0, 0]])
        _append(steps["ConnectivityIdOffsets"], [[0, 0, 0, 0]])
        for name, _components in self.DATA:
            rows = beads.ident if name == "grain" and beads.grain is None else getattr(beads, name)
            _append(root["PointData"][name], rows)
            _append(steps["PointDataOffsets"][name], [before])
        steps.attrs["NSteps"] = np.int64(self.frames + 1)
        self._file.flush()
        self._disk.check()

    def _finish(self) -> None:
        self._file.close()
        self._disk.close()
        self._disk.check()


FORMATS: dict[str, type[_Gsd | _VtkHdf]] = {".gsd": _Gsd, ".vtkhdf": _VtkHdf}


def _enough(there: int, wanted: int) -> None:
    if there < wanted:
        raise EOFError(f"it holds {there} of the {wanted} frames of the checkpoint")


def _growing(group: Any, name: str, dtype: npt.DTypeLike, components: int = 0, *, packed: bool = False) -> None:
    more = (components,) if components else ()
    packing: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if packed else {}
    rows = CHUNK if packed else 256
    group.create_dataset(name, shape=(0, *more), maxshape=(None, *more), dtype=dtype, chunks=(rows, *more), **packing)


def _append(dataset: Any, rows: npt.ArrayLike) -> None:
    rows = np.asarray(rows)
    dataset.resize(len(dataset) + len(rows), axis=0)
    if len(rows):
        dataset[-len(rows) :] = rows


# ---------------------------------------------------------------------- walls


def write_walls(path: Path, shapes: Sequence[Shape], domain: tuple[Array, Array]) -> None:
    """Write the walls as a mesh of triangles in VTK's legacy text format, which OVITO and ParaView read.

    Each triangle has the number of its wall as cell data.

    Parameters
    ----------
    path : Path
        Path of the .vtk file.
    shapes : sequence of Shape
        Shapes of the walls.
    domain : tuple of ndarray
        Low and high corner [m], to which an infinite plane is cut.
    """
    meshes = [triangles(shape, domain) for shape in shapes]
    corners = np.concatenate([mesh.reshape(-1, 3) for mesh in meshes]) if meshes else np.zeros((0, 3))
    count = len(corners) // 3
    wall = np.repeat(np.arange(len(meshes)), [len(mesh) for mesh in meshes])
    lines = ["# vtk DataFile Version 3.0", "walls, lengths in metres", "ASCII", "DATASET POLYDATA"]
    lines += [f"POINTS {len(corners)} double", *(f"{x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners)]
    lines += [f"POLYGONS {count} {4 * count}", *(f"3 {3 * k} {3 * k + 1} {3 * k + 2}" for k in range(count))]
    lines += [f"CELL_DATA {count}", "SCALARS wall int 1", "LOOKUP_TABLE default", *map(str, wall), ""]
    with replacing(path) as part:
        part.write_text("\n".join(lines), encoding="ascii")


def triangles(shape: Shape, domain: tuple[Array, Array]) -> Array:
    """Return the triangles of a wall.

    Parameters
    ----------
    shape : Shape
        Shape of the wall.
    domain : tuple of ndarray
        Low and high corner [m], to which a plane is cut.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Corners of the triangles [m].
    """
    from rigtwin.sim.engine.walls import elements
    from rigtwin.sim.engine.walls.shapes import Plane

    if isinstance(shape, Plane):
        return _fan(_cut_plane(np.array(shape.point), np.array(shape.normal), domain))
    rows = shape.rows
    if rows[0, elements.KIND] == elements.TRIANGLE:
        return rows[:, elements.POINT :].reshape(-1, 3, 3)
    return _turned_line(
        rows[0, elements.POINT : elements.AXIS], rows[0, elements.AXIS : elements.LOW_RADIUS],
        *rows[0, elements.LOW_RADIUS :],
    )  # fmt: skip


def _turned_line(point: Array, axis: Array, radius: float, far_radius: float, height: float) -> Array:
    """Triangles of a surface of revolution of a straight line; at a tip one triangle instead of two."""
    one, other = _circle(point, axis, radius), _circle(point + height * axis, axis, far_radius)
    one_next, other_next = np.roll(one, -1, axis=0), np.roll(other, -1, axis=0)
    parts = []
    if radius > 0:
        parts.append(np.stack([one, one_next, other], 1))
    if far_radius > 0:
        parts.append(np.stack([one_next, other_next, other], 1))
    return np.concatenate(parts)


def _fan(corners: Array) -> Array:
    first = np.broadcast_to(corners[0], (max(0, len(corners) - 2), 3)) if len(corners) else corners
    return np.stack([first, corners[1:-1], corners[2:]], axis=1)


def _circle(centre: Array, normal: Array, radius: float) -> Array:
    one, other = _across(normal)
    angle = np.arange(AROUND)[:, None] * 2 * math.pi / AROUND
    return centre + radius * (np.cos(angle) * one + np.sin(angle) * other)


def _cut_plane(point: Array, normal: Array, domain: tuple[Array, Array]) -> Array:
    """Points where the plane cuts the edges of the box, in order around it."""
    bits = np.array([[k >> axis & 1 for axis in range(3)] for k in range(8)])
    box = np.where(bits, domain[1], domain[0])
    side = (box - point) @ normal
    found = []
    for a in range(8):
        for b in range(a + 1, 8):
            if abs(bits[a] - bits[b]).sum() == 1 and side[a] * side[b] <= 0 and side[a] != side[b]:
                found.append(box[a] + side[a] / (side[a] - side[b]) * (box[b] - box[a]))
    if not found:
        return np.zeros((0, 3))
    corners = np.unique(np.round(found, 12), axis=0)
    one, other = _across(normal)
    out = corners - corners.mean(axis=0)
    return np.asarray(corners[np.argsort(np.arctan2(out @ other, out @ one))])


def _across(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors perpendicular to `normal` and to each other."""
    normal = normal / np.linalg.norm(normal)
    one = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    one /= np.linalg.norm(one)
    return one, np.cross(normal, one)
