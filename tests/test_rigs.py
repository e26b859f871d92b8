"""Every rig of `rigtwin.lab.rigs.RIGS` has all its parts, and no list of rigs differs from it."""

import inspect
import tomllib
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from rigtwin.commands import measure, simulate
from rigtwin.compare.deviation import RESULTS
from rigtwin.compare.twins.registry import ENTRIES
from rigtwin.lab.file import schema
from rigtwin.lab.formatting import TITLES
from rigtwin.lab.rig_quantities import _OF_RIG
from rigtwin.lab.rigs import RIGS, SETTINGS, Rig, RigName

PYPROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
LAYERS = {
    contract["containers"][0]: {name.strip() for layer in contract["layers"] for name in layer.split("|")}
    for contract in PYPROJECT["tool"]["importlinter"]["contracts"]
    if contract["type"] == "layers"
}
KEYS = {get_args(entry.model_fields["rig"].annotation)[0]: entry for entry in get_args(schema.ExperimentEntry)}


def test_every_list_of_rigs_is_that_of_their_settings():
    commands = [[each.name for each in group.app.registered_commands] for group in (measure, simulate)]
    commands[0].remove("lab")
    commands[1].remove("custom")  # a geometry of the user's own, of which there is no measurement
    for names in (get_args(RigName), ENTRIES, KEYS, *commands):
        assert sorted(names) == sorted(RIGS)


def test_settings_give_a_rig_of_their_own_and_a_title():
    made = {get_type_hints(kind.rig)["return"] for kind in SETTINGS.values()}
    assert made == set(get_args(Rig))
    assert len({kind.title for kind in SETTINGS.values()}) == len(made) == len(RIGS)


@pytest.mark.parametrize("rig", RIGS)
def test_the_keys_of_lab_toml_hold_all_settings(rig):
    assert ENTRIES[rig].settings is SETTINGS[rig]
    assert {field.name for field in fields(SETTINGS[rig])} <= KEYS[rig].model_fields.keys()


@pytest.mark.parametrize("rig", RIGS)
def test_measure_takes_what_compare_hands_it(rig):
    parameters = inspect.signature(import_module(f"rigtwin.measure.{rig}.measurement").measure).parameters
    assert {"bead_diameter", "table", "out", "progress"} <= parameters.keys()
    assert callable(import_module(f"rigtwin.measure.{rig}.evaluate").evaluate)


@pytest.mark.parametrize("folder", ["measure", "sim"])
def test_the_import_contracts_keep_every_rig_apart(folder):
    assert set(RIGS) <= LAYERS[f"rigtwin.{folder}"]


def test_every_result_can_be_stated_and_the_docs_name_it():
    named = {name for quantities in _OF_RIG.values() for name in quantities}
    assert RESULTS.keys() <= named
    assert {name.partition(" ")[0] for name in _OF_RIG} == set(RIGS)
    page = (Path(__file__).parents[1] / "docs" / "stated_results.md").read_text(encoding="utf-8")
    assert not {name for name in named if f"`{name}`" not in page}
    assert named <= TITLES.keys()


def test_stated_places_belong_to_known_rigs():
    assert {rig for rigs in schema._ONLY_OF.values() for rig in rigs} <= set(RIGS)
