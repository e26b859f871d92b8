"""How often the diagnosis names what is hidden: fresh labs by seed, `rigtwin diagnose` on each, the truth afterwards.

    python benchmarks/diagnose/verdicts.py [--seed 1] [--count 100] [--kind null] [--rig drop] [--effect air_drag]
        [--keep DIR]

`--kind null --count 300 --processes 1` draws labs in which nothing is hidden, one after the other on one core;
`--confounded` labs of one condition with what others look like, so that further experiments are proposed, and carried
out.  Also `SEED=` and `COUNT=` in the environment.  Labs come from `diagnose_labs.py`; the diagnosis is handed the
lab's folder alone.  Labs, truth and answers stay under `out/bench-diagnose`: a bench that was interrupted goes on where
it stopped, and only what changed code would change is done again.  Prints who was taken for whom and the figures
wanted, and writes `out/bench-diagnose.json`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import multiprocessing
import os
import re
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.benchmarks.diagnose.draw_labs import EVERY_RIG, KINDS, Case, chosen, confounded, plan, write
from rigtwin.benchmarks.diagnose.effect_names import canonical, is_named, true_value
from rigtwin.benchmarks.diagnose.lab_effects import ALL, STRENGTHS
from rigtwin.benchmarks.figures import OUT, SMOKE, Row, report, small

CPU_LIMIT = 600  # [s]
HERE = Path(__file__).resolve().parent
DRAWS = (*sorted(HERE.glob("lab_*.py")), HERE / "draw_labs.py")
ASKED = (HERE.parents[1] / "compare" / "diagnose", HERE.parents[1] / "sim" / "effects")
CLOSES = 0.8  # share of the gap that a right law closes at least
OFF = {"reach": 0.15, "period": 0.1, "low": 0.15, "high": 0.15}  # of a true shape, or of its band's width; or 3 std
SINGLE_RUN_CPU = 120.0  # [s], wanted at most for a lab


@dataclass(frozen=True)
class Answer:
    """What the diagnosis said of one lab."""

    verdict: str
    names: tuple[str, ...] = ()  # most certain first
    together: tuple[tuple[str, ...], ...] = ()  # sets that it cannot tell apart
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)  # by effect
    form: str = ""
    gap: dict[str, float] = field(default_factory=dict)
    cpu: float = math.nan  # [s]
    failure: str = ""
    designs: tuple[dict[str, Any], ...] = ()
    """Further experiments that it proposes, the most telling first."""

    @property
    def candidates(self) -> tuple[str, ...]:
        """The first name and all that it is not distinguished from."""
        if not self.names:
            return tuple(dict.fromkeys(name for group in self.together for name in group))
        alike = [group for group in self.together if self.names[0] in group]
        return tuple(dict.fromkeys([self.names[0], *(name for group in alike for name in group)]))

    @property
    def undecided(self) -> set[str]:
        """All names that it cannot tell from another, a second effect's among them."""
        return {name for group in self.together for name in group}


@dataclass(frozen=True)
class Job:
    """One lab to draw and to diagnose."""

    seed: int
    number: int
    case: Case
    folder: Path
    narrowed: bool
    drawn: str
    """What the draw depends on."""
    asked: str
    """... and the answer."""


@dataclass(frozen=True)
class Result:
    """Truth and answer side by side."""

    truth: dict[str, Any]
    answer: Answer
    after: Answer | None = None
    """What it said once the experiment that it proposed had been carried out too."""

    @property
    def split(self) -> bool:
        """Whether that experiment left fewer names that cannot be distinguished, the true one among them."""
        after = self.after
        if after is None or after.verdict not in ("named", "indistinguishable"):
            return False
        return len(after.undecided) < len(self.answer.undecided) and any(map(self.right, after.candidates))

    @property
    def true_effects(self) -> list[str]:
        return list(self.truth["effects"])

    def right(self, name: str, effect: str | None = None) -> bool:
        """Whether this name means one of the hidden effects (or the given one)."""
        return any(is_named(name, self.truth, true) for true in ([effect] if effect else self.true_effects))

    @property
    def first_right(self) -> bool:
        return self.answer.verdict in ("named", "indistinguishable") and any(map(self.right, self.answer.names[:1]))

    @property
    def in_set(self) -> bool:
        named = self.answer.verdict in ("named", "indistinguishable")
        return named and any(map(self.right, self.answer.candidates))

    @property
    def right_terms(self) -> bool:
        """Whether the formula of an `unlisted` verdict has the terms of the hidden effect, no other, and its shape."""
        stated = frozenset(formula_terms(self.answer.form))
        weak = self.truth["strength"] == "weak"
        return self.answer.verdict == "unlisted" and any(
            stated in map(frozenset, (*effect.terms, *(effect.weak_terms if weak else ())))
            and shape_right(self.answer.form, effect.shape)
            for effect in map(ALL.__getitem__, self.true_effects)
        )

    @property
    def right_law(self) -> bool:
        """Whether it has the right terms, and these close most of the gap on the held-out repetitions."""
        return self.right_terms and (self.closed("held_out") or 0.0) >= CLOSES

    def closed(self, part: str) -> float | None:
        """Share of the excess gap that is closed on the ``held_out`` repetitions, or on the held-out ``condition``;
        0 where nothing was stated that could close it, None where there was next to no gap."""
        gap = self.answer.gap
        before, after = gap.get(f"{part}_before"), gap.get(f"{part}_after")
        floor = gap.get(f"{part}_noise_floor", gap.get("noise_floor", 1.0))
        if before is None or after is None:
            return None if self.answer.names else 0.0
        return 1 - max(after - floor, 0.0) / (before - floor) if before > 1.05 * floor else None

    @property
    def wrong_name(self) -> bool:
        """It named one effect, alone and first, and that was not hidden."""
        return self.answer.verdict == "named" and bool(self.answer.names) and not self.right(self.answer.names[0])


