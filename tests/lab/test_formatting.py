"""Names of quantities for people."""

import ast
from pathlib import Path

import pytest

from rigtwin.lab.formatting import TITLES, title

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [path for room in ("measure", "sim", "compare") for path in sorted((ROOT / room).rglob("*.py"))]


def names_in(path: Path) -> set[str]:
    """Names that a file gives its quantities, as far as they stand there as text."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    constants = {
        node.targets[0].id: node.value.value
        for node in tree.body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and isinstance(node.value, ast.Constant)
    }
    firsts = [
        node.args[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Quantity" and node.args
    ]
    said = [
        first.value if isinstance(first, ast.Constant) else constants.get(getattr(first, "id", "")) for first in firsts
    ]
    return {name for name in said if isinstance(name, str)}


def test_every_quantity_that_is_measured_or_simulated_has_a_name_for_people():
    found = set().union(*map(names_in, SOURCES))
    assert len(found) >= 5
    assert found <= set(TITLES), found - set(TITLES)


@pytest.mark.parametrize("quantity", TITLES)
def test_a_name_for_people_has_no_underscore_of_its_own(quantity):
    assert "_" not in title(quantity).replace("h_B/h_A", "")
