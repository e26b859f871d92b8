"""Packing: all particles are in the bed, its packing fraction is that of spheres, its height that of the surface."""

import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from rigtwin.lab.clumps import row
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Contact, Material, Particle, clumped, sized
from rigtwin.lab.rigs import Packing
from rigtwin.lab.size_distributions import sieved, uniform
from rigtwin.lab.stl_grain import filled_file
from rigtwin.sim import packing
from rigtwin.sim.engine.bulk.bulk import Bulk
from rigtwin.sim.engine.walls.shapes import Cylinder, Disc, Motion, Wall

ASH = Material("ash", 720, 11e9, 0.44)
PMMA = Material("PMMA", 1250, 3e9, 0.4)
BEAD = Particle("bead", ASH, 6e-3, density=569)
BEADS, GLASS = Contact(0.6, 0.3, 0.02), Contact(0.47, 0.3, 0.02)
RIG = Packing(0.04, cylinder_height=0.05, fall_height=0.01)


def poured(particle=BEAD, count=180, **more) -> packing.Bed:
    more = {"pour_rate": 1500.0, "threads": 1, "seed": 4} | more
    return packing.run(RIG, particle, PMMA, BEADS, GLASS, count=count, **more)


@pytest.fixture(scope="module")
def bed() -> packing.Bed:
    return poured()


def solid_between(bed: packing.Bed, low: float, high: float) -> float:
    """Packing fraction [1] between two heights, from spherical caps."""
    z, r = bed.centres[:, 2], bed.radii
    a, b = np.clip(low - z, -r, r), np.clip(high - z, -r, r)
    volume = math.pi * (r**2 * (b - a) - (b**3 - a**3) / 3)
    return float(volume.sum() / (math.pi / 4 * bed.cylinder_diameter**2 * (high - low)))


def test_what_was_poured_is_in_the_cylinder(bed):
    assert (bed.asked, bed.placed, bed.missed) == (180, 180, 0)
    assert bed.at_rest
    assert bed.mass == pytest.approx(180 * BEAD.mass)
    assert bed.solid == pytest.approx(180 * BEAD.volume)
    assert np.hypot(*bed.centres[:, :2].T).max() < 0.02 - 0.003 * (1 - 0.05)
    assert bed.centres[:, 2].min() > 0.003 * (1 - 0.05)


def test_a_ball_from_an_stl_file_packs_as_the_sphere_it_is(bed, tmp_path):
    trimesh.creation.icosphere(subdivisions=4, radius=3.0).export(tmp_path / "ball.stl")
    ball = clumped("ball", ASH, filled_file(tmp_path / "ball.stl", 1e-3).clump, density=569)
    other = poured(ball)
    assert other.at_rest
    assert other.mass == pytest.approx(bed.mass, rel=3e-3)  # facets lie inside the sphere
    # beds of 180 spheres scatter by 1 % from seed to seed, and these two have other random numbers
    assert other.height == pytest.approx(bed.height, rel=0.03)


def test_volume_is_conserved(bed):
    whole = math.pi / 4 * bed.cylinder_diameter**2 * bed.height
    assert bed.bulk_density * whole == pytest.approx(180 * BEAD.mass)
    assert bed.packing_fraction == pytest.approx(bed.bulk_density / BEAD.effective_density)
    # from bottom to top the filled volume is that of all spheres
    assert solid_between(bed, -0.001, 0.06) * math.pi / 4 * 0.04**2 * 0.061 == pytest.approx(bed.solid)


def test_equal_spheres_pack_between_loose_and_dense_away_from_the_ends(bed):
    # a wall loosens the layers along it, so that a narrow cylinder holds a little less than an endless bed
    assert 0.52 < solid_between(bed, 0.006, bed.height - 0.006) < 0.64


def test_diameters_of_a_uniform_distribution_keep_to_their_range():
    mixed = poured(sized(BEAD, uniform(3.6e-3, 6e-3)), count=150)
    assert len(mixed.radii) == 150
    assert 1.8e-3 <= mixed.radii.min() < 2e-3
    assert 2.8e-3 < mixed.radii.max() <= 3e-3
    assert mixed.radii.mean() == pytest.approx(2.4e-3, rel=0.05)
    with pytest.raises(BadInput, match="the largest of its sizes"):
        replace(BEAD, sizes=uniform(3e-3, 7e-3))


