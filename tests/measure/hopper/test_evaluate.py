"""Evaluation of a discharge from records whose times, rates and uncertainties are known in closed form."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from rigtwin.lab.errors import BadInput, NothingToMeasure
from rigtwin.lab.quantity import Check, Evaluation, Quantity
from rigtwin.lab.records import Series
from rigtwin.measure.hopper.evaluate import CUT, Instant, evaluate, evaluate_discharge

Array = npt.NDArray[np.float64]

STEP = 0.001  # [s]
WITHIN_STEP = 0.95 / (2 * 1.96) * STEP  # [s], +-1.96 of it cover 95 % of a step
UNIFORM = 1 / math.sqrt(12)  # standard deviation over the width of a uniform distribution


def find(found: Evaluation, quantity: str) -> Quantity:
    (one,) = (each for each in found.quantities if each.quantity == quantity)
    return one


def check(found: Evaluation, name: str) -> Check:
    (one,) = (each for each in found.checks if each.check == name)
    return one


def weighed(time: Array, value: Array, unit: str = "kg") -> Series:
    return Series(time, value, "mass_left", unit)


def counted(*, stay: int = 0, until: float = 1.2, step: float = STEP) -> Series:
    """400 particles that leave one by one at 500 /s from 0.2 to 1 s, and others that stay."""
    time = np.arange(0, until, step)
    gone = np.clip(np.floor((time - 0.2) * 500 + 1e-9), 0, 400)
    return Series(time, 400 + stay - gone, "particles_left", "particles")


def slowing(residue: float = 0.0, scale: float = 1.0) -> Series:
    """What is left falls as (1 - t / 2 s)^2 from 0.5 s on, so the flow slows down evenly until it ends at 2.5 s."""
    time = np.arange(0, 3, STEP)
    left = residue + (1 - residue) * np.clip(1 - (time - 0.5) / 2, 0, 1) ** 2
    return weighed(time, scale * left)


def test_a_counted_instant_is_uncertain_within_the_step_in_which_it_lies() -> None:
    found = evaluate(counted())
    opening, last, lasted = (find(found, name) for name in ("opening_time", "last_particle_time", "discharge_time"))
    assert opening.value == pytest.approx(0.202)
    assert opening.budget == pytest.approx({"time step": WITHIN_STEP})
    assert last.value == pytest.approx(1.0 - STEP / 2)
    assert last.budget == pytest.approx({"time step": WITHIN_STEP})
    assert lasted.value == pytest.approx(last.value - opening.value)
    assert lasted.budget == pytest.approx({"opening: time step": WITHIN_STEP, "last particle: time step": WITHIN_STEP})
    assert lasted.std_uncertainty == pytest.approx(math.sqrt(2) * WITHIN_STEP)
    assert lasted.method == "first loss to last loss"
    assert (opening.unit, last.unit, lasted.unit) == ("s", "s", "s")
    assert {one.n for one in found.quantities} == {1}
    given = find(evaluate(counted(), opened=0.2), "discharge_time")
    assert given.budget == pytest.approx({"last particle: time step": WITHIN_STEP})
    assert given.method == "given to last loss"


def flickering(end: float = 0.0) -> tuple[Series, float]:
    """What is left falls by a quarter per second from 1 s on, with a flicker, and the noise that it is taken for."""
    time = np.arange(0, 6, STEP)
    flicker = 1e-4 * (-1.0) ** np.arange(len(time))
    # second differences of the flicker are +-4 of it, taken for normal noise
    return weighed(time, np.clip(1 - 0.25 * (time - 1), end, 1) + flicker), 1.4826 * 4e-4 / math.sqrt(6)


def test_where_weights_flicker_the_opening_lies_before_one_percent_has_left() -> None:
    record, noise = flickering()
    found = evaluate(record)
    opening, last = find(found, "opening_time"), find(found, "last_particle_time")
    # three times the noise surely is a loss
    earliest, latest = 1 + 3 * noise / 0.25, 1 + 0.01 / 0.25
    assert opening.value == pytest.approx((earliest + latest) / 2, abs=0.001)
    assert opening.budget["time step"] == pytest.approx(WITHIN_STEP)
    assert opening.budget["first loss"] == pytest.approx(UNIFORM * (latest - earliest), abs=0.0006)
    assert last.value == pytest.approx(5 - 3 * noise / 0.25, abs=0.001)
    assert not any(one.doubtful for one in found.quantities)


def test_weights_that_flicker_after_the_flow_still_flow_no_more() -> None:
    record, _ = flickering(end=0.2)
    found = evaluate(record, opened=1.0)
    assert not any(one.doubtful for one in found.quantities)
    assert find(found, "residue_fraction").value == pytest.approx(0.2, abs=3e-4)
    with pytest.raises(NothingToMeasure, match="do not change any more"):
        evaluate(flickering(end=0.75)[0], opened=1.0)


def test_the_rate_of_a_slowing_flow_is_that_at_the_middle_with_the_scatter_of_its_parts() -> None:
    start, end = (1 - math.sqrt(left) for left in (0.8, 0.2))  # over the 2 s of the discharge
    middle = (start + end) / 2
    rate = 2 * (1 - middle) / 2  # [1/s]; a straight line fitted to a parabola has the slope at its middle
    apart = 2 * (end - start) / 6 / 2  # [1/s], between the rates of neighbouring sixths
    for residue, scale, mass, rate_of_mass in ((0.0, 1.0, None, 1.0), (0.2, 3.0, None, 3.0), (0.2, 3.0, 1.5, 1.5)):
        found = evaluate(slowing(residue, scale), opened=0.5, total_mass=mass)
        flow = find(found, "mass_flow_rate")
        share = (1 - residue) * rate_of_mass
        assert flow.value == pytest.approx(share * rate, rel=2e-3)
        # the numbers 1 to 6 have the standard deviation sqrt 3.5
        assert flow.budget == pytest.approx({"scatter of the flow": share * apart * math.sqrt(3.5 / 6)}, rel=2e-3)
        assert flow.std_uncertainty == pytest.approx(sum(flow.budget.values()))
        assert flow.unit == "kg/s"
        assert flow.method == "line, 20 % to 80 %"
        assert flow.detail == pytest.approx(
            {"from_s": 0.5 + 2 * start, "to_s": 0.5 + 2 * end, "drift": -3 * apart / rate}, rel=2e-3
        )
        middle_90 = find(found, "discharge_time_5_95")
        assert middle_90.value == pytest.approx(2 * (math.sqrt(0.95) - math.sqrt(0.05)), abs=1e-4)
        assert middle_90.std_uncertainty == pytest.approx(STEP / 4)
        assert not found.warnings


def test_an_uncertain_area_of_the_bed_adds_to_rate_residue_and_middle_of_the_flow() -> None:
    time = np.arange(0, 4, STEP)
    for residue in (0.1, 0.01):
        left = weighed(time, residue + (1 - residue) * np.clip(1 - (time - 0.5) / 2, 0, 1))
        found = evaluate_discharge(left, 3.0, Instant(0.5, {}, "given"), None, None, 0.05)
        rate = 3.0 * (1 - residue) / 2
        assert find(found, "mass_flow_rate").budget["area for mass"] == pytest.approx(0.05 * rate)
        assert find(found, "residue_fraction").std_uncertainty == pytest.approx(max(0.05 * residue, 0.003))
        # near both ends a quarter of it, over the 2 s in which all leaves
        by_area = math.sqrt(2) * 0.25 * 0.05 * 2
        assert find(found, "discharge_time_5_95").std_uncertainty == pytest.approx(math.hypot(by_area, STEP / 4))
    exact = evaluate(left, opened=0.5)
    assert find(exact, "residue_fraction").std_uncertainty == 0
    assert "area for mass" not in find(exact, "mass_flow_rate").budget


def test_a_shift_of_the_exposure_moves_both_ends_and_not_the_discharge_time() -> None:
    opened = Instant(0.2, {"exposure": 0.004, "slide": 0.003}, "slide")
    last = Instant(1.0, {"exposure": 0.004, "frame": 0.004}, "bead")
    found = evaluate_discharge(counted(), None, opened, last, None, 0.0)
    assert find(found, "opening_time").std_uncertainty == pytest.approx(0.005)
    assert find(found, "last_particle_time").std_uncertainty == pytest.approx(0.004 * math.sqrt(2))
    lasted = find(found, "discharge_time")
    assert lasted.value == pytest.approx(0.8)
    assert lasted.budget == pytest.approx({"opening: slide": 0.003, "last particle: frame": 0.004})
    assert lasted.std_uncertainty == pytest.approx(0.005)
    assert lasted.method == "slide to bead"


def test_a_doubtful_end_makes_times_doubtful_and_no_share() -> None:
    opened, last = Instant(0.2, {}, "slide", "a hand hides the slot"), Instant(1.0, {}, "bead", "the bead vanishes")
    found = evaluate_discharge(counted(), None, opened, last, None, 0.0)
    for one in found.quantities:
        assert one.doubtful == ("a hand hides the slot; the bead vanishes" if one.unit == "s" else "")


def test_where_the_record_ends_before_the_last_particle_its_residue_is_any_share() -> None:
    cut = evaluate_discharge(counted(), None, Instant(0.2, {}, "given"), Instant(1.2, {}, CUT), 0.3, 0.0)
    residue = find(cut, "residue_fraction")
    assert residue.value == 0.3
    assert residue.std_uncertainty == pytest.approx(UNIFORM)
    assert residue.doubtful == find(cut, "last_particle_time").doubtful
    assert residue.doubtful.startswith("beads still leave at the end of the record")
    assert not check(cut, "emptied").passed
    named = Instant(1.2, {}, CUT, "the film ends")
    found = evaluate_discharge(counted(), None, Instant(0.2, {}, "given"), named, 0.3, 0.0)
    assert find(found, "last_particle_time").doubtful == "the film ends"


@pytest.mark.parametrize(
    ("after", "step", "cut"),
    # a 50th of 0.8 s, or three steps
    [
        (0.012, STEP, True),
        (0.022, STEP, False),
        (0.0145, 0.0015, True),
        (0.016, 0.0015, False),
        (0.011, 0.01, True),
        (0.051, 0.01, False),
    ],
)
def test_a_flow_has_stopped_after_a_fiftieth_of_its_time_without_a_loss(after: float, step: float, cut: bool) -> None:
    time = np.arange(0, 1.0 + after, step)
    found = evaluate(weighed(time, np.clip(1 - (time - 0.2), 0.2, 1)), opened=0.2)
    assert ("beads still leave" in find(found, "residue_fraction").doubtful) == cut


def test_a_fiftieth_of_the_filling_that_stays_fails_the_check_and_says_so() -> None:
    for stay, ending in ((7, "."), (9, "; the last particle is the last one that left.")):
        found = check(evaluate(counted(stay=stay), opened=0.2), "emptied")
        assert found.passed == (stay == 7)
        assert (found.value, found.expected) == (pytest.approx(stay / (400 + stay)), 0.0)
        assert found.message == f"{100 * stay / (400 + stay):.1f} % of the filling stays in the hopper{ending}"
    cut = check(evaluate(counted(stay=4, until=1.001), opened=0.2), "emptied")
    assert not cut.passed
    assert cut.message.startswith("the share that stays in the hopper is not known: beads still leave")
    assert cut.message.endswith("give a longer record.")


@pytest.mark.parametrize(
    ("rise", "lasts", "passed"), [(39, 50, True), (41, 50, False), (200, 2, True), (200, 3, False)]
)
def test_a_rise_counts_from_a_tenth_of_the_filling_and_three_values_on(rise: int, lasts: int, passed: bool) -> None:
    record = counted(until=2.0)
    value = record.value.copy()
    value[1400 : 1400 + lasts] += rise
    found = evaluate(Series(record.time, value, "particles_left", "particles"), opened=0.2)
    falling = check(found, "only_falls")
    assert falling.passed == passed
    assert (falling.value, falling.expected) == (pytest.approx(rise / 400 if lasts > 2 else 0.0), 0.0)
    if passed:
        assert falling.message == "what is left in the hopper only falls."
    else:
        assert f"rises by {100 * rise / 400:.0f} % of the filling until 1.4" in falling.message
    assert bool(find(found, "discharge_time_5_95").doubtful) != passed
    assert not find(found, "residue_fraction").doubtful


def test_nine_tenths_of_an_even_flow_leave_in_nine_tenths_of_its_time() -> None:
    within = check(evaluate(counted(), opened=0.2), "flow_within")
    assert within.passed
    assert (within.value, within.expected) == (pytest.approx(0.9, abs=0.002), 0.9)
    assert within.message == "the middle 90 % leaves in 0.720 s of the 0.800 s from the opening to the last particle."
    late = evaluate(counted(), opened=0.3)  # the middle 90 % begin before it but last a little longer than the rest
    assert not check(late, "flow_within").passed
    assert find(late, "discharge_time").doubtful == check(late, "flow_within").message
    assert check(late, "flow_within").value == pytest.approx(0.72 / 0.7, abs=0.004)


@pytest.mark.parametrize(("area", "passed"), [(0.05, True), (0.02, False)])
def test_the_middle_of_the_flow_may_be_longer_by_two_uncertainties(area: float, passed: bool) -> None:
    found = evaluate_discharge(counted(), None, Instant(0.3, {}, "given"), None, None, area)
    middle, lasted = find(found, "discharge_time_5_95"), find(found, "discharge_time")
    assert (middle.value < lasted.value + 2 * math.sqrt(2) * 0.25 * area * 0.8) == passed
    assert check(found, "flow_within").passed == passed


def test_a_loss_at_the_last_value_counts() -> None:
    time = np.arange(16.0)
    found = evaluate(weighed(time, np.clip(1 - (time - 5) / 10, 0, 1)), opened=5.0)
    assert find(found, "discharge_time_5_95").value == pytest.approx(9.0)
    assert find(found, "residue_fraction").value == pytest.approx(0.0)


def test_an_opening_after_the_last_particle_is_refused_with_both_times() -> None:
    why = (
        "particles left: the last particle leaves at 0.9995 s, before the opening at 1.1 s; check the time of opening, "
        "or move --start and --end to one discharge."
    )
    with pytest.raises(NothingToMeasure) as refusal:
        evaluate(counted(), opened=1.1)
    assert str(refusal.value) == why


def test_the_filling_is_the_median_of_the_first_values() -> None:
    record = slowing(scale=2.0)
    outliers = record.value.copy()
    outliers[:20] *= 1.5  # of a fiftieth of 3000 values
    for value in (record.value, outliers):
        found = evaluate(weighed(record.time, value), opened=0.5)
        assert find(found, "residue_fraction").value == 0
        assert find(found, "mass_flow_rate").value == pytest.approx(2 * 0.6708, rel=0.01)


@pytest.mark.parametrize(
    ("full", "quantity", "unit"),
    [
        (1.0, "discharged_fraction_rate", "1/s"),
        (1.4, "discharged_fraction_rate", "1/s"),
        (2, "particle_flow_rate", "1/s"),
    ],
)
def test_a_rate_without_a_mass_is_one_of_shares_or_particles(full: float, quantity: str, unit: str) -> None:
    found = evaluate(weighed(slowing().time, full * slowing().value, ""), opened=0.5)
    assert find(found, quantity).value == pytest.approx(full * 0.6708, rel=0.01)
    assert find(found, quantity).unit == unit
    (warning,) = found.warnings
    assert warning == f"mass flow rate: not given, only a {quantity.replace('_', ' ')}; give --total-mass."


@pytest.mark.parametrize(("steps", "given"), [(4.5, False), (6.5, True)])
def test_a_rate_needs_four_values_in_the_steady_flow(steps: float, given: bool) -> None:
    time = np.arange(20.0)
    found = evaluate(weighed(time, np.clip(1 - (time - 5) / steps, 0, 1)), opened=5.0)
    assert any(one.quantity == "mass_flow_rate" for one in found.quantities) == given
    few = "flow rate: not given, because too few values lie in the steady flow; give more values per second."
    assert found.warnings == (() if given else (few,))
    if given:
        assert find(found, "mass_flow_rate").value == pytest.approx(1 / steps)


def test_values_that_are_missing_lie_between_their_neighbours() -> None:
    record = slowing()
    value = record.value.copy()
    value[700:1500:3] = np.nan
    whole, holed = (evaluate(weighed(record.time, one), opened=0.5) for one in (record.value, value))
    for one, other in zip(whole.quantities, holed.quantities, strict=True):
        assert one.value == pytest.approx(other.value, rel=1e-4)


def test_five_values_are_enough_and_four_are_refused() -> None:
    five = np.array([1.0, 1.0, 1.0, 0.5, 0.0])
    assert evaluate(weighed(np.arange(5.0), five), opened=2.0).quantities
    with pytest.raises(BadInput, match=r"^mass left: needs at least five times, each with one value; got 4, 4\.$"):
        evaluate(weighed(np.arange(4.0), five[:4]))
    with pytest.raises(BadInput, match=r"got 6, 5\.$"):
        evaluate(weighed(np.arange(6.0), five))
    six = np.append(five, 0.0)
    assert evaluate(weighed(np.arange(6.0), np.where(np.arange(6) == 1, np.nan, six)), opened=2.0).quantities
    with pytest.raises(BadInput, match=r"^mass left: contains fewer than five finite values\.$"):
        evaluate(weighed(np.arange(5.0), np.where(np.arange(5) == 1, np.nan, five)))
    with pytest.raises(BadInput, match=r"^mass left: time does not increase from value to value; sort the series\.$"):
        evaluate(weighed(np.array([0.0, 1.0, 1.0, 2.0, 3.0]), five))
    with pytest.raises(BadInput, match=r"^mass left: time does not increase"):
        evaluate(weighed(np.array([0.0, 1.0, 2.0, 3.0, np.nan]), five))
    with pytest.raises(BadInput, match=r"^mass left: begins at 0; give what is left from before the opening\.$"):
        evaluate(weighed(np.arange(5.0), 0 * five))


@pytest.mark.parametrize("stopped", [True, False])
def test_a_hopper_is_emptied_where_less_than_seven_tenths_stay(stopped: bool) -> None:
    time = np.arange(200.0)

    def falls_to(end: float) -> Series:
        last = 100.0 if stopped else 199.0
        return weighed(time, 3 * np.clip(1 - (1 - end) * (time - 10) / (last - 10), end, 1))

    assert find(evaluate(falls_to(0.69)), "residue_fraction").value == pytest.approx(0.69)
    with pytest.raises(NothingToMeasure) as refusal:
        evaluate(falls_to(0.71))
    advice = (
        "do not change any more; if beads arch over the outlet use a wider one, and give a record of its opening"
        if stopped
        else "still change; give a record that lasts until the flow has stopped"
    )
    assert str(refusal.value) == (
        "mass left: 71 % is still left at the end, at most 70 % may be, and the last 20 values, from 180 s on, "
        f"{advice}."
    )


def test_the_first_loss_is_named_where_the_opening_is_not_known() -> None:
    (warning, *_) = evaluate(counted(), total_mass=1.0).warnings
    assert warning == "opening: not known, so the first loss was taken as the opening; give the time of opening."