def diagnose(lab: Path) -> dict[str, Any]:
    """The document of a diagnosis of one lab, or why there is none; handed the lab's folder alone."""
    from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab
    from rigtwin.compare.diagnose.diagnosis import diagnose as ask

    def give_up(_signal: int, _frame: Any) -> None:
        raise TimeoutError(f"more than {CPU_LIMIT} s of CPU time")

    signal.signal(signal.SIGPROF, give_up)
    signal.setitimer(signal.ITIMER_PROF, CPU_LIMIT)
    begun = time.process_time()
    try:
        document = ask(read_tracked_lab(lab)).to_json()
    except Exception as error:
        if SMOKE:
            raise
        document = {"verdict": "failed", "failure": f"{type(error).__name__}: {error}"}
    signal.setitimer(signal.ITIMER_PROF, 0)
    return {**document, "cpu_s": time.process_time() - begun}


def fingerprint(*folders: Path) -> str:
    """What the answer depends on: the code in these folders or files."""
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted(folder.rglob("*.py")) if folder.is_dir() else [folder]:
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def formula_terms(form: str) -> tuple[str, ...]:
    """The terms of a formula as the diagnosis words it, without their coefficients.

    >>> formula_terms("force per mass c e_z x v with c = 0.032 ± 0.0002 1/s; force per mass c with c = 1 ± 0.1 m/s^2")
    ('e_z x v', '')
    """
    laws = (part.split(" with ")[0] for part in form.split(";") if part.strip())
    return tuple(re.split(r"(?:^|\s)c(?:\s|$)", law, maxsplit=1)[-1].strip() for law in laws)


def shape_right(form: str, true: Mapping[str, float]) -> bool:
    """Whether the numbers of a formula's shape are the true ones, as far as it states them.

    >>> shape_right("force per mass c exp(-z / reach) with c = -1 ± 0.1 m/s^2, reach = 0.06 ± 0.005 m", {"reach": 0.04})
    False
    """
    stated = {name: (float(value), float(std)) for name, value, std in re.findall(r"(\w+) = (\S+) ± ([\w.+-]+)", form)}
    width = abs(true["high"] - true["low"]) if "high" in true else None
    return all(
        abs(stated[name][0] - size) <= max(OFF[name] * (width or size), 3 * stated[name][1])
        for name, size in true.items()
        if name in stated
    )


def read_answer(document: dict[str, Any]) -> Answer:
    """The parts of a diagnosis.json that are scored."""
    effects = document.get("effects") or []
    return Answer(
        verdict=str(document.get("verdict")),
        names=tuple(str(effect["effect"]) for effect in effects),
        together=tuple(tuple(map(str, group)) for group in document.get("indistinguishable") or []),
        parameters={str(effect["effect"]): effect.get("parameters") or {} for effect in effects},
        form=str(document.get("form") or ""),
        gap={key: float(v) for key, v in (document.get("gap") or {}).items() if isinstance(v, int | float)},
        cpu=float(document.get("cpu_s", math.nan)),
        failure=str(document.get("failure") or ""),
        designs=tuple(document.get("designs") or ()),
    )


# ----------------------------------------------------------------------------------------------------------- figures


def share(results: Sequence[Result], good: Iterable[bool]) -> float:
    flags = list(good)
    return sum(flags) / len(flags) if flags else math.nan