GRAVEL = sized(BEAD, sieved([2e-3, 3e-3, 4e-3, 6e-3], [0.2, 0.3, 0.5]))


def volume_shares(radii: np.ndarray) -> np.ndarray:
    """Shares of the volume in the classes of GRAVEL."""
    found, _ = np.histogram(2 * radii, [2e-3, 3e-3, 4e-3, 6.0001e-3], weights=radii**3)
    return found / found.sum()


@pytest.mark.parametrize("hopper", [{}, {"hopper_diameter": 0.06, "outlet_diameter": 0.03}], ids=["rain", "hopper"])
def test_a_sieved_material_keeps_its_curve_however_it_is_filled_in(hopper):
    """Large particles find room as small ones do: no size is drawn anew for a place that is free."""
    rig = replace(RIG, cylinder_height=0.08, **hopper)
    settings = {} if hopper else {"pour_rate": 4000.0}
    mixed = packing.run(rig, GRAVEL, PMMA, BEADS, GLASS, count=500, threads=1, seed=4, **settings)
    assert mixed.placed == 500
    assert len(mixed.radii) > 490
    assert volume_shares(mixed.radii) == pytest.approx([0.2, 0.3, 0.5], abs=0.03)
    assert mixed.mass == pytest.approx(500 * GRAVEL.mean_mass, rel=0.03)
    # by its volume and mass the bed is one of particles that fill gaps of larger ones
    assert mixed.solid == pytest.approx(4 / 3 * math.pi * (mixed.radii**3).sum())
    assert mixed.packing_fraction > 0.5


def test_the_height_is_that_of_the_surface(bed):
    top = (bed.centres[:, 2] + bed.radii).max()
    assert bed.surface.max() == pytest.approx(top, abs=1e-4)
    assert top - 0.01 < bed.height < top
    for profile in bed.profiles:
        middle = np.abs(profile.x) < 0.015
        # an outline sees the highest of all beads in a row
        assert bed.height < profile.height[middle].mean() <= top + 1e-9
        assert profile.base == (-0.02, 0.02)


def test_the_surface_of_one_sphere_is_that_of_the_sphere():
    heights = packing.surface(np.array([[0.002, -0.003, 0.01]]), np.array([0.004]), 0.04)
    area = math.pi / 4 * 0.04**2
    under = math.pi * 0.004**2 * 0.01 + 2 / 3 * math.pi * 0.004**3
    assert heights.mean() * area == pytest.approx(under, rel=0.02)


@pytest.mark.parametrize("width", [0.04, 0.011])
def test_the_surface_of_many_spheres_is_the_highest_of_each(width):
    random = np.random.default_rng(8)
    centres, radii = random.uniform(-0.024, 0.024, (300, 3)), random.uniform(2e-4, 4e-3, 300)
    x = (np.arange(100) + 0.5) / 100 * width - width / 2
    highest = np.zeros((100, 100))
    for (cx, cy, cz), radius in zip(centres, radii, strict=True):
        over = radius**2 - ((x[:, None] - cx) ** 2 + (x[None, :] - cy) ** 2)
        highest = np.where(over >= 0, np.maximum(highest, cz + np.sqrt(np.maximum(over, 0))), highest)
    inside = np.hypot(*np.meshgrid(x, x, indexing="ij")) < width / 2
    assert np.array_equal(packing.surface(centres, radii, width), highest[inside])


def test_the_seed_decides(bed):
    assert np.array_equal(poured().centres, bed.centres)
    assert not np.array_equal(poured(count=20, seed=5).centres, poured(count=20).centres)


def test_a_slow_pour_ends_with_the_last_bead():
    slow = poured(count=2, pour_rate=0.4)
    assert slow.placed == 2
    assert slow.assumptions["pour_rate"] == "0.4 particles per second (as given)"
    assert not [words for words in slow.warnings if "found room" in words]


def test_pellets_pour_with_random_orientation_and_keep_their_shape():
    pellet = clumped("pellet", ASH, row(3, 2e-3, 2e-3), mass=60e-6)
    bed = poured(pellet, count=30)
    assert bed.missed == 0
    assert bed.mass == pytest.approx(30 * 60e-6)
    spheres = bed.centres.reshape(30, 3, 3)
    assert np.linalg.norm(spheres[:, 2] - spheres[:, 0], axis=1) == pytest.approx(4e-3)


