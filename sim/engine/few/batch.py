"""Fields and kernels for many small simulations (copies), each a serial loop, all in one launch.

Bodies, pairs and walls of all copies are stored one after another in the same fields; each copy has the indices of its
first ones.  A thread takes the next copy when it becomes free.  The result of a copy depends on its own numbers only,
so it is the same to the bit whatever other copies run.  The data of each copy begin on a new cache line, so that no two
threads write to the same line.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import Effect
from rigtwin.sim.engine import backend
from rigtwin.sim.engine.backend import GRAIN, ti
from rigtwin.sim.engine.contact import LAW_SIZE, Mechanics
from rigtwin.sim.engine.effect_terms import Active, Terms, terms_among
from rigtwin.sim.engine.few.step import (
    BODIES,
    BODY,
    CHANGES,
    COUNTS,
    CULPRIT,
    LEFT,
    PAIR,
    ROW,
    SAMPLE,
    SAMPLE_SIZE,
    STEPS,
    TIME,
    WALL,
    WALLS,
    Steps,
)
from rigtwin.sim.engine.walls.elements import ELEMENT_SIZE, OF_WALL
from rigtwin.sim.engine.walls.wall_contacts import WallContacts
from rigtwin.sim.engine.walls.wall_table import KINDS, MOTION_SIZE, WallTable

Integers = npt.NDArray[np.int32]

# number of copies in the smallest fields, and factor to the next size, so that few kernels are compiled.  With a power
# of two in either, the same elements of all fields would map to the same cache line and evict each other
COPIES, LARGER = 1000, 9
BODIES_A_COPY, PAIRS_A_COPY, WALLS_A_COPY, ELEMENTS_A_COPY, ENTRIES_A_COPY = 8, 16, 2, 4, 16
LINE, LINE_OF_LIST = 8, 16  # numbers of vectors, and of 4-byte numbers, that fill at least a cache line
THREADS_OF_A_BLOCK = 32  # on a GPU
LAUNCH = 0.2  # [s] per launch, so that progress and Ctrl-C are handled at least twice a second
FIRST_RATE = 1e6  # [1/s], initial estimate of the steps per second of all copies together
LEAST_STEPS, MOST_STEPS = 100, 50_000_000  # of a copy in a launch

# columns of a table of bodies: position 3, velocity 3, spin 3, radius, mass, inertia, pivot 3, length, kind
KIND = 16
BODY_SIZE = 17


@dataclass(frozen=True)
class Copy:
    """Data of one small simulation."""

    bodies: Array  # shape (n, 17)
    pairs: Array  # shape (n * n, LAW_SIZE + 1): law of each pair, and whether it has contact forces
    walls: WallTable
    times: Array  # [s]
    clock: Array  # shape (9,)
    changes: bool  # whether a wall moves or is removed
    effects: tuple[Active, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """Result of a copy."""

    samples: Array  # shape (times, bodies, 9); NaN after a break-down
    steps: int
    time: float  # [s], reached
    culprit: int = -1  # body whose velocity is not finite; -1: none


def run(copies: Sequence[Copy], mechanics: Mechanics, threads: int, tell: Callable[[float], None]) -> list[Outcome]:
    """Run copies that have the same effects; `tell` is called with the simulated time [s] of all of them together."""
    bench = _bench(tuple(one.effect for one in copies[0].effects), _room(copies))
    return bench.run(copies, mechanics, threads, tell)


def _room(copies: Sequence[Copy]) -> int:
    """Number of copies that the fields must hold."""
    needs = max(
        len(copies),
        sum(_whole_lines(len(copy.bodies) + 1, LINE) for copy in copies) / BODIES_A_COPY,
        sum(_whole_lines(len(copy.pairs), LINE) for copy in copies) / PAIRS_A_COPY,
        sum(len(copy.walls.motion) for copy in copies) / WALLS_A_COPY,
        sum(len(copy.walls.elements) for copy in copies) / ELEMENTS_A_COPY,
        sum(_whole_lines(len(copy.bodies) * len(copy.walls.elements), LINE_OF_LIST) for copy in copies)
        / ENTRIES_A_COPY,
    )
    room = COPIES
    while room < needs:
        room *= LARGER
    return room


def _whole_lines(size: int, line: int) -> int:
    return -(-size // line) * line


def _places(sizes: Sequence[int], line: int = 1) -> Integers:
    """Begin of each of these consecutive pieces, and the end of the last one."""
    return np.cumsum([0, *(_whole_lines(size, line) for size in sizes)], dtype=np.int32)


def _nearness(copies: Sequence[Copy], body_at: Integers, wall_at: Integers) -> tuple[Array, Integers, Integers]:
    """Elements of all walls, and the list of walls near each body: every element of every wall of its copy."""
    element_at = _places([len(copy.walls.elements) for copy in copies])
    entry_at = _places([len(copy.bodies) * len(copy.walls.elements) for copy in copies], LINE_OF_LIST)
    elements = np.concatenate([copy.walls.elements for copy in copies])
    elements[:, OF_WALL] += np.repeat(wall_at[:-1], np.diff(element_at))
    first, near = np.zeros(body_at[-1] + 1, dtype=np.int32), np.zeros(entry_at[-1], dtype=np.int32)
    for c, copy in enumerate(copies):
        n, parts = len(copy.bodies), len(copy.walls.elements)
        # padding bodies have the padding entries
        first[body_at[c] : body_at[c + 1] + 1] = entry_at[c + 1]
        first[body_at[c] : body_at[c] + n + 1] = entry_at[c] + np.arange(n + 1) * parts
        near[entry_at[c] : entry_at[c] + n * parts] = np.tile(element_at[c] + np.arange(parts), n)
    return elements, first, near


@cache
def _bench(effects: tuple[Effect, ...], room: int) -> "Bench":
    return Bench(terms_among(effects, "few bodies", room), room)


@ti.data_oriented
class Bench(Steps):
    """Fields and kernels for up to `room` copies; made once per process, after the backend has started."""

    def __init__(self, terms: Terms, room: int) -> None:
        self.room = room
        device = backend.running().device
        self.block = GRAIN if device == "cpu" else THREADS_OF_A_BLOCK
        self.grain = GRAIN if device == "cpu" else 1
        self.rate = FIRST_RATE
        bodies, pairs = BODIES_A_COPY * room, PAIRS_A_COPY * room
        Steps.__init__(self, bodies, pairs, terms)
        self.walls = WallContacts(
            bodies, ENTRIES_A_COPY * room, ELEMENTS_A_COPY * room, terms, walls=WALLS_A_COPY * room, threads=1
        )

    # ------------------------------------------------------------------ a run

    def run(
        self, copies: Sequence[Copy], mechanics: Mechanics, threads: int, tell: Callable[[float], None]
    ) -> list[Outcome]:
        """Load the copies and advance them to their last sample times."""
        counts = self.load(copies)
        clock = np.array([copy.clock for copy in copies])
        times = np.concatenate([copy.times for copy in copies])
        rows = _places([len(copy.times) * len(copy.bodies) for copy in copies])
        samples = np.full((rows[-1], SAMPLE_SIZE), np.nan)
        running = np.arange(len(copies), dtype=np.int32)
        while len(running):
            began, before = time.perf_counter(), clock[:, STEPS].sum()
            budget = int(np.clip(LAUNCH * self.rate / len(running), LEAST_STEPS, MOST_STEPS))
            workers = min(threads, len(running)) if self.grain > 1 else len(running)
            self._advance(
                running, np.zeros(1, dtype=np.int32), workers, budget, clock, counts, times, samples, mechanics
            )
            self.rate = max(1.0, clock[:, STEPS].sum() - before) / (time.perf_counter() - began)
            running = running[(counts[running, LEFT] > 0) & (counts[running, CULPRIT] < 0)]
            tell(float(clock[:, TIME].sum()))
        return [
            Outcome(
                samples[rows[c] : rows[c + 1]].reshape(-1, len(copy.bodies), SAMPLE_SIZE),
                int(clock[c, STEPS]),
                float(clock[c, TIME]),
                int(counts[c, CULPRIT]),
            )
            for c, copy in enumerate(copies)
        ]

    def load(self, copies: Sequence[Copy]) -> Integers:
        """Load the initial states of the copies; returns their counts."""
        counts = np.zeros((len(copies), COUNTS), dtype=np.int32)
        # one additional body, so that padding entries of a list do not belong to a body of a copy
        body_at = _places([len(copy.bodies) + 1 for copy in copies], LINE)
        pair_at = _places([len(copy.pairs) for copy in copies], LINE)
        wall_at = _places([len(copy.walls.motion) for copy in copies])
        bodies, pairs = np.zeros((body_at[-1], BODY_SIZE)), np.zeros((pair_at[-1], LAW_SIZE + 1))
        for c, copy in enumerate(copies):
            bodies[body_at[c] : body_at[c] + len(copy.bodies)] = copy.bodies
            pairs[pair_at[c] : pair_at[c] + len(copy.pairs)] = copy.pairs
        counts[:, BODY], counts[:, BODIES] = body_at[:-1], [len(copy.bodies) for copy in copies]
        counts[:, WALL], counts[:, WALLS] = wall_at[:-1], [len(copy.walls.motion) for copy in copies]
        counts[:, PAIR], counts[:, CHANGES] = pair_at[:-1], [copy.changes for copy in copies]
        counts[:, LEFT], counts[:, CULPRIT] = [len(copy.times) for copy in copies], -1
        counts[:, SAMPLE] = _places([len(copy.times) for copy in copies])[:-1]
        counts[:, ROW] = _places([len(copy.times) * len(copy.bodies) for copy in copies])[:-1]
        elements, first, near = _nearness(copies, body_at, wall_at)
        motion = np.concatenate([copy.walls.motion for copy in copies])
        law = np.concatenate([copy.walls.law for copy in copies], axis=1)
        of = np.repeat(np.arange(len(copies), dtype=np.int32), counts[:, WALLS])
        self.terms.load([copy.effects for copy in copies])
        self._load(bodies, pairs)
        self._load_walls(elements, motion, law, of, first, near)
        return counts

    # ------------------------------------------------------------------ data in

    @ti.kernel
    def _load(self, bodies: ti.types.ndarray(), pairs: ti.types.ndarray()):
        ti.loop_config(serialize=True)
        for _ in range(1):
            for i in range(bodies.shape[0]):
                self.position[i] = ti.Vector([bodies[i, 0], bodies[i, 1], bodies[i, 2]])
                self.velocity[i] = ti.Vector([bodies[i, 3], bodies[i, 4], bodies[i, 5]])
                self.spin[i] = ti.Vector([bodies[i, 6], bodies[i, 7], bodies[i, 8]])
                self.body[i] = ti.Vector([bodies[i, 9], bodies[i, 10], bodies[i, 11]])
                self.thread[i] = ti.Vector([bodies[i, 12], bodies[i, 13], bodies[i, 14], bodies[i, 15]])
                self.kind[i] = int(bodies[i, KIND])
                # the last run may have broken down here, and zero times NaN is NaN
                self.push[i] = ti.Vector([0.0, 0.0, 0.0])
                self.twist[i] = ti.Vector([0.0, 0.0, 0.0])
                self.brake[i] = 0.0
            for p in range(pairs.shape[0]):
                self.pair_slip[p] = ti.Vector([0.0, 0.0, 0.0])
                self.pair_roll[p] = ti.Vector([0.0, 0.0, 0.0])
                self.pair_meets[p] = int(pairs[p, LAW_SIZE])
                for k in ti.static(range(LAW_SIZE)):
                    self.pair_law[p][k] = pairs[p, k]
                if ti.static(self.terms.act_on_contacts):
                    self.impact[p] = -1.0

    @ti.kernel
    def _load_walls(
        self,
        elements: ti.types.ndarray(),
        motion: ti.types.ndarray(),
        law: ti.types.ndarray(),
        of: ti.types.ndarray(),
        first: ti.types.ndarray(),
        near: ti.types.ndarray(),
    ):
        """Load the walls.  The constants of contacts are computed when needed, as bodies may differ."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            for e in range(elements.shape[0]):
                for k in range(ELEMENT_SIZE):
                    self.walls.elements[e, k] = elements[e, k]
            for w in range(motion.shape[0]):
                self.walls.copy[w] = of[w]
                self.walls.listed_at[w] = 0.0
                for k in range(MOTION_SIZE):
                    self.walls.motion[w, k] = motion[w, k]
                for a in range(KINDS):
                    for k in ti.static(range(LAW_SIZE)):
                        self.walls.law[a, w][k] = law[a, w, k]
            for i in range(first.shape[0]):
                self.walls.first[0, i] = first[i]
            for q in range(near.shape[0]):
                self.walls.near[0, q] = near[q]
                self.walls.touching[0, q] = 0

    @ti.kernel
    def _advance(
        self,
        running: ti.types.ndarray(),
        taken: ti.types.ndarray(),
        workers: ti.i32,
        budget: ti.i32,
        clock: ti.types.ndarray(),
        counts: ti.types.ndarray(),
        times: ti.types.ndarray(),
        samples: ti.types.ndarray(),
        mechanics: ti.template(),
    ):
        """Each worker takes the next running copy until none is left; `taken` counts the copies taken."""
        ti.loop_config(block_dim=self.block)
        for worker in range(workers * self.grain):
            if worker % self.grain == 0:
                turn = ti.atomic_add(taken[0], 1)
                while turn < running.shape[0]:
                    self.advance_copy(running[turn], budget, clock, counts, times, samples, mechanics)
                    turn = ti.atomic_add(taken[0], 1)
