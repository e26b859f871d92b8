"""Forces between beads: pairs in contact are gathered into packets, whose forces are computed in vector code.

Only some of the pairs in the list are in contact.  Those of a stretch of the list are found first, and the input of the
contact law is stored in rows of four numbers, which are loaded and stored as vectors.  A plain loop over these rows
computes the forces; the compiler turns it into vector instructions, four contacts at a time.  Then the forces are added
to the beads.  See docs/decisions/0006 for the form that the loop must have.

The forces on a bead from the pairs that it owns, and from those that other beads own, are summed separately, each in
list order.  If one thread has all pairs of the second kind, their sum is built during the loop.  Otherwise the forces
are stored for the other bead to collect, because no two threads may write the same number.  Both ways add the same
numbers in the same order.
"""

from typing import Any

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.bulk.table_layout import STEP
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
from rigtwin.sim.engine.effect_terms import Terms

PACKET = 128  # pairs; their rows fit the first-level cache
STRIDE = PACKET + 24  # gap between the packets of two threads, so that none is prefetched into the other's cache
PADDING = 40  # entries; rows at a distance of a multiple of a page would evict each other from the cache
LANES = 4  # contacts per vector instruction

# rows of a packet: branch vector and sum of the radii; velocity of the owner against the other; spins and inertias of
# both; slip and rolling about x; rolling about y and z
BETWEEN, VELOCITY, SPIN, SPIN_OTHER, SLIP, ROLL = range(6)
# further rows if beads differ: the constants of the contact
CONSTANT = 6
ROWS = 9
# columns from which the constants are computed: radii, masses and inertias of both, the law
RADII, MASSES, INERTIAS, LAW = 0, 2, 4, 6
COLUMNS = LAW + LAW_SIZE
# rows of results: force on the owner and its torque about x; its torque about y and z, and that of the other; force on
# the other and its torque about x; slip and rolling about x; rolling about y and z, and the depth.  Under type A grip
# and depth replace the force on the other, and there is no row of rolling.
GIVEN, GIVEN_AND_TAKEN, TAKEN, NEW_SLIP, NEW_ROLL = range(5)
RESULTS = 5


def _rows(rows: int, columns: int, length: int) -> tuple[tuple[ti.Field, ...], tuple[ti.Field, ...]]:
    """Rows of four numbers and single columns, in a separate block of memory."""
    builder = ti.FieldsBuilder()
    fours = tuple(ti.Vector.field(4, ti.f64) for _ in range(rows))
    ones = tuple(ti.field(ti.f64) for _ in range(columns))
    for field in fours + ones:
        builder.dense(ti.i, length).place(field)
    builder.finalize()
    return fours, ones