def share_row(name: str, flags: Sequence[bool], *, at_least: float | None = None, at_most: float | None = None) -> Row:
    count, hits = len(flags), sum(flags)
    value = hits / count if count else math.nan
    low, high = _interval(hits, count)
    note = f"{hits} of {count}, 95 %: {low:.0%} to {high:.0%}" if count else "none drawn"
    if not count:
        return Row(name, value, note=note)
    if at_least is not None:
        return Row(name, value, "1", None, f"at least {at_least:.0%}", value >= at_least, note)
    if at_most is not None:
        return Row(name, value, "1", None, f"at most {at_most:.0%}", value <= at_most, note)
    return Row(name, value, note=note)


def _interval(hits: int, count: int) -> tuple[float, float]:
    """Clopper and Pearson's interval of a share."""
    from scipy.stats import beta

    if not count:
        return 0.0, 1.0
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, count - hits + 1))
    high = 1.0 if hits == count else float(beta.ppf(0.975, hits + 1, count - hits))
    return low, high


def figures(results: Sequence[Result]) -> list[Row]:
    """The figures wanted of the diagnosis."""
    of = {kind: [r for r in results if r.truth["kind"] == kind] for kind in KINDS}
    singles = [r for r in of["single"] if not r.truth["unseen"]]
    clear = [r for r in singles if r.truth["strength"] != "weak"]
    weak = [r for r in singles if r.truth["strength"] == "weak"]
    nulls, pairs, unlisted = of["null"], of["pair"], of["unlisted"]
    named = [r for r in singles + pairs if r.first_right]
    not_named = [r for r in unlisted if not r.answer.names]  # what a wrong name closes is no merit
    flights = [r for r in unlisted if r.truth["rig"] == "drop"]
    rows = [
        share_row("no answer", [r.answer.verdict == "failed" for r in results], at_most=0.0),
        share_row("nulls: false alarms", [r.answer.verdict not in ("none", "failed") for r in nulls], at_most=0.02),
        share_row("nulls: an effect named", [r.answer.verdict == "named" for r in nulls], at_most=0.02),
        share_row("clear singles: true name first", [r.first_right for r in clear], at_least=0.95),
        share_row("clear singles: true name in the set", [r.in_set for r in clear], at_least=0.99),
        _set_size(clear),
        share_row("clear singles: wrong name", [r.wrong_name for r in clear], at_most=0.03),
        share_row("weak singles: true name first", [r.first_right for r in weak]),
        share_row("weak singles: wrong name", [r.wrong_name for r in weak], at_most=0.05),
        share_row("listed called unlisted", [r.answer.verdict == "unlisted" for r in singles + pairs], at_most=0.03),
        share_row("unlisted called unlisted", [r.answer.verdict == "unlisted" for r in unlisted], at_least=0.90),
        share_row("unlisted taken for a listed effect", [r.answer.verdict == "named" for r in unlisted]),
        share_row("pairs: both named", [_both(r) for r in pairs], at_least=0.85),
        share_row("pairs: both named, or one of those not distinguished", [_both(r, sets=True) for r in pairs]),
        share_row("pairs: one of them named", [any(map(r.right, r.answer.names)) for r in pairs], at_least=0.98),
        *(
            share_row(
                f"{strength} singles: true name first",
                [r.first_right for r in singles if r.truth["strength"] == strength],
            )
            for strength in STRENGTHS
            if strength != "weak"
        ),
        share_row("next experiment, carried out: set split", [r.split for r in results if r.after], at_least=0.90),
        *_closure(named, "named", "held_out", 0.9),
        *_closure(named, "named", "condition", 0.8),
        share_row("unlisted forces in flight: the right terms", [r.right_terms for r in flights], at_least=0.90),
        share_row(
            "unlisted forces in flight: the right terms, and gap closed by 80 % on held-out repetitions",
            [r.right_law for r in flights if r.closed("held_out") is not None],
            at_least=0.90,
        ),
        share_row("unlisted: the right terms", [r.right_terms for r in unlisted]),
        share_row(
            "unlisted: a formula with other terms", [bool(r.answer.form) and not r.right_terms for r in unlisted]
        ),
        share_row(
            "unlisted: the right terms, and gap closed by 80 % on held-out repetitions",
            [r.right_law for r in unlisted],
        ),
        *_closure(not_named, "not named", "held_out", 0.8),
        *_closure(not_named, "not named", "condition", 0.8),
        _coverage(singles + pairs),
        *time_rows(results),
    ]
    return rows


def _set_size(results: Sequence[Result]) -> Row:
    sizes = [len(r.answer.candidates) for r in results if r.answer.candidates]
    if not sizes:
        return Row("clear singles: mean set size", math.nan, note="none to judge")
    size = float(np.mean(sizes))
    return Row("clear singles: mean set size", size, "1", None, "at most 1.5", size <= 1.5)


