"""rigtwin: measure granular materials from media, simulate the same rigs, set the two side by side.

The map of the project (the folders at the top level import as ``rigtwin.*``)::

    lab/       the nouns both sides share: units, materials, particles, rigs, the lab file, records, quantities
    measure/   media -> records -> quantities            (never imports sim)
    sim/       model + rig -> records                    (never imports measure)
    compare/   twins, deviations, the report             (the only room that sees both)
    commands/  the commands: their options, and how results are shown
    cli.py     the door: run a command, turn every error into one sentence

Arrows run one way: ``cli -> commands -> compare -> {measure, sim} -> lab``.  The same rig has the same file name in
every room: ``measure/drop/measurement.py`` and ``sim/drop.py`` together tell the whole drop test.
"""

__version__ = "0.1.0"
