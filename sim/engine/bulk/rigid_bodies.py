"""Rigid bodies (clumps) of several beads: mass and moments of inertia, rotation, and positions of their beads.

The beads of a body have contacts as any other bead; two beads of one body are never listed as a pair.  After the walls
each bead holds the sum of its forces.  Each body then adds up the sums of its beads in a fixed order, and moves.

The angular momentum is stored in space axes at half steps, so that without a torque it is constant to the bit.  Over a
step the body rotates under a constant angular momentum by the symmetric splitting into rotations about its own axes
(Dullweber, Leimkuhler and McLachlan 1997, J. Chem. Phys. 107, 5840).  The splitting is symplectic, so that the energy
of a rotating body does not drift.  Each rotation is a Cayley rotation: it needs a division instead of sine and cosine,
is exactly orthogonal, and its error is of third order in the angle, below the second-order error of the splitting.
"""

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.sim.engine.backend import ti
from rigtwin.sim.engine.contact import reach, what_turned

# an exported bead: position 3, velocity 3, spin 3, radius, mass, inertia, acceleration 3, angular 3, ident, kind,
# largest overlap; velocity and spin half a step back
STATE_SIZE = 21
# an exported body: centre 3, velocity 3, quaternion 4 (real part first), angular momentum 3, principal moments 3,
# mass, acceleration 3, torque 3, ident, kind; velocity and angular momentum half a step back
BODY_SIZE = 25
CENTRE, VELOCITY, TURN, MOMENTUM = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
MOMENTS, MASS, PUSH, TORQUE, IDENT, KIND = slice(13, 16), 16, slice(17, 20), slice(20, 23), 23, 24
MEMBER_SIZE = 4  # place in the body's axes 3, number of the body (-1: none)
NEWTON_STEPS = 5  # sufficient for moments of inertia that differ by a factor of 20
NO_SPIN2 = 1e-200  # [rad^2/s^2], below which the square loses digits and the spin is a residue of rounding
ALL_BUT_HELD = 1e-9  # relative; a spin that exceeds the limit by less is stopped, as its rest has no valid digits


