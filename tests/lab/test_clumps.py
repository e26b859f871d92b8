"""Mass properties of unions of spheres against closed forms; the paper's clumps against its table 3."""

import math

import numpy as np
import pytest

from rigtwin.lab.clumps import ACCURACY, clump, cubic, mass_properties, row
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Material, Particle, clumped
from rigtwin.lab.reference import hlosta2020

ASH = Material("ash", 720, 11e9, 0.44)
BALL = 4 / 3 * math.pi


def test_one_sphere_is_a_sphere():
    whole = mass_properties([(3.0, -1.0, 2.0)], [1.5])
    volume = BALL * 1.5**3
    assert whole.volume == pytest.approx(volume, rel=ACCURACY)
    assert whole.centre == pytest.approx((3.0, -1.0, 2.0), abs=1e-9)
    assert np.array(whole.inertia) == pytest.approx(0.4 * volume * 1.5**2 * np.eye(3), rel=ACCURACY, abs=1e-9)
    assert whole.accuracy <= ACCURACY / 2


def test_two_spheres_apart_follow_the_parallel_axis_theorem():
    a, b, radii = np.array([0.0, 0.0, 0.0]), np.array([3.0, 1.0, -2.0]), (1.0, 2.0)
    masses = [BALL * r**3 for r in radii]
    centre = (masses[0] * a + masses[1] * b) / sum(masses)
    tensor = np.zeros((3, 3))
    for place, mass, r in zip((a, b), masses, radii, strict=True):
        d = place - centre
        tensor += mass * (0.4 * r**2 * np.eye(3) + d @ d * np.eye(3) - np.outer(d, d))
    whole = mass_properties([tuple(a), tuple(b)], radii)
    assert whole.volume == pytest.approx(sum(masses), rel=ACCURACY)
    assert whole.centre == pytest.approx(centre, rel=ACCURACY)
    assert np.abs(np.array(whole.inertia) - tensor).max() < ACCURACY * np.trace(tensor)


@pytest.mark.parametrize("axis", range(3))
def test_two_overlapping_spheres_lack_the_lens_that_they_share(axis):
    # two caps of height h, cut at half the distance d; closed forms of a sphere cut by a plane
    r, d = 1.0, 1.2
    cut = d / 2
    volume = 2 * math.pi * (2 / 3 * r**3 + r**2 * cut - cut**3 / 3)
    # of one part, z from its own centre: integral of z^2 and of (r^2 - z^2)^2 from -r to cut
    zz = math.pi * ((r**2 * cut**3 / 3 - cut**5 / 5) + (r**5 / 3 - r**5 / 5))
    z1 = math.pi * ((r**2 * cut**2 / 2 - cut**4 / 4) - (r**4 / 2 - r**4 / 4))
    flat = math.pi / 2 * ((r**4 * cut - 2 / 3 * r**2 * cut**3 + cut**5 / 5) + 8 / 15 * r**5)
    # the plane of the cut is the middle: z' = z - cut
    square = 2 * (zz - 2 * cut * z1 + cut**2 * volume / 2)
    along, across = 2 * flat, flat + square
    place = np.zeros((2, 3))
    place[:, axis] = -d / 2, d / 2
    whole = mass_properties([tuple(p) for p in place], [r, r])
    expected = np.full(3, across)
    expected[axis] = along
    assert whole.volume == pytest.approx(volume, rel=ACCURACY)
    assert np.diag(whole.inertia) == pytest.approx(expected, rel=ACCURACY)


def test_a_sphere_inside_another_adds_nothing():
    alone = mass_properties([(0.0, 0, 0)], [1.0])
    assert mass_properties([(0.0, 0, 0), (0.3, 0.2, 0)], [1.0, 0.5]).volume == pytest.approx(alone.volume, rel=ACCURACY)


def test_a_clump_lies_in_its_principal_axes_however_it_was_given():
    places, radii = np.array([[0, 0, 0], [3, 0, 0], [0, 2, 1.0]]), [2.0, 1.5, 1.0]
    one = clump([tuple(p) for p in places], radii)
    angle = 0.7
    turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]])
    other = clump([tuple(p) for p in places @ turn.T + 5.0], radii)
    assert sorted(other.gyration) == pytest.approx(sorted(one.gyration), rel=2 * ACCURACY)
    assert other.volume == pytest.approx(one.volume, rel=2 * ACCURACY)
    again = mass_properties(one.offsets, one.radii)
    tensor = np.array(again.inertia)
    assert np.abs(again.centre).max() < ACCURACY
    assert np.abs(tensor - np.diag(np.diag(tensor))).max() < 2 * ACCURACY * np.trace(tensor)


def test_a_cube_of_spheres_turns_alike_about_every_axis():
    cube = cubic(6e-3, ((1, 1, 1), 1e-3), ((1, 1, 0), 1.2e-3))
    assert len(cube.radii) == 20
    assert cube.gyration == pytest.approx((cube.gyration[0],) * 3, rel=ACCURACY)
    assert np.abs(np.array(cube.offsets)).max() == pytest.approx(2e-3)


