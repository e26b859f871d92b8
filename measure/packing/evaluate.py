"""Evaluate outlines of a bed in a cylinder: bed height and bulk density with their uncertainty budgets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.formatting import reading
from rigtwin.lab.quantity import (
    Check,
    Evaluation,
    Quantity,
    doubted,
    failed,
    in_a_row,
    root_sum_of_squares,
)
from rigtwin.lab.records import Profile
from rigtwin.lab.units import positive
from rigtwin.measure.bulk.checks import MISFIT
from rigtwin.measure.packing.bed_profile import OUTLINE_ABOVE, OUTLINE_SPREAD, Observation, mean_outline
from rigtwin.measure.packing.checks import (
    ANY_SHAPE,
    SPOILING,
    USUAL_FRACTION,
    bed_views_check,
    checks_of,
    fraction_check,
    material_check,
    random_packing,
    roughly,
)

PITS_BELOW, PITS_SPREAD = 0.50, 0.05  # [bead diameters], mean surface below the bead tops; its standard uncertainty

BEAD_UNCERTAINTY = (
    MISFIT / 2
)  # relative standard uncertainty of a bead size, or of a scale from it, that nothing else checks

# Estimated bead diameter over the rms roughness of the outline, used where nothing else shows the bead size.  Outlines
# of settled beds have a roughness of 0.15 to 0.35 bead diameters.
OF_ROUGHNESS, ROUGHNESS_UNCERTAINTY = 4.0, 0.4  # the second is a relative standard uncertainty


# ------------------------------------------------------------------------------------------------- record -> quantities


def evaluate(
    profiles: Sequence[Profile],
    *,
    cylinder_diameter: float | None,
    total_mass: float | None = None,
    bead_diameter: float | None = None,
    bead_density: float | None = None,
    spheres: bool = True,
) -> Evaluation:
    """Evaluate bed height and bulk density from outlines of one bed, filmed or simulated.

    Parameters
    ----------
    profiles : sequence of Profile
        One outline per view: x across the cylinder [m], height above the floor [m].  The profile of a simulated bed is
        the outline of its spheres, seen horizontally from far away.
    cylinder_diameter : float or None
        Inner diameter of the cylinder [m].
    total_mass : float, optional
        Mass of all beads [kg]; needed for the bulk density.
    bead_diameter : float, optional
        Bead diameter [m]; estimated from the roughness of the outline where it is not given.
    bead_density : float, optional
        Density of a bead [kg/m^3]; used to check the bulk density.
    spheres : bool
        Whether the beads are spheres of one size.

    Returns
    -------
    Evaluation
        ``bed_height`` [m] by the methods "surface bead tops", "mean surface" and "outline"; with mass and cylinder also
        ``bulk_density`` [kg/m^3] by the first two; checks and warnings.

    Raises
    ------
    BadInput
        If no profile is given or a size, mass or density is not positive.
    NothingToMeasure
        If a profile shows too little of the surface, or lies less than a bead above the floor.

    Notes
    -----
    With mean outline h_o and bead diameter d::

        h_tops = h_o - 0.30 d
        h_mean = h_o - 0.80 d
        rho    = 4 m / (pi D^2 h)

    Examples
    --------
    >>> import numpy as np
    >>> from rigtwin.lab.records import Profile
    >>> x = np.linspace(-0.03, 0.03, 301)
    >>> outline = Profile(x, 0.07 + 0.0018 * np.sin(2 * np.pi * x / 0.006), np.full(301, 1e-5))
    >>> found = evaluate([outline], cylinder_diameter=0.06, bead_diameter=0.006, total_mass=0.1)
    >>> [(one.quantity, one.method, round(one.value, 3)) for one in found.quantities[:2]]
    [('bed_height', 'surface bead tops', 0.068), ('bed_height', 'mean surface', 0.065)]
    """
    seen = [Observation(profile) for profile in profiles]
    return evaluate_views(seen, cylinder_diameter, total_mass, bead_diameter, bead_density, {}, spheres)


def evaluate_views(
    seen: Sequence[Observation],
    cylinder: float | None,
    mass: float | None,
    bead: float | None,
    solid: float | None,
    stated: Mapping[str, float],
    spheres: bool,
) -> Evaluation:
    """`stated` are the relative standard uncertainties of mass and cylinder, where they are not exact."""
    if not seen:
        raise BadInput("measure packing: no profile given; give at least one outline of the bed.")
    positive(cylinder_diameter=cylinder, total_mass=mass, bead_diameter=bead, bead_density=solid)
    heights = [mean_outline(each.profile, cylinder) for each in seen]
    outline = float(np.mean([height for height, _ in heights]))
    rough = float(np.mean([rough for _, rough in heights]))
    grain, unknown = (bead, 0.0) if bead else _bead_seen(seen, rough)
    parts = _view_uncertainties(seen, [height for height, _ in heights])
    below = OUTLINE_ABOVE + PITS_BELOW
    tops = {**parts, "outline to tops": OUTLINE_SPREAD * grain, "bead diameter": unknown * OUTLINE_ABOVE}
    pits = {
        **parts,
        "outline to surface": math.hypot(OUTLINE_SPREAD, PITS_SPREAD) * grain,
        "bead diameter": unknown * below,
    }
    checks = checks_of(seen, heights, cylinder, bead)
    if len(seen) > 1:
        checks.append(bed_views_check(seen, [height for height, _ in heights], grain))
    flaw = _flaw(seen, checks)
    found = [
        _height(outline - OUTLINE_ABOVE * grain, "surface bead tops", tops, len(seen), flaw),
        _height(outline - below * grain, "mean surface", pits, len(seen), flaw),
        _height(outline, "outline", parts, len(seen), flaw),
    ]
    if found[1].value <= 0:
        raise NothingToMeasure(
            f"the outline lies {outline * 1e3:.1f} mm above the floor, and the mean surface "
            f"{-found[1].value * 1e3:.1f} mm below it; check the zero of the heights, or state the floor of a photo "
            "with --floor y."
        )
    warnings = list(dict.fromkeys(each.unconfirmed for each in seen if each.unconfirmed))
    if bead is None:
        warnings.append(
            f"bead diameter not stated: the offsets between outline, tops and mean surface assume beads of "
            f"{reading(grain, unknown, 'm')}, estimated from the picture; give --bead-diameter."
        )
    if mass is not None and cylinder is not None:
        densities = [_density(height, mass, cylinder, stated) for height in found[:2]]
        if solid is None:
            checks.append(material_check(densities[0].value))
        else:
            among = random_packing(cylinder / grain) if spheres else ANY_SHAPE
            checks.append(fraction_check(densities[1], solid, among, spheres))
        if solid is None and stated:
            material = roughly(densities[0].value / USUAL_FRACTION)
            warnings.append(
                f"mass not confirmed: bulk density depends on --total-mass {mass * 1e3:g} g alone, which implies beads "
                f"of about {material} kg/m^3; give --bead-density to check it."
            )
        found += [doubted(one, failed(checks, ["bulk_density", "cylinder_bead_ratio"])) for one in densities]
    else:
        missing = "total_mass" if mass is None else "cylinder_diameter"
        warnings.append(f"bulk density was not computed; give --{missing.replace('_', '-')}.")
    return Evaluation(tuple(found), tuple(checks), tuple(warnings))


def _bead_seen(seen: Sequence[Observation], rough: float) -> tuple[float, float]:
    """Estimated diameter of a bead of unstated size and its standard uncertainty, both in m."""
    looks = [each.bead for each in seen if each.bead is not None]
    if looks:  # all views share the same bias of the apparent size, so it does not average out
        return float(np.median(looks)), BEAD_UNCERTAINTY * float(np.median(looks))
    return OF_ROUGHNESS * rough, ROUGHNESS_UNCERTAINTY * OF_ROUGHNESS * rough


def _flaw(seen: Sequence[Observation], checks: Sequence[Check]) -> str:
    """Reason why the heights are unreliable, or ""."""
    outline = [each.flaw for each in seen if each.flaw]
    # a covered outline often also fails the checks on slope and roughness; report only the cause
    odd = [] if outline else [each.message for each in checks if not each.passed and each.check in SPOILING]
    return in_a_row([*outline, *odd, *(each.misfit for each in seen)])


def _view_uncertainties(seen: Sequence[Observation], heights: Sequence[float]) -> dict[str, float]:
    """Standard uncertainties of the mean outline [m]; views share scale and floor, so only scatter averages out."""
    names = dict.fromkeys(name for each in seen for name in each.uncertainties)
    parts = {name: max(each.uncertainties.get(name, 0.0) for each in seen) for name in names}
    sigmas = [each.profile.sigma[np.isfinite(each.profile.sigma)] for each in seen]
    noise = max((float(np.median(sigma)) for sigma in sigmas if len(sigma)), default=0.0)
    parts["outline"] = 0.3 * noise
    if len(heights) > 1:
        parts["views"] = float(np.std(heights, ddof=1)) / math.sqrt(len(heights))
    return parts


def _height(value: float, method: str, budget: dict[str, float], count: int, flaw: str) -> Quantity:
    budget = {name: part for name, part in budget.items() if part > 0}
    if flaw:
        budget["unreliable outline"] = 2 * root_sum_of_squares(budget)
    return Quantity("bed_height", value, root_sum_of_squares(budget), "m", method, count, {}, budget, flaw)


def _density(height: Quantity, mass: float, cylinder: float, stated: Mapping[str, float]) -> Quantity:
    """Bulk density m / (pi/4 D^2 h) [kg/m^3]."""
    value = mass / (math.pi / 4 * cylinder**2 * height.value)
    power = {"mass": 1, "cylinder diameter": 2}
    budget = {name: value * part / height.value for name, part in height.budget.items()}
    budget |= {name: value * power[name] * part for name, part in stated.items()}
    sigma = root_sum_of_squares(budget)
    return Quantity(
        "bulk_density", value, sigma, "kg/m^3", height.method, height.n, budget=budget, doubtful=height.doubtful
    )
