"""How much the angle of a drum scatters from moment to moment, and how often few moments' 95 % intervals hold the mean.

    python benchmarks/measure/drum_moments.py [--kept FOLDER]

Twins of drums that differ in bead, wall, width, depth, speed and fill are looked at 150 times in a turn.  Those of
`CALIBRATION` give the constants of `rigtwin.measure.drum.evaluate`: ONE_MOMENT, PRIOR and MEMORY.  Those of
`HELD_OUT` did not: from each, sets of 1, 2, 3 and 5 moments and short films are drawn and evaluated, and their
intervals compared with the mean over the whole record.  Simulated profiles are kept in the folder `--kept`.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rigtwin.benchmarks.figures import OUT, Row, against, below, report, small
from rigtwin.lab.quantity import Quantity
from rigtwin.lab.records import Profile
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import Drum
from rigtwin.measure.drum import evaluate as ruler
from rigtwin.sim import drum

Array = npt.NDArray[np.float64]
Key = tuple[str, str]


@dataclass(frozen=True)
class Case:
    """A drum; sizes in bead diameters."""

    bead: str
    wall: str
    wide: float
    deep: float
    rpm: float
    fill: float
    turns: float
    seed: int

    def __str__(self) -> str:
        return f"{self.bead} in {self.wall}, {self.wide:g} beads wide, {self.deep:g} deep, {self.rpm:g} rpm"


CALIBRATION = (
    Case("D12", "steel", 11.5, 5, 5, 0.35, 2, 1),
    Case("D12", "steel", 16, 5, 10, 0.35, 3, 2),
    Case("D6", "steel", 12, 6, 15, 0.30, 3, 3),
    Case("D6_ABS", "steel", 16, 5, 15, 0.35, 3, 4),
    Case("D12", "steel", 24, 5, 10, 0.35, 2, 5),
    Case("D12", "PMMA", 20, 10, 12, 0.30, 2, 9),
    Case("D6", "steel", 22.6, 5, 6, 0.35, 1.5, 10),
    Case("D12", "steel", 34, 4, 8, 0.30, 2, 14),
    Case("D12", "steel", 24, 5, 20, 0.35, 3, 15),
    Case("D6_ABS", "steel", 30, 4, 15, 0.30, 2, 18),
)
HELD_OUT = (
    Case("D12", "PMMA", 14, 4, 20, 0.45, 3, 7),
    Case("D6", "PMMA", 20, 5, 10, 0.25, 2, 8),
    Case("D12", "steel", 28, 5, 8, 0.35, 2, 11),
    Case("D6_ABS", "steel", 12, 8, 10, 0.40, 3, 13),
    Case("D12", "aluminum", 22, 6, 15, 0.30, 2, 16),
    Case("D6_ABS", "steel", 26, 4, 20, 0.30, 2, 17),
    Case("D12", "steel", 44, 4, 6, 0.30, 1.5, 19),
    Case("D12", "PMMA", 38, 4, 8, 0.30, 1.5, 20),
    # on smooth steel the whole bed slides and sways: its scatter is not set by its beads
    Case("D5_steel", "steel", 18, 5, 15, 0.30, 3, 6),
    Case("D5_steel", "steel", 14, 6, 20, 0.40, 3, 12),
)
TINY = (Case("D12", "steel", 10, 3, 20, 0.35, 1.2, 1),)  # in place of both with SMOKE=1
CALIBRATED, HELD = small((CALIBRATION, HELD_OUT), (TINY, TINY))

LOOKS = 150  # in a turn
SETTLED = 0.3  # turns, after which the flow is steady
SETS = small(300, 20)  # of moments, of each drum
MOMENTS = (1, 2, 3, 5)
MAIN: Key = (ruler.GRAPHICAL, ruler.MIDDLE)


@dataclass(frozen=True)
class Record:
    """The steady part of a drum's twin."""

    case: Case
    profiles: tuple[Profile, ...]
    times: Array  # [s]
    diameter: float  # [m], of the drum

    @property
    def speed(self) -> float:
        """[rad/s]"""
        return self.case.rpm * math.pi / 30

    def evaluated(self, chosen: Sequence[int] | None = None) -> dict[Key, Quantity]:
        """Angles of all profiles, or of those that are chosen, by quantity and method."""
        picked = range(len(self.times)) if chosen is None else chosen
        found = ruler.evaluate(
            [self.profiles[k] for k in picked],
            self.times[list(picked)],
            drum_diameter=self.diameter,
            speed=self.speed,
            bead_diameter=self.diameter / self.case.wide,
        )
        return {(q.quantity, q.method): q for q in found.quantities if q.quantity in ruler.OF_SURFACE}


