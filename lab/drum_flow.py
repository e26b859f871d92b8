"""Checks that the bed of a rotating drum flows, shared by film and twin."""

from __future__ import annotations

from rigtwin.lab.quantity import Check
from rigtwin.lab.rigs import GRAVITY

FILL = 0.35  # of the drum, usual

FLOWING = (0.03, 0.7)  # part of the drum; less does not flow over itself, more has hardly a free surface

# speed^2 R / g; the wall throws beads off where that is the sine of their angle above the axis, so from a half on they
# fly across the drum from 30 degrees above it, and from 1 on they never leave the wall
THROWN, CENTRIFUGED = 0.5, 1.0

# speed^2 R / g of beds that roll, with a level surface: below, they slump in avalanches; above, they cascade with an
# arched surface (1e-4 and 1e-2, J. Mellmann, Powder Technology 118 (2001) 251, table 1); the borders depend on fill and
# friction, so a factor of 3 is left on both sides (assumed)
ROLLING = (3e-5, 3e-2)


def speed_doubt(speed: float, radius: float, *, level: bool, avalanches: bool) -> str:
    """Return why a stated speed does not fit the surface of the bed.

    Parameters
    ----------
    speed : float
        Stated speed of the drum [rad/s].
    radius : float
        Its radius [m].
    level : bool
        Whether the surface is straight.
    avalanches : bool
        Whether avalanches were seen.

    Returns
    -------
    str
        A clause; empty if the speed fits.

    References
    ----------
    J. Mellmann, The transverse motion of solids in rotating cylinders: forms of motion and transition behavior, Powder
    Technology 118 (2001) 251-270, table 1.

    Examples
    --------
    >>> speed_doubt(0.03, 0.07, level=True, avalanches=False)
    'below a Froude number of 3e-05 beds slump in avalanches, and none were seen (speed^2 R / g is 6.4e-06)'
    """
    froude = speed**2 * radius / GRAVITY
    low, high = ROLLING
    why = ""
    if froude < low and not avalanches:
        why = f"below a Froude number of {low:g} beds slump in avalanches, and none were seen"
    elif froude > high and level:
        why = f"above a Froude number of {high:g} the surface of beds is arched, and a straight one was seen"
    return why and f"{why} (speed^2 R / g is {froude:.2g})"


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
