"""Emulator against closed forms of Gaussian processes, and first-order indices of functions that are known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from rigtwin.compare.campaign.emulator import Emulator, fit, main_effects


def one_run(*, amplitude=2.0, white=0.5, value=1.5, mean=10.0, std=4.0):
    """A process of correlation length 0.5 that knows the value at 0.25 of the second parameter alone."""
    inverse = np.array([[1 / (amplitude + white)]])
    return Emulator(
        columns=np.array([1]), lengths=np.array([0.5]), amplitude=amplitude, points=np.array([[0.25 / 0.5]]),
        inverse=inverse, weights=inverse @ np.array([value]), mean=mean, std=std, fitted_noise=0.3,
    )  # fmt: skip


def test_a_process_with_one_run_returns_to_its_mean_away_from_it():
    at = np.array([0.25, 0.75, 0.0])
    mean, spread = one_run().predict(np.column_stack([[0.9, 0.1, 0.5], at]))
    kernel = 2.0 * np.exp(-0.5 * ((at - 0.25) / 0.5) ** 2)
    assert mean == pytest.approx(10 + 4 * kernel / 2.5 * 1.5)
    assert spread == pytest.approx(4 * np.sqrt(2.0 - kernel**2 / 2.5))
    assert one_run().noise == pytest.approx(0.3)


def test_a_run_further_off_than_expected_widens_both_uncertainties():
    far = one_run(value=5.0)
    assert one_run().widened == 1.0, "1.5 of an expected deviation of sqrt 2.5"
    assert far.widened == pytest.approx(5 / math.sqrt(2.5))
    unit = np.array([[0.5, 0.6]])
    assert far.predict(unit)[1] == pytest.approx(far.widened * one_run().predict(unit)[1])
    assert far.noise == pytest.approx(0.3 * far.widened)


@pytest.fixture(scope="module")
def fitted():
    unit = np.random.default_rng(3).random((20, 3))
    values = 5 + np.sin(4 * unit[:, 2]) + 0.5 * unit[:, 0] + 0.1 * np.random.default_rng(4).normal(size=20)
    return unit, values, fit(unit, values, seed=1, columns=[0, 2])


def test_the_fitted_covariance_is_that_of_a_gaussian_kernel_and_the_scatter(fitted):
    unit, values, emulator = fitted
    assert emulator.columns.tolist() == [0, 2]
    assert (emulator.mean, emulator.std) == (pytest.approx(np.mean(values)), pytest.approx(np.std(values)))
    apart = (unit[:, None, [0, 2]] - unit[None, :, [0, 2]]) / emulator.lengths
    covariance = emulator.amplitude * np.exp(-0.5 * np.sum(apart**2, axis=-1))
    covariance += (emulator.fitted_noise / emulator.std) ** 2 * np.eye(20)
    assert np.linalg.inv(emulator.inverse) == pytest.approx(covariance, abs=1e-6)
    assert covariance @ emulator.weights == pytest.approx((values - emulator.mean) / emulator.std)
    assert emulator.points * emulator.lengths == pytest.approx(unit[:, [0, 2]])


def test_a_parameter_that_the_twin_does_not_have_changes_nothing(fitted):
    unit, values, emulator = fitted
    other = unit.copy()
    other[:, 1] = 0.123
    for one, two in zip(emulator.predict(unit), emulator.predict(other), strict=True):
        assert one == pytest.approx(two)
    assert len(fit(unit, values, seed=1).lengths) == 3


def test_predictions_are_those_of_the_library_that_fits(fitted):
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    unit, values, emulator = fitted
    kernel = ConstantKernel(emulator.amplitude) * RBF(emulator.lengths)
    kernel += WhiteKernel((emulator.fitted_noise / emulator.std) ** 2)
    process = GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True).fit(unit[:, [0, 2]], values)
    at = np.random.default_rng(5).random((50, 3))
    mean, deviation = process.predict(at[:, [0, 2]], return_std=True)
    found, spread = emulator.predict(at)
    assert found == pytest.approx(mean)
    # the library adds the scatter of a run to the uncertainty of the mean
    assert np.hypot(spread / emulator.widened, emulator.fitted_noise) == pytest.approx(deviation, rel=1e-4)


def test_each_run_left_out_in_turn_lies_as_far_off_as_the_widening_says(fitted):
    unit, values, emulator = fitted
    values = values.copy()
    values[3] += 2.0
    scaled = (values - emulator.mean) / emulator.std
    covariance = np.linalg.inv(emulator.inverse)
    off = []
    for k in range(len(unit)):
        rest = np.arange(len(unit)) != k
        weights = np.linalg.solve(covariance[np.ix_(rest, rest)], covariance[rest, k])
        variance = covariance[k, k] - weights @ covariance[rest, k]
        off.append((scaled[k] - weights @ scaled[rest]) / math.sqrt(variance))
    disturbed = Emulator(
        emulator.columns, emulator.lengths, emulator.amplitude, emulator.points, emulator.inverse,
        emulator.inverse @ scaled, emulator.mean, emulator.std, emulator.fitted_noise,
    )  # fmt: skip
    assert np.sqrt(np.mean(np.square(off))) > 1
    assert disturbed.widened == pytest.approx(np.sqrt(np.mean(np.square(off))))


def test_an_exact_law_keeps_a_hundredth_of_scatter_and_an_idle_parameter_the_longest_length():
    unit = np.random.default_rng(6).random((24, 2))
    emulator = fit(unit, 2 + 3 * unit[:, 0], seed=1)
    assert emulator.fitted_noise == pytest.approx(0.01 * emulator.std, rel=1e-3)
    assert emulator.lengths[1] == pytest.approx(10.0, rel=1e-3)
    mean, spread = emulator.predict(np.array([[0.5, 0.5]]))
    assert mean == pytest.approx([3.5], abs=0.01)
    assert 0 < spread[0] < 0.02


def test_values_that_jump_from_run_to_run_do_not_shorten_the_length_below_its_bound():
    unit = np.linspace(0, 1, 24)[:, None]
    emulator = fit(unit, np.sin(40 * unit[:, 0]), seed=1)
    assert emulator.lengths[0] >= 0.15 * (1 - 1e-6)


def test_a_quantity_that_is_the_same_in_all_runs_stays_so_without_uncertainty():
    emulator = fit(np.random.default_rng(7).random((10, 2)), np.full(10, 3.0), seed=1)
    mean, spread = emulator.predict(np.array([[0.1, 0.9], [0.5, 0.5]]))
    assert mean == pytest.approx([3.0, 3.0])
    assert spread == pytest.approx([0.0, 0.0])
    assert emulator.noise == 0
    assert not main_effects(emulator, 2, seed=1).any()


def indices(function, parameters, mean, **more):
    stand_in = SimpleNamespace(predict=lambda unit: (function(unit), np.zeros(len(unit))), mean=mean)
    return main_effects(stand_in, parameters, seed=1, **more)


def test_main_effects_are_the_shares_of_the_variance_of_a_sum():
    found = indices(lambda unit: 7 + 3 * unit[:, 0] + unit[:, 1], 3, 9.0)
    assert found == pytest.approx([0.9, 0.1, 0.0], abs=0.01)
    # of x + x y with x, y uniform: Var of 1.5 x and of y / 2 over that of the whole
    whole = 1 / 3 * (1 + 1 + 1 / 3) - 0.75**2
    product = indices(lambda unit: unit[:, 0] + unit[:, 0] * unit[:, 1], 2, 0.75, number=2048)
    assert product == pytest.approx([1.5**2 / 12 / whole, 0.5**2 / 12 / whole], abs=0.01)


def test_main_effects_of_a_pure_interaction_are_none_and_never_negative():
    found = indices(lambda unit: (unit[:, 0] - 0.5) * (unit[:, 1] - 0.5), 2, 0.0)
    assert found == pytest.approx([0.0, 0.0], abs=0.02)
    assert (found >= 0).all()
    assert (indices(lambda unit: unit[:, 0], 1, 0.5) <= 1).all()
