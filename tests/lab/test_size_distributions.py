"""Drawn sizes have the moments of their law, and a sieving gives its masses back."""

import math

import numpy as np
import pytest
from scipy.stats import truncnorm

from rigtwin.lab.clumps import row
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Material, Particle, clumped, sized
from rigtwin.lab.size_distributions import Sizes, listed, lognormal, normal, sieved, uniform

COUNT = 200_000
ASH = Material("ash", 720, 11e9, 0.44)


def drawn(sizes: Sizes) -> np.ndarray:
    diameters = sizes.draw(COUNT, np.random.default_rng(1))
    assert diameters.min() >= sizes.smallest > 0
    assert diameters.max() <= sizes.largest
    return diameters


def test_laws_by_number_have_their_moments():
    assert drawn(uniform(4e-3, 8e-3)).mean() == pytest.approx(6e-3, rel=1e-3)
    bell = drawn(normal(6e-3, 0.5e-3))
    assert bell.mean() == pytest.approx(6e-3, rel=1e-3)
    assert bell.std() == pytest.approx(0.5e-3, rel=0.02)  # cut at three: 1.3 % narrower
    logs = np.log(drawn(lognormal(6e-3, 0.2)))
    assert np.median(logs) == pytest.approx(math.log(6e-3), abs=2e-3)
    assert logs.std() == pytest.approx(0.2, rel=0.02)


def test_a_lognormal_law_by_mass_is_one_by_number_with_a_smaller_median():
    """Hatch and Choate 1929: ln d_number = ln d_mass - 3 s^2."""
    spread, median = 0.15, 6e-3
    ends = {"smallest": 2e-3, "largest": 16e-3}
    by_mass = lognormal(median, spread, by="mass", **ends)
    by_number = lognormal(median * math.exp(-3 * spread**2), spread, **ends)
    assert by_mass.median_by_mass == pytest.approx(median, rel=2e-3)
    assert np.interp(0.5, by_mass.shares, by_mass.diameters) == pytest.approx(
        np.interp(0.5, by_number.shares, by_number.diameters), rel=2e-3
    )
    assert by_mass.mean_power(3) == pytest.approx(by_number.mean_power(3), rel=2e-3)


def test_ends_cut_a_law_off():
    cut = normal(6e-3, 2e-3, smallest=4e-3, largest=7e-3)
    assert (cut.smallest, cut.largest) == (pytest.approx(4e-3), pytest.approx(7e-3))
    assert drawn(cut).mean() == pytest.approx(truncnorm.mean(-1, 0.5, loc=6e-3, scale=2e-3), rel=1e-3)


def test_a_list_by_mass_has_its_shares_of_the_mass():
    diameters = drawn(listed([6e-3, 2e-3, 4e-3], [0.5, 0.3, 0.2]))
    values, counts = np.unique(diameters, return_counts=True)
    assert values == pytest.approx([2e-3, 4e-3, 6e-3])
    masses = counts * values**3
    assert masses / masses.sum() == pytest.approx([0.3, 0.2, 0.5], abs=2e-3)
    by_number = drawn(listed([2e-3, 4e-3], [1, 3], by="number"))
    assert (by_number == 2e-3).mean() == pytest.approx(0.25, abs=1e-4)


def test_sieving_what_was_drawn_gives_the_masses_back():
    meshes, masses = [1e-3, 2e-3, 2.5e-3, 4e-3, 5e-3], [0.2, 0.0, 0.5, 0.3]
    diameters = drawn(sieved(meshes, masses))
    found, _ = np.histogram(diameters, meshes, weights=diameters**3)
    assert found / found.sum() == pytest.approx(masses, abs=0.01)


