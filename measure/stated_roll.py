"""A camera's roll that is stated, held against the one that the picture shows, and one that only the picture shows."""

from __future__ import annotations

import math

from rigtwin.lab.quantity import Check
from rigtwin.measure.upright import GIVEN_ROLL, NOT_SEEN, STURDY, Upright

STATED_TO = math.radians(0.5)  # nobody reads a camera's lean better


def roll_check(given: float, seen: float, doubt: float, witness: str) -> Check:
    """A stated roll against that which a `witness` in the picture shows, with its standard uncertainty [rad]."""
    passed = abs(given - seen) < max(3 * doubt, STATED_TO)
    message = (
        f"a camera roll of {math.degrees(given):+.2f} degrees was given, {witness} "
        f"{math.degrees(seen):+.2f} ± {math.degrees(doubt):.2f}"
    )
    ending = (
        "."
        if passed
        else ": its sign may be wrong (positive when the scene looks turned clockwise), or what is seen there is not "
        "level, which a spirit level on it tells; where it is, leave --camera-roll out."
    )
    return Check("camera_roll", passed, math.degrees(given), math.degrees(seen), message + ending)


def upright_checks(upright: Upright) -> list[Check]:
    """Whether level edges bear out a stated roll, or that they alone show one as no camera on a stand has."""
    if upright.source == GIVEN_ROLL:
        return [roll_check(upright.roll, *upright.seen, "the level edges in the picture show")] if upright.seen else []
    turned = math.degrees(upright.roll)
    if abs(turned) <= STURDY:
        return []
    message = (
        f"the edges taken for level show a camera turned by {turned:+.1f} degrees, as none on a stand is: they "
        f"may lie aslant; where it was turned so, give --camera-roll {turned:.1f}deg."
    )
    return [Check("camera_roll", False, turned, 0.0, message)]


def nothing_level(upright: Upright) -> str:
    """What to say where neither a stated roll nor an edge tells how the camera was turned; nothing where one does."""
    if upright.source != NOT_SEEN:
        return ""
    return (
        "camera roll: nothing level is seen, the picture was taken as upright, to "
        f"{math.degrees(upright.sigma):.0f} degrees; give --camera-roll, 0deg where the camera was levelled."
    )
