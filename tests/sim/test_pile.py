"""Pile tests: the heap rests, is round, and the result states what was assumed."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.cli import run
from rigtwin.lab.clumps import row
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle, clumped
from rigtwin.lab.rigs import Pile
from rigtwin.measure.pile import evaluate as ruler
from rigtwin.sim.output.outline import silhouette
from rigtwin.sim.pile import pile
from rigtwin.sim.pile.piling import bowl
from rigtwin.sim.run.set_up import Bench

ASH = Material("ash", 720, 11e9, 0.44)
STEEL = Material("steel", 7850, 210e9, 0.3)
D6 = Particle("D6", ASH, 6e-3, density=569)
BOWL = Pile(0.04, rim_height=0.008, outlet_diameter=0.02)
BEADS, BASE = Contact(0.75, 0.44, 0.08), Contact(0.42, 0.36, 0.06)


@pytest.fixture(scope="module")
def heap() -> pile.Heap:
    return pile.run(BOWL, D6, STEEL, BEADS, BASE, count=150, seed=3, threads=1)


def test_the_heap_rests_and_all_beads_are_accounted_for(heap):
    assert heap.at_rest
    assert (heap.asked, heap.placed) == (150, 150)
    assert len(heap.centres) + heap.fallen == 150
    assert 60 < len(heap.centres) < 150
    assert heap.warnings == ()


def test_beads_lie_on_the_base_and_hardly_overlap(heap):
    gaps = np.linalg.norm(heap.centres[:, None] - heap.centres, axis=2) + np.eye(len(heap.centres))
    assert gaps.min() > 2 * D6.radius * (1 - 0.02)
    assert heap.centres[:, 2].min() > D6.radius * (1 - 0.02)
    assert np.hypot(heap.centres[:, 0], heap.centres[:, 1]).max() < BOWL.base_diameter / 2 + D6.radius


def test_the_heap_is_centred_and_higher_than_its_rim(heap):
    assert np.abs(heap.centres[:, :2].mean(axis=0)) == pytest.approx([0, 0], abs=D6.radius / 2)
    middle = np.hypot(heap.centres[:, 0], heap.centres[:, 1]) < 0.008
    # a third layer or more; their number depends on where single beads land
    assert heap.centres[middle, 2].max() > BOWL.rim_height + D6.radius


@pytest.mark.slow
def test_heaps_are_alike_on_both_sides_and_from_all_views_within_their_scatter():
    wide = replace(BOWL, base_diameter=0.07)
    angles: dict[str, list[list[float]]] = {"left": [], "right": [], "mean": []}  # [deg], heap by heap, view by view
    apart = []  # left minus right, in standard uncertainties
    for seed in (1, 2, 3):
        heap = pile.run(wide, D6, STEEL, BEADS, BASE, count=500, seed=seed, threads=1, stiffness_factor=3e-4)
        quantities = ruler.evaluate(heap.profiles, base_diameter=0.07, bead_diameter=D6.diameter).quantities
        lines = [
            one for one in quantities if (one.quantity, one.method) == (quantities[0].quantity, quantities[0].method)
        ]
        sides = {
            side: [one for one in lines if (one.detail["side"], one.detail["view"] == "all") == (side, False)]
            for side in angles
        }
        for side, views in sides.items():
            assert len(views) == 4
            angles[side].append([one.value for one in views])
        apart += [
            (left.value - right.value) / np.hypot(left.std_uncertainty, right.std_uncertainty)
            for left, right in zip(sides["left"], sides["right"], strict=True)
        ]
    # views of one heap share its beads: three heaps with two views' worth of sides each, three standard errors
    assert abs(np.mean(apart)) < 3 / np.sqrt(6)
    assert np.abs(apart).max() < 3
    # no view is steeper than the others by more than their scatter once heaps and views have their own means
    views = np.array(angles["mean"])
    off = views - views.mean(axis=1, keepdims=True)
    rest = off - off.mean(axis=0)
    scatter = np.sqrt((rest**2).sum() / (rest.size - sum(rest.shape) + 1))
    assert np.abs(off.mean(axis=0)).max() < 4 * scatter / np.sqrt(len(views))  # Student's t of six, 1 % for four views
    assert 15 < views.mean() < 45


def test_a_mirrored_rain_makes_the_mirror_image_of_a_heap():
    def fallen(mirror):
        bench = Bench(BOWL, D6, STEEL, BEADS, BASE, {"threads": 1})
        bulk = bench.bulk(bowl(BOWL), ((-0.03, -0.03, -0.012), (0.03, 0.03, 0.1)))
        rng = np.random.default_rng(5)
        place = np.stack(np.meshgrid(*[[-0.0065, 0.0, 0.0065]] * 2, [0.004, 0.0105, 0.017]), axis=-1).reshape(-1, 3)
        place += rng.uniform(-2e-4, 2e-4, place.shape)
        velocity, spin = rng.normal(0, 0.2, place.shape), rng.normal(0, 30, place.shape)
        # reflection acts on velocities as on positions, and with the opposite sign on spins
        bulk.add(place * mirror, velocity * mirror, -spin * mirror if mirror[0] < 0 else spin)
        bulk.run(round(0.02 / bulk.time_step))  # before rounding errors have grown
        fell = velocity * mirror - np.array([0.0, 0.0, 9.81 * bulk.time])
        return bulk.beads(), np.abs(bulk.beads().velocity - fell).max(axis=1) > 0.05

    mirror = np.array([-1.0, 1.0, 1.0])
    (one, hit), (other, hit_too) = fallen(np.ones(3)), fallen(mirror)
    assert hit.sum() > 20
    assert np.array_equal(hit, hit_too)
    assert other.position == pytest.approx(one.position * mirror, abs=1e-9)
    assert other.spin == pytest.approx(-one.spin * mirror, abs=1e-4)


def test_profiles_are_the_silhouettes_of_the_beads_from_four_sides(heap):
    assert len(heap.profiles) == 4
    assert len({profile.view for profile in heap.profiles}) == 4
    highest = heap.centres[:, 2].max() + heap.radius
    for profile in heap.profiles:
        assert profile.base == (-0.02, 0.02)
        assert np.diff(profile.x).max() <= D6.diameter / 24 * (1 + 1e-9)
        assert profile.height.max() == pytest.approx(highest, rel=1e-3)
        assert profile.height.min() >= 0
    for centre in heap.centres:  # the first view looks along y: every bead lies under the outline
        k = int(np.argmin(np.abs(heap.profiles[0].x - centre[0])))
        if abs(heap.profiles[0].x[k] - centre[0]) < 1e-4:
            assert heap.profiles[0].height[k] > centre[2] + heap.radius * (1 - 1e-2)


def test_the_same_seed_gives_the_same_heap_and_another_seed_another(heap):
    again = pile.run(BOWL, D6, STEEL, BEADS, BASE, count=150, seed=3, threads=1)
    assert np.array_equal(again.centres, heap.centres)
    other = pile.run(BOWL, D6, STEEL, BEADS, BASE, count=60, seed=4, threads=1)
    assert not np.array_equal(other.centres[:20], heap.centres[:20])


def test_what_the_rig_leaves_open_is_in_the_result(heap):
    assert {
        "outlet_diameter",
        "fall_height",
        "rim_height",
        "pour_rate",
        "stiffness_factor",
        "heights_and_angles",
    } <= set(heap.assumptions)
    assert "20 mm" in heap.assumptions["outlet_diameter"]
    assert heap.statistics["largest_overlap"] < 0.05


def test_without_a_rim_the_result_says_how_many_beads_stayed():
    flat = pile.run(replace(BOWL, rim_height=0.0), D6, STEEL, BEADS, BASE, count=40, settle_limit=1.0, threads=1)
    (said,) = [warning for warning in flat.warnings if f"{len(flat.centres)} of 40" in warning]
    assert said.endswith("give its height if it has one (--rim-height)")


def test_a_heap_without_time_to_settle_gives_a_warning():
    hasty = pile.run(BOWL, D6, STEEL, BEADS, BASE, count=40, settle_limit=0.02, threads=1)
    assert not hasty.at_rest
    assert any("still moving" in warning and "raise --settle-limit" in warning for warning in hasty.warnings)


@settings(max_examples=20, deadline=None)
@given(
    x=st.floats(-0.015, 0.015, allow_subnormal=False),
    y=st.floats(-0.015, 0.015, allow_subnormal=False),
    z=st.floats(0.003, 0.03),
    view=st.floats(0, 180),
)
def test_one_bead_casts_a_round_silhouette(x, y, z, view):
    profile = silhouette(np.array([[x, y, z]]), 0.003, 0.04, view)
    shadow = profile.height > 0
    assert profile.height.max() == pytest.approx(z + 0.003, rel=1e-2)
    assert profile.height[shadow].min() >= z
    assert np.ptp(profile.x[shadow]) == pytest.approx(0.006, abs=1e-3)
    turned = silhouette(np.array([[-x, -y, z]]), 0.003, 0.04, view)
    assert turned.height == pytest.approx(profile.height[::-1], abs=1e-9)


@pytest.mark.parametrize(
    ("rig", "count", "message"),
    [
        (Pile(-0.09), 10, "base_diameter"),
        (Pile(0.01), 10, "base_diameter"),
        (Pile(0.09, rim_height=-0.01), 10, "rim_height"),
        (Pile(0.09, rim_height=10.0), 10, "rim_height: 10000 mm is more than the base diameter of 90 mm"),
        (Pile(0.09, outlet_diameter=0.007), 10, "outlet_diameter"),
        (Pile(0.09), 0, "count"),
    ],
)
def test_an_impossible_pile_is_refused(rig, count, message):
    with pytest.raises(BadInput, match=message):
        pile.run(rig, D6, STEEL, BEADS, BASE, count=count)


def test_a_step_too_large_is_refused():
    with pytest.raises(BadInput, match="time_step_fraction"):
        pile.run(BOWL, D6, STEEL, BEADS, BASE, time_step_fraction=0.9)


def test_the_picture_shows_the_heap_on_its_base(heap):
    image = pile.picture(BOWL, heap, turn=0, tilt=0)
    rows, columns = np.nonzero((image < 255).any(axis=2))
    # from the side the picture is as high as the heap, and as wide as the base or what hangs over its rim
    across = heap.centres[:, 0]
    left, right = min(-0.02, across.min() - heap.radius), max(0.02, across.max() + heap.radius)
    assert np.ptp(rows) / np.ptp(columns) == pytest.approx(heap.profiles[0].height.max() / (right - left), rel=0.01)
    brown = image[..., 0].astype(int) - image[..., 2] > 30
    assert brown.sum() > 0.5 * np.ptp(rows) * np.ptp(columns) / 2


# ---------------------------------------------------------------------- pouring and emptying


ROUGH, SMOOTH = Contact(0.5, 0.6, 0.1), Contact(0.5, 0.1, 0.0)
TUBE = Pile(0.06, rim_height=0.004, variant="pouring", tube_diameter=0.03, lift_speed=0.1)
DRAIN = Pile(0.09, variant="emptying", drain_diameter=0.042)


def lifted(contact=ROUGH, rig=TUBE, count=150, **more) -> pile.Heap:
    return pile.run(rig, D6, STEEL, contact, contact, **({"count": count, "seed": 2, "threads": 1} | more))


def drained(contact=ROUGH, **more) -> pile.Heap:
    return pile.run(DRAIN, D6, STEEL, contact, contact, **({"count": 450, "seed": 2, "threads": 1} | more))


@pytest.fixture(scope="module")
def poured() -> pile.Heap:
    return lifted()


@pytest.fixture(scope="module")
def crater() -> pile.Heap:
    return drained()


def highest(heap: pile.Heap) -> float:
    """Mean height [m] of the heap's middle; a steeper heap is higher."""
    return float(np.mean([profile.height[np.abs(profile.x) < 0.01].mean() for profile in heap.profiles]))


