"""Thread team: threads that make many steps in one launch, each on its own contiguous stretch of the list.

A launch costs more than a step of few beads.  The threads therefore stay in one launch and synchronise within it, by
counters of the parts of a step that each has finished.  A stretch is contiguous in memory, and so in space.  Only its
first beads, `start` to `own`, have pairs that earlier stretches own; the other beads are not accessed by other threads
and move as soon as their pairs are done.  The results do not depend on where the stretches end, to the bit.

Threads can synchronise only while they run at the same time.  If a thread does not start, no step is made.  If a thread
waits too long in total, because other processes use the cores, all threads stop after a step.  The caller then
continues with one thread.
"""

import time

import numpy as np
import numpy.typing as npt

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.walls.wall_contacts import THREADS

LINE = 32  # numbers in a thread's row, so that two threads never share a cache line
# columns: polls while waiting, since last read; parts of steps finished; step after which the list must be rebuilt;
# step after which the thread had waited too long
WAITED, PARTS, LEFT_AT, LATE_AT = range(4)
GATHERED, DISBANDED = 1, 2
UNTIL_GATHERED = 200_000  # polls of another thread, after which the team is given up
PATIENCE = 1_500_000  # polls in one launch, after which it ends
LOOK = (
    2e-8  # [s], approximate duration of a poll; an error of a factor of two only delays the balancing of the stretches
)
ALONE = 0.05, 10.0  # [s], single-threaded period after a thread had no core of its own: first and longest
LEAST_SHARE, WATCHED = 0.6, 0.05  # least share of its cores that a team must get, over a period [s]


@ti.data_oriented
class Team:
    """Part of an arena that synchronises threads."""

    def __init__(self, parts: int) -> None:
        """`parts` is the number of synchronised parts of a step."""
        self.parts = parts
        self.desk = ti.field(ti.i32, (THREADS, LINE))
        self.gathering = ti.field(ti.i32, ())
        self.shares = ti.field(ti.f64, THREADS + 1)  # begins of the stretches, as fractions of the list

    @ti.func
    def clear_desks(self):
        self.gathering[None] = 0
        for w, c in ti.ndrange(THREADS, (PARTS, LATE_AT + 1)):
            self.desk[w, c] = 0

    @ti.func
    def gather_team(self, w, team):
        """Wait for all threads to start; 1 if they did."""
        ti.atomic_add(self.desk[w, PARTS], 1)
        if w == 0:
            looks = 0
            for v in range(1, team):
                # an atomic read, which the compiler cannot move out of the loop
                while ti.atomic_add(self.desk[v, PARTS], 0) == 0 and looks < UNTIL_GATHERED:
                    looks += 1
            outcome = GATHERED
            if looks >= UNTIL_GATHERED:
                outcome = DISBANDED
            ti.atomic_add(self.gathering[None], outcome)
        else:
            # the first thread runs or has run, as iterations of a loop are handed out in order
            while ti.atomic_add(self.gathering[None], 0) == 0:
                pass
        return int(ti.atomic_add(self.gathering[None], 0) == GATHERED)

    @ti.func
    def tell(self, w):
        """Signal that thread `w` has finished a part of a step; its writes are then visible to the others."""
        ti.atomic_add(self.desk[w, PARTS], 1)

    @ti.func
    def wait(self, begin, end, parts):
        """Wait until threads `begin` to `end` - 1 have finished over `parts` parts; returns the number of polls."""
        looks = 0
        for v in range(begin, end):
            while ti.atomic_add(self.desk[v, PARTS], 0) <= parts:
                looks += 1
        return looks

    @ti.func
    def anybody(self, column: ti.template(), team, done):
        """1 if a thread has set this mark after step `done`; threads that are further on can only have later marks."""
        found = 0
        for v in range(team):
            found |= int(self.desk[v, column] == done and done > 0)
        return found


class Crew:
    """Number of threads of the launches of one simulation, and the stretch of the list of each."""

    def __init__(self, threads: int) -> None:
        self._most = min(threads, THREADS)
        self._alone_until, self._alone_for = 0.0, ALONE[0]  # [s], end and length of a single-threaded period
        self._ran = self._used = 0.0  # [s], wall time, and processor time per core, since the last evaluation
        self._shares = np.ones(1)  # of the list
        self._of: Team | None = None  # arena that has these shares
        self._compiled = False  # the first launch compiles, on one core, and is not evaluated

    def gather(self, team: Team, threads: int) -> int:
        """Number of threads of the next launch, at most `threads`; one in a single-threaded period."""
        threads = 1 if time.perf_counter() < self._alone_until else max(1, min(threads, self._most))
        if threads > 1 and (len(self._shares) != threads or team is not self._of):
            self._hand_out(team, np.ones(threads))
        return threads

    def watch(self, team: Team, threads: int, took: float, used: float, *, late: bool) -> None:
        """Evaluate a launch of several threads: wall time `took` [s] and total processor time `used` [s]."""
        if self._compiled:
            self._ran += took
            self._used += used / threads
        self._compiled = True
        if late or (self._ran > WATCHED and self._used < LEAST_SHARE * self._ran):
            self._alone_until = time.perf_counter() + self._alone_for
            self._alone_for = min(2 * self._alone_for, ALONE[1])
            if self._ran > 0 and self._used >= LEAST_SHARE * self._ran:
                self._share_out(team, threads)  # the cores were available, so the stretches were uneven
        elif self._ran > WATCHED:
            self._alone_for = ALONE[0]
            self._share_out(team, threads)
        else:
            return
        self._ran = self._used = 0.0

    def _share_out(self, team: Team, threads: int) -> None:
        """Give longer stretches to threads that waited: cores, and stretches of the list, differ in speed."""
        idle = LOOK * team.desk.to_numpy()[:threads, WAITED] / self._ran
        self._hand_out(team, self._shares * (1 + 0.5 * np.clip(idle - idle.mean(), -0.5, 0.5)))

    def _hand_out(self, team: Team, shares: npt.NDArray[np.float64]) -> None:
        self._shares, self._of = shares / shares.sum(), team
        ends = np.ones(THREADS + 1)
        ends[: len(shares)] = np.concatenate([[0.0], np.cumsum(self._shares)[:-1]])
        team.shares.from_numpy(ends)
        team.desk.fill(0)
