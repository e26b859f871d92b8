"""The diagnosis of one lab: locate the disagreement, name the effect, add it, measure the gap, propose an experiment.

::

    tracks ── calibrate the baseline ── locate ── alarm? ── name ── listed or not? ── gap ── next experiment
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.axis_checks import check_axes, check_heights
from rigtwin.compare.diagnose.data.exclusions import sifted
from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab, need_repetitions
from rigtwin.compare.diagnose.fitting.fit import Fit, fit, screen
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned
from rigtwin.compare.diagnose.fitting.parameter_uncertainty import parameters
from rigtwin.compare.diagnose.fitting.strained import calibration, strained
from rigtwin.compare.diagnose.fitting.wide_scatter import above_usual, scatter_found
from rigtwin.compare.diagnose.fitting.wide_scatter import in_words as in_words_of_scatter
from rigtwin.compare.diagnose.models.double_pendulum import DoubleBench
from rigtwin.compare.diagnose.models.drop import DropBench
from rigtwin.compare.diagnose.models.pendulum import PendulumBench
from rigtwin.compare.diagnose.models.roll import LEVER, RollBench, both_ways, one_material_of_many_sizes
from rigtwin.compare.diagnose.models.slide import SlideBench
from rigtwin.compare.diagnose.selection.bent_laws import OTHER_SIZE
from rigtwin.compare.diagnose.selection.candidate import Candidate, refused, shown_from, surprise
from rigtwin.compare.diagnose.selection.formula import Formula, any_form, find_formula, fixed_forms
from rigtwin.compare.diagnose.selection.gap import Beside, Gap, beside, closed, gap, names, noise_floor
from rigtwin.compare.diagnose.selection.locate import Disagreement, Location, locate
from rigtwin.compare.diagnose.selection.name_effects import ALARM, FORM, NEAR_NOISE, Naming, name_effects, spread_of
from rigtwin.compare.diagnose.selection.next_experiment import CLEAR, Design, designs
from rigtwin.compare.diagnose.selection.stability import Claim, Stability, stability
from rigtwin.lab.errors import BadInput
from rigtwin.lab.formatting import unit_of
from rigtwin.lab.progress import Progress, silent
from rigtwin.sim.effects import Effect, library
from rigtwin.sim.effects.effect import WIDENING
from rigtwin.sim.effects.nameless_terms import nameless

MOST_RIVALS = 3  # largest number of rival sets for which the next experiment is computed
SURE = 1e-4  # p-value of the residual statistic below which a disagreement remains
SEEN = 0.05  # p-value below which an effect of an implausible size alone is a reason to look further
CERTAIN = 1e-8  # p-value below which data and model disagree even if no effect describes how
CLEARLY = 1.5  # gap in noise floors above which the closed share is meaningful
SIZE_EXPONENT = "size_exponent"  # parameter of the laws with a free dependence on the size
STATED = math.sqrt(ALARM)  # stated standard uncertainties by which a calibration quantity must be off to be named
FACTOR_TWO = 1.0  # penalty (`surprise`) of a coefficient that is off its predicted value by a factor of two
ON_A_TRACK = ("roll", "slide")  # rigs in which a body is guided along one straight path
# times the usual scatter between repetitions: a larger one is a misfit that differs between them; chosen on labs whose
# scale would scatter by 50 times the usual
SCATTER_OF_A_MISFIT = 20.0
LEFT = 0.9  # share of the excess gap that an effect must close to be named while a disagreement remains


@dataclass(frozen=True)
class Diagnosis:
    """Result of the diagnosis of one lab."""

    lab: TrackedLab
    verdict: str
    reason: str
    location: Location | None = None
    naming: Naming | None = None
    chosen: Candidate | None = None
    gap: Gap | None = None
    form: str = ""
    next_experiment: str = ""
    designs: tuple[Design, ...] = ()
    """Settings that would separate the rivals, largest separation first."""
    stability: Stability | None = None
    """How often other draws of the repetitions give the same name."""
    beside: tuple[Beside, ...] = ()
    """The runner-up and a placebo effect, fitted instead of the winner."""
    left_out: tuple[str, ...] = ()
    """Rows, repetitions and keys that were not used, each with the reason."""
    seconds: float = 0.0  # [s], CPU
    bench: Any = field(default=None, repr=False)

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.lab.title!r}: {self.verdict}: {self.reason}>"

    @property
    def where(self) -> tuple[Disagreement, ...]:
        """Regions in which data and model disagree."""
        return self.location.found if self.location else ()

    def to_json(self) -> dict[str, Any]:
        """The document of `diagnosis.json`."""
        naming, chosen = self.naming, self.chosen
        fitted = chosen.fitted if chosen else naming.base if naming else None
        calibrated = calibration(fitted) if fitted else []
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "strained": strained(calibrated),
            "scatter": scatter_found(self.bench, fitted) if fitted else [],
            "lab": self.lab.title,
            "path": str(self.lab.folder.resolve()),
            "experiments": [one.name for one in self.lab.conditions],
            "rig": self.lab.rig,
            "left_out": list(self.left_out),
            "where": [
                {
                    "experiment": one.experiment,
                    "record": one.record,
                    "region": one.region,
                    "z": one.z,
                    "p_adjusted": one.p_adjusted,
                    "deviation_m": one.deviation,
                }
                for one in self.where
            ],
            "where_in_words": in_words(self.location),
            "effects": _effects(self),
            "indistinguishable": _sets(self),
            "form": self.form,
            "gap": self.gap.to_json() if self.gap else {},
            "next_experiment": self.next_experiment,
            "stability": self.stability.to_json() if self.stability else None,
            "beside": [one.to_json() for one in self.beside],
            "designs": [one.to_json() for one in self.designs],
            "calibration": calibrated,
            "tried": [
                {
                    "effects": list(one.names),
                    "gain": one.gain,
                    "refused": one.reason,
                    "parameters": parameters(self.lab, one.fitted, one.terms),
                    "converged": one.fitted.converged,
                }
                for one in sorted(naming.tried, key=lambda one: -one.gain)
            ]
            if naming
            else [],
            "residual_statistic": {
                "before": _statistic(self.location),
                "after": _statistic(naming.after if naming else None),
            },
            "cpu_seconds": self.seconds,
        }


def diagnose(
    lab: TrackedLab,
    own: Sequence[Effect] = (),
    progress: Progress = silent,
    listed: Sequence[Effect] | None = None,
) -> Diagnosis:
    """Diagnose one lab.

    Parameters
    ----------
    lab : TrackedLab
        Tracks with the stated setup and uncertainties.
    own : sequence of Effect
        Effects of the user, tried beside the listed ones.
    progress : Progress
        Called with step, number and count.
    listed : sequence of Effect, optional
        Effects to try; the whole library by default.

    Returns
    -------
    Diagnosis
        The verdict is "none", "named", "indistinguishable", "unlisted" or "undecided".

    Raises
    ------
    BadInput
        If the tracks contradict the stated setup, there are too few repetitions, or the model cannot be fitted.
    """
    begun = time.process_time()
    check_axes(lab)
    asked = lab.repetitions
    lab, left_out = sifted(lab)
    check_heights(lab)
    need_repetitions(lab.folder, lab.repetitions, still=asked - lab.repetitions)
    candidates = [effect for effect in (*(library() if listed is None else listed), *own) if acts(effect, lab)]
    try:
        bench = bench_of(lab)
        progress("baseline", 0, 1)
        base = fit(bench, rounds=12)
        if not math.isfinite(base.deviance):
            raise ArithmeticError("the misfit of the baseline is not finite")
        naming = name_effects(bench, candidates, base, progress)
        naming = replace(naming, unseen=_unable_to_act(lab))
        verdict, sizes = _judge(bench, lab, naming, progress), None
        if verdict.verdict == "unlisted":
            verdict, sizes = _with_formula(verdict, progress)
        result = _shown(bench, lab, verdict, sizes)
    except (np.linalg.LinAlgError, ArithmeticError) as error:  # any other ValueError is a programming error
        raise BadInput(
            f"{lab.folder}: the model of a {lab.rig} cannot be fitted to these tracks ({error}); check the units of "
            "time_s, x_m and y_m and the lab's sizes, masses and settings, leave out repetitions in which hardly "
            "anything moves, or set RIGTWIN_DEBUG=1 to see where it failed."
        ) from error
    broken = [f"{title}: not tried, its equations have no solution for these tracks" for title in naming.broken]
    result = replace(result, left_out=(*lab.overlooked, *lab.assumed(candidates), *left_out, *broken))
    return replace(result, next_experiment=_next(result), seconds=time.process_time() - begun)


def _shown(bench: Regioned, lab: TrackedLab, verdict: Diagnosis, sizes: Gap | None) -> Diagnosis:
    """The verdict with gap, stability, next experiments, runner-up and placebo."""
    assert verdict.naming is not None
    base = verdict.naming.base
    verdict = _with_scatter(bench, verdict, base)
    chosen = verdict.chosen
    sizes = sizes or gap(bench, lab, base, chosen.fitted if chosen else None)
    return replace(
        verdict,
        gap=sizes,
        stability=_stability(verdict),
        designs=_designs(verdict),
        beside=_beside(verdict, sizes),
    )


def _with_scatter(bench: Regioned, verdict: Diagnosis, base: Fit) -> Diagnosis:
    """The verdict with a remark on unusual scatter.

    It is undecided where nothing was repeated, as the scatter may be the effect, and unlisted where an effect fits only
    with a scatter that no experiment has.
    """
    fitted = verdict.chosen.fitted if verdict.chosen else base
    far = above_usual(scatter_found(bench, fitted))
    if not far:
        return verdict
    found = replace(verdict, reason=f"{verdict.reason}; {in_words_of_scatter(far)}")
    if verdict.chosen is None:
        return found
    if _all_once(bench):
        return replace(found, verdict="undecided", chosen=None)
    terms = verdict.chosen.terms
    widened = any(term.geometry in WIDENING for term in terms)
    if widened or verdict.verdict == "unlisted" or far[0]["std"] <= SCATTER_OF_A_MISFIT * far[0]["usual"]:
        return found
    why = (
        f"{names(terms)} describes the data only with a scatter that no experiment has; {in_words_of_scatter(far[:1])}"
    )
    return replace(verdict, verdict="unlisted", chosen=None, reason=why)


def acts(effect: Effect, lab: TrackedLab) -> bool:
    """Return whether an effect acts in the lab's rig; a pendulum that hits a wall has the impact losses of a drop.

    Parameters
    ----------
    effect : Effect
        Effect of the catalogue.
    lab : TrackedLab
        Lab whose rig is asked.

    Returns
    -------
    bool
        True where it acts.
    """
    if effect.name == LEVER and not one_material_of_many_sizes(lab):
        return False
    if effect.geometry in ("surface_slope", "surface_direction") and not both_ways(lab):
        return False
    # a form whose further coefficient is that of the size
    if effect.free and [one.name for one in effect.parameters[1:]] == [SIZE_EXPONENT] and not _sizes(lab):
        return False
    if effect.geometry == "lengths" and lab.rig in effect.rigs and not _differ(lab.setting("length_m")):
        return False
    strikes = lab.rig == "pendulum" and bool(lab.conditions[0].wall)
    return lab.rig in effect.rigs or (strikes and effect.restitution is not None and "drop" in effect.rigs)


def _unable_to_act(lab: TrackedLab) -> tuple[Effect, ...]:
    """Effects of the rig that cannot act in this lab, nor any other form of them."""
    able = {one.group for one in library() if acts(one, lab)}
    return tuple(one for one in library() if lab.rig in one.rigs and one.group not in able)


def _sizes(lab: TrackedLab) -> bool:
    """Whether the lab has beads of different sizes, which a dependence on the size needs."""
    return _differ([condition.bead.diameter for condition in lab.conditions])


def _differ(lengths: Sequence[float]) -> bool:
    """Whether there are lengths [m] that differ by more than errors of measurement."""
    return max(lengths) > OTHER_SIZE * min(lengths)


def bench_of(lab: TrackedLab) -> Regioned:
    """Return the reduced model of the lab's rig, bound to its data.

    Parameters
    ----------
    lab : TrackedLab
        Lab whose data are fitted.

    Returns
    -------
    Regioned
        Reduced model of the rig.
    """
    builders: dict[str, Callable[[TrackedLab], Any]] = {
        "drop": DropBench,
        "pendulum": DoubleBench if lab.conditions[0].wall else PendulumBench,
        "double": DoubleBench,
        "roll": RollBench,
        "slide": SlideBench,
    }
    bench: Regioned = builders[lab.rig](lab)
    return bench


def _judge(bench: Regioned, lab: TrackedLab, naming: Naming, progress: Progress) -> Diagnosis:
    """Verdict from the fitted candidates; nameless terms test whether the listed effects suffice."""
    best, location = naming.best, naming.location
    plain = Diagnosis(lab, "none", "", location, naming, bench=bench)
    refused = max((one.score for one in naming.tried), default=0.0) > FORM and location.p < SEEN
    loud = refused or _remains(bench, location, naming.base)
    if best is None:
        alone = any_form(bench, naming, progress)
        if alone is not None and alone.gain > FORM and not alone.reason and not _all_once(bench):
            why = "no listed effect explains the disagreement with plausible coefficients"
            return replace(plain, verdict="unlisted", reason=why)
        if not loud:
            return replace(plain, reason="the data agree with the model within noise, scatter and stated calibration")
        if location.p < CERTAIN:
            return replace(
                plain, verdict="unlisted", reason="data and twin disagree, and no listed effect describes how"
            )
        why = "data and twin disagree, but no listed effect and no simple formula describes how"
        return replace(plain, verdict="undecided", reason=why + _by_chance(bench))
    alone = _rival_form(bench, lab, naming, best, progress)
    if alone is not None and not alone.reason and alone.gain - best.gain > FORM:
        best, naming = _from_there(bench, naming, best, alone)
        plain = replace(plain, naming=naming)
    left = _remains(bench, naming.after, best.fitted)
    better = alone is not None and not alone.reason and alone.gain - best.gain > FORM
    if alone is not None and better and len(alone.terms) <= len(best.terms) and not _nearly_all(best, alone):
        why = f"a formula that is not a listed effect fits better than {names(best.terms)}"
        return replace(plain, verdict="unlisted", reason=why)
    share = _closed(naming, noise_floor(bench, best.fitted))
    if left and share is not None and share < LEFT:
        why = f"{names(best.terms)} would close only {100 * share:.0f} % of the gap and leave a disagreement"
        verdict = "unlisted" if naming.after.p < SURE else "undecided"
        return replace(plain, verdict=verdict, reason=why + _by_chance(bench))
    if naming.alike:
        others = "; ".join(names(other.terms) for other in naming.alike)
        return replace(
            plain,
            verdict="indistinguishable",
            chosen=best,
            reason=f"{names(best.terms)} explains the data; equally well: {others}{_by_chance(bench)}",
        )
    if LEVER in best.names and len(best.terms) == 1:
        why = "one lever arm explains the rolling friction of all bead sizes: it is proportional to 1/d"
        return replace(plain, verdict="named", chosen=best, reason=why)
    rest = "; a part of the residuals remains unexplained" if left else ""
    rest += _in_other_forms(naming, best) + _by_chance(bench)
    return replace(plain, verdict="named", chosen=best, reason=f"{names(best.terms)} explains the disagreement{rest}")


def _rival_form(
    bench: Regioned, lab: TrackedLab, naming: Naming, best: Candidate, progress: Progress
) -> Candidate | None:
    """The best formula, where one may do better than the best set.

    On a track every run passes the same places at about the same times, so an error of the picture or the clock looks
    like a force by place or by time: where nothing else is named there, forces of a free shape are tried, too.
    """
    if lab.rig in ON_A_TRACK and all(term.kind == "measurement" for term in best.terms):
        return any_form(bench, naming, progress)
    forms = fixed_forms(bench, naming, progress, nameless(lab.rig)) if _more_to_say(bench, best) else []
    return max(forms, key=lambda one: one.gain, default=None)


def _nearly_all(best: Candidate, formula: Candidate) -> bool:
    """Whether listed effects of plausible size close nearly the whole gap that a formula closes.

    The law of a listed effect holds to some percent; the better the data, the larger the deviance that those leave.
    """
    plausible = all(surprise(best.fitted, term) <= FACTOR_TWO for term in best.terms)
    return plausible and len(best.terms) <= len(formula.terms) and best.gain >= LEFT * formula.gain


def _remains(bench: Regioned, location: Location, fitted: Fit) -> bool:
    """Whether a disagreement remains: in the mean over repetitions, or in single rows if nothing was repeated."""
    return location.p < SURE or (_all_once(bench) and fitted.per_row > CLEARLY * noise_floor(bench, fitted))


def _once(bench: Regioned) -> int:
    """Number of conditions with one repetition."""
    return int(np.sum(np.bincount(bench.condition) == 1))


def _all_once(bench: Regioned) -> bool:
    return _once(bench) == len(bench.condition_names)


def _by_chance(bench: Regioned) -> str:
    """A remark on conditions without repetitions, empty where all were repeated."""
    once = _once(bench)
    which = "no condition was" if _all_once(bench) else f"{once} of {len(bench.condition_names)} conditions were not"
    return f"; {which} repeated, so random scatter and an effect cannot be separated there" if once else ""


def _in_other_forms(naming: Naming, best: Candidate) -> str:
    """A remark on other forms of the same effect that fit equally well."""
    others = dict.fromkeys(term.title for form in naming.forms for term in form.terms if term.name not in best.names)
    return f"; the form is not resolved: {' or '.join(others)} fits equally well" if others else ""


def _from_there(bench: Regioned, naming: Naming, best: Candidate, formula: Candidate) -> tuple[Candidate, Naming]:
    """Fit the best set again from the formula's solution: a better local minimum must not count for the formula."""
    known = {u.name: float(v) for u, v in zip(best.fitted.unknowns, best.fitted.values, strict=True) if u.effect}
    again = fit(bench, best.terms, near=formula.fitted, beside=known, most=25, rounds=2)
    gained = best.fitted.deviance - again.deviance
    if gained <= 0 or refused(again, best.terms):
        return best, naming
    better = replace(best, fitted=again, gain=best.gain + gained / spread_of(naming.base, naming.location))
    return better, replace(naming, best=better, after=locate(bench, again))


