"""Diagnosis of clumps on a tilting arm: slides drawn here by SciPy's integrator with a hidden effect."""

import json
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab
from rigtwin.compare.diagnose.diagnosis import bench_of, diagnose
from rigtwin.compare.diagnose.fitting.fit import fit
from rigtwin.compare.diagnose.selection.name_effects import _fit
from rigtwin.sim.effects import named

G = 9.81
MU, RADIUS, PLACE, START = 0.39, 0.003, 0.25, math.radians(17)
ROLL, LEVEL, SCALE = 1.2e-3, 1.0e-3, 0.998
NOISE = 1e-4
LEVELS = 0.15  # [m/s], speed at which weakening friction levels off
SETTINGS = [(mass, rate) for mass in (0.8e-3, 4.5e-3) for rate in (0.5, 2.0)]


def draw_slide(rng, mass, rate, *, pull=0.0, drop=0.0, growth=0.0, chance=0.0, weaker=0.0):
    """One filmed slide: time [s] and place [m] as a camera that is a little off sees it."""
    less = max(rng.normal(0, chance), 0.0)  # a larger kinetic friction would only make it slip later
    mu, turn = MU * (1 + rng.normal(0, 0.02)), math.radians(rate)
    tilt = START + LEVEL

    def press(t, speed):
        return G * math.cos(tilt + turn * t) + pull / mass + 2 * speed * turn - RADIUS * turn**2

    begin = 0.0
    for _ in range(60):  # to the angle at which it slips
        begin = (math.asin((mu * press(begin, 0.0) + PLACE * turn**2) / G) - tilt) / turn

    def motion(t, s):
        kinetic = (mu * (1 - drop) - less + growth * abs(s[1]) - weaker * (1 - math.exp(-abs(s[1]) / LEVELS))) * press(
            t, s[1]
        )
        return [s[1], s[0] * turn**2 - G * math.sin(tilt + turn * t) + kinetic]

    def arrive(_t, s):
        return s[0] - 0.05

    arrive.terminal = True
    run = solve_ivp(
        motion, (begin, begin + 60), [PLACE, -1e-9], events=arrive, rtol=1e-10, atol=1e-12, dense_output=True
    )
    time = np.arange(0.0, run.t[-1], 1 / 60)
    along = np.where(time < begin, PLACE, run.sol(np.maximum(time, begin))[0])
    angle = tilt + turn * time + ROLL
    place = SCALE * np.column_stack(
        [along * np.cos(angle) - RADIUS * np.sin(angle), along * np.sin(angle) + RADIUS * np.cos(angle)]
    )
    return time, place + rng.normal(0, NOISE, place.shape)


def write_slides(folder, seed, repetitions=5, **hidden):
    """A lab of two weights at two rates."""
    rng = np.random.default_rng(seed)
    conditions = []
    for mass, rate in SETTINGS:
        name = f"m{1e6 * mass:.0f}_r{10 * rate:.0f}"
        (folder / name).mkdir(parents=True)
        for number in range(1, repetitions + 1):
            time, place = draw_slide(rng, mass, rate, **hidden)
            rows = "\n".join(f"{t:.5f},{x:.7f},{y:.7f}" for t, (x, y) in zip(time, place, strict=True))
            (folder / name / f"rep{number:02d}.csv").write_text("time_s,x_m,y_m\n" + rows + "\n")
        conditions.append(
            {
                "name": name, "bead": "b", "wall": "glass", "clump_mass_g": 1e3 * mass, "tilt_rate_deg_s": rate,
                "start_angle_deg": math.degrees(START), "waiting_time_s": 10.0, "start_distance_m": PLACE,
                "repetitions": repetitions,
            }
        )  # fmt: skip
    lab = {
        "rig": "slide",
        "camera": {"frame_rate_hz": 60.0, "scale_m_per_px": 5e-4, "tracking_noise_px": NOISE / 5e-4},
        "particles": {"b": {"diameter_m": 2 * RADIUS, "mass_g": 0.2}},
        "conditions": conditions,
    }
    (folder / "lab.json").write_text(json.dumps(lab))
    return read_tracked_lab(folder)


@pytest.fixture(scope="module")
def sticky(tmp_path_factory):
    return write_slides(tmp_path_factory.mktemp("sticky"), 1, repetitions=2, pull=1.7e-3)


def test_the_fit_of_a_strong_adhesion_converges_without_a_change_of_the_calibration(sticky):
    bench = bench_of(sticky)
    found = fit(bench, (named("contact_adhesion"),), near=fit(bench))
    true = fit(
        bench, found.terms, near=found, held={"plate_tilt.angle": LEVEL, "camera_roll.angle": ROLL}
    )  # fmt: skip
    assert found.converged
    assert found.deviance < true.deviance + 0.1
    for name, value in (("plate_tilt.angle", LEVEL), ("contact_adhesion.force", 1.7e-3)):
        assert found.value(name) == pytest.approx(value, abs=3 * found.std(name))


@pytest.mark.slow
def test_a_strong_adhesion_is_named_alone(sticky):
    found = diagnose(sticky, listed=[named(name) for name in ("contact_adhesion", "plate_tilt", "scale_error")])
    assert found.verdict == "named"
    assert [term.name for term in found.chosen.terms] == ["contact_adhesion"]


def test_a_weak_friction_drop_is_found_from_the_wrong_side_of_zero(tmp_path):
    bench = bench_of(write_slides(tmp_path, 2, drop=0.0034))
    found = _fit(bench, (named("friction_drop"),), fit(bench))
    assert found.value("friction_drop.drop") == pytest.approx(0.0034, abs=3 * found.std("friction_drop.drop"))


SLIDE_EFFECTS = ("friction_drop", "sliding_speed", "lens_distortion", "rolling_shutter", "contact_adhesion")


def test_friction_that_changes_with_the_speed_is_named_with_its_slope(tmp_path):
    growth = -0.02
    lab = write_slides(tmp_path, 4, repetitions=2, growth=growth)
    found = diagnose(lab, listed=[named(name) for name in SLIDE_EFFECTS])
    assert (found.verdict, found.chosen.names) == ("named", ("sliding_speed",))
    slope = found.chosen.fitted.value("sliding_speed.slope")
    assert slope == pytest.approx(growth, abs=4 * found.chosen.fitted.std("sliding_speed.slope"))


def test_friction_that_weakens_exponentially_is_described_by_the_saturating_law(tmp_path):
    bench = bench_of(write_slides(tmp_path, 6, repetitions=2, weaker=0.08))
    base = fit(bench)
    left = {name: _fit(bench, (named(name),), base) for name in ("sliding_speed", "sliding_speed_saturating")}
    share = {name: (one.per_row - 1) / (base.per_row - 1) for name, one in left.items()}
    assert share["sliding_speed_saturating"] < 0.1 < share["sliding_speed"]  # 90 % of the gap names a law


def test_chance_that_lowers_the_kinetic_friction_is_no_friction_drop(tmp_path):
    lab = write_slides(tmp_path, 5, repetitions=3, chance=0.003)
    assert diagnose(lab, listed=[named(name) for name in SLIDE_EFFECTS]).verdict == "none"