def test_a_clump_keeps_the_mass_that_it_is_given():
    pellet = clumped("pellet", ASH, row(3, 3e-3, 4e-3), mass=0.28e-3)
    assert pellet.mass == pytest.approx(0.28e-3)
    assert pellet.diameter == pytest.approx(14e-3, rel=1e-3)
    along, *across = sorted(pellet.moments)
    assert across[0] == pytest.approx(across[1], rel=1e-3)
    sphere, cylinder = (part * 0.28e-3 * 3e-3**2 for part in (0.4, 0.5))
    assert sphere < along < cylinder


def test_a_clump_of_one_sphere_weighs_what_the_sphere_does():
    ball, one = Particle("ball", ASH, 6e-3), clumped("one", ASH, clump([(0, 0, 0)], 3e-3))
    assert one.mass == pytest.approx(ball.mass, rel=ACCURACY)
    assert one.moments == pytest.approx(ball.moments, rel=2 * ACCURACY)
    assert one.rayleigh_time_step == pytest.approx(ball.rayleigh_time_step)


@pytest.mark.parametrize("entry", [row for row in hlosta2020.table(3) if row["virtual_particle"] in hlosta2020.CLUMPS])
def test_the_clumps_of_the_paper_have_the_volume_mass_and_density_of_table_3(entry):
    name = entry["virtual_particle"]
    bead = hlosta2020.particle(name)
    spheres = {"1s": 1, "8s-a": 8, "8s-b": 8, "9s": 9, "16s": 16, "24s": 24, "3s": 3, "5s": 5}[name.split("_")[1]]
    assert len(bead.radii) == spheres
    assert bead.volume * 1e9 == pytest.approx(entry["dem_volume_mm3"], rel=1.5e-3)
    assert bead.mass * 1e3 == pytest.approx(entry["total_mass_g"] / entry["pieces"])
    assert bead.effective_density == pytest.approx(entry["dem_density_kg_m3"], rel=2e-3)


def width(shape):
    """Of the box that holds a clump in its own axes."""
    return (np.abs(shape.offsets) + np.array(shape.radii)[:, None]).max(axis=0) * 2


def test_cubes_fit_a_cube_of_6_mm_the_calibrated_one_of_6_2_and_pellets_are_6_mm_thick():
    """The paper enlarged D4, D6, D12 and C6_24s by 0.2 mm after table 7, and left the others as they were."""
    for name in hlosta2020.CLUMPS:
        size = width(hlosta2020.shape(name))
        side = 6.2e-3 if name == hlosta2020.CALIBRATED["C6"] else 6e-3
        assert sorted(size)[:2] == pytest.approx([side, side], rel=1e-3)
        assert max(size) == pytest.approx(side if name.startswith("C6") else 15.4e-3, rel=1e-3)
    assert len(hlosta2020.particle("C6_28s").radii) == 28


def test_before_the_paper_enlarged_them_cubes_and_beads_were_smaller_and_as_heavy():
    cube = hlosta2020.particle("C6", enlarged=False)
    assert width(cube.shape) == pytest.approx([6e-3] * 3)
    assert cube.mass == pytest.approx(hlosta2020.particle("C6").mass)
    for name in ("D4", "D6", "D12"):
        before, after = hlosta2020.particle(name, enlarged=False), hlosta2020.particle(name)
        assert after.diameter - before.diameter == pytest.approx(0.2e-3)
        assert before.mass == pytest.approx(after.mass)
    for name in ("D6_ABS", "D5_steel", "C6_8s-a", "P6x15"):
        assert hlosta2020.particle(name, enlarged=False) == hlosta2020.particle(name)


def test_the_calibrated_cube_has_the_volume_of_24_spheres_less_what_40_neighbours_share():
    """Spheres of radius r whose centres are 2 a apart share two caps of height r - a."""
    r, a = 1.1, 1.0
    caps = 2 * math.pi * (r - a) ** 2 * (2 * r + a) / 3
    assert hlosta2020.shape("C6_24s").volume * 1e9 == pytest.approx(24 * 4 / 3 * math.pi * r**3 - 40 * caps, rel=1e-4)


def test_the_cube_and_the_pellet_are_the_clumps_of_the_calibrated_model():
    for name, density in (("C6", 1061), ("P6x15", 767)):
        bead = hlosta2020.particle(name)
        assert bead.name == name
        assert bead.effective_density == pytest.approx(density, rel=2e-3)
    assert hlosta2020.contact("C6_9s", "steel") == hlosta2020.contact("C6", "steel")
    assert hlosta2020.contact("D6", "P6x15_3s") == hlosta2020.contact("D6", "P6x15")


@pytest.mark.parametrize(
    ("places", "radii", "words"),
    [
        ([], [], "one radius per sphere"),
        ([(0, 0, 0)], [1.0, 2.0], "one radius per sphere"),
        ([(0, 0, math.nan)], [1.0], "finite"),
        ([(0, 0, 0)], [-1.0], "positive"),
    ],
)
def test_impossible_clumps_are_refused(places, radii, words):
    with pytest.raises(BadInput, match=words):
        clump(places, radii)


def test_a_clump_with_another_diameter_than_its_own_is_refused():
    with pytest.raises(BadInput, match="clumped"):
        Particle("odd", ASH, 1.0, shape=row(2, 1e-3, 1e-3))
    with pytest.raises(BadInput, match="both given"):
        clumped("odd", ASH, row(2, 1e-3, 1e-3), density=1.0, mass=1.0)
