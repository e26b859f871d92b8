"""The rigs that `compare` knows; a new rig is one more entry here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rigtwin.compare.twins.drop import DropEntry
from rigtwin.compare.twins.drum import DrumEntry
from rigtwin.compare.twins.hopper import HopperEntry
from rigtwin.compare.twins.packing import PackingEntry
from rigtwin.compare.twins.pendulum import PendulumEntry
from rigtwin.compare.twins.pile import PileEntry
from rigtwin.compare.twins.tilt import TiltEntry

if TYPE_CHECKING:
    from rigtwin.compare.twins.rig_entry import RigEntry
    from rigtwin.lab.file.lab_file import Experiment

ENTRIES: dict[str, RigEntry[Any]] = {
    entry.settings.name: entry
    for entry in (
        DropEntry(),
        PendulumEntry(),
        TiltEntry(),
        PackingEntry(),
        PileEntry(),
        DrumEntry(),
        HopperEntry(),
    )
}


def entry_of(experiment: Experiment) -> RigEntry[Any]:
    """Return the entry of an experiment's rig.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose rig is looked up.

    Returns
    -------
    RigEntry
        The entry.
    """
    return ENTRIES[experiment.rig.name]
