"""Threads that make many steps together in one launch, each on its own stretch of the list.

A launch costs more than a step of few beads, so the threads stay: they meet at the end of a step by counting the parts
of it that they have done.  Each looks after the beads of a stretch that is one piece in memory and so in space.  Of
these only the first ones, `start` to `own`, touch beads of earlier stretches; all others nobody else reads or writes,
and they move as soon as their pairs are done.  Where the stretches end has no say in the bits.

Threads can only meet while they run at the same time.  When one does not come at all, nothing is done; when one was
kept waiting too long in all, because others use the cores, all stop after a step.  Whoever launched goes on with one.
"""

import time

import numpy as np
import numpy.typing as npt

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.walls.wall_contacts import THREADS

LINE = 32  # numbers of a thread's row: two threads never share a line of the cache
# columns: looks in vain since they were last read; parts of steps done; the step after which the list was needed anew,
# the one after which it had waited enough
WAITED, PARTS, LEFT_AT, LATE_AT = range(4)
GATHERED, DISBANDED = 1, 2
UNTIL_GATHERED = 200_000  # looks at another thread
PATIENCE = 1_500_000  # looks in one launch, then it ends
LOOK = 2e-8  # [s], roughly; were it half or twice as long, stretches would only find their lengths later
ALONE = 0.05, 10.0  # [s] on one thread after another had no core to itself: the first time, and the longest
LEAST_SHARE, WATCHED = 0.6, 0.05  # part of its cores that a team must get, and how long it is looked at [s]


@ti.data_oriented
class Team:
    """The part of an arena by which threads meet."""

    def __init__(self, parts: int) -> None:
        """Of a step that has so many `parts`."""
        self.parts = parts
        self.desk = ti.field(ti.i32, (THREADS, LINE))
        self.gathering = ti.field(ti.i32, ())
        self.shares = ti.field(ti.f64, THREADS + 1)  # where the stretches of the list begin, in parts of it

    @ti.func
    def clear_desks(self):
        self.gathering[None] = 0
        for w, c in ti.ndrange(THREADS, (PARTS, LATE_AT + 1)):
            self.desk[w, c] = 0

    @ti.func
    def gather_team(self, w, team):
        """1 when all threads have come."""
        ti.atomic_add(self.desk[w, PARTS], 1)
        if w == 0:
            looks = 0
            for v in range(1, team):
                # an atomic look is one that the compiler cannot take out of the loop
                while ti.atomic_add(self.desk[v, PARTS], 0) == 0 and looks < UNTIL_GATHERED:
                    looks += 1
            outcome = GATHERED
            if looks >= UNTIL_GATHERED:
                outcome = DISBANDED
            ti.atomic_add(self.gathering[None], outcome)
        else:
            # the first thread runs or has run: rounds of a loop are handed out in order
            while ti.atomic_add(self.gathering[None], 0) == 0:
                pass
        return int(ti.atomic_add(self.gathering[None], 0) == GATHERED)

    @ti.func
    def tell(self, w):
        """Thread `w` has done a part of a step; all that it wrote is to be seen by whoever sees this."""
        ti.atomic_add(self.desk[w, PARTS], 1)

    @ti.func
    def wait(self, begin, end, parts):
        """Wait for threads `begin` to `end` - 1 to have done so many parts; how often it looked in vain."""
        looks = 0
        for v in range(begin, end):
            while ti.atomic_add(self.desk[v, PARTS], 0) <= parts:
                looks += 1
        return looks

    @ti.func
    def anybody(self, column: ti.template(), team, done):
        """1 when a thread has left this mark after step `done`; one that is further on can only have later marks."""
        found = 0
        for v in range(team):
            found |= int(self.desk[v, column] == done and done > 0)
        return found


class Crew:
    """How many threads the launches of one simulation get, and how large a stretch of the list each of them."""

    def __init__(self, threads: int) -> None:
        self._most = min(threads, THREADS)
        self._alone_until, self._alone_for = 0.0, ALONE[0]  # [s], on the clock of the machine
        self._ran = self._used = 0.0  # [s], by the clock and on each core, since last judged
        self._shares = np.ones(1)  # of the list
        self._of: Team | None = None  # who was told so
        self._compiled = False  # the first launch does that, on one core

    def gather(self, team: Team, threads: int) -> int:
        """Threads of the next launch, at most so many; one for a while after others had no core."""
        threads = 1 if time.perf_counter() < self._alone_until else max(1, min(threads, self._most))
        if threads > 1 and (len(self._shares) != threads or team is not self._of):
            self._hand_out(team, np.ones(threads))
        return threads

    def watch(self, team: Team, threads: int, took: float, used: float, *, late: bool) -> None:
        """Learn from a launch of several threads: how long it took [s], what it computed in all [s]."""
        if self._compiled:
            self._ran += took
            self._used += used / threads
        self._compiled = True
        if late or (self._ran > WATCHED and self._used < LEAST_SHARE * self._ran):
            self._alone_until = time.perf_counter() + self._alone_for
            self._alone_for = min(2 * self._alone_for, ALONE[1])
            if self._ran > 0 and self._used >= LEAST_SHARE * self._ran:
                self._share_out(team, threads)  # the cores were there: it was the stretches that were uneven
        elif self._ran > WATCHED:
            self._alone_for = ALONE[0]
            self._share_out(team, threads)
        else:
            return
        self._ran = self._used = 0.0

    def _share_out(self, team: Team, threads: int) -> None:
        """Give more to those that waited for others: cores are not all as fast, nor are stretches of the list."""
        idle = LOOK * team.desk.to_numpy()[:threads, WAITED] / self._ran
        self._hand_out(team, self._shares * (1 + 0.5 * np.clip(idle - idle.mean(), -0.5, 0.5)))

    def _hand_out(self, team: Team, shares: npt.NDArray[np.float64]) -> None:
        self._shares, self._of = shares / shares.sum(), team
        ends = np.ones(THREADS + 1)
        ends[: len(shares)] = np.concatenate([[0.0], np.cumsum(self._shares)[:-1]])
        team.shares.from_numpy(ends)
        team.desk.fill(0)
