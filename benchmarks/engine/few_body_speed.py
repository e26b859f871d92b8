"""Speed of the few-body path: a million steps of one drop, and hundreds of drops in one launch."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np

from rigtwin.benchmarks.figures import Row, machine, small
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.rigs import Drop
from rigtwin.sim import drop
from rigtwin.sim.engine.few import few_body
from rigtwin.sim.engine.few.few_body import Body, Case
from rigtwin.sim.engine.walls.shapes import Plane, Wall

ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
FRAME_RATE = 240.0  # [1/s]
PAIRS = small(3, 1)
TIMED = small(1.0, 0.01)  # [s], that one bead moves


def drop_rows() -> list[Row]:
    """A million steps of one bead in free fall and of one that rubs on a floor."""
    rows = []
    floor = [Wall(Plane((0, 0, 0), (0, 0, 1)), ASH, Contact(0.42, 0.36, 0.06))]
    bead = Particle("D6", ASH, 6e-3, density=569)
    starts = {
        "falls": Body(bead, (0, 0, 10.0)),
        "slides on a floor": Body(bead, (0, 0, bead.radius), velocity=(10.0, 0, 0)),
    }
    for name, body in starts.items():
        took = []
        for _ in range(4):  # the first compiles
            began = time.perf_counter()
            motion = few_body.run([body], np.array([TIMED]), walls=floor, step=1e-6, flight_step=1e-6)
            took.append((time.perf_counter() - began) * 1e6 / motion.steps)
        best = min(took[1:])
        note = f"best of 3, load average {machine()['load_average']}"
        rows.append(Row(f"1e6 steps of a bead that {name}", best, "s", None, "below 0.3", best < 0.3, note))
    return rows


def many_rows(drops: int, twins: int, threads: Sequence[int], seed: int) -> list[Row]:
    """Drops of different beads, heights and restitutions: in one launch and one launch after the other."""
    rng = np.random.default_rng(seed)
    trials = [_trial(rng) for _ in range(drops)]
    rows = [row for count in threads for row in _rows(trials, trials[:twins], count)]
    return [*rows, *([_shared(trials, max(threads))] if max(threads) > 1 else [])]


def _shared(trials: Sequence[drop.Trial], threads: int) -> Row:
    """One launch on all threads beside the same on one, by the clock."""
    cases = [_case(trial) for trial in trials]
    ratios = []
    for _ in range(PAIRS):
        alone = _took(time.perf_counter, lambda: few_body.run_many(cases, threads=1))
        ratios.append(alone / _took(time.perf_counter, lambda: few_body.run_many(cases, threads=threads)))
    return _ratio(f"{len(cases)} drops in one launch: {threads} threads over 1", ratios)


def _rows(trials: Sequence[drop.Trial], halved: Sequence[drop.Trial], threads: int) -> list[Row]:
    """One thread is timed by the computing time of the process, two by the clock."""
    cases = [_case(trial) for trial in trials]
    clock = time.process_time if threads == 1 else time.perf_counter
    alone, together, ratios = [], [], []
    for _ in range(PAIRS):
        alone.append(_speed(clock, lambda: [few_body.run_many([case], threads=threads)[0] for case in cases]))
        together.append(_speed(clock, lambda: few_body.run_many(cases, threads=threads)))
        one_by_one = _took(clock, lambda: [drop.run_many([trial], threads=threads) for trial in halved])
        ratios.append(one_by_one / _took(clock, lambda: drop.run_many(halved, threads=threads)))
    by = f"{threads} thread{'s' if threads > 1 else ''}"
    return [
        Row(f"{len(cases)} drops, {by}: one launch after the other", statistics.median(alone), "particle-steps/s"),
        Row(f"{len(cases)} drops, {by}: one launch", statistics.median(together), "particle-steps/s"),
        _ratio(f"{len(cases)} drops, {by}: ratio", [one / other for one, other in zip(together, alone, strict=True)]),
        _ratio(f"{len(halved)} twins of a drop, steps halved, {by}: ratio", ratios),
    ]


def _ratio(name: str, ratios: Sequence[float]) -> Row:
    middle = statistics.median(ratios)
    note = f"{min(ratios):.2f} to {max(ratios):.2f}, load average {machine()['load_average']}"
    return Row(name, middle, "1", None, "above 1", middle > 1, note)


def _trial(rng: np.random.Generator) -> drop.Trial:
    bead = Particle("bead", ASH, rng.uniform(3e-3, 12e-3), density=569)
    contact = Contact(rng.uniform(0.2, 0.9), 0.36, 0.06)
    return drop.Trial(Drop(rng.uniform(0.1, 0.5)), bead, STEEL, contact, FRAME_RATE, duration=0.5)


def _case(trial: drop.Trial) -> Case:
    start = (0.0, 0.0, trial.rig.drop_height + trial.particle.radius)
    floor = Wall(Plane((0, 0, 0), (0, 0, 1)), trial.wall, trial.contact)
    return Case([Body(trial.particle, start)], np.arange(1, 121) / FRAME_RATE, walls=[floor])


def _took(clock: Callable[[], float], work: Callable[[], object]) -> float:
    began = clock()
    work()
    return clock() - began


def _speed(clock: Callable[[], float], work: Callable[[], Sequence[object]]) -> float:
    """Steps per second."""
    began = clock()
    steps = sum(motion.steps for motion in work() if isinstance(motion, few_body.Motion))
    return steps / (clock() - began)
