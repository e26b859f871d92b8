"""What beads do to each other in a step: the pairs that touch, gathered into packets and worked out side by side.

Of all pairs in the list a part touches.  Those of a stretch of the list are found first, what the contact law needs of
them is laid out in columns, and one plain loop over these columns works out the forces: the compiler turns it into
vector instructions, several contacts at a time.  Then the forces go to the beads.

What a bead gets from the pairs it owns and from those that others own with it is added up apart, each in list order.
Where one thread has all those pairs the second sum is made on the way; else the forces are left where the other bead
looks for them, because no two threads may write the same number.  Both ways add the same numbers in the same order.
"""

from typing import Any

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.columns import STEP
from rigtwin.sim.engine.contact import (
    DAMPING,
    INERTIA,
    LAW_SIZE,
    MASS,
    RADIUS,
    ROLLING_RADIUS,
    SHARE,
    STIFFNESS,
    constants_of_two,
    contact_forces,
)
from rigtwin.sim.engine.terms import Terms

PACKET = 128  # pairs; their columns fit the first cache
STRIDE = 2 * PACKET + 8  # a thread's packet lies so far from the next one's that none is fetched ahead into its cache
PADDING = 40  # columns whose distance is a multiple of a page would push each other out of the cache
LANES = 8  # packets are worked out in multiples of this: the loop then has no scalar rest

# rows of a packet, of four numbers each, so that whole vectors are moved: branch vector and sum of the radii, velocity
# of the owner against the other and a number that means nothing, spins of both and inertias, slip and rolling about x,
# rolling about y and z; where beads differ, their radii and masses, inertias and the law too
BETWEEN, VELOCITY, SPIN, SPIN_OTHER, SLIP, ROLL = range(6)
SIZES, INERTIAS, LAW = 6, 7, 8
ROWS = LAW + 2
FORCE, TORQUE, TORQUE_OTHER, TO_SLIP, TO_ROLL, DEPTH = 0, 3, 6, 9, 12, 15
COLUMNS = 16
# results take the places of what they were made from: force on the owner and its torque about x; its torque about y and
# z, and that of the other; force on the other and its torque about x; slip and roll as before, then the depth


def _rows(count: int, length: int) -> tuple[ti.Field, ...]:
    """Rows of four numbers each in a piece of memory of their own."""
    builder = ti.FieldsBuilder()
    rows = tuple(ti.Vector.field(4, ti.f64) for _ in range(count))
    for row in rows:
        builder.dense(ti.i, length).place(row)
    builder.finalize()
    return rows


