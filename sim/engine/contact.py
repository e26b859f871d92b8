"""Contact law: Hertz-Mindlin or linear springs with tangential history, and rolling resistance.

The same law is used for sphere-sphere and sphere-wall contacts, with few bodies and in the bulk engine.  The first half
computes the constants of a pair of materials; the second half holds the Taichi functions that use them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material
from rigtwin.sim.engine.backend import ti

Rolling = Literal["type A", "type A explicit", "type C"]
ROLLING: tuple[Rolling, ...] = ("type A", "type A explicit", "type C")
ContactLaw = Literal["Hertz-Mindlin", "linear"]
CONTACT_LAWS: tuple[ContactLaw, ...] = ("Hertz-Mindlin", "linear")
OVERLAP_AT_START = 1e-3  # [radii], default largest overlap of bodies that are placed; more is taken for an input error
IMPACT_SPEED = 1.0  # [m/s], default impact speed at which a linear spring is as stiff as Hertz's contact

# columns of a table of pair laws
STIFFNESS, SHEAR, DAMPING, FRICTION, ROLLING_FRICTION, SHEAR_ROOT, SPEED = range(7)
LAW_SIZE = 7

# columns of the constants of a contact, which do not change during the contact; see `contact_constants`
NORMAL, TANGENTIAL, DASHPOT, DASHPOT_T, DASHPOT_R, LAGS, LAGS_T, LAGS_R = range(8)
SLIDES, ROLLS, ROLLING_RADIUS, SHARE = range(8, 12)
CONSTANTS = 12

# columns of the sizes of a kind of spheres; the last two are the reciprocals of mass and inertia
RADIUS, MASS, INERTIA, LIGHTNESS, NIMBLENESS = range(5)
SIZES_OF_KIND = 5

LAG = 0.25  # [steps], weight of a dashpot's own force in its velocity; see `contact_forces`
ROOT_6_5 = math.sqrt(6 / 5)
ROLLING_DAMPING = 0.05  # damping ratio; above 0.1 beads with many contacts oscillate


@dataclass(frozen=True)
class Mechanics:
    """Contact and rolling laws of a simulation; kernels are compiled for one choice."""

    contact: ContactLaw = CONTACT_LAWS[0]
    rolling: Rolling = "type C"

    def __post_init__(self) -> None:
        if self.contact not in CONTACT_LAWS:
            raise BadInput(
                f"contact_law: {self.contact!r} is unknown; use one of {', '.join(map(repr, CONTACT_LAWS))}."
            )
        if self.rolling not in ROLLING:
            raise BadInput(f"rolling: {self.rolling!r} is unknown; use one of {', '.join(map(repr, ROLLING))}.")

    @property
    def linear(self) -> bool:
        """Whether springs are linear."""
        return self.contact == "linear"

    @property
    def constant_torque(self) -> bool:
        """Whether rolling resistance is a constant torque."""
        return self.rolling != "type C"

    @property
    def holds(self) -> bool:
        """Whether rolling resistance also holds bodies at rest (see `contact_forces`)."""
        return self.rolling == "type A"


@dataclass(frozen=True)
class PairLaw:
    """Constants of the contact law for two materials and their contact."""

    effective_modulus: float  # E* [Pa]
    effective_shear: float  # G* [Pa]
    damping: float  # 2 sqrt(5/6) psi [1]
    friction: float  # [1]
    rolling_friction: float  # [1]
    impact_speed: float = IMPACT_SPEED  # [m/s], of the linear law

    @property
    def row(self) -> tuple[float, ...]:
        # a dashpot scales with the square root of its stiffness: tangential = normal times shear_root
        shear_root = math.sqrt(4 * self.effective_shear / self.effective_modulus)
        return (
            self.effective_modulus, self.effective_shear, self.damping, self.friction, self.rolling_friction,
            shear_root, self.impact_speed,
        )  # fmt: skip


def pair_law(one: Material, other: Material, contact: Contact, impact_speed: float = IMPACT_SPEED) -> PairLaw:
    """Effective moduli of two materials (Hlosta et al. 2020, section 2.1) and the damping of their contact."""
    if not 0 < impact_speed < math.inf:
        raise BadInput(f"impact_speed: {impact_speed:g} m/s must be a positive speed.")
    e_star = 1 / ((1 - one.poisson_ratio**2) / one.youngs_modulus + (1 - other.poisson_ratio**2) / other.youngs_modulus)
    g_star = 1 / ((2 - one.poisson_ratio) / one.shear_modulus + (2 - other.poisson_ratio) / other.shear_modulus)
    return PairLaw(
        effective_modulus=e_star,
        effective_shear=g_star,
        damping=2 * math.sqrt(5 / 6) * damping_ratio(contact.restitution),
        friction=contact.static_friction,
        rolling_friction=contact.rolling_friction,
        impact_speed=impact_speed,
    )


def linear_stiffness(modulus: Array, radius: Array, mass: Array, impact_speed: Array) -> Array:
    """Stiffness [N/m] of a linear spring with the same overlap as a Hertz contact in an undamped impact at this speed.

    Effective modulus [Pa], radius [m] and mass [kg].
    """
    hertz = 16 / 15 * modulus * radius**0.5
    return np.asarray(hertz**0.8 * (mass * impact_speed**2) ** 0.2)


def damping_ratio(restitution: float) -> float:
    """Damping ratio psi of a contact without tension for a restitution, at any speed, linear or Hertz.

    With y = x^(5/4) and d(tau) = x^(1/4) dt the damped Hertz oscillator becomes the linear one (Antypov and Elliott
    2011, EPL 94, 50004).  The contact ends when its force, not its overlap, reaches zero (Schwager and Poeschel
    2007), which gives, with psi = sin(a) below and psi = cosh(b) above critical damping::

        -ln e = (pi - 2 a) tan(a)        e >= exp(-2)
        -ln e = 2 b coth(b)              e <  exp(-2)

    The usual psi = -ln e / sqrt(pi^2 + ln^2 e) allows tension; without tension it gives 0.487 instead of 0.42.

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
    """Root of an increasing function by bisection; importing SciPy would take longer than a short simulation."""
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return 0.5 * (low + high)


