"""Fields and kernels of the bulk engine: many spheres, half Verlet list, no atomics in the force sum.

(`a[i] = a[i] + x` stands where `a[i] += x` would: Taichi makes the latter atomic.)

A step has two passes.  *Pairs*: every bead works out the pairs it owns, adds up what they do to it, and leaves what
each does to the other bead where that one looks for it.  *Beads*: each bead adds what was left for it, in list order,
adds its walls, and moves.  A bead that is part of a rigid body leaves its sum to a third pass, *bodies* (see
`bodies.py`); an arena without bodies is compiled without all that.  No two threads ever write the same number, so the
bits do not depend on how many there are.

Beads are renumbered in cell order whenever the list is built anew (memory order is space order); `ident` keeps their
names.  Between launches the state is: position at t, velocity and spin at t - step/2 (velocity Verlet in its leapfrog
form), and the last accelerations, which tell the velocity at t.

Materials, walls, gravity and step are data, sizes come in a few classes: a new run does not recompile.
"""

from functools import cache

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.bodies import STATE_SIZE, RigidBodies
from rigtwin.sim.engine.contact import (
    CONSTANTS,
    DAMPING,
    LAW_SIZE,
    ROLLING_RADIUS,
    SHARE,
    STIFFNESS,
    constants_of_two,
    contact_forces,
)
from rigtwin.sim.engine.terms import Terms, upwards
from rigtwin.sim.engine.wall_contacts import KINDS, ROOM, WallContacts

CELLS_PER_BEAD = 16
FLAGS = 17  # steps of one multi-threaded burst, and one
BURST = FLAGS - 1

# columns of `numbers`
STEP, SKIN, GRAVITY, LOW, CELL, MOST_SPEED = 0, 1, 2, 5, 8, 9
NUMBERS = 10
# columns of `counts`
BEADS, LISTED, LIVE_LIST, PAIRS, WALL_COUNT, CONSTANT_TORQUE, STATUS, CULPRIT = range(8)
NX, NY, NZ, OPEN, GONE, BUILDS, DONE = range(8, 15)
BODIES = 15
MIXED = 16  # 1: beads of one kind may differ in size or weight
COUNTS = 17
# values of STATUS
OK, PAIRS_FULL, NEAR_FULL, LEFT_DOMAIN, EXPLODED = range(5)


@cache
def arena(
    capacity: int, pair_capacity: int, near_capacity: int, terms: Terms, room: int = ROOM, rigid: bool = False
) -> "Arena":
    """The arena of this size; fields are made once per process (Taichi dies after some 500 fields)."""
    return Arena(capacity, pair_capacity, near_capacity, terms, room, rigid)


