"""Contacts of beads with walls at rest or in motion: selection of contact points, histories and forces.

A bead near an edge overlaps several elements of the same surface.  A contact point counts only if it lies in front of
the tangent plane of every nearer contact point.  A point behind that plane belongs to the continuation of the same
surface (a coplanar neighbour, the other side of a convex edge, a wall behind a wall); a point in front belongs to
another surface (a corner).  A face thus takes precedence over its edges, and an edge over its ends, for all kinds of
elements.  A contact that replaces another one takes over its history.

Walls move in closed form: their positions follow from the time alone, so that errors do not accumulate and a run can be
resumed at any time.
"""

from rigtwin.lab.arrays import Array
from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.contact import (
    CONSTANTS,
    DAMPING,
    INERTIA,
    LAW_SIZE,
    MASS,
    RADIUS,
    STIFFNESS,
    contact_constants,
    contact_forces,
    reach,
)
from rigtwin.sim.engine.effect_terms import Terms
from rigtwin.sim.engine.walls.elements import ELEMENT_SIZE, OF_WALL, towards_element
from rigtwin.sim.engine.walls.wall_table import (
    AXIS,
    CELLS_PER_ELEMENT,
    IN_PLACE,
    ITEMS_PER_ELEMENT,
    KINDS,
    LASTS,
    MOTION_SIZE,
    PIVOT,
    SPIN,
    START,
    SWAY,
    SWAY_RATE,
    UNTIL,
    VELOCITY,
    WALLS,
    WANDERS,
    WallTable,
)

THREADS = 64  # largest number of threads of one simulation
SAME = 1e-6  # [radii]; a point in front of the tangent plane by less belongs to the same surface

GONE, STILL, MOVES = range(3)  # states of a wall
APART, HOLDS, BEHIND = range(3)  # marks of a contact; BEHIND + q: same surface as contact q