@ti.func
def turned(vector, normal):
    """Rotate a tangential history vector into the tangent plane of the turned contact, keeping its length.

    A contact turns little within a step.  The square root that keeps the length is replaced by its Pade approximant,
    whose relative error is 1e-10 at a rotation of three degrees.
    """
    along = vector.dot(normal)
    flat = vector - normal * along
    lost2, length2 = along * along, flat.norm_sqr()
    return flat * ((length2 + 0.75 * lost2) / (length2 + 0.25 * lost2 + 1e-300))


@ti.func
def contact_constants(
    law, radius_eff, mass_eff, rolling_radius, rolling_inertia, share, step, linear: ti.template()
):  # fmt: skip
    """Constants of a contact; `share` is the fraction of the distance of the centres on the side of body i.

    Hertz's stiffnesses are proportional to the square root of the overlap, dashpots to its fourth root: these are the
    factors.  The stiffnesses of a linear contact are constant, with the same ratio of tangential to normal.
    """
    normal = 2.0 * law[STIFFNESS] * ti.sqrt(radius_eff)
    tangential = 8.0 * law[SHEAR] * ti.sqrt(radius_eff)
    dashpot = law[DAMPING] * ti.sqrt(normal * mass_eff)
    if ti.static(linear):
        # see `linear_stiffness`
        energy = mass_eff * law[SPEED] * law[SPEED]
        normal = (16.0 / 15.0 * law[STIFFNESS] * ti.sqrt(radius_eff)) ** 0.8 * energy**0.2
        tangential = normal * law[SHEAR_ROOT] * law[SHEAR_ROOT]
        # from the law's 2 sqrt(5/6) psi to 2 psi
        dashpot = ROOT_6_5 * law[DAMPING] * ti.sqrt(normal * mass_eff)
    dashpot_t = dashpot * law[SHEAR_ROOT]
    # the rolling spring is the tangential spring acting at the rolling radius
    dashpot_r = 2.0 * ROLLING_DAMPING * rolling_radius * ti.sqrt(tangential * rolling_inertia)
    lag = LAG * step
    # a tangential force also rotates the spheres: the effective mass of the tangential motion is 2/7
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
def constants_of_two(law, radius, radius_j, mass, mass_j, inertia, inertia_j, step, linear: ti.template()):
    """Constants of a contact of two spheres."""
    both = radius + radius_j
    radius_eff = radius * radius_j / both
    return contact_constants(
        law, radius_eff, mass * mass_j / (mass + mass_j), 2.0 * radius_eff, inertia * inertia_j / (inertia + inertia_j),
        radius / both, step, linear,
    )  # fmt: skip


@ti.func
def braked(spin, most):
    """Spin [rad/s] reduced by rolling resistance of type A, by up to `most` but not below zero."""
    size2 = spin.norm_sqr()
    left = 0.0 * spin
    if size2 > most * most:  # avoids root and division for bodies at rest
        left = spin * ti.max(0.0, 1.0 - most * (ti.sqrt(size2) * (1.0 / (size2 + 1e-300))))
    return left


@ti.func
def reach(lever, radius, normal):
    """Distance from a body's centre of mass to the contact of a bead in direction `normal`, in radii of the bead.

    `lever` [m] is the vector from the centre of mass to the centre of the bead.
    """
    return (lever + radius * normal).norm() / radius


