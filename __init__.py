"""rigtwin: measure granular materials from media, simulate the same rigs, set the two side by side.

The map of the project (the folders at the top level import as ``rigtwin.*``)::

    lab/       the nouns both sides share: units, materials, particles, rigs, the lab file, records, quantities
    measure/   media -> records -> quantities            (never imports sim)
    sim/       model + rig -> records                    (never imports measure)
    compare/   twins, deviations, the report             (the only room that sees both)
    cli.py     the door: parse, call one function, print

Arrows run one way: ``cli -> compare -> {measure, sim} -> lab``.  The same rig has the same file name in every
room: ``measure/drop.py`` and ``sim/drop.py`` together tell the whole drop test.
"""

__version__ = "0.1.0"
