"""Discharge tests: no bead is lost, and the flow follows the laws of hoppers."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.lab.clumps import row
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle, clumped
from rigtwin.lab.rigs import Hopper
from rigtwin.sim import hopper
from rigtwin.sim.run.steady_flow import steady_flow

G = 9.81
ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
D6 = Particle("D6", ASH, 6e-3, density=569)
BEADS, WALLS = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)
CONE = Hopper(0.03, diameter=0.06, cone_height=0.03)
SLOT = Hopper(0.02, "slot", width=0.06, slot_length=0.03, slide_drop=0.03)


def emptied(rig=CONE, **more) -> hopper.Discharge:
    more = {"count": 250, "seed": 2, "threads": 1, "stiffness_factor": 3e-4, "fill_limit": 0.6} | more
    return hopper.run(rig, D6, STEEL, BEADS, WALLS, **more)


@pytest.fixture(scope="module")
def cone() -> hopper.Discharge:
    return emptied()


@pytest.fixture(scope="module")
def slot() -> hopper.Discharge:
    return emptied(SLOT, count=150, settle_limit=0.6)


def test_every_bead_is_inside_or_out_and_the_mass_only_falls(cone):
    assert (cone.asked, cone.emptied, cone.remaining) == (250, 250, 0)
    assert len(cone.outlet_times) == 250
    assert np.all(np.diff(cone.outlet_times) >= 0)
    assert cone.outlet_times[0] > 0
    mass = cone.mass_left
    assert (mass.value[0], mass.value[-1]) == (pytest.approx(250 * D6.mass), 0.0)
    assert np.all(np.diff(mass.value) <= 0)
    # the series and the times of single beads agree
    for when, left in zip(mass.time, mass.value, strict=True):
        assert left == pytest.approx(D6.mass * (cone.outlet_times > when).sum(), abs=1e-12)
    assert cone.discharge_time == cone.outlet_times[-1]


def test_no_bead_leaves_faster_than_it_could_fall(cone):
    # bound: a free fall from the highest possible level of the bed
    assert cone.discharge_time > math.sqrt(2 * 0.02 / G)
    assert cone.outlet_times[0] < 0.1


def test_the_steady_flow_follows_beverloo_and_grows_with_the_outlet(cone):
    # W = C rho_b sqrt(g) (D - k d)^2.5 with C 0.55 to 0.65 and k 1.3 to 1.6, in a cone of 27 degrees up to 1.3 times
    # that (Rose and Tanaka); a short column of few beads scatters by another fifth
    def law(outlet, c, k):
        return c * 0.6 * D6.effective_density * math.sqrt(G) * (outlet - k * D6.diameter) ** 2.5

    wider = emptied(replace(CONE, outlet=0.04), count=400)
    for made, outlet in ((cone, 0.03), (wider, 0.04)):
        assert made.mass_flow_rate is not None
        assert 0.8 * law(outlet, 0.55, 1.6) < made.mass_flow_rate < 1.2 * 1.3 * law(outlet, 0.65, 1.3)
    ratio = wider.mass_flow_rate / cone.mass_flow_rate
    assert law(0.04, 1, 1.0) / law(0.03, 1, 1.0) < 1.2 * ratio
    assert ratio < 1.2 * law(0.04, 1, 1.6) / law(0.03, 1, 1.6)


@pytest.mark.slow
def test_the_flow_of_a_slot_follows_beverloos_law_of_slots():
    # W = C rho_b sqrt(g) (L - k d) (b - k d)^1.5, C 1.03 where a round outlet has 0.58 (Myers and Sellers), so 1.78 of
    # its 0.55 to 0.65, k 1.3 to 1.6; steep walls let through more (Rose and Tanaka): the window is wide, exponents tell
    def law(width, length, c, k):
        free = (length - k * D6.diameter) * (width - k * D6.diameter) ** 1.5
        return c * 0.6 * D6.effective_density * math.sqrt(G) * free

    def flow(width, length, count):
        rig = Hopper(width, "slot", width=0.1, slot_length=length)
        made = [emptied(rig, count=count, seed=seed, settle_limit=0.02) for seed in (1, 2)]
        assert all(one.emptied == count for one in made)
        return np.mean([one.mass_flow_rate for one in made])

    flows = {(b, L): flow(b, L, count) for b, L, count in ((0.03, 0.05, 500), (0.04, 0.05, 500), (0.03, 0.1, 1000))}
    for (width, length), found in flows.items():
        assert law(width, length, 1.78 * 0.55, 1.6) < found < 1.3 * law(width, length, 1.78 * 0.65, 1.3)
    # runs scatter by 5 percent, ratios of two means of two by as much; k of beads in a wedge may be as small as 1
    wider = flows[0.04, 0.05] / flows[0.03, 0.05]
    assert law(0.04, 1, 1, 1.0) / law(0.03, 1, 1, 1.0) / 1.1 < wider < 1.1 * law(0.04, 1, 1, 1.6) / law(0.03, 1, 1, 1.6)
    # end plates reduce the flow of a slot no more than edges would
    longer = flows[0.03, 0.1] / flows[0.03, 0.05]
    assert 2.0 / 1.1 < longer < 1.1 * law(0.03, 0.1, 1, 1.6) / law(0.03, 0.05, 1, 1.6)


def test_an_outlet_of_two_beads_is_blocked_and_the_result_says_so():
    blocked = emptied(replace(CONE, outlet=0.0085), count=120)
    assert blocked.discharge_time is None
    assert blocked.remaining > 20
    assert blocked.emptied + blocked.remaining == 120
    assert blocked.arched
    assert any("only" in warning and "of 120" in warning for warning in blocked.warnings)
    assert any("arch over the outlet, which is 8.5 mm or 1.4 of their" in warning for warning in blocked.warnings)


def test_beads_lying_around_an_outlet_do_not_count_as_an_arch():
    flat = emptied(replace(CONE, cone_height=1e-3, outlet=0.035), count=120)
    assert flat.remaining > 10
    assert not flat.arched
    assert not emptied(count=60, duration=0.1).arched  # the last beads are still falling


def test_all_beads_of_the_slot_hopper_lie_below_it(slot):
    assert slot.emptied == 150
    assert len(slot.centres) == 150
    assert slot.centres[:, 2].max() < 0
    assert slot.pile is not None
    seen = np.isfinite(slot.pile.height)
    assert np.nanmin(slot.pile.height) > 0
    # the heap stands between slide and end wall, one bead high at least
    assert np.ptp(slot.pile.x[seen]) > 4 * D6.diameter
    assert np.nanmax(slot.pile.height) > D6.diameter * 0.98
    assert np.abs(slot.centres[:, 1]).max() < 0.015


def test_clumps_leave_a_hopper_as_whole_particles():
    peanut = clumped("peanut", ASH, row(2, 2.5e-3, 3e-3), density=600)
    more = {"count": 60, "seed": 2, "threads": 1, "stiffness_factor": 3e-4, "fill_limit": 0.3}
    made = hopper.run(CONE, peanut, STEEL, BEADS, WALLS, **more)
    assert made.emptied + made.remaining == 60
    assert made.emptied == len(made.outlet_times) > 50
    assert made.mass_left.value[0] == pytest.approx(60 * peanut.mass)


def test_energy_closes_and_beads_hardly_overlap(cone, slot):
    for made in (cone, slot):
        assert made.statistics["largest_overlap"] < 0.07  # a third of the usual stiffness
        assert not any("budget" in warning for warning in made.warnings)


def test_what_the_rig_leaves_open_is_in_the_result(slot):
    assert "60 mm (as given)" in slot.assumptions["width"]
    assert "assumed" in slot.assumptions["slide_angle"]
    unsaid = hopper.plan_of(Hopper(0.02, "slot"), D6, 100).assumptions
    assert "68 mm (not stated: assumed)" in unsaid["slot_length"]


def test_a_broken_run_ends_with_the_bits_of_one_that_never_stopped(broken_off, cone, tmp_path):
    more = {"checkpoint": tmp_path / "hopper.npz", "checkpoint_interval": 0}
    for look in (9, 24, 30):
        broken_off(emptied, look, **more)
    again = emptied(**more)
    assert np.array_equal(again.outlet_times, cone.outlet_times)
    assert np.array_equal(again.mass_left.value, cone.mass_left.value)


def test_the_flow_rate_of_evenly_spaced_times_is_exact():
    assert steady_flow(np.arange(200) / 50, np.arange(200), 200) == pytest.approx(50.0)
    assert steady_flow(np.arange(5) / 50, np.arange(5), 200) is None


@pytest.mark.parametrize(
    ("rig", "more", "message"),
    [
        (Hopper(0.005), {}, "lets no bead"),
        (Hopper(-0.05), {}, "outlet"),
        (CONE, {"count": 0}, "at least 1"),
        (CONE, {"stiffness_factor": 2.0}, "stiffness_factor"),
        (CONE, {"duration": -1.0}, "duration"),
        (Hopper(0.2), {}, "outlet"),
        (Hopper(0.02, "slot", inclination=0.0), {}, "inclination"),
        (replace(CONE, cone_height=1e6), {}, "the space to fill has room for .*e\\+.* particles 8.1 mm apart"),
    ],
)
def test_an_impossible_hopper_is_refused(rig, more, message):
    with pytest.raises(BadInput, match=message):
        emptied(rig, **more)
