"""The examples in the docstrings run and give what they say."""

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ENGINE = ("import taichi", "rigtwin.sim")  # starting the engine takes longer than all examples together


def modules():
    for room in ("lab", "measure", "sim", "compare"):
        for path in sorted((ROOT / room).rglob("*.py")):
            if not any(word in path.read_text(encoding="utf-8") for word in ENGINE):
                yield ".".join(("rigtwin", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__")


@pytest.mark.parametrize("name", list(modules()))
def test_the_examples_of_a_module_hold(name):
    result = doctest.testmod(importlib.import_module(name))
    assert result.failed == 0


def test_examples_are_found_at_all():
    assert "rigtwin.lab.units" in modules()
    assert doctest.testmod(importlib.import_module("rigtwin.lab.units")).attempted >= 3
