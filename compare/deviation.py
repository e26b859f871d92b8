"""Compare measured with simulated quantities: combined repetitions, differences with uncertainty, verdict in words.

Uncertainties follow the GUM (JCGM 100:2008): the mean of n repetitions has the scatter's standard error
(type A, section 4.2), combined with the parts that all repetitions share, such as the scale (section 5.1.2).  A
scatter known from few repetitions is itself uncertain: 95 % then span more than two standard uncertainties (annex
G.4).  The scatter of published repetitions is the prior of a lab's own (`rigtwin.lab.reference.repetition_scatter`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from statistics import fmean, stdev
from typing import Any

from rigtwin.lab.formatting import counted
from rigtwin.lab.quantity import CheckLine, Detail, Quantity, root_sum_of_squares
from rigtwin.lab.reference.repetition_scatter import Scatter

# Details that distinguish quantities of the same name; other details (a frame number, a speed) only describe.
IDENTITY = ("bounce", "collision", "body", "side")

# Parts of a budget that are independent between repetitions and average out.  All other parts are shared by all
# repetitions: the error of a scale, for example, is the same in each.
AVERAGES_OUT = frozenset(
    {
        "tracking",
        "repetition",
        "grain roughness",
        "grain at apex and foot",
        "scatter of views and sides",
        "flow over time",
        "scatter of avalanches",
        "scatter of the flow",
    }
)

ONLY_MEASURED = "only measured"
"""Reason for a missing twin that is not repeated in the notes: none was asked for."""

# The results of the rigs, each with the number of its methods that are shown first.
RESULTS = {
    "restitution_wall": 2,
    "restitution_pair": 2,
    "angle_of_repose_graphical": 1,
    "angle_of_repose_geometric": 1,
    "static_friction": 1,
    "rolling_friction": 1,
    "bed_height": 1,
    "bulk_density": 1,
    "discharge_time": 1,
    "mass_flow_rate": 1,
}
MORE_SHOWN = {"drop_height": 1, "rebound_height": 1, "release_angle": 1, "rebound_angle": 1}

# Times on the clock of the film; they depend on the start of the camera and have no counterpart in the twin.
MOMENTS = frozenset({"onset_time", "opening_time", "last_particle_time"})

# [%]: largest deviation with its expanded uncertainty (95 %) of a twin that agrees.
UNINFORMATIVE = 25.0
OF_THE_TWIN = "twin: "
"""Begins the reasons why the value of the twin is doubtful."""
CLAUSES = {
    "twin too": ("differ", "differs"),
    "twin probably": ("probably differ", "probably differs"),
    "agrees": ("agree within their uncertainty", "agrees within its uncertainty"),
    "too few": ("have too few repetitions to tell", "has too few repetitions to tell"),
    "too uncertain": ("are too uncertain to tell", "is too uncertain to tell"),
    "doubtful": ("are doubtful", "is doubtful"),
    "differs from": ("differ from the setting", "differs from the setting"),
}
"""By the beginning of a verdict, what the headline says of several rows, and of one."""

# Probability of a difference that is called one without "probably".  With one repetition and the published scatter 90 %
# of the twins that are wrong by 30 % or more are called different, and 3 % of those that are right
# (benchmarks/compare/verdict_rates.py).
SURE = 0.975

CONTRADICTED = 0.01  # probability of the own scatter, below which it contradicts what is known beforehand

Key = tuple[str, str, str, tuple[tuple[str, Detail], ...]]


@dataclass(frozen=True)
class Combined:
    """n repetitions of one quantity as one number."""

    value: float
    std: float
    """Sample standard deviation of the repetitions; of a single one, its own standard uncertainty."""
    n: int
    std_uncertainty: float
    """Standard uncertainty of `value`: standard error of the scatter with the shared parts of the budget."""
    unit: str
    budget: dict[str, float] = field(default_factory=dict)
    """Named parts of `std_uncertainty`."""
    doubtful: str = ""
    left_out: int = 0
    """Number of doubtful repetitions that are excluded from the mean, because there are sound ones."""
    left_out_for: str = ""
    """Why they are doubtful."""
    freedom: float = math.inf
    """Effective degrees of freedom of `std_uncertainty` (GUM eq. G.2b)."""
    stated: bool = False
    """Whether lab.toml states it."""
    scatter: float | None = None
    """Relative standard deviation of a single repetition, where a prior of it was used."""
    prior: Scatter | None = None
    """The prior, where it weighs more than the own repetitions."""
    own_scatter: float | None = None
    """Relative standard deviation of the own repetitions, where it is too large for that prior."""


@dataclass(frozen=True)
class Deviation:
    """One row of ``deviations.csv``: one quantity of one experiment, measured and simulated."""

    experiment: str
    rig: str
    quantity: str
    method: str
    unit: str
    bounce: int | None
    collision: int | None
    body: str | None
    side: str | None
    measured: float
    measured_std: float
    measured_n: int
    measured_std_uncertainty: float
    simulated: float | None
    simulated_std: float | None
    simulated_n: int
    simulated_std_uncertainty: float | None
    percent_deviation: float | None
    percent_deviation_std: float | None
    z: float | None
    coverage_factor: float | None
    """Standard uncertainties of the difference that span 95 %: 1.96, more with few repetitions.

    Infinite with a single repetition whose scatter is unknown.
    """
    verdict: str
    scatter: float | None = None
    """Relative standard deviation from repetition to repetition, where that of published ones was used."""
    scatter_from: str = ""
    """Where that scatter comes from."""
    doubtful: str = ""
    failed_check: str = ""
    """Names of the checks that failed in the repetitions of which this is the mean, whether or not it rests on them."""
    note: str = ""
    budget: dict[str, float] = field(default_factory=dict)

    @property
    def z_limit(self) -> float | None:
        """Limit of abs(z) beyond which the two values differ."""
        return None if self.coverage_factor is None else _limit(self.coverage_factor)

    def row(self) -> dict[str, Any]:
        """The flat row of ``deviations.csv``."""
        return {column: getattr(self, column) for column in COLUMNS}


COLUMNS = tuple(column.name for column in fields(Deviation) if column.name != "budget")


def key_of(quantity: Quantity) -> Key:
    """Return the key under which quantities of several repetitions are the same quantity.

    Parameters
    ----------
    quantity : Quantity
        Quantity of one repetition.

    Returns
    -------
    tuple
        Name, method, unit, and the details that distinguish it (`IDENTITY`).

    Examples
    --------
    >>> key_of(Quantity("restitution_wall", 0.9, 0.01, "1", method="height", detail={"bounce": 1, "frame": 12}))
    ('restitution_wall', 'height', '1', (('bounce', 1),))
    """
    detail = quantity.detail
    # a bead has its name; the side it swings to depends on where the camera stood
    names = [name for name in IDENTITY if name in detail and not (name == "side" and "body" in detail)]
    identity = tuple((name, detail[name]) for name in names)
    return quantity.quantity, quantity.method, quantity.unit, identity


def combine(repetitions: Sequence[Quantity], prior: Scatter | None = None) -> Combined:
    """Mean of repetitions with its standard uncertainty.

    Parameters
    ----------
    repetitions : sequence of Quantity
        At least one value of the same quantity, all in one unit.  Doubtful ones are left out if sound ones remain.  A
        stated one is the mean of `Quantity.n` repetitions already and stands alone.
    prior : Scatter, optional
        What is known of the scatter beforehand.

    Returns
    -------
    Combined
        Mean, standard uncertainty with its budget, and effective degrees of freedom.

    Notes
    -----
    The variance of the mean is ``max(s, u)**2 / n + sum(c**2)`` with the sample standard deviation s of the n
    repetitions, the root mean square u of their own random parts, and the shared parts c.  The own random parts are a
    lower limit, because a few repetitions may agree by chance.  With a prior of s0 and d0 degrees of freedom, s**2 is
    ``(d0 * s0**2 + (n - 1) * s**2) / (d0 + n - 1)``, with d0 + n - 1 degrees of freedom: the mean is then distributed
    as Student's t.

    References
    ----------
    JCGM 100:2008 (GUM), sections 4.2 and 5.1.2, equation G.2b.
    A. Gelman et al., Bayesian Data Analysis, 3rd ed. (2013), section 2.6.

    Examples
    --------
    >>> several = [Quantity("drop_height", value, 0.1, "mm", method="track") for value in (99.0, 100.0, 101.0)]
    >>> mean = combine(several)
    >>> mean.value, mean.std, mean.n
    (100.0, 1.0, 3)
    """
    if repetitions[0].stated:
        return _stated(repetitions[0], prior)
    sound = [repetition for repetition in repetitions if not repetition.doubtful]
    used = sound or list(repetitions)
    n = len(used)
    reasons = "; ".join(dict.fromkeys(repetition.doubtful for repetition in repetitions if repetition.doubtful))
    values = [repetition.value for repetition in used]
    split = [_split(repetition) for repetition in used]
    shared = {
        name: fmean(parts.get(name, 0.0) for _, parts in split)
        for name in dict.fromkeys(name for _, parts in split for name in parts)
    }
    own = math.sqrt(fmean(random**2 for random, _ in split))
    scatter, freedom = _pooled(stdev(values) if n > 1 else own, n, fmean(values), prior)
    random = max(scatter, own) / math.sqrt(n)
    budget = {"repetition" if n > 1 or scatter > own else "random": random, **shared}
    budget = {name: part for name, part in budget.items() if part > 0}
    std_uncertainty = root_sum_of_squares(budget)
    return Combined(
        value=fmean(values),
        std=stdev(values) if n > 1 else used[0].std_uncertainty,
        n=n,
        std_uncertainty=std_uncertainty,
        unit=used[0].unit,
        budget=budget,
        doubtful="" if sound else reasons,
        left_out=len(repetitions) - n,
        left_out_for=reasons if sound else "",
        freedom=_freedom([(random, freedom if scatter > own else math.inf)], std_uncertainty),
        **_known_beforehand(scatter, stdev(values) if n > 1 else 0.0, n, fmean(values), prior),
    )


def _pooled(std: float, n: int, mean: float, prior: Scatter | None) -> tuple[float, float]:
    """Standard deviation of a repetition and its degrees of freedom, from n repetitions and a prior."""
    if prior is None:
        return std, n - 1
    before = prior.relative * abs(mean)
    if math.isinf(prior.freedom):
        return before, math.inf
    freedom = prior.freedom + n - 1
    return math.sqrt((prior.freedom * before**2 + (n - 1) * std**2) / freedom), freedom


def _known_beforehand(std: float, own: float, n: int, mean: float, prior: Scatter | None) -> dict[str, Any]:
    """What was used of the prior: `std` is the standard deviation with it, `own` that of the repetitions alone."""
    if prior is None:
        return {}
    if mean == 0:
        return {"scatter": 0.0}
    weighs = n - 1 < prior.freedom
    large = weighs and _by_chance(own / abs(mean), n - 1, prior) < CONTRADICTED
    return {
        "scatter": std / abs(mean),
        "prior": prior if weighs else None,
        "own_scatter": own / abs(mean) if large else None,
    }


def _by_chance(own: float, freedom: float, prior: Scatter) -> float:
    """Probability of an own scatter at least as large, if the prior holds (F test, one-sided)."""
    from scipy.special import chdtrc, fdtrc

    if freedom <= 0:
        return 1.0
    if prior.relative == 0:
        return 0.0 if own > 0 else 1.0
    ratio = (own / prior.relative) ** 2
    return float(
        chdtrc(freedom, freedom * ratio) if math.isinf(prior.freedom) else fdtrc(freedom, prior.freedom, ratio)
    )


def _stated(mean: Quantity, prior: Scatter | None) -> Combined:
    std = mean.std_uncertainty * math.sqrt(mean.n)
    scatter, freedom = _pooled(std, mean.n, mean.value, prior)
    random = scatter / math.sqrt(mean.n) if mean.n > 1 else math.hypot(mean.std_uncertainty, scatter)
    if prior is None:
        random = mean.std_uncertainty
    return Combined(
        value=mean.value,
        std=std,
        n=mean.n,
        std_uncertainty=random,
        unit=mean.unit,
        budget=mean.budget if prior is None else {"repetition": random},
        freedom=_freedom([(scatter / math.sqrt(mean.n), freedom)], random) if prior or mean.n > 1 else math.inf,
        stated=True,
        **_known_beforehand(scatter, std, mean.n, mean.value, prior),
    )


def is_result(quantity: str, side: Detail | None) -> bool:
    """Return whether a quantity is a result of its rig; of the sides of a heap only their mean is.

    Parameters
    ----------
    quantity : str
        Name of the quantity.
    side : str or None
        Side of a heap.

    Returns
    -------
    bool
        Whether it is one.
    """
    return quantity in RESULTS and side in (None, "mean")


def over_views(quantities: Sequence[Quantity]) -> list[Quantity]:
    """Combine the views of one repetition, because several views of a pile are not repetitions.

    Parameters
    ----------
    quantities : sequence of Quantity
        All quantities of one repetition.

    Returns
    -------
    list of Quantity
        One of each quantity.  A value that the estimator combined over views (``view="all"``) replaces the single
        views; values that it did not combine, such as left slopes, are averaged.
    """
    views: dict[Key, list[Quantity]] = {}
    for one in quantities:
        views.setdefault(key_of(one), []).append(one)
    found = []
    for ones in views.values():
        whole = [one for one in ones if one.detail.get("view") == "all"]
        seen = [one for one in ones if "view" in one.detail and math.isfinite(one.value)]
        found += whole or ([_mean_view(seen)] if len(seen) > 1 else ones)
    return found


def _mean_view(views: Sequence[Quantity]) -> Quantity:
    mean = combine(views)
    budget = {"scatter of views and sides" if name == "repetition" else name: u for name, u in mean.budget.items()}
    return replace(
        views[0],
        value=mean.value,
        std_uncertainty=mean.std_uncertainty,
        detail={**views[0].detail, "view": "all"},
        budget=budget,
        doubtful=mean.doubtful,
    )


def group(quantities: Iterable[Quantity]) -> dict[Key, list[Quantity]]:
    """Group quantities of all repetitions by their key; values that are not finite are left out.

    Parameters
    ----------
    quantities : iterable of Quantity
        Quantities of all repetitions.

    Returns
    -------
    dict of tuple to list of Quantity
        By `key_of`, in the order of first appearance.
    """
    groups: dict[Key, list[Quantity]] = {}
    for quantity in quantities:
        if math.isfinite(quantity.value):
            groups.setdefault(key_of(quantity), []).append(quantity)
    return groups


def deviations(
    experiment: str,
    rig: str,
    measured: Iterable[Quantity],
    simulated: Iterable[Quantity],
    *,
    set_from: dict[str, str] | None = None,
    run_name: str = "",
    without_twin: str = "",
    assumed: Sequence[str] = (),
    seen: str = "",
    scatter: Callable[[str], Scatter] | None = None,
    failed_checks: Callable[[Key], Sequence[CheckLine]] | None = None,
) -> tuple[Deviation, ...]:
    """Compare each measured quantity with that of the twin.

    Parameters
    ----------
    experiment : str
        Name of the experiment.
    rig : str
        Name of the rig.
    measured : iterable of Quantity
        Quantities of all repetitions.
    simulated : iterable of Quantity
        Quantities of all runs of the twin.
    set_from : dict of str to str, optional
        Quantities that are input of the twin, with their source ("measured" or "stated").  Their agreement does not
        test the model, and the note of the row says so.
    run_name : str
        Name of one run of the twin ("heap") if runs differ from seed to seed by an amount that one run cannot show;
        empty if they do not.
    without_twin : str
        Why there is no twin.
    assumed : sequence of str
        Settings of the twin that are neither stated nor measured.
    seen : str
        Settings that the twin takes from the media.
    scatter : callable, optional
        Returns for the name of a quantity what is known beforehand of its scatter from repetition to repetition, and
        from run to run of a twin with a `run_name`.
    failed_checks : callable, optional
        Returns for the key of a quantity the checks that failed in the repetitions of which its value is the mean,
        whether or not it rests on them.

    Returns
    -------
    tuple of Deviation
        One row for each measured quantity, without simulated values where the twin has no counterpart.

    Notes
    -----
    z is the difference over its standard uncertainty.  The two differ if abs(z) exceeds the coverage factor of
    Student's t with the effective degrees of freedom, "probably" below the factor of `SURE`.  Those that do not differ
    agree if the deviation with its expanded uncertainty lies within `UNINFORMATIVE` of zero and they
    would not differ with many degrees of freedom.

    References
    ----------
    JCGM 100:2008 (GUM), annex G.4.
    """
    given = set_from or {}

    def prior(name: str) -> Scatter | None:
        return None if scatter is None or name in given else scatter(name)

    twins = {key: combine(ones, prior(key[0]) if run_name else None) for key, ones in group(simulated).items()}
    rows = {key: combine(ones, prior(key[0])) for key, ones in group(measured).items() if key[0] not in MOMENTS}
    found = []
    for key, row in rows.items():
        other = _counterpart(key, rows, twins)
        twin = None if other is None else twins[other]
        one = _deviation(experiment, rig, key, row, twin, given.get(key[0], ""), run_name, without_twin)
        about = [f"the twin takes from the media {seen}"] if seen and other is not None else []
        about += [f"the twin assumes {', '.join(assumed)}"] if assumed and other is not None else []
        failed = ", ".join(check.name for check in failed_checks(key)) if failed_checks is not None else ""
        one = replace(one, failed_check=failed, note="; ".join(filter(None, (one.note, *about))))
        if other is not None and other != key:
            one = replace(
                one, note="; ".join(filter(None, (one.note, f"the twin's value is by another method: {other[1]}")))
            )
        found.append(one)
    return tuple(found)


def _counterpart(key: Key, rows: Iterable[Key], twins: Iterable[Key]) -> Key | None:
    """The key of the twin's quantity with the same method; if each side has one method only, that one.

    The methods may differ, because a twin knows some values directly that are estimated from a film.
    """
    if key in twins:
        return key
    mine, theirs = ([other for other in keys if (other[0], *other[2:]) == (key[0], *key[2:])] for keys in (rows, twins))
    return theirs[0] if len(mine) == len(theirs) == 1 else None


def headlines(rows: Iterable[Deviation]) -> list[Deviation]:
    """Return the main results: those of each rig from the first bounce or collision and over both sides.

    Parameters
    ----------
    rows : iterable of Deviation
        Rows of one or more experiments.

    Returns
    -------
    list of Deviation
        In their order.
    """
    return _first_of(rows, RESULTS)


def verdict_counts(rows: Iterable[Deviation]) -> dict[str, int]:
    """Return how many rows have which verdict.

    Parameters
    ----------
    rows : iterable of Deviation
        Rows whose verdicts are counted.

    Returns
    -------
    dict of str to int
        By a clause like "probably differ" or "probably differs", without zeros.
    """
    rows = list(rows)
    found = {}
    for verdict, (plural, singular) in CLAUSES.items():
        if number := sum(row.verdict.startswith(verdict) for row in rows):
            found[singular if number == 1 else plural] = number
    return found


def summarized(rows: Sequence[Deviation]) -> str:
    """Return in words how many rows have which verdict.

    Parameters
    ----------
    rows : sequence of Deviation
        Rows whose verdicts are counted.

    Returns
    -------
    str
        Number of rows and of each verdict, as a clause.

    Examples
    --------
    >>> summarized([])
    '0 quantities measured and simulated'
    """
    parts = [f"{number} {words}" for words, number in verdict_counts(rows).items()]
    return f"{len(rows)} {'quantity' if len(rows) == 1 else 'quantities'} measured and simulated" + (
        f": {', '.join(parts)}" if parts else ""
    )


def primary_first(rows: Sequence[Deviation]) -> tuple[list[Deviation], list[Deviation]]:
    """Split rows into the most important ones and the rest (later bounces, single sides, other methods).

    Parameters
    ----------
    rows : sequence of Deviation
        Rows of one or more experiments.

    Returns
    -------
    primary, rest : list of Deviation
        All rows of an experiment without important ones are in `primary`.
    """
    first = _first_of(rows, RESULTS | MORE_SHOWN)
    with_first = {row.experiment for row in first}
    primary = [row for row in rows if row in first or row.experiment not in with_first]
    return primary, [row for row in rows if row not in primary]


def _first_of(rows: Iterable[Deviation], methods: dict[str, int]) -> list[Deviation]:
    found: list[Deviation] = []
    for row in rows:
        first = row.side in (None, "mean") and row.bounce in (None, 1) and row.collision in (None, 1)
        mine = (row.experiment, row.quantity, row.body)
        before = sum((other.experiment, other.quantity, other.body) == mine for other in found)
        if first and before < methods.get(row.quantity, 0):
            found.append(row)
    return found


def percent_deviation(
    measured: float, measured_u: float, simulated: float, simulated_u: float
) -> tuple[float, float] | None:
    """Percent deviation of a simulated from a measured value, with its standard uncertainty.

    Parameters
    ----------
    measured, measured_u : float
        Measured value and its standard uncertainty.
    simulated, simulated_u : float
        Simulated value and its standard uncertainty, in the same unit.

    Returns
    -------
    tuple of float or None
        Deviation and standard uncertainty [%]; None if the measured value is zero within its standard uncertainty.

    Notes
    -----
    The deviation is ``100 * (simulated - measured) / measured``.  Independent uncertainties are propagated to first
    order.

    References
    ----------
    JCGM 100:2008 (GUM), equation 10.

    Examples
    --------
    >>> deviation, u = percent_deviation(2.0, 0.02, 2.2, 0.0)
    >>> round(deviation, 6), round(u, 6)
    (10.0, 1.1)
    >>> percent_deviation(0.1, 0.2, 1.0, 0.0) is None
    True
    """
    if abs(measured) <= measured_u or measured == 0:
        return None
    percent = 100 * (simulated - measured) / measured
    from_simulated = simulated_u / measured
    from_measured = simulated * measured_u / measured**2
    return percent, 100 * math.hypot(from_simulated, from_measured)


def percent_interval(
    measured: float, measured_u: float, simulated: float, simulated_u: float, coverage_factor: float
) -> tuple[float, float]:
    """Return the interval of a percent deviation; if bounded, it excludes zero where abs(z) exceeds the factor.

    Parameters
    ----------
    measured, measured_u : float
        Measured value and its standard uncertainty.
    simulated, simulated_u : float
        Simulated value and its standard uncertainty, in the same unit.
    coverage_factor : float
        Factor on the standard uncertainty of a difference.

    Returns
    -------
    tuple of float
        Ends of the interval [%], infinite where the measured value is zero within its expanded uncertainty.

    Notes
    -----
    The ends are the ratios ``r`` for which ``abs(simulated - r * measured)`` is the coverage factor times its standard
    uncertainty.  They lie on both sides of `percent_deviation` and further from it on the side of larger ratios.

    References
    ----------
    Fieller 1954, J. R. Stat. Soc. B 16, 175.

    Examples
    --------
    >>> low, high = percent_interval(10.0, 1.0, 14.0, 1.0, 2.0)
    >>> round(low, 1), round(high, 1)
    (10.2, 81.4)
    """
    uncertain = coverage_factor * measured_u / abs(measured) if measured else math.inf
    if not uncertain < 1:
        return -math.inf, math.inf
    ratio, left = simulated / measured, 1 - uncertain**2
    half = math.hypot(coverage_factor * simulated_u / measured * math.sqrt(left), ratio * uncertain)
    return 100 * ((ratio - half) / left - 1), 100 * ((ratio + half) / left - 1)


def _deviation(
    experiment: str,
    rig: str,
    key: Key,
    measured: Combined,
    simulated: Combined | None,
    set_from: str,
    run_name: str,
    without_twin: str,
) -> Deviation:
    name, method, unit, identity = key
    detail = dict(identity)
    percent: tuple[float, float] | None = None
    z: float | None = None
    freedom = math.inf
    if simulated is not None:
        percent = percent_deviation(
            measured.value, measured.std_uncertainty, simulated.value, simulated.std_uncertainty
        )
        total = math.hypot(measured.std_uncertainty, simulated.std_uncertainty)
        z = _z(simulated.value - measured.value, total)
        parts = ((one.std_uncertainty, one.freedom) for one in (measured, simulated))
        freedom = _freedom(parts, total)
        if _lone(run_name, measured, simulated) and not set_from:
            # the scatter of one repetition has no degrees of freedom, so any difference may be chance, without a prior
            freedom = 0.0
    reasons = [measured.doubtful] if measured.doubtful else []
    if simulated is not None and simulated.doubtful:
        reasons.append(f"{OF_THE_TWIN}{simulated.doubtful}")
    return Deviation(
        experiment=experiment,
        rig=rig,
        quantity=name,
        method=method,
        unit=unit,
        bounce=_whole(detail.get("bounce")),
        collision=_whole(detail.get("collision")),
        body=_text(detail.get("body")),
        side=_text(detail.get("side")),
        measured=measured.value,
        measured_std=measured.std,
        measured_n=measured.n,
        measured_std_uncertainty=measured.std_uncertainty,
        simulated=None if simulated is None else simulated.value,
        simulated_std=None if simulated is None else simulated.std,
        simulated_n=0 if simulated is None else simulated.n,
        simulated_std_uncertainty=None if simulated is None else simulated.std_uncertainty,
        percent_deviation=None if percent is None else percent[0],
        percent_deviation_std=None if percent is None else percent[1],
        z=z,
        coverage_factor=None if z is None else _coverage(freedom, 0.95),
        verdict=_verdict(measured, simulated, z, freedom, percent, doubtful=bool(reasons), given=bool(set_from)),
        scatter=measured.scatter,
        scatter_from="" if measured.prior is None else measured.prior.source,
        doubtful="; ".join(reasons),
        note=_note(run_name, measured, simulated, set_from, without_twin),
        budget=measured.budget,
    )


def _split(quantity: Quantity) -> tuple[float, dict[str, float]]:
    """The part that averages out over repetitions, and the named parts that do not, in the quantity's unit."""
    if not math.isfinite(quantity.std_uncertainty):
        return 0.0, {"unknown": math.inf}
    if not quantity.budget:
        return 0.0, {"measurement": quantity.std_uncertainty}
    own = {name: part for name, part in quantity.budget.items() if name in AVERAGES_OUT}
    shared = {name: part for name, part in quantity.budget.items() if name not in AVERAGES_OUT}
    # an estimator may widen its uncertainty beyond the listed parts if the result is doubtful
    beyond = quantity.std_uncertainty**2 - root_sum_of_squares(quantity.budget) ** 2
    if beyond > 1e-9 * quantity.std_uncertainty**2:
        shared["unexplained"] = math.sqrt(beyond)
    return root_sum_of_squares(own), shared