class Pairs:
    """The part of an arena that works out pairs."""

    terms: Terms
    place: ti.Field
    motion: ti.Field
    spin: ti.Field
    tag: ti.Field
    worst: ti.Field
    numbers: ti.Field
    constants: ti.Field
    kind_sizes: ti.Field
    pair_law: ti.Field

    def __init__(self, capacity: int, pair_capacity: int, packets: int, terms: Terms) -> None:
        # two lists, of which LIVE_LIST is in force and the other is the last one or the next one
        self.first = ti.field(ti.i32, (2, capacity + 1))  # first pair of a bead
        self.partner = ti.field(ti.i32, (2, pair_capacity))
        self.touching = ti.field(ti.i8, (2, pair_capacity))
        # slip, roll; zero where apart.  Between two builds the list that is not in force needs none: there lie the
        # forces of the pairs, force on the owner, torque on the other, sorted by the other
        self.history = ti.Vector.field(6, ti.f64, (2, pair_capacity))
        if terms.changes_restitution:
            self.impact: Any = ti.field(ti.f64, (2, pair_capacity))  # DAMPING of this impact
        self.owner_of = ti.field(ti.i32, pair_capacity)  # of a pair of the list in force
        self.pointed_first = ti.field(ti.i32, capacity + 1)  # first of the forces of pairs that point to a bead
        self.place_of_force = ti.field(ti.i32, pair_capacity)  # of a pair of the list in force
        # force and torque on a bead, zero between steps
        self.given = ti.Vector.field(6, ti.f64, capacity)  # by the pairs that it owns
        self.taken = ti.Vector.field(6, ti.f64, capacity)  # by those that others own, with the other sign: force
        self.chosen = ti.field(ti.i32, packets * STRIDE)  # pairs of a packet
        self.packet = _rows(ROWS, packets * STRIDE + PADDING)
        self.result = ti.Vector.field(COLUMNS, ti.f64, packets * STRIDE + PADDING, layout=ti.Layout.SOA)

    # ------------------------------------------------------------------ finding those that touch

    @ti.func
    def choose(self, live, begin, end, chunk):
        """Pairs of the list from `begin` to `end` that touch, noted for their packet; how many."""
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
            # written in any case: that is cheaper than a branch that goes either way
            self.chosen[chunk * STRIDE + count] = p
            count += int(touches)
        return count

    @ti.func
    def holds_on(self, live, p):
        """1 when the beads of a pair have parted but still hold together."""
        i, j = self.owner_of[p], self.partner[live, p]
        place, place_j = self.place[i], self.place[j]
        between = ti.Vector([place_j[0] - place[0], place_j[1] - place[1], place_j[2] - place[2]])
        both = place[3] + place_j[3]
        modulus = self.pair_law[self.tag[i][1], self.tag[j][1]][STIFFNESS]
        return ti.cast(between.norm() - both < self.terms.neck(place[3] * place_j[3] / both, modulus), ti.i8)

    @ti.func
    def change(self, live, p, touches):
        """A contact begins or ends."""
        self.touching[live, p] = touches
        place = self.place_of_force[p]
        for c in ti.static(range(6)):
            self.history[live, p][c] = 0.0
            self.history[1 - live, place][c] = 0.0
        if ti.static(self.terms.changes_restitution):
            # of one that ends nobody asks any more
            self.impact[live, p] = self.damping_of_impact(self.owner_of[p], self.partner[live, p])

    @ti.func
    def damping_of_impact(self, i, j):
        """Where restitution depends on the speed of impact: DAMPING of one that begins now."""
        place, place_j, motion, motion_j = self.place[i], self.place[j], self.motion[i], self.motion[j]
        between = ti.Vector([place_j[0] - place[0], place_j[1] - place[1], place_j[2] - place[2]])
        velocity = ti.Vector([motion[0] - motion_j[0], motion[1] - motion_j[1], motion[2] - motion_j[2]])
        radius_eff = place[3] * place_j[3] / (place[3] + place_j[3])
        mass_eff = motion[3] * motion_j[3] / (motion[3] + motion_j[3])
        damping = self.pair_law[self.tag[i][1], self.tag[j][1]][DAMPING]
        return self.terms.damping_of_pair(damping, velocity.dot(between) / between.norm(), radius_eff, mass_eff)

    # ------------------------------------------------------------------ working them out

    @ti.func
    def gather(self, live, chunk, count, alike: ti.template(), mechanics: ti.template()):
        """Lay out what the contact law needs of the chosen pairs."""
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
            if ti.static(not mechanics.constant_torque):
                for c in ti.static(range(2)):
                    self.packet[ROLL][k][c] = history[4 + c]
            if ti.static(not alike):
                law = self.pair_law[self.tag[i][1], self.tag[j][1]]
                if ti.static(self.terms.changes_restitution):
                    law[DAMPING] = self.impact[live, p]
                for c in ti.static(range(LAW_SIZE)):
                    self.packet[LAW + c // 4][k][c % 4] = law[c]
                for c in ti.static(range(2)):
                    self.packet[SIZES][k][c] = (place[3], place_j[3])[c]
                    self.packet[SIZES][k][2 + c] = (motion[3], motion_j[3])[c]
                    self.packet[INERTIAS][k][c] = (spin[3], spin_j[3])[c]

    @ti.func
    def work_out(self, chunk, count, alike: ti.template(), mechanics: ti.template()):
        """Forces of the chosen pairs.  One loop without calls, gathers or early ends: it is to become vector code."""
        room = chunk * STRIDE
        step = self.numbers[STEP]
        same_law, same = self.pair_law[0, 0], self.constants[None]
        size = self.kind_sizes[None]
        self.packet[0][room + count][0] = 1.0
        for k in range(room, room + count):
            law, constants = same_law, same
            radius, radius_j, mass, mass_j, inertia, inertia_j = (
                size[RADIUS], size[RADIUS], size[MASS], size[MASS], size[INERTIA], size[INERTIA],
            )  # fmt: skip
            if ti.static(not alike):
                radius, radius_j = self.packet[SIZES][k][0], self.packet[SIZES][k][1]
                mass, mass_j = self.packet[SIZES][k][2], self.packet[SIZES][k][3]
                inertia, inertia_j = self.packet[INERTIAS][k][0], self.packet[INERTIAS][k][1]
                for c in ti.static(range(LAW_SIZE)):
                    law[c] = self.packet[LAW + c // 4][k][c % 4]
                constants = constants_of_two(
                    law, radius, radius_j, mass, mass_j, inertia, inertia_j, step, mechanics.linear
                )
            between = self.three(BETWEEN, k)
            turning = self.three(SPIN, k)
            turning_j = self.three(SPIN_OTHER, k)
            slip = self.three(SLIP, k)
            roll = ti.Vector([0.0, 0.0, 0.0])
            if ti.static(not mechanics.constant_torque):
                roll = ti.Vector([self.packet[SLIP][k][3], self.packet[ROLL][k][0], self.packet[ROLL][k][1]])
            distance2 = between.norm_sqr()
            distance = ti.sqrt(distance2)
            normal = between * (distance * (1.0 / distance2))  # the division need not wait for the root
            lever = constants[SHARE] * distance
            lever_j = distance - lever
            surface = self.three(VELOCITY, k)
            surface += (lever * turning + lever_j * turning_j).cross(normal)
            overlap = self.packet[BETWEEN][k][3] - distance
            held = overlap
            if ti.static(self.terms.has_neck):
                held = ti.max(overlap, 0.0)
            force, torque, torque_j, slip, roll = contact_forces(
                held, normal, surface, turning, turning_j, radius, radius_j, inertia, inertia_j, constants, slip, roll,
                step, mechanics,
            )  # fmt: skip
            if ti.static(self.terms.attracts):
                force += self.terms.attraction(overlap, 0.5 * constants[ROLLING_RADIUS], law[STIFFNESS]) * normal
            turn = normal.cross(force)
            torque += lever * turn
            torque_j += lever_j * turn
            depth = overlap * (1.0 / constants[ROLLING_RADIUS])
            for c in ti.static(range(3)):
                self.result[k][FORCE + c] = force[c]
                self.result[k][TORQUE + c] = torque[c]
                self.result[k][TORQUE_OTHER + c] = torque_j[c]
                self.result[k][TO_SLIP + c] = slip[c]
                if ti.static(not mechanics.constant_torque):
                    self.result[k][TO_ROLL + c] = roll[c]
            self.result[k][DEPTH] = depth

    @ti.func
    def three(self, row: ti.template(), k):
        """The first three numbers of a row, as a vector."""
        return ti.Vector([self.packet[row][k][0], self.packet[row][k][1], self.packet[row][k][2]])

    @ti.func
    def deliver(self, live, chunk, count, own, stop, mechanics: ti.template()):
        """Bring forces to the beads and histories back to the pairs; nobody else gives to beads `own` to `stop` - 1."""
        room = chunk * STRIDE
        deepest = 0.0
        for k in range(room, room + count):
            p = self.chosen[k]
            i, j = self.owner_of[p], self.partner[live, p]
            for c in ti.static(range(3)):
                self.history[live, p][c] = self.result[k][TO_SLIP + c]
                if ti.static(not mechanics.constant_torque):
                    self.history[live, p][3 + c] = self.result[k][TO_ROLL + c]
                self.given[i][c] = self.given[i][c] + self.result[k][FORCE + c]
                self.given[i][3 + c] = self.given[i][3 + c] + self.result[k][TORQUE + c]
            if own <= j < stop:
                for c in ti.static(range(3)):
                    self.taken[j][c] = self.taken[j][c] - self.result[k][FORCE + c]
                    self.taken[j][3 + c] = self.taken[j][3 + c] + self.result[k][TORQUE_OTHER + c]
            else:
                place = self.place_of_force[p]
                for c in ti.static(range(3)):
                    self.history[1 - live, place][c] = -self.result[k][FORCE + c]
                    self.history[1 - live, place][3 + c] = self.result[k][TORQUE_OTHER + c]
            if self.result[k][DEPTH] > deepest:
                deepest = self.result[k][DEPTH]
        if deepest > 0.0:
            first = self.owner_of[self.chosen[room]]
            if deepest > self.worst[first]:
                self.worst[first] = deepest

    @ti.func
    def meet(self, live, begin, end, chunk, own, stop, alike: ti.template(), mechanics: ti.template()):
        """Forces of the pairs from `begin` to `end`, at most PACKET; `chunk` says which packet is free for that, and
        beads `own` to `stop` - 1 get forces from nobody else.
        """
        count = self.choose(live, begin, end, chunk)
        self.gather(live, chunk, count, alike, mechanics)
        self.work_out(chunk, (count + LANES - 1) // LANES * LANES + 1, alike, mechanics)
        self.deliver(live, chunk, count, own, stop, mechanics)

    @ti.func
    def sum_taken(self, live, i):
        """What the pairs that others own with bead `i` do to it, where they left it."""
        total = ti.Vector([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        for q in range(self.pointed_first[i], self.pointed_first[i + 1]):
            total += self.history[1 - live, q]
        return total
