"""The kinds of input, and how often each is drawn: kinds that take long less often."""

from __future__ import annotations

from random import Random

from rigtwin.benchmarks.fuzz_cases import command_options, decks, kept, labs, media, solids, tables
from rigtwin.benchmarks.fuzz_cases.case import Kind

KINDS: dict[str, tuple[Kind, int]] = {
    "table": (tables.own_table, 12),
    "table of a tracker": (tables.tracker, 10),
    "table of another rig": (tables.table_of_rig, 8),
    "--columns": (tables.columns, 4),
    "lab.toml, measured": (labs.measured_lab, 5),
    "lab.toml, stated": (labs.stated_lab, 8),
    "lab.toml, simulated": (labs.simulated_lab, 8),
    "lab.toml, compared": (labs.compared_lab, 2),
    "model.toml": (labs.model, 4),
    "lab.json": (labs.tracked_lab, 6),
    "film": (media.container, 14),
    "film, measured": (media.long_film, 3),
    "stack": (media.stack, 10),
    "photo": (media.photo, 8),
    "sound": (media.sound, 5),
    "STL wall": (solids.wall, 5),
    "STL grain": (solids.grain_of_lab, 3),
    "checkpoint": (kept.damaged_checkpoint, 3),
    "checkpoint, mended": (kept.mended_checkpoint, 3),
    "store": (kept.damaged_store, 5),
    "kept measurement": (kept.kept_measurement, 4),
    "earlier results": (kept.earlier_results, 2),
    "deck": (decks.imported, 5),
    "options of simulate": (command_options.of_simulate, 6),
    "options of measure": (command_options.of_measure, 6),
    "options of export": (command_options.of_export, 5),
    "options of sweep": (command_options.of_sweep, 4),
}


def drawn(chance: Random) -> tuple[str, Kind]:
    """A kind by chance, with its name."""
    (name,) = chance.choices(list(KINDS), [weight for _, weight in KINDS.values()])
    return name, KINDS[name][0]


def every(number: int) -> tuple[str, Kind]:
    """The kinds one after the other."""
    name = list(KINDS)[number % len(KINDS)]
    return name, KINDS[name][0]
