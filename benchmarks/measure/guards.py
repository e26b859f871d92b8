"""Which special cases of `measure` earn their place: each is switched off by itself, and the numbers are compared.

    python benchmarks/measure/guards.py [--rig RIG ...] [--only GUARD ...] [--count N] [--media DIR ...] [--json FILE]

A guard makes a number doubtful, drops data, or refuses a clip in an unusual situation.  The rows are those of
`hard_bulk.py` and `hard_footage.py`, with `--media` instead the folders that `unseen.py` reads.  A guard wins a row if
without it a number of that row is silently off by more than `SILENT` standard uncertainties, a sound number is lost, or
the program stops with an error.  It costs a row if without it a sound number is gained, or a silent one is not, and
none of the above happens.  It is idle if nothing changes in any row; of two guards that back each other up both are.

Every clip is first measured as it is, and each guard is watched meanwhile: where it always returned what its
replacement returns, the clip need not be measured without it.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from rigtwin.benchmarks.figures import Row, report, small
from rigtwin.benchmarks.measure import draw_bulk, hard_bulk, hard_footage, unseen
from rigtwin.benchmarks.measure.hard_footage import SEED
from rigtwin.benchmarks.measure.unseen import SILENT
from rigtwin.lab.quantity import Check

Function = Callable[..., Any]
Neutral = Callable[[Function], Function]  # makes the replacement of a function

DRAWN: dict[str, tuple[hard_footage.Read, Iterable[str]]] = {
    **{rig: (hard_bulk.readings, names) for rig, (_, names) in hard_bulk.RIGS.items()},
    **{rig: (hard_footage.readings, hard_footage.cases_of(rig)) for rig in hard_footage.RIGS},
}
FILMS = ("drum", "hopper", "drop", "pendulum", "slide", "roll")
TILT = ("slide", "roll")

# --------------------------------------------------------------------------------------------------------- replacements


def always(value: object) -> Neutral:
    return lambda _: lambda *_, **__: value


def argument(number: int) -> Neutral:
    """Returns an argument as it was given."""
    return lambda _: lambda *given, **__: given[number]


def nowhere(function: Function) -> Function:
    """Marks nothing in a mask of the same shape."""
    return lambda *given, **named: np.zeros_like(function(*given, **named))


def everywhere(function: Function) -> Function:
    return lambda *given, **named: np.ones_like(function(*given, **named))


def given_with(number: int, **changes: object) -> Neutral:
    """The function, called with an argument of which some fields are changed."""

    def neutral(function: Function) -> Function:
        def call(*given: Any, **named: Any) -> Any:
            return function(*given[:number], replace(given[number], **changes), *given[number + 1 :], **named)

        return call

    return neutral


def named_with(**changes: object) -> Neutral:
    return lambda function: lambda *given, **named: function(*given, **(named | changes))


def returned_with(**changes: object) -> Neutral:
    return lambda function: lambda *given, **named: replace(function(*given, **named), **changes)


def emptied(*names: str) -> Neutral:
    """The result, with zeros in some of its fields."""

    def neutral(function: Function) -> Function:
        def call(*given: Any, **named: Any) -> Any:
            found = function(*given, **named)
            return replace(found, **{name: np.zeros_like(getattr(found, name)) for name in names})

        return call

    return neutral


def during(changes: Mapping[str, object]) -> Neutral:
    """The function, with other values at these places while it runs."""

    def neutral(function: Function) -> Function:
        def call(*given: Any, **named: Any) -> Any:
            with ExitStack() as stack:
                for place, value in changes.items():
                    owner, name = at_place(place)
                    stack.enter_context(mock.patch.object(owner, name, value))
                return function(*given, **named)

        return call

    return neutral


def passing(*names: str) -> Neutral:
    """Checks of these names, or all, pass."""

    def passed(found: Any) -> Any:
        if isinstance(found, Check):
            return replace(found, passed=True) if not names or found.check in names else found
        return type(found)(map(passed, found)) if isinstance(found, list | tuple) else found

    return lambda function: lambda *given, **named: passed(function(*given, **named))


def unsaid(text: str) -> Neutral:
    """The reason why a number is doubtful is dropped where it holds this text."""

    def without(found: Any) -> Any:
        if isinstance(found, str):
            return "" if text in found else found
        return replace(found, flaw="") if text in getattr(found, "flaw", "") else found

    return lambda function: lambda *given, **named: without(function(*given, **named))


def _of_full_range(exposure_of: Function) -> Function:
    return lambda _: exposure_of(np.array([0.0, 255.0], dtype=np.float32))


def _both_flanks(free_flanks: Function) -> Function:
    return lambda heap, flank=None: free_flanks(heap, flank or "both")


def _first_row(_: Function) -> Function:
    return lambda bed, __: np.where(bed.any(axis=0), np.argmax(bed, axis=0), len(bed) - 1)


def _all_steady(_: Function) -> Function:
    def ends(__: Any, value: Any) -> tuple[int, int]:
        seen = np.flatnonzero(np.isfinite(value))
        return (int(seen[0]), int(seen[-1])) if len(seen) else (0, 0)

    return ends


def _middle_of_gauge(gauge: Any, x: Any, _: Any) -> Any:
    return np.full(len(x), (gauge.gauge.first + gauge.gauge.last) / 2)


def _nothing_strange(_: Function) -> Function:
    return lambda picture, *_: (np.zeros(picture.shape[:2], dtype=bool), False)


def _seen_to_pass(last_particle: Function) -> Function:
    def call(*given: Any) -> Any:
        found = last_particle(*given)
        if "not seen to pass" not in found.budget:
            return found
        budget = {part: value for part, value in found.budget.items() if part != "not seen to pass"}
        return replace(found, budget=budget, doubtful="")

    return call


def _above(_: Function) -> Function:
    return lambda top, slot, __: np.flatnonzero(top < slot)


def _no_losses(_: Function) -> Function:
    return lambda *given: ((), given[-1](given[-2]))


def _own_images(_: Function) -> Function:
    return lambda fits, __: [fit.image for fit in fits]


def _not_placed(_: Function) -> Function:
    return lambda _, __, guess, ___: replace(guess, placed=False)


# --------------------------------------------------------------------------------------------------------------- guards


@dataclass(frozen=True)
class Guard:
    """A special case, where it is called by which name (below `rigtwin.measure`), and what takes its place."""

    name: str
    rigs: Sequence[str]
    places: Sequence[str]
    neutral: Neutral


def _below(package: str, *rigs: str) -> Callable[..., Guard]:
    """Makes guards with places in one package."""

    def guard(name: str, place: str, neutral: Neutral) -> Guard:
        return Guard(name, rigs, (f"{package}.{place}",), neutral)

    return guard


_surface = _below("bulk.hidden_surface", "packing")
_cylinder = _below("packing.cylinder", "packing")
_judged = partial(_cylinder, place="_judged")
_gauge = partial(_cylinder, place="find_gauge")
_pile = _below("pile", "pile")
_drum = _below("drum", "drum")
_hopper = _below("hopper", "hopper")
_tilt = _below("tilt", *TILT)
_drop = _below("drop", "drop")
_follow = _below("tracking.follow", "drop")
_pendulum = _below("pendulum", "pendulum")
_film = _below("scene", *FILMS)

OF_PACKINGS = (
    _cylinder("covered surface", "covered_columns", nowhere),
    _cylinder("upright strips of glare", "without_strips", argument(0)),
    _surface("surface off its line", "_off_level", nowhere),
    _cylinder("bed cut off by the picture", "_cut_off", always(False)),
    _cylinder("grains below the floor", "_grains_below", always(0.0)),
    _judged("gauge hidden at the surface", neutral=during({"packing.cylinder.Bed.gauge_rows": _middle_of_gauge})),
    _judged("gauge ends above its zero", neutral=during({"packing.cylinder.ENDS_ABOVE": math.inf})),
    _judged("zero beside the lowest beads", neutral=during({"packing.cylinder.LOOKING": (-math.inf, math.inf)})),
    _judged("quarter of the surface hidden", neutral=unsaid("the surface is hidden in more")),
    _judged("faint outline of a bed", neutral=unsaid("the outline has hardly any contrast")),
    _judged("too little surface: refused", neutral=during({"packing.cylinder.LEAST_SHOWN": -1.0})),
    _cylinder("circles not filled with grains", "_filled", everywhere),
    _cylinder("gauge in another plane", "_elsewhere", always(math.nan)),
    _cylinder("gauge", "_gauge", always(None)),
    _gauge("longer marks of a gauge", neutral=during({"packing.graduations.LONGER_MARKS": -math.inf})),
    _gauge("clear waves of a gauge", neutral=during({"packing.graduations.CLEAR": 0.0})),
    _gauge("length of a gauge", neutral=during({"packing.graduations.LEAST_LENGTH": 0.0})),
    _cylinder("parted bed", "_beads", during({"packing.cylinder.PARTED": 1.0})),
    _below("packing", "packing")("fewest circles", "observe.find_bed", during({"packing.cylinder.FEWEST": 1})),
    _below("packing", "packing")("rod before the bed", "grain_region._joined", argument(0)),
    Guard("circles in a row", ("packing", "pile", "hopper"), ("bulk.beads._in_a_row",), always(False)),
    Guard(
        "stretch of dark pictures",
        ("packing", "pile", "drum"),
        ("packing.cylinder.exposure_of", "pile.silhouette.exposure_of", "drum.bed.exposure_of"),
        _of_full_range,
    ),
)
_picture_flaw = partial(_pile, place="observe._flaw_of_picture")
_no_heap = partial(_pile, place="silhouette._unlike_a_heap")
_disc = partial(_pile, place="silhouette.find_disc")
_no_grains = partial(_pile, place="silhouette._grains")
_profile_flaw = partial(_pile, place="evaluate._flaw_of_profile")
OF_PILES = (
    _picture_flaw("outline at the picture's edge", neutral=given_with(0, cut_off=False)),
    _picture_flaw("steep view", neutral=during({"pile.observe.STEEPEST_VIEW": math.inf})),
    _picture_flaw("unsure outline", neutral=during({"pile.observe.UNSURE": 1.0})),
    _no_heap("unlike a heap: refused", neutral=always("")),
    _no_heap("proportions of a heap", neutral=unsaid("beads high")),
    _no_heap("matter below the outline", neutral=during({"pile.silhouette.LEAST_MATTER": -1.0})),
    _no_heap("matter above the outline", neutral=during({"pile.silhouette.MOST_ALIKE": 2.0})),
    _no_grains("few grains: refused", neutral=during({"pile.silhouette.LEAST_GRAINS": 0.0})),
    _no_grains("unlikely grains: refused", neutral=during({"pile.silhouette.LEAST_LIKELY": 0.0})),
    _disc("rim of the base on edges", neutral=during({"pile.base_disc.LEAST_SUPPORT": 0.0})),
    _pile("faint rim of the base", "observe._faint_rim", always("")),
    _disc("regions fit the base", neutral=during({"pile.base_disc.LEAST_FIT": 0.0})),
    _pile("flank against a wall", "repose_angles.free_flanks", _both_flanks),
    _pile("wall falls within a grain", "repose_angles._at_a_wall", always(True)),
    _profile_flaw("flaws of a profile", neutral=always("")),
    _profile_flaw("flank too steep", neutral=during({"pile.repose_angles.STEEPEST_FLANK": math.inf})),
    _profile_flaw("flank too short", neutral=unsaid("grains long")),
    _pile("flank does not fall steadily", "repose_angles.monotony", always(1.0)),
    _pile("base wider or narrower than the heap", "evaluate._base_flaw", always("")),
    _pile("no base found", "evaluate._quantities_of_view", given_with(0, unsure_base="")),
)
OF_DRUMS = (
    _drum("something passes a drum", "bed._hides", always(False)),
    _drum("incredible outlines", "measurement.credible", argument(0)),
    _drum("area far from the usual one", "measurement.credible", during({"drum.profiles.LOST": math.inf})),
    _drum("columns that never move", "measurement.hidden_columns", nowhere),
    _drum("flying beads", "measurement.without_flights", argument(0)),
    _drum("surface beside a gap", "profiles._apart_from_gaps", argument(0)),
    _drum("rim above the bed", "bed._top_of_lowest", _first_row),
    _drum("noisy frames smoothed", "bed._blur_against_noise", always(0.0)),
    _drum("surface along the wall", "evaluate._without_wall", argument(0)),
    _drum("start and end of the flow", "evaluate.steady_part", _all_steady),
    _drum("no round border of a bed", "bed._drum_in", during({"drum.bed.MISFIT": math.inf})),
    _drum("rim by the bed", "bed.rim_of_bed", always(None)),
    _drum("no drum: refused", "measurement.must_be_a_drum", always(None)),
    _drum("light above bright beads", "glare._lies_over", everywhere),
    _drum("contrast of bright beads", "bed.brightened_share", during({"drum.glare.DULLED": math.inf})),
)
OF_HOPPERS = (
    _hopper("foreign objects", "outflow._strange", _nothing_strange),
    _hopper("foreign colours", "outflow.foreign", nowhere),
    _hopper("something crosses to the bed", "outflow.crosses", always(False)),
    _hopper("something passes a hopper", "outflow._hides", always(False)),
    _hopper("covered bed", "outflow._covers", always(False)),
    _hopper("hidden slot", "measurement.hidden_share", always(0.0)),
    _hopper("bar before the slot", "checks.before_the_slot", always(frozenset())),
    _hopper("slot open at the start", "measurement.closed_before", argument(1)),
    _hopper("hidden opening or end", "measurement.unhidden", argument(1)),
    _hopper("slide of the beads' colour", "outflow._above_slide", argument(2)),
    _hopper("hand beside the bed", "outflow._bed", during({"hopper.outflow.ALIKE": 0.0})),
    _hopper("slender objects", "outflow._bed", during({"hopper.outflow.NARROWEST": math.inf})),
    _hopper("faint slide smoothed", "slide_opening._smoothing", always(1)),
    _hopper("last bead not seen to pass", "measurement.last_particle", _seen_to_pass),
    _hopper("beads do not rise", "observe._still_above", _above),
    _hopper("opening by the flow", "observe._opened_by_flow", returned_with(doubtful="")),
    _hopper("flow at the end of the record", "evaluate._still_flows", always(False)),
    _hopper("repeated frames of a flow", "lost_frames.repeated", nowhere),
    _hopper("frames cut out of a flow", "lost_frames._cut_out", always(())),
    _hopper("lost frames by the stream", "checks.timing_check", during({"hopper.lost_frames.MORE": math.inf})),
    _hopper("stream as a clock", "falling_stream.Stream.fall", always(None)),
    _hopper("lowest bead as a clock", "checks.fall_below", always(None)),
    _hopper("outlet speed as a clock", "checks.outlet_check", passing()),
    _hopper("few bits", "measurement.compression_effect", passing()),
)
OF_PLATES = (
    _tilt("objects before the plate", "observe.in_front", nowhere),
    _tilt("glare on the plate", "observe.glare", nowhere),
    _tilt("lost frames by the plate", "observe.gaps_by_turn", emptied("missing", "shown")),
    _tilt("lost frames by the body", "observe.gaps_by_run", emptied("missing", "shown")),
    _tilt("wrong scale of a plate", "measurement.onset_of", during({"tilt.evaluate.WRONG_SCALE": math.inf})),
    _tilt("body leaves the scene", "observe.find_body", during({"tilt.body_track.LEFT": -math.inf})),
    _tilt("arriving body: refused", "body_track._arrives", always(False)),
    _tilt("body seen lower later", "body_track._times_seen_lower", always(1)),
    _tilt("single outliers of a run", "onset._calm", argument(0)),
)
OF_DROPS = (
    _drop("lost frames by the flights", "find_bead.find_losses", _no_losses),
    _drop("lost frames at contacts", "lost_frames._at_contacts", always(())),
    _drop("lost frames within flights", "lost_frames._within_flights", always(())),
    _drop("flights joined", "find_bead.join_flights", always(None)),
    _drop("second search by look", "find_bead.paths_by_look", always(())),
    _drop("second look at a falling bead", "find_bead.look_again", argument(0)),
    _drop("bead beside a gap", "find_bead._beside_a_gap", nowhere),
    _drop("motion to the camera", "measurement.find_depth", always(None)),
    _drop("scales contradict", "scale.scales_agree", always(True)),
    _drop("rate not stated", "measurement._with_film_checks", named_with(lengths="")),
    _drop("restitution above 1", "evaluate._gains", always(False)),
    _drop("hidden shake", "measurement.view_checks", during({"drop.checks.MOST_HIDDEN": math.inf})),
    _drop("shake by the flights", "measurement.view_checks", during({"drop.checks.MOST_LEFT": math.inf})),
    _follow("objects before the bead", "occluders", always(None)),
    _follow("bead fitted badly", "_started_again", argument(0)),
    _follow("light of neighbouring frames", "in_steady_light", _own_images),
    _follow("scatter of the path", "scatter", always(1.0)),
)
_collision = partial(_pendulum, place="track_two_beads._collision")
OF_PENDULUMS = (
    _pendulum("lost frames by the swing", "observe.find_losses", _no_losses),
    _pendulum("second look at swinging beads", "observe.relocate", argument(1)),
    _pendulum("beads before a changed scene", "track_two_beads._in_front_of", nowhere),
    _pendulum("strong lens", "swing_fit._bends", always(False)),
    _pendulum("bead hung there", "track_two_beads.hung", always(True)),
    _pendulum("collision in pieces", "find_collision._meetings_of_pieces", always([])),
    _collision("collision in sparser frames", neutral=during({"pendulum.track_two_beads.SPARSER": ()})),
    _pendulum("beginning of a fall joined", "find_collision.with_beginning", argument(0)),
    _pendulum("repeated frames of a swing", "measurement.without_repeats", argument(0)),
    _pendulum("swaying bead B", "checks._sway", always(0.0)),
    _pendulum(
        "record too short", "evaluate.reasons_of", always(dict.fromkeys(("collision", "release", "turning"), ""))
    ),
)
_paced = tuple(f"{rig}.measurement.at_its_pace" for rig in ("drum", "hopper", "tilt", "drop"))
_still = ("scene.background.stands_still", "tracking.find_paths.stands_still")
OF_FILMS = (
    _film("scene without edges", "scene.Scene.textured", always(True)),
    _film("frame far from the scene", "scene.Scene._placed_from_afar", _not_placed),
    _film("flicker", "scene.Scene._levelled", argument(2)),
    _film("scene of shaken frames", "background._shaken_far", always(False)),
    Guard("camera that stands still", FILMS, _still, always(False)),
    Guard("flicker of colours", ("drum", "hopper"), ("scene.steadied_frames._levelled",), argument(0)),
    Guard("playback above the capture rate", ("drum", "hopper", "drop", *TILT), _paced, argument(0)),
    Guard("repeated frames", FILMS, ("media.duplicate_frames.repeated",), nowhere),
    Guard("interlaced or broken off", FILMS, ("media.video.Video.spoilt",), always("")),
)

# checks of which a failure makes numbers doubtful, by rigs and by the place that makes them
CHECKS: dict[tuple[str, ...], dict[str, Sequence[str]]] = {
    ("packing",): {
        "packing.observe.picture_checks": ("gauge", "bead_size", "walls", "straight_walls"),
        "packing.evaluate.checks_of": ("level_bed", "smooth_surface"),
    },
    ("drum",): {
        "drum.measurement.checks_of_picture": (
            *("rim_found", "fill", "surface_shape", "surface_steps", "static_camera", "bed_in_view", "camera_roll"),
            *("even_light", "same_bed"),
        ),
        "drum.measurement.stance_checks": ("bed_below", "turning"),
        "drum.evaluate._checks": ("steady_flow", "surface_in_view", "frame_timing"),
        "drum.evaluate._falls_check": ("surface_falls",),
    },
    ("hopper",): {
        "hopper.measurement.checks_of_picture": ("slot_in_view", "bed_clear"),
        "hopper.measurement.bed_check": ("bed_uncovered",),
        "hopper.measurement.flow_timing_check": ("frame_timing",),
        "hopper.measurement.rate_check": ("frame_rate",),
        "hopper.measurement.camera_by_scene": ("static_camera",),
        "hopper.measurement.upright_checks": ("camera_roll",),
        "hopper.evaluate._falling_check": ("only_falls",),
        "hopper.evaluate._within_check": ("flow_within",),
    },
    TILT: {
        "tilt.evaluate.checks_of": (
            *("gravity", "proportions", "variant", "creep", "steady_rise", "run_residuals", "onset_certainty"),
            "rest_seen",
        ),
        "tilt.measurement.view_checks": ("arm_in_view", "frame_timing", "level"),
        "tilt.measurement.shape_check": ("shape",),
        "tilt.measurement.portrait_check": ("picture_at_rest",),
        "tilt.measurement.compression_check": ("compression",),
        "tilt.measurement.camera_by_scene": ("static_camera",),
    },
    ("drop",): {
        "drop.evaluate.gravity_check": ("gravity",),
        "drop.evaluate.residual_check": ("flight_residuals",),
        "drop.evaluate.plane_check": ("out_of_plane",),
        "drop.evaluate.fall_check": ("first_fall",),
        "drop.evaluate.timing_check": ("frame_timing",),
        "drop.measurement.view_checks": ("bead_in_view", "static_camera"),
        "drop.measurement.size_check": ("bead_size",),
    },
    ("pendulum",): {
        "pendulum.evaluate.momentum_check": ("momentum",),
        "pendulum.evaluate.residual_check": ("swing_residuals",),
        "pendulum.evaluate.distance_check": ("contact_distance",),
        "pendulum.measurement.timing_check": ("frame_timing",),
        "pendulum.measurement.lens_check": ("lens",),
        "pendulum.measurement.view_checks": ("bead_in_view", "static_camera"),
    },
}
OF_CHECKS = tuple(
    Guard(f"check {name}", rigs, (place,), passing(name))
    for rigs, places in CHECKS.items()
    for place, names in places.items()
    for name in names
)
GUARDS = (
    *OF_PACKINGS,
    *OF_PILES,
    *OF_DRUMS,
    *OF_HOPPERS,
    *OF_PLATES,
    *OF_DROPS,
    *OF_PENDULUMS,
    *OF_FILMS,
    *OF_CHECKS,
)


def at_place(place: str) -> tuple[Any, str]:
    """The module or class below `rigtwin.measure` that holds a name, and the name."""
    *parts, name = f"rigtwin.measure.{place}".split(".")
    for count in range(len(parts), 0, -1):
        with suppress(ModuleNotFoundError):
            owner: Any = importlib.import_module(".".join(parts[:count]))
            for part in parts[count:]:
                owner = getattr(owner, part)
            return owner, name
    raise ModuleNotFoundError(place)


@contextmanager
def instead(places: Mapping[str, Neutral]) -> Iterator[None]:
    """At each of these places a function that is made of the one there."""
    with ExitStack() as stack:
        for place, make in places.items():
            owner, name = at_place(place)
            there = vars(owner)[name]
            new: Any
            if isinstance(there, cached_property):
                new = cached_property(make(there.func))
                new.__set_name__(owner, name)
            elif isinstance(there, property):
                assert there.fget is not None
                new = property(make(there.fget))
            else:
                new = make(there)
            stack.enter_context(mock.patch.object(owner, name, new))
        yield


def watched(guards: Iterable[Guard], acting: set[str]) -> Neutral:
    """A function that notes in `acting` which guards do something else than their replacements."""

    def watch(function: Function) -> Function:
        others = {guard.name: guard.neutral(function) for guard in guards}

        def call(*given: Any, **named: Any) -> Any:
            found, error = _outcome(function, given, named)
            for name, neutral in others.items():
                if name not in acting:
                    other, other_error = _outcome(neutral, given, named)
                    if repr(error) != repr(other_error) or not alike(found, other):
                        acting.add(name)
            if error is not None:
                raise error
            return found

        return call

    return watch


def _outcome(function: Function, given: Sequence[Any], named: Mapping[str, Any]) -> tuple[Any, Exception | None]:
    try:
        return function(*given, **named), None
    except Exception as error:
        return None, error


def alike(one: Any, other: Any) -> bool:
    """Whether two results are the same, number by number."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(alike, one, other))
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
    if is_dataclass(one) and type(one) is type(other):
        return all(alike(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one):
        return math.isnan(other)
    return bool(np.all(one == other))


# ---------------------------------------------------------------------------------------------------------- measurement


@dataclass(frozen=True)
class Number:
    """A measured number beside its truth."""

    name: str
    value: float
    off: float  # [standard uncertainties]
    flagged: bool

    @property
    def state(self) -> str:
        return "flagged" if self.flagged else "silent" if abs(self.off) > SILENT else "sound"

    def __str__(self) -> str:
        return f"{self.name} {self.value:.5g} ({self.off:+.2f} u, {self.state})"


@dataclass(frozen=True)
class Seen:
    """What was measured of a clip."""

    numbers: Sequence[Number]
    note: str = ""  # failed checks, or why nothing was measured
    stopped: bool = False  # with an error that is no refusal

    def names(self, state: str) -> set[str]:
        return {number.name for number in self.numbers if number.state == state}

    @property
    def counts(self) -> dict[str, int]:
        states = {state: len(self.names(state)) for state in ("sound", "flagged", "silent")}
        return states | {"refused": int(not self.numbers and not self.stopped), "stopped": int(self.stopped)}


@dataclass(frozen=True)
class Sample:
    """A clip or photo of known truth."""

    rig: str
    row: str
    group: str  # where it comes from
    read: Callable[[], Seen]


def drawn(rig: str, count: int, folder: Path) -> list[Sample]:
    read, names = DRAWN[rig]
    return [
        Sample(rig, name, "drawn", partial(_drawn, read, rig, name, seed, folder))
        for name in small(list(names), ["clean"])
        for seed in range(SEED, SEED + count)
    ]


def _drawn(read: hard_footage.Read, rig: str, name: str, seed: int, folder: Path) -> Seen:
    place = folder / f"{rig}, {name}, {seed}"
    with ExitStack() as stack:
        if place.exists():
            for owner, of_owner, new in KEPT:
                stack.enter_context(mock.patch.object(owner, of_owner, new(getattr(owner, of_owner))))
        place.mkdir(exist_ok=True)
        found, note = read(rig, name, seed, place)
    return Seen([Number(one.name, one.value, one.off, one.flagged) for one in found], note)


def _truth_alone(draw: Function) -> Function:
    return lambda *given: (iter(()), *draw(*given)[1:])


# how films are kept that were drawn already: the encoder does not give the same film of the same pictures twice
KEPT: tuple[tuple[Any, str, Neutral], ...] = (
    (hard_footage, "film", argument(0)),
    (hard_bulk, "stored", argument(0)),
    (draw_bulk, "turning", _truth_alone),
    (draw_bulk, "emptying", _truth_alone),
)


def stored(folder: Path) -> list[Sample]:
    """The samples in a folder of folders with `given.json` and `truth.json`."""
    samples = []
    for path in sorted(file.parent for file in folder.glob("*/truth.json") if (file.parent / "given.json").exists()):
        given = json.loads((path / "given.json").read_text())
        rig = unseen.settings("tilt", given)["variant"] if given["kind"] == "tilt" else given["kind"]
        samples.append(Sample(rig, path.name, folder.name, partial(_stored, path)))
    return samples


def _stored(path: Path) -> Seen:
    found = unseen.outcomes(path, by_hand=False)
    numbers = [
        Number(one.name, one.value, one.error / one.sigma if one.sigma > 0 else math.inf, bool(one.doubtful))
        for one in found
        if one.measured
    ]
    return Seen(numbers, "; ".join(one.doubtful for one in found if not one.measured))


def measured(sample: Sample) -> Seen:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return sample.read()
        except Exception as error:
            return Seen([], f"{type(error).__name__}: {error}", stopped=True)


def as_it_is(sample: Sample, guards: Sequence[Guard]) -> tuple[Seen, set[str]]:
    """What is measured with all guards, and which of these do something."""
    acting: set[str] = set()
    at: dict[str, list[Guard]] = {}
    for guard in guards:
        for place in guard.places:
            at.setdefault(place, []).append(guard)
    with instead({place: watched(ones, acting) for place, ones in at.items()}):
        return measured(sample), acting


def without(guard: Guard, sample: Sample) -> Seen:
    with instead(dict.fromkeys(guard.places, guard.neutral)):
        return measured(sample)


# ----------------------------------------------------------------------------------------------------------- comparison

EFFECTS = ("won", "cost", "changed", "")  # in the order of their weight


def effect(usual: Seen, other: Seen) -> str:
    """Whether a guard wins or costs a clip that gives `usual` with it and `other` without it."""
    lost, gained = usual.names("sound") - other.names("sound"), other.names("sound") - usual.names("sound")
    worse, better = other.names("silent") - usual.names("silent"), usual.names("silent") - other.names("silent")
    if worse or lost or (other.stopped and not usual.stopped):
        return "won"
    return "cost" if gained or better else "" if repr(usual) == repr(other) else "changed"


@dataclass(frozen=True)
class Compared:
    """One clip, with a guard and without it."""

    row: str
    effect: str
    usual: Seen
    other: Seen  # without the guard

    @property
    def changes(self) -> list[str]:
        """What changes by leaving the guard out, number by number."""
        before, after = ({one.name: str(one) for one in seen.numbers} for seen in (self.usual, self.other))
        names = [name for name in {**before, **after} if before.get(name) != after.get(name)]
        said = [f"{before.get(name, 'none')} -> {after.get(name, 'none')}" for name in names]
        return said + ([f"{self.usual.note} -> {self.other.note}"] if self.usual.note != self.other.note else [])


@dataclass(frozen=True)
class Finding:
    """What a guard does for a rig."""

    guard: Guard
    rig: str
    group: str
    clips: int
    compared: Sequence[Compared]  # the clips in which the guard does something
    seconds: float

    def rows(self, wanted: str) -> list[str]:
        """The rows of which this is the weightiest effect."""
        best: dict[str, int] = {}
        for one in self.compared:
            best[one.row] = min(best.get(one.row, len(EFFECTS)), EFFECTS.index(one.effect))
        return [row for row, rank in best.items() if EFFECTS[rank] == wanted]

    @property
    def idle(self) -> bool:
        return not any(one.effect for one in self.compared)

    @property
    def acts(self) -> list[str]:
        """The rows in which the guard does anything, with or without an effect on the numbers."""
        return list(dict.fromkeys(one.row for one in self.compared))

    @property
    def row(self) -> Row:
        words = {"won": "wins", "cost": "costs", "changed": "changes"}
        parts = [f"{word} {', '.join(rows)}" for kind, word in words.items() if (rows := self.rows(kind))]
        title = f"{self.rig}, {self.group}, {self.guard.name}: rows won"
        idle = f"idle, though it acts in {len(self.acts)} rows" if self.acts else "idle, never acts"
        return Row(title, len(self.rows("won")), note="; ".join(parts) or idle)

    def to_json(self) -> dict[str, Any]:
        return {
            "guard": self.guard.name,
            "places": list(self.guard.places),
            "rig": self.rig,
            "group": self.group,
            "acts": self.acts,
            "idle": self.idle,
            **{kind: self.rows(kind) for kind in EFFECTS if kind},
            "clips": self.clips,
            "seconds": round(self.seconds, 1),
            "compared": [
                {"row": one.row, "effect": one.effect, "with": one.usual.counts, "without": one.other.counts}
                | {"changes": one.changes}
                for one in self.compared
            ],
        }


def findings(samples: Sequence[Sample], guards: Sequence[Guard]) -> Iterator[Finding]:
    """What each guard does for the samples of one rig and group."""
    rig, group = samples[0].rig, samples[0].group
    guards = [guard for guard in guards if rig in guard.rigs]
    usual = []
    for sample in samples:
        began = time.perf_counter()
        usual.append(as_it_is(sample, guards))
        sys.stderr.write(f"{rig}, {sample.row}: {usual[-1][0].counts}, {time.perf_counter() - began:.1f} s\n")
    left_out = 0
    for guard in guards:
        began, compared = time.perf_counter(), []
        for sample, (seen, acting) in zip(samples, usual, strict=True):
            # a smoke run leaves out one guard per rig, to test `without`; `as_it_is` has found the places of all
            if guard.name in acting and left_out < small(math.inf, 1):
                left_out += 1
                other = without(guard, sample)
                compared.append(Compared(sample.row, effect(seen, other), seen, other))
        yield Finding(guard, rig, group, len(samples), compared, time.perf_counter() - began)


def kept(found: Sequence[Finding], file: Path | None) -> None:
    """Write what was found so far."""
    if file is not None:
        unfinished = file.with_suffix(".tmp")
        unfinished.write_text(json.dumps([one.to_json() for one in found], indent=1) + "\n")
        unfinished.replace(file)


def table(files: Iterable[Path]) -> str:
    """Markdown table of what each guard wins and costs, by results that ``--json`` wrote; the others by name."""
    known = {guard.name for guard in GUARDS}
    results = [one for file in files for one in json.loads(file.read_text()) if one["guard"] in known]
    lines: dict[str, dict[str, list[str]]] = {}
    for one in results:
        line = lines.setdefault(one["guard"], {"places": [], **{kind: [] for kind in EFFECTS if kind}})
        line["places"] += [f"`{place}`" for place in one["places"] if f"`{place}`" not in line["places"]]
        for kind in filter(None, EFFECTS):
            if one["group"] == "drawn" and one[kind]:
                line[kind].append(f"{one['rig']}: {', '.join(one[kind])}")
            elif one[kind]:
                line[kind].append(f"{one['rig']}, {len(one[kind])} of {one['clips']} photos of {one['group']}")
    shown = [name for name, line in lines.items() if line["won"] or line["cost"]]
    rest = {True: "change numbers or notes, but neither win nor cost", False: "change nothing"}
    return "\n".join(
        [
            "| guard | place below `rigtwin.measure` | rows won | rows that it costs |",
            "|---|---|---|---|",
            *(
                f"| {name} | {', '.join(line['places'])} | {'; '.join(line['won'])} | {'; '.join(line['cost'])} |"
                for name in shown
                for line in [lines[name]]
            ),
            *(
                f"\nGuards that {what}: "
                + ", ".join(name for name in lines if name not in shown and bool(lines[name]["changed"]) == moves)
                + "."
                for moves, what in rest.items()
            ),
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = list(dict.fromkeys(guard.name for guard in GUARDS))
    parser.add_argument("--rig", nargs="+", choices=tuple(DRAWN), default=tuple(DRAWN))
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="GUARD")
    parser.add_argument("--count", type=int, default=small(2, 1), help="clips of each row")
    parser.add_argument("--media", nargs="+", type=Path, default=(), help="folders to take the place of drawn clips")
    parser.add_argument("--json", type=Path, help="write what changes, clip by clip, into this file")
    parser.add_argument("--table", nargs="+", type=Path, metavar="JSON", help="print such files as a table instead")
    asked = parser.parse_args(arguments)
    if asked.table:
        print(table(asked.table))  # noqa: T201
        return 0
    guards = [guard for guard in GUARDS if guard.name in asked.only]
    found: list[Finding] = []
    with tempfile.TemporaryDirectory() as folder:
        samples = [sample for each in asked.media for sample in stored(each)] or [
            sample for rig in asked.rig for sample in drawn(rig, asked.count, Path(folder))
        ]
        try:
            for rig, group in dict.fromkeys((one.rig, one.group) for one in samples if one.rig in asked.rig):
                for one in findings([each for each in samples if (each.rig, each.group) == (rig, group)], guards):
                    found.append(one)
                    sys.stderr.write(f"{one.row.name} {one.row.value:g}; {one.row.note} ({one.seconds:.0f} s)\n")
                    kept(found, asked.json)
        except KeyboardInterrupt:
            sys.stderr.write("interrupted: what was found so far follows\n")
    return report("bench-guards", [one.row for one in found], seed=SEED, count=asked.count)


if __name__ == "__main__":
    sys.exit(main())
