"""Neighbour list: cells, half Verlet list with contact histories, and renumbering of beads.

Beads are renumbered in cell order at each build of the list, so that neighbours are close in memory; a pair is owned by
its bead with the lower number.  Several threads each list the neighbours of a part of the beads in a part of the
memory; the parts are then joined, so that the list does not depend on the number of threads.  If something does not
fit, the current list is left unchanged.
"""

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.bulk.pair_forces import Pairs
from rigtwin.sim.engine.bulk.rigid_bodies import RigidBodies
from rigtwin.sim.engine.bulk.table_layout import (
    BEADS,
    BODIES,
    BUILDS,
    CELL,
    CULPRIT,
    GONE,
    KEPT,
    LEFT_DOMAIN,
    LISTED,
    LIVE_LIST,
    LOW,
    NEAR_FULL,
    NX,
    NY,
    NZ,
    OPEN,
    PAIRS,
    PAIRS_FULL,
    SKIN,
    STATUS,
    WALL_COUNT,
    WHOLE,
    WORST,
)
from rigtwin.sim.engine.walls.wall_contacts import THREADS, WallContacts

CELLS_PER_BEAD = 16
LARGE, CELLS_IN_LARGE = 200_000, 4  # beads, and cells per bead above this number, to save memory


class Neighbours(Pairs, RigidBodies):
    """Part of an arena that builds the lists of neighbours and near walls."""

    capacity: int
    pair_capacity: int
    rigid: bool
    walls: WallContacts
    given: ti.Field
    counts: ti.Field
    stale: ti.Field
    flight: ti.Field
    flight_before: ti.Field

    def make_cells(self, capacity: int) -> None:
        self.cell_capacity = (CELLS_PER_BEAD if capacity < LARGE else CELLS_IN_LARGE) * capacity
        self.cell_first = ti.field(ti.i32, self.cell_capacity + 1)
        self.cell_of = ti.field(ti.i32, capacity)
        self.order = ti.field(ti.i32, capacity)  # new number -> old number
        self.listed = ti.field(ti.i32, (THREADS, 2))  # pairs, and walls near beads, in each part of the next list
        # columns of beads to renumber, and their temporary storage; the largest overlap is handled separately
        keepers = [(field, c) for field in (self.given, self.taken) for c in range(6)]
        fours = [(field, c) for field in (self.place, self.motion, self.spin) for c in range(4)]
        others = (
            [(self.push, c) for c in range(3)] + [(self.twist, c) for c in range(3)] + [(self.tag, 0), (self.tag, 1)]
        )
        self.lots = tuple(
            tuple((*one, *keeper) for one, keeper in zip(lot, keepers, strict=False)) for lot in (fours, others)
        )

    @ti.func
    def sort_into_cells(self):
        """Find the cell of every bead and the new order; beads outside an open domain are dropped, else reported.

        A body leaves the domain as a whole, when its centre does.
        """
        beads = self.counts[BEADS]
        nx, ny, nz = self.counts[NX], self.counts[NY], self.counts[NZ]
        cells = nx * ny * nz
        for c in range(cells + 1):
            self.cell_first[c] = 0
        kept = 0
        for i in range(beads):
            self.cell_of[i] = -1
            scale = 1.0 / self.numbers[CELL]
            x = int(ti.floor((self.place[i][0] - self.numbers[LOW]) * scale))
            y = int(ti.floor((self.place[i][1] - self.numbers[LOW + 1]) * scale))
            z = int(ti.floor((self.place[i][2] - self.numbers[LOW + 2]) * scale))
            inside = ti.min(x, y, z, nx - 1 - x, ny - 1 - y, nz - 1 - z) >= 0
            if ti.static(self.rigid):
                b = self.body[i]
                if b >= 0:
                    centre = self.body_place[b]
                    p = int(ti.floor((centre[0] - self.numbers[LOW]) * scale))
                    q = int(ti.floor((centre[1] - self.numbers[LOW + 1]) * scale))
                    r = int(ti.floor((centre[2] - self.numbers[LOW + 2]) * scale))
                    inside = ti.min(p, q, r, nx - 1 - p, ny - 1 - q, nz - 1 - r) >= 0
                    # beads outside belong to the cells at the border, which can only add candidate pairs
                    x = ti.min(ti.max(x, 0), nx - 1)
                    y = ti.min(ti.max(y, 0), ny - 1)
                    z = ti.min(ti.max(z, 0), nz - 1)
            if inside:
                cell = (z * ny + y) * nx + x
                self.cell_of[i] = cell
                self.cell_first[cell + 1] = self.cell_first[cell + 1] + 1
                kept += 1
            elif self.counts[OPEN] == 0:
                self.counts[STATUS] = LEFT_DOMAIN
                self.counts[CULPRIT] = i
        for c in range(cells):
            self.cell_first[c + 1] = self.cell_first[c + 1] + self.cell_first[c]
        for i in range(beads):
            cell = self.cell_of[i]
            if cell >= 0:
                slot = self.cell_first[cell]
                self.order[slot] = i
                self.cell_first[cell] = slot + 1
        # filling has moved every start to that of the next cell; shift back
        for k in range(cells):
            c = cells - k
            self.cell_first[c] = self.cell_first[c - 1]
        self.cell_first[0] = 0
        return kept

    @ti.func
    def list_pairs(self, beads, place, stop):
        """Write the next list of `beads` in new numbers, with histories, into its entries `place` to `stop` - 1.

        The current list is not changed.  Returns the number of entries needed, which may be more than there is room.
        """
        nx, ny, nz = self.counts[NX], self.counts[NY], self.counts[NZ]
        following = 1 - self.counts[LIVE_LIST]
        skin = self.numbers[SKIN]
        first_bead, end_bead = ti.static(beads)
        pairs = place
        for a in range(first_bead, end_bead):
            i = self.order[a]
            self.first[following, a] = pairs
            cell = self.cell_of[i]
            x = cell % nx
            y = (cell // nx) % ny
            z = cell // (nx * ny)
            # rest of the own row of cells, then the four rows that follow in cell order
            for row in range(5):
                dy, dz = row, 0
                if row >= 2:
                    dy, dz = row - 3, 1
                if ti.min(y + dy, ny - 1 - y - dy, nz - 1 - z - dz) >= 0:
                    line = ((z + dz) * ny + y + dy) * nx
                    begin = self.cell_first[line + ti.max(x - 1, 0)]
                    end = self.cell_first[line + ti.min(x + 1, nx - 1) + 1]
                    if row == 0:
                        begin = a + 1
                    for b in range(begin, end):
                        j = self.order[b]
                        reach = self.place[i][3] + self.place[j][3] + skin
                        gap2 = 0.0
                        for c in ti.static(range(3)):
                            gap2 += (self.place[i][c] - self.place[j][c]) ** 2
                        near = gap2 < reach * reach
                        if ti.static(self.rigid):
                            near = near and not self.of_one_body(i, j)
                        if near:
                            if pairs < stop:
                                self.partner[following, pairs] = b
                                self.carry_history(i, j, following, pairs)
                            pairs += 1
        return pairs - place

    @ti.func
    def carry_history(self, i, j, following, new):
        """Copy the history of the contact of beads `i` and `j` to pair `new`."""
        live = 1 - following
        owner, other = ti.min(i, j), ti.max(i, j)
        self.touching[following, new] = ti.cast(0, ti.i8)
        self.history[following, new] = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        if other < self.counts[LISTED]:
            for p in range(self.first[live, owner], self.first[live, owner + 1]):
                if self.partner[live, p] == other and self.touching[live, p] == 1:
                    # if the owner changes, the history changes sign
                    sign = 1.0
                    if owner != i:
                        sign = -1.0
                    self.touching[following, new] = ti.cast(1, ti.i8)
                    self.history[following, new] = sign * self.history[live, p]
                    if ti.static(self.terms.changes_restitution):
                        self.impact[following, new] = self.impact[live, p]

    @ti.func
    def renumber(self, kept):
        """Reorder the data of beads in two lots, with the idle fields `given` and `taken` as temporary storage."""
        if ti.static(self.rigid):
            self.keep_members(self.counts[BEADS])
        for lot in ti.static(range(2)):
            for a in range(kept):
                i = self.order[a]
                for field, c, keeper, k in ti.static(self.lots[lot]):
                    keeper[a][k] = float(field[i][c])
                if ti.static(lot == 1):
                    self.taken[a][5] = self.worst[i]
            for a in range(kept):
                for field, c, keeper, k in ti.static(self.lots[lot]):
                    field[a][c] = ti.cast(keeper[a][k], field.dtype)
                if ti.static(lot == 1):
                    self.worst[a] = self.taken[a][5]
                    for c in ti.static(range(3)):
                        self.listed_at[a][c] = self.place[a][c]
                    for c in ti.static(range(6)):
                        self.given[a][c] = 0.0
                        self.taken[a][c] = 0.0
                    if ti.static(self.rigid):
                        self.renumber_member(a, self.order[a])

    @ti.func
    def list_walls(self, beads, begin, end):
        """Write the next list of walls near `beads`, as `list_pairs` does for pairs."""
        leeway = 0.5 * self.numbers[SKIN]
        first_bead, end_bead = ti.static(beads)
        found = begin
        for a in range(first_bead, end_bead):
            i = self.order[a]
            position = ti.Vector([self.place[i][0], self.place[i][1], self.place[i][2]])
            found = self.walls.list_bead(
                self.counts[LIVE_LIST], a, i, self.counts[LISTED], (found, end), position, self.place[i][3] + leeway,
                leeway, self.counts[WALL_COUNT],
            )  # fmt: skip
        return found - begin

    @ti.func
    def list_pointed(self, kept):
        """Set the owners of pairs, and the storage for forces on beads from pairs that others own, in list order."""
        live = self.counts[LIVE_LIST]
        for i in range(kept + 1):
            self.pointed_first[i] = 0
        for i in range(kept):
            for p in range(self.first[live, i], self.first[live, i + 1]):
                self.owner_of[p] = i
                j = self.partner[live, p]
                self.pointed_first[j + 1] = self.pointed_first[j + 1] + 1
        for i in range(kept):
            self.pointed_first[i + 1] = self.pointed_first[i + 1] + self.pointed_first[i]
            self.cell_of[i] = self.pointed_first[i]  # reused; the cells are not needed any more
        for p in range(self.counts[PAIRS]):
            j = self.partner[live, p]
            self.place_of_force[p] = self.cell_of[j]
            for c in ti.static(range(6)):
                self.history[1 - live, p][c] = 0.0
            if ti.static(self.constant_torque):
                self.grip[p] = 0.0
            self.cell_of[j] = self.cell_of[j] + 1

    @ti.func
    def list_part(self, part, parts):
        """List the neighbours and walls near the beads of one part."""
        kept, near_capacity = self.counts[KEPT], self.walls.near_capacity
        beads = ti.static((kept * part // parts, kept * (part + 1) // parts))
        begin, end = room(self.pair_capacity, part, parts), room(self.pair_capacity, part + 1, parts)
        self.listed[part, 0] = self.list_pairs(beads, begin, end)
        begin, end = room(near_capacity, part, parts), room(near_capacity, part + 1, parts)
        self.listed[part, 1] = self.list_walls(beads, begin, end)

    @ti.func
    def parts_fit(self, parts):
        """1 if all parts of the next list had room; else sets STATUS (memory full) or WHOLE (build without parts)."""
        pairs, near, fits = 0, 0, 1
        for part in range(parts):
            own, own_near = self.listed[part, 0], self.listed[part, 1]
            pairs += own
            near += own_near
            if own > room(self.pair_capacity, part + 1, parts) - room(self.pair_capacity, part, parts):
                fits = 0
            if own_near > room(self.walls.near_capacity, part + 1, parts) - room(self.walls.near_capacity, part, parts):
                fits = 0
        if pairs > self.pair_capacity:
            self.counts[STATUS] = PAIRS_FULL
            self.counts[PAIRS] = pairs
        elif near > self.walls.near_capacity:
            self.counts[STATUS] = NEAR_FULL
        elif fits == 0:
            self.counts[WHOLE] = 1
        return fits

    @ti.func
    def join_parts(self, parts):
        """Append the parts of the next list to the first."""
        following, kept = 1 - self.counts[LIVE_LIST], self.counts[KEPT]
        for part in range(1, parts):
            pairs, near = self.listed[0, 0], self.listed[0, 1]
            begin, begin_near = room(self.pair_capacity, part, parts), room(self.walls.near_capacity, part, parts)
            for a in range(kept * part // parts, kept * (part + 1) // parts):
                self.first[following, a] = self.first[following, a] - begin + pairs
                self.walls.first[following, a] = self.walls.first[following, a] - begin_near + near
            for p in range(self.listed[part, 0]):
                self.partner[following, pairs + p] = self.partner[following, begin + p]
                self.touching[following, pairs + p] = self.touching[following, begin + p]
                self.history[following, pairs + p] = self.history[following, begin + p]
                if ti.static(self.terms.changes_restitution):
                    self.impact[following, pairs + p] = self.impact[following, begin + p]
            for q in range(self.listed[part, 1]):
                self.walls.move_entry(following, begin_near + q, near + q)
            self.listed[0, 0] = pairs + self.listed[part, 0]
            self.listed[0, 1] = near + self.listed[part, 1]

    @ti.func
    def take_list(self, time):
        """Make the next list the current one and renumber."""
        kept, pairs, following = self.counts[KEPT], self.listed[0, 0], 1 - self.counts[LIVE_LIST]
        self.first[following, kept] = pairs
        self.walls.first[following, kept] = self.listed[0, 1]
        self.walls.note_listing(
            self.counts[WALL_COUNT], time, self.counts[BEADS], self.counts[LIVE_LIST], self.counts[LISTED]
        )
        if ti.static(self.terms.acts_in_flight):
            for i in range(self.counts[BEADS]):
                self.flight_before[None] = self.flight_before[None] + self.flight[i]
                self.flight[i] = 0.0
        gone = self.counts[BEADS] - kept
        for i in range(self.counts[BEADS]):
            if self.cell_of[i] < 0:
                self.numbers[WORST] = ti.max(self.numbers[WORST], self.worst[i])
        if ti.static(self.rigid):
            gone = 0
            for i in range(self.counts[BEADS]):
                if self.cell_of[i] < 0 and self.body[i] < 0:
                    gone += 1
        self.renumber(kept)
        if ti.static(self.rigid):
            bodies = self.renumber_bodies(self.counts[BODIES], kept)
            gone += self.counts[BODIES] - bodies
            self.counts[BODIES] = bodies
        self.counts[LIVE_LIST] = 1 - self.counts[LIVE_LIST]
        self.counts[PAIRS] = pairs
        self.counts[GONE] += gone
        self.counts[BEADS] = kept
        self.counts[LISTED] = kept
        self.counts[BUILDS] += 1
        self.list_pointed(kept)
        self.stale[0] = 0


@ti.func
def room(capacity, part, parts):
    """First entry of a part of a list."""
    return int(ti.cast(capacity, ti.i64) * part // parts)
