"""Estimate the run time on one core: the longest runs start first, and the remaining time can be shown."""

from __future__ import annotations

import math

from rigtwin.compare.reproduce import paper_runs
from rigtwin.lab.reference import hlosta2020

START = 5.0  # [s], compilation of the kernels
BODY, SPHERE = 0.22e-6, 0.035e-6  # [s], cost of a time step for each body and for each of its spheres
STEP = 0.3  # time step over the Rayleigh time step
FALLING = 0.7  # average share of the bodies that are present while a rig is filled or drained


def seconds(particle: str, count: float, lasts: float, *, stiffness_factor: float = hlosta2020.SOFTENING) -> float:
    """Run time [s] of a simulation of `count` particles over `lasts` [s] of simulated time."""
    bead = hlosta2020.particle(particle)
    step = STEP * bead.rayleigh_time_step / math.sqrt(stiffness_factor)
    # the neighbour list of a long clump grows with the volume of its bounding sphere over that of the clump
    neighbours = math.pi / 6 * bead.diameter**3 / bead.volume
    return START + lasts / step * count * (BODY + SPHERE * len(bead.radii) * neighbours)


def of_pile(particle: str, base_diameter: float, count: int | None = None) -> float:
    """Run time [s] of a pile; without a `count` the surplus falls over the rim and is removed."""
    bead = hlosta2020.particle(particle)
    if count is None:
        poured = paper_runs.piled_count(base_diameter, paper_runs.RIM, bead.mass / bead.effective_density)
        there = 0.5 * poured
    else:
        poured, there = count, FALLING * count
    return seconds(particle, there, 2 + poured / paper_runs.pour_rate(bead, base_diameter))


def of_bed(particle: str, count: int) -> float:
    """Run time [s] of a bed in the cylinder."""
    return seconds(particle, FALLING * count, 4)


def of_drum(particle: str, speed: float) -> float:
    """Run time [s] of the drum at `speed` [rad/s]."""
    bead = hlosta2020.particle(particle)
    count = (
        math.pi
        / 4
        * paper_runs.DRUM**2
        * paper_runs.DEPTH
        * paper_runs.FILL
        * paper_runs.PACKED
        * bead.effective_density
        / bead.mass
    )
    return seconds(particle, count, 1 + paper_runs.TURNS * 2 * math.pi / speed)


def of_discharge(particle: str, count: int, empties_in: float) -> float:
    """Run time [s] of a hopper that is empty after `empties_in` [s]."""
    return seconds(particle, FALLING * count, 2 + empties_in)


def of_flow(count: int, shear_modulus: float) -> float:
    """Run time [s] of the conical hopper at a shear modulus [Pa]; it is empty long before the end."""
    factor = shear_modulus / hlosta2020.particle("D6").material.shear_modulus
    return seconds("D6", 0.4 * count, 6, stiffness_factor=factor)