def _z(difference: float, uncertainty: float) -> float | None:
    if not math.isfinite(uncertainty) or uncertainty <= 0:
        return None
    return difference / uncertainty


def _freedom(parts: Iterable[tuple[float, float]], total: float) -> float:
    """Effective degrees of freedom of `total` from its parts, each (uncertainty, degrees of freedom) (GUM eq. G.2b)."""
    if not math.isfinite(total) or total <= 0:
        return math.inf
    loss = sum((part / total) ** 4 / freedom for part, freedom in parts)
    return 1 / loss if loss > 0 else math.inf


def _coverage(freedom: float, probability: float) -> float:
    """Standard uncertainties on each side of a value that hold `probability` (Student's t)."""
    from scipy.special import ndtri, stdtrit

    if freedom <= 0:
        return math.inf
    upper = (1 + probability) / 2
    return float(stdtrit(freedom, upper) if math.isfinite(freedom) else ndtri(upper))


def _limit(coverage_factor: float) -> float:
    """Limit of abs(z): two standard uncertainties, or what spans 95 % where that is more."""
    return max(2.0, coverage_factor)


def _verdict(
    measured: Combined,
    simulated: Combined | None,
    z: float | None,
    freedom: float,
    percent: tuple[float, float] | None,
    *,
    doubtful: bool,
    given: bool,
) -> str:
    if simulated is None:
        return "no twin value"
    if given:
        return "set equal" if z is None or abs(z) < _limit(_coverage(freedom, 0.95)) else "differs from the setting"
    if doubtful:
        return "doubtful"
    if z is None:
        return "uncertainty unknown"
    span = _limit(_coverage(freedom, 0.95))
    if abs(z) >= span:
        certainty = "probably " if abs(z) < _coverage(freedom, SURE) else ""
        return f"twin {certainty}too {'high' if z > 0 else 'low'}"
    half = (span if math.isfinite(span) else 2.0) * (0.0 if percent is None else percent[1])  # [%]
    # relative to an uncertain value a large deviation may exceed its expanded uncertainty where z is within its span
    within = percent is None or abs(percent[0]) <= min(half, UNINFORMATIVE - half)
    # where only the few degrees of freedom keep a difference from being significant, it may be real
    if within and abs(z) < 2:
        return "agrees"
    # what more repetitions would leave
    if percent is None or abs(z) >= 2:
        return "too few repetitions to tell"
    shared = math.hypot(*(_shared(one) for one in (measured, simulated))) / abs(measured.value)
    return "too few repetitions to tell" if 200 * shared <= UNINFORMATIVE else "too uncertain to tell"