def _more_to_say(bench: Regioned, best: Candidate) -> bool:
    """Whether a nameless term added to the best set promises enough gain to be fitted."""
    if best.fitted.per_row > NEAR_NOISE:
        return True
    terms = nameless(bench.lab.rig)  # type: ignore[attr-defined]
    return any(best.fitted.deviance - one.deviance > 0.8 * FORM for one in screen(bench, best.fitted, terms))


def _with_formula(verdict: Diagnosis, progress: Progress) -> tuple[Diagnosis, Gap | None]:
    """An `unlisted` verdict with a formula, if one holds on held-out data, and its gap.

    A formula that fails on held-out data is only mentioned as a hint and does not enter the model.  If the search
    itself fails, the verdict has no formula.
    """
    naming = verdict.naming
    assert naming is not None
    try:
        found = find_formula(verdict.bench, verdict.lab, naming, progress)
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        return replace(verdict, reason=f"{verdict.reason}; no formula could be fitted to these tracks ({error})"), None
    if found is None or not found.holds:
        return replace(verdict, reason=f"{verdict.reason}; {_no_law(found)}"), None
    chosen = found.candidate
    naming = replace(naming, after=locate(verdict.bench, chosen.fitted))
    return replace(verdict, chosen=chosen, form=found.words, naming=naming), found.sizes