def record(case: Case, kept: Path) -> Record:
    """The drum's twin, simulated unless it is kept from before."""
    particle = hlosta2020.particle(case.bead)
    bead = particle.equivalent_diameter
    rig = Drum(case.wide * bead, case.rpm * math.pi / 30, case.deep * bead, case.fill)
    file = kept / f"{'-'.join(f'{each}' for each in astuple(case))}.npz"
    if not file.exists():
        among, on_wall = hlosta2020.contact(case.bead, case.bead), hlosta2020.contact(case.bead, case.wall)
        run = drum.run(
            rig, particle, hlosta2020.material(case.wall), among, on_wall, turns=case.turns,
            interval=60 / case.rpm / LOOKS, seed=case.seed, device="cpu",
        )  # fmt: skip
        kept.mkdir(parents=True, exist_ok=True)
        heights = np.array([profile.height for profile in run.profiles])
        np.savez_compressed(file, time=run.time, x=run.profiles[0].x, height=heights)
    with np.load(file) as found:
        steady = found["time"] > SETTLED * 60 / case.rpm
        x, heights, times = found["x"], found["height"][steady], found["time"][steady]
    profiles = tuple(Profile(x, height, np.zeros(len(x)), None, "end") for height in heights)
    return Record(case, profiles, times, rig.diameter)


def scatter(records: Sequence[Record]) -> list[Row]:
    """The constants, from the drums of the calibration."""
    rows, found = [], [(each, each.evaluated()) for each in records]
    deviations = {
        key: np.array([float(angles[key].detail["standard_deviation"]) for _, angles in found])  # type: ignore[arg-type]
        for key in ruler.ONE_MOMENT
    }
    wide = np.array([each.case.wide for each, _ in found])
    for (each, angles), deviation in zip(found, deviations[MAIN], strict=True):
        usual = ruler.one_moment(MAIN, 1 / each.case.wide)
        turns = each.speed * np.ptp(each.times) / (2 * math.pi)
        memory = turns / float(angles[MAIN].detail["independent_frames"])  # type: ignore[arg-type]
        rows.append(
            Row(f"scatter of one moment, {each.case}", deviation, "deg", usual, note=f"memory {memory:.3f} turns")
        )
    if len(records) > 1:
        slope = float(np.polyfit(np.log(wide), np.log(deviations[MAIN]), 1)[0])
        rows.append(against("exponent of bead over drum diameter", -slope, 1.0, absolute=0.25))
    ratios = []
    for key, deviation in deviations.items():
        ratio = np.log(deviation * wide / ruler.ONE_MOMENT[key])
        ratios.append(ratio)
        root = ruler.ONE_MOMENT[key] * math.exp(float(np.mean(ratio)))
        name = f"scatter of one moment times drum over bead diameter, {key[0]}, {key[1]}"
        rows.append(against(name, root, ruler.ONE_MOMENT[key], relative=0.1, unit="deg"))
    if len(records) > 1:
        # the logarithm of a standard deviation known by f degrees of freedom scatters by 1 / sqrt(2 f)
        spread = math.sqrt(float(np.mean([np.var(ratio, ddof=1) for ratio in ratios])))
        note = f"as {1 / (2 * spread**2):.1f} degrees of freedom have"
        rows.append(below("spread of the scatter between drums", spread, 1 / math.sqrt(2 * ruler.PRIOR), note=note))
    return rows