@pytest.mark.parametrize(
    "sizes",
    [
        uniform(2e-3, 8e-3),
        uniform(2e-3, 8e-3, by="mass"),
        normal(6e-3, 1e-3),
        lognormal(4e-3, 0.3, by="mass"),
        listed([2e-3, 5e-3, 6e-3], [0.2, 0.5, 0.3]),
        sieved([1e-3, 2e-3, 2.5e-3, 4e-3, 9e-3], [0.2, 0.0, 0.5, 0.3]),
    ],
    ids=["uniform", "uniform by mass", "normal", "lognormal", "list", "sieve"],
)
def test_means_and_medians_are_those_of_what_is_drawn(sizes):
    diameters = np.sort(drawn(sizes))
    for power in (1, 2, 3):
        assert sizes.mean_power(power) == pytest.approx((diameters**power).mean(), rel=1e-3)
    below = np.cumsum(diameters**3)
    assert sizes.median_by_mass == pytest.approx(diameters[np.searchsorted(below, below[-1] / 2)], rel=2e-3)


def test_few_particles_have_the_mass_of_many():
    """One in each of equal shares of the number: the sample is representative, only its order is random."""
    sizes = lognormal(4e-3, 0.3)
    few = [(sizes.draw(50, np.random.default_rng(seed)) ** 3).mean() for seed in range(20)]
    assert np.mean(few) == pytest.approx(sizes.mean_power(3), rel=0.02)
    assert np.std(few) < 0.06 * sizes.mean_power(3)  # 18 % if each were drawn by itself
    order = sizes.draw(1000, np.random.default_rng(1))
    assert abs(np.corrcoef(order, np.arange(1000))[0, 1]) < 0.1


def test_particles_of_different_sizes_have_a_mean_mass_and_a_typical_size():
    bead = sized(Particle("bead", ASH, 1.0), listed([2e-3, 4e-3], [0.5, 0.5], by="number"))
    assert bead.diameter == 4e-3
    assert bead.smallest_radius == pytest.approx(1e-3)
    one = 720 * math.pi / 6
    assert bead.mean_mass == pytest.approx(one * (2e-3**3 + 4e-3**3) / 2)
    assert bead.typical.diameter == pytest.approx(4e-3)  # eight ninths of the mass
    assert bead.typical.sizes is None
    # the smallest sets the time step
    assert bead.rayleigh_time_step == pytest.approx(Particle("small", ASH, 2e-3).rayleigh_time_step)


def test_a_clump_is_scaled_by_the_diameter_of_its_sphere():
    pellet = sized(clumped("pellet", ASH, row(3, 1e-3, 1e-3)), uniform(3e-3, 6e-3))
    assert pellet.equivalent_diameter == pytest.approx(6e-3)
    whole = clumped("pellet", ASH, row(3, 1e-3, 1e-3))
    factor = 6e-3 / whole.equivalent_diameter
    assert pellet.mass == pytest.approx(factor**3 * whole.mass)
    assert pellet.moments == pytest.approx([factor**5 * one for one in whole.moments])
    assert pellet.diameter == pytest.approx(factor * whole.diameter)
    with pytest.raises(BadInput, match="the largest of its sizes"):
        Particle("bead", ASH, 6e-3, sizes=uniform(3e-3, 5e-3))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: uniform(6e-3, 4e-3),
        lambda: uniform(0.0, 4e-3),
        lambda: uniform(1e-4, 4e-3),
        lambda: normal(1e-3, 1e-3),
        lambda: normal(1e-3, -1e-3),
        lambda: normal(6e-3, 1e-5, smallest=1e-3, largest=2e-3),
        lambda: lognormal(-1e-3, 0.1),
        lambda: lognormal(1e-3, 0.1, smallest=2e-3, largest=1e-3),
        lambda: listed([1e-3], [0.5, 0.5]),
        lambda: listed([1e-3, 1e-3], [0.5, 0.5]),
        lambda: listed([1e-3, 2e-3], [-0.5, 0.5]),
        lambda: sieved([1e-3, 2e-3], [0.5, 0.5]),
        lambda: sieved([1e-3, 2e-3], [0.0]),
        lambda: Sizes((1e-3,), (0.0,)),
        lambda: Sizes((1e-3, 2e-3), (0.0, 0.9)),
        lambda: Sizes((2e-3, 1e-3), (0.0, 1.0)),
    ],
)
def test_impossible_sizes_are_refused(wrong):
    with pytest.raises(BadInput, match="sizes"):
        wrong()