def _no_law(found: Formula | None) -> str:
    """Why no formula is reported, and the share that the best one closes as a hint."""
    if found is None or (found.share is not None and not found.share > 0):
        return "no formula of the known terms describes how"
    closes = found.sizes.closed if found.share is None else found.share
    if closes is None or not closes > 0:
        return "no formula of the known terms describes how"
    where = "on the data it was fitted to" if found.share is None else "on held-out repetitions"
    return (
        f"{found.flaw}; the best formula, given only as a hint, closes {100 * closes:.0f} % of "
        f"the gap {where}: {found.words}"
    )


def _closed(naming: Naming, noise: float) -> float | None:
    """Share of the excess gap that the best set closes: in the mean over repetitions if that has a gap, else in rows.

    What differs from repetition to repetition is scatter, which no effect explains.  `noise` is the squared deviation
    per row that the best set would leave without any gap.
    """
    assert naming.best is not None
    common = naming.location.statistic, naming.after.statistic, 1.0
    every = naming.base.per_row, naming.best.fitted.per_row, noise
    shares = (closed(*one) for one in (common, every) if one[0] >= CLEARLY * one[2])
    return next((share for share in shares if share is not None), None)


def _next(diagnosis: Diagnosis) -> str:
    """Proposal for the next experiment."""
    naming = diagnosis.naming
    if diagnosis.verdict == "indistinguishable" and diagnosis.chosen is not None:
        asked = [*diagnosis.chosen.terms, *(term for other in _alike(diagnosis) for term in other.terms)]
        hints = "; or ".join(dict.fromkeys(term.splits for term in asked if term.splits))
        best = next(iter(diagnosis.designs), None)
        if best is None:
            return hints
        verb = "would separate them" if best.separation >= CLEAR else "would separate them best, though not clearly"
        return (
            f"{best.words}, {best.repetitions} repetitions, {verb}: {' and '.join(best.between)} then differ by "
            f"{best.separation:.1f} standard deviations; also: {hints}"
        )
    if diagnosis.verdict == "named" and diagnosis.chosen is not None:
        splits = [term.splits for term in diagnosis.chosen.terms if term.splits]
        return f"to confirm it: {splits[0]}" if splits else ""
    if diagnosis.verdict == "none" and naming is not None:
        return _sensitivity(naming)
    return "repeat the condition with the largest disagreement with one setting changed at a time"