class RigidBodies:
    """Part of an arena that handles rigid bodies; its fields are allocated only if there are any."""

    place: ti.Field
    motion: ti.Field
    spin: ti.Field
    push: ti.Field
    twist: ti.Field
    listed_at: ti.Field

    constant_torque: bool
    holds: bool

    def __init__(self, capacity: int, constant_torque: bool) -> None:
        if constant_torque:
            self.brake = ti.field(ti.f64, capacity)  # [N m], limit of the rolling resistance of a bead
        self.body = ti.field(ti.i32, capacity)  # of a bead, -1: none
        self.arm = ti.Vector.field(3, ti.f64, capacity)  # of a bead, in its body's axes
        self.spare_member = ti.Vector.field(MEMBER_SIZE, ti.f64, capacity)
        self.member_first = ti.field(ti.i32, capacity + 1)
        self.member = ti.field(ti.i32, capacity)
        self.body_place = ti.Vector.field(4, ti.f64, capacity)  # centre of mass, mass
        self.body_motion = ti.Vector.field(3, ti.f64, capacity)  # velocity half a step back
        self.body_turn = ti.Vector.field(4, ti.f64, capacity)  # quaternion from the body's axes to space
        self.body_momentum = ti.Vector.field(3, ti.f64, capacity)  # angular, in space, half a step back
        self.body_moments = ti.Vector.field(3, ti.f64, capacity)  # principal
        self.body_push = ti.Vector.field(3, ti.f64, capacity)  # acceleration
        self.body_twist = ti.Vector.field(3, ti.f64, capacity)  # torque, in space
        self.body_tag = ti.Vector.field(2, ti.i32, capacity)  # ident, kind
        self.body_new = ti.field(ti.i32, capacity)  # number of a body in the next list; -1: it left the domain

    @ti.kernel
    def put_bodies(self, bodies: ti.types.ndarray(), start: ti.i32, count: ti.i32):
        """Write bodies start ... start + count - 1 (columns as in BODY_SIZE)."""
        ti.loop_config(serialize=True)
        for k in range(count):
            b = start + k
            for c in ti.static(range(3)):
                self.body_place[b][c] = bodies[k, c]
                self.body_motion[b][c] = bodies[k, 3 + c]
                self.body_momentum[b][c] = bodies[k, 10 + c]
                self.body_moments[b][c] = bodies[k, 13 + c]
                self.body_push[b][c] = bodies[k, 17 + c]
                self.body_twist[b][c] = bodies[k, 20 + c]
            for c in ti.static(range(4)):
                self.body_turn[b][c] = bodies[k, 6 + c]
            self.body_place[b][3] = bodies[k, 16]
            self.body_tag[b][0] = int(bodies[k, 23])
            self.body_tag[b][1] = int(bodies[k, 24])

    @ti.kernel
    def get_bodies(self, bodies: ti.types.ndarray(), count: ti.i32):
        """Read all bodies (columns as in BODY_SIZE)."""
        ti.loop_config(serialize=True)
        for b in range(count):
            for c in ti.static(range(3)):
                bodies[b, c] = self.body_place[b][c]
                bodies[b, 3 + c] = self.body_motion[b][c]
                bodies[b, 10 + c] = self.body_momentum[b][c]
                bodies[b, 13 + c] = self.body_moments[b][c]
                bodies[b, 17 + c] = self.body_push[b][c]
                bodies[b, 20 + c] = self.body_twist[b][c]
            for c in ti.static(range(4)):
                bodies[b, 6 + c] = self.body_turn[b][c]
            bodies[b, 16] = self.body_place[b][3]
            bodies[b, 23] = float(self.body_tag[b][0])
            bodies[b, 24] = float(self.body_tag[b][1])

    @ti.kernel
    def put_members(self, members: ti.types.ndarray(), start: ti.i32, count: ti.i32):
        """Set the bodies of beads start ... start + count - 1 (columns as in MEMBER_SIZE)."""
        ti.loop_config(serialize=True)
        for k in range(count):
            for c in ti.static(range(3)):
                self.arm[start + k][c] = members[k, c]
            self.body[start + k] = int(members[k, 3])

    @ti.kernel
    def get_members(self, members: ti.types.ndarray(), count: ti.i32):
        ti.loop_config(serialize=True)
        for i in range(count):
            for c in ti.static(range(3)):
                members[i, c] = self.arm[i][c]
            members[i, 3] = float(self.body[i])

    # ------------------------------------------------------------------ the list

    @ti.func
    def of_one_body(self, i, j):
        return self.body[i] >= 0 and self.body[i] == self.body[j]

    @ti.func
    def keep_members(self, beads):
        for i in range(beads):
            for c in ti.static(range(3)):
                self.spare_member[i][c] = self.arm[i][c]
            self.spare_member[i][3] = float(self.body[i])

    @ti.func
    def renumber_member(self, a, i):
        for c in ti.static(range(3)):
            self.arm[a][c] = self.spare_member[i][c]
        self.body[a] = int(self.spare_member[i][3])

    @ti.func
    def renumber_bodies(self, bodies, kept):
        """Remove bodies that left the domain and list the beads of each; returns the number of remaining bodies."""
        for b in range(bodies):
            self.body_new[b] = -1
        for a in range(kept):
            if self.body[a] >= 0:
                self.body_new[self.body[a]] = 0
        left = 0
        for b in range(bodies):
            if self.body_new[b] == 0:
                self.body_new[b] = left
                if left < b:
                    self.move_up(left, b)
                left += 1
        self.list_members(left, kept)
        return left

    @ti.func
    def move_up(self, to, b):
        self.body_place[to] = self.body_place[b]
        self.body_motion[to] = self.body_motion[b]
        self.body_turn[to] = self.body_turn[b]
        self.body_momentum[to] = self.body_momentum[b]
        self.body_moments[to] = self.body_moments[b]
        self.body_push[to] = self.body_push[b]
        self.body_twist[to] = self.body_twist[b]
        self.body_tag[to] = self.body_tag[b]

    @ti.func
    def list_members(self, left, kept):
        """List the beads of each body by their numbers."""
        for b in range(left + 1):
            self.member_first[b] = 0
        for a in range(kept):
            if self.body[a] >= 0:
                b = self.body_new[self.body[a]]
                self.body[a] = b
                self.member_first[b + 1] = self.member_first[b + 1] + 1
        for b in range(left):
            self.member_first[b + 1] = self.member_first[b + 1] + self.member_first[b]
        # filling moves every start to that of the next body; shift back
        for a in range(kept):
            b = self.body[a]
            if b >= 0:
                self.member[self.member_first[b]] = a
                self.member_first[b] = self.member_first[b] + 1
        for k in range(left):
            b = left - k
            self.member_first[b] = self.member_first[b - 1]
        self.member_first[0] = 0

    # ------------------------------------------------------------------ the step

    @ti.func
    def lever(self, i):
        """Vector [m] from the centre of mass of its body to bead `i`; zero for a single bead."""
        lever = ti.Vector([0.0, 0.0, 0.0])
        b = self.body[i]
        if b >= 0:
            for c in ti.static(range(3)):
                lever[c] = self.place[i][c] - self.body_place[b][c]
        return lever

    @ti.func
    def reach(self, i, normal):
        """Distance from the centre of mass to the contact of bead `i` in direction `normal`, in radii of the bead."""
        return reach(self.lever(i), self.place[i][3], normal)

    @ti.func
    def sum_of_beads(self, b, middle):
        """Force on body `b`, torque about its centre of mass `middle`, and limit of its rolling resistance."""
        force = ti.Vector([0.0, 0.0, 0.0])
        torque = ti.Vector([0.0, 0.0, 0.0])
        brake = 0.0
        for k in range(self.member_first[b], self.member_first[b + 1]):
            i = self.member[k]
            place = self.place[i]
            pull = self.push[i]
            force += pull
            torque += self.twist[i] + (ti.Vector([place[0], place[1], place[2]]) - middle).cross(pull)
            if ti.static(self.constant_torque):
                brake += self.brake[i]
        return force, torque, brake

    @ti.func
    def carry(self, b, step, gravity, reach2, fastest2):
        """Move body `b` by a step; returns bits: 1 if a bead left its skin, 2 if a bead is too fast."""
        centre = self.body_place[b]
        mass = centre[3]
        middle = ti.Vector([centre[0], centre[1], centre[2]])
        force, torque, brake = self.sum_of_beads(b, middle)
        push = force / mass + gravity
        velocity = self.body_motion[b] + step * push
        momentum = self.body_momentum[b] + step * torque
        middle += step * velocity

        moments = self.body_moments[b]
        turn = self.body_turn[b]
        before = rotation(turn)
        along = before.transpose() @ momentum  # in the body's axes
        if ti.static(self.holds):
            along = braked_momentum(along, moments, step * brake)
            momentum = before @ along
            torque = what_turned(self.body_momentum[b], momentum, step)
        elif ti.static(self.constant_torque):
            along -= taken_off(before.transpose() @ self.body_momentum[b], moments, step * brake)
            momentum = before @ along
            torque = (momentum - self.body_momentum[b]) / step
        spin = before @ (along / moments)
        for axis, part in ti.static(((0, 0.5), (1, 0.5), (2, 1.0), (1, 0.5), (0, 0.5))):
            turn, along = turned_about(turn, along, axis, 0.5 * part * step * along[axis] / moments[axis])
        turn /= turn.norm()
        after = rotation(turn)
        spin = 0.5 * (spin + after @ (along / moments))
        rate = (after - before) / step

        self.body_push[b] = push
        self.body_twist[b] = torque
        self.body_motion[b] = velocity
        self.body_momentum[b] = momentum
        self.body_turn[b] = turn
        answer = 0
        for k in range(self.member_first[b], self.member_first[b + 1]):
            i = self.member[k]
            arm = self.arm[i]
            position = middle + after @ arm
            # mean velocity of the bead in the step, so that the slip of a contact is the displacement of its surfaces
            drift = velocity + rate @ arm
            moved = 0.0
            for c in ti.static(range(3)):
                self.place[i][c] = position[c]
                self.motion[i][c] = drift[c]
                self.spin[i][c] = spin[c]
                moved += (position[c] - self.listed_at[i][c]) ** 2
            if moved > reach2:
                answer |= 1
            if not (drift.norm_sqr() < fastest2):
                answer |= 2
        for c in ti.static(range(3)):
            self.body_place[b][c] = middle[c]
        return answer


