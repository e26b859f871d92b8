"""Forces in one contact: Hertz-Mindlin with tangential history, and rolling resistance.

One law serves every pair, sphere on sphere and sphere on wall, in the few-body path and in the bulk engine.
The first half prepares the numbers of a pair of materials; the second half is the Taichi function that uses them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rigtwin.lab.materials import Contact, Material
from rigtwin.sim.engine.backend import ti

Rolling = Literal["type A", "type C"]
ROLLING: tuple[Rolling, ...] = ("type A", "type C")

# columns of a table of pair laws
STIFFNESS, SHEAR, DAMPING, FRICTION, ROLLING_FRICTION, SHEAR_ROOT = range(6)
LAW_SIZE = 6

# columns of the constants of a contact: all that does not change while it lasts, see `contact_constants`
NORMAL, TANGENTIAL, DASHPOT, DASHPOT_T, DASHPOT_R, LAGS, LAGS_T, LAGS_R = range(8)
SLIDES, ROLLS, ROLLING_RADIUS, SHARE = range(8, 12)
CONSTANTS = 12

# columns of the sizes of a kind of spheres; the last two are the reciprocals of mass and inertia
RADIUS, MASS, INERTIA, LIGHTNESS, NIMBLENESS = range(5)
SIZES_OF_KIND = 5

LAG = 0.25  # how far a dashpot's own force is counted against it, in steps; see contact_forces
ROLLING_DAMPING = 0.05  # of critical; more than a tenth rings where many contacts meet


@dataclass(frozen=True)
class PairLaw:
    """What the contact law needs of two materials and their contact."""

    effective_modulus: float  # E* [Pa]
    effective_shear: float  # G* [Pa]
    damping: float  # 2 sqrt(5/6) psi [1]
    friction: float  # [1]
    rolling_friction: float  # [1]

    @property
    def row(self) -> tuple[float, ...]:
        # a dashpot goes with the root of its stiffness: the tangential one is the normal one times the last column
        shear_root = math.sqrt(4 * self.effective_shear / self.effective_modulus)
        return (
            self.effective_modulus, self.effective_shear, self.damping, self.friction, self.rolling_friction, shear_root
        )  # fmt: skip


def pair_law(one: Material, other: Material, contact: Contact) -> PairLaw:
    """Effective moduli of two materials (Hlosta et al. 2020, section 2.1) and the damping of their contact."""
    e_star = 1 / ((1 - one.poisson_ratio**2) / one.youngs_modulus + (1 - other.poisson_ratio**2) / other.youngs_modulus)
    g_star = 1 / ((2 - one.poisson_ratio) / one.shear_modulus + (2 - other.poisson_ratio) / other.shear_modulus)
    return PairLaw(
        effective_modulus=e_star,
        effective_shear=g_star,
        damping=2 * math.sqrt(5 / 6) * damping_ratio(contact.restitution),
        friction=contact.static_friction,
        rolling_friction=contact.rolling_friction,
    )


def damping_ratio(restitution: float) -> float:
    """Damping ratio psi of a Hertz contact without tension that returns this restitution, at any speed.

    With y = x^(5/4) and d(tau) = x^(1/4) dt the damped Hertz oscillator becomes the linear one (Antypov and Elliott
    2011, EPL 94, 50004).  The contact lets go when its force reaches zero, not its overlap (Schwager and Poeschel
    2007), which gives, with psi = sin(a) below and psi = cosh(b) above critical damping::

        -ln e = (pi - 2 a) tan(a)        e >= exp(-2)
        -ln e = 2 b coth(b)              e <  exp(-2)

    The usual psi = -ln e / sqrt(pi^2 + ln^2 e) lets the contact pull, and returns 0.487 for 0.42 once it may not.

    >>> damping_ratio(1.0)
    0.0
    """
    if restitution == 1:
        return 0.0
    loss = -math.log(restitution)
    if loss == 2:
        return 1.0
    if loss < 2:
        a = _root(lambda a: (math.pi - 2 * a) * math.tan(a) - loss, 0.0, math.pi / 2 * (1 - 1e-12))
        return math.sin(a)
    b = _root(lambda b: 2 * b / math.tanh(b) - loss, 1e-9, loss)
    return math.cosh(b)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a rising function is zero.  By halving: SciPy takes longer to import than a short run to simulate."""
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return 0.5 * (low + high)


@ti.func
def turned(vector, normal):
    """A tangential history vector carried into the tangent plane of the turned contact, its length kept.

    Within a step a contact turns by little: the root that keeps the length is taken by its Pade approximant, which
    errs by 1e-10 of the length where the contact turned by three degrees.
    """
    along = vector.dot(normal)
    flat = vector - normal * along
    lost2, length2 = along * along, flat.norm_sqr()
    return flat * ((length2 + 0.75 * lost2) / (length2 + 0.25 * lost2 + 1e-300))


