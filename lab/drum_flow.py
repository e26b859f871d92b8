"""Checks that the bed of a rotating drum flows, shared by film and twin."""

from __future__ import annotations

from rigtwin.lab.quantity import Check
from rigtwin.lab.rigs import GRAVITY

FILL = 0.35  # of the drum, usual

FLOWING = (0.03, 0.7)  # part of the drum; less does not flow over itself, more has hardly a free surface

# speed^2 R / g; the wall throws beads off where that is the sine of their angle above the axis, so from a half on they
# fly across the drum from 30 degrees above it, and from 1 on they never leave the wall
THROWN, CENTRIFUGED = 0.5, 1.0


def froude_check(speed: float, radius: float) -> Check:
    """Check that beads flow in a drum and are not thrown.

    Parameters
    ----------
    speed : float
        Speed of the drum [rad/s].
    radius : float
        Its radius [m].

    Returns
    -------
    Check
        ``froude_number`` [1], speed^2 R / g.
    """
    froude = speed**2 * radius / GRAVITY
    words = f"the Froude number, speed^2 R / g, is {froude:.2g}"
    if froude >= CENTRIFUGED:
        words += ": the drum centrifuges, beads stay at its wall and no surface flows; turn it more slowly"
    elif froude >= THROWN:
        words += ": beads are thrown across the drum, and no surface flows; turn it more slowly"
    if froude >= THROWN:
        words += ", or correct the speed if it turned otherwise"
    return Check("froude_number", froude < THROWN, froude, 0.0, words + ".")


def fill_check(share: float, what: str) -> Check:
    """Check that a bed flows over itself.

    Parameters
    ----------
    share : float
        Share of the drum that it takes [1].
    what : str
        What fills it, in words: "the bed fills".

    Returns
    -------
    Check
        ``fill`` [1].
    """
    filled = FLOWING[0] < share < FLOWING[1]
    least, most = (round(100 * limit) for limit in FLOWING)  # [%]
    ending = "." if filled else f": no bed of less than {least} or more than {most} % flows over itself."
    return Check("fill", filled, share, FILL, f"{what} {100 * share:.3g} % of the drum's cross-section{ending}")
