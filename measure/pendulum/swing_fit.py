"""Fit the swing of one or two beads to their tracks, through all collisions at once.

All frames before, between and after the collisions are fitted together.  The speeds at the contact therefore follow
from hundreds of frames, damping is not counted as restitution, and the time of the contact is where the swings before
and after it meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from rigtwin.lab.arrays import Array, Mask
from rigtwin.lab.errors import NothingToMeasure
from rigtwin.lab.quantity import root_sum_of_squares
from rigtwin.lab.records import Track
from rigtwin.measure.geometry.circle import fit_circle
from rigtwin.measure.pendulum.swing_model import Swings, angles, pivots, positions, states_at_collision
from rigtwin.measure.robust import autocorrelation_factor, mad_std

NOWHERE = 1e9  # [standard deviations], of a point from a swing that has no position there
FEWEST = 5  # positions of a bead, before and after a hit
SETTLED = 0.02  # relative change of the noise below which its iteration has converged
MOST_LAGS = 25  # at which the autocorrelation of residuals is summed

FEWEST_AFTER = 3  # minimum number of points after a collision for the speed of a bead

# share of bead A's arc after which the holder (a finger) neither occludes nor touches it any more
CLEAR = 0.03

# Priors of parameters that one short swing hardly determines; (mean, standard deviation).
PRIORS = {
    "damping": (0.03, 0.1),  # [1/s], pivot and thread
    # [1/rad], rho_air Cd A L / (2 m): 0.006 to 0.01 for 6 to 12 mm beads of plastic or wood on 0.15 to 0.3 m
    "drag": (0.01, 0.015),
    # With a camera 2.5 pendulum lengths away whose axis is 2 degrees off the normal of the swing plane, the scale one
    # length from the middle is 1.4 % larger on one side; barrel distortion of a lens is up to about 0.5 % there.
    "perspective_x": (0.0, 0.014),
    "perspective_y": (0.0, 0.014),
    "lens": (0.0, 0.003),
}

# Wider priors for strong distortion: the tracks of a long swing determine it, up to some tenth at the picture's edge.
BENT = {"perspective_x": (0.0, 0.05), "perspective_y": (0.0, 0.05), "lens": (0.0, 0.05)}

MOST_BENT = 3.0  # prior standard deviations beyond which the view is that of a strong lens or an oblique camera

_CAUSES = {
    "damping": "damping",
    "drag": "damping",
    "perspective_x": "perspective",
    "perspective_y": "perspective",
    "lens": "lens",
}


@dataclass(frozen=True)
class Outcome:
    """A number derived from a fit, and its standard uncertainty by cause."""

    value: float
    budget: dict[str, float]

    @property
    def std(self) -> float:
        return root_sum_of_squares(self.budget)


@dataclass(frozen=True)
class StatedPivots:
    """Pivots that the user states, in the axes of the tracks: of bead A, then of bead B."""

    places: tuple[tuple[float, float], ...]
    sigma: float  # standard uncertainty of each coordinate

    def moved(self, origin: Array, unit: float) -> StatedPivots:
        """The same in axes with this origin, in this unit of length."""
        places = (np.array(self.places) - origin) / unit
        return StatedPivots(tuple((float(x), float(y)) for x, y in places), self.sigma / unit)


NO_PIVOTS = StatedPivots((), 1.0)


@dataclass(frozen=True)
class SwingFit:
    """`Swings` fitted to tracks."""

    swings: Swings
    tracks: tuple[Track, ...]
    used: tuple[Mask, ...]  # which points of each track were fitted
    residuals: tuple[Array, ...]  # [m], observed minus fitted, shape (n, 2) per track, also of points not used
    noise: float  # [m], standard deviation of one coordinate of a used point
    covariance: Array  # of the parameter vector
    parts: dict[str, Array]  # parts of the covariance by cause; their sum is the covariance
    bent: bool = False  # whether lens and perspective exceed those of a usual lens and a careful set-up
    stated: StatedPivots = NO_PIVOTS

    def propagate(self, function: Callable[[Swings], dict[str, Array]]) -> dict[str, Outcome]:
        """Propagate the covariance through `function` (values of shape (batch,)): values and uncertainty by cause."""
        columns, steps = _perturbed(self.swings, np.sqrt(np.diag(self.covariance)) * 0.05)
        outcomes = {}
        for name, values in function(self.swings.batch(columns)).items():
            gradient = (values[1:] - values[0]) / steps
            variances = {cause: float(gradient @ part @ gradient) for cause, part in self.parts.items()}
            budget = {cause: math.sqrt(max(variance, 0.0)) for cause, variance in variances.items()}
            outcomes[name] = Outcome(float(values[0]), budget)
        return outcomes


def fit_swings(
    tracks: Sequence[Track],
    *,
    axis: tuple[float, float] | None = None,
    ground: float = 0.0,
    most_collisions: int = 3,
    stated: StatedPivots = NO_PIVOTS,
) -> SwingFit:
    """Fit the swing of bead A (``tracks[0]``) into bead B (``tracks[1]``) or, for a single track, into a wall.

    `axis` is the principal point in the record's axes, if known: perspective scales lengths about it.  `ground` is the
    position-dependent shift of a filmed bead's centre by its background, as a share of the noise.  `stated` pivots are
    priors of the fit.

    Raises `NothingToMeasure` if there is no release, no collision, or too few points of either.
    """
    for track in tracks:
        if len(track.time) < FEWEST:
            raise NothingToMeasure(
                f"bead {track.body} has {len(track.time)} positions in the whole record, {FEWEST} are needed; film "
                "with the beads in clear contrast to what is behind them, or narrow the search with --region."
            )
    origin, unit = tracks[0].position[0], float(np.ptp(tracks[0].position[:, 0]))
    if not unit > 0:
        raise NothingToMeasure(
            f"all {len(tracks[0].time)} positions of bead A have the same x; let the clip run from before the release."
        )
    scaled = tuple(
        replace(track, position=(track.position - origin) / unit, sigma=track.sigma / unit) for track in tracks
    )
    first = _first_guess(scaled)
    if axis is not None:
        first = replace(first, axis=((axis[0] - float(origin[0])) / unit, (axis[1] - float(origin[1])) / unit))
    hinges = stated.moved(origin, unit) if stated.places else stated
    fit = _fit(first, scaled, ground, hinges)
    if axis is not None and _bends(fit.swings):
        with suppress(NothingToMeasure):  # then keep the fit with the narrow priors
            fit = _fit(fit.swings, scaled, ground, hinges, bent=True)
    while fit.swings.collisions < most_collisions:
        further = _with_next_collision(fit)
        if further is None:
            break
        # if a later collision does not fit (the beads leave the plane, a track is lost), keep the earlier ones
        try:
            longer = _fit(further, scaled, ground, hinges, bent=fit.bent)
        except NothingToMeasure:
            break
        if longer.noise > 1.5 * fit.noise:
            break
        fit = longer
    return replace(_in_record_units(fit, tuple(tracks), origin, unit), stated=stated)


def misses_of(fit: SwingFit, late: float = 0.0) -> Array:
    """Residuals of all used points and of the priors, in units of their noise; points shifted by `late` [s].

    Order: for each bead x of all points, then y; then the priors, and the stated pivots.
    """
    data = _data_of(fit)
    moved = tuple(replace(track, time=track.time + late) for track in data.tracks)
    return _misses(fit.swings.batched(), replace(data, tracks=moved))[:, 0]


def slopes_of(fit: SwingFit) -> Array:
    """Derivatives of the residuals by the parameters, shape (n, parameters)."""
    return _slopes(fit.swings, _data_of(fit))


def _data_of(fit: SwingFit) -> _Data:
    priors = PRIORS | BENT if fit.bent else PRIORS
    return _Data(fit.tracks, tuple(_weights(track) for track in fit.tracks), fit.used, fit.noise, priors, fit.stated)


def _bends(swings: Swings) -> bool:
    return any(abs(float(swings[name]) - PRIORS[name][0]) > MOST_BENT * PRIORS[name][1] for name in BENT)


def onset(track: Track) -> int | None:
    """Index of the first point at which the body has clearly left its first position; None if it never does."""
    first = np.median(track.position[:5], axis=0)
    away = np.hypot(*(track.position - first).T)
    moved = away > max(8 * jitter(track), 0.02 * float(np.percentile(away, 95)))
    settled = moved[:-2] & moved[1:-1] & moved[2:]
    if float(np.percentile(away, 95)) < 12 * jitter(track) or not np.any(settled):
        return None
    return int(np.argmax(settled))


def _at_rest(track: Track) -> str:
    away = np.hypot(*(track.position - np.median(track.position[:5], axis=0)).T)
    times = float(np.percentile(away, 95)) / max(jitter(track), 1e-12)
    return (
        f"bead {track.body} does not clearly leave its first position from {track.time[0]:.3f} to "
        f"{track.time[-1]:.3f} s: most positions lie within {times:.1f} times their noise of it, and 12 are needed, at "
        "three frames in a row"
    )


def jitter(track: Track) -> float:
    """Noise of one coordinate [m] from second differences: an upper limit, as it includes the path's curvature."""
    second = np.diff(track.position, n=2, axis=0)
    return float(np.median(np.abs(second))) / (0.6745 * math.sqrt(6))


