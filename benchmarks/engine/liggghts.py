"""LIGGGHTS, where it is installed, on beads that our engine brought there: same places, materials, step and skin.

Hertz with tangential history; rolling friction cdt beside our type A, epsd2 beside our type C.  LIGGGHTS multiplies
mu_r by the effective radius, which between equal spheres is half of ours: its pair coefficient is doubled, that of
the walls stays.
"""

from __future__ import annotations

import os
import re
import shutil
import statistics
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import Row, machine
from rigtwin.lab.errors import RigtwinError
from rigtwin.lab.materials import Contact, Particle
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.decks.card import ROLLING
from rigtwin.sim.engine.contact import Rolling

LOOK = 0.05  # [s] between two looks at how its processes fare
TIME = re.compile(r"Loop time of (\S+) on \d+ procs? for (\d+) steps with (\d+) atoms")


@dataclass(frozen=True, kw_only=True)
class Peer:
    """What its every deck needs; the walls are of the beads' material."""

    particle: Particle
    between: Contact
    walls: Contact
    time_step: float  # [s]
    skin: float  # [m]
    gravity: float  # [m/s^2]


@dataclass(frozen=True, kw_only=True)
class Bed(Peer):
    """A box of equal beads, open at the top."""

    position: npt.NDArray[np.float64]  # [m], shape (n, 3)
    size: tuple[float, float, float]  # [m]

    def files(self, rolling: str, steps: int, warm_up: int) -> dict[str, str]:
        """What the program reads, by name; `in.run` is the deck."""
        x, y, z = self.size
        r = self.particle.radius
        data = _positions(self.particle, self.position, (-r, -r, -r), (x + r, y + r, z))
        deck = _deck(self, rolling, _box_walls(rolling, x, y), steps=steps, warm_up=warm_up)
        return {"beads.data": data, "in.run": deck}

    @property
    def spheres(self) -> int:
        """How many it must tell of."""
        return len(self.position)


@dataclass(frozen=True, kw_only=True)
class Clumps(Peer):
    """Equal clumps that it throws into a box itself: it takes no clumps from elsewhere."""

    count: int
    size: tuple[float, float, float]  # [m]

    def files(self, rolling: str, steps: int, warm_up: int) -> dict[str, str]:
        """What the program reads, by name; `in.run` is the deck."""
        x, y, z = self.size
        edge, clump = self.particle.diameter, self.particle.shape
        assert clump is not None
        spheres = [(*at, radius) for at, radius in zip(clump.offsets, clump.radii, strict=True)]
        inside = f"{edge / 2} {x - edge / 2} {edge / 2} {y - edge / 2} {edge / 2} {z - edge / 2}"
        box = f"region box block -{edge} {x + edge} -{edge} {y + edge} -{edge} {z} units box\ncreate_box 2 box\n"
        shape, mixed, thrown = 15_485_863, 15_485_867, 32_452_843  # it takes none but primes as seeds
        fill = (
            f"region inside block {inside} units box\n"
            f"fix clump all particletemplate/multisphere {shape} atom_type 1 density constant "
            f"{self.particle.effective_density} nspheres {len(spheres)} ntry 1000000 spheres file clump.txt scale 1 "
            "type 1\n"
            f"fix sizes all particledistribution/discrete {mixed} 1 clump 1.0\n"
            f"fix throw all insert/pack seed {thrown} distributiontemplate sizes maxattempt 1000 insert_every once "
            "overlapcheck yes orientation random all_in yes vel constant 0 0 -0.3 region inside "
            f"particles_in_region {self.count}\n"
        )
        walls = _box_walls(rolling, x, y) + fill
        deck = _deck(self, rolling, walls, box, "multisphere", steps=steps, warm_up=warm_up)
        return {"clump.txt": "\n".join(" ".join(map(str, sphere)) for sphere in spheres) + "\n", "in.run": deck}

    @property
    def spheres(self) -> int:
        """How many it must tell of."""
        return self.count * len(self.particle.radii)


def _box_walls(rolling: str, x: float, y: float) -> str:
    planes = {"x0": ("xplane", 0.0), "x1": ("xplane", x), "y0": ("yplane", 0.0), "y1": ("yplane", y)}
    planes["z0"] = ("zplane", 0.0)
    model = _model(rolling)
    return "".join(
        f"fix {name} all wall/gran {model} primitive type 2 {plane} {at}\n" for name, (plane, at) in planes.items()
    )