def _both(result: Result, *, sets: bool = False) -> bool:
    """Whether each of two hidden effects is named, or with `sets` is among what a name is not distinguished from."""
    answer = result.answer
    said = [*answer.names, *(name for group in answer.together for name in group if sets)]
    return all(any(result.right(name, effect) for name in said) for effect in result.true_effects)


def _closure(results: Sequence[Result], what: str, part: str, at_least: float) -> list[Row]:
    """Excess gap closed on held-out data."""
    closed = [share for r in results if (share := r.closed(part)) is not None]
    name = f"{what}: excess gap closed, held-out {'condition' if part == 'condition' else 'repetitions'}"
    if not closed:
        return [Row(f"{name} (median)", math.nan, note="none to judge")]
    middle, tenth = float(np.median(closed)), float(np.quantile(closed, 0.1))
    wanted, count = f"at least {at_least}", f"{len(closed)} labs"
    return [
        Row(f"{name} (median)", middle, "1", None, wanted, middle >= at_least, count),
        Row(f"{name} (worst tenth)", tenth, "1", None, "", None),
    ]


def _coverage(results: Sequence[Result]) -> Row:
    inside = []
    for r in results:
        for name in r.answer.names:
            if not r.right(name):
                continue
            for parameter, found in r.answer.parameters.get(name, {}).items():
                true = true_value(r.truth, name, parameter)
                value, std = found.get("value"), found.get("std")
                if true is not None and value is not None and std:
                    inside.append(abs(value - true) <= 1.96 * std)
    row = share_row("parameters: 95 % interval holds the truth", inside)
    if not inside:
        return row
    return Row(row.name, row.value, "1", None, "90 % to 98 %", 0.90 <= row.value <= 0.98, row.note)


def time_rows(results: Sequence[Result]) -> list[Row]:
    cpu = [r.answer.cpu for r in results if math.isfinite(r.answer.cpu)]
    if not cpu:
        return []
    most = max(cpu)
    return [
        Row("CPU time of a lab (median)", float(np.median(cpu)), "s"),
        Row("CPU time of a lab (most)", most, "s", None, f"below {SINGLE_RUN_CPU:.0f} s", most < SINGLE_RUN_CPU),
    ]


def confusion(results: Sequence[Result]) -> dict[str, dict[str, int]]:
    """For each hidden thing, what it was taken for and how often."""
    table: dict[str, Counter[str]] = {}
    for r in results:
        true = " + ".join(r.true_effects) or "nothing"
        if r.answer.verdict in ("named", "indistinguishable"):
            said = " + ".join(canonical(name) for name in r.answer.names[:2])
            said = said if r.answer.verdict == "named" else f"{{{', '.join(map(canonical, r.answer.candidates))}}}"
        else:
            said = r.answer.verdict
        table.setdefault(true, Counter())[said] += 1
    return {true: dict(said.most_common()) for true, said in sorted(table.items())}


# -------------------------------------------------------------------------------------------------------------- main


def _one(job: Job) -> Result:
    """Draw one lab, or take the one that is there, and diagnose it, or take the answer that is there.

    Where names cannot be distinguished, the experiment that is proposed is drawn too, and the lab diagnosed again.
    """
    name = f"s{job.seed}c{job.number:03d}"
    truth, answer = _asked(job, name, None)
    if answer.verdict == "indistinguishable" and answer.designs:
        return Result(truth, answer, _asked(job, f"{name}_next", answer.designs[0])[1])
    return Result(truth, answer)


def _asked(job: Job, name: str, design: dict[str, Any] | None) -> tuple[dict[str, Any], Answer]:
    """The truth of a lab and what the diagnosis says of it."""
    drawn = f"{job.drawn} {json.dumps(design)}" if design else job.drawn
    truth = kept(job.folder / "truth" / f"{name}.json", "drawn", drawn)
    if truth is None:
        shape: dict[str, Any] = {"narrowed": job.narrowed, "design": design}
        truth = write(job.case, name, (job.seed, job.number), job.folder, **shape) | {"drawn": drawn}
        (job.folder / "truth" / f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n")
    answer = ask(job.folder, name, f"{drawn} {job.asked}")
    said = ", ".join(answer.names) or answer.form or answer.failure
    if answer.together:
        said += f" {{{'; '.join(', '.join(group) for group in answer.together)}}}"
    sys.stdout.write(
        f"{name} {truth['rig']:13} {truth['strength']:8} {' + '.join(truth['effects']) or 'nothing':40} -> "
        f"{answer.verdict} {said}  ({answer.cpu:.0f} s)\n"
    )
    sys.stdout.flush()
    return truth, answer


def ask(folder: Path, name: str, asked: str) -> Answer:
    """What the diagnosis says of a lab that was drawn, or what it said before if `asked` is the same."""
    file = folder / "answers" / f"{name}.json"
    document = kept(file, "asked", asked)
    if document is None:
        document = diagnose(folder / "labs" / name) | {"asked": asked}
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps(document, indent=1, default=str) + "\n")
    return read_answer(document)


