"""A camera's roll that is stated, held against the one that the picture shows."""

from __future__ import annotations

import math

from rigtwin.lab.quantity import Check

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