def test_the_time_per_particle_adds_up_over_a_run_that_was_stopped(monkeypatch, tmp_path):
    clock = [0.0]
    monkeypatch.setattr(time, "process_time", lambda: clock[0])

    def a_second_each_look(stop: float = math.inf):
        looks = 0

        def progress(_stage, _done, _total):
            nonlocal looks
            clock[0] += 1.0
            looks += 1
            if looks == stop:
                raise KeyError

        return progress

    whole = poured(count=40, progress=a_second_each_look())
    assert whole.computing > 10
    kept = {"count": 40, "checkpoint": tmp_path / "bed.npz", "checkpoint_interval": 0}
    with pytest.raises(KeyError):
        poured(progress=a_second_each_look(7), **kept)
    again = poured(progress=a_second_each_look(), **kept)
    # processor time between the last checkpoint and the stop is lost
    assert whole.computing - 1 <= again.computing <= whole.computing
    assert again.seconds_per_particle == again.computing / 40
    clock[0] += 1000.0  # time between two processes does not count
    assert poured(**kept).computing == pytest.approx(again.computing, abs=1.0)


def test_the_command_prints_the_time_per_particle(tmp_path, capfd):
    from rigtwin.cli import run

    command = (
        "simulate packing --cylinder-diameter 40mm --cylinder-height 50mm --count 60 --threads 1 --pour-rate 900/s"
    )
    assert run([*command.split(), "--out", str(tmp_path)]) == 0
    (printed,) = [line for line in capfd.readouterr().out.splitlines() if line.startswith("computing:")]
    each = json.loads((tmp_path / "quantities.json").read_text())["settings"]["seconds_per_particle"]
    assert printed == f"computing: {each:.3g} s of processor time per particle"


def test_a_hopper_with_a_slide_fills_the_cylinder_as_a_rain_does(bed):
    rig = replace(RIG, hopper_diameter=0.06)
    from_hopper = packing.run(rig, BEAD, PMMA, BEADS, GLASS, count=180, seed=4, threads=1)
    assert (from_hopper.placed, from_hopper.missed) == (180, 0)
    assert from_hopper.at_rest
    assert from_hopper.centres[:, 2].max() < rig.cylinder_height
    # the same beads in the same cylinder: the beds differ by less than half a layer
    assert from_hopper.height == pytest.approx(bed.height, abs=BEAD.radius)
    assert "60 mm" in from_hopper.assumptions["hopper"]


@pytest.mark.parametrize("settle_limit", [0.02, 4.0])
def test_particles_arching_over_the_outlet_are_not_counted_as_missed(settle_limit):
    rig = replace(RIG, hopper_diameter=0.06, outlet_diameter=2 * BEAD.diameter)
    limits = {"fill_limit": 0.5, "settle_limit": settle_limit}
    jammed = packing.run(rig, BEAD, PMMA, BEADS, GLASS, count=60, seed=4, threads=1, **limits)
    assert jammed.arched
    assert jammed.stuck > 40
    assert jammed.missed == 0
    (said,) = [warning for warning in jammed.warnings if "arch over the outlet" in warning]
    assert said.startswith(f"{jammed.stuck} of 60 particles")
    assert said.endswith("or 2 of their diameters wide; give a wider --outlet-diameter")
    assert not any("did not stay" in warning for warning in jammed.warnings)


@pytest.mark.parametrize(
    ("rig", "more", "words"),
    [
        (Packing(0.01), {}, "cylinder_diameter"),
        (Packing(0.04, outlet_diameter=0.05), {}, "wider than the cylinder"),
        (Packing(0.04, outlet_diameter=0.01), {}, "lets no particles"),
        (Packing(0.04, hopper_diameter=0.02), {}, "hopper_diameter"),
        (RIG, {"count": 0}, "count"),
        (RIG, {"stiffness_factor": 2.0}, "stiffness_factor"),
        (RIG, {"pour_rate": -1.0}, "pour_rate"),
    ],
)
def test_impossible_beds_are_refused(rig, more, words):
    with pytest.raises(BadInput, match=words):
        packing.run(rig, BEAD, PMMA, BEADS, GLASS, **more)