@ti.func
def what_turned(before, after, step):
    """Angular acceleration (or torque) that changed a spin (or angular momentum) in a step with braking.

    It is zero if the spin was stopped: the body then stays at rest, and its spin at the end of the step is computed
    from this value.
    """
    rate = (after - before) / step
    if after.norm_sqr() == 0.0:
        rate = after
    return rate


@ti.func
def contact_forces(
    overlap, normal, velocity, spin_i, spin_j, constants, slip, roll, step, mechanics: ti.template()
):  # fmt: skip
    """Contact force on body i (Hertz-Mindlin or linear) and rolling resistance.

    `normal` points from i to j.  `velocity` [m/s] is the velocity of i's surface relative to j's at the contact, in the
    middle of the previous step.  `slip` [m] and `roll` [rad] are the stored histories.

    Stiffnesses S_n = 2 E* sqrt(R* d) and S_t = 8 G* sqrt(R* d); spring 2/3 S_n d; dashpots 2 sqrt(5/6) psi sqrt(S m*)
    v; no tension; |F_t| <= mu F_n (Hlosta et al. 2020, eqs 1 and 2, with the velocity outside the root).  The linear
    law has constant stiffnesses and dashpots 2 psi sqrt(S m*) instead; the rest is the same.

    A dashpot with the mid-step velocity dissipates too much energy, one that solves for the velocity at the end of the
    step too little.  Half of that correction (LAG) reproduces the restitution to 0.5 % on average, even if a contact
    lasts only eight steps, and leaves a static contact exactly Hertzian.

    Rolling resistance has the torque limit mu_r F_n R on each sphere (EDEM's convention):

    - Type A acts against each body's own spin.  It stops the spin but does not reverse it.  For a clump R is the
      distance from the contact to the centre of mass (see `reach`).  The other torques on a body are not known in a
      contact; the contact therefore returns its part of the limit, mu_r F_n, and the integration of the body applies
      the sum of all parts once (see `braked`).
    - "type A explicit" removes at most the spin at the beginning of the step.  The spin that other torques add in the
      step remains, so a body that type A holds keeps turning, by the other torque times the step over the inertia.
    - Type C is an elastic-plastic spring-dashpot against the relative rolling (Ai et al. 2011) with spring S_t R^2.

    Returns the force on i (on j the opposite), the torque of type C on i (on j the opposite), mu_r F_n of type A, the
    new slip and the new roll.
    """
    # roots and divisions dominate the cost of a contact; their number is kept small
    root, fourth_root, secant = 1.0, 1.0, 1.0
    if ti.static(not mechanics.linear):
        root = ti.sqrt(overlap)
        fourth_root = ti.sqrt(root)
        secant = 2.0 / 3.0
    stiff_n = constants[NORMAL] * root
    stiff_t = constants[TANGENTIAL] * root
    late_n = 1.0 + constants[LAGS] * fourth_root
    late_t = 1.0 + constants[LAGS_T] * fourth_root
    late_r = 1.0 + constants[LAGS_R] * fourth_root
    part = fourth_root / (late_n * late_t * late_r)
    closing = velocity.dot(normal)
    push = ti.max(0.0, stiff_n * overlap * secant + closing * (constants[DASHPOT] * (late_t * late_r) * part))

    sliding = velocity - closing * normal
    new_slip = turned(slip, normal) + sliding * step
    drag = -stiff_t * new_slip - constants[DASHPOT_T] * (late_n * late_r) * part * sliding
    limit = constants[SLIDES] * push
    drag2 = drag.norm_sqr()
    soft_t = 1.0 / stiff_t
    if drag2 > limit * limit:
        drag *= limit / ti.sqrt(drag2)
        new_slip = drag * -soft_t

    torque = ti.Vector([0.0, 0.0, 0.0])
    grip = 0.0
    new_roll = ti.Vector([0.0, 0.0, 0.0])
    if ti.static(mechanics.constant_torque):
        grip = constants[ROLLS] * push
    elif constants[ROLLS] > 0.0:
        # the spring resists rolling only, the dashpot also twisting, or beads in a pile at rest would keep spinning
        rate = spin_i - spin_j
        rolling_radius = constants[ROLLING_RADIUS]
        stiff_r = stiff_t * rolling_radius * rolling_radius
        new_roll = turned(roll, normal) + (rate - rate.dot(normal) * normal) * step
        torque = -stiff_r * new_roll - constants[DASHPOT_R] * (late_n * late_t) * part * rate
        most = constants[ROLLS] * push * rolling_radius
        torque2 = torque.norm_sqr()
        if torque2 > most * most:
            torque *= most / ti.sqrt(torque2)
            # inverse stiffness of the spring; the compiler evaluates the division by a constant once
            soft_r = soft_t * (1.0 / (rolling_radius * rolling_radius))
            new_roll = (torque.dot(normal) * normal - torque) * soft_r
    return drag - push * normal, torque, grip, new_slip, new_roll
