"""Time step of a few bodies: forces, integration, and length of the next step."""

from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.contact import DAMPING, LAW_SIZE, STIFFNESS, braked, constants_of_two, contact_forces
from rigtwin.sim.engine.effect_terms import Terms, upwards
from rigtwin.sim.engine.walls.elements import OF_WALL
from rigtwin.sim.engine.walls.wall_contacts import WallContacts
from rigtwin.sim.engine.walls.wall_table import WANDERS

ENDLESS = 1e9  # [m]
RESTING_SPEED = 1e-8  # [m/s]
RESTING_ACCELERATION = 1e-4  # [m/s^2]
SAMPLE_SIZE = 9  # position, velocity, spin

# columns of a copy's clock: time, step in contact, longest step, limit of the next step, number of steps (-1: forces
# not computed yet), gravity 3, rate of its rotation about y
TIME, STEP, LONGEST, AHEAD, STEPS, GRAVITY, TURNS = 0, 1, 2, 3, 4, 5, 8
CLOCK = 9
# columns of a copy's counts: first body and number of bodies, walls likewise, first pair, whether a wall changes, next
# sample and number of samples left, row of the next sample, and the body whose velocity is not finite (-1: none)
BODY, BODIES, WALL, WALLS, PAIR, CHANGES, SAMPLE, LEFT, ROW, CULPRIT = range(10)
COUNTS = 10