@ti.func
def braked_momentum(along, moments, most):
    """Angular momentum, in the axes of the body, after a torque against the spin has removed up to `most` [N m s].

    The remaining spin w satisfies I w + most w/|w| = `along`.  The spin at the end of the step is braked, so that it is
    never reversed and a body at rest stays at rest.  With w = `along` / (I + s) only s is unknown.
    """
    size = along.norm()
    left = ti.Vector([0.0, 0.0, 0.0])
    if size > most * (1.0 + ALL_BUT_HELD):
        # Newton's method from above on a concave function; exact after one step if all moments are equal
        s = ti.max(moments[0], moments[1], moments[2]) * most / (size - most)
        if most > 0.0:
            for _ in range(NEWTON_STEPS):
                spin = along / (moments + s)
                slowness = 1.0 / spin.norm()
                slope = (spin * spin / (moments + s)).sum() * slowness**3 - 1.0 / most
                s -= (slowness - s / most) / slope
        left = along * moments / (moments + s)
    return left


@ti.func
def taken_off(along, moments, most):
    """Angular momentum of up to `most` [N m s] about the axis of the present spin, at most the present one."""
    spin = along / moments
    taken = along
    if spin.norm_sqr() > NO_SPIN2:
        axis = spin / spin.norm()
        taken = ti.min(most, along.dot(axis)) * axis
    return taken