def frame_interval(track: Track) -> float:
    """Frame interval [s]."""
    return float(np.median(np.diff(track.time)))


def _first_guess(tracks: tuple[Track, ...]) -> Swings:
    a = tracks[0]
    start, hit = onset(a), _first_hit(tracks)
    if start is None:
        raise NothingToMeasure(f"{_at_rest(a)}; let the clip run from before the release.")
    hit_time = float(tracks[-1].time[hit])
    falling = np.arange(start, int(np.searchsorted(a.time, hit_time)))
    if len(falling) < 6:
        raise NothingToMeasure(
            f"bead A has {len(falling)} positions between its first motion at {a.time[start]:.3f} s and the collision "
            f"at {hit_time:.3f} s, 6 are needed; film at a higher rate, or let the clip begin before the release."
        )
    circles = [fit_circle(track.position) for track in tracks]
    lowest = np.median(tracks[1].position[: max(hit, 1)], axis=0) if len(tracks) > 1 else a.position[hit]
    down = lowest - circles[-1][0]
    tilt = math.atan2(down[0], -down[1])
    angle = [_angle(track, centre, tilt) for track, (centre, _) in zip(tracks, circles, strict=True)]
    pull = _pull(a.time[falling], angle[0][falling])
    if len(tracks) > 1:  # extrapolate B back to its rest position
        leaving = _slope(tracks[1].time, angle[1], float(tracks[1].time[hit - 1]), 0.3 / math.sqrt(pull))
        hit_time -= max(float(angle[1][hit]) / leaving, 0.0) if leaving != 0 else 0.0
    _seen_after(hit_time, tracks)
    release = float(np.median(angle[0][: max(start, 1)]))
    fallen = abs(float(angle[0][start]) - release)
    release_time = float(a.time[start]) - math.sqrt(2 * fallen / (pull * max(abs(math.sin(release)), 0.05)))
    values = {
        "tilt": tilt,
        "gravity": pull * circles[0][1],
        **{name: mean for name, (mean, _) in PRIORS.items()},
        "release_angle": release,
        "release_time": release_time,
        "time_0": hit_time,
    }
    beads = len(tracks)
    for bead, (centre, radius) in enumerate(circles):
        values |= {f"pivot_x_{bead}": centre[0], f"pivot_y_{bead}": centre[1], f"length_{bead}": radius}
        values[f"speed_0_{bead}"] = _slope(tracks[bead].time, angle[bead], hit_time, 0.5 / math.sqrt(pull))
    return Swings(np.array([values[name] for name in Swings.names(beads, 1)]), beads, 1)