def answered(folder: Path, name: str) -> Result | None:
    try:
        truth = json.loads((folder / "truth" / f"{name}.json").read_text())
        return Result(truth, read_answer(json.loads((folder / "answers" / f"{name}.json").read_text())))
    except (OSError, ValueError):
        return None


def kept(file: Path, key: str, value: str) -> dict[str, Any] | None:
    """A document written before, unless the code has changed since."""
    try:
        document: dict[str, Any] = json.loads(file.read_text())
    except (OSError, ValueError):
        return None
    return document if document.get(key) == value else None


def in_small(seed: int, folder: Path) -> list[Job]:
    """Narrow labs of each effect, rig and kind are drawn, and those with a new rig or kind are to be diagnosed.

    A double pendulum is drawn but not diagnosed: its diagnosis takes ten times as long as that of another rig.
    """
    jobs, seen = [], set[str]()
    for number, case in enumerate(plan(seed)):
        if seen >= {*ALL, *EVERY_RIG, *KINDS}:
            return jobs
        job = Job(seed, number, case, folder, narrowed=True, drawn="", asked="")
        if case.rig != "double" and not seen >= {case.rig, case.kind}:
            jobs.append(job)
            seen |= {case.kind}
        elif not seen >= {case.rig, *case.effects}:
            write(case, f"s{seed}c{number:03d}", (seed, number), folder, narrowed=True)
        seen |= {case.rig, *case.effects}
    return jobs


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED", "1")))
    parser.add_argument("--count", type=int, default=int(os.environ.get("COUNT", "100")))
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--rig", choices=sorted(set(EVERY_RIG)))
    parser.add_argument("--effect", choices=sorted(ALL))
    parser.add_argument("--strength", choices=(*STRENGTHS, "null"))
    parser.add_argument(
        "--keep", type=Path, default=small(Path("out"), OUT) / "bench-diagnose", help="labs, truth and answers go here"
    )
    parser.add_argument("--processes", type=int, default=small(2, 1))
    parser.add_argument("--narrow", action="store_true", help="labs of one condition, where names often look alike")
    parser.add_argument("--confounded", action="store_true", help="narrow labs of effects that are often confounded")
    parser.add_argument("--kept", action="store_true", help="only labs answered before, whatever code answered them")
    given = parser.parse_args()
    filters = {"kind": given.kind, "rig": given.rig, "effect": given.effect, "strength": given.strength}
    drawn, asked = fingerprint(*DRAWS), fingerprint(*ASKED)
    # a number stands for another lab in each plan: answers of one are none of the other
    drawn += " confounded" if given.confounded else " narrow" if given.narrow else ""
    jobs = [
        Job(given.seed, number, case, given.keep, given.narrow or given.confounded, drawn, asked)
        for number, case in chosen(given.seed, given.count, **filters, cases=confounded if given.confounded else plan)
    ]
    if SMOKE:
        jobs = in_small(given.seed, given.keep)
    if given.kept:
        results = [
            found for job in jobs if (found := answered(job.folder, f"s{job.seed}c{job.number:03d}")) is not None
        ]
    elif given.processes == 1:
        results = [_one(job) for job in jobs]
    else:
        with multiprocessing.get_context("fork").Pool(given.processes) as pool:
            results = list(pool.imap(_one, jobs, chunksize=1))
    table = confusion(results)
    for true, said in table.items():
        sys.stdout.write(f"{true:45} -> {', '.join(f'{what} {n}' for what, n in said.items())}\n")
    cases = [
        {
            "case": r.truth["case"], "rig": r.truth["rig"], "kind": r.truth["kind"], "strength": r.truth["strength"],
            "hidden": r.true_effects, "verdict": r.answer.verdict, "named": r.answer.names, "set": r.answer.candidates,
            "first_right": r.first_right, "cpu_s": r.answer.cpu, "failure": r.answer.failure,
        }
        for r in results
    ]  # fmt: skip
    return report("bench-diagnose", figures(results), seed=given.seed, confusion=table, cases=cases)


if __name__ == "__main__":
    raise SystemExit(main())