def _sensitivity(naming: Naming) -> str:
    """Smallest detectable size of each effect, and the effects that these data cannot show."""
    seen, blind = [], []
    stated = {u.name: u.sd for u in naming.base.unknowns if math.isfinite(u.sd)}
    for one in naming.tried:
        if len(one.terms) == 1 and one.terms[0].geometry not in WIDENING:
            term = one.terms[0]
            parameter = term.parameters[0]
            std = one.fitted.std(f"{term.name}.{parameter.name}")
            # a change within the stated calibration uncertainty is not an effect, however well the data determine it
            least = math.hypot(math.sqrt(ALARM) * std, STATED * stated.get(f"{term.name}.{parameter.name}", 0.0))
            least = max(least, shown_from(parameter.least, std))
            if math.isfinite(least) and 0 < least < parameter.high:
                seen.append(f"{term.title} {least:.2g}{unit_of(parameter.unit)}")
            else:
                blind.append(f"{term.title} ({term.splits})")
    if naming.unseen:
        blind += [f"{term.title} ({term.splits})" for term in naming.unseen]
    text = "smallest effects that these data would have shown: " + ", ".join(seen) if seen else ""
    if blind:
        text += "; not detectable at any size, because unknowns of the baseline absorb them: " + "; ".join(blind)
    return text