def _seen_after(hit: float, tracks: tuple[Track, ...]) -> None:
    """Raise `NothingToMeasure` if one bead is seen after the collision and the other is not."""
    ends = [float(np.max(track.time)) for track in tracks]
    for track, end in zip(tracks, ends, strict=True):
        if np.sum(track.time > hit) < FEWEST_AFTER and max(ends) > max(end, hit) + FEWEST_AFTER * frame_interval(track):
            raise NothingToMeasure(
                f"bead {track.body} has fewer than {FEWEST_AFTER} positions after the collision at {hit:.3f} s, though "
                f"the record goes on to {max(ends):.3f} s; clear the view, film larger, or, if another object was "
                "followed, narrow the search with --region."
            )


def _first_hit(tracks: tuple[Track, ...]) -> int:
    """Index into the last track of the first frame after the first collision."""
    if len(tracks) > 1:
        hit = onset(tracks[1])
        if hit is None:
            raise NothingToMeasure(f"{_at_rest(tracks[1])}; let the clip run on past the collision.")
        return hit
    # a wall reverses the bead at full speed; at the end of a swing it turns slowly
    track = tracks[0]
    step = np.diff(track.position, axis=0)
    kink = np.hypot(*np.diff(step, axis=0).T)
    if len(kink) < 10 or np.max(kink) < 6 * np.percentile(kink, 80) + 6 * jitter(track):
        raise NothingToMeasure(
            f"no sudden turn was found in the path of the bead from {track.time[0]:.3f} to {track.time[-1]:.3f} s; let "
            "the clip run past the impact on the wall."
        )
    return int(np.argmax(kink > 0.5 * np.max(kink))) + 2


