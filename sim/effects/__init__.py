"""The library of effects: one small file each, found by looking into this folder.

An effect is one term that plain contact mechanics and an ideal camera leave out.  A file says what it is called, its
equation and source, its parameters, the rigs in which it acts, and how it enters, as plain functions of numbers.  The
functions use only ``+ - * / ** abs``, so the very same code runs on NumPy arrays here and can be compiled into an
engine.  A user's own file of the same kind takes part: `own_effect(path)`.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

from rigtwin.lab.errors import BadInput
from rigtwin.sim.effects.effect import Effect, Parameter
from rigtwin.sim.effects.nameless_terms import PREFIX, form
from rigtwin.sim.effects.validate import check, one_sided

__all__ = ["Effect", "Parameter", "library", "named", "own_effect"]


@cache
def library() -> tuple[Effect, ...]:
    """Every effect in the sub-folders of this folder, sorted by name."""
    families = [module.name for module in pkgutil.iter_modules(__path__) if module.ispkg]
    found = []
    for family in families:
        package = importlib.import_module(f"{__name__}.{family}")
        for module in pkgutil.iter_modules(package.__path__):
            found.append(_effect_of(importlib.import_module(f"{package.__name__}.{module.name}"), module.name))
    return tuple(sorted(found, key=lambda effect: effect.name))


def named(name: str) -> Effect:
    """The effect of that name, or the nameless term.  Raises `BadInput` with the known names."""
    if name.startswith(PREFIX):
        return form(name)
    known = {effect.name: effect for effect in library()}
    if name not in known:
        raise BadInput(f"there is no effect {name!r}; known are {', '.join(known)}.")
    return known[name]


def own_effect(path: Path) -> Effect:
    """The effect in a user's own file, which must define ``EFFECT = Effect(...)``.

    Its functions are tried on plausible numbers first.  Raises `BadInput`, with the file and the hook.
    """
    spec = importlib.util.spec_from_file_location(f"rigtwin_own_{path.stem}", path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise BadInput(f"{path}: no such Python file; give a file that defines EFFECT = Effect(...).")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise BadInput(f"{path}: cannot be run ({type(error).__name__}: {error}); correct the file.") from error
    effect = _effect_of(module, str(path))
    check(effect, path)
    return replace(effect, aimed=effect.aimed or one_sided(effect))


def _effect_of(module: ModuleType, name: str) -> Effect:
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise BadInput(
            f"{name}: defines no EFFECT = Effect(...); see rigtwin/sim/effects/flight/air_drag.py for a model."
        )
    return effect
