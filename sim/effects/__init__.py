"""Catalogue of effects: terms that plain contact mechanics and an ideal camera leave out.

One file per effect, in a folder per family; `library` finds them by listing the folders:

- adhesion/: adhesion at impacts and at lasting contacts
- camera/: errors of the camera: roll, scale, lens, perspective, frame rate, shutter, time stamps
- flight/: forces of the air and of electric charge on a moving bead
- friction/: friction that depends on time, speed or size
- impact/: restitution that depends on speed, shape or plate
- rig/: errors of the rig: level, lengths, pivot, release

and the code for all of them:

- effect.py: the types `Effect` and `Parameter`
- nameless_terms.py: terms with one coefficient, for a deviation that no effect of the catalogue describes
- nameless_shapes.py: such terms with a fitted shape (band, decay, period)
- validate.py: test calls of a user's own effect

The functions of an effect use only ``+ - * / ** abs``.  The same code therefore runs on NumPy arrays and compiled in an
engine.  A user's own file of the same form is loaded by `own_effect`.
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
from rigtwin.lab.spelling import meant_or
from rigtwin.sim.effects.effect import Effect, Parameter
from rigtwin.sim.effects.nameless_terms import PREFIX, form
from rigtwin.sim.effects.validate import check, one_sided

__all__ = ["Effect", "Parameter", "library", "named", "own_effect"]


@cache
def library() -> tuple[Effect, ...]:
    """Return every effect of the catalogue, sorted by name.

    Returns
    -------
    tuple of Effect
        The effects.

    Examples
    --------
    >>> [effect.name for effect in library()][:2]
    ['adhesion', 'adhesion_jkr']
    """
    families = [module.name for module in pkgutil.iter_modules(__path__) if module.ispkg]
    found = []
    for family in families:
        package = importlib.import_module(f"{__name__}.{family}")
        for module in pkgutil.iter_modules(package.__path__):
            found.append(_effect_of(importlib.import_module(f"{package.__name__}.{module.name}"), module.name))
    return tuple(sorted(found, key=lambda effect: effect.name))


def named(name: str) -> Effect:
    """Return the effect of a name.

    Parameters
    ----------
    name : str
        Name of an effect of the catalogue, or of a nameless term (``"form:..."``).

    Returns
    -------
    Effect
        The effect.

    Raises
    ------
    BadInput
        If there is no effect of that name; the message has the name that was meant, or one of each family.

    Examples
    --------
    >>> named("buoyancy").rigs
    ('drop', 'pendulum', 'double')
    """
    if name.startswith(PREFIX):
        return form(name)
    known = {effect.name: effect for effect in library()}
    if name not in known:
        firsts = {effect.group: effect.name for effect in reversed(known.values())}
        listed = ", ".join(reversed(firsts.values()))  # the first of each family
        advice = meant_or(name, known, f"known are {listed} and forms of these.")
        raise BadInput(f"there is no effect {name!r}; {advice}")
    return known[name]


def own_effect(path: Path) -> Effect:
    """Load an effect from a user's own Python file.

    Parameters
    ----------
    path : Path
        Python file that defines ``EFFECT = Effect(...)``.  The file is executed.

    Returns
    -------
    Effect
        The effect, with `aimed` set if its force or torque has a fixed direction.

    Raises
    ------
    BadInput
        If the file does not exist, cannot be executed or defines no effect, or if a hook fails in a test call at
        the typical parameters; the message names the file and the hook.

    Examples
    --------
    >>> own_effect(Path("missing.py"))
    Traceback (most recent call last):
    rigtwin.lab.errors.BadInput: missing.py: no such Python file; give a file that defines EFFECT = Effect(...).
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
            f"{name}: defines no EFFECT = Effect(...); see rigtwin/sim/effects/flight/air_drag.py for an example."
        )
    return effect