class Pairs:
    """Part of an arena that computes the forces of pairs."""

    terms: Terms
    rigid: bool
    constant_torque: bool
    place: ti.Field
    motion: ti.Field
    spin: ti.Field
    tag: ti.Field
    worst: ti.Field
    numbers: ti.Field
    constants: ti.Field
    pair_law: ti.Field
    reach: Any  # of a contact, see `RigidBodies`

    def __init__(self, capacity: int, pair_capacity: int, packets: int, terms: Terms) -> None:
        # two lists: LIVE_LIST is the current one, the other the previous or the next one
        self.first = ti.field(ti.i32, (2, capacity + 1))  # first pair of a bead
        self.partner = ti.field(ti.i32, (2, pair_capacity))
        self.touching = ti.field(ti.i8, (2, pair_capacity))
        # slip and roll; zero without contact.  Between two builds the row of the other list is free: it stores the
        # forces and torques of the pairs on their other bead, sorted by that bead
        self.history = ti.Vector.field(6, ti.f64, (2, pair_capacity))
        if terms.changes_restitution:
            self.impact: Any = ti.field(ti.f64, (2, pair_capacity))  # DAMPING of the present impact
        self.owner_of = ti.field(ti.i32, pair_capacity)  # of a pair of the current list
        self.pointed_first = ti.field(
            ti.i32, capacity + 1
        )  # first of the forces of pairs in which a bead is the other one
        self.place_of_force = ti.field(ti.i32, pair_capacity)  # of a pair of the current list
        self.sums = 6
        if self.constant_torque:
            self.sums = 7
            self.grip: Any = ti.field(
                ti.f64, pair_capacity
            )  # [N], of the pairs on their other bead, sorted as the forces
        # force, torque and, under type A, grip on a bead; zero between steps
        self.given = ti.Vector.field(self.sums, ti.f64, capacity)  # from the pairs that it owns
        self.taken = ti.Vector.field(self.sums, ti.f64, capacity)  # from the pairs that other beads own
        self.chosen = ti.field(ti.i32, packets * STRIDE)  # pairs of a packet
        length = packets * STRIDE + PADDING
        self.packet, self.column = _rows(ROWS, COLUMNS, length)
        self.result, _ = _rows(RESULTS, 0, length)

    # ------------------------------------------------------------------ finding contacts

    @ti.func
    def choose(self, live, begin, end, chunk):
        """Store the pairs in contact from `begin` to `end` of the list in `chosen`; returns their number."""
        count = 0
        for p in range(begin, end):
            place, place_j = self.place[self.owner_of[p]], self.place[self.partner[live, p]]
            both = place[3] + place_j[3]
            distance2 = 0.0
            for c in ti.static(range(3)):
                distance2 += (place_j[c] - place[c]) ** 2
            touches = ti.cast(distance2 < both * both, ti.i8)
            if ti.static(self.terms.has_neck):
                touches |= self.touching[live, p] & self.holds_on(live, p)
            if touches != self.touching[live, p]:
                self.change(live, p, touches)
            # written in any case, which is cheaper than an unpredictable branch
            self.chosen[chunk * STRIDE + count] = p
            count += int(touches)
        return count

    @ti.func
    def holds_on(self, live, p):
        """1 if the beads of a pair have separated but adhesion still holds them."""
        i, j = self.owner_of[p], self.partner[live, p]
        place, place_j = self.place[i], self.place[j]
        between = ti.Vector([place_j[0] - place[0], place_j[1] - place[1], place_j[2] - place[2]])
        both = place[3] + place_j[3]
        modulus = self.pair_law[self.tag[i][1], self.tag[j][1]][STIFFNESS]
        return ti.cast(between.norm() - both < self.terms.neck(place[3] * place_j[3] / both, modulus), ti.i8)

    @ti.func
    def change(self, live, p, touches):
        """Reset the history of a contact that begins or ends."""
        self.touching[live, p] = touches
        place = self.place_of_force[p]
        for c in ti.static(range(6)):
            self.history[live, p][c] = 0.0
            self.history[1 - live, place][c] = 0.0
        if ti.static(self.constant_torque):
            self.grip[place] = 0.0
        if ti.static(self.terms.changes_restitution):
            # the value of a contact that ends is never read
            self.impact[live, p] = self.damping_of_impact(self.owner_of[p], self.partner[live, p])

    @ti.func
    def damping_of_impact(self, i, j):
        """DAMPING of an impact that begins now, if restitution depends on the impact speed."""
        place, place_j, motion, motion_j = self.place[i], self.place[j], self.motion[i], self.motion[j]
        between = ti.Vector([place_j[0] - place[0], place_j[1] - place[1], place_j[2] - place[2]])
        velocity = ti.Vector([motion[0] - motion_j[0], motion[1] - motion_j[1], motion[2] - motion_j[2]])
        radius_eff = place[3] * place_j[3] / (place[3] + place_j[3])
        mass_eff = motion[3] * motion_j[3] / (motion[3] + motion_j[3])
        damping = self.pair_law[self.tag[i][1], self.tag[j][1]][DAMPING]
        return self.terms.damping_of_pair(damping, velocity.dot(between) / between.norm(), radius_eff, mass_eff)

    # ------------------------------------------------------------------ forces

    @ti.func
    def gather(self, live, chunk, count, alike: ti.template()):
        """Store the input of the contact law for the chosen pairs in the rows of the packet."""
        room = chunk * STRIDE
        for k in range(room, room + count):
            p = self.chosen[k]
            i, j = self.owner_of[p], self.partner[live, p]
            place, motion, spin = self.place[i], self.motion[i], self.spin[i]
            place_j, motion_j, spin_j = self.place[j], self.motion[j], self.spin[j]
            history = self.history[live, p]
            for c in ti.static(range(4)):
                self.packet[VELOCITY][k][c] = motion[c] - motion_j[c]
                self.packet[SPIN][k][c] = spin[c]
                self.packet[SPIN_OTHER][k][c] = spin_j[c]
                self.packet[SLIP][k][c] = history[c]
            for c in ti.static(range(3)):
                self.packet[BETWEEN][k][c] = place_j[c] - place[c]
            self.packet[BETWEEN][k][3] = place[3] + place_j[3]
            if ti.static(not self.constant_torque):
                for c in ti.static(range(2)):
                    self.packet[ROLL][k][c] = history[4 + c]
            if ti.static(not alike):
                law = self.pair_law[self.tag[i][1], self.tag[j][1]]
                if ti.static(self.terms.changes_restitution):
                    law[DAMPING] = self.impact[live, p]
                for c in ti.static(range(LAW_SIZE)):
                    self.column[LAW + c][k] = law[c]
                for c in ti.static(range(2)):
                    self.column[RADII + c][k] = (place[3], place_j[3])[c]
                    self.column[MASSES + c][k] = (motion[3], motion_j[3])[c]
                    self.column[INERTIAS + c][k] = (spin[3], spin_j[3])[c]

    @ti.func
    def reach_rows(self, behind):
        """Write to the memory blocks of packets, at an entry `behind` all that are used.

        The compiler then loads their addresses here and not in the following loop, which would otherwise stay scalar.
        """
        self.packet[BETWEEN][behind][0] = 1.0
        self.result[GIVEN][behind][0] = 0.0

    @ti.func
    def prepare(self, chunk, count, mechanics: ti.template()):
        """Constants of the chosen contacts, if beads differ; also vector code."""
        room = chunk * STRIDE
        step = self.numbers[STEP]
        self.reach_rows(room + count)
        for k in range(room, room + count):
            law = ti.Vector([0.0] * LAW_SIZE)
            for c in ti.static(range(LAW_SIZE)):
                law[c] = self.column[LAW + c][k]
            constants = constants_of_two(
                law, self.column[RADII][k], self.column[RADII + 1][k], self.column[MASSES][k],
                self.column[MASSES + 1][k], self.column[INERTIAS][k], self.column[INERTIAS + 1][k], step,
                mechanics.linear,
            )  # fmt: skip
            for c in ti.static(range(CONSTANTS)):
                self.packet[CONSTANT + c // 4][k][c % 4] = constants[c]

    @ti.func
    def work_out(self, chunk, count, alike: ti.template(), mechanics: ti.template()):
        """Forces of the chosen pairs.  A loop without calls, gathers or early exits, so that it becomes vector code."""
        room = chunk * STRIDE
        step = self.numbers[STEP]
        same_law, same = self.pair_law[0, 0], self.constants[None]
        self.reach_rows(room + count)
        for k in range(room, room + count):
            constants, modulus = same, same_law[STIFFNESS]
            if ti.static(not alike):
                modulus = self.column[LAW + STIFFNESS][k]
                for c in ti.static(range(CONSTANTS)):
                    constants[c] = self.packet[CONSTANT + c // 4][k][c % 4]
            between = self.three(BETWEEN, k)
            turning = self.three(SPIN, k)
            turning_j = self.three(SPIN_OTHER, k)
            slip = self.three(SLIP, k)
            roll = ti.Vector([0.0, 0.0, 0.0])
            if ti.static(not self.constant_torque):
                roll = ti.Vector([self.packet[SLIP][k][3], self.packet[ROLL][k][0], self.packet[ROLL][k][1]])
            distance2 = between.norm_sqr()
            distance = ti.sqrt(distance2)
            normal = between * (distance * (1.0 / distance2))  # the division does not have to wait for the root
            lever = constants[SHARE] * distance
            lever_j = distance - lever
            surface = self.three(VELOCITY, k)
            surface += (lever * turning + lever_j * turning_j).cross(normal)
            overlap = self.packet[BETWEEN][k][3] - distance
            held = overlap
            if ti.static(self.terms.has_neck):
                held = ti.max(overlap, 0.0)
            force, torque, grip, slip, roll = contact_forces(
                held, normal, surface, turning, turning_j, constants, slip, roll, step, mechanics
            )  # fmt: skip
            if ti.static(self.terms.attracts):
                force += self.terms.attraction(overlap, 0.5 * constants[ROLLING_RADIUS], modulus) * normal
            turn = normal.cross(force)
            torque_j = lever_j * turn - torque
            torque += lever * turn
            depth = overlap * (1.0 / constants[ROLLING_RADIUS])
            # rows are written completely; a gap would keep the loop scalar
            for c in ti.static(range(4)):
                self.result[GIVEN][k][c] = (force[0], force[1], force[2], torque[0])[c]
                self.result[GIVEN_AND_TAKEN][k][c] = (torque[1], torque[2], torque_j[1], torque_j[2])[c]
                self.result[NEW_SLIP][k][c] = (slip[0], slip[1], slip[2], roll[0])[c]
                if ti.static(self.constant_torque):
                    self.result[TAKEN][k][c] = (grip, depth, 0.0, torque_j[0])[c]
                else:
                    self.result[TAKEN][k][c] = (-force[0], -force[1], -force[2], torque_j[0])[c]
                    self.result[NEW_ROLL][k][c] = (roll[1], roll[2], 0.0, depth)[c]

    @ti.func
    def three(self, row: ti.template(), k):
        """The first three numbers of a row, as a vector."""
        return ti.Vector([self.packet[row][k][0], self.packet[row][k][1], self.packet[row][k][2]])

    @ti.func
    def deliver(self, live, chunk, count, own, stop):
        """Add forces to beads and store histories; beads `own` to `stop` - 1 get forces from this thread only."""
        room = chunk * STRIDE
        deepest = 0.0
        for k in range(room, room + count):
            p = self.chosen[k]
            i, j = self.owner_of[p], self.partner[live, p]
            # all reads precede all writes, so that the compiler uses vector moves
            on_i, on_both, on_j = self.result[GIVEN][k], self.result[GIVEN_AND_TAKEN][k], self.result[TAKEN][k]
            slip, given = self.result[NEW_SLIP][k], self.given[i]
            grip, depth = on_j[0], on_j[1]
            for c in ti.static(range(3)):
                self.history[live, p][c] = slip[c]
            grip_j = grip
            if ti.static(self.constant_torque):
                for c in ti.static(range(3)):
                    on_j[c] = -on_i[c]
                if ti.static(self.rigid):
                    normal = self.three(BETWEEN, k).normalized()
                    grip_j *= self.reach(j, -normal)
                    grip *= self.reach(i, normal)
            else:
                roll = self.result[NEW_ROLL][k]
                depth = roll[3]
                self.history[live, p][3] = slip[3]
                for c in ti.static(range(2)):
                    self.history[live, p][4 + c] = roll[c]
            for c in ti.static(range(4)):
                self.given[i][c] = given[c] + on_i[c]
            for c in ti.static(range(2)):
                self.given[i][4 + c] = given[4 + c] + on_both[c]
            if ti.static(self.constant_torque):
                self.given[i][6] = given[6] + grip
            self.hand_to_other(live, p, j, on_j, on_both, grip_j, own <= j < stop)
            deepest = ti.max(deepest, depth)
        if deepest > 0.0:
            # any bead of the packet may store it: only the overall maximum is read
            first = self.owner_of[self.chosen[room]]
            self.worst[first] = ti.max(self.worst[first], deepest)

    @ti.func
    def hand_to_other(self, live, p, j, on_j, on_both, grip, alone):
        """Add the force of pair `p` to its other bead `j`, or store it there if other threads may write to `taken`."""
        if alone:
            taken = self.taken[j]
            for c in ti.static(range(4)):
                self.taken[j][c] = taken[c] + on_j[c]
            for c in ti.static(range(2)):
                self.taken[j][4 + c] = taken[4 + c] + on_both[2 + c]
            if ti.static(self.constant_torque):
                self.taken[j][6] = taken[6] + grip
        else:
            place = self.place_of_force[p]
            for c in ti.static(range(4)):
                self.history[1 - live, place][c] = on_j[c]
            for c in ti.static(range(2)):
                self.history[1 - live, place][4 + c] = on_both[2 + c]
            if ti.static(self.constant_torque):
                self.grip[place] = grip

    @ti.func
    def meet(self, live, begin, end, chunk, own, stop, alike: ti.template(), mechanics: ti.template()):
        """Forces of the pairs from `begin` to `end`, at most PACKET, in packet number `chunk`.

        Beads `own` to `stop` - 1 get forces from this thread only.
        """
        count = self.choose(live, begin, end, chunk)
        self.gather(live, chunk, count, alike)
        # a loop that writes unused numbers ends in a scalar contact, so there is one more than a multiple of LANES
        lanes = (count + LANES - 1) // LANES * LANES + 1
        if ti.static(not alike):
            self.prepare(chunk, lanes, mechanics)
        self.work_out(chunk, lanes, alike, mechanics)
        self.deliver(live, chunk, count, own, stop)

    @ti.func
    def sum_taken(self, live, i):
        """Sum of the stored forces on bead `i` from pairs that other beads own."""
        total = ti.Vector([0.0] * self.sums)
        for q in range(self.pointed_first[i], self.pointed_first[i + 1]):
            for c in ti.static(range(6)):
                total[c] += self.history[1 - live, q][c]
            if ti.static(self.constant_torque):
                total[6] += self.grip[q]
        return total