@ti.func
def contact_constants(law, radius_eff, mass_eff, rolling_radius, rolling_inertia, share, step):
    """All that does not change while a contact lasts; `share` is the part of the distance that is on i's side.

    Stiffnesses go with the root of the overlap and dashpots with the root of that: here are their factors.
    """
    normal = 2.0 * law[STIFFNESS] * ti.sqrt(radius_eff)
    tangential = 8.0 * law[SHEAR] * ti.sqrt(radius_eff)
    dashpot = law[DAMPING] * ti.sqrt(normal * mass_eff)
    dashpot_t = dashpot * law[SHEAR_ROOT]
    # the spring against rolling is the tangential one at the end of the rolling radius
    dashpot_r = 2.0 * ROLLING_DAMPING * rolling_radius * ti.sqrt(tangential * rolling_inertia)
    lag = LAG * step
    # a tangential force also turns the spheres: the contact moves as if its mass were 2/7
    return ti.Vector(
        [
            normal,
            tangential,
            dashpot,
            dashpot_t,
            dashpot_r,
            lag * dashpot / mass_eff,
            3.5 * lag * dashpot_t / mass_eff,
            lag * dashpot_r / rolling_inertia,
            law[FRICTION],
            law[ROLLING_FRICTION],
            rolling_radius,
            share,
        ]
    )


@ti.func
def constants_of_two(law, radius, radius_j, mass, mass_j, inertia, inertia_j, step):
    """The constants of a contact of two spheres."""
    both = radius + radius_j
    radius_eff = radius * radius_j / both
    return contact_constants(
        law, radius_eff, mass * mass_j / (mass + mass_j), 2.0 * radius_eff, inertia * inertia_j / (inertia + inertia_j),
        radius / both, step,
    )  # fmt: skip


@ti.func
def contact_forces(
    overlap, normal, velocity, spin_i, spin_j, radius_i, radius_j, inertia_i, inertia_j, constants, slip, roll, step,
    constant_torque: ti.template(),
):  # fmt: skip
    """Hertz-Mindlin force on body i and the torques that rolling resistance adds on i and j.

    `normal` points from i to j, `velocity` [m/s] is that of i's surface relative to j's at the contact in the middle
    of the step that led here, `slip` [m] and `roll` [rad] are the stored histories.  Stiffnesses S_n = 2 E* sqrt(R* d)
    and S_t = 8 G* sqrt(R* d); spring 2/3 S_n d; dashpots 2 sqrt(5/6) psi sqrt(S m*) v; no tension; |F_t| <= mu F_n
    (Hlosta et al. 2020, eqs 1 and 2 with the velocity outside the root).

    A dashpot fed with the velocity of mid-step takes too much energy, one that solves for the velocity at the end of
    the step too little; half of that correction (LAG) returns the restitution put in to 0.5 % on average even where a
    contact lasts only eight steps, and leaves a static contact exactly Hertzian.

    Rolling resistance, torque limit mu_r F_n R on each sphere (EDEM's convention): type A acts against each body's
    own spin, type C is an elastic-plastic spring-dashpot against the relative rolling (Ai et al. 2011) with spring
    S_t R^2.  Returns force on i, torque on i, torque on j, new slip, new roll.
    """
    # roots and divisions are most of the cost of a contact: there are as few as can be
    root = ti.sqrt(overlap)
    fourth_root = ti.sqrt(root)
    stiff_n = constants[NORMAL] * root
    stiff_t = constants[TANGENTIAL] * root
    late_n = 1.0 + constants[LAGS] * fourth_root
    late_t = 1.0 + constants[LAGS_T] * fourth_root
    late_r = 1.0 + constants[LAGS_R] * fourth_root
    part = fourth_root / (late_n * late_t * late_r)
    closing = velocity.dot(normal)
    push = ti.max(0.0, stiff_n * overlap * (2.0 / 3.0) + closing * (constants[DASHPOT] * (late_t * late_r) * part))

    sliding = velocity - closing * normal
    new_slip = turned(slip, normal) + sliding * step
    drag = -stiff_t * new_slip - constants[DASHPOT_T] * (late_n * late_r) * part * sliding
    limit = constants[SLIDES] * push
    drag2 = drag.norm_sqr()
    soft_t = 1.0 / stiff_t
    if drag2 > limit * limit:
        drag *= limit / ti.sqrt(drag2)
        new_slip = drag * -soft_t

    torque_i = ti.Vector([0.0, 0.0, 0.0])
    torque_j = ti.Vector([0.0, 0.0, 0.0])
    new_roll = ti.Vector([0.0, 0.0, 0.0])
    if constants[ROLLS] > 0.0:
        grip = constants[ROLLS] * push
        if ti.static(constant_torque):
            # never more than stops the spin within the step
            rate = 1.0 / step
            torque_i = -ti.min(grip * (radius_i / (spin_i.norm() + 1e-30)), inertia_i * rate) * spin_i
            torque_j = -ti.min(grip * (radius_j / (spin_j.norm() + 1e-30)), inertia_j * rate) * spin_j
        else:
            # the spring resists rolling; the dashpot twisting too, else beads in a resting pile spin on like tops
            rate = spin_i - spin_j
            rolling_radius = constants[ROLLING_RADIUS]
            stiff_r = stiff_t * rolling_radius * rolling_radius
            new_roll = turned(roll, normal) + (rate - rate.dot(normal) * normal) * step
            torque_i = -stiff_r * new_roll - constants[DASHPOT_R] * (late_n * late_t) * part * rate
            most = grip * rolling_radius
            torque2 = torque_i.norm_sqr()
            if torque2 > most * most:
                torque_i *= most / ti.sqrt(torque2)
                # 1 over the spring's stiffness; the division by a constant is made once
                soft_r = soft_t * (1.0 / (rolling_radius * rolling_radius))
                new_roll = (torque_i.dot(normal) * normal - torque_i) * soft_r
            torque_j = -torque_i
    return drag - push * normal, torque_i, torque_j, new_slip, new_roll
