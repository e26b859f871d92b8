"""Drum: no bead is lost, the slope of the surface is in its physical range, and beads mix."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from rigtwin.lab.drum_flow import fill_check
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Drum
from rigtwin.sim import drum
from rigtwin.sim.output.mixing import lacey, mixing

ASH = Material("ash", 720, 11e9, 0.44)
PMMA = Material("PMMA", 1180, 3.2e9, 0.35)
D6 = Particle("D6", ASH, 6e-3, density=569)
ROUGH, SMOOTH = Contact(0.6, 0.6, 0.1), Contact(0.6, 0.05, 0.0)
RIG = Drum(0.07, 15 * math.pi / 30, depth=0.02, fill=0.4)


def turned(rig=RIG, contact=ROUGH, wall=ROUGH, **more) -> drum.Rotation:
    more = {"turns": 0.5, "seed": 3, "threads": 1, "stiffness_factor": 3e-4, "fill_limit": 0.4} | more
    return drum.run(rig, D6, PMMA, contact, wall, **more)


@pytest.fixture(scope="module")
def rough() -> drum.Rotation:
    return turned()


@pytest.fixture(scope="module")
def smooth() -> drum.Rotation:
    return turned(wall=SMOOTH)


def slope(made: drum.Rotation) -> float:
    """Angle [deg] of a straight line through the middle half of the steady outline, rising to the left."""
    profile = made.steady
    middle = (np.abs(profile.x) < 0.5 * RIG.diameter / 2) & np.isfinite(profile.height)
    return math.degrees(math.atan(-np.polyfit(profile.x[middle], profile.height[middle], 1)[0]))


def test_no_bead_is_lost_or_pressed_through_a_wall(rough):
    expected = 0.4 * 0.6 * math.pi / 4 * 0.07**2 * 0.02 / (math.pi / 6 * D6.diameter**3)
    assert rough.count == round(expected)
    assert len(rough.centres) == rough.count
    assert np.hypot(rough.centres[:, 0], rough.centres[:, 2]).max() < 0.035 - D6.radius * 0.98
    assert np.abs(rough.centres[:, 1]).max() < 0.01 - D6.radius * 0.98
    assert rough.statistics["largest_overlap"] < 0.07  # a third of the usual stiffness


def test_the_bed_climbs_with_the_wall_to_a_slope_of_its_friction(rough):
    # above the slope of rolling resistance alone, below that of friction: mu in the bed, and mu times depth over
    # width at the end walls, here 0.03 m over 0.02 m
    assert 0.1 < math.tan(math.radians(slope(rough))) < 0.6 * (1 + 0.03 / 0.02)


def test_end_walls_have_the_friction_that_is_stated_for_them(rough):
    made = turned(replace(RIG, end_wall_friction=0.0))
    assert "static friction 0" in made.assumptions["end_walls"]
    assert slope(made) < slope(rough)  # in a drum three beads deep the end walls carry much of the bed
    assert slope(turned(replace(RIG, end_wall_friction=ROUGH.static_friction))) == slope(rough)


@pytest.mark.slow
def test_reversed_rotation_gives_the_mirror_image_of_the_slope(rough):
    other = turned(Drum(RIG.diameter, -RIG.speed, RIG.depth, RIG.fill))
    assert slope(other) == pytest.approx(-slope(rough), abs=6)


def test_in_a_smooth_drum_the_bed_slides_and_lies_lower(rough, smooth):
    # it slides as a whole at the friction angle of the wall, or a little above, due to friction at the end walls
    assert slope(smooth) < slope(rough) - 8
    assert slope(smooth) > -3


@pytest.mark.slow
def test_beads_mix_in_a_drum_that_tumbles_and_not_in_one_that_slides():
    # with few beads the scatter of the index after half a turn is as large as its rise
    rough, smooth = turned(turns=1.0), turned(turns=1.0, wall=SMOOTH)
    assert rough.mixing.quantity == "lacey_index"
    assert rough.mixing.value[-1] > rough.mixing.value[1] + 0.2
    assert smooth.mixing.value[-1] < rough.mixing.value[-1] - 0.1


@pytest.mark.parametrize("more", [{}, {"seed": 4}, {"rig": replace(RIG, fill=0.2)}])
def test_the_halves_of_a_bed_that_has_not_turned_are_not_mixed(more):
    made = turned(**{"turns": 0.01, **more})
    assert made.time[0] == made.mixing.time[0] == 0.0
    assert made.mixing.value[0] == pytest.approx(0.0, abs=0.02)  # the halves may differ by one bead
    # the bed at rest is level, and the first sample of the turning bed differs little
    level = made.profiles[0]
    middle = np.isfinite(level.height) & (np.abs(level.x) < 0.02)
    assert abs(np.polyfit(level.x[middle], level.height[middle], 1)[0]) < math.tan(math.radians(12))


def test_the_standard_uncertainty_of_the_index_is_its_scatter_over_samples():
    # 40 cells of 25 beads, each with its own probability of marked ones, in repeated random draws
    rng = np.random.default_rng(2)
    cell = np.repeat(np.arange(40), 25)
    centres = np.column_stack([cell + 0.5, np.zeros(1000), np.full(1000, 0.5)])

    def drawn():
        part = rng.choice([0.2, 0.5, 0.8], 40)
        return mixing(centres, rng.random(1000) < part[cell], 1.0)

    found = [drawn() for _ in range(300)]
    scatter = np.std([one.index for one in found])
    assert np.mean([one.std_uncertainty for one in found]) == pytest.approx(scatter, rel=0.15)
    assert all(not one.quantity(1.0).doubtful for one in found)


def test_an_index_of_few_cells_is_doubtful():
    rng = np.random.default_rng(3)
    few = mixing(rng.uniform(0, 2, (44, 3)), rng.random(44) < 0.5, 1.0)
    assert few.cells == 4
    assert few.quantity(2.0).detail == {"turns": 2.0, "cells": 4}
    assert "only 4 cells" in few.quantity(2.0).doubtful
    alone = mixing(rng.uniform(0, 1, (44, 3)), rng.random(44) < 0.5, 1.0)
    assert math.isnan(alone.index)  # a single cell has no variance among cells


def test_the_command_writes_profiles_angles_and_mixing_over_time_and_prints_the_index(tmp_path, capfd):
    from rigtwin.cli import run

    out = tmp_path / "out"
    size = "--drum-diameter 70mm --speed 15rpm --depth 20mm --fill 0.4 --turns 0.3"
    numerics = "--stiffness-factor 0.0003 --threads 1 --particle D6"
    assert run(["simulate", "drum", *size.split(), *numerics.split(), "--out", str(out)]) == 0
    printed = capfd.readouterr().out
    row = next(line for line in printed.splitlines() if "Mixing index" in line)
    assert "after 0.3 turns" in row
    assert "doubtful" in row
    assert "cells of 3 bead diameters" in printed
    tables = {path.stem: np.genfromtxt(path, delimiter=",", names=True) for path in sorted(out.glob("drum-twin-*.csv"))}
    names = {stem.removeprefix("drum-twin-"): table.dtype.names for stem, table in tables.items()}
    assert names == {
        "profiles-over-time": ("time_s", "x_m", "height_m", "sigma_m"),
        "angle_of_repose_graphical": ("time_s", "angle_of_repose_graphical_deg"),
        "angle_of_repose_geometric": ("time_s", "angle_of_repose_geometric_deg"),
        "lacey_index": ("time_s", "lacey_index"),
        "profile-1": ("x_m", "height_m", "sigma_m"),
    }
    surface = tables["drum-twin-profiles-over-time"]
    assert np.isfinite(surface["height_m"]).all()
    assert np.hypot(surface["x_m"], surface["height_m"]).max() < 0.035 * 1.001
    for name in ("angle_of_repose_graphical", "angle_of_repose_geometric", "lacey_index"):
        assert np.array_equal(tables[f"drum-twin-{name}"]["time_s"], np.unique(surface["time_s"]))
    # the angle over time has the printed mean
    angles = tables["drum-twin-angle_of_repose_graphical"]["angle_of_repose_graphical_deg"]
    angles_of_the_twin = json.loads((out / "quantities.json").read_text())["quantities"]
    mean = next(one for one in angles_of_the_twin if one["quantity"] == "angle_of_repose_graphical")
    assert angles[1:].min() < mean["value"] < angles[1:].max()
    assert abs(angles[0]) < 0.7 * mean["value"]  # at rest its slope was smaller


def test_the_index_of_separated_beads_is_zero_and_of_random_ones_one():
    rng = np.random.default_rng(1)
    centres = rng.uniform(0, 10, (20_000, 3))
    assert lacey(centres, centres[:, 0] < 5, 1.0) == pytest.approx(0.0, abs=1e-9)
    assert lacey(centres, rng.random(20_000) < 0.3, 1.0) == pytest.approx(1.0, abs=0.01)


def test_profiles_have_their_times_and_lie_in_the_drum(rough):
    assert len(rough.profiles) == len(rough.time) == len(rough.mixing.time)
    assert np.diff(rough.time) == pytest.approx(0.1, rel=0.01)
    assert rough.time[-1] == pytest.approx(0.5 * 2 * math.pi / RIG.speed, abs=0.11)
    for profile in rough.profiles:
        inside = np.isfinite(profile.height)
        assert inside.sum() > 0.5 * len(profile.x)
        assert np.hypot(profile.x[inside], profile.height[inside]).max() < 0.035 * 1.001
    assert rough.profiles[3].view == f"t = {rough.time[3]:.3f} s"


def test_the_work_of_the_drum_is_in_the_energy_balance(rough):
    assert rough.statistics["wall_work_j"] > 0
    assert not any("budget" in warning for warning in rough.warnings)
    assert np.diff(rough.history.dissipated).min() > -1e-3 * rough.history.supplied[-1]


def test_a_broken_run_ends_with_the_bits_of_one_that_never_stopped(broken_off, rough, tmp_path):
    more = {"checkpoint": tmp_path / "drum.npz", "checkpoint_interval": 0}
    for look in (6, 25):
        broken_off(turned, look, **more)
    again = turned(**more)
    assert np.array_equal(again.centres, rough.centres)
    assert np.array_equal(again.mixing.value, rough.mixing.value)


def test_pellets_too_long_to_fit_at_once_are_added_one_after_another(broken_off, tmp_path):
    pellet = hlosta2020.particle("P6x15_3s")

    def pellets(**more) -> drum.Rotation:
        numerics = {"seed": 3, "threads": 1, "stiffness_factor": 1e-4, "fill_limit": 0.02}
        return drum.run(RIG, pellet, PMMA, ROUGH, ROUGH, count=36, turns=0.02, **numerics, **more)

    whole = pellets()
    assert len(whole.centres) == 36 * len(pellet.radii)
    assert np.hypot(whole.centres[:, 0], whole.centres[:, 2]).max() < 0.035 - 0.9 * min(pellet.radii)
    assert np.abs(whole.centres[:, 1]).max() < 0.01 - 0.9 * min(pellet.radii)
    more = {"checkpoint": tmp_path / "pellets.npz", "checkpoint_interval": 0}
    broken_off(pellets, 1, **more)  # while they are still being added
    assert np.array_equal(pellets(**more).centres, whole.centres)


def test_what_the_rig_leaves_open_is_in_the_result():
    made = turned(Drum(0.05, 10.0), count=40, turns=0.1)
    assert made.assumptions["depth"] == "25 mm (not stated: assumed)"
    assert made.assumptions["fill"].startswith("40 beads")
    assert made.assumptions["fill"].endswith("(by the number of beads given)")
    # a fill may be stated or seen in a film: the rig does not say which
    assert turned(Drum(0.05, 10.0, fill=0.1), turns=0.1).assumptions["fill"].endswith("at a packing of 0.6")
    assert turned(Drum(0.05, 10.0), turns=0.1).assumptions["fill"].endswith("(not stated: assumed)")


def test_too_few_beads_have_no_mixing_index():
    assert math.isnan(lacey(np.array([[0.5, 0.0, 0.0]] * 4), np.arange(4) < 2, 1.0))
    made = turned(count=4, turns=0.05)
    assert math.isnan(made.mixing.value[-1])
    assert any("no two cells hold enough beads for a mixing index" in warning for warning in made.warnings)


def test_a_bed_still_moving_at_the_start_gives_a_warning_with_the_option_to_raise():
    hasty = turned(fill_limit=0.01, turns=0.01)
    assert any("still moving" in warning and "raise --fill-limit" in warning for warning in hasty.warnings)


def test_an_angle_without_steady_flow_is_doubtful(rough):
    def wrong(rig, **other):
        return {one.check for one in drum.checks(rig, D6, replace(rough, **other)) if not one.passed}

    assert wrong(RIG) == set()
    assert wrong(RIG, turns=0.1) == {"turned_enough"}
    assert wrong(RIG, time=rough.time[:2], turns=3.0) == {"turned_enough"}
    assert wrong(RIG, count=5) == {"fill", "beads_enough"}
    assert wrong(replace(RIG, depth=0.007), count=20) == {"beads_enough"}  # two beads high


@pytest.mark.parametrize(("share", "words"), [(0.02, "2 %"), (0.704, "70.4 %"), (0.996, "99.6 %")])
def test_the_fill_is_printed_with_enough_digits_to_see_its_limit(share, words):
    check = fill_check(share, "the bed fills")
    assert not check.passed
    assert f"fills {words} of the drum" in check.message


@pytest.mark.parametrize(
    ("rig", "more", "message"),
    [
        (Drum(0.01, 1.0), {}, "too small"),
        (Drum(-0.1, 1.0), {}, "diameter"),
        (Drum(0.07, 0.0), {}, "must turn"),
        (Drum(0.07, 1.0, fill=1.5), {}, "fill"),
        (RIG, {"turns": 0.0}, "turns"),
        (RIG, {"count": 5000}, "beads fill .* of the drum, more than 90%"),
    ],
)
def test_an_impossible_drum_is_refused(rig, more, message):
    with pytest.raises(BadInput, match=message):
        turned(rig, **more)
