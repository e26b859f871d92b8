"""Taichi fields and kernels of the bulk engine: many spheres, half Verlet list, no atomics in the force sum.

(`a[i] = a[i] + x` is used instead of `a[i] += x`, which Taichi makes atomic.)

A step computes the forces of the pairs (see `pair_forces.py`); then each bead adds the forces of its walls and moves.
Both proceed together through the list: a bead whose pairs are all done moves while it is still in the cache.  Threads
share the list as described in `thread_team.py`.  A bead of a rigid body leaves its force sum to its body, which moves
last (see `rigid_bodies.py`); an arena without bodies is compiled without this code.  No two threads write the same
number, and every sum has a fixed order, so the results do not depend on the number of threads, to the bit.

State between launches: position at t; velocity and spin at t - step/2 (leapfrog form of velocity Verlet); and the last
accelerations, from which the velocity at t follows.

Materials, walls, gravity and time step are data, and sizes come in a few classes, so that a new run needs no
recompilation.
"""

from functools import cache
from typing import Any

from rigtwin.sim.engine.backend import GRAIN, ti
from rigtwin.sim.engine.bulk.neighbour_list import Neighbours
from rigtwin.sim.engine.bulk.pair_forces import PACKET, Pairs
from rigtwin.sim.engine.bulk.rigid_bodies import RigidBodies
from rigtwin.sim.engine.bulk.table_layout import (
    BEADS,
    BEFORE,
    BODIES,
    BURST_LENGTH,
    CHUNKS,
    COUNTS,
    CULPRIT,
    DONE,
    EXPLODED,
    GRAVITY,
    KEPT,
    LATE,
    LISTED,
    LIVE_LIST,
    MOST_SPEED,
    NUMBERS,
    OK,
    PAIRS,
    SKIN,
    STAGE,
    STATUS,
    STEP,
    WALL_COUNT,
)
from rigtwin.sim.engine.bulk.thread_team import LATE_AT, LEFT_AT, PATIENCE, WAITED, Team
from rigtwin.sim.engine.contact import (
    CONSTANTS,
    LAW_SIZE,
    LIGHTNESS,
    NIMBLENESS,
    SIZES_OF_KIND,
    Mechanics,
    Rolling,
    braked,
    constants_of_two,
    what_turned,
)
from rigtwin.sim.engine.effect_terms import Terms, upwards
from rigtwin.sim.engine.walls.wall_contacts import THREADS, WallContacts
from rigtwin.sim.engine.walls.wall_table import KINDS, ROOM

FLAGS = 17  # steps of one multi-threaded burst, plus one
BURST = FLAGS - 1


@cache
def arena(
    capacity: int,
    pair_capacity: int,
    near_capacity: int,
    terms: Terms,
    room: int = ROOM,
    rigid: bool = False,
    rolling: Rolling = "type C",
    weighs: bool = False,
) -> "Arena":
    """Arena of this size; its fields are allocated once per process, as Taichi fails after about 500 fields."""
    return Arena(capacity, pair_capacity, near_capacity, terms, room, rigid, rolling, weighs)


