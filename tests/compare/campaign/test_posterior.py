"""Posterior and its parts against closed forms, with linear stand-ins for the emulators."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from rigtwin.compare.campaign.posterior import Parameter, Posterior, Target, correlation, sample, scatter


@dataclass(frozen=True)
class Linear:
    """Stand-in for an emulator: a linear quantity, its uncertainty, linear too, and the scatter of the twin."""

    slope: np.ndarray
    spread: float = 0.0
    spread_slope: float = 0.0
    noise: float = 0.0
    start: float = field(default=0.0)

    def predict(self, unit):
        return self.start + unit @ self.slope, self.spread + self.spread_slope * unit[:, 0]


def target(quantity="angle", value=0.5, std=0.1, repetitions=5, reading=0.0, experiment="heap", method="line"):
    return Target(experiment, quantity, method, "deg", value, std, repetitions, reading)


def column(*values):
    return np.array(values)[:, None]


def test_numbers_of_the_unit_interval_and_values_are_each_others_inverse():
    linear, wide = Parameter("a", 2.0, 6.0), Parameter("b", 0.01, 1.0)
    assert linear.value(np.array([0.0, 0.25, 1.0])) == pytest.approx([2.0, 3.0, 6.0])
    assert linear.unit(np.array([2.0, 3.0, 6.0])) == pytest.approx([0.0, 0.25, 1.0])
    assert wide.value(np.array([0.0, 0.5, 1.0])) == pytest.approx([0.01, 0.1, 1.0])
    assert wide.unit(np.array([0.01, 0.1, 1.0])) == pytest.approx([0.0, 0.5, 1.0])


def test_a_range_of_more_than_a_factor_of_eight_is_logarithmic_unless_a_value_was_measured():
    assert Parameter("a", 0.1, 0.85).logarithmic
    assert not Parameter("a", 0.1, 0.75).logarithmic
    assert not Parameter("a", 0.125, 1.0).logarithmic
    assert not Parameter("a", 0.0, 1.0).logarithmic
    assert not Parameter("a", -1.0, 1.0).logarithmic
    assert not Parameter("a", 0.01, 1.0, 0.5, 0.1).logarithmic


def test_the_prior_of_a_measured_value_is_normal_about_it():
    known = Parameter("a", 0.0, 4.0, 1.0, 0.5)
    unit = np.array([0.0, 0.25, 0.5, 1.0])
    expected = norm(1.0, 0.5).logpdf(4 * unit)
    assert known.log_prior(unit) - known.log_prior(unit[:1]) == pytest.approx(expected - expected[0])
    assert known.log_prior(np.array([0.25])) == 0
    for unknown in (Parameter("a", 0.0, 4.0), Parameter("a", 0.0, 4.0, mean=1.0), Parameter("a", 0.0, 4.0, std=0.5)):
        assert not unknown.log_prior(unit).any()


def test_the_density_of_one_target_is_normal_with_the_variances_of_measurement_and_emulator():
    one = Posterior([Parameter("a", 0, 1)], [target(std=0.1)], [Linear(np.ones(1), 0.05, 0.1)], np.eye(1))
    unit = column(0.2, 0.5, 0.9)
    sigma = np.hypot(0.1, 0.05 + 0.1 * unit[:, 0])
    expected = norm(unit[:, 0], sigma).logpdf(0.5)
    found = one.log_density(unit)
    assert found - found[0] == pytest.approx(expected - expected[0])
    assert one.chi_square(unit) == pytest.approx(((unit[:, 0] - 0.5) / sigma) ** 2)
    assert one.shares(unit)[:, 0] == pytest.approx((0.05 + 0.1 * unit[:, 0]) ** 2 / sigma**2)


def test_a_measured_prior_adds_to_density_and_chi_square():
    plain, known = (
        Posterior([parameter, Parameter("b", 0, 1)], [target()], [Linear(np.array([1.0, 0.5]))], np.eye(1))
        for parameter in (Parameter("a", 0, 2), Parameter("a", 0, 2, 0.8, 0.2))
    )
    unit = np.array([[0.4, 0.3], [0.1, 0.9], [0.8, 0.2]])
    off = (2 * unit[:, 0] - 0.8) / 0.2
    assert known.chi_square(unit) - plain.chi_square(unit) == pytest.approx(off**2)
    assert known.log_density(unit) - plain.log_density(unit) == pytest.approx(-0.5 * off**2)


def test_nothing_lies_outside_of_the_unit_cube_and_its_faces_belong_to_it():
    one = Posterior([Parameter("a", 0, 1), Parameter("b", 0, 1)], [target()], [Linear(np.ones(2))], np.eye(1))
    unit = np.array([[0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0], [-0.01, 0.5], [0.5, 1.01], [0.5, 0.5]])
    found = one.log_density(unit)
    assert np.isfinite(found).tolist() == [True, True, True, True, False, False, True]
    assert (found[4:6] == -math.inf).all()
    assert (one.log_density(unit[4:6]) == -math.inf).all()


def test_targets_that_err_together_and_conventions_that_they_share_enter_the_covariance():
    targets = [
        target("angle", 0.5, 0.1, reading=0.3),
        target("height", 0.6, 0.2),
        target("angle", 0.4, 0.1, reading=0.2, experiment="bed"),
        target("angle", 0.4, 0.1, reading=0.2, experiment="bed", method="apex"),
    ]
    together = np.eye(4)
    together[0, 1] = together[1, 0] = 0.6
    emulators = [Linear(np.array([slope]), 0.05) for slope in (1.0, 0.5, 0.8, 0.3)]
    found = Posterior([Parameter("a", 0, 1)], targets, emulators, together)
    covariance = np.diag([0.01, 0.04, 0.01, 0.01]) + np.diag([0.09, 0, 0.04, 0.04]) + 0.05**2 * np.eye(4)
    covariance[0, 1] = covariance[1, 0] = 0.6 * 0.1 * 0.2
    covariance[0, 2] = covariance[2, 0] = 0.3 * 0.2  # the same quantity, read by the same method
    unit = column(0.2, 0.5, 0.7)
    expected = [
        multivariate_normal(np.array([1.0, 0.5, 0.8, 0.3]) * at, covariance).logpdf([one.value for one in targets])
        for at in unit[:, 0]
    ]
    density = found.log_density(unit)
    assert density - density[0] == pytest.approx(np.array(expected) - expected[0])
    assert found.shares(unit) == pytest.approx(np.tile(0.05**2 / np.diag(covariance), (3, 1)))


def test_the_twins_scatter_counts_as_four_degrees_of_freedom_beside_the_repetitions():
    assert scatter(target(std=0.3, repetitions=2), 0.4 * math.sqrt(2)) == pytest.approx(0.5), "two: added"
    assert scatter(target(std=0.1, repetitions=3), 0.3) == pytest.approx(math.sqrt((2 * 0.1**2 + 4 * 0.3**2 / 3) / 6))
    assert scatter(target(std=0.1, repetitions=9), 0.6) == pytest.approx(math.sqrt((8 * 0.1**2 + 4 * 0.2**2) / 12))
    noisy = Posterior(
        [Parameter("a", 0, 1)], [target(std=0.3, repetitions=1)], [Linear(np.ones(1), noise=0.4)], np.eye(1)
    )
    assert noisy.chi_square(column(0.0)) == pytest.approx([(0.5 / 0.5) ** 2])


def test_a_quantity_that_never_scatters_has_a_density_nevertheless():
    exact = Posterior([Parameter("a", 0, 1)], [target(value=2.0, std=0.0)], [Linear(np.zeros(1), start=2.0)], np.eye(1))
    assert exact.chi_square(column(0.3)) == pytest.approx([0.0])
    assert np.isfinite(exact.log_density(column(0.3))).all()


def residuals_of(together, runs=400):
    random = np.random.default_rng(1)
    first, other = random.normal(size=(2, runs))
    return first, together * first + math.sqrt(1 - together**2) * other


def test_only_quantities_of_one_experiment_that_vary_correlate():
    constant, angle, height, bed = (
        target("mass", experiment="scale"), target("angle"), target("height"), target("height", experiment="bed")
    )  # fmt: skip
    first, second = residuals_of(-0.7)
    residuals = {constant: np.zeros(400), angle: 3 * first, height: 0.1 * second, bed: first}
    found = correlation([constant, angle, height, bed], residuals)
    expected = np.eye(4)
    expected[1, 2] = expected[2, 1] = np.corrcoef(first, second)[0, 1]
    assert found == pytest.approx(expected, abs=0.02)
    assert np.diag(found) == pytest.approx(np.ones(4))
    flat = target("width")
    widened = correlation([angle, flat, height], residuals | {flat: np.full(400, 2.0)})
    assert widened[0, 2] == pytest.approx(found[1, 2])
    assert not widened[1, [0, 2]].any()


@pytest.mark.parametrize(("missing", "counts"), [(20, True), (21, False)])
def test_a_quantity_that_four_of_five_twins_give_correlates(missing, counts):
    first, second = residuals_of(0.8, runs=100)
    second[:missing] = np.nan
    found = correlation([target("angle"), target("height")], {target("angle"): first, target("height"): second})
    assert (found[0, 1] > 0.6) == counts
    assert (found[0, 1] == 0) != counts


def test_no_run_in_common_leaves_quantities_uncorrelated():
    nothing = np.full(10, np.nan)
    assert (correlation([target("angle"), target("height")], {target(name): nothing for name in ("angle", "height")})
            == np.eye(2)).all()  # fmt: skip


def test_samples_have_mean_and_deviation_of_a_normal_posterior():
    known = Parameter("a", 0.0, 2.0, 1.2, 0.1)
    measured = Posterior([known], [target(value=0.5, std=0.04)], [Linear(np.ones(1), 0.03)], np.eye(1))
    samples, density, converged = sample(measured, seed=2, most=7200)
    precision = np.array([1 / 0.05**2, 1 / 0.05**2])  # of the measurement, and of the prior in the unit interval
    assert converged
    assert samples.mean() == pytest.approx(precision @ [0.5, 0.6] / precision.sum(), abs=0.003)
    assert samples.std() == pytest.approx(1 / math.sqrt(precision.sum()), rel=0.06)
    assert density == pytest.approx(measured.log_density(samples))


def test_a_chain_ends_after_its_steps_and_says_that_it_has_not_converged():
    one = Posterior([Parameter("a", 0, 1)], [target(std=0.05)], [Linear(np.ones(1))], np.eye(1))
    samples, density, converged = sample(one, seed=1, most=900)
    # 32 walkers, of whose 900 steps the first third is left out and every fifth kept
    assert samples.shape == (32 * 120, 1)
    assert density.shape == (32 * 120,)
    assert not converged
    again, _, _ = sample(one, seed=1, most=900)
    assert (samples == again).all()


def test_walkers_start_in_both_of_two_equally_good_places():
    @dataclass(frozen=True)
    class Valley(Linear):
        def predict(self, unit):
            return (2 * unit[:, 0] - 1) ** 2, np.zeros(len(unit))

    two = Posterior([Parameter("a", 0, 1)], [target(value=0.36, std=0.02)], [Valley(np.ones(1))], np.eye(1))
    samples, _, _ = sample(two, seed=1, most=900)
    assert 0.15 < np.mean(samples < 0.5) < 0.85
    assert np.mean(np.abs(np.abs(samples - 0.5) - 0.3) < 0.05) > 0.99