def _angle(track: Track, centre: Array, tilt: float) -> Array:
    away = track.position - centre
    turned = np.arctan2(away[:, 0], -away[:, 1]) - tilt
    return np.asarray((turned + math.pi) % (2 * math.pi) - math.pi)


def _pull(time: Array, angle: Array) -> float:
    """g/L [1/s^2] from the energy of a fall: omega^2 = 2 g/L cos(theta) + const."""
    curve = np.polynomial.Polynomial.fit(time, angle, min(4, len(time) - 1))
    energy = curve.deriv()(time) ** 2
    slope = float(np.polynomial.Polynomial.fit(np.cos(curve(time)), energy, 1).convert().coef[-1])
    if not slope > 0:
        raise NothingToMeasure(
            f"bead A does not gain speed on its way down from {time[0]:.3f} to {time[-1]:.3f} s; let the clip begin "
            "before the release, with an upright camera."
        )
    return slope / 2


def _slope(time: Array, angle: Array, start: float, span: float) -> float:
    """Angular speed [rad/s] shortly after `start`."""
    later = time[time > start]
    near = (time > start) & (time <= max(start + span, later[min(4, len(later) - 1)] if len(later) else start))
    if np.sum(near) < FEWEST_AFTER:
        raise NothingToMeasure(
            f"a bead has {int(np.sum(near))} positions right after the collision at {start:.3f} s, {FEWEST_AFTER} are "
            "needed; film on for one more swing."
        )
    degree = 2 if np.sum(near) > 4 else 1
    return float(np.polynomial.Polynomial.fit(time[near], angle[near], degree).deriv()(start))


def _fit(
    swings: Swings, tracks: tuple[Track, ...], ground: float, stated: StatedPivots, *, bent: bool = False
) -> SwingFit:
    """Least squares with priors, without frames of contact, frames in which A is held, and outliers."""
    from scipy.optimize import least_squares

    priors = PRIORS | BENT if bent else PRIORS
    weights = [_weights(track) for track in tracks]
    outlier = [~np.all(np.isfinite(track.position), axis=1) for track in tracks]
    noise = 0.01 * float(swings["length_0"])
    used, weighed_by = list[Mask](), math.inf
    for _ in range(6):
        end = _end_of_last_swing(swings)
        chosen = [_usable(swings, track, bead, end) & ~outlier[bead] for bead, track in enumerate(tracks)]
        settled = (
            abs(noise - weighed_by) < SETTLED * noise
        )  # until then the priors have the wrong weight against the points
        if settled and all(np.array_equal(old, new) for old, new in zip(used, chosen, strict=True)):
            break
        used, weighed_by = chosen, noise
        _enough(used, swings, tracks)

        data = _Data(tracks, tuple(weights), tuple(used), noise, priors, stated)
        found = least_squares(
            _misses_at, swings.vector, jac=_slopes_at, args=(swings, data), method="lm", x_scale="jac", max_nfev=25
        )
        swings = swings.batch(found.x)
        residuals = _residuals(swings, tracks)
        swinging = float(swings["gravity"]) > 0 and np.all(swings.per_bead("length") > 0)
        if not (swinging and all(np.all(np.isfinite(residual)) for residual in residuals)):
            raise NothingToMeasure(
                "no swing fits the positions: the fit diverges, or ends without gravity or length; film larger, from "
                "before the release to past the collision, or, if other objects were followed, narrow the search with "
                "--region."
            )
        scaled = np.concatenate([(r * w[:, None])[u] for r, w, u in zip(residuals, weights, used, strict=True)])
        spread = mad_std(scaled, centre=0.0)
        noise = max(float(np.sqrt(np.mean(scaled[np.abs(scaled) < 6 * spread + 1e-12] ** 2))), 1e-7)
        outlier = [
            np.max(np.abs(r * w[:, None]), axis=1) > 6 * spread + 1e-9 for r, w in zip(residuals, weights, strict=True)
        ]
    data = _Data(tracks, tuple(weights), tuple(used), noise, priors, stated)
    covariance, parts = _covariance(swings, data, residuals, ground)
    return SwingFit(swings, tracks, tuple(used), tuple(residuals), noise, covariance, parts, bent)