def _beside(diagnosis: Diagnosis, sizes: Gap) -> tuple[Beside, ...]:
    naming, chosen = diagnosis.naming, diagnosis.chosen
    if naming is None or chosen is None or diagnosis.verdict not in ("named", "indistinguishable"):
        return ()
    tried = [(one.fitted, one.gain) for one in naming.tried]
    return beside(diagnosis.bench, naming.base, sizes, chosen.fitted, tried, diagnosis.lab.title)


def _stability(diagnosis: Diagnosis) -> Stability | None:
    naming, chosen = diagnosis.naming, diagnosis.chosen
    if naming is None or chosen is None or diagnosis.verdict not in ("named", "indistinguishable"):
        return None
    if _all_once(diagnosis.bench):
        return None  # without repetitions there is nothing to resample
    same_size = [one for one in naming.tried if len(one.terms) == len(chosen.terms) and not one.reason]
    rivals = [one for one in same_size if one.groups != chosen.groups]
    spread = spread_of(naming.base, naming.location)

    def claim(one: Candidate) -> Claim:
        gained = (naming.base.deviance - one.fitted.deviance) / spread
        return Claim(one.fitted, one.score - gained)

    return stability(
        naming.base, claim(chosen), [claim(one) for one in rivals], diagnosis.bench.condition,
        alarm=ALARM, spread=spread,
    )  # fmt: skip


