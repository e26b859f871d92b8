"""Twin of the pile on a round base."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

import numpy as np

from rigtwin.compare import curve_overlays
from rigtwin.compare.twins.many_body import Cast, Computed, ManyBodyEntry, bulk_twin
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.run_cost import need_usual_number
from rigtwin.compare.twins.twin import Twin, stated
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import PACKING
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.records import Profile
from rigtwin.lab.rig_quantities import ABOVE_RIM
from rigtwin.lab.rigs import LIFT_SPEED, Pile, PileSettings
from rigtwin.lab.tracked.table import is_table

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement, Quantity
    from rigtwin.sim.pile.pile import Heap
    from rigtwin.sim.run.set_up import Numerics


def pile_twin(
    rig: Pile,
    cast: Cast,
    *,
    count: int,
    seed: int,
    pour_rate: float | None = None,
    fall_height: float | None = None,
    fill_limit: float | None = None,
    settle_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """Simulate a pile of particles on a round base and evaluate its profiles, seen from the sides.

    Parameters
    ----------
    rig : Pile
        Base diameter [m], rim [m] and way of forming the pile.
    cast : Cast
        Particle, wall and contacts.
    count : int
        Number of particles.
    seed : int
        Seed of the random numbers.
    pour_rate : float, optional
        Particles per second [1/s], as in `rigtwin.sim.pile.pile.run`.
    fall_height : float, optional
        Height of fall [m], as in `rigtwin.sim.pile.pile.run`.
    fill_limit, settle_limit : float, optional
        Longest times of filling and settling [s], as in `rigtwin.sim.pile.pile.run`.
    progress : Progress
        Called with step, number and count.
    **numerics
        Numerical settings of the run.

    Returns
    -------
    Twin
        Angles of repose [deg] and profiles.

    Raises
    ------
    BadInput
        If the settings are not possible, or the profiles cannot be evaluated.
    """
    from rigtwin.sim.pile import pile

    begun = time.perf_counter()
    heap = pile.run(
        rig,
        *cast,
        count=count,
        seed=seed,
        pour_rate=pour_rate,
        fall_height=fall_height,
        progress=progress,
        **stated(fill_limit=fill_limit, settle_limit=settle_limit),
        **numerics,
    )
    return pile_result(rig, cast, heap, Computed(begun, seed, numerics.get("threads")))


def pile_result(rig: Pile, cast: Cast, heap: Heap, computed: Computed) -> Twin:
    """Evaluate a heap that was simulated.

    Parameters
    ----------
    rig : Pile
        The rig.
    cast : Cast
        Particle, wall and contacts.
    heap : Heap
        Result of the run.
    computed : Computed
        How it was computed.

    Returns
    -------
    Twin
        As `pile_twin` returns it.

    Raises
    ------
    BadInput
        If it cannot be evaluated.
    """
    from rigtwin.measure.pile import evaluate as ruler
    from rigtwin.sim.pile import pile

    failed, bead = _no_heap(rig, cast, heap), cast.particle.typical.diameter
    try:
        evaluation = ruler.evaluate(heap.profiles, base_diameter=heap.base_diameter, bead_diameter=bead)
    except BadInput as error:
        if failed:
            raise BadInput(f"{failed}.") from error
        raise
    if rig.rim_height > 0:
        above = _above_rim(rig, heap, bead)
        evaluation = replace(evaluation, quantities=(*evaluation.quantities, *above))
    course = {"asked": heap.asked, "placed": heap.placed, "fallen": heap.fallen, "at_rest": heap.at_rest}
    course |= stated(bed_height_m=heap.bed_height)
    shown = heap.profiles, (), lambda: pile.picture(rig, heap)
    return replace(bulk_twin("pile", rig, cast, heap, evaluation, computed, course, *shown), failed=failed)


def _no_heap(rig: Pile, cast: Cast, heap: Heap) -> str:
    """Why the particles on the base are no heap, with the setting to change; empty where they are one."""
    stay = heap.placed - heap.fallen
    thick, volume = cast.particle.typical.diameter, cast.particle.mean_volume
    layer = math.ceil(PACKING * math.pi / 4 * rig.base_diameter**2 * thick / volume)
    if rig.variant == "emptying" or stay >= layer:
        return ""
    what = f"{stay} of {heap.placed} particles are on the base, and one layer has about {layer}"
    if heap.fallen < heap.placed / 2:
        return f"{what}; give a larger count, or a smaller base_diameter"
    rim = "a rim_height" if rig.rim_height == 0 else "a higher rim_height"
    return f"{what}: the others rolled off; give {rim}, or contacts with more rolling_friction"


def _above_rim(rig: Pile, heap: Heap, diameter: float) -> Iterator[Quantity]:
    """Angles of repose of what is seen above the rim, from whose edge to edge they are read then."""
    from rigtwin.measure.pile import evaluate as ruler

    above = [replace(one, height=np.maximum(one.height - rig.rim_height, 0.0)) for one in heap.profiles]
    try:
        found = ruler.evaluate(above, base_diameter=heap.base_diameter, bead_diameter=diameter)
    except BadInput:  # nothing stands above it
        return
    for one in found.quantities:
        if one.quantity.startswith("angle_of_repose"):
            yield replace(one, method=f"{one.method}{ABOVE_RIM}")


def _volume(profile: Profile) -> tuple[float, float]:
    """Volume [m^3] of the body that the profile makes when it turns about its middle, and its largest radius [m]."""
    seen = np.isfinite(profile.height) & (profile.height > 0)
    if seen.sum() < 3:
        return 0.0, 0.0
    x, height = profile.x[seen], profile.height[seen]
    out = np.abs(x - (sum(profile.base) / 2 if profile.base is not None else x[[0, -1]].mean()))
    return float(np.pi * np.trapezoid(height * out, x)), float(out.max())


PILE_COUNT = 1000
"""Particles poured on a pile's twin where neither the lab file nor the command says how many."""
ROLLED_OFF = 2  # particles poured over those on a full base; more only fall off, and fewer may not fill it


