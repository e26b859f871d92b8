"""Robust statistics against SciPy, closed forms and simulated noise."""

import numpy as np
import pytest
from scipy.stats import median_abs_deviation

from rigtwin.measure.robust import autocorrelation_factor, mad_std


def test_the_deviation_is_that_of_scipy_about_the_median_and_about_zero():
    values = np.random.default_rng(0).normal(2.0, 3.0, (50, 4))
    assert mad_std(values) == pytest.approx(median_abs_deviation(values, None, scale="normal"), rel=1e-5)
    about_zero = median_abs_deviation(values, None, center=lambda each, axis: 0.0, scale="normal")
    assert mad_std(values, centre=0.0) == pytest.approx(about_zero, rel=1e-5)
    assert about_zero > 1.2 * mad_std(values)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_autocorrelation_factor_of_a_first_order_process_is_its_closed_form(rho):
    rng = np.random.default_rng(2)
    series = np.zeros((40, 2000))
    for k in range(1, series.shape[1]):
        series[:, k] = rho * series[:, k - 1] + rng.normal(size=len(series))
    found = np.mean([autocorrelation_factor(each[200:], 200, significance=1.0) for each in series])
    assert found == pytest.approx((1 + rho) / (1 - rho), rel=0.12)


def test_the_sum_of_the_autocorrelation_ends_at_its_first_zero_at_the_given_lag_or_where_it_is_not_significant():
    wave = np.cos(2 * np.pi * np.arange(400) / 40)  # zero at lag 10
    whole = 1 + 2 * sum(np.cos(2 * np.pi * lag / 40) * (1 - lag / 400) for lag in range(1, 10))
    assert autocorrelation_factor(wave, 100) == pytest.approx(whole, rel=0.02)
    assert autocorrelation_factor(wave, 2) == pytest.approx(1 + 2 * np.cos(2 * np.pi / 40), rel=0.01)
    # cos(2 pi lag / 40) < 10 / sqrt(400) from lag 7 on
    part = 1 + 2 * sum(np.cos(2 * np.pi * lag / 40) * (1 - lag / 400) for lag in range(1, 7))
    assert autocorrelation_factor(wave, 100, significance=10.0) == pytest.approx(part, rel=0.02)


def test_residuals_without_scatter_are_not_correlated():
    assert autocorrelation_factor(np.ones(50), 20) == 1.0