def _designs(diagnosis: Diagnosis) -> tuple[Design, ...]:
    """Settings that separate indistinguishable sets; empty for other verdicts."""
    if diagnosis.verdict != "indistinguishable" or diagnosis.chosen is None:
        return ()
    rivals = [diagnosis.chosen.fitted, *(other.fitted for other in _alike(diagnosis)[:MOST_RIVALS])]
    return tuple(designs(diagnosis.bench, rivals))


def _alike(diagnosis: Diagnosis) -> tuple[Candidate, ...]:
    naming = diagnosis.naming
    return naming.alike if naming is not None and diagnosis.verdict == "indistinguishable" else ()


def _sets(diagnosis: Diagnosis) -> list[list[str]]:
    """The interchangeable names: those that not all rival sets share."""
    others = _alike(diagnosis)
    if diagnosis.chosen is None or not others:
        return []
    every = [diagnosis.chosen.names, *(other.names for other in others)]
    common = set(every[0]).intersection(*every[1:])
    return [list(dict.fromkeys(name for one in every for name in one if name not in common))]


def _effects(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Effects with parameters, largest gain first; the probability follows from the scores of the rivals."""
    if diagnosis.chosen is None or diagnosis.verdict == "unlisted":
        return []
    chosen, others = diagnosis.chosen, _alike(diagnosis)
    weights = [1.0, *(math.exp((other.score - chosen.score) / 2) for other in others)]
    probability = weights[0] / sum(weights)
    order = sorted(chosen.terms, key=lambda term: -_gain_of(diagnosis, term))
    return [
        {
            "effect": term.name,
            "title": term.title,
            "kind": term.kind,
            "parameters": parameters(diagnosis.lab, chosen.fitted, (term,)),
            "probability": probability,
        }
        for term in order
    ]


def _gain_of(diagnosis: Diagnosis, term: Effect) -> float:
    """Gain that the chosen set would lose without the term."""
    assert diagnosis.naming is not None
    assert diagnosis.chosen is not None
    rest = {name for name in diagnosis.chosen.names if name != term.name}
    without = next((one.gain for one in diagnosis.naming.tried if set(one.names) == rest), 0.0)
    return diagnosis.chosen.gain - without


def _statistic(location: Location | None) -> dict[str, Any] | None:
    if location is None or not location.tested:
        return None
    return {"S": location.statistic, "p": location.p, "regions": location.tested, "spread": location.spread}


def in_words(location: Location | None) -> str:
    """Return where data and model disagree, in one or two sentences.

    Parameters
    ----------
    location : Location or None
        What `locate` found.

    Returns
    -------
    str
        The sentences.
    """
    if location is None:
        return "not located"
    if not location.tested:
        return "not tested: no region is seen in two repetitions of a condition"
    if not location.found:
        return (
            f"in no single region: none of {location.tested} has a significant mean residual by itself; an effect is "
            "judged by the fit of all together"
        )
    experiments = dict.fromkeys(one.experiment for one in location.found)
    regions = dict.fromkeys(one.region for one in location.found)
    top = location.found[0]
    where = ", ".join(list(regions)[:3])
    conditions = f"{len(experiments)} condition{'s' if len(experiments) > 1 else ''}"
    return (
        f"{len(location.found)} of {location.tested} regions disagree, in {conditions} "
        f"({', '.join(list(experiments)[:3])}{' ...' if len(experiments) > 3 else ''}); strongest in {top.record} "
        f"during the {top.region} of {top.experiment} (z = {top.z:.1f}, {1e3 * top.deviation:.3f} mm); "
        f"mostly {where}"
    )
