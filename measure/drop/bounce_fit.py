"""Fit all flights of a bouncing bead at once: gravity, air drag, contact times, plate level, camera geometry.

Between two contacts the bead flies freely.  With air drag that depends only on speed, every vertical flight is a piece
of one curve shifted in time, H - S(t - t_apex).  One release time and one apex height per bounce therefore describe the
whole record; a contact is where two neighbouring flights meet at the plate.  Heights, speeds at the contacts and flight
times all follow from this one fit.

Camera effects on the heights are fitted too, with priors for a careful set-up: perspective and lens (the scale changes
with height), and motion toward the camera (level and scale change along a flight).  No value is read from the nearest
frame: at 60 frames per second that alone would cause an error of 0.01 in the restitution.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from rigtwin.lab.arrays import Array, Mask
from rigtwin.lab.rigs import GRAVITY
from rigtwin.measure.drop.fall_in_air import AirDrag, Fall, longest_contact, tables_of
from rigtwin.measure.drop.sideways_motion import fit_sideways
from rigtwin.measure.robust import mad_std

# Standard deviations of the priors.
PERSPECTIVE = 0.02  # relative change of scale over the drop height: camera 2.5 drop heights away, pitched by 3 degrees
LENS = 0.01  # the same, quadratic term: 1 % barrel distortion at the edge of the picture
DRIFT = 0.04  # change of the plate's level over the height of a flight: a bead that leaves the plane by 2 degrees
# Duration of a contact as a share of the longest possible one: median and standard deviation for log-uniform moduli
# from rubber (1e7 Pa) to steel (2e11 Pa); the duration scales as the modulus to the power -0.4.  The median is used,
# not the mean, because most beads are hard.
USUAL_CONTACT, CONTACT_SPREAD = 0.14, 0.25
DRAG = 0.10  # relative uncertainty of a sphere's drag coefficient for a bead with a hole or a seam
DRAG_FORM = 0.3  # relative growth of a sphere's drag coefficient from a fall to its rebound, if the size is unknown
DRAG_HELD = 0.05  # relative prior width of a known drag: slow errors of a track look much like drag
LEAST_SEEN = 0.5  # minimum share of a flight's frames that must show the bead on the fitted curve
FEWEST_SEEN = 3  # minimum number of such frames, however short the flight is
FREE_DRAG = 0.3  # [1/m], prior width of the drag per mass of an unknown bead: a wooden bead of 6 mm has 0.2


@dataclass(frozen=True)
class Heights:
    """Height over time of a bouncing bead, in any unit of length."""

    time: Array  # [s], shape (n,)
    height: Array  # up, shape (n,)
    sigma: Array  # standard deviation, shape (n,); only relative values matter, the size is fitted
    across: Array | None = None  # horizontal position in a film, shape (n,): its residuals show errors of the film


@dataclass(frozen=True)
class Bounces:
    """The fitted record: parameters, their covariance, and the quantities derived from them."""

    model: _Model
    parameters: Array
    covariance: Array
    used: Mask  # which frames were fitted, shape (n,)
    residual: Array  # in the unit of the heights, shape (n,), NaN outside the flights
    noise: float  # in the unit of the heights, scatter of the fitted frames
    expected_noise: float  # the same from third differences, independent of the model
    time_offset: float  # [s], subtracted from the times before fitting

    @property
    def count(self) -> int:
        """Number of bounces that were seen with a flight before and after."""
        return self.model.count

    @property
    def contact_times(self) -> Array:
        """[s], shape (count,)"""
        return self.model.contacts(self.parameters)[: self.count] + self.time_offset

    @property
    def apex_times(self) -> Array:
        """[s], shape (count + 1,); the first is the release (or the apex before it)."""
        return self.model.apexes(self.parameters) + self.time_offset

    @property
    def span(self) -> float:
        """Drop height in the unit of the record."""
        reader = self.model.reader(self.parameters)
        return float(reader.heights[0]) * reader.size

    def curve(self, time: Array) -> Array:
        """Fitted heights at times [s], in the unit of the record; NaN outside the flights."""
        return self.model.curve(self.parameters, time - self.time_offset)

    def level(self, time: Array) -> Array:
        """Height of the bead's centre at contact at times [s], in the unit of the record."""
        return self.model.level(self.parameters, time - self.time_offset)

    @property
    def growth(self) -> tuple[Array, Array]:
        """Relative growth of the scale from contact 1 to contacts 2..N and the end, shape (count,), with uncertainty.

        The accelerations of the flights show it.
        """
        mine = self.model.causes["camera"][: self.count]
        return self.parameters[mine], np.sqrt(np.diag(self.covariance)[mine])

    def read(self, reading: Callable[[Reader], float]) -> tuple[float, dict[str, float]]:
        """Value of `reading` for the fitted parameters, and its standard uncertainty split by cause."""
        value = float(reading(self.model.reader(self.parameters)))
        gradient = np.zeros(len(self.parameters))
        for k, step in enumerate(0.1 * np.sqrt(np.diag(self.covariance)) + 1e-12):
            moved = self.parameters.copy()
            moved[k] += step
            gradient[k] = (reading(self.model.reader(moved)) - value) / step
        parts = {}
        free = np.ones(len(self.parameters), dtype=bool)
        before = float(gradient @ self.covariance @ gradient)
        information = np.linalg.pinv(self.covariance)
        for cause, mine in self.model.causes.items():
            free[mine] = False
            inner = np.linalg.pinv(information[np.ix_(free, free)])
            after = float(gradient[free] @ inner @ gradient[free])
            parts[cause] = math.sqrt(max(before - after, 0.0))
            before = after
        parts["tracking"] = math.sqrt(max(before, 0.0))
        # change of the reading per change of the drag, with the other parameters fitted again
        variance = float(self.covariance[-1, -1])
        follows = float(gradient @ self.covariance[:, -1]) / variance if variance > 0 else 0.0
        drag = self.model.drag
        strength = 1.0 if drag.known else float(self.parameters[-1])
        unlike = abs(follows * strength) * (DRAG if drag.diameter is not None else DRAG_FORM)
        parts["air drag"] = math.hypot(parts.get("air drag", 0.0), unlike)
        return value, parts


