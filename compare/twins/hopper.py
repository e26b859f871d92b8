"""Twin of the hopper."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Unpack

from rigtwin.compare import curve_overlays
from rigtwin.compare.twins.many_body import (
    Cast,
    Computed,
    ManyBodyEntry,
    bulk_twin,
    filling_count,
    filling_mass,
    stated_filling,
)
from rigtwin.compare.twins.rig_entry import Stated
from rigtwin.compare.twins.run_warnings import warned
from rigtwin.compare.twins.twin import Twin, stated
from rigtwin.lab.errors import BadInput
from rigtwin.lab.materials import Particle
from rigtwin.lab.progress import Progress, silent
from rigtwin.lab.quantity import Evaluation, Quantity, doubted, failed
from rigtwin.lab.rigs import SLOT_LENGTH, SLOT_WIDTH, Hopper, HopperSettings

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.quantity import Measurement
    from rigtwin.sim.hopper import Discharge
    from rigtwin.sim.run.set_up import Numerics


def hopper_twin(
    rig: Hopper,
    cast: Cast,
    *,
    count: int,
    seed: int,
    duration: float | None = None,
    fill_limit: float | None = None,
    settle_limit: float | None = None,
    progress: Progress = silent,
    **numerics: Unpack[Numerics],
) -> Twin:
    """Simulate the discharge of a hopper and evaluate the mass left over time.

    Parameters
    ----------
    rig : Hopper
        Outlet [m], shape and sizes of the hopper.
    cast : Cast
        Particle, wall and contacts.
    count : int
        Number of particles.
    seed : int
        Seed of the random numbers.
    duration : float, optional
        Simulated time from the opening [s]; by default until no particle leaves any more.
    fill_limit, settle_limit : float, optional
        Longest times of filling and settling [s], as in `rigtwin.sim.hopper.run`.
    progress : Progress
        Called with step, number and count.
    **numerics
        Numerical settings of the run.

    Returns
    -------
    Twin
        Discharge time [s], mass flow rate [kg/s] and mass left [kg] over time.

    Raises
    ------
    BadInput
        If the settings are not possible, or there is no flow that can be evaluated.
    """
    from rigtwin.sim import hopper

    begun = time.perf_counter()
    waits = stated(fill_limit=fill_limit, settle_limit=settle_limit)
    discharge = hopper.run(
        rig, *cast, count=count, seed=seed, duration=duration, progress=progress, **waits, **numerics
    )
    return hopper_result(rig, cast, discharge, Computed(begun, seed, numerics.get("threads")), duration=duration)


def hopper_result(
    rig: Hopper, cast: Cast, discharge: Discharge, computed: Computed, *, duration: float | None = None
) -> Twin:
    """Evaluate a discharge that was simulated.

    Parameters
    ----------
    rig : Hopper
        The rig.
    cast : Cast
        Particle, wall and contacts.
    discharge : Discharge
        Result of the run.
    computed : Computed
        How it was computed.
    duration : float, optional
        Simulated time from the opening [s] where it was stated.

    Returns
    -------
    Twin
        As `hopper_twin` returns it.

    Raises
    ------
    BadInput
        If it cannot be evaluated.
    """
    from rigtwin.measure.hopper import evaluate as ruler
    from rigtwin.sim import hopper

    try:
        evaluation = ruler.evaluate(
            discharge.mass_left, total_mass=discharge.asked * cast.particle.mean_mass, opened=0.0
        )
    except BadInput as error:
        if why := _no_flow(rig, cast.particle, discharge, duration):
            raise BadInput(why) from error
        raise
    if discharge.arched or failed(evaluation.checks, {"emptied"}):
        evaluation = _not_emptied(evaluation, discharge)
    course = {
        "asked": discharge.asked,
        "emptied": discharge.emptied,
        "remaining": discharge.remaining,
        "last_bead_s": discharge.discharge_time,
        "mass_flow_rate_kg_s": discharge.mass_flow_rate,
    }
    heap = () if discharge.pile is None else (discharge.pile,)
    shown = heap, (discharge.mass_left,), lambda: hopper.picture(rig, cast.particle, discharge)
    twin = bulk_twin("hopper", rig, cast, discharge, evaluation, computed, course, *shown)
    if discharge.arched and discharge.emptied < discharge.asked / 2:
        return replace(twin, failed=_no_flow(rig, cast.particle, discharge, duration).rstrip("."))
    return twin


def _not_emptied(evaluation: Evaluation, discharge: Discharge) -> Evaluation:
    """Mark times as doubtful because particles remain in the hopper, and all other quantities if they arch."""
    why = next(sentence for sentence in warned({"warnings": discharge.warnings}) if sentence.startswith("only "))

    def doubtful(one: Quantity) -> bool:
        if one.quantity == "opening_time":
            return False
        return discharge.arched or (one.unit == "s" and not one.doubtful)

    return replace(
        evaluation, quantities=tuple(doubted(one, why) if doubtful(one) else one for one in evaluation.quantities)
    )


def _no_flow(rig: Hopper, particle: Particle, discharge: Discharge, duration: float | None) -> str:
    """The setting that prevents a discharge that can be evaluated, with advice; empty if it is none of these."""
    from rigtwin.measure.hopper.evaluate import STAYS
    from rigtwin.sim.hopper import STUCK
    from rigtwin.sim.run.filling import arch_in_words

    end = float(discharge.mass_left.time[-1])
    if discharge.emptied == discharge.asked:
        return (
            f"a count of {discharge.asked} is too small for a flow: all particles are out after {end:.2g} s; "
            "give more particles or a narrower outlet."
        )
    stay = f"{discharge.remaining} of {discharge.asked} particles"
    if discharge.arched:
        return f"outlet: {arch_in_words(stay, rig.outlet, particle)}; give a wider one."
    latest = float(discharge.outlet_times[-1]) if discharge.emptied else 0.0
    if duration is not None and end >= duration and end - latest <= STUCK:
        return (
            f"duration: {duration:g} s after the opening {discharge.emptied} of {discharge.asked} particles have left "
            "and the flow continues; give a longer duration, or none to wait until the flow has stopped."
        )
    if discharge.remaining < STAYS * discharge.asked:
        return ""
    return f"{stay} stay in the hopper around its outlet; give steeper walls or a wider outlet."


class HopperEntry(ManyBodyEntry[HopperSettings]):
    """The hopper in `compare`."""

    settings = HopperSettings
    run_name: ClassVar[str] = "discharge"

    def known(self, experiment: Experiment) -> dict[str, Any]:
        rig = self.rig(experiment)
        return {
            "bin_width": rig.bin_width,
            "depth": rig.depth,
            "total_mass": self.filling(experiment),
            "bead_density": experiment.particle.effective_density,
        }

    def stated(self, experiment: Experiment) -> list[Stated]:
        rig = self.rig(experiment)
        return [
            Stated("outlet", rig.outlet, 1e3, " mm"),
            Stated("bin", rig.bin_width, 1e3, " mm"),
            Stated("depth", rig.depth, 1e3, " mm"),
            Stated("walls at", rig.inclination, math.degrees(1), "°"),
            stated_filling(rig),
        ]

    def curves(
        self, experiment: Experiment, measured: Sequence[Measurement], twins: Sequence[Twin]
    ) -> Iterable[curve_overlays.Overlay]:
        return curve_overlays.share_left_over_time(measured, twins)

    def filling(self, experiment: Experiment) -> float | None:
        return filling_mass(self.rig(experiment), experiment.particle)

    def takes_count(self, experiment: Experiment) -> bool:
        rig = self.rig(experiment)
        return rig.count is None and rig.total_mass is None

    def count(self, experiment: Experiment, count: int | None) -> int:
        return filling_count(self.rig(experiment), experiment.particle, count)

    def assumed(self, experiment: Experiment, count: int | None) -> list[str]:
        rig = self.rig(experiment)
        usual = Hopper(rig.outlet or 0.0)
        if rig.variant == "slot":
            found = [f"a bin {SLOT_WIDTH * 1e3:.3g} mm wide"] if rig.bin_width is None else []
            found += [f"a slot {SLOT_LENGTH * 1e3:.3g} mm long"] if rig.depth is None else []
            walls = f"walls at {math.degrees(usual.inclination):.3g} degrees"
            return [*found, walls] if rig.inclination is None else found
        found = [f"a bin {usual.diameter * 1e3:.3g} mm wide"] if rig.bin_width is None else []
        return [*found, f"a cone of {usual.cone_height * 1e3:.3g} mm"] if rig.cone_height is None else found

    def check_count(self, experiment: Experiment, count: int | None) -> None:
        from rigtwin.sim import hopper

        assert count is not None
        hopper.check(self.rig(experiment).rig(), experiment.particle, count=count)

    def filled_twin(self, experiment: Experiment, cast: Cast, count: int | None, **run: Any) -> Twin:
        assert count is not None
        return hopper_twin(self.rig(experiment).rig(), cast, count=count, **run)