@dataclass(frozen=True, kw_only=True)
class Hopper(Peer):
    """Flowing beads in a mesh that turns about z."""

    position: npt.NDArray[np.float64]  # [m], shape (n, 3)
    velocity: npt.NDArray[np.float64]  # [m/s], shape (n, 3)
    corners: npt.NDArray[np.float64]  # [m], shape (triangles, 3, 3)
    period: float  # [s], of a turn
    reach: tuple[float, float, float]  # [m], of the domain: across, and its lower and upper end

    def files(self, rolling: str, steps: int, warm_up: int) -> dict[str, str]:
        """What the program reads, by name; `in.run` is the deck."""
        across, low, high = self.reach
        edge = across + self.particle.diameter
        data = _positions(self.particle, self.position, (-edge, -edge, low), (edge, edge, high), self.velocity)
        walls = (
            "fix shape all mesh/surface file walls.stl type 2\n"
            f"fix walls all wall/gran {_model(rolling)} mesh n_meshes 1 meshes shape\n"
            f"fix turning all move/mesh mesh shape rotate origin 0. 0. 0. axis 0. 0. 1. period {self.period}\n"
        )
        deck = _deck(self, rolling, walls, steps=steps, warm_up=warm_up)
        return {"beads.data": data, "walls.stl": stl(self.corners), "in.run": deck}

    @property
    def spheres(self) -> int:
        """How many it must tell of."""
        return len(self.position)


@dataclass(frozen=True)
class Scene:
    """Spheres of several kinds, without rolling friction, among walls of the last kind's material."""

    kinds: Sequence[Particle]
    contacts: Mapping[tuple[int, int], Contact]  # of kinds (a, b), a <= b
    kind: npt.NDArray[np.int64]  # shape (n,)
    position: npt.NDArray[np.float64]  # [m], shape (n, 3)
    velocity: npt.NDArray[np.float64]  # [m/s], shape (n, 3)
    walls: str  # commands
    files: Mapping[str, str]  # that the walls need, by name
    low: tuple[float, float, float]  # [m]
    high: tuple[float, float, float]  # [m]
    time_step: float  # [s]
    skin: float  # [m]

    def deck(self, steps: int, every: int) -> dict[str, str]:
        """What the program reads, by name; it writes places each `every` steps."""
        count = len(self.kinds)
        pairs = [(min(a, b), max(a, b)) for a in range(count) for b in range(count)]
        restitution, friction = (
            " ".join(str(getattr(self.contacts[pair], name)) for pair in pairs)
            for name in ("restitution", "static_friction")
        )
        moduli = " ".join(str(kind.material.youngs_modulus) for kind in self.kinds)
        ratios = " ".join(str(kind.material.poisson_ratio) for kind in self.kinds)
        bounds = [f"{a} {b} {axis}lo {axis}hi" for a, b, axis in zip(self.low, self.high, "xyz", strict=True)]
        head = ["spheres", "", f"{len(self.position)} atoms", f"{count} atom types", *bounds, "", "Atoms", ""]
        spheres = [self.kinds[k] for k in self.kind]
        rows = [
            f"{i} {k + 1} {sphere.diameter} {sphere.effective_density} {x!r} {y!r} {z!r}"
            for i, (k, sphere, (x, y, z)) in enumerate(zip(self.kind, spheres, self.position.tolist(), strict=True), 1)
        ]
        speeds = [f"{i} {x!r} {y!r} {z!r} 0 0 0" for i, (x, y, z) in enumerate(self.velocity.tolist(), 1)]
        stiffness = "soft" if min(kind.material.youngs_modulus for kind in self.kinds) < 5e6 else "hard"
        run = (
            # it refuses moduli above 1e9 Pa, or below 5e6, without the first line
            f"{stiffness}_particles yes\n"
            "atom_style granular\natom_modify map array\nboundary f f f\nnewton off\n"
            "communicate single vel yes\nunits si\nread_data spheres.data\n"
            f"neighbor {self.skin} bin\nneigh_modify delay 0\n"
            f"fix m1 all property/global youngsModulus peratomtype {moduli}\n"
            f"fix m2 all property/global poissonsRatio peratomtype {ratios}\n"
            f"fix m3 all property/global coefficientRestitution peratomtypepair {count} {restitution}\n"
            f"fix m4 all property/global coefficientFriction peratomtypepair {count} {friction}\n"
            f"pair_style gran {HERTZ}\npair_coeff * *\ntimestep {self.time_step!r}\n"
            f"fix weight all gravity {GRAVITY} vector 0 0 -1\n{self.walls.format(type=count)}"
            "fix move all nve/sphere\nthermo 100000\nthermo_modify lost ignore\n"
            f"dump look all custom {every} look.txt id x y z\n"
            # its default writes six digits
            'dump_modify look format "%d %20.15g %20.15g %20.15g"\n'
            f"run {steps}\n"
        )
        return {"spheres.data": "\n".join([*head, *rows, "", "Velocities", "", *speeds]) + "\n", "in.run": run}