def published() -> list[Row]:
    """Scatter of repeated measurements of drums 140 mm wide (Hlosta et al. 2020, table 14), read off by eye."""
    rows = []
    for each in hlosta2020.table(14):
        if each["rig"] == "drum_140mm_3rpm" and str(each["particle"]).startswith("D"):
            bead = hlosta2020.particle(str(each["particle"])).diameter
            usual = ruler.one_moment(MAIN, bead / 0.14)
            rows.append(Row(f"published repetitions, {each['particle']}", float(each["aor_exp_std_deg"]), "deg", usual))
    return rows


def coverage(records: Sequence[Record]) -> list[Row]:
    """How often intervals from few moments hold the mean over the record, on drums that are not in the calibration."""
    hits: dict[tuple[Key, int], list[bool]] = {}
    by_drum: dict[tuple[Case, int], list[bool]] = {}
    for each in records:
        rng, truth = np.random.default_rng(1), each.evaluated()
        apart = math.ceil(ruler.MEMORY * LOOKS)
        for count in MOMENTS:
            for _ in range(SETS):
                # at even intervals, as odd ones fail a check of the record
                step = int(rng.integers(apart, max((len(each.times) - 1) // max(count - 1, 1), apart) + 1))
                start = int(rng.integers(max(len(each.times) - (count - 1) * step, 1)))
                for key, q in each.evaluated(range(len(each.times))[start::step][:count]).items():
                    # moments are off the mean of a record that they are part of by less than off the true mean
                    share = min(count / float(truth[key].detail["independent_frames"]), 0.5)  # type: ignore[arg-type]
                    off = abs(q.value - truth[key].value) / math.sqrt(1 - share)
                    hit = off < q.value - q.interval95[0]
                    hits.setdefault((key, count), []).append(hit)
                    if key == MAIN:
                        by_drum.setdefault((each.case, count), []).append(hit)
    rows = []
    for (key, count), each in sorted(hits.items()):
        share, name = float(np.mean(each)), f"{_counted(count)}, {key[0]}, {key[1]}: 95 % intervals"
        note = f"{len(each)} sets of {len(records)} drums"
        rows.append(Row(name, share, "1", 0.95, "0.90 to 0.99", 0.90 <= share <= 0.99, note))
    for (case, count), each in by_drum.items():
        rows.append(Row(f"{_counted(count)}, {case}: 95 % intervals", float(np.mean(each)), "1", 0.95))
    return rows


def _counted(count: int) -> str:
    return f"{count} moment{'' if count == 1 else 's'}"


def films(records: Sequence[Record]) -> list[Row]:
    """The same for the line over the middle half in short films, whose neighbouring frames are alike."""
    rows = []
    for turns in (0.06, 0.1, 0.2, 0.4):
        rng, hits, count = np.random.default_rng(2), [], round(turns * LOOKS)
        for each in records:
            truth = each.evaluated()[MAIN]
            for start in rng.integers(len(each.times) - count, size=SETS // 5):
                q = each.evaluated(range(start, start + count))[MAIN]
                off = abs(q.value - truth.value) / math.sqrt(1 - count / len(each.times))
                hits.append(off < q.value - q.interval95[0])
        note = f"{len(hits)} films of {len(records)} drums"
        rows.append(Row(f"films of {turns:g} turns: 95 % intervals", float(np.mean(hits)), "1", 0.95, note=note))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kept", type=Path, default=OUT / "drum_moments")
    kept = parser.parse_args(arguments).kept
    calibrated = [record(case, kept) for case in CALIBRATED]
    held = [record(case, kept) for case in HELD]
    return report("bench-drum-moments", [*scatter(calibrated), *published(), *coverage(held), *films(held)])


if __name__ == "__main__":
    sys.exit(main())