def _weights(track: Track) -> Array:
    """Relative weight of each point: median sigma over its sigma."""
    sigma = track.sigma
    if not np.all(np.isfinite(sigma)) or np.min(sigma) <= 0:
        return np.ones(len(track.time))
    return np.asarray(np.median(sigma) / sigma)


def _usable(swings: Swings, track: Track, bead: int, end: float) -> Mask:
    """Points in free swing: A after its release, none whose exposure may contain a collision, none after `end` [s]."""
    dt = frame_interval(track)
    usable = track.time < end - dt
    if bead == 0:
        usable &= track.time > float(swings["release_time"]) + max(dt, _clearing(swings))
    for k in range(swings.collisions):
        usable &= np.abs(track.time - float(swings[f"time_{k}"])) > dt
    return np.asarray(usable)


def _clearing(swings: Swings) -> float:
    """Time after the release until bead A has left its holder [s]: it has moved by the share `CLEAR` of its arc.

    From rest it moves by g sin(a) t^2 / 2 along its circle of radius L; the whole arc is a L.
    """
    way, pull = abs(float(swings["release_angle"])), float(swings["gravity"] / swings["length_0"])
    return math.sqrt(2 * CLEAR * way / (pull * max(math.sin(way), 0.05)))


def _enough(used: list[Mask], swings: Swings, tracks: tuple[Track, ...]) -> None:
    hit = float(swings["time_0"])
    for mask, track in zip(used, tracks, strict=True):
        before, after = (int(np.sum(mask & side)) for side in (track.time < hit, track.time > hit))
        if after < FEWEST or (track is tracks[0] and before < FEWEST):
            raise NothingToMeasure(
                f"bead {track.body} has {before} positions that fit a free swing before the collision at {hit:.3f} s "
                f"and {after} after it, {FEWEST} are needed; film at a higher rate, and for one swing past the "
                "collision."
            )


def _residuals(swings: Swings, tracks: tuple[Track, ...]) -> list[Array]:
    return [
        track.position - positions(swings, angles(swings, track.time)[0])[bead, :, 0]
        for bead, track in enumerate(tracks)
    ]


@dataclass(frozen=True)
class _Data:
    """Data and priors of a fit."""

    tracks: tuple[Track, ...]
    weights: tuple[Array, ...]  # relative, of every point
    used: tuple[Mask, ...]
    noise: float  # [m], of a point of weight 1
    priors: dict[str, tuple[float, float]]  # mean and standard deviation
    stated: StatedPivots


def _misses_at(vector: Array, swings: Swings, data: _Data) -> Array:
    # a diverging swing has no position; the fit needs a number to turn back from there
    return np.nan_to_num(
        _misses(swings.batch(vector[:, None]), data)[:, 0], nan=NOWHERE, posinf=NOWHERE, neginf=-NOWHERE
    )


def _slopes_at(vector: Array, swings: Swings, data: _Data) -> Array:
    return np.nan_to_num(_slopes(swings.batch(vector), data), posinf=0.0, neginf=0.0)


def _slopes(swings: Swings, data: _Data) -> Array:
    """Derivatives of the residuals by finite differences, shape (n, parameters)."""
    columns, steps = _perturbed(swings)
    table = _misses(swings.batch(columns), data)
    return np.asarray((table[:, 1:] - table[:, :1]) / steps)


def _misses(swings: Swings, data: _Data) -> Array:
    """Weighted residuals of all used points and of the priors, shape (n, batch)."""
    rows = []
    time = np.unique(np.concatenate([track.time[mask] for track, mask in zip(data.tracks, data.used, strict=True)]))
    seen = positions(swings, angles(swings, time)[0])
    for bead, (track, weight, mask) in enumerate(zip(data.tracks, data.weights, data.used, strict=True)):
        here = seen[bead, np.searchsorted(time, track.time[mask])]
        miss = (track.position[mask][:, None] - here) * (weight[mask][:, None, None] / data.noise)
        rows += [miss[..., 0], miss[..., 1]]
    rows += [((swings[name] - mean) / deviation)[None] for name, (mean, deviation) in data.priors.items()]
    for bead, place in enumerate(data.stated.places[: swings.beads]):
        away = (pivots(swings)[bead, 0] - np.array(place)) / data.stated.sigma
        rows += [away[None, :, 0], away[None, :, 1]]
    return np.concatenate(rows)


