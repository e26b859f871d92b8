"""Evaluation of outlines of a bed: heights, bulk density and every part of their budgets in closed form."""

import math

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.records import Profile
from rigtwin.measure.packing.bed_profile import Observation
from rigtwin.measure.packing.evaluate import evaluate, evaluate_views

BEAD, CYLINDER = 0.006, 0.06
NOISE = 1e-4  # [m], of every point of an outline
ABOVE_TOPS, ABOVE_SURFACE = 0.30, 0.80  # [bead diameters], of the mean outline
TOPS_SPREAD, SURFACE_SPREAD = 0.08, math.hypot(0.08, 0.05)  # [bead diameters]


def wavy(height=0.07, *, rough=0.2 * BEAD, noise=NOISE, view="front", lean=0.0):
    """Outline of this mean [m] and rms roughness [m] about it."""
    x = np.linspace(-CYLINDER / 2, CYLINDER / 2, 601)
    waves = math.sqrt(2) * rough * np.sin(2 * np.pi * x / (0.95 * CYLINDER / 9))
    return Profile(x, height + waves + lean * x, np.full(len(x), noise), view=view)


def views(*seen, mass=None, bead=BEAD, solid=None, stated=None, cylinder=CYLINDER, spheres=True):
    return evaluate_views(list(seen), cylinder, mass, bead, solid, stated or {}, spheres)


def pick(found, quantity, method):
    (one,) = (each for each in found.quantities if (each.quantity, each.method) == (quantity, method))
    return one


def heights(found):
    return [pick(found, "bed_height", method) for method in ("surface bead tops", "mean surface", "outline")]