def _shared(one: Combined) -> float:
    """The part of the standard uncertainty that does not average out over repetitions."""
    averaged = max((one.budget.get(name, 0.0) for name in ("repetition", "random")), default=0.0)
    return math.sqrt(max(one.std_uncertainty**2 - averaged**2, 0.0))


def _lone(run_name: str, measured: Combined, simulated: Combined) -> list[str]:
    """The sides with a single repetition, where repetitions differ and nothing is known of their scatter."""
    single = {
        "measured": measured.n == 1 and measured.scatter is None,
        "simulated": simulated.n == 1 and run_name != "" and simulated.scatter is None,
    }
    return [side for side, alone in single.items() if alone]


def _note(run_name: str, measured: Combined, simulated: Combined | None, set_from: str, without_twin: str) -> str:
    notes = ["the measured value is stated in lab.toml"] if measured.stated else []
    if simulated is None and without_twin != ONLY_MEASURED:
        notes.append(f"no twin: {without_twin}" if without_twin else "the twin gives no such number")
    if simulated is not None and not set_from and (lone := _lone(run_name, measured, simulated)):
        what = run_name or "repetition"
        notes.append(f"one {what} {' and one '.join(lone)}: the scatter of {what}s is not in the uncertainty")
    sides = (("measured", measured, ""), ("simulated", simulated, run_name))
    few = [
        f"{one.n} {name} {what or 'repetition'}{'s' if one.n > 1 else ''}"
        for name, one, what in sides
        if one is not None and one.prior is not None
    ]
    if few and measured.prior is not None and measured.scatter is not None:
        notes.append(
            f"{' and '.join(few)}: a scatter of {100 * measured.scatter:.2g} % is in the uncertainty "
            f"({measured.prior.source})"
        )
    for name, one, what in sides:
        if one is not None and one.prior is not None and one.own_scatter is not None:
            notes.append(
                f"the {one.n} {name} {what or 'repetition'}s scatter by {100 * one.own_scatter:.2g} %, too much for a "
                f"scatter of {100 * one.prior.relative:.2g} % ({one.prior.source}; F test, p < {CONTRADICTED:g})"
            )
    if set_from:
        notes.append(f"the twin starts from the {set_from} value")
    if measured.left_out:
        notes.append(f"{counted(measured.left_out, 'doubtful repetition')} left out")
    if simulated is not None and simulated.left_out:  # no warning of the twin gives the reason
        run = counted(simulated.left_out, f"doubtful {run_name or 'run'}")
        notes.append(f"{run} of the twin left out ({simulated.left_out_for}), {simulated.n} counted")
    return "; ".join(notes)


def _whole(value: Detail | None) -> int | None:
    return None if value is None else int(value)


def _text(value: Detail | None) -> str | None:
    return None if value is None else str(value)