class Steps:
    """Part of a bench that integrates a copy: its bodies, pairs and near walls."""

    walls: WallContacts

    def __init__(self, bodies: int, pairs: int, terms: Terms) -> None:
        self.terms = terms
        self.position = ti.Vector.field(3, ti.f64, bodies)
        self.velocity = ti.Vector.field(3, ti.f64, bodies)
        self.spin = ti.Vector.field(3, ti.f64, bodies)
        self.push = ti.Vector.field(3, ti.f64, bodies)  # acceleration
        self.twist = ti.Vector.field(3, ti.f64, bodies)  # angular acceleration
        self.brake = ti.field(ti.f64, bodies)  # [rad/s^2], limit of the deceleration by rolling resistance of type A
        self.half = ti.Vector.field(3, ti.f64, bodies)  # velocity at the middle of the step
        self.half_spin = ti.Vector.field(3, ti.f64, bodies)
        self.body = ti.Vector.field(3, ti.f64, bodies)  # radius, mass, inertia
        self.thread = ti.Vector.field(4, ti.f64, bodies)  # pivot, length (0: none)
        self.kind = ti.field(ti.i32, bodies)
        self.pair_slip = ti.Vector.field(3, ti.f64, pairs)
        self.pair_roll = ti.Vector.field(3, ti.f64, pairs)
        self.pair_law = ti.Vector.field(LAW_SIZE, ti.f64, pairs)
        self.pair_meets = ti.field(ti.i32, pairs)
        if terms.act_on_contacts:
            self.impact = ti.field(ti.f64, pairs)  # DAMPING of the present impact; negative: no contact

    @ti.func
    def forces(self, c, begin, end, first_pair, step, longest, pull, mechanics: ti.template()):
        """Accelerations from positions and mid-step velocities; returns the least time to a contact, 0 in contact."""
        clear = longest
        slack = pull.norm() * longest
        for i in range(begin, end):
            self.push[i] = self.push_on_body(c, i, step, pull)
            self.twist[i] = ti.Vector([0.0, 0.0, 0.0])
            self.brake[i] = 0.0
        for i in range(begin, end):
            radius, mass, inertia = self.body[i][0], self.body[i][1], self.body[i][2]
            force, torque, grip, deepest = self.walls.press(
                0, 0, i, self.kind[i], self.position[i], self.half[i], self.half_spin[i], radius, mass, inertia,
                ti.Vector([0.0, 0.0, 0.0]), step, False, mechanics,
            )  # fmt: skip
            self.push[i] = self.push[i] + force / mass
            self.twist[i] = self.twist[i] + torque / inertia
            if ti.static(mechanics.constant_torque):
                self.brake[i] = self.brake[i] + grip * radius / inertia
            for q in range(self.walls.first[0, i], self.walls.first[0, i + 1]):
                wall = int(self.walls.elements[self.walls.near[0, q], OF_WALL])
                closing = self.half[i].norm() + slack + self.walls.motion[wall, WANDERS]
                clear = ti.min(clear, 0.4 * ti.max(self.walls.facing[q][3] - radius, 0.0) / closing)
            if deepest > 0.0:
                clear = 0.0
            for j in range(i + 1, end):
                p = first_pair + (i - begin) * (end - begin) + (j - begin)
                if self.pair_meets[p] == 1:
                    radius_j, mass_j, inertia_j = self.body[j][0], self.body[j][1], self.body[j][2]
                    between = self.position[j] - self.position[i]
                    distance = between.norm()
                    overlap = radius + radius_j - distance
                    velocity = self.half[i] - self.half[j]
                    clear = ti.min(clear, self.cling(c, p, i, j, overlap, between, longest))
                    if overlap > 0.0:
                        clear = 0.0
                        normal = between / distance
                        lever = distance * radius / (radius + radius_j)
                        lever_j = distance - lever
                        surface = velocity + (lever * self.half_spin[i] + lever_j * self.half_spin[j]).cross(normal)
                        constants = constants_of_two(
                            self.law_of_pair(p), radius, radius_j, mass, mass_j, inertia, inertia_j, step,
                            mechanics.linear,
                        )  # fmt: skip
                        force, torque, grip, slip, roll = contact_forces(
                            overlap, normal, surface, self.half_spin[i], self.half_spin[j], constants,
                            self.pair_slip[p], self.pair_roll[p], step, mechanics,
                        )  # fmt: skip
                        self.pair_slip[p] = slip
                        self.pair_roll[p] = roll
                        turn = normal.cross(force)
                        self.push[i] = self.push[i] + force / mass
                        self.push[j] = self.push[j] - force / mass_j
                        self.twist[i] = self.twist[i] + (lever * turn + torque) / inertia
                        self.twist[j] = self.twist[j] + (lever_j * turn - torque) / inertia_j
                        if ti.static(mechanics.constant_torque):
                            self.brake[i] = self.brake[i] + grip * radius / inertia
                            self.brake[j] = self.brake[j] + grip * radius_j / inertia_j
                    else:
                        self.pair_slip[p] = ti.Vector([0.0, 0.0, 0.0])
                        self.pair_roll[p] = ti.Vector([0.0, 0.0, 0.0])
                        clear = ti.min(clear, -0.4 * overlap / (velocity.norm() + slack))
        return clear

    @ti.func
    def push_on_body(self, c, i, step, pull):
        """Acceleration by gravity and by effects away from contacts."""
        push = pull
        if ti.static(self.terms.act_on_bodies):
            push += self.push_of_terms(c, i, step, pull)
        return push

    @ti.func
    def push_of_terms(self, c, i, step, gravity):
        """Acceleration by effects away from contacts; `push` still holds the value of the last step."""
        radius, mass = self.body[i][0], self.body[i][1]
        velocity = self.half[i] + 0.5 * step * self.push[i]
        push = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.terms.acts_in_flight):
            self.walls.face(0, 0, i, self.position[i], radius)
            gap = self.walls.gap(0, i, radius)
            push += self.terms.in_flight(velocity, gap, radius, mass, upwards(gravity), c) / mass
        if ti.static(self.terms.acts_on_threads):
            length = self.thread[i][3]
            if length > 0.0:
                pivot = ti.Vector([self.thread[i][0], self.thread[i][1], self.thread[i][2]])
                arm = (self.position[i] - pivot) / length
                push += self.terms.on_thread(velocity, arm, length, mass, upwards(gravity), c) / mass
        return push

    @ti.func
    def law_of_pair(self, p):
        law = self.pair_law[p]
        if ti.static(self.terms.changes_restitution):
            law[DAMPING] = self.impact[p]
        return law

    @ti.func
    def cling(self, c, p, i, j, overlap, between, longest):
        """Forces of effects in this contact; returns the limit of the step: 0 while an effect acts, else `longest`."""
        clear = longest
        if ti.static(self.terms.act_on_contacts):
            normal = between / between.norm()
            radius, mass = self.body[i][0], self.body[i][1]
            radius_j, mass_j = self.body[j][0], self.body[j][1]
            radius_eff = radius * radius_j / (radius + radius_j)
            law = self.pair_law[p]
            state = self.impact[p]
            if overlap > 0.0 and state < 0.0:
                closing = (self.half[i] - self.half[j]).dot(normal)
                mass_eff = mass * mass_j / (mass + mass_j)
                state = self.terms.damping_of_pair(law[DAMPING], closing, radius_eff, mass_eff, c)
            if overlap < -self.terms.neck(radius_eff, law[STIFFNESS], c):
                state = -1.0
            if state >= 0.0:
                clear = 0.0
                pull = self.terms.attraction(overlap, radius_eff, law[STIFFNESS], c)
                self.push[i] = self.push[i] + pull / mass * normal
                self.push[j] = self.push[j] - pull / mass_j * normal
            self.impact[p] = state
        return clear

    @ti.func
    def turned_about_y(self, vector, angle):
        """Rotate `vector` about y, from z towards x."""
        cosine, sine = ti.cos(angle), ti.sin(angle)
        return ti.Vector([vector[0] * cosine + vector[2] * sine, vector[1], vector[2] * cosine - vector[0] * sine])

    @ti.func
    def drift(self, i, h, mechanics: ti.template()):
        """Advance positions to the end of the step and velocities to its middle; threads keep their length (RATTLE)."""
        before = self.position[i]
        middle = self.velocity[i] + 0.5 * h * self.push[i]
        after = before + h * middle
        length = self.thread[i][3]
        if length > 0.0 and h > 0.0:
            pivot = ti.Vector([self.thread[i][0], self.thread[i][1], self.thread[i][2]])
            arm = before - pivot
            reach = after - pivot
            b = reach.dot(arm)
            c = reach.norm_sqr() - length * length
            pull = -c / (b + ti.sqrt(b * b - c * arm.norm_sqr()))
            after += pull * arm
            middle += pull / h * arm
        self.position[i] = after
        self.half[i] = middle
        self.half_spin[i] = self.turned_on(i, self.spin[i], 0.5 * h, mechanics)

    @ti.func
    def turned_on(self, i, spin, time, mechanics: ti.template()):
        """Spin of body `i` after a `time` [s]."""
        later = spin + time * self.twist[i]
        if ti.static(mechanics.holds):
            later = braked(later, time * self.brake[i])
        elif ti.static(mechanics.constant_torque):
            later = braked(spin, time * self.brake[i]) + time * self.twist[i]
        return later

    @ti.func
    def across_thread(self, i, velocity):
        free = velocity
        length = self.thread[i][3]
        if length > 0.0:
            pivot = ti.Vector([self.thread[i][0], self.thread[i][1], self.thread[i][2]])
            arm = (self.position[i] - pivot) / length
            free -= free.dot(arm) * arm
        return free

    @ti.func
    def take_sample(self, samples: ti.template(), row, begin, end):
        for i in range(begin, end):
            for k in ti.static(range(3)):
                samples[row + i - begin, k] = self.position[i][k]
                samples[row + i - begin, 3 + k] = self.velocity[i][k]
                samples[row + i - begin, 6 + k] = self.spin[i][k]

    @ti.func
    def advance_copy(
        self, c, budget, clock: ti.template(), counts: ti.template(), times: ti.template(), samples: ti.template(),
        mechanics: ti.template(),
    ):  # fmt: skip
        """Advance one copy by up to `budget` steps, or until all samples are taken."""
        begin, first_wall, first_pair = counts[c, BODY], counts[c, WALL], counts[c, PAIR]
        end, last_wall, changes = begin + counts[c, BODIES], first_wall + counts[c, WALLS], counts[c, CHANGES]
        sample, awaited, row = counts[c, SAMPLE], counts[c, LEFT], counts[c, ROW]
        now, ahead, steps = clock[c, TIME], clock[c, AHEAD], clock[c, STEPS]
        shortest, longest, turns = clock[c, STEP], clock[c, LONGEST], clock[c, TURNS]
        gravity = ti.Vector([clock[c, GRAVITY], clock[c, GRAVITY + 1], clock[c, GRAVITY + 2]])
        pull, wanted, culprit = gravity, times[sample], -1
        left = budget
        while left > 0 and awaited > 0 and culprit < 0:
            h = ti.max(ahead, shortest)
            if now + h > wanted - 1e-15:
                h = ti.max(wanted - now, 0.0)
            if steps < 0.0:
                h = 0.0
            for i in range(begin, end):
                self.drift(i, h, mechanics)
            if turns != 0.0:
                pull = self.turned_about_y(gravity, turns * (now + h))
            if changes == 1 or steps < 0.0:
                for w in range(first_wall, last_wall):
                    self.walls.pose_wall(0, w, now + h, h, ENDLESS)
            ahead = self.forces(c, begin, end, first_pair, h, longest, pull, mechanics)
            still = changes == 0 and turns == 0.0
            for i in range(begin, end):
                self.velocity[i] = self.across_thread(i, self.half[i] + 0.5 * h * self.push[i])
                self.spin[i] = self.turned_on(i, self.half_spin[i], 0.5 * h, mechanics)
                speed2 = self.velocity[i].norm_sqr() + (self.body[i][0] * self.spin[i]).norm_sqr()
                if not (speed2 < 1e12):
                    culprit = i - begin
                if speed2 > RESTING_SPEED**2 or self.push[i].norm_sqr() > RESTING_ACCELERATION**2:
                    still = False
            now += h
            steps += 1.0
            left -= 1
            while awaited > 0 and culprit < 0 and (now >= wanted - 1e-14 or still):
                # bodies without velocity and acceleration stay at rest, so the remaining samples are equal
                self.take_sample(samples, row, begin, end)
                row += end - begin
                awaited -= 1
                if awaited > 0:
                    sample += 1
                    wanted = times[sample]
        clock[c, TIME], clock[c, AHEAD], clock[c, STEPS] = now, ahead, steps
        counts[c, SAMPLE], counts[c, LEFT], counts[c, ROW], counts[c, CULPRIT] = sample, awaited, row, culprit