def test_a_lifted_tube_leaves_a_centred_heap_and_all_beads_are_accounted_for(poured):
    assert poured.at_rest
    assert poured.placed == 150 == len(poured.centres) + poured.fallen
    packed = 150 * D6.volume / (math.pi * 0.015**2 * poured.bed_height)  # of the bed before the tube was lifted
    assert 0.4 < packed < 0.64
    assert np.abs(poured.centres[:, :2].mean(axis=0)) == pytest.approx([0, 0], abs=D6.radius)
    # the tube is removed: beads lie at the former position of its wall
    radius = np.hypot(*poured.centres[:, :2].T)
    assert (np.abs(radius - 0.015) < D6.radius).any()
    for profile in poured.profiles:
        middle, outside = np.abs(profile.x) < 0.01, np.abs(profile.x) > 0.02
        assert profile.height[middle].mean() > profile.height[outside].mean() + D6.radius


def test_smooth_beads_spread_farther_from_under_a_tube_than_rough_ones(poured):
    assert highest(lifted(SMOOTH)) < highest(poured) - D6.radius / 3


def test_the_bed_left_in_an_emptied_container_slopes_down_to_the_drain(crater):
    assert crater.at_rest
    assert crater.warnings == ()
    assert crater.placed == 450 == len(crater.centres) + crater.fallen
    assert 0.1 * 450 < crater.fallen < 450
    radius = np.hypot(*crater.centres[:, :2].T)
    at_wall, at_drain = crater.centres[radius > 0.036, 2], crater.centres[radius < 0.026, 2]
    assert at_wall.max() > at_drain.max() + D6.radius
    assert crater.base_diameter == pytest.approx(0.09 - 0.042)


