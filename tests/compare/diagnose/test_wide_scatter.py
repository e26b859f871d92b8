"""Scatter between repetitions that is larger than in a usual experiment."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rigtwin.compare.diagnose.diagnosis import Diagnosis, _with_scatter
from rigtwin.compare.diagnose.models.scattered import Scattered
from rigtwin.sim.effects import named


@pytest.mark.parametrize(("std", "verdict"), [(0.01, "named"), (0.05, "named"), (0.9, "unlisted")])
def test_an_effect_that_needs_an_absurd_scatter_explains_nothing(std, verdict):
    bench = SimpleNamespace(
        scattered=[Scattered("scale of the picture", "1", 0.02)],
        scatter=np.zeros((6, 1), dtype=int),
        condition=np.repeat([0, 1], 3),
        condition_names=["a", "b"],
    )
    fitted = SimpleNamespace(scatter=np.array([std]))
    chosen = SimpleNamespace(fitted=fitted, terms=(named("perspective"),))
    found = Diagnosis(SimpleNamespace(title="t", rig="drop"), "named", "perspective explains the disagreement")
    judged = _with_scatter(bench, replace(found, chosen=chosen), fitted)
    assert judged.verdict == verdict
    assert ("the repetitions scatter more than usual" in judged.reason) == (std > 0.02)
