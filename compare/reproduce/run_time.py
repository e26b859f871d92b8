"""Estimate the run time on one core: the longest runs start first, and the remaining time can be shown."""

from __future__ import annotations

import math

from rigtwin.compare.reproduce import paper_runs
from rigtwin.compare.twins import run_cost
from rigtwin.lab.reference import hlosta2020

FALLING = 0.7  # average share of the bodies that are present while a rig is filled or drained


def seconds(particle: str, count: float, lasts: float, *, stiffness_factor: float = hlosta2020.SOFTENING) -> float:
    """Run time [s] of a simulation of `count` particles over `lasts` [s] of simulated time."""
    return run_cost.seconds(hlosta2020.particle(particle), count, lasts, stiffness_factor=stiffness_factor)


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
