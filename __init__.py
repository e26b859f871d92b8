"""rigtwin: measure granular materials from media, simulate the same rigs, set the two side by side.

The Python API::

    rigtwin.measure(rig, *media, **settings)    a clip or photos to a `Measurement`
    rigtwin.simulate(rig, **settings)           the digital twin of a rig
    rigtwin.open_lab(folder)                    a lab folder, to compare and to diagnose

The folders at the top level import as ``rigtwin.*``::

    lab/       types that measurement and simulation share: units, materials, rigs, lab file, records, quantities
    measure/   media -> records -> quantities            (never imports sim)
    sim/       model + rig -> records                    (never imports measure)
    compare/   twins, deviations, reports, diagnosis     (imports measure and sim)
    commands/  the commands: their options, and how results are shown
    api.py     the functions above
    cli.py     the command line: run a command, turn every error into one sentence

Imports run one way: ``cli -> api -> commands -> compare -> {measure, sim} -> lab``.  ``measure/<rig>/`` and
``sim/<rig>.py`` together show one whole experiment.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from rigtwin.lab.version import __version__

__all__ = ["__version__", "measure", "open_lab", "simulate"]

if TYPE_CHECKING:
    from rigtwin.api import measure, open_lab, simulate
else:

    class _MeasurePackage(ModuleType):
        """The package ``rigtwin.measure``, which may be called like the function of that name."""

        def __call__(self, rig: str, *media: Any, **settings: Any) -> Any:
            from rigtwin.api import measure

            return measure(rig, *media, **settings)

    import_module("rigtwin.measure").__class__ = _MeasurePackage

    def __getattr__(name: str) -> Any:
        """Load `simulate` and `open_lab` when they are first used."""
        if name in ("simulate", "open_lab"):
            from rigtwin import api

            return getattr(api, name)
        raise AttributeError(f"module 'rigtwin' has no attribute {name!r}")
