"""Diagnosis: an error in the law of the first effect is not named as a second, and a real second effect is found."""

from types import SimpleNamespace

import numpy as np
import pytest

from rigtwin.compare.diagnose.selection import name_effects
from rigtwin.compare.diagnose.selection.bent_laws import bends, gained_beside
from rigtwin.compare.diagnose.selection.candidate import Candidate, refused
from rigtwin.compare.diagnose.selection.name_effects import ALARM, _plainest, _Search, spared
from rigtwin.sim.effects import library, named

FITTED = SimpleNamespace(value=lambda name: 0.4)
MOTION = {
    "force": (0.5, -2.0, 0.1, 3e-3, 1e-4), "torque": (0.3, 2.0, 0.25, 1e-3), "restitution": (0.6, 1.3, 3e-3, 1e-4),
    "rolling": (0.02, 0.5, 3e-3), "sliding": (0.4, 0.5, 10.0), "onset": (0.4, 10.0, 0.02), "view": (0.1, 0.2),
    "exposure": (1.0, 0.1, 0.2), "mutual": (0.01, 3e-3, 1e-4), "sideways": (0.01, 3e-3, 1e-4),
}  # fmt: skip


def test_the_variations_of_a_quadratic_drag_are_linear_and_cubic():
    drag = named("air_drag")
    slower, faster = bends(drag, FITTED, sizes=False)
    for term, power in ((slower, 1), (faster, 3)):
        single, double = (np.array(term.force(0.0, -v, 0.1, 3e-3, 1e-4, 0.1)) for v in (1.0, 2.0))
        assert double[1] == pytest.approx(2**power * single[1], rel=1e-6)
        assert single[0] == 0.0
    # at 1 m/s a variation is that share of the drag
    plain = drag.force(0.0, -1.0, 0.1, 3e-3, 1e-4, 0.4)[1]
    assert slower.force(0.0, -1.0, 0.1, 3e-3, 1e-4, 0.1)[1] == pytest.approx(0.1 * plain, rel=1e-6)


def test_a_drag_on_beads_of_two_sizes_may_depend_on_the_size_in_another_way():
    more = bends(named("air_drag"), FITTED, sizes=True)
    assert len(more) == 5
    small, large = (more[2].force(0.0, -1.0, 0.1, radius, 1e-4, 1.0)[1] for radius in (2e-3, 4e-3))
    assert large == pytest.approx(8 * small)  # one power more than the area


@pytest.mark.parametrize("effect", library(), ids=lambda effect: effect.name)
def test_variations_of_a_law_are_linear_in_their_coefficient_and_effects_on_the_rig_have_none(effect):
    found = bends(effect, FITTED, sizes=True)
    assert bool(found) == (not effect.geometry)
    for term in found:
        hook = next(name for name in MOTION if getattr(term, name) is not None)
        zero, once, twice = (np.array(getattr(term, hook)(*MOTION[hook], c)) for c in (0.0, 0.01, 0.02))
        assert twice - zero == pytest.approx(2 * (once - zero), rel=1e-6)


def test_a_share_of_a_strong_first_effect_is_required_only_where_its_law_may_leave_residuals(monkeypatch):
    """100 is a small share of a gain of 1e9: it counts only where the law of the first effect cannot leave it."""
    search = _Search(SimpleNamespace(lab=SimpleNamespace(rig="pendulum")), SimpleNamespace(per_row=1000.0), 1.0)
    fitted = SimpleNamespace(unknowns=(), std=lambda name: 1.0, value=lambda name: 0.44, per_row=1.0)
    drag = Candidate((named("air_drag"),), fitted, 1e9)
    for gained, beside, earned in ((100.0, 60.0, True), (100.0, 5.0, False), (15.0, 60.0, False), (2e3, 5.0, True)):
        monkeypatch.setattr(name_effects, "gained_beside", lambda *_, beside=beside: beside)
        search.beside.clear()
        both = Candidate((*drag.terms, named("length_error")), fitted, 1e9 + gained)
        assert search.earned(drag, both) is earned