def test_sections_of_a_crater_are_heaps_with_the_wall_in_the_middle(crater):
    mean = np.mean([profile.height for profile in crater.profiles], axis=0)
    away = np.abs(crater.profiles[0].x)  # from the wall
    assert mean[away < 0.008].mean() > mean[away > 0.016].mean() + D6.radius / 2
    # a section turned by half a turn shows the same two slopes, left and right exchanged
    from rigtwin.sim.pile.emptying import section

    one, other = (section(crater.centres, crater.radii, DRAIN, 0.042, 6e-3, view) for view in (0.0, 180.0))
    assert other.height == pytest.approx(one.height[::-1], abs=1e-9)


@pytest.mark.slow
def test_rough_beads_stay_in_an_emptied_container_where_smooth_ones_run_out(crater):
    assert drained(SMOOTH).fallen > 1.2 * crater.fallen


def test_a_bridged_drain_gives_a_warning():
    narrow = replace(DRAIN, drain_diameter=0.014)
    heap = pile.run(narrow, D6, STEEL, ROUGH, ROUGH, count=300, seed=2, threads=1)
    assert any("bridged" in warning for warning in heap.warnings)


@pytest.mark.parametrize("rig", [TUBE, DRAIN])
def test_a_run_that_was_stopped_ends_with_the_same_bits(broken_off, rig, tmp_path):
    count = 60 if rig is TUBE else 200
    settings_ = {"count": count, "seed": 3, "threads": 1, "settle_limit": 0.3}
    whole = pile.run(rig, D6, STEEL, ROUGH, ROUGH, **settings_)
    kept = {"checkpoint": tmp_path / "heap.npz", "checkpoint_interval": 0}
    broken_off(partial(pile.run, rig, D6, STEEL, ROUGH, ROUGH), 25, **settings_, **kept)
    again = pile.run(rig, D6, STEEL, ROUGH, ROUGH, **settings_, **kept)
    assert np.array_equal(again.centres, whole.centres)
    assert again.time == whole.time


