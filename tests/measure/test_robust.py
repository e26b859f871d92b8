"""Robust statistics against SciPy, closed forms and simulated noise."""

import numpy as np
import pytest
from scipy.stats import median_abs_deviation

from rigtwin.measure.robust import autocorrelation_factor, mad_std, robust_linear_fit, third_differences


def test_the_deviation_is_that_of_scipy_for_any_axis_and_centre():
    values = np.random.default_rng(0).normal(2.0, 3.0, (50, 4))
    for axis in (None, 0, 1):
        assert mad_std(values, axis) == pytest.approx(median_abs_deviation(values, axis, scale="normal"), rel=1e-5)
    about_zero = median_abs_deviation(values, None, center=lambda each, axis: 0.0, scale="normal")
    assert mad_std(values, centre=0.0) == pytest.approx(about_zero, rel=1e-5)


@pytest.mark.parametrize("uneven", [False, True])
def test_third_differences_keep_the_noise_and_nothing_of_a_parabola(uneven):
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.choice([1, 2, 5], 4000) if uneven else np.ones(4000)) / 240
    path = np.column_stack([0.3 * time, 2 + time - 4.9 * time**2])
    assert np.abs(third_differences(time, path)).max() < 1e-8 * np.abs(path).max()
    third = third_differences(time, path + rng.normal(0, 1e-2, path.shape))
    assert third.shape == (len(time) - 3, 2)
    assert third.std(axis=0) == pytest.approx([1e-2, 1e-2], rel=0.05)


def test_third_differences_of_too_few_or_equal_times_are_left_out():
    assert third_differences(np.arange(3.0), np.zeros((3, 2))).shape == (0, 2)
    assert third_differences(np.array([0.0, 1.0, 1.0, 2.0, 3.0, 4.0]), np.zeros(6)).shape == (1,)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_autocorrelation_factor_of_a_first_order_process_is_its_closed_form(rho):
    rng = np.random.default_rng(2)
    series = np.zeros((40, 2000))
    for k in range(1, series.shape[1]):
        series[:, k] = rho * series[:, k - 1] + rng.normal(size=len(series))
    found = np.mean([autocorrelation_factor(each[200:]) for each in series])
    assert found == pytest.approx((1 + rho) / (1 - rho), rel=0.12)


def test_a_record_without_scatter_is_not_correlated():
    assert autocorrelation_factor(np.zeros(0)) == autocorrelation_factor(np.ones(50)) == 1.0


def test_a_robust_line_ignores_a_fifth_of_outliers_and_its_covariance_is_that_of_the_rest():
    rng = np.random.default_rng(3)
    x = np.linspace(-1, 1, 500)
    design = np.column_stack([np.ones_like(x), x])
    y = design @ [0.5, 2.0] + rng.normal(0, 0.01, len(x))
    y[::5] += rng.uniform(1, 3, len(y[::5]))
    fit = robust_linear_fit(design, y, np.full(len(x), 0.01**-2))
    plain = np.linalg.inv(design.T @ design) * 0.01**2
    assert fit.answer == pytest.approx([0.5, 2.0], abs=5 * np.sqrt(plain[1, 1]))
    assert fit.scale == pytest.approx(0.01, rel=0.5)
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(np.sqrt(np.diag(plain)), rel=0.3)


def test_a_prior_decides_where_the_data_say_nothing():
    design = np.column_stack([np.ones(5), np.zeros(5)])
    fit = robust_linear_fit(
        design, np.full(5, 3.0), np.ones(5), scale=1.0, prior=(np.array([0.0, 7.0]), np.array([0.0, 4.0]))
    )
    assert fit.answer == pytest.approx([3.0, 7.0])
    assert fit.covariance[1, 1] == pytest.approx(0.25)
