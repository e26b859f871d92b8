"""Find the experiment that would separate rival effects: each setting is simulated with both fitted models.

The prediction of one model is fitted with the other.  The unknowns of the other have the covariance of the present fit
as prior, and its releases and impacts are free.  The remaining misfit is the expected separation (Box & Hill 1967,
linearised).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np

from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.fitting.fit import Fit
from rigtwin.compare.diagnose.fitting.normal_equations import Regioned, linear_at
from rigtwin.compare.diagnose.fitting.subset import subset
from rigtwin.compare.diagnose.models.drop import ONE_MATERIAL
from rigtwin.compare.diagnose.models.sensitivities import slopes
from rigtwin.lab.arrays import Array
from rigtwin.sim.effects import named
from rigtwin.sim.effects.effect import WIDENING

REPETITIONS = 5  # repetitions assumed for each setting
MORE = (10, 20)  # repetitions tried if no setting separates the rivals with fewer
LEADING = 4  # settings that are evaluated in both directions
ENOUGH = 0.02  # relative decrease of the misfit that ends the fit
START = 0.03  # [s], start of the motion in the simulated record
LONGEST = 20.0  # [s], longest simulated record
SPHERE = 4 / 3 * math.pi  # volume of a sphere over the cube of its radius
OF_MATERIAL = ("restitution.", "rolling_friction.", "static_friction.")
CLEAR = 4.0
"""Separation in standard deviations that separates two names."""


@dataclass(frozen=True)
class Setting:
    """One change of the experiment."""

    words: str
    density: float = 1.0  # times that of the bead used
    size: float = 1.0
    state: Mapping[str, float] = field(default_factory=dict)
    """Quantities of the rig by the name of the bench's attribute, SI units."""
    release: float | None = None
    """The height [m] or the angle [rad] of the release."""
    longer: float = 1.0
    thickness: float = 1.0
    """Factor on the thickness of the plate, same material."""

    @property
    def elsewhere(self) -> bool:
        """Whether another ball is used, whose restitution and friction are unknown."""
        return self.density != 1.0 or self.size != 1.0

    @property
    def change(self) -> dict[str, Any]:
        """All changes from the starting condition, by the names above."""
        everything = asdict(self)
        return {name: everything[name] for name in ("density", "size", "state", "release", "longer", "thickness")}


@dataclass(frozen=True)
class Design:
    """A setting and the separation of the rivals expected there."""

    words: str
    separation: float  # [standard deviations], of the pair with the smallest separation
    between: tuple[str, str] = ("", "")
    start: str = ""
    """The condition that the setting starts from."""
    change: Mapping[str, Any] = field(default_factory=dict)
    repetitions: int = REPETITIONS

    def to_json(self) -> dict[str, Any]:
        return {
            "setting": self.words,
            "separation_sigma": self.separation,
            "hardest_pair": list(self.between),
            "condition": self.start,
            "change": dict(self.change),
            "repetitions": self.repetitions,
        }


def designs(bench: Regioned, rivals: Sequence[Fit]) -> list[Design]:
    """All settings of the rig, largest separation first.  Rivals that only widen the noise cannot be compared."""
    rivals = [one for one in rivals if not any(term.geometry in WIDENING for term in one.terms)]
    pairs = list(combinations(rivals, 2))
    if not pairs:
        return []
    start = bench.condition_names[bench.condition[_like(bench)]]
    found = []
    for setting in settings(bench):
        least = _hardest(bench, setting, pairs)
        if least is not None:  # a setting for which one pair has no finite separation is left out
            found.append((setting, *least))
    found.sort(key=lambda one: -one[1])
    # the separation depends little on which rival is true; for the leading settings both cases are computed
    turned = [(other, one) for one, other in pairs]
    leading = []
    for setting, apart, between in found[:LEADING]:
        if (least := _hardest(bench, setting, turned)) is not None:
            leading.append((setting, *min((apart, between), least)))
    leading.sort(key=lambda one: -one[1])
    ranked = [
        Design(setting.words, apart, between, start, setting.change)
        for setting, apart, between in leading + found[LEADING:]
    ]
    for count in MORE if leading else ():
        if ranked[0].separation >= CLEAR:
            break
        if (least := _hardest(bench, leading[0][0], [*pairs, *turned], count)) is not None:
            ranked[0] = replace(ranked[0], separation=least[0], between=least[1], repetitions=count)
    return ranked


def _hardest(
    bench: Regioned, setting: Setting, pairs: Sequence[tuple[Fit, Fit]], repetitions: int = REPETITIONS
) -> tuple[float, tuple[str, str]] | None:
    """Smallest separation of any pair, and the names of that pair; None if one separation is not finite."""
    apart = []
    for one, other in pairs:
        found = separation(bench, setting, one, other, repetitions)
        if not math.isfinite(found):
            return None
        apart.append((found, (_names(one), _names(other))))
    return min(apart)