@pytest.mark.parametrize(("alone", "beside", "earned"), [(5.0, 3.0, False), (5.0, 1.0, True), (200.0, 3.0, True)])
def test_a_weak_second_effect_counts_where_the_first_leaves_much_or_both_leave_nothing(alone, beside, earned):
    search = _Search(SimpleNamespace(lab=SimpleNamespace(rig="pendulum")), SimpleNamespace(per_row=1000.0), 1.0)
    one, both = (
        SimpleNamespace(unknowns=(), std=lambda name: 1.0, value=lambda name: 0.44, per_row=per_row)
        for per_row in (alone, beside)
    )
    drag = Candidate((named("air_drag"),), one, 1e6)
    assert search.earned(drag, Candidate((*drag.terms, named("length_error")), both, 1e6 + 5e3)) is earned


@pytest.mark.parametrize("lost", [(2.5,), (0.0, 1.0, 1.75), (0.0, 1.0, 1.75, 2.5)])
def test_a_start_without_a_solution_loses_no_other(monkeypatch, lost):
    """Beside a baseline that is far off, a liquid is fitted from four viscosities."""

    def fit(_bench, _terms, *, near=None, start=None, **_):
        place = near.place if start is None else start["fluid.log_viscosity"]
        if place in lost:
            raise np.linalg.LinAlgError
        return SimpleNamespace(place=place, deviance=abs(place - 1.2))

    monkeypatch.setattr(name_effects, "fit", fit)
    base = SimpleNamespace(per_row=1e4, terms=(), pulls={}, unknowns=(), values=(), place=9.0)
    found = name_effects._fit(None, (named("fluid"),), base)
    assert found.place == min(({0.0, 1.0, 1.75, 2.5, 9.0} - set(lost)), key=lambda place: abs(place - 1.2))


def test_sets_that_are_not_nested_are_not_compared_with_free_laws():
    fewer, more = (
        Candidate(tuple(map(named, names)), FITTED, 0.0) for names in (("air_drag",), ("pivot_friction", "scale_error"))
    )
    assert gained_beside(SimpleNamespace(), fewer, more) == 0.0


def test_of_equally_good_forms_the_one_without_a_thin_plate_is_named(monkeypatch):
    plate, bead = (
        Candidate((named(name),), SimpleNamespace(value=lambda _: 0.5), gain)
        for name, gain in (("plate_compliance", 378.1), ("restitution_viscoelastic", 377.4))
    )
    done = {frozenset(one.names): one for one in (plate, bead)}
    search = SimpleNamespace(done=done, certified=lambda one: one)
    chosen, others = _plainest(search, plate)
    assert chosen is bead
    assert others == [plate]
    clear = Candidate(bead.terms, bead.fitted, 370.0)
    search.done = {frozenset(one.names): one for one in (plate, clear)}
    assert _plainest(search, plate) == (plate, [])


def test_a_plain_form_is_fitted_to_convergence_before_it_is_rejected():
    """After convergence a lag of 5 becomes a lead of 12, so the thin plate and an equal drag no longer fit as well."""
    plate, rough, fine, drag = (
        Candidate((named(name),), SimpleNamespace(value=lambda _: 0.5), gain)
        for name, gain in (
            ("plate_compliance", 100.0), ("restitution_viscoelastic", 95.0), ("restitution_viscoelastic", 112.0),
            ("adhesion_jkr", 99.0),
        )
    )  # fmt: skip
    done = {frozenset(one.names): one for one in (plate, rough, drag)}

    def certified(one):
        done[frozenset(one.names)] = fine
        return fine

    assert _plainest(SimpleNamespace(done=done, certified=certified), plate) == (fine, [])


