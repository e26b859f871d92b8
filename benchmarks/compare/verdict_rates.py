"""How often a twin that is wrong is called different, and one that is right, with one repetition of each.

    python benchmarks/compare/verdict_rates.py

Every lab has one experiment: a rig is drawn, true values of its results, the scatter from repetition to repetition of
each result, what the measurement adds, and whether the twin is right or off by 30 % or more.  The lab is then judged by
`rigtwin.compare.deviation.deviations` as `rigtwin compare` does, and called different if one of its results is.  The
scatter is not the prior: it is 0.5 to 2 times the published one, evenly in the logarithm, and the same for heap and
twin where runs of the twin scatter.  `SEED=7 COUNT=400` in the environment draw other labs and fewer of them.  Labs
with more repetitions show that own scatter takes over.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigtwin.benchmarks.figures import Row, report, small
from rigtwin.compare.chosen import known_scatter
from rigtwin.compare.deviation import Deviation, deviations, is_result
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.camera import Camera
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.reference.repetition_scatter import published_scatter
from rigtwin.lab.rig_quantities import RigQuantity, quantities_of
from rigtwin.lab.rigs import (
    DropSettings,
    DrumSettings,
    HopperSettings,
    PackingSettings,
    PendulumSettings,
    PileSettings,
    RigSettings,
    TiltSettings,
)

SEED = int(os.environ.get("SEED", "1"))
COUNT = int(os.environ.get("COUNT", str(small(32000, 40))))  # of labs; shares of few labs are chance
RIGS: tuple[RigSettings, ...] = (
    DropSettings(),
    PendulumSettings(0.2),
    PendulumSettings(0.2, variant="wall"),
    TiltSettings("slide"),
    TiltSettings("roll"),
    PackingSettings(0.065),
    PileSettings(0.09),
    DrumSettings(0.14, 0.3),
    HopperSettings("slot", outlet=0.03),
)
TRUE = {  # range of true values, in the unit of the quantity
    "restitution_wall": (0.2, 0.75),
    "restitution_pair": (0.4, 0.85),
    "static_friction": (0.15, 0.7),
    "rolling_friction": (0.02, 0.15),
    "bed_height": (0.05, 0.2),
    "bulk_density": (300.0, 900.0),
    "angle_of_repose_graphical": (18.0, 50.0),
    "angle_of_repose_geometric": (20.0, 50.0),
    "discharge_time": (0.5, 4.0),
    "mass_flow_rate": (0.02, 0.2),
}
RECIPROCAL = {"bulk_density": "bed_height", "mass_flow_rate": "discharge_time"}  # results that follow from another one
FACTORS = 0.5, 2.0  # true scatter over the published one
MEASURED = 0.003, 0.03  # relative standard uncertainty of a measurement, half of it shared by all repetitions
OFF = 1.3, 3.0  # true value of a wrong twin over that of the experiment, or the other way round
REPETITIONS = 1, 2, 3, 5
MOST_FALSE, LEAST_FOUND = 0.03, 0.90


@dataclass(frozen=True)
class Drawn:
    """A lab that was drawn, and what the comparison says."""

    rig: str
    off: float  # true value of the twin over that of the experiment, less 1; 0 for one that is right
    rows: Sequence[Deviation]

    @property
    def called(self) -> bool:
        return any(row.verdict.startswith("twin too") for row in self.rows)

    @property
    def perhaps(self) -> bool:
        return any(row.verdict.startswith("twin") for row in self.rows)


def labs(n: int, count: int) -> Iterator[Drawn]:
    """Labs with n repetitions of each result; every other twin is wrong."""
    rng = np.random.default_rng([SEED, n])
    for number in range(count):
        settings = RIGS[int(rng.integers(len(RIGS)))]
        off = _off(rng) if number % 2 else 0.0
        yield _lab(rng, settings, off, n)


def _off(rng: np.random.Generator) -> float:
    """At least 30 % too high, or too low by as much as makes it lower by that factor and at least 30 %."""
    if rng.random() < 0.5:
        return float(_evenly(rng, *OFF)) - 1
    return 1 / float(_evenly(rng, 1 / 0.7, OFF[1])) - 1


def _evenly(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly distributed in the logarithm."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _lab(rng: np.random.Generator, settings: RigSettings, off: float, n: int) -> Drawn:
    particle, wall = hlosta2020.particle("D6"), hlosta2020.material("steel")
    experiment = Experiment("lab", settings, particle, wall, Camera(), ())
    entry = entry_of(experiment)
    measured, simulated = [], []
    runs = n if entry.run_name else 1
    drawn: dict[str, tuple[list[float], list[float], float]] = {}
    for name, kind in quantities_of(settings).items():
        detail = dict(kind.which)
        if name not in TRUE or not is_result(name, detail.get("side")):
            continue
        if name in RECIPROCAL:  # of one bed, or one discharge: no evidence of its own
            values, twins, u = drawn[RECIPROCAL[name]]
            values, twins = [1 / value for value in values], [1 / value for value in twins]
        else:
            truth, u = _evenly(rng, *TRUE[name]), _evenly(rng, *MEASURED)
            scatter = published_scatter(settings.name, name).relative * _evenly(rng, *FACTORS)
            shared, own = u / math.sqrt(2) * rng.normal(), u / math.sqrt(2)
            values = [truth * (1 + scatter * rng.normal() + shared + own * rng.normal()) for _ in range(n)]
            between = scatter if entry.run_name else 0.0
            twins = [truth * (1 + off) * (1 + between * rng.normal()) for _ in range(runs)]
            drawn[name] = values, twins, u
        half = u / math.sqrt(2)
        measured += [_quantity(name, kind, value, {"scale": half, "tracking": half}) for value in values]
        simulated += [_quantity(name, kind, value, {"fit": 1e-3}) for value in twins]
    rows = deviations(
        "lab", settings.name, measured, simulated,
        run_name=entry.run_name, scatter=partial(known_scatter, experiment),
    )  # fmt: skip
    return Drawn(_named(settings), off, rows)


def _quantity(name: str, kind: RigQuantity, value: float, relative: Mapping[str, float]) -> Quantity:
    budget = {part: share * abs(value) for part, share in relative.items()}
    total = math.hypot(*budget.values())
    return Quantity(name, value, total, kind.unit, kind.methods[0], 1, dict(kind.which), budget)


def _named(settings: RigSettings) -> str:
    return " ".join(filter(None, (settings.name, str(getattr(settings, "variant", "")))))


def _share(labs: Sequence[Drawn], what: str = "called") -> float:
    return sum(getattr(one, what) for one in labs) / len(labs) if labs else math.nan


def _rates(n: int, count: int) -> Iterator[Row]:
    drawn = list(labs(n, count))
    right, wrong = [one for one in drawn if not one.off], [one for one in drawn if one.off]
    label = f"{n} repetition{'s' if n > 1 else ''}"
    found, false = _share(wrong), _share(right)
    wanted = n == 1
    yield Row(
        f"{label}: wrong by 30 % or more, called different", found, "1", None,
        f"at least {LEAST_FOUND:g}" if wanted else "", found >= LEAST_FOUND if wanted else None,
        f"{len(wrong)} labs; {_share(wrong, 'perhaps'):.1%} with those called probably different",
    )  # fmt: skip
    yield Row(
        f"{label}: right, called different", false, "1", None,
        f"at most {MOST_FALSE:g}" if wanted else "", false <= MOST_FALSE if wanted else None,
        f"{len(right)} labs; {_share(right, 'perhaps'):.1%} with those called probably different",
    )  # fmt: skip
    if not wanted:
        return
    for low, high in ((0.3, 0.5), (0.5, 1.0), (1.0, math.inf)):
        part = [one for one in wrong if low <= max(one.off, 1 / (1 + one.off) - 1) < high]
        title = (
            f"{label}: wrong by a factor of {1 + low:g} to {1 + high:g}"
            if math.isfinite(high)
            else (f"{label}: wrong by a factor of {1 + low:g} or more")
        )
        yield Row(
            f"{title}, called different", _share(part), note=f"{len(part)} labs" if part else "skipped: none drawn"
        )
    for rig in dict.fromkeys(map(_named, RIGS)):
        mine = [[one for one in some if one.rig == rig] for some in (wrong, right)]
        note = f"{len(mine[0])} wrong, {len(mine[1])} right; right ones called different: {_share(mine[1]):.1%}"
        yield Row(f"{label}: {rig}, wrong, called different", _share(mine[0]), note=note)


def main() -> int:
    rows = [row for n in REPETITIONS for row in _rates(n, COUNT if n == 1 else COUNT // 4)]
    return report("bench-verdicts", rows, seed=SEED, count=COUNT)


if __name__ == "__main__":
    sys.exit(main())
