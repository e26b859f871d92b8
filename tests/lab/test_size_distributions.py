"""Drawn sizes have the moments of their law, and a sieving gives its masses back."""

import math

import numpy as np
import pytest

from rigtwin.lab.errors import BadInput
from rigtwin.lab.size_distributions import Sizes, lognormal, normal, sieved, uniform

COUNT = 200_000


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


def test_sieving_what_was_drawn_gives_the_masses_back():
    meshes, masses = [1e-3, 2e-3, 2.5e-3, 4e-3, 5e-3], [0.2, 0.0, 0.5, 0.3]
    diameters = drawn(sieved(meshes, masses))
    found, _ = np.histogram(diameters, meshes, weights=diameters**3)
    assert found / found.sum() == pytest.approx(masses, abs=0.01)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: uniform(6e-3, 4e-3),
        lambda: uniform(0.0, 4e-3),
        lambda: normal(1e-3, 1e-3),
        lambda: lognormal(-1e-3, 0.1),
        lambda: sieved([1e-3, 2e-3], [0.5, 0.5]),
        lambda: sieved([1e-3, 2e-3], [0.0]),
        lambda: Sizes((1e-3,)),
    ],
)
def test_impossible_sizes_are_refused(wrong):
    with pytest.raises(BadInput, match="sizes"):
        wrong()
