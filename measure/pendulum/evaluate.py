"""Evaluate the tracks of a pendulum: restitution, release and rebound angles, checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from rigtwin.lab.arrays import Array
from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Detail, Evaluation, Quantity, doubted
from rigtwin.lab.records import Track
from rigtwin.measure.pendulum.checks import (
    contact_angle_check,
    distance_check,
    gravity_check,
    length_check,
    momentum_check,
    reasons_of,
    residual_check,
)
from rigtwin.measure.pendulum.swing_fit import Outcome, SwingFit, fit_swings
from rigtwin.measure.pendulum.swing_model import Swings, centres, states_at_collision, turning_points

Variant = Literal["double", "wall"]

# Share of the bead's radius.  The lit side of a bead changes with its position under the lamp, so the centre fitted to
# an evenly shaded disc shifts by some hundredths of the radius between the ends of a swing.
SHADING = 0.03

HEAD_ON = ("momentum", "contact_distance")  # checks that fail if the beads meet off centre or a track is wrong


def evaluate(
    tracks: Sequence[Track],
    *,
    variant: Variant = "double",
    length: float | None = None,
    bead_diameter: float | None = None,
    bead_mass: float | None = None,
) -> Evaluation:
    """Restitution, release and rebound angles of a pendulum record, with checks of momentum, gravity and lengths.

    Parameters
    ----------
    tracks : sequence of Track
        Beads "A" (released) and "B" (hanging), or one bead for the wall.  Position [m], shape (n, 2), in the plane of
        the swing; time [s], shape (n,).
    variant : {"double", "wall"}
        Second bead or wall.
    length : float, optional
        Stated length from hinge to bead centre [m]; used in the checks only.
    bead_diameter : float, optional
        Stated diameter [m]; used in the checks only.
    bead_mass : float, optional
        Stated mass [kg]; used in the checks only.

    Returns
    -------
    Evaluation
        ``restitution_pair`` and ``energy_ratio_root`` (or ``restitution_wall``) [1], ``release_angle`` and
        ``rebound_angle`` [deg], with checks.

    Raises
    ------
    NothingToMeasure
        If there is no release, no second bead or no collision in the record.
    BadInput
        If the number or names of the tracks do not match the variant.

    Notes
    -----
    - ``restitution_pair``, method "velocity", per collision: e = (v_B' - v_A') / (v_A - v_B) with the speeds at the
      contact from the fitted equation of motion, so damping does not count as restitution.
    - ``restitution_pair``, method "angle": e = (sin(b'/2) - sin(a'/2)) / sin(a/2) with the release angle a and the
      turning angles a', b' of A and B, that of A negative if it bounces back.  Losses of the swing do count.
    - ``energy_ratio_root``, method "height": sqrt(h_B' / h_A), eq. 5 of the paper applied to the two beads.  For equal
      masses it is (1 + e) / 2, not e.
    - ``restitution_wall``, methods "velocity": v'/v; "angle": sin(a'/2) / sin(a/2), which assumes that the bead hangs
      vertically where it touches the wall; "height": sqrt(h'/h) with the heights above the point of contact.

    References
    ----------
    Hlosta et al. (2020), eq. 5 and fig. 3c.
    """
    return judge(fit_swings(in_order(tracks, variant)), length, bead_diameter, bead_mass)


def judge(
    fit: SwingFit,
    length: float | None = None,
    bead_diameter: float | None = None,
    bead_mass: float | None = None,
    *,
    shading: float = 0.0,
) -> Evaluation:
    """Evaluate fitted swings; arguments as in `evaluate`.

    `shading` [m] is the apparent shift of a filmed bead's centre between positions due to the lighting.
    """
    outcomes = _with_shading(fit.propagate(outcomes_of), shading)
    residuals = residual_check(fit)
    checks = [gravity_check(outcomes), residuals]
    checks.insert(0, momentum_check(outcomes, bead_mass) if fit.swings.beads == 2 else contact_angle_check(outcomes))
    if length is not None:
        checks.append(length_check(outcomes["length"], length))
    if bead_diameter is not None and fit.swings.beads == 2:
        checks.append(distance_check(outcomes["distance"], bead_diameter))
    reasons = reasons_of(fit, outcomes)
    if not residuals.passed:
        reasons = {name: "; ".join(filter(None, [reason, residuals.message])) for name, reason in reasons.items()}
    if fit.swings.beads == 1 and not checks[0].passed:
        reasons["plumb"] = checks[0].message
    if fit.swings.beads == 2:
        off_centre = [check.message for check in checks if check.check in HEAD_ON and not check.passed]
        reasons["collision"] = "; ".join(filter(None, [reasons["collision"], *off_centre]))
    quantities = [*_restitutions(fit, outcomes, reasons), *_angles(outcomes, reasons)]
    warnings = [check.message for check in checks if not check.passed]
    return Evaluation(tuple(quantities), tuple(checks), tuple(warnings))


def in_order(tracks: Sequence[Track], variant: Variant) -> tuple[Track, ...]:
    """The tracks of bead A, then bead B.

    Raises `NothingToMeasure` for one track only, `BadInput` if names or number do not match the variant.
    """
    named = {track.body.strip().upper(): track for track in tracks}
    if variant == "wall":
        if len(tracks) != 1 and "A" not in named:
            raise BadInput(f"A wall pendulum has one bead; this record holds {len(tracks)} ({', '.join(named)}).")
        return (named.get("A", tracks[0]),)
    if len(tracks) == 1:
        raise NothingToMeasure(
            "the record holds one track; a double pendulum needs those of bead A and bead B (for a wall: variant wall)."
        )
    if not {"A", "B"} <= set(named):
        raise BadInput(
            f"The record names its beads {', '.join(named)}; name the released bead A and the hanging one B."
        )
    return named["A"], named["B"]


def outcomes_of(swings: Swings) -> dict[str, Array]:
    """All values derived from the swings; speeds and angles are positive in A's direction of approach."""
    lengths, outcomes = swings.per_bead("length"), {}
    for k in range(swings.collisions):
        angle, before = states_at_collision(swings, k)
        v, v_after = before * lengths, swings.after(k) * lengths
        if swings.beads == 1:
            outcomes[f"restitution_{k}"] = -v_after[0] / v[0]
        else:
            outcomes[f"restitution_{k}"] = (v_after[1] - v_after[0]) / (v[0] - v[1])
        outcomes[f"approach_{k}"] = np.abs(v[0] - (v[1] if swings.beads > 1 else 0))
        if k == 0:
            way = np.sign(v[0])
            outcomes |= _first_collision(swings, angle, way * v, way * v_after, way)
    return outcomes


def _first_collision(swings: Swings, angle: Array, v: Array, v_after: Array, way: Array) -> dict[str, Array]:
    turning = way * turning_points(swings, 0)[0]
    release = np.abs(swings["release_angle"])
    from_angles = np.sin(turning / 2) / np.sin(release / 2)
    outcomes = {
        "release": release,
        "turning_0": turning[0],
        "gravity": swings["gravity"],
        "pull": swings["gravity"] / swings["length_0"],
        "length": np.mean(swings.per_bead("length"), axis=0),
        "way": way,
    }
    if swings.beads == 1:
        hit, (start, turned) = way * angle[0], (np.cos(release), np.cos(turning[0]))
        heights = np.maximum(np.cos(hit) - turned, 0) / (np.cos(hit) - start)
        return outcomes | {"from_angles": -from_angles[0], "from_heights": np.sqrt(heights), "contact_angle": hit}
    place = centres(swings, angle[:, None])[:, 0]
    rise = swings["length_1"] * (1 - np.cos(turning[1])) / (swings["length_0"] * (1 - np.cos(release)))
    return outcomes | {
        "turning_1": turning[1],
        "from_angles": from_angles[1] - from_angles[0],
        "energy_ratio_root": np.sqrt(np.maximum(rise, 0)),
        "angle_ratio": turning[1] / release,
        "speed": v[0],
        "speeds_after": v_after[0] + v_after[1],
        "momentum": (v_after[0] + v_after[1]) / v[0],
        "distance": np.hypot(*np.moveaxis(place[1] - place[0], -1, 0)),
    }


def _with_shading(outcomes: dict[str, Outcome], shading: float) -> dict[str, Outcome]:
    """Add the uncertainty of the bead's centre due to shading to angles and what follows from them."""
    if not shading > 0:
        return outcomes
    step = shading / outcomes["length"].value  # [rad]
    turns = [outcomes[name].value for name in ("turning_0", "turning_1") if name in outcomes]
    half = np.sin(outcomes["release"].value / 2)
    rise = [math.cos(turn / 2) / 2 * step / half for turn in turns]
    fall = step / (2 * math.tan(outcomes["release"].value / 2))
    steps = dict.fromkeys(("release", "turning_0", "turning_1"), step)
    steps["from_angles"] = math.hypot(*rise, fall * outcomes["from_angles"].value)
    steps["from_heights"] = steps["from_angles"]
    if "energy_ratio_root" in outcomes:
        steps["energy_ratio_root"] = math.hypot(rise[1], fall * outcomes["energy_ratio_root"].value)
    return {
        name: Outcome(outcome.value, outcome.budget | ({"shading": steps[name]} if name in steps else {}))
        for name, outcome in outcomes.items()
    }


def _restitutions(fit: SwingFit, outcomes: dict[str, Outcome], reasons: dict[str, str]) -> list[Quantity]:
    name = "restitution_pair" if fit.swings.beads == 2 else "restitution_wall"
    found = []
    for k in range(fit.swings.collisions):
        e = outcomes[f"restitution_{k}"]
        detail: dict[str, Detail] = {
            "collision": k + 1,
            "impact_speed_m_per_s": round(outcomes[f"approach_{k}"].value, 5),
        }
        reason = reasons["collision"]
        if e.value - 2 * e.std > 1:
            reason = "; ".join(filter(None, [reason, "a restitution above 1 is not possible: a track is wrong"]))
        found.append(_quantity(name, e, "1", "velocity", detail, doubtful=reason))
    by_speed, by_angle = outcomes["restitution_0"], outcomes["from_angles"]
    # this method counts losses of the swing as restitution: its difference from the fit enters the uncertainty
    losses = {"swing_losses": abs(by_speed.value - by_angle.value)}
    detail = {"collision": 1}
    seen = "; ".join(filter(None, [reasons["collision"], reasons["release"], reasons["turning"]]))
    plumb = "; ".join(filter(None, [seen, reasons.get("plumb", "")]))
    found.append(
        _quantity(name, Outcome(by_angle.value, by_angle.budget | losses), "1", "angle", detail, doubtful=plumb)
    )
    if fit.swings.beads == 1:
        by_height = outcomes["from_heights"]
        losses = {"swing_losses": abs(by_speed.value - by_height.value)}
        whole = Outcome(by_height.value, by_height.budget | losses)
        found.append(_quantity(name, whole, "1", "height", detail, doubtful=seen))
    else:
        ratio: dict[str, Detail] = {
            "collision": 1,
            "angle_ratio": round(outcomes["angle_ratio"].value, 5),
            "equals": "(1+e)/2, not e",
        }
        found.append(_quantity("energy_ratio_root", outcomes["energy_ratio_root"], "1", "height", ratio, doubtful=seen))
    return found


def _angles(outcomes: dict[str, Outcome], reasons: dict[str, str]) -> list[Quantity]:
    way = outcomes["way"].value
    quantities = [
        _quantity(
            "release_angle",
            _degrees(outcomes["release"]),
            "deg",
            "swing",
            {"body": "A", "side": "left" if way > 0 else "right"},
            doubtful=reasons["release"],
        )
    ]
    for bead, body in enumerate("AB"):
        if (turning := outcomes.get(f"turning_{bead}")) is not None:
            detail: dict[str, Detail] = {"body": body, "side": "right" if turning.value * way > 0 else "left"}
            angle = _degrees(replace(turning, value=abs(turning.value)))
            quantities.append(_quantity("rebound_angle", angle, "deg", "swing", detail, doubtful=reasons["turning"]))
    return quantities


def _degrees(outcome: Outcome) -> Outcome:
    return Outcome(math.degrees(outcome.value), {k: math.degrees(part) for k, part in outcome.budget.items()})


def _quantity(
    name: str, outcome: Outcome, unit: str, method: str, detail: dict[str, Detail], *, doubtful: str
) -> Quantity:
    found = Quantity(name, outcome.value, outcome.std, unit, method, detail=detail, budget=dict(outcome.budget))
    return doubted(found, doubtful)
