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

PITS_BELOW, PITS_SPREAD = 0.50, 0.05

BEAD_DOUBT = MISFIT / 2  # relative, of a scale read off the beads or of their size, which nothing else checks then

# Beads are taken to be that many times as large as an outline is rough where only that tells their size; outlines of
# settled beds are rough by 0.15 to 0.35 of them.
OF_ROUGHNESS, ROUGHNESS_DOUBT = 4.0, 0.4  # the latter relative


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
    """Bed height and bulk density from outlines of one bed (several views), filmed or simulated.

    A simulated bed's profile is the outline of its spheres seen level and from far away, above the floor.
    `cylinder_diameter` [m] is the inner one, `total_mass` [kg], `bead_diameter` [m], `bead_density` [kg/m^3];
    `spheres` are all of one size.
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
    for name, value in (
        ("cylinder_diameter", cylinder),
        ("total_mass", mass),
        ("bead_diameter", bead),
        ("bead_density", solid),
    ):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise BadInput(f"measure packing: {name} must be positive, got {value:g}.")
    heights = [mean_outline(each.profile, cylinder) for each in seen]
    outline = float(np.mean([height for height, _ in heights]))
    rough = float(np.mean([rough for _, rough in heights]))
    grain, unknown = (bead, 0.0) if bead else _bead_seen(seen, rough)
    parts = _view_doubts(seen, [height for height, _ in heights])
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
            f"the outline lies at {outline * 1e3:.1f} mm, not above the floor by a bead; check height_m and its zero."
        )
    warnings = list(dict.fromkeys(each.unconfirmed for each in seen if each.unconfirmed))
    if bead is None:
        warnings.append(
            f"bead diameter not stated: what lies between outline, tops and mean surface was worked out for beads of "
            f"{reading(grain, unknown, 'm')}, by the look of the bed; give --bead-diameter."
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
                f"mass not confirmed: bulk density hangs on --total-mass {mass * 1e3:g} g alone, by which beads have "
                f"about {material} kg/m^3; give --bead-density to check it."
            )
        found += [doubted(one, failed(checks, ["bulk_density", "cylinder_bead_ratio"])) for one in densities]
    else:
        missing = "total_mass" if mass is None else "cylinder_diameter"
        warnings.append(f"bulk density is left out; give --{missing.replace('_', '-')}.")
    return Evaluation(tuple(found), tuple(checks), tuple(warnings))


def _bead_seen(seen: Sequence[Observation], rough: float) -> tuple[float, float]:
    """Diameter of a bead that is not stated and its standard uncertainty, both in m."""
    looks = [each.bead for each in seen if each.bead is not None]
    if looks:  # views show the same beads alike
        return float(np.median(looks)), BEAD_DOUBT * float(np.median(looks))
    return OF_ROUGHNESS * rough, ROUGHNESS_DOUBT * OF_ROUGHNESS * rough


def _flaw(seen: Sequence[Observation], checks: Sequence[Check]) -> str:
    """Why the heights are not to be relied on."""
    outline = [each.flaw for each in seen if each.flaw]
    # an outline that something covers is likely to be askew or smooth for that
    odd = [] if outline else [each.message for each in checks if not each.passed and each.check in SPOILING]
    return in_a_row([*outline, *odd, *(each.misfit for each in seen)])


def _view_doubts(seen: Sequence[Observation], heights: Sequence[float]) -> dict[str, float]:
    """What the pictures leave in doubt; views share scale and floor, so only scatter averages out."""
    names = dict.fromkeys(name for each in seen for name in each.doubts)
    parts = {name: max(each.doubts.get(name, 0.0) for each in seen) for name in names}
    sigmas = [float(np.nanmedian(each.profile.sigma)) for each in seen]
    noise = max((sigma for sigma in sigmas if math.isfinite(sigma)), default=0.0)
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
    """Mass over the filled volume, pi/4 D^2 h."""
    value = mass / (math.pi / 4 * cylinder**2 * height.value)
    power = {"mass": 1, "cylinder diameter": 2}
    budget = {name: value * part / height.value for name, part in height.budget.items()}
    budget |= {name: value * power[name] * part for name, part in stated.items()}
    sigma = root_sum_of_squares(budget)
    return Quantity(
        "bulk_density", value, sigma, "kg/m^3", height.method, height.n, budget=budget, doubtful=height.doubtful
    )