def test_heights_lie_below_the_outline_by_shares_of_a_bead_that_are_uncertain_themselves():
    found = evaluate([wavy()], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    tops, surface, outline = heights(found)
    assert list(found.quantities) == [tops, surface, outline]
    assert outline.value == pytest.approx(0.07, abs=1e-5)
    assert tops.value == pytest.approx(outline.value - ABOVE_TOPS * BEAD)
    assert surface.value == pytest.approx(outline.value - ABOVE_SURFACE * BEAD)
    assert outline.budget == pytest.approx({"outline": 0.3 * NOISE})
    assert tops.budget == pytest.approx({"outline": 0.3 * NOISE, "outline to tops": TOPS_SPREAD * BEAD})
    assert surface.budget == pytest.approx({"outline": 0.3 * NOISE, "outline to surface": SURFACE_SPREAD * BEAD})
    for one in found.quantities:
        assert one.std_uncertainty == pytest.approx(math.hypot(*one.budget.values()))
        assert (one.unit, one.n, one.doubtful) == ("m", 1, "")
    assert found.warnings == ("bulk density was not computed; give --total-mass.",)


def test_a_bead_that_is_not_stated_is_four_times_the_roughness_known_to_two_fifths():
    found = evaluate([wavy(rough=1e-3)], cylinder_diameter=CYLINDER)
    tops, surface, outline = heights(found)
    bead = (outline.value - tops.value) / ABOVE_TOPS
    assert bead == pytest.approx(4e-3, rel=0.03)
    assert surface.value == pytest.approx(outline.value - ABOVE_SURFACE * bead)
    assert tops.budget["bead diameter"] == pytest.approx(0.4 * bead * ABOVE_TOPS)
    assert surface.budget["bead diameter"] == pytest.approx(0.4 * bead * ABOVE_SURFACE)
    assert "bead diameter" not in outline.budget
    assert found.warnings[0] == (
        "bead diameter not stated: the offsets between outline, tops and mean surface assume beads of "
        "4.0 ± 1.6 mm, estimated from the picture; give --bead-diameter."
    )


def test_beads_that_are_seen_have_the_median_size_of_the_views_and_the_error_that_they_share():
    seen = [Observation(wavy(), bead=size) for size in (0.005, 0.0052, 0.009)]
    tops, surface, outline = heights(views(*seen, Observation(wavy()), bead=None))
    assert tops.value == pytest.approx(outline.value - ABOVE_TOPS * 0.0052)
    assert tops.budget["bead diameter"] == pytest.approx(0.08 * 0.0052 * ABOVE_TOPS)
    assert surface.budget["bead diameter"] == pytest.approx(0.08 * 0.0052 * ABOVE_SURFACE)


def test_views_share_scale_and_floor_so_that_only_their_scatter_averages_out():
    seen = [
        Observation(wavy(0.070, noise=1e-4), {"floor": 4e-4, "scale": 1e-4}),
        Observation(wavy(0.071, noise=3e-4), {"floor": 2e-4, "roll": 5e-4}),
        Observation(wavy(0.072, noise=math.nan), {"floor": 3e-4}),
    ]
    outline = heights(views(*seen))[2]
    assert outline.value == pytest.approx(0.071, abs=1e-5)
    assert outline.n == 3
    expected = {"floor": 4e-4, "scale": 1e-4, "roll": 5e-4, "outline": 0.9e-4, "views": 1e-3 / math.sqrt(3)}
    assert outline.budget == pytest.approx(expected)
    assert outline.std_uncertainty == pytest.approx(math.hypot(*expected.values()))
    assert "outline" not in heights(views(seen[2]))[2].budget


@pytest.mark.parametrize(
    ("seen", "why"),
    [
        (Observation(wavy(), flaw="a hand covers it", misfit="the gauge contradicts it."),
         "a hand covers it; the gauge contradicts it"),
        (Observation(wavy(rough=0.7 * BEAD), flaw="a hand covers it"), "a hand covers it"),
    ],
)  # fmt: skip
def test_an_unreliable_outline_adds_twice_its_uncertainty(seen, why):
    sound = heights(views(Observation(wavy())))
    for one, other in zip(sound, heights(views(seen)), strict=True):
        assert other.doubtful == why
        assert other.budget["unreliable outline"] == pytest.approx(2 * one.std_uncertainty, rel=0.01)
        assert other.std_uncertainty == pytest.approx(math.sqrt(5) * one.std_uncertainty, rel=0.01)


def test_a_rough_or_leaning_outline_is_doubtful_with_the_message_of_its_check():
    for profile, name in ((wavy(rough=0.7 * BEAD), "smooth_surface"), (wavy(lean=0.12), "level_bed")):
        found = evaluate([profile], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
        (failed,) = (check for check in found.checks if not check.passed)
        assert failed.check == name
        assert {one.doubtful for one in found.quantities} == {failed.message.rstrip(".")}


def test_bulk_density_has_the_relative_uncertainties_of_height_mass_and_twice_the_diameter():
    found = views(Observation(wavy(), {"floor": 4e-4}), mass=0.12, solid=568.0 * 2, spheres=False,
                  stated={"mass": 0.01, "cylinder diameter": 0.02})  # fmt: skip
    for height in heights(found)[:2]:
        density = pick(found, "bulk_density", height.method)
        value = 0.12 / (math.pi * (CYLINDER / 2) ** 2 * height.value)
        assert density.value == pytest.approx(value)
        parts = {part: value * size / height.value for part, size in height.budget.items()}
        parts |= {"mass": 0.01 * value, "cylinder diameter": 2 * 0.02 * value}
        assert density.budget == pytest.approx(parts)
        assert density.std_uncertainty == pytest.approx(math.hypot(*parts.values()))
        assert (density.unit, density.n) == ("kg/m^3", 1)
    assert [one.quantity for one in found.quantities] == ["bed_height"] * 3 + ["bulk_density"] * 2
    assert not found.warnings


def test_a_mass_that_no_density_of_the_beads_confirms_is_reported_if_it_was_weighed():
    weighed = {"mass": 0.002}
    (warning,) = views(Observation(wavy()), mass=0.1, stated=weighed).warnings
    density = 0.1 / (math.pi * (CYLINDER / 2) ** 2 * (0.07 - ABOVE_TOPS * BEAD))
    assert warning == (
        "mass not confirmed: bulk density depends on --total-mass 100 g alone, which implies beads of about "
        f"{float(f'{density / 0.6:.2g}'):g} kg/m^3; give --bead-density to check it."
    )
    assert not views(Observation(wavy()), mass=0.1).warnings  # of a twin
    assert not views(Observation(wavy()), mass=0.1, solid=900.0, stated=weighed).warnings


@pytest.mark.parametrize(
    ("fraction", "solid", "stated", "passed"),
    [(0.6, 568.0, True, True), (0.3, 568.0, True, False), (0.6, 50.0, True, True), (0.6, 50.0, False, False)],
)
def test_the_density_of_the_beads_is_held_against_the_mean_surface(fraction, solid, stated, passed):
    surface = 0.07 - ABOVE_SURFACE * BEAD
    mass = fraction * solid * math.pi / 4 * CYLINDER**2 * surface
    found = views(Observation(wavy()), mass=mass, solid=solid if stated else None)
    (check,) = (each for each in found.checks if each.check == "bulk_density")
    assert check.passed == passed
    if stated:
        assert check.value == pytest.approx(fraction, rel=1e-3)
    for one in found.quantities:
        assert bool(one.doubtful) == (one.quantity == "bulk_density" and not passed)
    for one in found.quantities[3:]:
        assert ("failed check" in one.budget) != passed


def test_a_narrow_cylinder_makes_the_density_doubtful_and_no_height():
    narrow = 4.9 * BEAD
    found = evaluate([wavy()], cylinder_diameter=narrow, bead_diameter=BEAD, total_mass=0.02)
    (ratio,) = (each for each in found.checks if each.check == "cylinder_bead_ratio")
    assert not ratio.passed
    assert [bool(one.doubtful) for one in found.quantities] == [False] * 3 + [True] * 2


def test_what_is_missing_for_the_density_is_named():
    for given, missing in (({"cylinder_diameter": None, "total_mass": 0.1}, "cylinder-diameter"),
                           ({"cylinder_diameter": CYLINDER}, "total-mass")):  # fmt: skip
        found = evaluate([wavy()], bead_diameter=BEAD, **given)
        assert found.warnings == (f"bulk density was not computed; give --{missing}.",)
        assert len(found.quantities) == 3


def test_warnings_of_a_photo_are_given_once():
    unsure = [Observation(wavy(), unconfirmed=text) for text in ("no gauge.", "no gauge.", "", "no floor.")]
    assert views(*unsure, mass=0.1).warnings == ("no gauge.", "no floor.")


def test_views_are_compared_if_there_are_several():
    def compared(*outlines):
        found = evaluate(list(outlines), cylinder_diameter=CYLINDER, bead_diameter=BEAD)
        return any(check.check == "views_agree" for check in found.checks)

    assert compared(wavy(), wavy())
    assert not compared(wavy())


def test_an_outline_less_than_a_bead_above_the_floor_is_refused_with_both_heights():
    with pytest.raises(NothingToMeasure) as refusal:
        evaluate([wavy(0.0040, rough=0.001)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert str(refusal.value) == (
        "the outline lies 4.0 mm above the floor, and the mean surface 0.8 mm below it; check the zero of the heights, "
        "or state the floor of a photo with --floor y."
    )
    low = evaluate([wavy(0.0050, rough=0.001)], cylinder_diameter=CYLINDER, bead_diameter=BEAD)
    assert heights(low)[1].value == pytest.approx(0.0002, abs=2e-5)


def test_no_outline_and_sizes_that_are_not_positive_are_refused():
    with pytest.raises(BadInput) as refusal:
        evaluate([], cylinder_diameter=CYLINDER)
    assert str(refusal.value) == "measure packing: no profile given; give at least one outline of the bed."
    for wrong in ("total_mass", "bead_diameter", "bead_density"):
        with pytest.raises(BadInput, match="positive"):
            evaluate([wavy()], cylinder_diameter=CYLINDER, **{wrong: 0.0})
