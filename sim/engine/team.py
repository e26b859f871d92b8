"""Threads that make many steps together in one launch, each on its own stretch of the list.

A launch costs more than a step of few beads, so the threads stay: they meet at the end of a step by counting the parts
of it that they have done.  Each looks after the beads of a stretch that is one piece in memory and so in space.  Of
these only the first ones, `start` to `own`, touch beads of earlier stretches; all others nobody else reads or writes,
and they move as soon as their pairs are done.  Where the stretches end has no say in the bits.

Threads can only meet while they run at the same time.  When one does not come at all, nothing is done; when one was
kept waiting too long in all, because others use the cores, all stop after a step.  Whoever launched goes on with one.
"""

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.wall_contacts import THREADS

LINE = 32  # numbers of a thread's row: two threads never share a line of the cache
# columns: parts of steps done, the step after which the list was needed anew, the one after which it had waited enough
PARTS, LEFT_AT, LATE_AT = range(3)
GATHERED, DISBANDED = 1, 2
UNTIL_GATHERED = 1_000_000  # looks at another thread, each some nanoseconds
PATIENCE = 6_000_000  # looks in one launch, then it ends: some 0.04 s of computing


@ti.data_oriented
class Team:
    """The part of an arena by which threads meet."""

    def __init__(self, parts: int) -> None:
        """Of a step that has so many `parts`."""
        self.parts = parts
        self.desk = ti.field(ti.i32, (THREADS, LINE))
        self.gathering = ti.field(ti.i32, ())

    @ti.func
    def clear_desks(self):
        self.gathering[None] = 0
        for w, c in ti.ndrange(THREADS, LINE):
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
