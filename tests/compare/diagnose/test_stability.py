"""Bootstrap over repetitions: a name that all support is stable, one that depends on a single one is not."""

import numpy as np
import pytest

from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.compare.diagnose.selection.stability import Claim, names, stability
from rigtwin.sim.effects import named

CONDITION = np.repeat([0, 1], 6)


def fitted(effect: str, shares: list[float]) -> Fit:
    """A fit with only the shares of the repetitions in its deviance."""
    nothing = np.zeros(0)
    return Fit(
        terms=(named(effect),) if effect else (), unknowns=(), values=nothing, local=np.zeros((12, 0)), scatter=nothing,
        jitter=0.0, covariance=np.zeros((0, 0)), robust=nothing, deviance=float(sum(shares)), chi2=0.0, objective=0.0,
        pulls={}, residual=np.zeros((0, 2)), speed=np.zeros((0, 2)), seen=np.zeros((0, 2)), converged=True,
        by_run=np.array(shares),
    )  # fmt: skip


BASE = fitted("", [100.0] * 12)


def test_a_name_that_every_repetition_supports_never_loses() -> None:
    drag, shutter = fitted("air_drag", [90.0] * 12), fitted("rolling_shutter", [95.0] * 12)
    found = stability(BASE, Claim(drag), [Claim(shutter)], CONDITION, alarm=16.0)
    assert found is not None
    assert (found.first, found.alarm, found.left_out, found.rival) == (1.0, 1.0, 1.0, "")


def test_a_name_that_depends_on_one_repetition_loses_where_it_is_not_drawn() -> None:
    drag = fitted("air_drag", [40.0, *([100.0] * 11)])
    shutter = fitted("rolling_shutter", [96.0] * 12)
    found = stability(BASE, Claim(drag), [Claim(shutter)], CONDITION, alarm=16.0)
    assert found is not None
    # one of six is drawn at least once with probability 1 - (5/6)^6
    assert found.first == pytest.approx(1 - (5 / 6) ** 6, abs=0.04)
    assert found.rival == names(shutter) == "rolling_shutter"
    assert found.left_out == pytest.approx(11 / 12)


def test_a_fit_to_part_of_the_data_is_not_judged() -> None:
    part = fitted("air_drag", [90.0] * 5)
    assert stability(BASE, Claim(part), [], CONDITION, alarm=16.0) is None


def test_a_name_that_leads_by_its_predicted_coefficient_leads_in_every_resample() -> None:
    drag, shutter = fitted("air_drag", [90.0] * 12), fitted("rolling_shutter", [89.9] * 12)
    for credit, first in ((5.0, 1.0), (0.0, 0.0)):
        found = stability(BASE, Claim(drag, credit), [Claim(shutter)], CONDITION, alarm=16.0)
        assert found is not None
        assert found.first == first