HERTZ = "model hertz tangential history"


def mesh_wall() -> str:
    """Commands for walls of the triangles in walls.stl."""
    return (
        "fix shape all mesh/surface file walls.stl type {type}\n"
        f"fix walls all wall/gran {HERTZ} mesh n_meshes 1 meshes shape\n"
    )


def plane_walls(planes: Mapping[str, tuple[str, float]]) -> str:
    """Commands for planes across an axis, by name."""
    return "".join(
        f"fix {name} all wall/gran {HERTZ} primitive type {{type}} {plane} {at}\n"
        for name, (plane, at) in planes.items()
    )


def positions(scene: Scene, *, steps: int, every: int) -> list[npt.NDArray[np.float64]]:
    """Number (from 1) and place [m] of the spheres that are there, shape (n, 4): at first and each `every` steps."""
    frames = looks({**scene.deck(steps, every), **scene.files}).split("ITEM: TIMESTEP\n")[1:]
    found = []
    for frame in frames:
        rows = frame.split("ITEM: ATOMS id x y z")[1].split()
        found.append(np.array(rows, dtype=float).reshape(-1, 4))
    return found


def final_positions(bed: Bed, rolling: Rolling, steps: int) -> npt.NDArray[np.float64]:
    """Where the spheres are after `steps` [m], shape (n, 3)."""
    files = bed.files(ROLLING[rolling], steps, 0)
    files["in.run"] = f"dump look all custom {steps} look.txt id x y z\n".join(files["in.run"].rsplit("run 0\n", 1))
    last = looks(files).split("ITEM: ATOMS id x y z")[-1]
    return np.array(last.split(), dtype=float).reshape(-1, 4)[:, 1:]


def looks(files: Mapping[str, str]) -> str:
    """What it writes into look.txt when it runs in.run among these `files`."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text)
        done = subprocess.run(["liggghts", "-in", "in.run"], capture_output=True, text=True, check=False, cwd=folder)
        if done.returncode or "Loop time" not in done.stdout:
            last = (done.stdout + done.stderr).strip().splitlines()[-1:]
            raise RigtwinError(f"LIGGGHTS stopped with code {done.returncode}: {' '.join(last)}")
        return (Path(folder) / "look.txt").read_text()


def installed(threads: int) -> bool:
    """Whether LIGGGHTS, and for several threads mpirun, can be started here."""
    return shutil.which("liggghts") is not None and (threads == 1 or shutil.which("mpirun") is not None)


def version() -> str:
    """What the program calls itself."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            ["liggghts", "-log", "none"], input="", capture_output=True, text=True, check=False, cwd=folder, timeout=60
        )
    found = re.search(r"LIGGGHTS \(Version (\S+)", done.stdout)
    return found.group(1).rstrip(",") if found else "unknown"


def speed(
    bed: Bed | Hopper | Clumps, rolling: Rolling, *, threads: int, steps: int, warm_up: int
) -> tuple[float, float]:
    """Particle-steps per second of its own loop, start-up left out, and the part of the time that it had its cores.

    Ranks wait for each other in busy loops: on a machine that others use as well its figure falls far more than ours.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, text in bed.files(ROLLING[rolling], steps, warm_up).items():
            (Path(folder) / name).write_text(text)
        command = ["liggghts", "-in", "in.run"]
        if threads > 1:
            command = ["mpirun", "-np", str(threads), "--oversubscribe", *command]
        # mpirun refuses a container's only user without these
        environment = os.environ | {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        running = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder, env=environment
        )
        try:
            out, err, ran = _watched(running)
        finally:
            running.kill()  # of an interrupted benchmark nothing computes on
        share = sum(on for on, _ in ran.values()) / max(1, sum(on + waited for on, waited in ran.values()))
    times = TIME.findall(out)
    if running.returncode or not times:
        last = (out + err).strip().splitlines()[-1:]
        raise RigtwinError(f"LIGGGHTS stopped with code {running.returncode}: {' '.join(last)}")
    seconds, made, atoms = times[-1]
    if int(atoms) != bed.spheres:
        raise RigtwinError(f"LIGGGHTS ran {atoms} of {bed.spheres} spheres; they do not fit their box.")
    return int(made) * int(atoms) / float(seconds), share


def _watched(running: subprocess.Popen[str]) -> tuple[str, str, dict[int, tuple[int, int]]]:
    """What it said on stdout and stderr until it ended, and how its processes fared, as `_ranks` says."""
    ran: dict[int, tuple[int, int]] = {}
    while True:
        try:
            return *running.communicate(timeout=LOOK), ran
        except subprocess.TimeoutExpired:
            ran |= _ranks(running.pid)


def _ranks(parent: int) -> dict[int, tuple[int, int]]:
    """How long LIGGGHTS' processes, `parent` or its children, ran and waited for a core until now [ns]."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            name, rest = (folder / "stat").read_text().split("(", 1)[1].rsplit(")", 1)
            pid = int(folder.name)
            if name == "liggghts" and parent in (pid, int(rest.split()[1])):
                ran, waited, _ = map(int, (folder / "schedstat").read_text().split())
                found[pid] = ran, waited
        except (OSError, ValueError):  # it has ended meanwhile, or is no process
            continue
    return found