@pytest.mark.parametrize(
    ("rig", "message"),
    [
        (replace(TUBE, tube_diameter=0.01), "tube_diameter"),
        (replace(TUBE, tube_diameter=0.07), "tube_diameter"),
        (replace(TUBE, lift_speed=-1.0), "lift_speed"),
        (replace(DRAIN, drain_diameter=0.01), "drain_diameter"),
        (replace(DRAIN, drain_diameter=0.085), "drain_diameter"),
        (replace(DRAIN, rim_height=0.01), "rim_height"),
    ],
)
def test_impossible_tubes_and_drains_are_refused(rig, message):
    with pytest.raises(BadInput, match=message):
        pile.run(rig, D6, STEEL, BEADS, BASE, count=50)


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        ([0.0, 0.01, 0.08, 0.01, 0.002], "impacts pressed beads up to 9.0%"),
        ([0.0, 0.01, 0.01, 0.01, 0.06], "beads lie up to 6.0%"),
        ([0.0, 0.07, 0.07, 0.06, 0.0], "beads lie up to 6.0%"),  # a hopper that has emptied
    ],
)
def test_overlaps_in_impacts_are_distinguished_from_lasting_ones(seen, words):
    logbook = SimpleNamespace(warnings=(), history=SimpleNamespace(largest_overlap=np.array(seen)))
    (said,) = Bench(BOWL, D6, STEEL, BEADS, BASE, {}).warnings(SimpleNamespace(largest_overlap=0.09, note=""), logbook)
    assert words in said
    assert "--stiffness-factor" in said


def test_effects_of_a_model_act_on_the_heap_or_are_named_as_left_out():
    named = {"effects": {"adhesion_jkr": {}, "camera_roll": {}, "air_drag": {}}}
    run = SimpleNamespace(largest_overlap=0.0, note=""), SimpleNamespace(warnings=())
    beads = Bench(BOWL, D6, STEEL, BEADS, BASE, named)
    assert "adhesion jkr, air drag" in beads.assumptions()["effects"]
    (said,) = beads.warnings(*run)
    assert "camera_roll had no part" in said
    # the engine simulates forces in flight on spheres only
    clump = clumped("pellet", ASH, row(3, 2e-3, 2e-3), mass=60e-6)
    pellets = Bench(BOWL, clump, STEEL, BEADS, BASE, named)
    assert pellets.assumptions()["effects"] == "adhesion jkr"
    (said,) = pellets.warnings(*run)
    assert "camera_roll, air_drag had no part" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--method", "pouring", "--tube-diameter", "100mm"], "--tube-diameter"),
        (["--method", "emptying", "--rim-height", "5mm"], "--rim-height"),
        (["--method", "pouring", "--lift-speed", "20mm"], "--lift-speed"),
    ],
)
def test_an_impossible_setting_gives_one_sentence_on_the_command_line(options, words, capsys, tmp_path):
    command = ["simulate", "pile", "--base-diameter", "90mm", "--out", str(tmp_path), *options]
    assert run(command) == 2
    assert words in capsys.readouterr().err