def _names(fitted: Fit) -> str:
    return " + ".join(term.name for term in fitted.terms)


def settings(bench: Regioned) -> list[Setting]:
    """Possible settings of a rig of this kind."""
    whole: Any = bench
    like = _like(bench)
    density = float(whole.mass[like] / (SPHERE * whole.radius[like] ** 3))
    common = [
        Setting("a steel ball of the same size", density=7850.0 / density),
        Setting("a foam ball of the same size (30 kg/m^3)", density=30.0 / density),
        Setting("a ball of the same material, twice the size", size=2.0),
        Setting("a ball of the same material, half the size", size=0.5),
    ]
    rig = whole.lab.rig
    if rig == "drop":
        heights = (0.02, 0.05, 0.15, 0.5, 1.0, 2.0)
        return [*(Setting(f"drops from {1000 * h:.0f} mm", release=h) for h in heights), *common, *_plates(bench)]
    if rig in ("pendulum", "double"):
        angles = [Setting(f"release from {a} degrees", release=math.radians(a)) for a in (5, 10, 20, 45, 75)]
        long = [Setting("a record four times as long", longer=4.0)] if not hasattr(bench, "impacts") else []
        threads = [
            Setting(f"a thread of {1000 * length:.0f} mm", state={"length": length})
            for length in (0.5 * float(whole.length.min()), 2.0 * float(whole.length.max()))
        ]
        return [*angles, *long, *threads, *common]
    if rig == "roll":
        slopes_ = [
            Setting(f"an incline of {a} degrees", state={"slope": math.radians(a), "push": 0.0, "side": 1.0})
            for a in (3, 8, 15, 25)
        ]
        pushes = [
            Setting(f"a push of {v} m/s on the level{way}", state={"slope": 0.0, "push": v, "side": side})
            for v in (0.2, 0.5, 1.0, 2.0)
            for way, side in (("", 1.0), (", the other way", -1.0))
        ]
        return [*slopes_, *pushes, *common]
    waits = [Setting(f"a wait of {w:g} s on the level arm", state={"waiting": w}) for w in (1.0, 60.0, 1800.0)]
    rates = [Setting(f"tilting at {r} degrees per second", state={"rate": math.radians(r)}) for r in (0.2, 5.0)]
    weights = [
        Setting(f"a clump of {k} times the weight", state={"clump": k * float(whole.clump.min())}) for k in (5, 25)
    ]
    return [*waits, *rates, *weights]


def _plates(bench: Regioned) -> list[Setting]:
    """Other plates, if the lab states enough of its own for the thickness to have an effect."""
    whole: Any = bench
    lab, condition = whole.lab, whole.conditions[_like(bench)]
    counting = [p for p in named("plate_compliance").parameters if lab.stated_for(condition, p) is not None]
    if not counting:
        return []
    thick = float(lab.stated["walls"][condition.wall]["thickness_m"])
    return [
        Setting(f"a plate of the same material, {1000 * times * thick:.3g} mm thick", thickness=times)
        for times in (0.5, 2.0, 4.0)
    ]


def separation(bench: Regioned, setting: Setting, one: Fit, other: Fit, repetitions: int = REPETITIONS) -> float:
    """Separation in standard deviations: misfit of `other`, fitted to data predicted by `one`.

    NaN where it is not known, as for forces that depend on the place along x: flights of another fall begin elsewhere.
    """
    if any(term.sideways is not None for term in (*one.terms, *other.terms)):
        return math.nan
    try:
        place, values = laid_out(bench, setting, one)
        truth = lawful(place, one, values)
        place.rows = slopes(place, one.unknowns, one.terms, truth, values).position
        anew = 1.0 if setting.elsewhere else ONE_MATERIAL if setting.thickness != 1.0 else 0.0
        return _left_over(place, other, truth, anew=anew, repetitions=repetitions)
    except (np.linalg.LinAlgError, ValueError, FloatingPointError):
        return math.nan


def _like(bench: Regioned) -> int:
    """The repetition that the settings start from: the one with the most impacts."""
    active = getattr(bench, "active", None)
    return 0 if active is None else int(np.argmax(active.sum(axis=1)))