def beside(
    name: str, ours: list[float], theirs: list[float], wanted: float, alone: bool = True, more: str = ""
) -> list[Row]:
    """Rows of speeds, ours and LIGGGHTS', and of their ratio pair by pair; `alone`: whether the ratio may be judged."""
    unit = "M particle-steps/s"
    rows = [Row(f"{name}: rigtwin", statistics.median(ours) / 1e6, unit, note=_spread(ours, 1e6))]
    if theirs:
        ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
        rows.append(Row(f"{name}: LIGGGHTS", statistics.median(theirs) / 1e6, unit, note=_spread(theirs, 1e6)))
        ratio, limit = statistics.median(ratios), f"at least {wanted:g}, median of {len(ratios)} pairs"
        note = f"{_spread(ratios, 1)}; load average {machine()['load_average']}{more}"
        rows.append(Row(f"{name}: ratio", ratio, "1", None, limit, alone and ratio >= wanted, note))
    return rows


def _spread(values: list[float], scale: float) -> str:
    return f"{min(values) / scale:.2f} to {max(values) / scale:.2f}"


def _model(rolling: str) -> str:
    return f"model hertz tangential history rolling_friction {rolling}"


def _positions(
    particle: Particle,
    position: npt.NDArray[np.float64],
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    velocity: npt.NDArray[np.float64] | None = None,
) -> str:
    bounds = [f"{a} {b} {axis}lo {axis}hi" for a, b, axis in zip(low, high, "xyz", strict=True)]
    head = ["beads", "", f"{len(position)} atoms", "2 atom types", *bounds, "", "Atoms", ""]
    bead = f"1 {particle.diameter} {particle.effective_density}"
    rows = [f"{i} {bead} {a!r} {b!r} {c!r}" for i, (a, b, c) in enumerate(position.tolist(), 1)]
    if velocity is not None:
        rows += ["", "Velocities", ""]
        rows += [f"{i} {a!r} {b!r} {c!r} 0 0 0" for i, (a, b, c) in enumerate(velocity.tolist(), 1)]
    return "\n".join(head + rows) + "\n"


def stl(corners: npt.NDArray[np.float64]) -> str:
    rows = ["solid walls"]
    for triangle in corners.tolist():
        rows += ["facet normal 0 0 0", "outer loop", *(f"vertex {a} {b} {c}" for a, b, c in triangle)]
        rows += ["endloop", "endfacet"]
    return "\n".join([*rows, "endsolid walls"]) + "\n"


def _deck(
    run: Peer,
    rolling: str,
    walls: str,
    beads: str = "read_data beads.data\n",
    moved: str = "nve/sphere",
    *,
    steps: int,
    warm_up: int,
) -> str:
    material = run.particle.material

    def pairs(name: str, between: float, wall: float) -> str:
        return f"fix {name} all property/global {name} peratomtypepair 2 {between} {wall} {wall} {wall}\n"

    def each(name: str, value: float) -> str:
        return f"fix {name} all property/global {name} peratomtype {value} {value}\n"

    soft = "" if material.youngs_modulus >= 5e6 else "soft_particles yes\n"
    return (
        f"{soft}atom_style granular\natom_modify map array\nboundary f f f\nnewton off\n"
        # ranks side by side: one above the other they would share the beads badly
        f"communicate single vel yes\nunits si\nprocessors * * 1\n{beads}"
        f"neighbor {run.skin} bin\nneigh_modify delay 0\n"
        + each("youngsModulus", material.youngs_modulus)
        + each("poissonsRatio", material.poisson_ratio)
        + pairs("coefficientRestitution", run.between.restitution, run.walls.restitution)
        + pairs("coefficientFriction", run.between.static_friction, run.walls.static_friction)
        + pairs("coefficientRollingFriction", 2 * run.between.rolling_friction, run.walls.rolling_friction)
        + f"pair_style gran {_model(rolling)}\npair_coeff * *\ntimestep {run.time_step}\n"
        + f"fix weight all gravity {run.gravity} vector 0 0 -1\n"
        + walls
        + f"fix move all {moved}\nthermo_style custom step atoms ke\nthermo 100000\nthermo_modify lost error\n"
        + f"run {warm_up}\nrun {steps}\n"
    )
