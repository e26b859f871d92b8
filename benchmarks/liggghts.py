"""LIGGGHTS, where it is installed, on a bed that our engine settled: same positions, materials, step and skin.

Hertz with tangential history; rolling friction cdt beside our type A, epsd2 beside our type C.  LIGGGHTS multiplies
mu_r by the effective radius, which between equal spheres is half of ours: its pair coefficient is doubled, that of
the walls stays.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.lab.errors import RigtwinError
from rigtwin.lab.materials import Contact, Particle
from rigtwin.sim.engine.contact import Rolling

ROLLING: dict[Rolling, str] = {"type A": "cdt", "type C": "epsd2"}
TIME = re.compile(r"Loop time of (\S+) on \d+ procs? for (\d+) steps with (\d+) atoms")


@dataclass(frozen=True)
class Bed:
    """A box of equal beads, open at the top."""

    particle: Particle
    between: Contact
    walls: Contact  # of the five planes, made of the beads' material
    position: npt.NDArray[np.float64]  # [m], shape (n, 3)
    size: tuple[float, float, float]  # [m]
    time_step: float  # [s]
    skin: float  # [m]
    gravity: float  # [m/s^2]


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


def speed(bed: Bed, rolling: Rolling, *, threads: int, steps: int, warm_up: int) -> tuple[float, float]:
    """Particle-steps per second of its own loop time, start-up left out, and the part of its cores that it got.

    Ranks wait for each other in busy loops: on a machine that others use as well its figure falls far more than ours.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bed.data").write_text(_positions(bed))
        (Path(folder) / "in.bed").write_text(_deck(bed, ROLLING[rolling], steps=steps, warm_up=warm_up))
        command = ["liggghts", "-in", "in.bed"]
        if threads > 1:
            command = ["mpirun", "-np", str(threads), "--oversubscribe", *command]
        # mpirun refuses a container's only user without these
        environment = os.environ | {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        before, began = _child_seconds(), time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, env=environment)
        share = (_child_seconds() - before) / (time.perf_counter() - began) / threads
    times = TIME.findall(done.stdout)
    if done.returncode or not times:
        last = (done.stdout + done.stderr).strip().splitlines()[-1:]
        raise RigtwinError(f"LIGGGHTS stopped with code {done.returncode}: {' '.join(last)}")
    seconds, made, atoms = times[-1]
    if int(atoms) != len(bed.position):
        raise RigtwinError(f"LIGGGHTS ran {atoms} of {len(bed.position)} beads; the bed does not fit its box.")
    return int(made) * int(atoms) / float(seconds), share


def _child_seconds() -> float:
    used = os.times()
    return used.children_user + used.children_system


def _positions(bed: Bed) -> str:
    x, y, z = bed.size
    r = bed.particle.radius
    head = [
        "settled bed",
        "",
        f"{len(bed.position)} atoms",
        "2 atom types",
        f"{-r} {x + r} xlo xhi",
        f"{-r} {y + r} ylo yhi",
        f"{-r} {z} zlo zhi",
        "",
        "Atoms",
        "",
    ]
    bead = f"1 {bed.particle.diameter} {bed.particle.effective_density}"
    rows = [f"{i} {bead} {a!r} {b!r} {c!r}" for i, (a, b, c) in enumerate(bed.position.tolist(), 1)]
    return "\n".join(head + rows) + "\n"


def _deck(bed: Bed, rolling: str, *, steps: int, warm_up: int) -> str:
    material = bed.particle.material
    model = f"model hertz tangential history rolling_friction {rolling}"
    x, y, _ = bed.size

    def pairs(name: str, between: float, wall: float) -> str:
        return f"fix {name} all property/global {name} peratomtypepair 2 {between} {wall} {wall} {wall}\n"

    def each(name: str, value: float) -> str:
        return f"fix {name} all property/global {name} peratomtype {value} {value}\n"

    planes = {"x0": ("xplane", 0.0), "x1": ("xplane", x), "y0": ("yplane", 0.0), "y1": ("yplane", y)}
    planes["z0"] = ("zplane", 0.0)
    soft = "" if material.youngs_modulus >= 5e6 else "soft_particles yes\n"
    return (
        f"{soft}atom_style granular\natom_modify map array\nboundary f f f\nnewton off\n"
        # ranks side by side: one above the other they would share the beads badly
        "communicate single vel yes\nunits si\nprocessors * * 1\nread_data bed.data\n"
        f"neighbor {bed.skin} bin\nneigh_modify delay 0\n"
        + each("youngsModulus", material.youngs_modulus)
        + each("poissonsRatio", material.poisson_ratio)
        + pairs("coefficientRestitution", bed.between.restitution, bed.walls.restitution)
        + pairs("coefficientFriction", bed.between.static_friction, bed.walls.static_friction)
        + pairs("coefficientRollingFriction", 2 * bed.between.rolling_friction, bed.walls.rolling_friction)
        + f"pair_style gran {model}\npair_coeff * *\ntimestep {bed.time_step}\n"
        + f"fix weight all gravity {bed.gravity} vector 0 0 -1\n"
        + "".join(
            f"fix {name} all wall/gran {model} primitive type 2 {plane} {at}\n" for name, (plane, at) in planes.items()
        )
        + "fix move all nve/sphere\nthermo_style custom step atoms ke\nthermo 100000\nthermo_modify lost error\n"
        + f"run {warm_up}\nrun {steps}\n"
    )