def test_an_impact_law_by_which_beads_gain_energy_is_refused():
    plate = named("plate_compliance").parameters[1]

    def fitted(e, std):
        own = {
            "restitution.D6-glass": (e, std), "plate_compliance.strength": (50.0, 5.0),
            "plate_compliance.plate": (plate.typical, 0.1 * plate.typical),
        }  # fmt: skip
        unknowns = [SimpleNamespace(name=name) for name in own]
        values = [value for value, _ in own.values()]
        return SimpleNamespace(
            unknowns=unknowns,
            values=values,
            value=lambda name: own[name][0],
            std=lambda name: own[name][1],
            std_given=lambda name, others: own[name][1],
        )

    terms = (named("plate_compliance"),)
    assert refused(fitted(1.1, 0.02), terms) == "restitution.D6-glass = 1.1 is above one"
    assert refused(fitted(1.1, 0.08), terms) == ""
    assert refused(fitted(0.9, 0.01), terms) == ""


def test_a_candidate_whose_equations_have_no_solution_is_left_out_and_reported():
    search = _Search(SimpleNamespace(), None, 1.0)

    def singular():
        raise np.linalg.LinAlgError("Singular matrix")

    search._attempt((named("air_drag"), named("plate_tilt")), singular)
    assert search.done == {}
    assert list(search.broken) == ["air drag and non-level plate"]


def test_a_fit_beside_a_poor_baseline_is_kept_where_the_search_begins_anew_and_finds_a_worse_one():
    def candidate(deviance):
        fitted = SimpleNamespace(residual=np.zeros(9), deviance=deviance, converged=True, unknowns=(), terms=terms)
        return Candidate(terms, fitted, gain=0.0)

    terms = (named("friction_drop"),)
    key = frozenset({"friction_drop"})
    base = SimpleNamespace(residual=np.zeros(9), deviance=50.0)
    search = _Search(SimpleNamespace(), base, 1.0, earlier={key: candidate(9.0)})
    search._spared = lambda _fitted: 0.0
    assert search._better_earlier(key, candidate(40.0)).gain == 50.0 - 9.0
    assert search._better_earlier(key, candidate(8.0)).fitted.deviance == 8.0


def test_a_candidate_that_has_no_solution_on_all_data_is_refused_and_reported(monkeypatch):
    search = _Search(SimpleNamespace(), None, 1.0)

    def singular(_candidate):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(search, "_to_the_end", singular)
    one = Candidate((named("air_drag"),), SimpleNamespace(converged=False), gain=9.0)
    assert search._completed(one).reason == "its equations have no solution for these tracks"
    assert list(search.broken) == ["air drag"]


@pytest.mark.parametrize(
    ("repetitions", "scatter", "lever"),
    [(2, 0.1, False), (3, 0.1, False), (2, 0.15, False), (15, 0.03, False), (15, 0.03, True)],
)
def test_frictions_of_three_sizes_are_tied_only_where_the_data_determine_them(repetitions, scatter, lever):
    """Equal coefficients are no lever arm, even with few scattered repetitions; those proportional to 1/d are one."""
    rng = np.random.default_rng(3)
    sizes, draws, found = np.array([1.0, 1.25, 1.5]), 200, 0
    for _ in range(draws):
        seen = rng.normal(0.0 if not lever else -np.log(sizes)[:, None], scatter, (3, repetitions))
        variance = np.full(3, max(float(np.var(seen, axis=1).mean()), 1e-6) / repetitions)
        tied = seen.mean(axis=1) + np.log(sizes)
        lost = float(np.sum((tied - np.average(tied, weights=1 / variance)) ** 2 / variance))
        base = SimpleNamespace(index=int, covariance=np.diag(variance), values=np.ones(3))
        found += spared(base, ("0", "1", "2")) - lost > ALARM
    assert found >= 0.85 * draws if lever else found <= 0.01 * draws


def test_frictions_with_a_common_uncertainty_gain_from_tying():
    """An angle error shifts all coefficients equally: the knowledge of their ratios counts."""
    apart, shared = 1e-4 * np.eye(3), 0.01 * np.ones((3, 3))
    alone = SimpleNamespace(index=int, covariance=apart + 0.01 * np.eye(3), values=np.ones(3))
    alike = SimpleNamespace(index=int, covariance=apart + shared, values=np.ones(3))
    assert spared(alike, ("0", "1", "2")) > spared(alone, ("0", "1", "2")) + 8
    assert spared(alone, ()) == 0.0
