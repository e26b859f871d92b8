"""What a sweep varies: the parameters of particle, contacts, rig and effects, by name, and designs over them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args, get_type_hints

from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.schema import ExperimentEntry, InSi
from rigtwin.lab.materials import PARAMETERS, Particle, no_bead_has, no_bead_is, scaled
from rigtwin.lab.spelling import suggestion
from rigtwin.lab.units import DIMENSIONS, si

if TYPE_CHECKING:
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.file.model_file import Model
    from rigtwin.sim.effects.effect import Parameter

Design = Literal["grid", "sobol", "latin"]
Point = Mapping[str, float]
"""Values of the varied parameters by name, in SI."""

WHOLE = ("count", "bounces")
"""Settings of rigs that are whole numbers."""

LEVELS = 5  # of a range in a grid, where none are given
MOST_POINTS = 10_000  # of a design; more were not meant

OF_PARTICLE = {"diameter": "length", "density": "density", "scale": "number", "youngs_modulus": "pressure"}
"""Parameters of the particle; `scale` multiplies all its lengths and keeps its mass."""

IMPOSSIBLE = {"diameter": no_bead_is, "density": no_bead_has}
"""What is odd about a value of a particle, empty where nothing is."""


class Setting(NamedTuple):
    """An experiment under a model."""

    experiment: Experiment
    model: Model


@dataclass(frozen=True)
class Varied:
    """A parameter and its values.

    Attributes
    ----------
    name : str
        Name of the parameter.
    values : tuple of float
        Values in SI; of a range the lowest and the highest.
    levels : int or None
        Number of levels of a range in a grid; None for a list of values.
    unit : str
        SI unit of the values.
    """

    name: str
    values: tuple[float, ...]
    levels: int | None
    unit: str = "1"

    @property
    def grid(self) -> tuple[float, ...]:
        """The values in a grid."""
        if self.levels is None:
            return self.values
        low, high = self.values
        return tuple(float(f"{low + (high - low) * k / (self.levels - 1):.12g}") for k in range(self.levels))


def parse(text: str, experiment: Experiment, *, option: str = "--vary") -> Varied:
    """Read a parameter and its values.

    Parameters
    ----------
    text : str
        ``static_friction=0.05..1.5:8`` (a range with its number of levels) or ``outlet=30mm,40mm``.
    experiment : Experiment
        Its twin decides which parameters there are.
    option : str
        The option that errors name.

    Returns
    -------
    Varied
        The parameter and its values.

    Raises
    ------
    BadInput
        If it is not like this, or the experiment has no such parameter.
    """
    name, equals, said = (part.strip() for part in text.partition("="))
    if not (name and equals and said):
        raise BadInput(f"{option}: {text!r} is not like static_friction=0.05..1.5:8 or outlet=30mm,40mm.")
    if not applies(name, experiment):
        known = [*names(experiment), *of_pairs(experiment)]
        raise BadInput(
            f"{option}: a {experiment.rig_name} has no parameter {name!r} that can be varied; "
            f"{suggestion(name, known)}."
        )
    unit = _unit(name, experiment, option)
    low, dots, rest = said.partition("..")
    if not dots:
        values = tuple(_value(name, item.strip(), experiment, option) for item in said.split(","))
        return Varied(name, values, None, unit)
    high, colon, levels = rest.partition(":")
    if colon and not (levels.strip().isdecimal() and int(levels) >= 2):
        raise BadInput(f"{option}: {name} has {levels!r} levels; give a whole number of at least 2.")
    if len(levels.strip()) > len(str(MOST_POINTS)) or int(levels or 0) > MOST_POINTS:
        raise BadInput(f"{option}: {name} has more than {MOST_POINTS} levels; give fewer.")
    ends = _value(name, low.strip(), experiment, option), _value(name, high.strip(), experiment, option)
    if not ends[0] < ends[1]:
        raise BadInput(f"{option}: {name} goes from {low.strip()} to {high.strip()}; give the lower value first.")
    return Varied(name, ends, int(levels) if colon else LEVELS, unit)


def applies(name: str, experiment: Experiment) -> bool:
    """Return whether the twin of an experiment has a parameter; those of effects apply to every twin.

    Parameters
    ----------
    name : str
        Name of the parameter.
    experiment : Experiment
        Experiment whose twin is asked.

    Returns
    -------
    bool
        True where it has the parameter.
    """
    return "." in name or name in names(experiment) or name in of_pairs(experiment)


def of_pairs(experiment: Experiment) -> dict[str, tuple[str, tuple[str, str]]]:
    """Return the parameters of single contacts, ``static_friction@D6-steel``.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose contacts are listed.

    Returns
    -------
    dict of str to tuple
        By name the parameter and the pair.
    """
    return {
        f"{parameter}@{a}-{b}": (parameter, (a, b))
        for one, other in experiment.contacts
        for a, b in ((one, other), (other, one))
        for parameter in PARAMETERS
    }


def of_contact(name: str) -> str:
    """Return the parameter of a contact that a name means.

    Parameters
    ----------
    name : str
        The name, also with ``wall_`` before it or a pair behind it.

    Returns
    -------
    str
        ``static_friction`` of ``wall_static_friction`` and of ``static_friction@D6-steel``.
    """
    return name.removeprefix("wall_").partition("@")[0]


def contact_pair(name: str, experiment: Experiment) -> tuple[str, str]:
    """Return the pair whose parameter a name means in an experiment.

    Parameters
    ----------
    name : str
        Name of a parameter of a contact.
    experiment : Experiment
        Experiment in which the name is looked up.

    Returns
    -------
    tuple of str
        Names of the two sides.
    """
    if "@" in name:
        return of_pairs(experiment)[name][1]
    return experiment.contacts[0 if name.startswith("wall_") else -1]


def need_different(said: Sequence[str], experiments: Sequence[Experiment], *, option: str) -> None:
    """Refuse names that mean the same parameter.

    Parameters
    ----------
    said : sequence of str
        Names as the user gave them.
    experiments : sequence of Experiment
        Experiments in which the names are looked up.
    option : str
        The option that errors name.

    Raises
    ------
    BadInput
        If two of the names are the same, or mean the same contact's parameter in an experiment.
    """
    for experiment in experiments:
        seen: dict[Any, str] = {}
        for name in (one for one in said if applies(one, experiment)):
            of_a_contact = of_contact(name) in PARAMETERS
            meant = (of_contact(name), *sorted(contact_pair(name, experiment))) if of_a_contact else name
            if meant in seen:
                same = "is given twice" if seen[meant] == name else f"and {seen[meant]} are the same parameter"
                raise BadInput(f"{option}: {name} {same}; take one of them out.")
            seen[meant] = name


def names(experiment: Experiment) -> list[str]:
    """Return the parameters of an experiment that can be varied, without those of effects.

    Parameters
    ----------
    experiment : Experiment
        Experiment whose parameters are listed.

    Returns
    -------
    list of str
        Their names, without those of single contacts (`of_pairs`).
    """
    own = list(PARAMETERS) if experiment.rig.particles_touch else []
    wall = [] if experiment.wall is None else [f"wall_{name}" for name in PARAMETERS]
    taken = {field.name for field in fields(experiment.rig)} - {"variant", "hanger", *experiment.rig.idle}
    return [*own, *wall, *OF_PARTICLE, *(name for name in _entry_hints(experiment.rig_name) if name in taken)]


def points(varied: Sequence[Varied], design: Design, number: int | None, seed: int) -> list[Point]:
    """Return the points of a design.

    Parameters
    ----------
    varied : sequence of Varied
        Parameters.
    design : {"grid", "sobol", "latin"}
        All combinations of levels, a Sobol sequence, or a Latin hypercube (`scipy.stats.qmc`).
    number : int, optional
        Number of points of a design that is no grid.
    seed : int
        Seed of a design that is no grid.

    Returns
    -------
    list of Point
        Values in SI, by name.

    Raises
    ------
    BadInput
        If number and design do not go together, or there are too many points.
    """
    if design == "grid":
        if number is not None:
            raise BadInput("--points: a grid has as many points as its levels give; leave it out, or give --design.")
        whole = math.prod(len(one.grid) for one in varied)
        if whole > MOST_POINTS:
            raise BadInput(f"--vary: {whole} points; give fewer levels, or --design sobol with --points.")
        grids = [one.grid for one in varied]
        return [_point(varied, values) for values in itertools.product(*grids)]
    if number is None:
        raise BadInput(f"--points: a {design} design needs their number.")
    if number > MOST_POINTS:
        raise BadInput(f"--points: {number} points; give at most {MOST_POINTS}.")
    if listed := [one.name for one in varied if one.levels is None]:
        raise BadInput(f"--vary: {listed[0]} is a list of values; a {design} design needs a range like 0.1..0.5.")
    from scipy.stats import qmc

    if design == "sobol":
        sampler = qmc.Sobol(len(varied), rng=seed)
        unit = sampler.random_base2(max(1, math.ceil(math.log2(number))))[:number]
    else:
        unit = qmc.LatinHypercube(len(varied), rng=seed).random(number)
    scaled = qmc.scale(unit, [one.values[0] for one in varied], [one.values[1] for one in varied])
    return [_point(varied, row) for row in scaled.tolist()]


def _point(varied: Sequence[Varied], values: Sequence[float]) -> Point:
    named = zip((one.name for one in varied), values, strict=True)
    return {name: round(value) if name in WHOLE else value for name, value in named}


def at(setting: Setting, point: Point) -> Setting:
    """Return the experiment and the model at a point.

    Parameters
    ----------
    setting : Setting
        Experiment and model.
    point : Point
        Values in SI, by name.

    Returns
    -------
    Setting
        The experiment and the model, changed.

    Raises
    ------
    BadInput
        If a coefficient or a property of the particle is out of range.
    """
    experiment, model = setting
    rig = {field.name for field in fields(experiment.rig)}
    for name, value in point.items():
        if "." in name:
            effect, _, parameter = name.partition(".")
            known = model.effects.get(effect, {})
            model = replace(model, effects={**model.effects, effect: {**known, parameter: value}})
        elif of_contact(name) in PARAMETERS:
            changed: dict[str, Any] = {of_contact(name): value}
            model = model.with_contact(*contact_pair(name, experiment), **changed)
        elif name in OF_PARTICLE:
            experiment = replace(experiment, particle=_particle(experiment.particle, name, value))
        elif name in rig:
            settings: Any = experiment.rig
            experiment = replace(experiment, rig=replace(settings, **{name: round(value) if name in WHOLE else value}))
    return Setting(experiment, model)


def _particle(particle: Particle, name: str, value: float) -> Particle:
    if name == "density":
        return replace(particle, density=value)
    if name == "youngs_modulus":
        return replace(particle, material=replace(particle.material, youngs_modulus=value))
    factor = value if name == "scale" else value / particle.typical.diameter
    density = particle.effective_density / factor**3 if name == "scale" else particle.density
    return replace(scaled(particle, factor), density=density)


@cache
def _entry_hints(rig: str) -> dict[str, Any]:
    """Types of the keys of a rig in lab.toml."""
    kinds = {get_args(get_type_hints(kind)["rig"])[0]: kind for kind in get_args(ExperimentEntry)}
    return get_type_hints(kinds[rig], include_extras=True)


def _unit(name: str, experiment: Experiment, option: str) -> str:
    """SI unit of a parameter."""
    if "." in name:
        return _of_effect(name, option).unit
    if of_contact(name) in PARAMETERS:
        return "1"
    if name in OF_PARTICLE:
        return DIMENSIONS[OF_PARTICLE[name]][0]
    hint = _entry_hints(experiment.rig_name)[name]
    kinds = (hint, *get_args(hint))  # of an optional key the first of its arguments
    read = [one for kind in kinds for one in getattr(kind, "__metadata__", ()) if isinstance(one, InSi)]
    return DIMENSIONS[read[0].dimension][0] if read else "1"


def _value(name: str, text: str, experiment: Experiment, option: str) -> float:
    """A value of a parameter in SI."""
    if "." in name:
        return si(text, "number", name=f"{option} {name}")
    if of_contact(name) in PARAMETERS or name in OF_PARTICLE:
        value = si(text, OF_PARTICLE.get(name, "number"), name=f"{option} {name}")
        zero_is_possible = of_contact(name).endswith("friction")
        if value < 0 or (value == 0 and not zero_is_possible) or (of_contact(name) == "restitution" and value > 1):
            raise BadInput(f"{option}: {name} cannot be {text}.")
        if name in IMPOSSIBLE and (odd := IMPOSSIBLE[name](value)):
            raise BadInput(f"{option}: {name} {text}: {odd}")
        return value
    from pydantic import TypeAdapter, ValidationError

    try:
        item = int(text) if text.isdecimal() and name in WHOLE else text
        return float(TypeAdapter(_entry_hints(experiment.rig_name)[name]).validate_python(item))
    except ValidationError as error:
        raise BadInput(f"{option}: {name}: {str(error.errors()[0]['msg']).removeprefix('Value error, ')}") from None


def _of_effect(name: str, option: str) -> Parameter:
    from rigtwin.sim.effects import named

    effect, _, parameter = name.partition(".")
    known = {one.name: one for one in named(effect).parameters}
    if parameter not in known:
        raise BadInput(f"{option}: {effect} has no parameter {parameter!r}; {suggestion(parameter, known)}.")
    return known[parameter]
