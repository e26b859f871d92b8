"""The methods text of a comparison: what was measured, how the twins were run and how both were compared.

Every number in it is one of this run: of lab.toml, the measurements, the settings of the twins, or the versions of
the programs.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rigtwin.compare.chosen import known_scatter
from rigtwin.compare.deviation import SURE, UNINFORMATIVE, Deviation, headlines
from rigtwin.compare.report.methods_text import Methods, effect_sentence, listed, software, were
from rigtwin.compare.twins.many_body import NUMERICS
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.formatting import reading, title
from rigtwin.lab.media_files import SOUNDS
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.reference.bibliography import SOFTWARE
from rigtwin.lab.rigs import GRAVITY

if TYPE_CHECKING:
    from rigtwin.compare.comparison import Comparison, Outcome
    from rigtwin.compare.twins.twin import Twin
    from rigtwin.lab.file.lab_file import Experiment
    from rigtwin.lab.materials import Material, Particle
    from rigtwin.lab.quantity import Measurement

_MEDIA = {"film": "films", "photo": "photos", "table": "tables of tracked data", "sound": "sound recordings"}


def methods(comparison: Comparison, versions: Mapping[str, str]) -> Methods:
    """The methods text of a comparison.

    Parameters
    ----------
    comparison : Comparison
        The finished comparison.
    versions : mapping of str to str
        Versions of the programs, as in provenance.json.

    Returns
    -------
    Methods
        Its paragraphs.
    """
    return Methods(
        tuple(
            (heading, text)
            for heading, text in (
                ("Experiments", _experiments(comparison)),
                ("Measurement", _measurement(comparison, versions)),
                ("Simulation", _simulation(comparison)),
                ("Comparison", _comparison(comparison)),
                ("Software", software(versions)),
            )
            if text
        )
    )


# ------------------------------------------------------------------------------------------------------- experiments


def _experiments(comparison: Comparison) -> str:
    number = len(comparison.outcomes)
    first = f"The lab “{comparison.lab.title}” has {number} experiment{'s' if number > 1 else ''} in this comparison."
    parts = [first, *(_experiment(outcome) for outcome in comparison.outcomes)]
    if comparison.lab.borrowed:
        parts.append(
            "Not stated by the lab and taken from published tables [@hlosta2020]: "
            f"{'; '.join(sentence.rstrip('.') for sentence in comparison.lab.borrowed)}."
        )
    return "\n\n".join(parts)


def _experiment(outcome: Outcome) -> str:
    experiment = outcome.experiment
    wall = "" if experiment.wall is None else f" on {_material(experiment.wall)}"
    settings = [
        f"{one.name.removesuffix(', stated')} {one.text}" for one in entry_of(experiment).stated(experiment) if one.text
    ]
    sentences = [
        f"`{experiment.id}` ({_kind(experiment)}): {_particle(experiment.particle)}{wall}"
        + (f"; stated: {', '.join(settings)}." if settings else "."),
        *_repetitions(outcome),
        *_stated(experiment),
    ]
    return " ".join(sentences)


def _kind(experiment: Experiment) -> str:
    variant = getattr(experiment.rig, "variant", "")
    return f"{experiment.rig.title.lower()}{f', {variant}' if variant else ''}"


def _particle(particle: Particle) -> str:
    size = f"{1e3 * particle.diameter:.4g} mm"
    shape = f"sphere of {size}"
    if particle.shape is not None:
        shape = f"rigid clump of {len(particle.radii)} spheres, {size} across"
    if particle.sizes is not None:
        kind = "spheres" if particle.shape is None else f"rigid clumps of {len(particle.radii)} spheres"
        median = f"median by mass {1e3 * particle.typical.equivalent_diameter:.4g} mm"
        return _with_mass(particle, f"{kind} of different sizes ({particle.sizes.law}; {median})", "mean ")
    return _with_mass(particle, f"a {shape}")


def _with_mass(particle: Particle, shape: str, of: str = "") -> str:
    density = "" if particle.density is None else f"{particle.density:.4g} kg/m³ over its volume, "
    mass = f"{of}{1e3 * particle.mean_mass:.3g} g"
    return f"particle {particle.name}, {shape} and {mass}, {density}of {_material(particle.material)}"


def _material(material: Material) -> str:
    return (
        f"{material.name} ({material.density:.4g} kg/m³, Young's modulus {material.youngs_modulus / 1e9:.4g} GPa, "
        f"Poisson's ratio {material.poisson_ratio:.3g})"
    )


def _repetitions(outcome: Outcome) -> Iterator[str]:
    experiment, found = outcome.experiment, outcome.measurements
    if found:
        kinds = Counter(kind for item in found for kind in _media_of(experiment, item))
        media = " and ".join(_media(kind, number) for kind, number in kinds.items())
        yield f"{were(len(found), 'repetition')} measured from {media}{_rates(outcome)}{_scales(found)}."
    if outcome.failures:
        names = ", ".join(one.source.name for one in outcome.failures)
        yield f"{were(len(outcome.failures), 'repetition')} not measurable and left out ({names})."
    for file, why in experiment.rejected.items():
        yield f"{file.name} was rejected: {why}."


def _media(kind: str, number: int) -> str:
    return f"{number} {_MEDIA[kind] if number > 1 else _MEDIA[kind].replace('s of', ' of').removesuffix('s')}"


def _media_of(experiment: Experiment, item: Measurement) -> list[str]:
    """The kind of each medium of a repetition."""
    views = next((views for views in experiment.repetitions if views[0] == item.source), (item.source,))
    if item.table:
        return ["table"] * len(views)
    photo = entry_of(experiment).is_photo(item.source)
    return ["sound" if view.suffix.lower() in SOUNDS else "photo" if photo else "film" for view in views]


def _views(found: Iterable[Measurement]) -> Iterator[Mapping[str, Any]]:
    for item in found:
        yield from item.camera.get("views") or [item.camera]


def _rates(outcome: Outcome) -> str:
    rates = sorted(
        {round(float(view["frame_rate_hz"]), 3) for view in _views(outcome.measurements) if view.get("frame_rate_hz")}
    )
    if not rates:
        return ""
    own = "" if outcome.experiment.camera.frame_rate is not None else " (the rate of the file)"
    return f" at {listed(f'{rate:.6g}' for rate in rates)} Hz{own}"


def _scales(found: Sequence[Measurement]) -> str:
    scales = [1e3 * float(view["scale_m_per_px"]) for view in _views(found) if view.get("scale_m_per_px")]
    if not scales:
        return ""
    low, high = f"{min(scales):.4g}", f"{max(scales):.4g}"
    size = low if low == high else f"{low} to {high}"
    sources = sorted({str(view["scale_from"]) for view in _views(found) if view.get("scale_from")})
    return f", {size} mm/px{f' (from {listed(sources)})' if sources else ''}"


def _stated(experiment: Experiment) -> Iterator[str]:
    if experiment.measured:
        names = listed(
            f"{title(one.quantity).lower()} {reading(one.value, one.std_uncertainty, one.unit)} (n = {one.n})"
            for one in experiment.measured
        )
        yield f"Stated as measured by other means: {names}."


# ------------------------------------------------------------------------------------------------------- measurement


def _measurement(comparison: Comparison, versions: Mapping[str, str]) -> str:
    found = [(outcome, item) for outcome in comparison.outcomes for item in outcome.measurements]
    if not comparison.deviations:
        return ""
    kinds = {kind for outcome, item in found for kind in _media_of(outcome.experiment, item)}
    with_opencv = (
        f", on OpenCV {versions.get('opencv-python-headless', '')} [@bradski2000]" if kinds & {"film", "photo"} else ""
    )
    rows = headlines(comparison.deviations)
    results: dict[str, list[str]] = {}
    for row in rows:
        results.setdefault(_of_rig(row), []).append(row.method)
    named = "; ".join(f"{name} ({', '.join(dict.fromkeys(ways))})" for name, ways in results.items())
    parts = sorted({name for row in comparison.deviations for name in row.budget})
    text = [
        f"The {listed(_MEDIA[kind] for kind in _MEDIA if kind in kinds)} were measured with rigtwin "
        f"{versions[SOFTWARE]} [@{SOFTWARE}]{with_opencv}."
        if kinds
        else "",
        f"Main results and their methods: {named}." if named else "",
        "Each value has a standard uncertainty with a budget of named parts [@jcgm100]"
        + (f"; here: {'; '.join(part.replace('_', ' ') for part in parts)}." if parts else "."),
        "Every ± is one standard uncertainty. The variance of a mean of n repetitions is max(s, u)²/n plus the squares "
        "of the parts that all repetitions share, such as the scale, with the sample standard deviation s of the "
        "repetitions and the root mean square u of their own random parts. Values that failed a check are doubtful and "
        "left out of a mean that has others.",
        *_priors(comparison),
    ]
    return " ".join(filter(None, text))


def _of_rig(row: Deviation) -> str:
    """The quantity and its rig: an angle of repose of a heap is not that of a drum."""
    return f"{title(row.quantity).lower()} of a {row.rig}"


def _priors(comparison: Comparison) -> Iterator[str]:
    """What was known beforehand of the scatter, for the results in whose uncertainty it counts."""
    known: dict[str, None] = {}
    published = False
    experiments = {outcome.experiment.id: outcome.experiment for outcome in comparison.outcomes}
    for row in headlines(comparison.deviations):
        if row.scatter is None:
            continue
        prior = known_scatter(experiments[row.experiment], row.quantity)
        published = published or prior.source.startswith(hlosta2020.CITATION)
        freedom = "known exactly" if math.isinf(prior.freedom) else f"{prior.freedom:.2g} degrees of freedom"
        where = prior.source.removeprefix(hlosta2020.CITATION).strip(", ")
        known[f"{_of_rig(row)} {100 * prior.relative:.2g} % ({freedom}; {where})"] = None
    if not known:
        return
    yield (
        "The relative standard deviation from repetition to repetition has a scaled inverse chi-squared prior "
        f"[@gelman2013]: {'; '.join(known)}."
        + (" Scatter from tables is that of published repetitions [@hlosta2020; @smyth2004]." if published else "")
        + " With it s² becomes (d₀ s₀² + (n − 1) s²)/(d₀ + n − 1), s₀ and d₀ being standard deviation and degrees of "
        "freedom of the prior."
    )


# -------------------------------------------------------------------------------------------------------- simulation


def _simulation(comparison: Comparison) -> str:
    twins = [(outcome, runs) for outcome in comparison.outcomes if (runs := _run(outcome))]
    own = [run for _, runs in twins for run in runs if not _other_code(run)]
    effects = comparison.lab.model.effects
    parts = [" ".join(_laws(own))] if own else []
    parts += [_twin(outcome, runs, effects) for outcome, runs in twins]
    without = [f"`{one.experiment.id}` ({one.without_twin})" for one in comparison.outcomes if one.without_twin]
    if without:
        parts.append(f"Without a twin: {'; '.join(without)}.")
    parts += _acting(own, effects)
    return "\n\n".join(parts)


def _run(outcome: Outcome) -> list[Twin]:
    """The runs of the twin that are compared."""
    return [] if outcome.without_twin else [twin for twin in outcome.twins if not twin.failed]


def _other_code(twin: Twin) -> str:
    return str(twin.settings.get("engine", {}).get("computed_by", ""))


def _laws(twins: Sequence[Twin]) -> Iterator[str]:
    """The laws that the twins have in common."""
    devices = listed(sorted({str(twin.settings["engine"]["device"]).upper() for twin in twins}))
    yield (
        f"The twins are simulated by the discrete element method [@cundall1979] in rigtwin [@{SOFTWARE}], written in "
        f"Taichi [@hu2019], on the {devices}; gravity is {GRAVITY:g} m/s²."
    )
    laws = {numerics.get("contact_law", "") for numerics in map(_numerics, twins)} - {""}
    if "Hertz-Mindlin" in laws:
        yield (
            "Contacts follow Hertz's law with a tangential spring after Mindlin, stored from the beginning of the "
            "contact and limited by Coulomb friction [@mindlin1953; @hlosta2020]."
        )
    for law in sorted(laws - {"Hertz-Mindlin"}):
        yield f"Contact law: {law}."
    yield (
        "The damping of a contact, which allows no tension, is the one that gives the stated restitution at any impact "
        "speed [@schwager2007; @antypov2011]."
    )
    for rolling in sorted({numerics.get("rolling_resistance", "") for numerics in map(_numerics, twins)} - {""}):
        yield f"Rolling resistance: {_symbols(rolling)} [@ai2011; @hlosta2020]."


def _symbols(words: str) -> str:
    return words.replace("mu_r Fn R", "μᵣ Fₙ R")


def _numerics(twin: Twin) -> Mapping[str, str]:
    found: Mapping[str, str] = twin.settings.get("numerics", {})
    return found


def _twin(outcome: Outcome, runs: Sequence[Twin], effects: Mapping[str, Any]) -> str:
    first = runs[0]
    name, settings = outcome.experiment.id, first.settings
    contacts = "; ".join(
        f"{pair} {_coefficients(outcome.experiment, contact)}" for pair, contact in settings["contacts"].items()
    )
    by = f", computed by {_other_code(first)}" if _other_code(first) else ""
    said = [f"Twin of `{name}`{by}: {_size(outcome, runs)}contacts {contacts}"]
    numerics = _numerics(first)
    if stiffness := numerics.get("stiffness_factor"):
        said.append(f"stiffness factor: {stiffness}")
    step = settings.get("statistics", {}).get("time_step_s")
    if step or "time_step" in numerics:
        size = f"{1e6 * step:.4g} µs" if step else ""
        said.append("time step: " + ", ".join(filter(None, (size, numerics.get("time_step", "").replace("um", "µm")))))
    if "effects" in numerics:
        said.append(f"effects: {numerics['effects']}")
    starts = [_start(first, quantity, source) for quantity, source in first.set_from.items()]
    if starts:
        said.append(f"started from the {listed(starts)}")
    if outcome.from_media:
        said.append(f"taken from the media: {outcome.from_media}")
    return "; ".join([*said, *_taken(first, outcome.from_media)]) + "."


def _start(twin: Twin, quantity: str, source: str) -> str:
    """A quantity that is an input of the twin, with its value there."""
    value = twin.settings["rig"].get(quantity)  # in SI
    words = "" if value is None else f", {reading(value, 0.0, 'rad' if quantity.endswith('angle') else 'm')}"
    return f"{title(quantity).lower()} as {'measured (the mean)' if source == 'measured' else 'stated'}{words}"


def _taken(twin: Twin, from_media: str) -> Iterator[str]:
    """What else the twin assumes; its numerical settings and what it takes from the media are stated before."""
    for line in twin.assumptions:
        name, colon, origin = line.partition(": ")
        numerical = colon and name.replace(" ", "_") in (*NUMERICS, "computed_by")
        stated = origin.rstrip(".").endswith("(as given)")
        if not (numerical or (stated and re.search(rf"\b{re.escape(name.lower())}\b", from_media))):
            yield line[:1].lower() + line[1:].rstrip(".")


def _coefficients(experiment: Experiment, contact: Mapping[str, float]) -> str:
    needed = entry_of(experiment).needed(experiment)
    return ", ".join(f"{name.replace('_', ' ')} {contact[name]:.4g}" for name in needed)


def _size(outcome: Outcome, runs: Sequence[Twin]) -> str:
    """Runs, seeds and particles of a twin of many particles."""
    if not entry_of(outcome.experiment).many_particles:
        seed = runs[0].settings.get("seed")
        return "" if seed is None else f"seed {seed}; "
    seeds = [str(run.settings.get("seed")) for run in runs]
    number = listed(dict.fromkeys(str(_particles(run)) for run in runs))
    s = "s" if len(runs) > 1 else ""
    failed = [f"seed {one.settings.get('seed')} failed ({one.failed})" for one in outcome.twins if one.failed]
    left = f", {listed(failed)} and left out" if failed else ""
    return f"{len(runs)} run{s} (seed{s} {listed(seeds)}) of {number} particles{left}; "


def _particles(run: Twin) -> int | str:
    return next((run.settings[key] for key in ("placed", "count", "asked") if key in run.settings), "?")


def _acting(twins: Sequence[Twin], effects: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """The effects that act in a twin, with their parameters and sources."""
    from rigtwin.sim.effects import named

    names = {name for twin in twins for name in _numerics(twin).get("effects", "").split(", ") if name}
    for name, values in effects.items():
        if name.replace("_", " ") not in names:
            continue
        effect = named(name)
        numbers = ", ".join(f"{key} = {value:.4g}" for key, value in values.items())
        yield effect_sentence(effect.title, effect.equation, effect.source, f", with {numbers} (SI)" if numbers else "")


# -------------------------------------------------------------------------------------------------------- comparison


def _comparison(comparison: Comparison) -> str:
    compared = [row for row in comparison.deviations if row.z is not None]
    if not compared:
        return ""
    given = any(row.verdict in ("set equal", "differs from the setting") for row in compared)
    text = [
        "Records of experiment and twin are evaluated by the same functions. The deviation is 100 (simulated − "
        "measured) / measured, in percent, and z the difference over its standard uncertainty, with effective degrees "
        "of freedom by equation G.2b of the guide [@jcgm100]. Twin and experiment differ where |z| exceeds the factor "
        f"of Student's t for {100 * SURE:g} %, probably differ where it exceeds that for 95 %, and agree where it does "
        f"not and the deviation with its expanded uncertainty lies within ±{UNINFORMATIVE:g} %; otherwise the result "
        "is inconclusive.",
        "The uncertainty of the twins' parameters is not included.",
        "Quantities that are an input of the twin are not a test of it." if given else "",
        comparison.headline[:1].upper() + comparison.headline[1:],
    ]
    return " ".join(filter(None, text))