def _perturbed(swings: Swings, steps: Array | None = None) -> tuple[Array, Array]:
    """The parameter vector, and one column per parameter with that one changed; shape (n, n + 1)."""
    if steps is None:
        steps = 1e-6 * np.maximum(np.abs(swings.vector), 0.1)
    return swings.vector[:, None] + np.column_stack([np.zeros(len(steps)), np.diag(steps)]), steps


def _covariance(swings: Swings, data: _Data, residuals: list[Array], ground: float) -> tuple[Array, dict[str, Array]]:
    """Covariance of the parameters and its parts: tracking noise, each prior, stated pivots, and the background.

    With information N from the data and P from the priors, C = (N + P)^-1 = C N C + sum of C P_i C.  A shift of all
    points that depends on position changes the parameters, not the residuals: C J^T d for each such pattern d.
    """
    slopes = _slopes(swings, data)
    causes_of_priors = [_CAUSES[name] for name in PRIORS] + ["pivot"] * 2 * len(data.stated.places[: swings.beads])
    count = len(slopes) - len(causes_of_priors)
    # correlated residuals (background, lens, texture) carry less information than their number suggests
    series = [values for residual, used in zip(residuals, data.used, strict=True) for values in residual[used].T]
    seen = slopes[:count].T @ slopes[:count] / correlation(series)
    causes = {"tracking": seen}
    for row, cause in enumerate(causes_of_priors):
        causes[cause] = causes.get(cause, np.zeros_like(seen)) + np.outer(slopes[count + row], slopes[count + row])
    inverse = _inverse(sum(causes.values(), np.zeros_like(seen)))
    parts = {cause: inverse @ information @ inverse for cause, information in causes.items()}
    if ground > 0:
        shifts = _inverse(slopes.T @ slopes) @ slopes[:count].T @ _shifts(swings, data) * ground
        parts["ground"] = shifts @ shifts.T
    return np.asarray(sum(parts.values(), np.zeros_like(seen))), parts


def _inverse(information: Array) -> Array:
    size = np.sqrt(np.diag(information))
    if not (np.isfinite(size) & (size > 0)).all():
        raise NothingToMeasure(
            "the positions do not determine every parameter of the swings; give a record with a longer swing."
        )
    return np.asarray(np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size))


def _shifts(swings: Swings, data: _Data) -> Array:
    """Patterns in which the background may shift the points, in units of their noise, shape (points, patterns).

    Horizontal and vertical shifts for each bead.
    """
    rows = []
    for bead, (track, weight, mask) in enumerate(zip(data.tracks, data.weights, data.used, strict=True)):
        ways = _ways(swings, bead, track.time[mask]) * weight[mask][:, None]
        rows += [np.hstack([ways, 0 * ways]), np.hstack([0 * ways, ways])]
    return np.concatenate(rows)


def ground_ways(fit: SwingFit) -> list[Array]:
    """Patterns in which the background may shift a bead's centre, for the used points of each, (points, patterns)."""
    swings, both = fit.swings, zip(fit.tracks, fit.used, strict=True)
    return [_ways(swings, bead, track.time[mask]) for bead, (track, mask) in enumerate(both)]


def _ways(swings: Swings, bead: int, time: Array) -> Array:
    """Patterns: polynomials of degree 1 to 3 over the position; rest; the square of the speed; drifts in time.

    A bead at rest hides a background that is never seen meanwhile, unlike a moving one.  Motion blur at high speed
    changes the weight of a bead's lit and dark side, and a codec copies slow objects from earlier frames.  What it
    copies also drifts in time between release and collisions: along a line and a parabola.
    """
    hit, reach = float(swings["time_0"]), float(swings["length_0"] * np.abs(np.sin(swings["release_angle"])))
    angle, speed = angles(swings, time)
    place = np.clip(float(swings[f"length_{bead}"]) * np.sin(angle[bead, :, 0]) / reach, -1, 1)
    waits = (time < hit) & (bead > 0)
    blur = (speed[bead, :, 0] / np.max(np.abs(speed))) ** 2
    drifts = _drifts(time, [float(swings[f"time_{k}"]) for k in range(swings.collisions)])
    drifts[waits] = 0
    return np.column_stack([np.polynomial.legendre.legvander(place, 3)[:, 1:], waits, blur, drifts])