@pytest.mark.parametrize("law", ["Hertz-Mindlin", "linear"])
def test_the_overlap_of_a_bead_at_rest_follows_its_contact_law(law):
    factor, speed = 1e-3, 0.3
    one = poured(count=1, settle_limit=2.0, stiffness_factor=factor, contact_law=law, impact_speed=speed)
    moduli = [factor * body.youngs_modulus / (1 - body.poisson_ratio**2) for body in (ASH, PMMA)]
    modulus = moduli[0] * moduli[1] / sum(moduli)
    hertz = 4 / 3 * modulus * math.sqrt(BEAD.radius)
    deepest = (5 / 4 * BEAD.mass * speed**2 / hertz) ** 0.4  # of an elastic impact by Hertz
    spring = BEAD.mass * speed**2 / deepest**2
    weight = BEAD.mass * 9.81
    sinks = weight / spring if law == "linear" else (weight / hertz) ** (2 / 3)
    assert BEAD.radius - one.centres[0, 2] == pytest.approx(sinks, rel=0.02)
    assert one.assumptions["contact_law"].startswith(law)


# ---------------------------------------------------------------------- Janssen


NARROW = 0.025  # [m]
SOFT_ASH, SOFT_PMMA = ASH.softened(1e-3), PMMA.softened(1e-3)


def borne_by_the_floor(count: int, wall_friction: float) -> tuple[float, float]:
    """Share of a bed's weight on the floor of a narrow cylinder [1], and the bed's height [m].

    The floor sinks slowly by a tenth of a diameter, so that friction holds the bed up wherever it can: Janssen's case.
    """
    soft, up = replace(BEAD, material=SOFT_ASH), (0.0, 0.0, 1.0)
    wall = Contact(0.3, wall_friction)
    bed = Bulk(
        [soft],
        Contact(0.3, 0.5, 0.02),
        [
            Wall(Disc((0.0, 0.0, 0.0), up, NARROW / 2), SOFT_PMMA, wall),
            Wall(Cylinder((0.0, 0.0, -0.005), up, NARROW / 2, 0.16), SOFT_PMMA, wall),
        ],
        low=(-0.02, -0.02, -0.01),
        high=(0.02, 0.02, 0.16),
        time_step=0.3 * soft.rayleigh_time_step,
        threads=1,
    )
    k, rng = np.arange(count), np.random.default_rng(3)
    around = np.where(k % 7, 6.2e-3, 0.0)  # layers of seven
    place = np.stack([around * np.cos(k % 7 * math.pi / 3), around * np.sin(k % 7 * math.pi / 3)], axis=1)
    place = np.column_stack([place, 3.2e-3 + 6.3e-3 * (k // 7)]) + rng.uniform(-5e-5, 5e-5, (count, 3))
    bed.add(place, rng.normal(0, 0.1, (count, 3)))
    bed.run(round(0.8 / bed.time_step))
    speed, began = 6e-3, bed.time
    bed.move_wall(0, Motion((0.0, 0.0, -speed), start=began))
    bed.run(round(0.05 / bed.time_step))
    moduli = [body.youngs_modulus / (1 - body.poisson_ratio**2) for body in (SOFT_ASH, SOFT_PMMA)]
    modulus, forces = moduli[0] * moduli[1] / sum(moduli), []
    for _ in range(5):
        bed.run(round(0.01 / bed.time_step))
        beads, floor = bed.beads(), -speed * (bed.time - began)
        depth = np.maximum(floor + beads.radius - beads.position[:, 2], 0.0)
        forces.append((4 / 3 * modulus * np.sqrt(beads.radius) * depth**1.5).sum())  # Hertz
    return np.mean(forces) / (count * soft.mass * 9.81), float(beads.position[:, 2].max() + soft.radius - floor)


def test_the_floor_of_a_smooth_cylinder_carries_the_whole_weight():
    assert borne_by_the_floor(84, wall_friction=0.0)[0] == pytest.approx(1.0, rel=0.02)


def test_a_rough_cylinder_carries_its_bed_as_janssen_predicts():
    # the floor carries m g (1 - exp(-h / l)) l / h with l = D / (4 mu K); K lies between Rankine's active 0.3 and a
    # liquid's 1
    def law(height, k):
        reach = NARROW / (4 * 0.5 * k)
        return reach / height * (1 - math.exp(-height / reach))

    found = [borne_by_the_floor(count, wall_friction=0.5) for count in (42, 84, 150)]
    for share, height in found:
        assert law(height, 1.0) < share < law(height, 0.3)
    # saturation: less than about half of the upper half's weight reaches the floor
    (low, _), (high, _) = found[0], found[-1]
    assert 150 * high - 42 * low < 0.5 * (150 - 42)