def laid_out(bench: Regioned, setting: Setting, fitted: Fit) -> tuple[Any, Array]:
    """A bench of one repetition at this setting, and the values of the unknowns there."""
    whole: Any = bench
    place: Any = copy.copy(subset(bench, [_like(bench)]))
    place.radius = place.radius * setting.size
    place.mass = place.mass * setting.density * setting.size**3
    if setting.thickness != 1.0:
        place.lab = _with_plate(whole.lab, place.conditions[0].wall, setting.thickness)
    for name, value in setting.state.items():
        setattr(place, name, np.full(1, value))
    place.local_prior = place.local_prior.copy()
    place.local_sd = place.local_sd.copy()
    rig = whole.lab.rig
    if setting.release is not None and rig == "drop":
        place.local_prior[0, 2] = setting.release + float(place.radius[0])
    elif rig == "drop":
        place.local_prior[0, 2] += float(place.radius[0]) * (1 - 1 / setting.size)
    elif setting.release is not None:
        place.local_prior[0, 1] = math.copysign(setting.release, place.local_prior[0, 1])
    if rig == "roll":
        place.local_prior[0, 2] = float(place.push[0])
        place.local_sd[0, 2] = 0.1 * float(place.push[0]) + 1e-5
    step = float(np.median(np.diff(np.unique(place.time))))
    length = _duration(place, setting, rig)
    grid = np.arange(0.0, length, step)
    bodies = place.bodies
    place.time = np.repeat(grid, bodies)
    place.rows = np.zeros((len(place.time), 2))
    place.sigma = np.full(len(place.time), float(place.sigma[0]))
    place.owner = np.zeros(len(place.time), dtype=int)
    place.spans = [slice(0, len(place.time))]
    if hasattr(whole, "body"):
        place.body = np.tile(np.arange(bodies), len(grid))
    return place, fitted.values.copy()


def _with_plate(lab: TrackedLab, wall: str, times: float) -> TrackedLab:
    """The lab with the thickness of the wall multiplied by `times`."""
    walls = dict(lab.stated["walls"])
    walls[wall] = {**walls[wall], "thickness_m": times * walls[wall]["thickness_m"]}
    return replace(lab, stated={**lab.stated, "walls": walls})


def _duration(place: Any, setting: Setting, rig: str) -> float:
    """Duration [s] of the simulated record."""
    if rig == "drop":
        fall = math.sqrt(2 * max(float(place.local_prior[0, 2] - place.radius[0]), 1e-3) / place.lab.gravity)
        return START + 3.0 * fall
    if rig == "roll" and float(place.push[0]) == 0.0:
        return START + math.sqrt(
            2 * 0.4 / max(0.7 * place.lab.gravity * (math.sin(float(place.slope[0])) - 0.02), 0.02)
        )
    return min(setting.longer * float(np.ptp(place.time)), LONGEST)


def lawful(place: Any, fitted: Fit, values: Array) -> Array:
    """Local unknowns (1, L) with the release as set and every impact or friction exactly as the law predicts."""
    local = place.local_prior.copy()
    if place.onset >= 0:
        local[:, place.onset] = START
    free = np.flatnonzero(~np.isfinite(place.local_sd[0]))
    for _ in range(3 + 2 * len(free)):
        seen = slopes(place, fitted.unknowns, fitted.terms, local, values)
        place.rows = seen.position  # a shutter's delay depends on the position
        if not len(free) or not seen.soft.size or float(np.abs(seen.soft).max()) < 1e-10:
            break
        jacobian = seen.by_soft[free, 0].T  # (S, free)
        change = np.linalg.lstsq(jacobian, -seen.soft[0], rcond=None)[0]
        local[0, free] += np.clip(change, -1.0, 1.0)
    return np.asarray(local)


def _left_over(place: Any, other: Fit, start: Array, *, anew: float, repetitions: int) -> float:
    """Misfit of the other model fitted to the data in `place`, with its present fit as prior.

    `anew` is the standard deviation of the difference of restitution and friction between there and here.
    """
    known = other.values
    loose = [anew**2 if u.name.startswith(OF_MATERIAL) else 0.0 for u in other.unknowns]
    covariance = other.covariance + np.diag(loose)
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    inner = covariance / np.outer(scale, scale)
    tie = np.linalg.inv(inner + 1e-9 * np.eye(len(scale))) / np.outer(scale, scale)
    free = tuple(replace(u, sd=math.inf) for u in other.unknowns)
    local, values, least = start, known, math.inf
    nearest = local, values
    for _ in range(6):
        linear = linear_at(place, other.terms, free, local, values, other.scatter)
        off = values - known
        cost = repetitions * linear.objective + float(off @ tie @ off)
        if not cost < least:  # too long a step
            local, values = (best + 0.3 * (one - best) for one, best in zip((local, values), nearest, strict=True))
            continue
        gained, least, nearest = least - cost, cost, (local, values)
        if gained < ENOUGH * cost:
            break
        ab = np.linalg.solve(linear.a, linear.b)[0]
        ag = np.linalg.solve(linear.a, linear.g_local[..., None])[0, :, 0]
        block = repetitions * (linear.c[0] - linear.b[0].T @ ab) + tie
        pull = repetitions * (linear.g_global[0] - ab.T @ linear.g_local[0]) - tie @ off
        step = np.linalg.solve(block, pull)
        values = values + step
        local = local + (ag - ab @ step)[None]
    return math.sqrt(max(least, 0.0)) if math.isfinite(least) else math.nan
