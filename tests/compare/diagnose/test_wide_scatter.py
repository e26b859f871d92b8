"""Scatter between repetitions that is larger than in a usual experiment."""

from types import SimpleNamespace

import numpy as np
import pytest

from rigtwin.compare.diagnose.diagnosis import Diagnosis, _with_scatter
from rigtwin.compare.diagnose.models.scattered import Scattered
from rigtwin.sim.effects import named


@pytest.mark.parametrize(
    ("std", "effect", "repeated", "given", "verdict"),
    [
        (0.01, "perspective", True, "named", "named"),
        (0.39, "perspective", True, "named", "named"),
        (0.41, "perspective", True, "named", "unlisted"),
        (0.41, "perspective", True, "indistinguishable", "unlisted"),
        (0.41, "perspective", False, "named", "undecided"),  # what happened once may be scatter
        (0.41, "odd_shape", True, "named", "named"),  # it is a scatter itself
    ],
)
def test_an_effect_that_needs_an_absurd_scatter_explains_nothing(std, effect, repeated, given, verdict):
    """The usual scatter of the scale is 0.02, twenty times as much is a misfit."""
    condition = np.repeat([0, 1], 3) if repeated else np.arange(6)
    bench = SimpleNamespace(
        scattered=[Scattered("scale of the picture", "1", 0.02)],
        scatter=np.zeros((6, 1), dtype=int),
        condition=condition,
        condition_names=[str(number) for number in np.unique(condition)],
    )
    fitted = SimpleNamespace(scatter=np.array([std]))
    chosen = SimpleNamespace(fitted=fitted, terms=(named(effect),))
    found = Diagnosis(SimpleNamespace(title="t", rig="drop"), given, "it explains the disagreement", chosen=chosen)
    judged = _with_scatter(bench, found, fitted)
    assert judged.verdict == verdict
    assert ("the repetitions scatter more than usual" in judged.reason) == (std > 0.02)