@ti.data_oriented
class Arena(RigidBodies):
    """State of up to `capacity` beads, `pair_capacity` neighbouring pairs and `near_capacity` walls near beads.

    `rigid`: some beads are parts of bodies.
    """

    def __init__(
        self, capacity: int, pair_capacity: int, near_capacity: int, terms: Terms, room: int, rigid: bool
    ) -> None:
        self.terms = terms
        self.capacity = capacity
        self.pair_capacity = pair_capacity
        self.rigid = rigid
        self.walls = WallContacts(capacity, near_capacity, room, terms)
        self.owner: object = None  # the simulation whose state this is
        self.cell_capacity = CELLS_PER_BEAD * capacity
        self.place = ti.Vector.field(4, ti.f64, capacity)  # position, radius
        self.motion = ti.Vector.field(4, ti.f64, capacity)  # velocity half a step back, mass
        self.spin = ti.Vector.field(4, ti.f64, capacity)  # spin half a step back, inertia
        self.push = ti.Vector.field(3, ti.f64, capacity)  # acceleration
        self.twist = ti.Vector.field(3, ti.f64, capacity)  # angular acceleration
        self.listed_at = ti.Vector.field(3, ti.f64, capacity)  # position when the list was built
        self.tag = ti.Vector.field(2, ti.i32, capacity)  # ident, kind
        self.worst = ti.field(ti.f64, capacity)  # largest overlap/radius seen by this slot's pairs and walls

        if rigid:
            super().__init__(capacity)

        self.spare = ti.Vector.field(STATE_SIZE, ti.f64, capacity)

        # two lists, of which LIVE_LIST is in force and the other is the last one or the next one
        self.first = ti.field(ti.i32, (2, capacity + 1))  # first pair of a bead
        self.partner = ti.field(ti.i32, (2, pair_capacity))
        self.slip = ti.Vector.field(3, ti.f64, (2, pair_capacity))
        self.roll = ti.Vector.field(3, ti.f64, (2, pair_capacity))
        self.touching = ti.field(ti.i32, (2, capacity))  # how many pairs of a bead touch: they come first
        if terms.changes_restitution:
            self.impact = ti.field(ti.f64, (2, pair_capacity))  # DAMPING of this impact, below zero: not known yet
        # force on the owner, torque on the other; sorted by the other
        self.pair_force = ti.Vector.field(6, ti.f64, pair_capacity)
        self.pointed_first = ti.field(ti.i32, capacity + 1)  # first of the forces of pairs that point to a bead
        self.place_of_force = ti.field(ti.i32, pair_capacity)  # of a pair of the list in force

        self.cell_first = ti.field(ti.i32, self.cell_capacity + 1)
        self.cell_of = ti.field(ti.i32, capacity)
        self.order = ti.field(ti.i32, capacity)  # new number -> old number
        self.fill = ti.field(ti.i32, capacity + 1)

        self.numbers = ti.field(ti.f64, NUMBERS)
        self.counts = ti.field(ti.i32, COUNTS)
        self.stale = ti.field(ti.i32, FLAGS)
        self.pair_law = ti.Vector.field(LAW_SIZE, ti.f64, (KINDS, KINDS))
        self.constants = ti.Vector.field(CONSTANTS, ti.f64, (KINDS, KINDS))  # of contacts of two kinds of spheres

    # ------------------------------------------------------------------ data in and out

    @ti.kernel
    def configure(
        self,
        numbers: ti.types.ndarray(),
        counts: ti.types.ndarray(),
        pair_law: ti.types.ndarray(),
        kinds: ti.types.ndarray(),
        kind_count: ti.i32,
    ):
        """Empty the arena and set everything that a run does not change; a row of `kinds` is radius, mass, inertia."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            for c in range(NUMBERS):
                self.numbers[c] = numbers[c]
            for c in range(COUNTS):
                self.counts[c] = counts[c]
            for a in range(KINDS):
                for c in ti.static(range(LAW_SIZE)):
                    for b in range(KINDS):
                        self.pair_law[a, b][c] = pair_law[a, b, c]
            for a in range(kind_count):
                for b in range(kind_count):
                    self.constants[a, b] = constants_of_two(
                        self.pair_law[a, b], kinds[a, 0], kinds[b, 0], kinds[a, 1], kinds[b, 1], kinds[a, 2],
                        kinds[b, 2], numbers[STEP],
                    )  # fmt: skip
            self.first[0, 0] = 0
            self.first[1, 0] = 0

    @ti.kernel
    def set_count(self, column: ti.i32, value: ti.i32):
        self.counts[column] = value

    @ti.kernel
    def put(self, beads: ti.types.ndarray(), start: ti.i32, count: ti.i32):
        """Write beads start ... start + count - 1 (columns as in STATE_SIZE)."""
        ti.loop_config(serialize=True)
        for k in range(count):
            i = start + k
            for c in ti.static(range(4)):
                self.place[i][c] = beads[k, (0, 1, 2, 9)[c]]
                self.motion[i][c] = beads[k, (3, 4, 5, 10)[c]]
                self.spin[i][c] = beads[k, (6, 7, 8, 11)[c]]
            for c in ti.static(range(3)):
                self.push[i][c] = beads[k, 12 + c]
                self.twist[i][c] = beads[k, 15 + c]
            self.tag[i][0] = int(beads[k, 18])
            self.tag[i][1] = int(beads[k, 19])
            self.worst[i] = beads[k, 20]
            if ti.static(self.rigid):
                self.body[i] = -1

    @ti.kernel
    def get(self, beads: ti.types.ndarray(), count: ti.i32):
        """Read all beads (columns as in STATE_SIZE)."""
        ti.loop_config(serialize=True)
        for i in range(count):
            for c in ti.static(range(4)):
                beads[i, (0, 1, 2, 9)[c]] = self.place[i][c]
                beads[i, (3, 4, 5, 10)[c]] = self.motion[i][c]
                beads[i, (6, 7, 8, 11)[c]] = self.spin[i][c]
            for c in ti.static(range(3)):
                beads[i, 12 + c] = self.push[i][c]
                beads[i, 15 + c] = self.twist[i][c]
            beads[i, 18] = float(self.tag[i][0])
            beads[i, 19] = float(self.tag[i][1])
            beads[i, 20] = self.worst[i]

    @ti.kernel
    def get_pairs(self, first: ti.types.ndarray(), pairs: ti.types.ndarray(), beads: ti.i32):
        """Read the list in force: first pair of each bead; per pair partner, touching, slip 3, roll 3."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            live = self.counts[LIVE_LIST]
            for i in range(beads + 1):
                first[i] = self.first[live, i]
            for i in range(beads):
                for p in range(self.first[live, i], self.first[live, i + 1]):
                    pairs[p, 0] = float(self.partner[live, p])
                    pairs[p, 1] = float(p < self.first[live, i] + self.touching[live, i])
                    for c in ti.static(range(3)):
                        pairs[p, 2 + c] = self.slip[live, p][c]
                        pairs[p, 5 + c] = self.roll[live, p][c]

    @ti.kernel
    def put_pairs(self, first: ti.types.ndarray(), pairs: ti.types.ndarray(), beads: ti.i32):
        ti.loop_config(serialize=True)
        for _ in range(1):
            live = self.counts[LIVE_LIST]
            for i in range(beads + 1):
                self.first[live, i] = first[i]
            for i in range(beads):
                self.touching[live, i] = 0
                for p in range(first[i], first[i + 1]):
                    self.partner[live, p] = int(pairs[p, 0])
                    self.touching[live, i] = self.touching[live, i] + int(pairs[p, 1])
                    for c in ti.static(range(3)):
                        self.slip[live, p][c] = pairs[p, 2 + c]
                        self.roll[live, p][c] = pairs[p, 5 + c]
                    if ti.static(self.terms.changes_restitution):
                        self.impact[live, p] = -1.0
            self.counts[LISTED] = beads

    # ------------------------------------------------------------------ the list

    @ti.func
    def sort_into_cells(self):
        """Cell of every bead and the new order; beads outside are left out of an open domain, else reported.

        A body leaves as a whole, when its centre does.
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
                    # beads that stick out count to the cells at the border: that only brings cells closer
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
        # filling moved every start to the next cell's start
        for k in range(cells):
            c = cells - k
            self.cell_first[c] = self.cell_first[c - 1]
        self.cell_first[0] = 0
        return kept

    @ti.func
    def list_pairs(self, kept):
        """Write the next list in new numbers, history carried over; the list in force stays as it is."""
        nx, ny, nz = self.counts[NX], self.counts[NY], self.counts[NZ]
        following = 1 - self.counts[LIVE_LIST]
        skin = self.numbers[SKIN]
        pairs = 0
        for a in range(kept):
            i = self.order[a]
            self.first[following, a] = pairs
            self.touching[following, a] = 0
            cell = self.cell_of[i]
            x = cell % nx
            y = (cell // nx) % ny
            z = cell // (nx * ny)
            # own row from the next bead on, then the four rows that come later in cell order
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
                            if pairs < self.pair_capacity:
                                self.partner[following, pairs] = b
                                self.carry_history(i, j, following, a, pairs)
                            pairs += 1
        self.first[following, kept] = pairs
        return pairs

    @ti.func
    def carry_history(self, i, j, following, a, new):
        """Where `i` and `j` were in touch, `new` joins the pairs of `a`, once `i`, that touch, with its history."""
        live = 1 - following
        owner, other = ti.min(i, j), ti.max(i, j)
        if other < self.counts[LISTED]:
            begin = self.first[live, owner]
            for p in range(begin, begin + self.touching[live, owner]):
                if self.partner[live, p] == other:
                    front = self.first[following, a] + self.touching[following, a]
                    partner = self.partner[following, new]
                    self.partner[following, new] = self.partner[following, front]
                    self.partner[following, front] = partner
                    # seen from the other bead the history has the other sign
                    sign = 1.0
                    if owner != i:
                        sign = -1.0
                    self.slip[following, front] = sign * self.slip[live, p]
                    self.roll[following, front] = sign * self.roll[live, p]
                    if ti.static(self.terms.changes_restitution):
                        self.impact[following, front] = self.impact[live, p]
                    self.touching[following, a] = self.touching[following, a] + 1

    @ti.func
    def renumber(self, kept):
        if ti.static(self.rigid):
            self.keep_members(self.counts[BEADS])
        for i in range(self.counts[BEADS]):
            for c in ti.static(range(4)):
                self.spare[i][c] = self.place[i][c]
                self.spare[i][4 + c] = self.motion[i][c]
                self.spare[i][8 + c] = self.spin[i][c]
            for c in ti.static(range(3)):
                self.spare[i][12 + c] = self.push[i][c]
                self.spare[i][15 + c] = self.twist[i][c]
            self.spare[i][18] = float(self.tag[i][0])
            self.spare[i][19] = float(self.tag[i][1])
            self.spare[i][20] = self.worst[i]
        for a in range(kept):
            i = self.order[a]
            for c in ti.static(range(4)):
                self.place[a][c] = self.spare[i][c]
                self.motion[a][c] = self.spare[i][4 + c]
                self.spin[a][c] = self.spare[i][8 + c]
            for c in ti.static(range(3)):
                self.push[a][c] = self.spare[i][12 + c]
                self.twist[a][c] = self.spare[i][15 + c]
                self.listed_at[a][c] = self.spare[i][c]
            self.tag[a][0] = int(self.spare[i][18])
            self.tag[a][1] = int(self.spare[i][19])
            self.worst[a] = self.spare[i][20]
            if ti.static(self.rigid):
                self.renumber_member(a, i)

    @ti.func
    def list_walls(self, kept):
        """Write the next list of walls near beads, as `list_pairs` does that of pairs."""
        leeway = 0.5 * self.numbers[SKIN]
        found = 0
        for a in range(kept):
            i = self.order[a]
            position = ti.Vector([self.place[i][0], self.place[i][1], self.place[i][2]])
            found = self.walls.list_bead(
                self.counts[LIVE_LIST], a, i, self.counts[LISTED], found, position, self.place[i][3] + leeway, leeway,
                self.counts[WALL_COUNT],
            )  # fmt: skip
        self.walls.first[1 - self.counts[LIVE_LIST], kept] = found
        return found

    @ti.func
    def list_pointed(self, kept):
        """For every bead room for the forces of the pairs that other beads own with it, in list order."""
        live = self.counts[LIVE_LIST]
        for i in range(kept + 1):
            self.pointed_first[i] = 0
        for p in range(self.counts[PAIRS]):
            j = self.partner[live, p]
            self.pointed_first[j + 1] = self.pointed_first[j + 1] + 1
        for i in range(kept):
            self.pointed_first[i + 1] = self.pointed_first[i + 1] + self.pointed_first[i]
            self.fill[i] = self.pointed_first[i]
        for p in range(self.counts[PAIRS]):
            j = self.partner[live, p]
            self.place_of_force[p] = self.fill[j]
            for c in ti.static(range(6)):
                self.pair_force[p][c] = 0.0
            self.fill[j] = self.fill[j] + 1

    @ti.func
    def build(self, time):
        """Build the list anew and renumber; when anything does not fit, say so and leave all as it was."""
        kept = self.sort_into_cells()
        pairs = 0
        if self.counts[STATUS] == OK:
            pairs = self.list_pairs(kept)
            if pairs > self.pair_capacity:
                self.counts[STATUS] = PAIRS_FULL
                self.counts[PAIRS] = pairs
        if self.counts[STATUS] == OK and self.list_walls(kept) > self.walls.near_capacity:
            self.counts[STATUS] = NEAR_FULL
        if self.counts[STATUS] == OK:
            self.walls.note_listing(self.counts[WALL_COUNT], time, self.counts[BEADS])
            gone = self.counts[BEADS] - kept
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

    # ------------------------------------------------------------------ the step

    @ti.func
    def put_force(self, p, force, torque):
        """Leave what pair `p` does to its other bead where that bead looks for it."""
        place = self.place_of_force[p]
        for c in ti.static(range(3)):
            self.pair_force[place][c] = force[c]
            self.pair_force[place][3 + c] = torque[c]

    @ti.func
    def constants_of(self, i, j, alike: ti.template()):
        """Constants of a contact of beads `i` and `j`: those of their kinds where the beads of a kind are `alike`."""
        kind, kind_j = self.tag[i][1], self.tag[j][1]
        constants = self.constants[kind, kind_j]
        if ti.static(not alike):
            constants = self.work_out(i, j, self.pair_law[kind, kind_j])
        return constants

    @ti.func
    def work_out(self, i, j, law):
        """Constants of a contact of two beads, from their own sizes, masses and inertias."""
        radius, mass, inertia = self.place[i][3], self.motion[i][3], self.spin[i][3]
        radius_j, mass_j, inertia_j = self.place[j][3], self.motion[j][3], self.spin[j][3]
        return constants_of_two(law, radius, radius_j, mass, mass_j, inertia, inertia_j, self.numbers[STEP])

    @ti.func
    def constants_of_impact(self, live, p, i, j, closing):
        """Where restitution depends on the speed of impact: the constants with the damping of this one."""
        law = self.pair_law[self.tag[i][1], self.tag[j][1]]
        if self.impact[live, p] < 0.0:
            radius, mass, radius_j, mass_j = self.place[i][3], self.motion[i][3], self.place[j][3], self.motion[j][3]
            radius_eff, mass_eff = radius * radius_j / (radius + radius_j), mass * mass_j / (mass + mass_j)
            self.impact[live, p] = self.terms.damping_of_pair(law[DAMPING], closing, radius_eff, mass_eff)
        law[DAMPING] = self.impact[live, p]
        return self.work_out(i, j, law)

    @ti.func
    def cling(self, p, i, j):
        """Pull on the owner of a pair whose beads have parted, and whether they still hold together."""
        place, place_j = self.place[i], self.place[j]
        between = ti.Vector([place_j[0] - place[0], place_j[1] - place[1], place_j[2] - place[2]])
        distance, both = between.norm(), place[3] + place_j[3]
        radius_eff = place[3] * place_j[3] / both
        modulus = self.pair_law[self.tag[i][1], self.tag[j][1]][STIFFNESS]
        force, holds = ti.Vector([0.0, 0.0, 0.0]), 0
        if distance - both < self.terms.neck(radius_eff, modulus):
            holds = 1
            force = self.terms.attraction(both - distance, radius_eff, modulus) / distance * between
            self.put_force(p, force, ti.Vector([0.0, 0.0, 0.0]))
        return force, holds

    @ti.func
    def begin_contacts(self, live, i, place):
        """Bring the pairs of bead `i` that now touch to its first ones, which did before; the first of the others.

        So the branches of both loops nearly always go the same way.
        """
        apart = self.first[live, i] + self.touching[live, i]
        for p in range(apart, self.first[live, i + 1]):
            place_j = self.place[self.partner[live, p]]
            between = ti.Vector([place_j[0] - place[0], place_j[1] - place[1], place_j[2] - place[2]])
            if between.norm_sqr() < (place[3] + place_j[3]) ** 2:
                self.exchange(live, p, apart)
                self.slip[live, apart] = ti.Vector([0.0, 0.0, 0.0])
                self.roll[live, apart] = ti.Vector([0.0, 0.0, 0.0])
                if ti.static(self.terms.changes_restitution):
                    self.impact[live, apart] = -1.0
                apart += 1
        return apart

    @ti.func
    def end_contact(self, live, p, last):
        """Pair `p` touches no more: `last`, the last one that may, takes its place and history."""
        nothing = ti.Vector([0.0, 0.0, 0.0])
        self.put_force(p, nothing, nothing)
        self.exchange(live, p, last)
        self.slip[live, p] = self.slip[live, last]
        self.roll[live, p] = self.roll[live, last]
        if ti.static(self.terms.changes_restitution):
            self.impact[live, p] = self.impact[live, last]

    @ti.func
    def exchange(self, live, p, q):
        """Two pairs of one bead change places, but for their histories."""
        partner, place = self.partner[live, p], self.place_of_force[p]
        self.partner[live, p] = self.partner[live, q]
        self.place_of_force[p] = self.place_of_force[q]
        self.partner[live, q] = partner
        self.place_of_force[q] = place

    @ti.func
    def meet(self, i, alike: ti.template()):  # noqa: PLR0915  one idea: all that a pair does in a step
        """Forces of the pairs that bead `i` owns; its own share waits in `push` and `twist` for `move`."""
        live = self.counts[LIVE_LIST]
        step = self.numbers[STEP]
        constant_torque = self.counts[CONSTANT_TORQUE]
        place, motion, spin = self.place[i], self.motion[i], self.spin[i]
        sum_force = ti.Vector([0.0, 0.0, 0.0])
        sum_torque = ti.Vector([0.0, 0.0, 0.0])
        worst = self.worst[i]
        apart = self.begin_contacts(live, i, place)
        p = self.first[live, i]
        while p < apart:
            j = self.partner[live, p]
            place_j = self.place[j]
            between = ti.Vector([place_j[0] - place[0], place_j[1] - place[1], place_j[2] - place[2]])
            both = place[3] + place_j[3]
            distance2 = between.norm_sqr()
            if distance2 < both * both:
                motion_j, spin_j = self.motion[j], self.spin[j]
                distance = ti.sqrt(distance2)
                normal = between * (distance * (1.0 / distance2))  # the division need not wait for the root
                constants = self.constants_of(i, j, alike)
                lever = constants[SHARE] * distance
                lever_j = distance - lever
                turning = ti.Vector([spin[0], spin[1], spin[2]])
                turning_j = ti.Vector([spin_j[0], spin_j[1], spin_j[2]])
                surface = ti.Vector([motion[0] - motion_j[0], motion[1] - motion_j[1], motion[2] - motion_j[2]])
                surface += (lever * turning + lever_j * turning_j).cross(normal)
                if ti.static(self.terms.changes_restitution):
                    constants = self.constants_of_impact(live, p, i, j, surface.dot(normal))
                roll = ti.Vector([0.0, 0.0, 0.0])
                if constant_torque == 0:
                    roll = self.roll[live, p]
                force, torque, torque_j, slip, roll = contact_forces(
                    both - distance, normal, surface, turning, turning_j, place[3], place_j[3], spin[3], spin_j[3],
                    constants, self.slip[live, p], roll, step, constant_torque,
                )  # fmt: skip
                if ti.static(self.terms.attracts):
                    modulus = self.pair_law[self.tag[i][1], self.tag[j][1]][STIFFNESS]
                    force += self.terms.attraction(both - distance, 0.5 * constants[ROLLING_RADIUS], modulus) * normal
                self.slip[live, p] = slip
                if constant_torque == 0:
                    self.roll[live, p] = roll
                turn = normal.cross(force)
                sum_force += force
                sum_torque += lever * turn + torque
                self.put_force(p, force, lever_j * turn + torque_j)
                if both - distance > worst * constants[ROLLING_RADIUS]:
                    worst = (both - distance) / constants[ROLLING_RADIUS]
                p += 1
            else:
                holds = 0
                if ti.static(self.terms.has_neck):
                    pull, holds_on = self.cling(p, i, j)
                    sum_force += pull
                    holds = holds_on
                if holds == 1:
                    p += 1
                else:
                    apart -= 1
                    self.end_contact(live, p, apart)
        self.touching[live, i] = apart - self.first[live, i]
        self.push[i] = sum_force
        self.twist[i] = sum_torque
        self.worst[i] = worst

    @ti.func
    def move(self, i):
        """Sum of all forces on bead `i`, its walls included, and its way to the next step; 1 when it left its skin.

        A bead of a body leaves the sums in `push` and `twist`; its body moves it.
        """
        step = self.numbers[STEP]
        force = self.push[i]
        torque = self.twist[i]
        for q in range(self.pointed_first[i], self.pointed_first[i + 1]):
            for c in ti.static(range(3)):
                force[c] -= self.pair_force[q][c]
                torque[c] += self.pair_force[q][3 + c]

        place, motion, spin = self.place[i], self.motion[i], self.spin[i]
        position = ti.Vector([place[0], place[1], place[2]])
        velocity = ti.Vector([motion[0], motion[1], motion[2]])
        turning = ti.Vector([spin[0], spin[1], spin[2]])
        radius, mass, inertia = place[3], motion[3], spin[3]
        drag, hold, deepest = self.walls.press(
            self.counts[LIVE_LIST], i, self.tag[i][1], position, velocity, turning, radius, mass, inertia, step,
            self.counts[CONSTANT_TORQUE],
        )  # fmt: skip
        force += drag
        torque += hold
        self.worst[i] = ti.max(self.worst[i], deepest / radius)

        left_skin = 0
        if ti.static(self.rigid):
            if self.body[i] >= 0:
                self.push[i] = force
                self.twist[i] = torque
            else:
                left_skin = self.go(i, force, torque)
        else:
            left_skin = self.go(i, force, torque)
        return left_skin

    @ti.func
    def go(self, i, force, torque):
        """Move bead `i` by a step under its force and torque; 1 when it left its skin."""
        step = self.numbers[STEP]
        place, motion, spin = self.place[i], self.motion[i], self.spin[i]
        position = ti.Vector([place[0], place[1], place[2]])
        velocity = ti.Vector([motion[0], motion[1], motion[2]])
        turning = ti.Vector([spin[0], spin[1], spin[2]])
        mass, inertia = motion[3], spin[3]
        gravity = ti.Vector([self.numbers[GRAVITY], self.numbers[GRAVITY + 1], self.numbers[GRAVITY + 2]])
        push = force / mass + gravity
        if ti.static(self.terms.acts_in_flight):
            # the velocity is that of half a step ago
            now = velocity + 0.5 * step * push
            gap = self.walls.gap(self.counts[LIVE_LIST], i, place[3])
            push += self.terms.in_flight(now, gap, place[3], mass, upwards(gravity)) / mass
        twist = torque / inertia
        self.push[i] = push
        self.twist[i] = twist
        velocity += step * push
        turning += step * twist
        position += step * velocity
        moved = 0.0
        for c in ti.static(range(3)):
            self.place[i][c] = position[c]
            self.motion[i][c] = velocity[c]
            self.spin[i][c] = turning[c]
            moved += (position[c] - self.listed_at[i][c]) ** 2
        if not (velocity.norm_sqr() < self.numbers[MOST_SPEED] ** 2):
            self.counts[STATUS] = EXPLODED
            self.counts[CULPRIT] = i
        left_skin = 0
        if moved > 0.25 * self.numbers[SKIN] ** 2:
            left_skin = 1
        return left_skin

    @ti.func
    def pose_walls(self, time):
        """Put the walls where they are at `time`; 1 when one has come too far for the list."""
        step, leeway = self.numbers[STEP], 0.5 * self.numbers[SKIN]
        return self.walls.pose(self.counts[WALL_COUNT], time, step, leeway)

    @ti.func
    def move_body(self, b):
        """Body `b` to the next step; 1 when one of its beads left its skin."""
        gravity = ti.Vector([self.numbers[GRAVITY], self.numbers[GRAVITY + 1], self.numbers[GRAVITY + 2]])
        reach2, fastest2 = 0.25 * self.numbers[SKIN] ** 2, self.numbers[MOST_SPEED] ** 2
        answer = self.carry(b, self.numbers[STEP], gravity, reach2, fastest2)
        if answer >= 2:
            self.counts[STATUS] = EXPLODED
            self.counts[CULPRIT] = self.member[self.member_first[b]]
        return answer & 1

    @ti.kernel
    def run_serial(self, steps: ti.i32, before: ti.f64, alike: ti.template()):
        """Up to `steps` steps on one thread, after the `before` ones made so far.

        Stops early when the list is needed anew or STATUS is no longer OK.  `alike`: single spheres, those of one kind
        of one size; what only depends on the kinds is then looked up.
        """
        ti.loop_config(serialize=True)
        for _ in range(1):
            done = 0
            while done < steps and self.stale[0] == 0 and self.counts[STATUS] == OK:
                self.stale[0] = self.pose_walls((before + done) * self.numbers[STEP])
                if self.stale[0] == 0:
                    beads = self.counts[BEADS]
                    for i in range(beads):
                        self.meet(i, alike)
                    left_skin = 0
                    for i in range(beads):
                        left_skin |= self.move(i)
                    if ti.static(self.rigid):
                        for b in range(self.counts[BODIES]):
                            left_skin |= self.move_body(b)
                    self.stale[0] = left_skin
                    done += 1
            self.counts[DONE] = done

    @ti.kernel
    def build_alone(self, before: ti.f64):
        """The list, where it is needed anew; inlined in the step's kernel it would double what a first start takes."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if self.stale[0] == 1 and self.counts[STATUS] == OK:
                time = before * self.numbers[STEP]
                self.pose_walls(time)
                self.build(time)
            for s in range(1, FLAGS):
                self.stale[s] = 0

    @ti.kernel
    def run_step(self, s: ti.i32, beads: ti.i32, bodies: ti.i32, before: ti.f64, alike: ti.template()):
        """Step `s` of a burst on all threads; once the list is needed anew the rest of the burst does nothing."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            if self.stale[s] == 0:
                self.stale[s] = self.pose_walls((before + s) * self.numbers[STEP])
        for i in range(beads):
            if self.stale[s] == 0:
                self.meet(i, alike)
        for i in range(beads):
            left_skin = 1
            if self.stale[s] == 0:
                left_skin = self.move(i)
            if left_skin == 1:
                self.stale[s + 1] = 1
        if ti.static(self.rigid):
            for b in range(bodies):
                left_skin = 1
                if self.stale[s] == 0:
                    left_skin = self.move_body(b)
                if left_skin == 1:
                    self.stale[s + 1] = 1

    @ti.kernel
    def end_burst(self, length: ti.i32):
        """Steps really made into DONE; the list's need into the first flag."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            done = 0
            for s in range(length):
                if self.stale[s] == 0:
                    done += 1
            self.stale[0] = self.stale[length]
            self.counts[DONE] = done

    def set_stale(self) -> None:
        self.stale[0] = 1