@ti.func
def rotation(q):
    """Rotation matrix from the axes of the body to space."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return ti.Matrix(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


@ti.func
def turned_about(q, along, axis: ti.template(), half):
    """Rotate a body about its own axis by 2 atan(half): quaternion, not normalised, and momentum in its axes."""
    one, other = ti.static((axis + 1) % 3, (axis + 2) % 3)
    scale = 1.0 / (1.0 + half * half)
    cosine, sine = (1.0 - half * half) * scale, 2.0 * half * scale
    seen = along
    seen[one] = cosine * along[one] + sine * along[other]
    seen[other] = cosine * along[other] - sine * along[one]
    new = q
    new[0] = q[0] - half * q[1 + axis]
    new[1 + axis] = q[1 + axis] + half * q[0]
    new[1 + one] = q[1 + one] + half * q[1 + other]
    new[1 + other] = q[1 + other] - half * q[1 + one]
    return new, seen


# ---------------------------------------------------------------------- outside the kernels


def matrices(turn: Array) -> Array:
    """Rotation matrices, shape (n, 3, 3), of quaternions, shape (n, 4), from the body's axes to space."""
    w, x, y, z = np.asarray(turn, dtype=float).reshape(-1, 4).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def velocities_now(rows: Array, step: float) -> tuple[Array, Array, Array]:
    """Velocity, spin and angular momentum, shape (n, 3), of exported bodies at the time of their positions."""
    velocity = rows[:, VELOCITY] + 0.5 * step * rows[:, PUSH]
    momentum = rows[:, MOMENTUM] + 0.5 * step * rows[:, TORQUE]
    return velocity, spin_of(rows[:, TURN], rows[:, MOMENTS], momentum), momentum


def spin_of(turn: Array, moments: Array, momentum: Array) -> Array:
    """Angular velocity [rad/s] from the angular momentum of bodies, in space axes, shape (n, 3)."""
    axes = matrices(turn)
    along = np.einsum("nji,nj->ni", axes, momentum) / moments
    return np.asarray(np.einsum("nij,nj->ni", axes, along))


def momentum_of(turn: Array, moments: Array, spin: Array) -> Array:
    """Angular momentum [kg m^2/s] from the angular velocity of bodies, in space axes, shape (n, 3)."""
    axes = matrices(turn)
    along = np.einsum("nji,nj->ni", axes, spin) * moments
    return np.asarray(np.einsum("nij,nj->ni", axes, along))


def new_bodies(
    particle: Particle, position: Array, velocity: Array, spin: Array, turn: Array | None, sizes: Array
) -> Array:
    """Rows of new clumps for the arena, without numbers and forces; `sizes` relative to the particle."""
    rows = np.zeros((len(position), BODY_SIZE))
    turn = np.broadcast_to([1.0, 0.0, 0.0, 0.0] if turn is None else turn, (len(position), 4)).astype(float)
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    if not (np.isfinite(length) & (length > 0)).all():
        raise BadInput("turn: a quaternion is zero or not finite; give four numbers, the real part first.")
    rows[:, CENTRE], rows[:, VELOCITY], rows[:, TURN] = position, velocity, turn / length
    rows[:, MOMENTS], rows[:, MASS] = particle.moments * sizes[:, None] ** 5, particle.mass * sizes**3
    rows[:, MOMENTUM] = momentum_of(rows[:, TURN], rows[:, MOMENTS], spin)
    return rows


def new_members(particle: Particle, bodies: Array, sizes: Array, first: int) -> tuple[Array, Array]:
    """Rows of the beads of new `bodies` for the arena, and their membership; body numbers begin at `first`."""
    assert particle.shape is not None
    count = len(particle.shape.radii)
    arms = sizes[:, None, None] * np.array(particle.shape.offsets)
    radii = sizes[:, None] * np.array(particle.shape.radii)
    rows = np.zeros((len(bodies) * count, STATE_SIZE))
    lever = np.einsum("nij,nkj->nki", matrices(bodies[:, TURN]), arms).reshape(-1, 3)
    spin = spin_of(bodies[:, TURN], bodies[:, MOMENTS], bodies[:, MOMENTUM])
    rows[:, 0:3] = np.repeat(bodies[:, CENTRE], count, axis=0) + lever
    rows[:, 6:9] = np.repeat(spin, count, axis=0)
    rows[:, 3:6] = np.repeat(bodies[:, VELOCITY], count, axis=0) + np.cross(rows[:, 6:9], lever)
    rows[:, 9] = radii.reshape(-1)
    # contacts use the mass of the whole clump, rolling resistance the smallest of its moments of inertia
    rows[:, 10] = np.repeat(bodies[:, MASS], count)
    rows[:, 11] = np.repeat(bodies[:, MOMENTS].min(axis=1), count)
    members = np.zeros((len(rows), MEMBER_SIZE))
    members[:, :3] = arms.reshape(-1, 3)
    members[:, 3] = np.repeat(np.arange(first, first + len(bodies)), count)
    return rows, members
