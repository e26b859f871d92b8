"""Time step as a fraction of Rayleigh's, with its limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle

USUAL, DOUBTFUL, UNSTABLE = 0.30, 0.40, 0.80  # fractions of Rayleigh's time step
SPRINGS_DECIDE = 0.05  # restitution; above it beds of 500 beads are stable at 0.3 of Rayleigh's step
FEW_BODIES = 0.1  # fraction in runs of a few bodies, whose steps cost nothing
LEAST = 1e-3  # fraction; contacts gain no accuracy below 0.01, and a run would take days


def time_step(
    particles: Sequence[Particle], fraction: float = USUAL, *, forced: bool = False, restitution: float = 1.0
) -> tuple[float, tuple[str, ...]]:
    """Return the time step as a fraction of the smallest Rayleigh step.

    The lowest restitution of the contacts makes it shorter where the dashpots and not the springs decide which step is
    stable (`dashpot_factor`).

    Parameters
    ----------
    particles : sequence of Particle
        The particles, with the moduli that are simulated.
    fraction : float
        Time step over Rayleigh's [1].
    forced : bool
        Whether an unstable step is taken.
    restitution : float
        Lowest restitution of the contacts [1].

    Returns
    -------
    step : float
        Time step [s].
    warnings : tuple of str
        Warnings about it.

    Raises
    ------
    BadInput
        If the fraction is not positive or too small, or the step is unstable and not forced.

    References
    ----------
    Hlosta et al. 2020, eq. 7.
    """
    if not (math.isfinite(fraction) and fraction > 0):
        raise BadInput(f"time_step_fraction must be a positive number, got {fraction:g}.")
    if fraction < LEAST:
        raise BadInput(
            f"time_step_fraction: {fraction:g} of Rayleigh's step makes the run {USUAL / fraction:.2g} times as long "
            f"as the usual {USUAL:g} and no more accurate; give at least {LEAST:g}."
        )
    if fraction > UNSTABLE and not forced:
        raise BadInput(
            f"time_step_fraction: {100 * fraction:g}% of Rayleigh's step is unstable; "
            f"give at most {UNSTABLE:g} (usual: {USUAL:g}), or force it."
        )
    warnings: tuple[str, ...] = ()
    if fraction > DOUBTFUL:
        why = f"above {DOUBTFUL:.0%} contacts lose accuracy"
        if fraction > UNSTABLE:
            why = f"above {UNSTABLE:.0%} contacts gain spurious energy"
        warnings = (f"the time step is {100 * fraction:g}% of Rayleigh's; {why}",)
    longest = dashpot_factor(restitution) * USUAL
    if restitution < SPRINGS_DECIDE and fraction > longest and not forced:
        fraction = longest
        warnings = (
            f"the time step is {100 * fraction:.3g}% of Rayleigh's, because the dashpots of a restitution of "
            f"{restitution:g} are unstable with a longer one",
        )
    return fraction * min(particle.rayleigh_time_step for particle in particles), warnings


def dashpot_factor(restitution: float) -> float:
    """Return a factor on the time step for contacts of low restitution.

    Parameters
    ----------
    restitution : float
        Lowest restitution of the contacts [1].

    Returns
    -------
    float
        At most 1, which it is from `SPRINGS_DECIDE` upwards [1].

    Notes
    -----
    A spring of frequency w with a dashpot of damping ratio psi is stable under symplectic Euler steps of at most 2
    (sqrt(1 + psi^2) - psi) / w.  The factor is that limit over the limit at `SPRINGS_DECIDE`.

    Examples
    --------
    >>> dashpot_factor(0.5), round(dashpot_factor(0.01), 2)
    (1.0, 0.43)
    """
    return 1.0 if restitution >= SPRINGS_DECIDE else _stable(restitution) / _stable(SPRINGS_DECIDE)


def _stable(restitution: float) -> float:
    from rigtwin.sim.engine.contact import damping_ratio  # with Taichi, which takes a second to import

    psi = damping_ratio(restitution)
    return math.sqrt(1 + psi**2) - psi


def of_kind(one: object, kind: type) -> None:
    """Refuse an object of another class.

    Parameters
    ----------
    one : object
        Object to be checked.
    kind : type
        Class that it must have.

    Raises
    ------
    BadInput
        If the object is not of it.
    """
    if not isinstance(one, kind):
        room = kind.__module__.rpartition(".")[2]
        raise BadInput(f"{one!r:.80} is no {room}.{kind.__name__}; make one for each run.")