def _drifts(time: Array, cuts: list[float]) -> Array:
    """A line and a parabola in time for each interval between the cuts, 0 elsewhere."""
    columns = np.zeros((len(time), 2 * (len(cuts) + 1)))
    stretch = np.searchsorted(cuts, time)
    for k in np.unique(stretch):
        mine = stretch == k
        since = time[mine] - time[mine][0]
        along = 2 * since / max(float(since[-1]), 1e-9) - 1
        columns[mine, 2 * k : 2 * k + 2] = np.polynomial.legendre.legvander(along, 2)[:, 1:]
    return columns


def correlation(series: Iterable[Array]) -> float:
    """Mean autocorrelation factor of the residuals of several coordinates, each up to its first zero."""
    return float(np.mean([autocorrelation_factor(each, min(MOST_LAGS, len(each) // 3)) for each in series]))


def _end_of_last_swing(swings: Swings) -> float:
    """Time at which the beads meet again after the last collision [s]."""
    start = float(swings[f"time_{swings.collisions - 1}"])
    period = 2 * math.pi * math.sqrt(float(np.max(swings.per_bead("length"))) / float(swings["gravity"]))
    time = start + np.linspace(0, 1.3 * period, 400)
    angle, _ = angles(swings, time)
    at, _ = states_at_collision(swings, swings.collisions - 1)
    apart = (angle - at[:, None])[..., 0]
    way = apart[0] if swings.beads == 1 else apart[1] - apart[0]
    opened = len(time) // 6  # a fifth of a period after the collision: well apart, long before they meet again
    closed = np.flatnonzero(way[opened:] * np.sign(way[opened]) <= 0)
    return float(time[opened + closed[0]]) if len(closed) else float(time[-1])


def _with_next_collision(fit: SwingFit) -> Swings | None:
    """The fitted swings with a first guess of the next collision; None if the record does not show it well."""
    swings = fit.swings
    hit = _end_of_last_swing(swings)
    values = dict(zip(Swings.names(swings.beads, swings.collisions), swings.vector, strict=True))
    pull = float(swings["gravity"] / swings["length_0"])
    k = swings.collisions
    values[f"time_{k}"] = hit
    for bead, track in enumerate(fit.tracks):
        if np.sum(track.time > hit + 1.5 * frame_interval(track)) < 12:
            return None
        centre = np.array([swings[f"pivot_x_{bead}"], swings[f"pivot_y_{bead}"]])
        angle = _angle(track, centre, float(swings["tilt"]))
        values[f"speed_{k}_{bead}"] = _slope(track.time, angle, hit + frame_interval(track), 0.4 / math.sqrt(pull))
    before = states_at_collision(swings, k - 1)[1]
    approach = abs(float(np.ptp(before))) if swings.beads > 1 else abs(float(before[0, 0]))
    # a collision with little rebound is hidden by the noise and the frames left out around it
    leaving = np.ptp(swings.after(k - 1)) if swings.beads > 1 else abs(float(swings.after(k - 1)[0]))
    if float(leaving) < 0.15 * approach:
        return None
    return Swings(
        np.array([values[name] for name in Swings.names(swings.beads, k + 1)]), swings.beads, k + 1, swings.axis
    )


def _in_record_units(fit: SwingFit, tracks: tuple[Track, ...], origin: Array, unit: float) -> SwingFit:
    names = Swings.names(fit.swings.beads, fit.swings.collisions)
    lengths = np.array([unit if name.startswith(("pivot", "length", "gravity")) else 1.0 for name in names])
    offset = np.array([origin["xy".index(name[6])] if name.startswith("pivot") else 0.0 for name in names])
    both = np.outer(lengths, lengths)
    axis = fit.swings.axis
    if axis is not None:
        axis = float(origin[0]) + axis[0] * unit, float(origin[1]) + axis[1] * unit
    return SwingFit(
        replace(fit.swings, vector=fit.swings.vector * lengths + offset, axis=axis),
        tracks,
        fit.used,
        tuple(residual * unit for residual in fit.residuals),
        fit.noise * unit,
        fit.covariance * both,
        {cause: part * both for cause, part in fit.parts.items()},
        fit.bent,
    )