@ti.data_oriented
class Arena(Neighbours, Team):
    """State of up to `capacity` beads, `pair_capacity` neighbouring pairs and `near_capacity` walls near beads.

    `rigid`: whether beads may be parts of rigid bodies.  `rolling`: rolling resistance model.  `weighs`: whether the
    impulses of the beads on each wall are summed.
    """

    def __init__(
        self,
        capacity: int,
        pair_capacity: int,
        near_capacity: int,
        terms: Terms,
        room: int,
        rigid: bool,
        rolling: Rolling,
        weighs: bool,
    ) -> None:
        self.terms = terms
        self.capacity = capacity
        self.pair_capacity = pair_capacity
        self.rigid = rigid
        mechanics = Mechanics(rolling=rolling)
        self.constant_torque, self.holds = mechanics.constant_torque, mechanics.holds
        self.walls = WallContacts(capacity, near_capacity, room, terms, weighs=weighs)
        self.owner: object = None  # the simulation that uses this arena
        self.place = ti.Vector.field(4, ti.f64, capacity)  # position, radius
        self.motion = ti.Vector.field(4, ti.f64, capacity)  # velocity half a step back, mass
        self.spin = ti.Vector.field(4, ti.f64, capacity)  # spin half a step back, inertia
        self.push = ti.Vector.field(3, ti.f64, capacity)  # acceleration
        self.twist = ti.Vector.field(3, ti.f64, capacity)  # angular acceleration
        self.listed_at = ti.Vector.field(3, ti.f64, capacity)  # position when the list was built
        self.tag = ti.Vector.field(2, ti.i32, capacity)  # ident, kind
        self.worst = ti.field(ti.f64, capacity)  # largest overlap/radius seen by this slot's pairs and walls
        if terms.acts_in_flight:
            self.flight: Any = ti.field(ti.f64, capacity)  # [J], work of forces in flight on the beads of this slot
            self.flight_before: Any = ti.field(ti.f64, ())  # [J], work before the last list build
        if rigid:
            RigidBodies.__init__(self, capacity, self.constant_torque)
        Pairs.__init__(self, capacity, pair_capacity, THREADS, terms)
        Team.__init__(self, 3 if rigid else 2)
        self.make_cells(capacity)

        self.numbers = ti.field(ti.f64, NUMBERS)
        self.counts = ti.field(ti.i32, COUNTS)
        self.stale = ti.field(ti.i32, FLAGS)
        self.pair_law = ti.Vector.field(LAW_SIZE, ti.f64, (KINDS, KINDS))
        self.kind_sizes = ti.Vector.field(SIZES_OF_KIND, ti.f64, ())  # of the first kind of spheres
        self.constants = ti.Vector.field(CONSTANTS, ti.f64, ())  # of a contact of two spheres of the first kind

    # ------------------------------------------------------------------ data in and out

    @ti.kernel
    def configure(
        self,
        numbers: ti.types.ndarray(),
        counts: ti.types.ndarray(),
        pair_law: ti.types.ndarray(),
        sizes: ti.types.ndarray(),
        linear: ti.template(),
    ):
        """Empty the arena and set everything that is constant in a run.

        `sizes` are those of the first kind of spheres (columns as in SIZES_OF_KIND).
        """
        ti.loop_config(serialize=True)
        for _ in range(1):
            for c in range(NUMBERS):
                self.numbers[c] = numbers[c]
            for c in range(COUNTS):
                self.counts[c] = counts[c]
            for a in range(pair_law.shape[0]):  # run-time length, or the compiler would unroll the loop
                for c in ti.static(range(LAW_SIZE)):
                    for b in range(pair_law.shape[1]):
                        self.pair_law[a, b][c] = pair_law[a, b, c]
            for c in ti.static(range(SIZES_OF_KIND)):
                self.kind_sizes[None][c] = sizes[c]
            self.constants[None] = constants_of_two(
                self.pair_law[0, 0], sizes[0], sizes[0], sizes[1], sizes[1], sizes[2], sizes[2], numbers[STEP], linear
            )
            self.first[0, 0] = 0
            self.first[1, 0] = 0
            if ti.static(self.terms.acts_in_flight):
                self.flight_before[None] = 0.0
                for i in range(self.flight.shape[0]):
                    self.flight[i] = 0.0

    @ti.kernel
    def set_count(self, column: ti.i32, value: ti.i32):
        """Change one of `counts`; the list is rebuilt before the next step."""
        self.counts[column] = value
        self.stale[0] = 1

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
        """Read the current list: first pair of each bead; per pair partner, touching, slip 3, roll 3, impact."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            live = self.counts[LIVE_LIST]
            for i in range(beads + 1):
                first[i] = self.first[live, i]
            for i in range(beads):
                for p in range(self.first[live, i], self.first[live, i + 1]):
                    pairs[p, 0] = float(self.partner[live, p])
                    pairs[p, 1] = float(self.touching[live, p])
                    for c in ti.static(range(6)):
                        pairs[p, 2 + c] = self.history[live, p][c]
                    if ti.static(self.terms.changes_restitution):
                        pairs[p, 8] = self.impact[live, p]

    @ti.kernel
    def put_pairs(self, first: ti.types.ndarray(), pairs: ti.types.ndarray(), beads: ti.i32):
        ti.loop_config(serialize=True)
        for _ in range(1):
            live = self.counts[LIVE_LIST]
            for i in range(beads + 1):
                self.first[live, i] = first[i]
            for i in range(beads):
                for p in range(first[i], first[i + 1]):
                    self.partner[live, p] = int(pairs[p, 0])
                    self.touching[live, p] = ti.cast(pairs[p, 1], ti.i8)
                    for c in ti.static(range(6)):
                        self.history[live, p][c] = pairs[p, 2 + c]
                    if ti.static(self.terms.changes_restitution):
                        self.impact[live, p] = pairs[p, 8]
            self.counts[LISTED] = beads

    # ------------------------------------------------------------------ the step

    @ti.func
    def move(self, thread, i, own, last, alike: ti.template(), mechanics: ti.template()):
        """Sum the forces on bead `i`, including walls, and move it; 1 if it left its skin.

        For beads below `own`, the forces of pairs that other beads own are collected from where those left them.  A
        bead of a body stores the sums in `push`, `twist` and `brake`; its body moves it.
        """
        step = self.numbers[STEP]
        given, taken = self.given[i], self.taken[i]
        if i < own:
            taken = self.sum_taken(self.counts[LIVE_LIST], i)
        force = ti.Vector([taken[0] + given[0], taken[1] + given[1], taken[2] + given[2]])
        torque = ti.Vector([taken[3] + given[3], taken[4] + given[4], taken[5] + given[5]])
        for c in ti.static(range(self.sums)):
            self.given[i][c] = 0.0
            self.taken[i][c] = 0.0

        place, motion, spin = self.place[i], self.motion[i], self.spin[i]
        position = ti.Vector([place[0], place[1], place[2]])
        velocity = ti.Vector([motion[0], motion[1], motion[2]])
        turning = ti.Vector([spin[0], spin[1], spin[2]])
        radius, mass, inertia = place[3], motion[3], spin[3]
        lever = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.rigid and self.constant_torque):
            lever = self.lever(i)
        drag, hold, grip, deepest = self.walls.press(
            thread, self.counts[LIVE_LIST], i, self.tag[i][1], position, velocity, turning, radius, mass, inertia,
            lever, step, alike, mechanics,
        )  # fmt: skip
        force += drag
        torque += hold
        brake = 0.0  # torque limit of rolling resistance of type A
        if ti.static(self.constant_torque):
            brake = (taken[6] + given[6] + grip) * radius
        if deepest > self.worst[i] * radius:
            self.worst[i] = deepest / radius

        left_skin = 0
        if ti.static(self.rigid):
            if self.body[i] >= 0:
                self.push[i] = force
                self.twist[i] = torque
                if ti.static(self.constant_torque):
                    self.brake[i] = brake
            else:
                left_skin = self.go(i, force, torque, brake, last, alike)
        else:
            left_skin = self.go(i, force, torque, brake, last, alike)
        return left_skin

    @ti.func
    def go(self, i, force, torque, brake, last, alike: ti.template()):
        """Move bead `i` by a step under its force, torque and rolling resistance; 1 if it left its skin.

        Accelerations are stored only in the `last` step of a launch; they are not read in between.
        """
        step = self.numbers[STEP]
        place, motion, spin = self.place[i], self.motion[i], self.spin[i]
        position = ti.Vector([place[0], place[1], place[2]])
        velocity = ti.Vector([motion[0], motion[1], motion[2]])
        turning = ti.Vector([spin[0], spin[1], spin[2]])
        mass, inertia = motion[3], spin[3]
        gravity = ti.Vector([self.numbers[GRAVITY], self.numbers[GRAVITY + 1], self.numbers[GRAVITY + 2]])
        lightness, nimbleness = self.kind_sizes[None][LIGHTNESS], self.kind_sizes[None][NIMBLENESS]
        if ti.static(not alike):
            lightness, nimbleness = 1.0 / mass, 1.0 / inertia
        push = force * lightness + gravity
        if ti.static(self.terms.acts_in_flight):
            # the stored velocity is that of half a step ago
            now = velocity + 0.5 * step * push
            gap = self.walls.gap(self.counts[LIVE_LIST], i, place[3])
            blown = self.terms.in_flight(now, gap, place[3], mass, upwards(gravity))
            push += blown * lightness
            self.flight[i] = self.flight[i] + step * blown.dot(velocity + 0.5 * step * push)
        twist = torque * nimbleness
        if ti.static(self.constant_torque):
            most = step * brake * nimbleness
            if ti.static(self.holds):
                slowed = braked(turning + step * twist, most)
                twist = what_turned(turning, slowed, step)
                turning = slowed
            else:
                slowed = braked(turning, most) + step * twist
                twist = (slowed - turning) / step
                turning = slowed
        else:
            turning += step * twist
        if last:
            self.push[i] = push
            self.twist[i] = twist
        velocity += step * push
        position += step * velocity
        moved, left_skin = 0.0, 0
        for c in ti.static(range(3)):
            self.place[i][c] = position[c]
            self.motion[i][c] = velocity[c]
            self.spin[i][c] = turning[c]
            moved += (position[c] - self.listed_at[i][c]) ** 2
        if not (velocity.norm_sqr() < self.numbers[MOST_SPEED] ** 2):
            self.counts[STATUS] = EXPLODED
            self.counts[CULPRIT] = i
            left_skin = 1
        if moved > 0.25 * self.numbers[SKIN] ** 2:
            left_skin = 1
        return left_skin

    @ti.func
    def pose_walls(self, thread, time):
        """Set the walls to their positions at `time`, for one thread; 1 if one has moved too far for the list."""
        step, leeway = self.numbers[STEP], 0.5 * self.numbers[SKIN]
        return self.walls.pose(thread, self.counts[WALL_COUNT], time, step, leeway)

    @ti.func
    def move_body(self, b):
        """Move body `b` by a step; 1 if one of its beads left its skin."""
        gravity = ti.Vector([self.numbers[GRAVITY], self.numbers[GRAVITY + 1], self.numbers[GRAVITY + 2]])
        reach2, fastest2 = 0.25 * self.numbers[SKIN] ** 2, self.numbers[MOST_SPEED] ** 2
        answer = self.carry(b, self.numbers[STEP], gravity, reach2, fastest2)
        if answer >= 2:
            self.counts[STATUS] = EXPLODED
            self.counts[CULPRIT] = self.member[self.member_first[b]]
            answer = 1
        return answer & 1

    @ti.kernel
    def run_team(self, team: ti.i32, steps: ti.i32, before: ti.f64, alike: ti.template(), mechanics: ti.template()):
        """Make up to `steps` steps on a team of one or more threads, after the `before` steps made so far.

        Stops early if the list must be rebuilt, STATUS is not OK or a thread waited too long (LATE).  `alike`: all
        beads are single spheres of one size and kind.
        """
        for turn in range(team * GRAIN):
            if turn % GRAIN == 0:
                w = turn // GRAIN
                if w == 0:
                    self.counts[DONE] = 0
                if self.stale[0] == 0 and self.counts[STATUS] == OK:
                    if self.gather_team(w, team) == 1:
                        self.run_stretch(w, team, steps, before, alike, mechanics)
                    elif w == 0:
                        self.counts[LATE] = 1

    @ti.func
    def run_stretch(self, w, team, steps, before, alike: ti.template(), mechanics: ti.template()):
        """Part of thread `w` in up to `steps` steps."""
        live = self.counts[LIVE_LIST]
        start, stop = self.stretch_start(live, w, team), self.stretch_start(live, w + 1, team)
        own = start
        for p in range(self.first[live, start]):
            own = ti.max(own, self.partner[live, p] + 1)
        own = ti.min(own, stop)
        done, waited, strayed, going = 0, 0, 0, 1
        while going == 1 and done < steps:
            strayed = self.pose_walls(w, (before + done) * self.numbers[STEP])
            going = 1 - strayed
            if going == 1:
                left_skin, looks = self.make_step(
                    w, team, done, (start, own, stop), done == steps - 1, alike, mechanics
                )  # fmt: skip
                done += 1
                if left_skin == 1:
                    self.desk[w, LEFT_AT] = done
                if waited + looks > PATIENCE:
                    self.desk[w, LATE_AT] = done
                self.tell(w)
                waited += looks + self.wait(0, team, self.parts * done)
                going = 1 - ti.max(self.anybody(LEFT_AT, team, done), self.anybody(LATE_AT, team, done))
        self.desk[w, WAITED] = self.desk[w, WAITED] + waited
        if w == 0:
            self.counts[DONE] = done
            self.stale[0] = ti.max(strayed, self.anybody(LEFT_AT, team, done))
            self.counts[LATE] = self.anybody(LATE_AT, team, done)

    @ti.func
    def make_step(self, w, team, done, stretch, last, alike: ti.template(), mechanics: ti.template()):
        """Part of thread `w` in step number `done`, except for the last synchronisation; `last`: last step of a launch.

        Returns 1 if a bead left its skin, and the number of polls without success while waiting for other threads.
        """
        live = self.counts[LIVE_LIST]
        start, own, stop = ti.static(stretch)
        begin, end = self.first[live, start], self.first[live, stop]
        packets = (end - begin) // PACKET + 1
        left_skin, looks, moved = 0, 0, own
        for part in range(packets + 1):
            first_bead, end_bead = moved, stop
            if part < packets:
                from_pair = begin + part * PACKET
                to_pair = ti.min(from_pair + PACKET, end)
                self.meet(live, from_pair, to_pair, w, own, stop, alike, mechanics)
                if to_pair < end:
                    end_bead = self.owner_of[to_pair]
                moved = ti.max(moved, end_bead)
            else:
                # beads that have pairs owned by earlier stretches
                first_bead, end_bead = start, own
                self.tell(w)
                looks = self.wait(0, w, self.parts * done + 1)
            for i in range(first_bead, end_bead):
                left_skin |= self.move(w, i, own, last, alike, mechanics)
        if ti.static(self.rigid):
            self.tell(w)
            looks += self.wait(0, team, self.parts * done + 2)
            bodies = self.counts[BODIES]
            for b in range(bodies * w // team, bodies * (w + 1) // team):
                left_skin |= self.move_body(b)
        return left_skin, looks

    @ti.func
    def stretch_start(self, live, w, team):
        """First bead of stretch `w`; stretches are weighted by their number of pairs and beads."""
        beads, pairs = self.counts[BEADS], self.counts[PAIRS]
        low, high = 0, beads
        share = float(pairs + beads) * self.shares[w]
        if w == team:
            share = float(pairs + beads)
        while low < high:
            middle = (low + high) // 2
            if self.first[live, middle] + middle < share:
                low = middle + 1
            else:
                high = middle
        return low

    @ti.kernel
    def build_list(self, before: ti.f64, parts: ti.i32, whole: ti.template()):
        """Rebuild the list if needed, in parts by several threads, or as a `whole` by one.

        Inlined in the kernel of the step this code would double the time of the first start (compilation), and so would
        the code that joins the parts here.  If a part has no room the list stays outdated.
        """
        ti.loop_config(serialize=True)
        for _ in range(1):
            for s in range(1, FLAGS):
                self.stale[s] = 0
            self.counts[LATE] = 0
            self.clear_desks()
            if self.stale[0] == 1 and self.counts[STATUS] == OK:
                self.pose_walls(0, before * self.numbers[STEP])
                self.counts[KEPT] = self.sort_into_cells()
        if ti.static(not whole):
            for turn in range(parts * GRAIN):
                if turn % GRAIN == 0 and self.stale[0] == 1 and self.counts[STATUS] == OK:
                    self.list_part(turn // GRAIN, parts)
        ti.loop_config(serialize=True)
        for _ in range(1):
            if self.stale[0] == 1 and self.counts[STATUS] == OK:
                if ti.static(whole):
                    self.list_part(0, 1)
                if self.parts_fit(parts) == 1:
                    if ti.static(not whole):
                        self.join_parts(parts)
                    self.take_list(before * self.numbers[STEP])

    @ti.kernel
    def begin_burst(self, length: ti.i32, chunks: ti.i32, before: ti.f64):
        """Set up the following `length` calls of `run_step`."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.counts[BURST_LENGTH] = length
            self.counts[CHUNKS] = chunks
            self.counts[STAGE] = -1
            self.numbers[BEFORE] = before

    @ti.kernel
    def run_step(self, alike: ti.template(), mechanics: ti.template()):
        """Make the next step of a burst on all threads; once the list must be rebuilt the remaining calls do nothing.

        It takes no numbers as arguments, which would have to be transferred at each of its many calls.
        """
        beads, bodies, rounds = self.counts[BEADS], self.counts[BODIES], self.counts[CHUNKS] * GRAIN
        ti.loop_config(serialize=True)
        for _ in range(1):
            s = self.counts[STAGE] + 1
            self.counts[STAGE] = s
            if self.stale[s] == 0:
                self.stale[s] = self.pose_walls(0, (self.numbers[BEFORE] + s) * self.numbers[STEP])
        for turn in range(rounds):
            if turn % GRAIN == 0 and self.stale[self.counts[STAGE]] == 0:
                self.meet_chunk(turn // GRAIN, self.counts[CHUNKS], alike, mechanics)
        for i in range(beads):
            s = self.counts[STAGE]
            left_skin = 1
            if self.stale[s] == 0:
                left_skin = self.move(0, i, beads, s == self.counts[BURST_LENGTH] - 1, alike, mechanics)
            if left_skin == 1:
                self.stale[s + 1] = 1
        if ti.static(self.rigid):
            for b in range(bodies):
                s = self.counts[STAGE]
                left_skin = 1
                if self.stale[s] == 0:
                    left_skin = self.move_body(b)
                if left_skin == 1:
                    self.stale[s + 1] = 1

    @ti.func
    def meet_chunk(self, chunk, chunks, alike: ti.template(), mechanics: ti.template()):
        """Forces of the pairs of one part of the list."""
        live = self.counts[LIVE_LIST]
        pairs = self.counts[PAIRS]
        # equal numbers of pairs, rounded up to the first pair of the next bead
        begin = self.start_of_bead(live, int(float(pairs) * chunk / chunks))
        end = self.start_of_bead(live, int(float(pairs) * (chunk + 1) / chunks))
        while begin < end:
            self.meet(live, begin, ti.min(begin + PACKET, end), chunk, 0, 0, alike, mechanics)
            begin += PACKET

    @ti.func
    def start_of_bead(self, live, p):
        """First pair, at or after `p`, that is the first of its owner."""
        start = self.counts[PAIRS]
        if p == 0:
            start = 0
        elif p < start:
            start = self.first[live, self.owner_of[p - 1] + 1]
        return start

    @ti.kernel
    def end_burst(self, length: ti.i32):
        """Store the number of steps made in DONE, and whether the list must be rebuilt in the first flag."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            done = 0
            for s in range(length):
                if self.stale[s] == 0:
                    done += 1
            self.stale[0] = self.stale[length]
            self.counts[DONE] = done
