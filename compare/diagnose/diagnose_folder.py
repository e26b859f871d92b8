"""Diagnose the lab in a folder and write diagnosis.json, diagnosis.html with its figures, and model.toml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rigtwin.compare import result_files
from rigtwin.compare.diagnose.bulk.bulk_lab import BulkLab
from rigtwin.compare.diagnose.bulk.bulk_page import bulk_figure, bulk_page
from rigtwin.compare.diagnose.bulk.diagnose_bulk import BulkDiagnosis, diagnose_bulk, not_in_the_model
from rigtwin.compare.diagnose.bulk.from_bulk_toml import bulk_lab_of
from rigtwin.compare.diagnose.bulk.read_bulk_json import is_bulk, read_bulk_lab
from rigtwin.compare.diagnose.data.from_lab_toml import tracked_lab
from rigtwin.compare.diagnose.data.read_lab_json import read_tracked_lab
from rigtwin.compare.diagnose.data.tracked_lab import TrackedLab
from rigtwin.compare.diagnose.diagnosis import Diagnosis, diagnose
from rigtwin.compare.diagnose.diagnosis_methods import LIBRARIES, bulk_methods, methods
from rigtwin.compare.diagnose.figures import figures
from rigtwin.compare.diagnose.fitting.parameter_uncertainty import parameters
from rigtwin.compare.diagnose.page import page
from rigtwin.compare.report.figure_file import figure_files
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.model_file import Model, model_text
from rigtwin.lab.materials import PARAMETERS, KnownContact, Material, Pair, Particle, pair
from rigtwin.lab.progress import Progress, silent
from rigtwin.sim.effects import own_effect
from rigtwin.sim.effects.nameless_terms import PREFIX, form

ASSUMED = {"density_kg_m3": 1000.0, "youngs_modulus_Pa": 1e9, "poissons_ratio": 0.3}
"""Material properties assumed where the lab states none; each assumption is a remark in model.toml."""


def diagnose_folder(
    folder: Path,
    out: Path,
    *,
    own: Sequence[Path] = (),
    only: Sequence[str] = (),
    allow_outside: bool = False,
    store: Path | None = None,
    seed: int = 1,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress = silent,
) -> tuple[Diagnosis | BulkDiagnosis, dict[str, Path]]:
    """Diagnose the lab in a folder and write the result.

    Parameters
    ----------
    folder : Path
        Folder with a lab.json or a lab.toml, or the path of a lab.toml.  A lab.json in the folder takes precedence.
    out : Path
        Folder for diagnosis.json, diagnosis.html, its figures (SVG) with their numbers (CSV), and model.toml.
    own : sequence of Path
        Files with effects of the user, tried beside those of the library.
    only : sequence of str
        Experiments of a lab.toml to diagnose; empty for all.  Not allowed with a lab.json.
    allow_outside : bool
        Whether the lab may name files outside its folder.
    store : Path, optional
        Folder that keeps the twins of a lab with many particles; ``out/runs`` by default.
    seed : int
        First seed of such twins.
    workers : int, optional
        Number of processes for films and for such twins; one for each core by default.
    cluster : str, optional
        A cluster for such twins, as in `rigtwin.compare.campaign.runners.runner`.
    progress : Progress
        Called with step, number and count.

    Returns
    -------
    diagnosis : Diagnosis or BulkDiagnosis
        Verdict, effects, gap and next experiment.
    files : dict of str to Path
        Written files by name.

    Raises
    ------
    BadInput
        If the lab cannot be read or fitted, or `only` is given with a lab.json.
    """
    notebook = folder.suffix == ".toml" or ((folder / "lab.toml").is_file() and not (folder / "lab.json").is_file())
    if only and not notebook:
        raise BadInput(f"{folder}: --only names experiments of a lab.toml; a lab.json is diagnosed whole.")
    with result_files.claimed(out):
        if (bulk := _bulk_lab(folder, notebook, only, allow_outside, out, workers, progress)) is not None:
            if own:
                raise BadInput(f"{own[0]}: an effect of your own is tried in labs of single bodies only; leave it out.")
            return _diagnose_bulk(bulk, out, store or out / "runs", seed, workers, cluster, progress)
        effects = [own_effect(path) for path in own]
        lab = (
            tracked_lab(folder, only, out, progress, allow_outside=allow_outside, workers=workers)
            if notebook
            else read_tracked_lab(folder, allow_outside=allow_outside)
        )
        _need_own_folder(out, lab)
        diagnosis = diagnose(lab, effects, progress)
        model, drawn = model_of(diagnosis), figures(diagnosis)
        remarks = [f"left out: {reason}" for reason in _not_carried(diagnosis).values()] + _assumed(diagnosis.lab)
        text = methods(diagnosis, result_files.versions(LIBRARIES))
        contents = {
            "diagnosis.json": result_files.document(diagnosis.to_json()),
            "diagnosis.html": page(diagnosis, drawn, text),
            **text.files("diagnosis"),
            "model.toml": "".join(f"# {remark}\n" for remark in remarks) + model_text(model),
            **figure_files("diagnosis", drawn.values()),
        }
        return diagnosis, result_files.write_together(out, contents)


def _need_own_folder(out: Path, lab: TrackedLab | BulkLab) -> None:
    """Refuse a folder with a diagnosis of other experiments, before the fits or twins."""
    result_files.others_before(out, "diagnosis.json", lab.folder, [one.name for one in lab.conditions])


def _bulk_lab(
    folder: Path, notebook: bool, only: Sequence[str], allow_outside: bool, out: Path, workers: int | None,
    progress: Progress,
) -> BulkLab | None:  # fmt: skip
    """The lab where its rigs hold many particles."""
    if notebook:
        return bulk_lab_of(folder, only, out, progress, allow_outside=allow_outside, workers=workers)
    return read_bulk_lab(folder, allow_outside=allow_outside) if is_bulk(folder) else None


def _diagnose_bulk(
    lab: BulkLab, out: Path, store: Path, seed: int, workers: int | None, cluster: str | None, progress: Progress
) -> tuple[BulkDiagnosis, dict[str, Path]]:
    _need_own_folder(out, lab)
    found = diagnose_bulk(lab, store, progress, seed=seed, workers=workers, cluster=cluster)
    drawn = bulk_figure(found)
    remarks = [f"left out: {reason}" for reason in not_in_the_model(found)]
    text = bulk_methods(found, result_files.versions(LIBRARIES))
    contents = {
        "diagnosis.json": result_files.document(found.to_json()),
        "diagnosis.html": bulk_page(found, drawn, text),
        **text.files("diagnosis"),
        "model.toml": "".join(f"# {remark}\n" for remark in remarks) + model_text(found.model),
        **figure_files("diagnosis", [drawn]),
    }
    return found, result_files.write_together(out, contents)


def model_of(diagnosis: Diagnosis) -> Model:
    """Return the model of the lab: its materials and beads, the fitted contacts and the named effects.

    Parameters
    ----------
    diagnosis : Diagnosis
        Diagnosis with the fitted contacts.

    Returns
    -------
    Model
        Model as it is written to model.toml.
    """
    lab = diagnosis.lab
    materials: dict[str, Material] = {}
    particles: dict[str, Particle] = {}
    for condition in lab.conditions:
        bead = condition.bead
        solid = _material(f"{bead.about.get('material') or 'material'} of {bead.name}", bead.about)
        materials[solid.name] = solid
        particles[bead.name] = Particle(bead.name, solid, bead.diameter, bead.density)
        about = (lab.stated.get("walls") or {}).get(condition.wall)
        if isinstance(about, dict):
            materials[condition.wall] = _material(condition.wall, about)
    return Model(materials, particles, _contacts(diagnosis), _named(diagnosis))


def _material(name: str, about: Mapping[str, object]) -> Material:
    return Material(name, *(_known(about, key, default) for key, default in ASSUMED.items()))


def _known(about: Mapping[str, object], key: str, default: float) -> float:
    value = about.get(key)
    return float(value) if isinstance(value, (int, float)) else default


def _assumed(lab: TrackedLab) -> list[str]:
    """One sentence for each property that the model assumes because the lab does not state it."""
    walls = lab.stated.get("walls") or {}
    stated = {condition.bead.name: condition.bead.about for condition in lab.conditions}
    stated |= {condition.wall: walls[condition.wall] for condition in lab.conditions if condition.wall in walls}
    return [
        f"assumed, because the lab does not state it for {name}: {key} = {default:g}"
        for name, about in stated.items()
        for key, default in ASSUMED.items()
        if key not in about and not (key == "density_kg_m3" and ("mass_g" in about or "mass_kg" in about))
    ]


def _contacts(diagnosis: Diagnosis) -> dict[Pair, KnownContact]:
    if diagnosis.naming is None:
        return {}
    fitted = diagnosis.chosen.fitted if diagnosis.chosen else diagnosis.naming.base
    known = {unknown.name: value for unknown, value in zip(fitted.unknowns, fitted.values, strict=True)}
    if hasattr(diagnosis.bench, "restitutions"):
        known |= {f"restitution.{name}": value for name, value in diagnosis.bench.restitutions(known).items()}
    found: dict[Pair, KnownContact] = {}
    for condition in diagnosis.lab.conditions:
        bead, other = condition.bead.name, condition.wall or condition.bead.name
        fits = {name: float(known[key]) for name in PARAMETERS if (key := f"{name}.{bead}-{other}") in known}
        if "restitution" in fits:  # noise can move a fitted value out of the valid range
            fits["restitution"] = min(max(fits["restitution"], 0.01), 1.0)
        if fits:
            found[pair(bead, other)] = KnownContact(**fits)
    return found


def _named(diagnosis: Diagnosis) -> dict[str, dict[str, float]]:
    if diagnosis.chosen is None:
        return {}
    left_out = _not_carried(diagnosis)
    return {
        term.name: {
            name: float(one["value"])
            for name, one in parameters(diagnosis.lab, diagnosis.chosen.fitted, (term,)).items()
        }
        for term in diagnosis.chosen.terms
        if term.name not in left_out
    }


def _not_carried(diagnosis: Diagnosis) -> dict[str, str]:
    """Formulas that the simulation does not support yet, with the reason; model.toml omits them to stay readable."""
    reasons = {}
    for term in diagnosis.chosen.terms if diagnosis.chosen else ():
        if term.name.startswith(PREFIX):
            try:
                form(term.name)
            except BadInput as problem:
                reasons[term.name] = str(problem)
    return reasons
