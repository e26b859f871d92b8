"""How often the diagnosis names what is hidden in labs whose physics shares no code with its models.

    python benchmarks/diagnose/independent.py [--seed 1] [--count 60] [--kind null] [--rig drop] [--effect air_drag]
        [--keep DIR] [--processes 1] [--kept]

Labs come from `independent_labs`; the diagnosis is handed the lab's folder alone.  As in `verdicts.py` labs, truth and
answers are kept (under `out/bench-diagnose-independent`), and only what changed code would change is done again.  Also
`SEED=` and `COUNT=` in the environment.  Prints who was taken for whom, by effect and law, and the figures wanted; the
rows, the tables and what was said of each lab are in `out/bench-diagnose-independent.json`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rigtwin.benchmarks.diagnose.independent_labs import KINDS, RIGS, STRENGTHS, Case, chosen, write
from rigtwin.benchmarks.diagnose.independent_labs_effects import ALL
from rigtwin.benchmarks.diagnose.verdicts import (
    ASKED,
    Result,
    answered,
    ask,
    confusion,
    fingerprint,
    kept,
    share_row,
    time_rows,
)
from rigtwin.benchmarks.figures import OUT, SMOKE, Row, report, small

HERE = Path(__file__).resolve().parent
DRAWS = tuple(sorted(HERE.glob("independent_labs*.py")))
CLEAR = STRENGTHS[1:]
CHEAP = ("drop", "roll")  # rigs of which labs are diagnosed fast
Job = tuple[int, int, Case, Path, str, str]


def case_name(seed: int, number: int) -> str:
    return f"i{seed}c{number:03d}"


def _one(job: Job) -> Result:
    """Draw one lab, or take the one that is there, and diagnose it, or take the answer that is there."""
    seed, number, case, folder, drawn, asked = job
    name = case_name(seed, number)
    file = folder / "truth" / f"{name}.json"
    truth = kept(file, "drawn", drawn)
    if truth is None:
        truth = write(case, name, (seed, number), folder, most=small(1000, 2)) | {"drawn": drawn}
        file.write_text(json.dumps(truth, indent=1) + "\n")
    answer = ask(folder, name, f"{drawn} {asked}")
    laws = " + ".join(f"{e} ({law})" for e, law in zip(truth["effects"], truth["laws"], strict=True)) or "nothing"
    said = ", ".join(answer.names) or answer.form or answer.failure
    sys.stdout.write(
        f"{name} {truth['rig']:9} {truth['strength']:8} {laws:50} -> {answer.verdict} {said}  ({answer.cpu:.0f} s)\n"
    )
    sys.stdout.flush()
    return Result(truth, answer)


def unlisted_right(result: Result) -> bool:
    """Whether what no list has was called that; the name of the thing itself, should there be one, is right too."""
    return result.answer.verdict == "unlisted" or result.first_right


def both_right(result: Result) -> bool:
    """Whether each of two hidden effects is named."""
    return all(any(result.right(name, effect) for name in result.answer.names) for effect in result.true_effects)


def figures(results: Sequence[Result]) -> list[Row]:
    """The figures wanted of the diagnosis."""
    of = {kind: [r for r in results if r.truth["kind"] == kind] for kind in KINDS}
    listed = [r for r in of["single"] + of["pair"] if not r.truth["absorbed"]]
    clear = [r for r in listed if r.truth["strength"] in CLEAR]
    singles = [r for r in clear if r.truth["kind"] == "single"]
    near = [r for r in listed if r.truth["strength"] == "near"]
    absorbed = [r for r in of["single"] if r.truth["absorbed"] and not r.truth["unseen"]]
    unseen = [r for r in of["single"] if r.truth["unseen"]]
    unlisted = [r for r in of["unlisted"] if r.truth["strength"] in CLEAR]
    slides = [r for r in clear if r.truth["rig"] == "slide"]
    quiet_slides = [r for r in of["null"] if r.truth["rig"] == "slide"]
    rows = [
        share_row("no answer", [r.answer.verdict == "failed" for r in results], at_most=0.0),
        share_row("right name first", [r.first_right for r in clear], at_least=0.90),
        share_row("right name in the set", [r.in_set or r.first_right for r in clear]),
        share_row("wrong name", [r.wrong_name for r in clear], at_most=0.04),
        share_row("listed called unlisted", [r.answer.verdict == "unlisted" for r in clear], at_most=0.05),
        share_row("nulls: false alarms", [alarm(r) for r in of["null"]], at_most=0.02),
        share_row("unlisted called so", [unlisted_right(r) for r in unlisted], at_least=0.85),
        share_row("slides: right name first", [r.first_right for r in slides], at_least=0.90),
        share_row("slides: nulls with a false alarm", [alarm(r) for r in quiet_slides], at_most=0.0),
        share_row("pairs: both named", [both_right(r) for r in clear if r.truth["kind"] == "pair"]),
        share_row("singles, moderate: right name first", _first(singles, "moderate")),
        share_row("singles, strong: right name first", _first(singles, "strong")),
        share_row("near the limit: right name first", [r.first_right for r in near]),
        share_row("near the limit: wrong name", [r.wrong_name for r in near]),
        *(
            share_row(f"{rig}: right name first", [r.first_right for r in clear if r.truth["rig"] == rig])
            for rig in RIGS
        ),
        share_row("what a plain model takes up: right name first", [r.first_right for r in absorbed]),
        share_row("what leaves no trace: another name", [r.wrong_name for r in unseen]),
        *time_rows(results),
    ]
    return rows


def _first(results: Sequence[Result], strength: str) -> list[bool]:
    return [r.first_right for r in results if r.truth["strength"] == strength]


def alarm(result: Result) -> bool:
    return result.answer.verdict not in ("none", "failed")


def by_law(results: Sequence[Result]) -> dict[str, dict[str, int]]:
    """For each rig, effect and law, what it was taken for and how often."""
    table: dict[str, Counter[str]] = {}
    for r in results:
        for effect, law in zip(r.truth["effects"], r.truth["laws"], strict=True):
            first = r.answer.names[0] if r.answer.names else r.answer.verdict
            said = "right" if r.first_right else "in the set" if r.in_set else first
            if r.truth["kind"] == "unlisted" and unlisted_right(r):
                said = "right"
            table.setdefault(f"{r.truth['rig']}: {effect} ({law}), {r.truth['strength']}", Counter())[said] += 1
    return {true: dict(said.most_common()) for true, said in sorted(table.items())}


def in_small(jobs: Sequence[Job]) -> list[Job]:
    """A lab of each rig is drawn; one in which nothing is hidden, and one with an effect, are diagnosed."""
    first = {
        kind: next(job for job in jobs if job[2].kind == kind and job[2].rig in CHEAP) for kind in ("null", "single")
    }
    for rig in RIGS:
        _, number, case, folder, *_ = next(job for job in jobs if job[2].rig == rig and job[2].kind == "single")
        write(case, f"{rig}_{number}", (number,), folder, most=1)
    return list(first.values())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED", "1")))
    parser.add_argument("--count", type=int, default=int(os.environ.get("COUNT", "60")))
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--rig", choices=RIGS)
    parser.add_argument("--effect", choices=sorted(ALL))
    parser.add_argument("--keep", type=Path, default=small(Path("out"), OUT) / "bench-diagnose-independent")
    parser.add_argument("--processes", type=int, default=small(2, 1))
    parser.add_argument("--kept", action="store_true", help="only labs answered before, whatever code answered them")
    given = parser.parse_args()
    filters = {"kind": given.kind, "rig": given.rig, "effect": given.effect}
    drawn, asked = fingerprint(*DRAWS), fingerprint(*ASKED)

    cases = chosen(given.seed, small(given.count, 60), **filters)
    wanted = [(given.seed, number, case, given.keep, drawn, asked) for number, case in cases]
    wanted = in_small(wanted) if SMOKE else wanted
    if given.kept:
        names = [case_name(job[0], job[1]) for job in wanted]
        results = [found for name in names if (found := answered(given.keep, name)) is not None]
    elif given.processes == 1:
        results = [_one(job) for job in wanted]
    else:
        with multiprocessing.get_context("fork").Pool(given.processes) as pool:
            results = list(pool.imap(_one, wanted, chunksize=1))
    table = by_law(results)
    for true, said in table.items():
        sys.stdout.write(f"{true:70} -> {', '.join(f'{what} {n}' for what, n in said.items())}\n")
    return report(
        "bench-diagnose-independent", figures(results), seed=given.seed, confusion=confusion(results), by_law=table,
        cases=[_case(r) for r in results],
    )  # fmt: skip


def _case(result: Result) -> dict[str, Any]:
    truth, answer = result.truth, result.answer
    return {
        **{key: truth[key] for key in ("case", "rig", "kind", "strength", "gain", "effects", "laws", "sizes")},
        "verdict": answer.verdict, "named": answer.names, "set": answer.candidates, "form": answer.form,
        "first_right": result.first_right, "cpu_s": answer.cpu, "failure": answer.failure,
    }  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(main())