@ti.data_oriented
class WallContacts:
    """Walls near each of up to `capacity` beads, `near_capacity` entries in total, in two alternating lists."""

    def __init__(
        self,
        capacity: int,
        near_capacity: int,
        room: int,
        terms: Terms,
        walls: int = WALLS,
        threads: int = THREADS,
        *,
        weighs: bool = False,
    ) -> None:
        """`weighs`: whether the impulses of the beads on each wall are summed."""
        self.terms = terms
        self.weighs = weighs
        self.near_capacity = near_capacity
        self.room = room
        self.elements = ti.field(ti.f64, (room, ELEMENT_SIZE))
        self.cell_first = ti.field(ti.i32, CELLS_PER_ELEMENT * room + 1)
        self.items = ti.field(ti.i32, ITEMS_PER_ELEMENT * room)
        self.grid = ti.field(ti.f64, (walls, 4))
        self.grid_shape = ti.field(ti.i32, (walls, 4))
        self.motion = ti.field(ti.f64, (walls, MOTION_SIZE))
        self.law = ti.Vector.field(LAW_SIZE, ti.f64, (KINDS, walls))
        self.constants = ti.Vector.field(CONSTANTS, ti.f64, walls)  # of a contact of the first kind of spheres

        # positions of the walls in this step; each thread computes its own, so that none has to wait for another
        self.state = ti.field(ti.i32, (threads, walls))
        self.turned = ti.Matrix.field(3, 3, ti.f64, (threads, walls))
        self.pivot = ti.Vector.field(3, ti.f64, (threads, walls))
        self.velocity = ti.Vector.field(3, ti.f64, (threads, walls))
        self.spin = ti.Vector.field(3, ti.f64, (threads, walls))
        self.listed_at = ti.field(ti.f64, walls)  # duration of the motion of each wall when the list was built

        self.first = ti.field(ti.i32, (2, capacity + 1))  # first entry of a bead
        self.near = ti.field(ti.i32, (2, near_capacity))  # element
        self.touching = ti.field(ti.i32, (2, near_capacity))
        self.slip = ti.Vector.field(3, ti.f64, (2, near_capacity))
        self.roll = ti.Vector.field(3, ti.f64, (2, near_capacity))
        if terms.copies > 1:
            self.copy = ti.field(ti.i32, walls)  # copy of the simulation to which a wall belongs
        if terms.changes_restitution:
            self.impact = ti.field(ti.f64, (2, near_capacity))  # DAMPING of the present impact
        self.facing = ti.Vector.field(4, ti.f64, near_capacity)  # direction to the wall's nearest point, distance
        self.mark = ti.field(ti.i32, near_capacity)
        self.work = ti.field(ti.f64, capacity)  # [J], done by moving walls on the beads of this slot
        self.work_before = ti.field(ti.f64, ())  # [J], before the last list build
        if weighs:
            # impulse [N s] and its moment [N m s] about the wall's pivot: of each entry since the list was built, as
            # threads share no entries, and of each wall before
            self.impulse = ti.Vector.field(6, ti.f64, near_capacity)
            self.impulse_before = ti.Vector.field(6, ti.f64, walls)

    def load(self, table: WallTable, sizes: Array, step: float, linear: bool) -> None:
        """Load the walls of a simulation, with empty lists.

        `sizes` are those of the first kind of spheres (columns as in SIZES_OF_KIND), `step` [s] is the time step.
        """
        self._load(
            table.elements, table.cell_first, table.items, table.grid, table.grid_shape, table.motion, table.law,
            len(table.elements), len(table.cell_first), len(table.items), sizes, step, linear,
        )  # fmt: skip

    @ti.kernel
    def _load(
        self,
        elements: ti.types.ndarray(),
        cell_first: ti.types.ndarray(),
        items: ti.types.ndarray(),
        grid: ti.types.ndarray(),
        grid_shape: ti.types.ndarray(),
        motion: ti.types.ndarray(),
        law: ti.types.ndarray(),
        element_count: ti.i32,
        cell_count: ti.i32,
        item_count: ti.i32,
        sizes: ti.types.ndarray(),
        step: ti.f64,
        linear: ti.template(),
    ):
        ti.loop_config(serialize=True)
        for _ in range(1):
            for i in range(self.work.shape[0]):
                self.work[i] = 0.0
            for e, c in ti.ndrange(element_count, ELEMENT_SIZE):
                self.elements[e, c] = elements[e, c]
            for c in range(cell_count):
                self.cell_first[c] = cell_first[c]
            for c in range(item_count):
                self.items[c] = items[c]
            for w in range(motion.shape[0]):
                for c in range(4):
                    self.grid[w, c] = grid[w, c]
                    self.grid_shape[w, c] = grid_shape[w, c]
                for c in range(MOTION_SIZE):
                    self.motion[w, c] = motion[w, c]
                for a in range(KINDS):
                    for c in ti.static(range(LAW_SIZE)):
                        self.law[a, w][c] = law[a, w, c]
                self.listed_at[w] = 0.0
                self.constants[w] = contact_constants(
                    self.law[0, w], sizes[RADIUS], sizes[MASS], sizes[RADIUS], sizes[INERTIA], 1.0, step, linear
                )
            self.first[0, 0] = 0
            self.first[1, 0] = 0
            self.work_before[None] = 0.0
            self.forget_impulses()

    @ti.func
    def forget_impulses(self):
        if ti.static(self.weighs):
            for q in range(self.impulse.shape[0]):
                for c in ti.static(range(6)):
                    self.impulse[q][c] = 0.0
            for w in range(self.impulse_before.shape[0]):
                for c in ti.static(range(6)):
                    self.impulse_before[w][c] = 0.0

    # ------------------------------------------------------------------ where the walls are

    @ti.func
    def time_moving(self, w, time):
        return ti.min(ti.max(time - self.motion[w, START], 0.0), self.motion[w, LASTS])

    @ti.func
    def pose(self, thread, walls, time, step, leeway):
        """Set the walls to their positions at `time`, for one thread.

        Returns 1 if a wall has moved by more than `leeway` [m] since the list was built.
        """
        strayed = 0
        for w in range(walls):
            strayed = ti.max(strayed, self.pose_wall(thread, w, time, step, leeway))
        return strayed

    @ti.func
    def pose_wall(self, thread, w, time, step, leeway):
        strayed = 0
        velocity = self.motion_vector(w, VELOCITY)
        spin = self.motion[w, SPIN] * self.motion_vector(w, AXIS)
        self.state[thread, w] = STILL
        self.velocity[thread, w] = ti.Vector([0.0, 0.0, 0.0])
        self.spin[thread, w] = ti.Vector([0.0, 0.0, 0.0])
        if velocity.norm_sqr() + spin.norm_sqr() + self.motion[w, SWAY_RATE] > 0.0:
            self.state[thread, w] = MOVES
            lasted = self.time_moving(w, time)
            # mid-step velocities
            since = time - 0.5 * step - self.motion[w, START]
            if since > 0.0 and since < self.motion[w, LASTS]:
                self.velocity[thread, w] = velocity
                self.spin[thread, w] = spin
                if self.motion[w, SWAY_RATE] > 0.0:
                    rate = self.motion[w, SWAY_RATE]
                    self.velocity[thread, w] += rate * ti.cos(rate * since) * self.motion_vector(w, SWAY)
            if (lasted - self.listed_at[w]) * self.motion[w, WANDERS] > leeway:
                strayed = 1
            if self.motion[w, IN_PLACE] > 0.5:
                lasted = 0.0
            self.pivot[thread, w] = self.motion_vector(w, PIVOT) + lasted * velocity
            if self.motion[w, SWAY_RATE] > 0.0:
                self.pivot[thread, w] += ti.sin(self.motion[w, SWAY_RATE] * lasted) * self.motion_vector(w, SWAY)
            self.turned[thread, w] = rotation(self.motion_vector(w, AXIS), self.motion[w, SPIN] * lasted)
        if time >= self.motion[w, UNTIL]:
            self.state[thread, w] = GONE
        return strayed

    @ti.func
    def motion_vector(self, w, column):
        return ti.Vector([self.motion[w, column], self.motion[w, column + 1], self.motion[w, column + 2]])

    @ti.func
    def copy_of(self, w):
        """Copy of the simulation to which wall `w` belongs."""
        copy = 0
        if ti.static(self.terms.copies > 1):
            copy = self.copy[w]
        return copy

    @ti.func
    def before_it_moved(self, thread, w, position):
        """A position moved back with the wall to the wall's initial position."""
        there = position
        if self.state[thread, w] == MOVES:
            relative = position - self.pivot[thread, w]
            there = self.turned[thread, w].transpose() @ relative + self.motion_vector(w, PIVOT)
        return there

    # ------------------------------------------------------------------ the list

    @ti.func
    def note_listing(self, walls, time, beads, live, listed):
        """Record the positions of the walls, their work and impulses so far, at a list build.

        `live` is the list that ends here, of `listed` beads.
        """
        for w in range(walls):
            self.listed_at[w] = self.time_moving(w, time)
        for i in range(beads):
            self.work_before[None] = self.work_before[None] + self.work[i]
            self.work[i] = 0.0
        if ti.static(self.weighs):
            for q in range(self.first[live, listed]):
                w = int(self.elements[self.near[live, q], OF_WALL])
                for c in ti.static(range(6)):
                    self.impulse_before[w][c] = self.impulse_before[w][c] + self.impulse[q][c]
                    self.impulse[q][c] = 0.0

    @ti.func
    def list_bead(self, live, a, i, listed, places, position, reach, leeway, walls):
        """List the elements near bead `i`, which is `a` in the next list, with histories; returns the next free entry.

        `places`: first free entry, and end of the entries that may be used.
        """
        following = 1 - live
        found, end = ti.static(places)
        self.first[following, a] = found
        for w in range(walls):
            if self.state[0, w] != GONE:
                there = self.before_it_moved(0, w, position)
                far = reach
                if self.motion[w, WANDERS] > 0.0:
                    far += leeway
                cell = self.grid_shape[w, 3]
                if self.grid_shape[w, 0] > 0:
                    at = ti.Vector([0, 0, 0])
                    inside = 1
                    for c in ti.static(range(3)):
                        at[c] = int(ti.floor((there[c] - self.grid[w, c]) * self.grid[w, 3]))
                        if at[c] < 0 or at[c] >= self.grid_shape[w, c]:
                            inside = 0
                    cell += (at[2] * self.grid_shape[w, 1] + at[1]) * self.grid_shape[w, 0] + at[0]
                    if inside == 0:
                        cell = -1
                if cell >= 0:
                    for item in range(self.cell_first[cell], self.cell_first[cell + 1]):
                        e = self.items[item]
                        distance, _direction = towards_element(self.elements, e, there)
                        if distance < far:
                            if found < end:
                                self.near[following, found] = e
                                self.carry_history(live, i, listed, found)
                            found += 1
        return found

    @ti.func
    def carry_history(self, live, i, listed, new):
        following = 1 - live
        self.touching[following, new] = 0
        self.slip[following, new] = ti.Vector([0.0, 0.0, 0.0])
        self.roll[following, new] = ti.Vector([0.0, 0.0, 0.0])
        if i < listed:
            for q in range(self.first[live, i], self.first[live, i + 1]):
                if self.near[live, q] == self.near[following, new] and self.touching[live, q] == 1:
                    self.touching[following, new] = 1
                    self.slip[following, new] = self.slip[live, q]
                    self.roll[following, new] = self.roll[live, q]
                    if ti.static(self.terms.changes_restitution):
                        self.impact[following, new] = self.impact[live, q]

    @ti.func
    def move_entry(self, following, old, new):
        """Move an entry of the next list."""
        self.near[following, new] = self.near[following, old]
        self.touching[following, new] = self.touching[following, old]
        self.slip[following, new] = self.slip[following, old]
        self.roll[following, new] = self.roll[following, old]
        if ti.static(self.terms.changes_restitution):
            self.impact[following, new] = self.impact[following, old]

    # ------------------------------------------------------------------ the step

    @ti.func
    def face(self, thread, live, i, position, radius):
        """Mark the contacts of bead `i` that hold; returns the number of present and previous ones."""
        meets = 0
        for q in range(self.first[live, i], self.first[live, i + 1]):
            e = self.near[live, q]
            w = int(self.elements[e, OF_WALL])
            distance, direction = towards_element(self.elements, e, self.before_it_moved(thread, w, position))
            if self.state[thread, w] == MOVES:
                direction = self.turned[thread, w] @ direction
            if self.state[thread, w] == GONE:
                distance = 1e9
            for c in ti.static(range(3)):
                self.facing[q][c] = direction[c]
            self.facing[q][3] = distance
            self.mark[q] = APART
            if distance < radius:
                self.mark[q] = HOLDS
            if distance < radius or self.touching[live, q] == 1:
                meets += 1
        if meets > 1:
            self.tell_apart(live, i, radius)
        return meets

    @ti.func
    def tell_apart(self, live, i, radius):
        """Discard contacts that do not lie in front of the tangent plane of a nearer one."""
        for q in range(self.first[live, i], self.first[live, i + 1]):
            if self.mark[q] == HOLDS or self.touching[live, q] == 1:
                one = self.facing[q]
                for r in range(self.first[live, i], self.first[live, i + 1]):
                    other = self.facing[r]
                    nearer = other[3] < one[3] or (other[3] == one[3] and r < q)
                    if other[3] < radius and nearer:
                        along = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
                        if one[3] * along > other[3] - SAME * radius:
                            self.mark[q] = BEHIND + r

    @ti.func
    def hand_over(self, live, i):
        """Copy the history of contacts to those that replace them on the same surface."""
        for q in range(self.first[live, i], self.first[live, i + 1]):
            if self.mark[q] >= BEHIND and self.touching[live, q] == 1:
                heir = self.mark[q] - BEHIND
                if self.touching[live, heir] == 0:
                    self.touching[live, heir] = 1
                    self.slip[live, heir] = self.slip[live, q]
                    self.roll[live, heir] = self.roll[live, q]
                    if ti.static(self.terms.changes_restitution):
                        self.impact[live, heir] = self.impact[live, q]

    @ti.func
    def press(
        self, thread, live, i, kind, position, velocity, turning, radius, mass, inertia, lever, step,
        alike: ti.template(), mechanics: ti.template(),
    ):  # fmt: skip
        """Force of the walls on bead `i`, torque about its centre, grip of type A, and largest overlap."""
        force = ti.Vector([0.0, 0.0, 0.0])
        torque = ti.Vector([0.0, 0.0, 0.0])
        grip = 0.0
        deepest = 0.0
        meets = self.face(thread, live, i, position, radius)
        if meets > 1:
            self.hand_over(live, i)
        if meets > 0:
            for q in range(self.first[live, i], self.first[live, i + 1]):
                if self.mark[q] == HOLDS:
                    w = int(self.elements[self.near[live, q], OF_WALL])
                    normal = ti.Vector([self.facing[q][0], self.facing[q][1], self.facing[q][2]])
                    distance = self.facing[q][3]
                    slip = ti.Vector([0.0, 0.0, 0.0])
                    roll = ti.Vector([0.0, 0.0, 0.0])
                    if self.touching[live, q] == 1:
                        slip, roll = self.slip[live, q], self.roll[live, q]
                    surface, wall_spin, slip, roll = self.carry(
                        thread, w, position + distance * normal, normal, slip, roll, step
                    )
                    law = self.law[kind, w]
                    if ti.static(self.terms.changes_restitution):
                        if self.touching[live, q] == 0:
                            closing = (velocity - surface).dot(normal)
                            self.impact[live, q] = self.terms.damping(
                                law[DAMPING], closing, radius, mass, self.copy_of(w)
                            )
                        law[DAMPING] = self.impact[live, q]
                    constants = self.constants[w]
                    if ti.static(not alike):
                        constants = contact_constants(law, radius, mass, radius, inertia, 1.0, step, mechanics.linear)
                    drag, hold, own_grip, slip, roll = contact_forces(
                        radius - distance, normal, velocity + distance * turning.cross(normal) - surface, turning,
                        wall_spin, constants, slip, roll, step, mechanics,
                    )  # fmt: skip
                    if ti.static(self.terms.attracts):
                        pull = self.terms.attraction(radius - distance, radius, law[STIFFNESS], self.copy_of(w))
                        drag += pull * normal
                    self.slip[live, q] = slip
                    self.roll[live, q] = roll
                    self.touching[live, q] = 1
                    force += drag
                    torque += distance * normal.cross(drag) + hold
                    grip += own_grip * reach(lever, radius, normal)
                    deepest = ti.max(deepest, radius - distance)
                    if self.state[thread, w] == MOVES:
                        self.work[i] = self.work[i] + step * (drag.dot(surface) + hold.dot(wall_spin))
                    self.weigh(thread, q, w, position + distance * normal, drag, hold, step)
                elif self.touching[live, q] == 1:
                    self.touching[live, q] = 0
                    if ti.static(self.terms.has_neck):
                        force += self.hold_neck(thread, live, q, i, kind, position, radius, step)
        return force, torque, grip, deepest

    @ti.func
    def weigh(self, thread, q, w, point, force, torque, step):
        """Add the reaction to a force and a torque on a bead, which acts on wall `w` at `point`."""
        if ti.static(self.weighs):
            pivot = self.motion_vector(w, PIVOT)
            if self.state[thread, w] == MOVES:
                pivot = self.pivot[thread, w]
            moment = (point - pivot).cross(force) + torque
            for c in ti.static(range(3)):
                self.impulse[q][c] = self.impulse[q][c] - step * force[c]
                self.impulse[q][3 + c] = self.impulse[q][3 + c] - step * moment[c]

    @ti.func
    def carry(self, thread, w, point, normal, slip, roll, step):
        """Velocity of wall `w` at `point` and its spin; slip and roll of a contact there, rotated with the wall."""
        surface, spin = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0])
        new_slip, new_roll = slip, roll
        if self.state[thread, w] == MOVES:
            spin = self.spin[thread, w]
            surface = self.velocity_at(thread, w, point)
            # the history rotates with the wall about the normal; for other axes it follows the normal
            twist = step * spin.dot(normal) * normal
            new_slip += twist.cross(slip)
            new_roll += twist.cross(roll)
        return surface, spin, new_slip, new_roll

    @ti.func
    def velocity_at(self, thread, w, point):
        """Velocity of a moving wall at one of its points."""
        return self.velocity[thread, w] + self.spin[thread, w].cross(point - self.pivot[thread, w])

    @ti.func
    def hold_neck(self, thread, live, q, i, kind, position, radius, step):
        """Attractive force on bead `i` of a contact that has separated but is still held by adhesion."""
        w = int(self.elements[self.near[live, q], OF_WALL])
        modulus, copy = self.law[kind, w][STIFFNESS], self.copy_of(w)
        apart = self.facing[q][3] - radius
        force = ti.Vector([0.0, 0.0, 0.0])
        if self.mark[q] == APART and apart < self.terms.neck(radius, modulus, copy):
            self.touching[live, q] = 1
            pull = self.terms.attraction(-apart, radius, modulus, copy)
            normal = ti.Vector([self.facing[q][0], self.facing[q][1], self.facing[q][2]])
            force = pull * normal
            point = position + self.facing[q][3] * normal
            if self.state[thread, w] == MOVES:
                self.work[i] = self.work[i] + step * force.dot(self.velocity_at(thread, w, point))
            self.weigh(thread, q, w, point, force, ti.Vector([0.0, 0.0, 0.0]), step)
        return force

    @ti.func
    def gap(self, live, i, radius):
        """Gap [m] of bead `i` to the nearest wall of its list, at the last call of `face`; 1e9 without walls."""
        least = 1e9
        for q in range(self.first[live, i], self.first[live, i + 1]):
            least = ti.min(least, self.facing[q][3] - radius)
        return least

    # ------------------------------------------------------------------ data out and in

    @ti.kernel
    def get_contacts(
        self,
        beads: ti.types.ndarray(),
        found: ti.types.ndarray(),
        live: ti.i32,
        count: ti.i32,
        walls: ti.i32,
        time: ti.f64,
        step: ti.f64,
    ):
        """Overlap of each entry of the list whose contact holds, else zero; `beads` has position 3 and radius.

        Negative if the bead has separated from the wall but is still held by adhesion.
        """
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.pose(0, walls, time, step, 0.0)
            for i in range(count):
                radius = beads[i, 3]
                self.face(0, live, i, ti.Vector([beads[i, 0], beads[i, 1], beads[i, 2]]), radius)
                for q in range(self.first[live, i], self.first[live, i + 1]):
                    found[q] = 0.0
                    held = self.mark[q] == HOLDS
                    if ti.static(self.terms.has_neck):
                        held = held or (self.mark[q] == APART and self.touching[live, q] == 1)
                    if held:
                        found[q] = radius - self.facing[q][3]

    @ti.kernel
    def get_impulses(self, found: ti.types.ndarray(), live: ti.i32, beads: ti.i32, walls: ti.i32):
        """Impulse [N s] of the beads on each wall so far, and its moment [N m s] about the wall's pivot."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            for w in range(walls):
                for c in ti.static(range(6)):
                    found[w, c] = self.impulse_before[w][c]
            for q in range(self.first[live, beads]):
                w = int(self.elements[self.near[live, q], OF_WALL])
                for c in ti.static(range(6)):
                    found[w, c] = found[w, c] + self.impulse[q][c]

    @ti.kernel
    def get_list(self, first: ti.types.ndarray(), entries: ti.types.ndarray(), live: ti.i32, beads: ti.i32):
        """Read the current list: first entry of each bead; per entry element, touching, slip 3, roll 3, wall."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            for i in range(beads + 1):
                first[i] = self.first[live, i]
            for q in range(self.first[live, beads]):
                entries[q, 0] = float(self.near[live, q])
                entries[q, 1] = float(self.touching[live, q])
                entries[q, 8] = self.elements[self.near[live, q], OF_WALL]
                for c in ti.static(range(3)):
                    entries[q, 2 + c] = self.slip[live, q][c]
                    entries[q, 5 + c] = self.roll[live, q][c]

    @ti.kernel
    def put_list(self, first: ti.types.ndarray(), entries: ti.types.ndarray(), live: ti.i32, beads: ti.i32):
        ti.loop_config(serialize=True)
        for _ in range(1):
            for i in range(beads + 1):
                self.first[live, i] = first[i]
            for q in range(first[beads]):
                self.near[live, q] = int(entries[q, 0])
                self.touching[live, q] = int(entries[q, 1])
                for c in ti.static(range(3)):
                    self.slip[live, q][c] = entries[q, 2 + c]
                    self.roll[live, q][c] = entries[q, 5 + c]


@ti.func
def rotation(axis, angle):
    """Matrix of the rotation by `angle` [rad] about a unit vector."""
    s, c = ti.sin(angle), 1.0 - ti.cos(angle)
    x, y, z = axis[0], axis[1], axis[2]
    return ti.Matrix(
        [
            [1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)],
        ]
    )
