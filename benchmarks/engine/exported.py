"""What LIGGGHTS makes of exported parameters: how rolling slows down, and how high a bead bounces."""

from __future__ import annotations

import math

import numpy as np

from rigtwin.benchmarks.engine import liggghts
from rigtwin.benchmarks.figures import Row, against, skipped, small
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import GRAVITY
from rigtwin.sim.decks.card import ROLLING, Export, export

SPEED, SPIN, DROP = 0.1, 50.0, 0.02  # [m/s], [rad/s], [m]
LOAD = 0.1  # [N], that presses two spheres together
FRACTION = small(0.02, 0.1)  # of Rayleigh's step
TITLE = "exported to LIGGGHTS"


def exported() -> list[Row]:
    """Deceleration of a rolling bead, torque between two that are pressed together, rebound from a plate."""
    if not liggghts.installed(1):
        return [skipped(TITLE, "liggghts is not installed")]
    d6, steel = hlosta2020.particle("D6"), hlosta2020.material("steel")
    among, against_wall = hlosta2020.contact("D6", "D6"), hlosta2020.contact("D6", "steel")
    # several of our laws may be one of theirs, and their decks are the same then
    laws = {theirs: [ours for ours, name in ROLLING.items() if name == theirs] for theirs in ROLLING.values()}
    slowing = 5 / 7 * against_wall.rolling_friction * GRAVITY
    rows = []
    for theirs, ours in laws.items():
        made = export("liggghts", d6, steel, among, against_wall, rolling=ours[0], time_step_fraction=FRACTION)
        name, limit = f"{TITLE}, {' and '.join(ours)} as {theirs}", among.rolling_friction
        rows += [
            against(f"{name}: rolling on steel, slowing", _rolling(made), slowing, relative=0.01, unit="m/s2"),
            against(f"{name}: torque limit between two beads, over F_n R", _pressed(made), limit, relative=0.01),
        ]
    rows.append(against(f"{TITLE}: restitution on steel", _bounce(made), against_wall.restitution, absolute=0.005))
    return rows


def _rolling(made: Export) -> float:
    """[m/s^2], of a bead that rolls on the plate without sliding."""
    radius = made.particle.radius
    start = f"0 0 {radius!r} {SPEED} 0 0 0 {SPEED / radius!r} 0"
    every = round(0.01 / made.time_step)
    late = _run(made, [start], "vx", steps=10 * every, every=every, floor=True)[3:]  # it has settled on the plate
    return float(-np.polyfit(np.arange(len(late)) * every * made.time_step, late, 1)[0])


def _pressed(made: Export) -> float:
    """Torque over F_n R [1] of two beads held at a distance, which turn like gears, so that nothing slides."""
    bead = made.particle
    stiffness = bead.material.youngs_modulus / (2 * (1 - bead.material.poisson_ratio**2))
    overlap = (LOAD / (4 / 3 * stiffness * math.sqrt(bead.radius / 2))) ** (2 / 3)
    apart = 2 * bead.radius - overlap
    start = [f"{-apart / 2!r} 0 0.05 0 0 0 0 {SPIN} 0", f"{apart / 2!r} 0 0.05 0 0 0 0 {-SPIN} 0"]
    steps = round(2e-4 / made.time_step)  # a third of the time in which they stop
    every = steps // 4
    spin = _run(made, start, "omegay", steps=4 * every, every=every, held=True)[2:]  # the spring is taut by then
    inertia = 0.4 * bead.mass * bead.radius**2
    return float((spin[0] - spin[-1]) / (2 * every * made.time_step) * inertia / (LOAD * bead.radius))


def _bounce(made: Export) -> float:
    """Restitution [1] of a bead dropped on the plate."""
    radius = made.particle.radius
    fall = math.sqrt(2 * DROP / GRAVITY)
    steps = round(1.2 * fall / made.time_step)
    looks = _run(made, [f"0 0 {radius + DROP!r} 0 0 0 0 0 0"], "vz", steps=steps, every=1, floor=True)
    return float(-looks.max() / looks.min())


def _run(
    made: Export,
    spheres: list[str],
    watched: str,
    *,
    steps: int,
    every: int,
    floor: bool = False,
    held: bool = False,
) -> np.ndarray:
    """What is watched of the first sphere each `every` steps; a sphere is its place, velocity and spin."""
    bead = made.particle
    lines = [sphere.split() for sphere in spheres]
    atoms = [f"{i} 1 {bead.diameter!r} {bead.effective_density!r} {' '.join(s[:3])}" for i, s in enumerate(lines, 1)]
    moving = [f"{i} {' '.join(s[3:])}" for i, s in enumerate(lines, 1)]
    data = ["beads", "", f"{len(lines)} atoms", "2 atom types", "-1 1 xlo xhi", "-1 1 ylo yhi", "-0.1 1 zlo zhi"]
    data += ["", "Atoms", "", *atoms, "", "Velocities", "", *moving]
    model = f"model hertz tangential history rolling_friction {liggghts.ROLLING[made.rolling]}"
    deck = (
        "atom_style granular\natom_modify map array\nboundary f f f\nnewton off\ncommunicate single vel yes\n"
        "units si\nread_data beads.data\nneighbor 0.002 bin\nneigh_modify delay 0\ninclude exported.in\n"
        + (f"fix floor all wall/gran {model} primitive type 2 zplane 0.0\n" if floor else "")
        + ("" if held else f"fix weight all gravity {GRAVITY} vector 0 0 -1\n")
        + "fix move all nve/sphere\n"
        + ("fix hold all setforce 0 0 0\n" if held else "")
        + f"thermo 1000000\ndump look all custom {every} look.txt id {watched}\n"
        'dump_modify look format "%d %20.15g"\n'
        f"run {steps}\n"
    )
    output = liggghts.looks({"beads.data": "\n".join(data) + "\n", "exported.in": made.text, "in.run": deck})
    frames = output.split(f"ITEM: ATOMS id {watched}")[1:]
    rows = (line.split() for frame in frames for line in frame.split("ITEM:")[0].splitlines())
    return np.array([float(row[1]) for row in rows if row and row[0] == "1"])