def find_contacts(record: Heights) -> npt.NDArray[np.intp]:
    """Frames nearest to the contacts: minima of the height that exceed the noise on both sides, shape (contacts,)."""
    y = record.height
    noise = third_difference_noise(record)
    span = float(np.ptp(y))
    if span <= 8 * noise:
        return np.zeros(0, dtype=np.intp)
    return _lows(y, max(8 * noise, 0.004 * span))


def _lows(y: Array, prominence: float) -> npt.NDArray[np.intp]:
    """Minima of at least this prominence on both sides.

    scipy.signal.find_peaks does the same, but its import takes longer than a whole measurement.
    """
    steps = np.flatnonzero(np.diff(y)) + 1
    starts, ends = np.concatenate([[0], steps]), np.concatenate([steps, [len(y)]])
    levels = y[starts]
    found = []
    for k in 1 + np.flatnonzero((levels[1:-1] < levels[:-2]) & (levels[1:-1] < levels[2:])):
        before, after = (np.flatnonzero(side < levels[k]) for side in (levels[:k][::-1], levels[k + 1 :]))
        left = levels[k - int(before[0]) if len(before) else 0 : k]
        right = levels[k + 1 : k + 1 + int(after[0]) if len(after) else len(levels)]
        if min(float(np.max(left)), float(np.max(right))) - levels[k] >= prominence:
            found.append((starts[k] + ends[k] - 1) // 2)
    return np.array(found, dtype=np.intp)


def third_difference_noise(record: Heights) -> float:
    """Noise of a record from third differences, without a model.

    The third difference of a parabola is zero; the median is not affected by the few contacts.  Divided differences
    with the true times allow uneven or missing frames.
    """
    if len(record.time) < 4:
        return 0.0
    time, height = (np.lib.stride_tricks.sliding_window_view(each, 4) for each in (record.time, record.height))
    # ones on the diagonal do not change the products
    apart = (time[:, :, None] - time[:, None, :]) / np.median(np.diff(record.time)) + np.eye(4)
    known = np.all(apart != 0, axis=(1, 2))
    weights = 1 / np.prod(apart[known], axis=2)
    third = np.abs(np.sum(weights * height[known], axis=1)) / np.sqrt(np.sum(weights**2, axis=1))
    return float(np.median(third)) / 0.6745 if len(third) > 3 else 0.0


def _part(record: Heights, used: Mask) -> Heights:
    return Heights(record.time[used], record.height[used], record.sigma[used])


class Reader:
    """The parameters as quantities of the experiment, in metres of fall."""

    def __init__(self, heights: Array, fall: Fall, size: float, periods: Array) -> None:
        self.heights = heights  # [m], apex above the contact level; the first is the drop
        self.size = size  # units of the record per metre
        self.flight_times = periods  # [s], from contact to contact
        self._fall = fall

    def impact_speed(self, bounce: int) -> float:
        """[m/s], just before contact number `bounce` (1, 2, ...)."""
        return self._fall.fall.speed_after(float(self.heights[bounce - 1]))

    def rebound_speed(self, bounce: int) -> float:
        """[m/s], just after it."""
        return self._fall.rise.speed_after(float(self.heights[bounce]))


@dataclass(frozen=True)
class _Model:
    """Layout of the parameter vector: log size, release, H_0..H_N, levels, growth, perspective, lens, dwell, drag."""

    count: int
    drag: AirDrag
    end: float  # [s], last frame used
    top: float  # [m], approximate drop height: unit of the perspective terms

    @property
    def length(self) -> int:
        return 2 + (self.count + 1) + (self.count + 1) + self.count + 4

    def split(self, p: Array) -> tuple[Array, Array, Array]:
        """H_0..H_N [m]; levels at contacts 1..N and at the end; relative growth at contact 2..N and at the end."""
        n = self.count
        heights = np.maximum(p[2 : 3 + n], 1e-9)
        return heights, p[3 + n : 4 + 2 * n], p[4 + 2 * n : 4 + 3 * n]

    def swelling(self, flights: Array) -> Array:
        """Prior standard deviation of the growth along flights of these heights."""
        return DRIFT * 1.3 * flights / self.top

    @property
    def causes(self) -> dict[str, list[int]]:
        """Indices of the parameters that belong to each cause of uncertainty."""
        n = self.count
        first = 4 + 3 * n
        growth = list(range(4 + 2 * n, first))
        return {"air drag": [first + 3], "contact duration": [first + 2], "camera": [*growth, first, first + 1]}

    def fall(self, p: Array) -> Fall:
        # the range of the tables grows in powers of two, so that most calls hit the cache
        highest = 2.0 ** math.ceil(math.log2(1.3 * float(np.max(self.split(p)[0]))))
        return tables_of(self.drag, max(float(p[-1]), 0.0), highest)

    def apexes(self, p: Array) -> Array:
        return np.asarray(self._times(p[None], self.fall(p))[0][0])

    def contacts(self, p: Array) -> Array:
        """[s], contacts 1..N and the (unseen) end of the last flight."""
        return np.asarray(self._times(p[None], self.fall(p))[1][0])

    def _times(self, many: Array, fall: Fall) -> tuple[Array, Array]:
        """Apexes and contacts [s] of many parameter vectors, shape (m, N + 1) each."""
        heights = self._heights(many)
        down, up = fall.fall.time_to(heights), fall.rise.time_to(heights[:, 1:])
        dwell = np.maximum(many[:, -2:-1], 0.0)
        since = np.cumsum(down[:, :-1] + dwell + up, axis=1)
        apexes = many[:, 1:2] + np.concatenate([np.zeros((len(many), 1)), since], axis=1)
        return apexes, apexes + down

    def _heights(self, many: Array) -> Array:
        return np.maximum(many[:, 2 : 3 + self.count], 1e-9)

    def level(self, p: Array, time: Array) -> Array:
        _, levels, _ = self.split(p)
        contacts = self.contacts(p)
        return np.interp(time, [*contacts[: self.count], max(self.end, contacts[self.count - 1] + 1e-6)], levels)

    def curve(self, p: Array, time: Array) -> Array:
        return np.asarray(self.curves(p[None], time)[0])

    def curves(self, many: Array, time: Array) -> Array:
        """The curve for many parameter vectors with the same drag, shape (m, n)."""
        n = self.count
        fall = self.fall(many[0])
        apexes, contacts = self._times(many, fall)
        flight = np.sum(time[:, None] > contacts[:, None, :n], axis=2)

        def of_flight(values: Array) -> Array:
            return np.take_along_axis(values, flight, axis=1)

        above = of_flight(self._heights(many)) - fall.below_apex(time - of_flight(apexes))
        # level and growth are linear from contact to contact
        last = np.maximum(self.end, contacts[:, n - 1 : n] + 1e-6)
        knots = np.concatenate([contacts[:, :n], last], axis=1)
        leg = np.maximum(flight - 1, 0)
        since = time - np.take_along_axis(knots, leg, axis=1)
        share = np.clip(since / np.take_along_axis(np.diff(knots), leg, axis=1), 0.0, 1.0)

        def along(values: Array) -> Array:
            begins, rises = (np.take_along_axis(each, leg, axis=1) for each in (values, np.diff(values)))
            return np.asarray(begins + share * rises)

        growth = np.concatenate([np.zeros((len(many), 1)), many[:, 4 + 2 * n : 4 + 3 * n]], axis=1)
        relative = above / self.top
        # minus 1, so that `size` is the mean scale over the drop, as given by a rule beside it or a stated scale
        seen = above * (1 + many[:, -4:-3] * (relative - 1) + many[:, -3:-2] * (relative**2 - 1))
        curves = along(many[:, 3 + n : 4 + 2 * n]) + np.exp(many[:, :1]) * (1 + along(growth)) * seen
        return np.asarray(np.where((time > contacts[:, -1:]) | (time < apexes[:, :1]), np.nan, curves))

    def reader(self, p: Array) -> Reader:
        return Reader(self.split(p)[0], self.fall(p), math.exp(p[0]), np.diff(self.contacts(p)))


def fit_bounces(record: Heights, drag: AirDrag) -> Bounces | None:
    """Fit all flights at once; None if there is no contact with a flight before and after it."""
    offset = float(record.time[0])
    record = replace(record, time=record.time - offset)
    contacts = _worth_fitting(record, find_contacts(record))
    while len(contacts):
        fitted = _fit(record, contacts, drag, offset)
        if fitted is not None:
            seen = max(_well_seen(record.time, fitted), 1)
            if seen >= fitted.count:
                return fitted
            contacts = contacts[:seen]
        else:
            contacts = contacts[:-1]
    return None


def _well_seen(time: Array, fitted: Bounces) -> int:
    """Number of bounces before the first flight in which too few frames show the bead on the fitted curve.

    Where another object was followed in place of the bead, minima of the track are no contacts.  A wrong flight also
    spoils the one before it, because they share a contact.
    """
    step, end = float(np.median(np.diff(time))), fitted.model.end
    contacts = fitted.model.contacts(fitted.parameters)
    for k, (begins, ends) in enumerate(pairwise(contacts)):
        # one frame at either end is left out of the fit: its exposure may contain the contact
        frames = (min(float(ends), end) - float(begins)) / step - 2
        seen = np.sum(fitted.used & (time > begins) & (time < ends))
        if seen < max(LEAST_SEEN * frames, FEWEST_SEEN):
            return k
    return fitted.count


def _worth_fitting(record: Heights, contacts: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Contacts with at least five frames of flight on both sides and a rise well above the noise."""
    noise = third_difference_noise(record)
    edges = [0, *contacts.tolist(), len(record.time) - 1]
    kept: list[int] = []
    for k, contact in enumerate(contacts):
        after = edges[k + 2] - contact
        before = contact - edges[k]
        rise = float(np.max(record.height[contact : edges[k + 2] + 1]) - record.height[contact])
        if before < 5 or after < 5 or rise < 12 * noise:
            break
        kept.append(int(contact))
    return np.array(kept, dtype=np.intp)


def _fit(record: Heights, contacts: npt.NDArray[np.intp], drag: AirDrag, offset: float) -> Bounces | None:
    start = _first_guess(record, contacts, drag)
    if start is None:
        return None
    model, parameters, spread, stop = start
    centre = parameters.copy()
    step = float(np.median(np.diff(record.time)))
    # below this, interpolation errors of the fall tables would count as residuals
    finest = 2e-6 * float(np.ptp(record.height))
    usual = max(third_difference_noise(record), finest)
    sigma = record.sigma.copy()
    blank = ~(np.isfinite(sigma) & (sigma > 0))
    sigma[blank] = usual if np.all(blank) else np.median(sigma[~blank])
    sigma = np.maximum(sigma, 0.3 * np.median(sigma))
    used = np.zeros(len(sigma), dtype=bool)
    outlier = np.zeros(len(sigma), dtype=bool)
    scatter = math.inf
    for turn in range(5):
        before, used = used, _in_flight(record, model, parameters, step, usual, stop) & ~outlier
        if np.sum(used) < model.count * 4 + 6:
            return None
        if not (np.array_equal(used, before) and abs(scatter - 1) < 0.02):  # otherwise the fit would be the same
            # a coarse tolerance is enough here: the choice of outliers changes the result more
            parameters, _ = _solve(record, model, parameters, centre, spread, sigma, used, to=1e-5)
            # free flight determines a strong lens distortion: widen the prior so that it does not pull it back
            spread[-4:-2] = np.maximum(spread[-4:-2], np.abs(parameters[-4:-2]))
        residual = record.height - model.curve(parameters, record.time)
        ratio = residual / sigma
        scatter = mad_std(ratio[used], centre=0.0)
        sigma = np.maximum(sigma * max(scatter, 1e-3), finest)
        inside = used | outlier
        limit = (np.inf, 8.0, 5.0, 4.0, 4.0)[turn]
        outlier = inside & ~(np.abs(residual) < limit * sigma)
        if np.sum(outlier) > 0.35 * np.sum(inside):
            return None
    residual = record.height - model.curve(parameters, record.time)
    excess = _repetition((residual / sigma)[used])
    if record.across is not None:
        contacts_seen = model.contacts(parameters)[: model.count]
        sideways = fit_sideways(record.time[used], record.across[used], contacts_seen, model.apexes(parameters))
        excess = max(excess, _unsteadiness(sideways.off[sideways.kept] / sigma[used][sideways.kept]))
    sigma = sigma * math.sqrt(excess)
    parameters, covariance = _solve(record, model, parameters, centre, spread, sigma, used)
    residual = record.height - model.curve(parameters, record.time)
    return Bounces(
        model=model,
        parameters=parameters,
        covariance=covariance,
        used=used,
        residual=residual,
        # weighted: a frame with a large stated sigma is no sign of a misfit
        noise=float(np.sqrt(np.average(residual[used] ** 2, weights=sigma[used] ** -2))),
        # noise in flight as well: a bead at rest is located better
        expected_noise=max(third_difference_noise(record), third_difference_noise(_part(record, used))),
        time_offset=offset,
    )


def _repetition(ratio: Array) -> float:
    """Factor on the variance for correlated residuals: background texture, pixel locking, misfit of the model.

    1 + 2 sum of the autocorrelation up to its first zero: slow residuals do not average out.
    """
    values = ratio - ratio.mean()
    power = float(values @ values) + 1e-300
    rho = [float(values[lag:] @ values[:-lag]) / power for lag in range(1, max(len(values) // 4, 2))]
    fades = next((lag for lag, each in enumerate(rho) if each < 1 / math.sqrt(len(values))), len(rho))
    neighbours = (1 + rho[0]) / (1 - rho[0])
    return float(np.clip(max(1 + 2 * sum(rho[:fades]), neighbours), 1.0, 25.0))


def _unsteadiness(ratio: Array) -> float:
    """Factor on the variance of the heights from the horizontal residuals, where the bead must fly straight.

    Camera shake that the codec hides in the scene bends heights as gravity does; the fit of the heights cannot see it.
    """
    return float(np.mean(ratio**2)) * _repetition(ratio)


def _first_guess(
    record: Heights, contacts: npt.NDArray[np.intp], drag: AirDrag
) -> tuple[_Model, Array, Array, float] | None:
    """Model, starting parameters, spread of their priors, and the time where the last usable flight ends."""
    time, y = record.time, record.height
    bends: list[float] = []
    apexes: list[tuple[float, float]] = []
    following = find_contacts(record)
    later = following[following > contacts[-1]]
    stop = float(time[later[0]]) if len(later) else float(time[-1])
    bounds = [_fall_begins(record, int(contacts[0])), *contacts.tolist(), int(np.searchsorted(time, stop))]
    for first, last in pairwise(bounds):
        piece = np.s_[first + (1 if bends else 0) : last]
        if last - first < 4:
            return None
        bend, slope, base = np.polyfit(time[piece] - time[first], y[piece], 2)
        if bend >= 0:
            return None
        bends.append(-2 * bend)
        apexes.append((time[first] - slope / (2 * bend), base - slope**2 / (4 * bend)))
    bend = float(np.median(bends))
    levels = [float(min(y[k], y[min(k + 1, len(y) - 1)])) for k in contacts]
    # both frames around a contact are too high by up to one frame of fall: extrapolate with the parabola instead
    heights = [max(apexes[0][1] - levels[0], 1e-3 * abs(apexes[0][1]))]
    heights += [apex - level for (_, apex), level in zip(apexes[1:], levels, strict=True)]
    if min(heights) <= 0:
        return None
    size = bend / GRAVITY
    metres = np.array(heights) / size
    # flight times do not depend on scale or drag, so the fit starts with the contacts where they were seen
    between = np.diff(time[contacts])
    metres[1 : 1 + len(between)] = GRAVITY * between**2 / 8
    model = _Model(len(contacts), drag, float(min(stop, time[-1])), float(metres[0]))
    strength, width = (1.0, DRAG_HELD) if drag.known else (0.0, FREE_DRAG)
    n = model.count
    to_fall = tables_of(drag, strength, 4 * float(metres[0])).fall.time_to(metres[:1])
    release = float(time[contacts[0]] - to_fall[0])
    longest = longest_contact(drag, float(metres[0]))
    parameters = np.array(
        [
            math.log(size),
            release,
            *metres,
            *levels,
            levels[-1],
            *np.zeros(n),
            0.0,
            0.0,
            USUAL_CONTACT * longest,
            strength,
        ]
    )
    spread = np.full(model.length, np.inf)
    spread[-4:] = PERSPECTIVE, LENS, CONTACT_SPREAD * longest, width
    return model, parameters, spread, stop


def _fall_begins(record: Heights, contact: int) -> int:
    """Last frame in which the bead is within 3 % of the fall from its highest point: it falls from there on."""
    y = record.height[: contact + 1]
    top = float(np.max(y))
    return int(np.flatnonzero(y > top - 0.03 * (top - y[-1]))[-1])


def _in_flight(record: Heights, model: _Model, p: Array, step: float, noise: float, stop: float) -> Mask:
    """Frames that show free flight: after the release, and not within an exposure of a contact."""
    time = record.time
    contacts = model.contacts(p)
    heights, _, _ = model.split(p)
    start = model.apexes(p)[0]
    # near the apex a bead that is still held looks the same as a released one
    begun = start + math.sqrt(2 * max(3 * noise / math.exp(p[0]), 0.004 * float(heights[0])) / GRAVITY)
    inside = (time > begun) & (time < min(stop, float(contacts[-1])) + 1e-9)
    for contact in [*contacts[: model.count], contacts[-1]]:
        dwell = max(float(p[-2]), 0.0)
        inside &= (time < contact - 0.55 * step) | (time > contact + dwell + 0.55 * step)
    return np.asarray(inside)


def _solve(
    record: Heights,
    model: _Model,
    start: Array,
    centre: Array,
    spread: Array,
    sigma: Array,
    used: Mask,
    *,
    to: float = 1e-9,
) -> tuple[Array, Array]:
    """Least squares with priors; parameters and covariance.  `to` is the relative tolerance of the cost."""
    time, y, sigma = record.time[used], record.height[used], sigma[used]
    n = model.count
    known = np.isfinite(spread)
    flights = np.maximum(centre[3 : 3 + n], 1e-3 * centre[2])
    size = math.exp(centre[0])
    drift = DRIFT * flights * size
    open_end = model.end < model.contacts(start)[-1] - 1e-3
    swelling = model.swelling(flights)

    def misfits(many: Array) -> Array:
        curves = model.curves(many, time)
        # a frame outside the flights counts with a constant large residual
        curves = np.where(np.isfinite(curves), curves, y + 10 * sigma)
        levels, growth = many[:, 3 + n : 4 + 2 * n], many[:, 4 + 2 * n : 4 + 3 * n]
        priors = (many[:, known] - centre[known]) / spread[known]
        steps = np.diff(levels)
        off = steps / drift
        if open_end:
            # no next contact shows the level: prior is the same drift as before, but a bounce may change it
            before = steps[:, -2] * flights[-1] ** 0.5 / flights[-2] ** 0.5 if n > 1 else np.zeros(len(many))
            off[:, -1] = (steps[:, -1] - before) / (0.5 * drift[-1] + 0.5 * np.abs(before))
        swell = np.diff(np.concatenate([np.zeros((len(many), 1)), growth], axis=1)) / swelling
        return np.concatenate([(y - curves) / sigma, priors, off, swell], axis=1)

    def slopes(p: Array) -> Array:
        """Derivatives by finite differences; all parameters except the drag (the last) share the tables of the fall."""
        steps = math.sqrt(np.finfo(float).eps) * np.maximum(np.abs(p), 1.0)
        moved = p + np.diag(steps)
        here, *there = misfits(np.concatenate([p[None], moved[:-1]]))
        return np.asarray((np.array([*there, misfits(moved[-1:])[0]]) - here).T / steps)

    lower, upper = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    lower[2 : 3 + n] = 1e-6
    lower[-2:] = -1e-12
    inside = np.clip(start, lower, upper)

    def misfit(p: Array) -> Array:
        return np.asarray(misfits(p[None])[0])

    solved = least_squares(
        misfit,
        inside,
        slopes,
        bounds=(lower, upper),
        x_scale="jac",
        ftol=to,
        xtol=1e-10,
        max_nfev=40,
    )
    jacobian = np.asarray(solved.jac)
    return np.asarray(solved.x), np.linalg.pinv(jacobian.T @ jacobian, hermitian=True, rcond=1e-15)