class PileEntry(ManyBodyEntry[PileSettings]):
    """The heap in `compare`."""

    settings = PileSettings
    run_name: ClassVar[str] = "heap"

    def known(self, experiment: Experiment) -> dict[str, Any]:
        rig = self.rig(experiment)
        drained = rig.drain_diameter or 0.0 if rig.variant == "emptying" else 0.0
        return {"base_diameter": rig.base_diameter - drained}

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [Stated("base", rig.base_diameter, 1e3, " mm"), Stated("rim", rig.rim_height or None, 1e3, " mm")]

    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[curve_overlays.Overlay]:
        return curve_overlays.outlines("outline of the heap", measured, twins, experiment.particle.typical.diameter)

    def takes_count(self, experiment: Experiment) -> bool:
        return self.rig(experiment).count is None

    def count(self, experiment: Experiment, count: int | None) -> int:
        return self.rig(experiment).count or count or PILE_COUNT

    def needs_measurement(self, experiment: Experiment) -> bool:
        return self.takes_count(experiment) and bool(experiment.repetitions)

    def completed(self, experiment: Experiment, measurements: Sequence[Measurement]) -> tuple[Experiment, str]:
        rig, particle = self.rig(experiment), experiment.particle
        seen = [_volume(one) for item in measurements for one in item.profiles]
        volumes = [volume for volume, _ in seen if volume > 0]
        if rig.variant == "emptying" or rig.count is not None or not volumes:
            return experiment, ""
        count = round(PACKING * fmean(volumes) / particle.mean_volume)
        said = f"{count} particles, by the volume of the heap"
        if max(reach for _, reach in seen) > rig.base_diameter / 2 - 2 * particle.diameter:
            twice = ROLLED_OFF * count
            count = max(twice, PILE_COUNT)
            enough = f"twice the volume of the filmed heap, which reaches the edge of its base, is {twice} particles"
            said = f"{count} particles: {enough}{'' if count == twice else f', and at least {PILE_COUNT} are poured'}"
        origin = f"the volume of the heap on a base of {rig.base_diameter * 1e3:.4g} mm"
        need_usual_number("base_diameter", count, particle, origin, "the base and the size of the particle")
        try:
            self.check_count(experiment, count)
        except BadInput:
            return experiment, ""
        return replace(experiment, rig=replace(rig, count=count)), said

    def assumed(self, experiment: Experiment, count: int | None) -> list[str]:
        rig = self.rig(experiment)
        found = [] if rig.count or count else [f"{PILE_COUNT} particles"]
        if rig.variant == "piling":
            found += ["a funnel of a quarter of the base"] if rig.outlet_diameter is None else []
            found += ["a funnel that rises with the heap"] if rig.outlet_height is None else []
            found += ["a base without a rim"] if rig.rim_height == 0 else []
        if rig.variant == "pouring":
            found += ["a tube of half the base"] if rig.tube_diameter is None else []
            found += [f"a lift at {LIFT_SPEED * 1e3:.3g} mm/s"] if rig.lift_speed is None else []
        return found

    def check_count(self, experiment: Experiment, count: int | None) -> None:
        from rigtwin.sim.pile import pile

        assert count is not None
        pile.check(self.rig(experiment).rig(), experiment.particle, count=count)

    def check_media(self, experiment: Experiment, views: Sequence[Path]) -> None:
        if self.rig(experiment).variant != "emptying":
            return
        for view in views:
            if not is_table(view):
                raise BadInput(
                    f"{view}: a photo from outside does not show the crater of an emptied container; give a CSV file "
                    "of its surface in a section through the axis as x_m,height_m, with both halves set back to back: "
                    "x from the wall (0) to the edges of the hole."
                )

    def filled_twin(self, experiment: Experiment, cast: Cast, count: int | None, **run: Any) -> Twin:
        assert count is not None
        return pile_twin(self.rig(experiment).rig(), cast, count=count, **run)
