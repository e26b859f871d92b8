"""The methods text states the numbers of its run, and cites what its models are from."""

import re
from dataclasses import replace

import pytest

from rigtwin.compare.report.methods import methods
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.materials import Particle, sized
from rigtwin.lab.reference.bibliography import bibtex, cited, references
from rigtwin.lab.size_distributions import uniform
from rigtwin.lab.version import __version__
from rigtwin.sim.effects import library

VERSIONS = {"rigtwin": __version__, "python": "3.12.9", "taichi": "1.7.4", "opencv-python-headless": "5.0.0.93"}
OTHER = {
    "diameter_mm": 12.2, "mass_g": 0.69, "drop_mm": 301.0, "base_mm": 140.0, "rate_hz": 1000.0, "scale_mm": 0.0913,
    "films": 5, "photos": 2, "wall_restitution": 0.61, "static": 0.27, "rolling": 0.013, "modulus_gpa": 3.1,
    "count": 2750, "seeds": (11, 12, 13), "step_us": 8.25, "law": "type A",
    "scatter": 'scatter = { restitution_wall = "3.3 % (n = 21)" }',
}  # fmt: skip


def stated(numbers) -> dict[str, str]:
    """What the text must say, by the number that it is about."""
    return {
        "diameter": f"sphere of {numbers.diameter_mm:g} mm",
        "mass": f"{numbers.mass_g:.3g} g",
        "drop height": f"drop height {numbers.drop_mm:g} mm",
        "base": f"base {numbers.base_mm:g} mm",
        "repetitions": f"{numbers.films} repetitions were measured from {numbers.films} films",
        "photos": f"1 repetition was measured from {numbers.photos} photos",
        "frame rate": f"at {numbers.rate_hz:g} Hz",
        "scale": f"{numbers.scale_mm:g} mm/px (from known length)",
        "left out": f"1 repetition was not measurable and left out (r{numbers.films:02d}.mp4)",
        "modulus": f"Young's modulus {numbers.modulus_gpa:g} GPa",
        "contact": f"bead-steel restitution {numbers.wall_restitution:g}, static friction {numbers.static:g}, "
        f"rolling friction {numbers.rolling:g}",
        "particles": f"of {numbers.count} particles",
        "runs": f"{len(numbers.seeds)} runs",
        "seeds": f"{numbers.seeds[-2]} and {numbers.seeds[-1]})",
        "time step": f"time step: {numbers.step_us:g} µs, 30% of Rayleigh's",
        "law": f"Rolling resistance: {numbers.law}, torque limit μᵣ Fₙ R",
    }


@pytest.mark.parametrize(("mine", "other"), [({}, OTHER), (OTHER, {})])
def test_the_text_has_the_numbers_of_its_lab_and_none_of_another(comparison, numbers, mine, other):
    text = methods(comparison(numbers(**mine)), VERSIONS).markdown
    wrong = stated(numbers(**other))
    for what, words in stated(numbers(**mine)).items():
        assert words in text, what
        assert wrong[what] not in text, what
    assert "9999" not in text, "particles that were asked for, not those that were placed"
    assert "GPa, Poisson's ratio 0.44" in text
    assert "outlet diameter: 22.5 mm" in text
    assert text.count("Hertz-Mindlin") == 0, "the law is described, and not among what is assumed"
    for version in VERSIONS.values():
        assert version in text


def test_the_scatter_is_the_published_one_unless_the_lab_states_its_own(comparison, numbers):
    published, own = (methods(comparison(numbers(**one)), VERSIONS).markdown for one in ({}, OTHER))
    # docs/verdicts.md lists the published ones
    assert "restitution on the wall of a drop 4.4 % (1.7 degrees of freedom; table 11)" in published
    assert "restitution on the wall of a drop 3.3 % (20 degrees of freedom; " in own
    for text in (published, own):
        assert "angle of repose, geometric of a pile 2.8 % (3 degrees of freedom; table 15)" in text


def test_every_citation_is_in_the_list_and_in_the_bib_file_and_nothing_else(comparison):
    text = methods(comparison(), VERSIONS)
    prose = "\n".join(paragraph for _, paragraph in text.paragraphs)
    keys = set(re.findall(r"@(\w+)", prose))
    assert keys == {one.key for one in text.cited} == set(re.findall(r"^@\w+\{(\w+),$", text.bibtex, re.MULTILINE))
    assert {"rigtwin", "hlosta2020", "jcgm100", "ai2011", "bradski2000"} <= keys
    assert f"version = {{{__version__}}}" in text.bibtex
    assert text.bibtex.count("{") == text.bibtex.count("}")
    html = "".join(part for _, parts in text.html for part in parts)
    assert "@" not in html
    assert '<a href="#ref-ai2011">Ai et al. 2011</a>' in html


def test_what_was_not_done_is_not_described(comparison):
    whole = comparison()
    fall, heap = whole.outcomes
    alone = replace(heap, without_twin="the restitution of the contact bead-bead is not known", twins=())
    text = methods(replace(whole, outcomes=(fall, alone)), VERSIONS).markdown
    assert "Rolling resistance" not in text
    assert "ai2011" not in text
    assert "seed" not in text
    assert "Without a twin: `heap` (the restitution of the contact bead-bead is not known)." in text
    measured = tuple(replace(one, without_twin="it failed", twins=()) for one in whole.outcomes)
    text = methods(replace(whole, outcomes=measured), VERSIONS).markdown
    assert "Without a twin: `fall` (it failed)" in text
    assert "hu2019" not in text


def test_what_a_twin_takes_from_the_media_is_stated(comparison):
    whole = comparison()
    fall, heap = whole.outcomes
    assert "from the media" not in methods(whole, VERSIONS).markdown
    seen = replace(whole, outcomes=(fall, replace(heap, from_media="1300 particles, to the edge of its base")))
    text = methods(seen, VERSIONS).markdown
    assert "; taken from the media: 1300 particles, to the edge of its base; " in text.partition("Twin of `heap`")[2]
    base = entry_of(heap.experiment).stated(heap.experiment)[0]
    assert f"stated: base {base.text}" in text, "a setting stays, whatever words the other text has"


def test_a_setting_is_left_out_only_where_the_media_have_its_whole_name(comparison):
    whole = comparison()
    fall, heap = whole.outcomes
    given = tuple(
        replace(twin, assumptions=("count: 1300 (as given).", "Fill: rain (as given).")) for twin in heap.twins
    )
    seen = replace(heap, twins=given, from_media="count 1300, filling to the rim")
    text = methods(replace(whole, outcomes=(fall, seen)), VERSIONS).markdown.partition("Twin of `heap`")[2]
    assert "count: 1300" not in text
    assert "; fill: rain (as given)." in text


def test_a_run_that_failed_is_stated_with_its_reason(comparison):
    whole = comparison()
    fall, heap = whole.outcomes
    lost = replace(heap.twins[0], failed="79 of 1000 particles stayed")
    some = replace(whole, outcomes=(fall, replace(heap, twins=(*heap.twins, lost))))
    assert "failed (79 of 1000 particles stayed) and left out" in methods(some, VERSIONS).markdown


def test_effects_of_the_model_are_described_where_they_act(comparison):
    whole = comparison()
    model = replace(whole.lab.model, effects={"air_drag": {"drag_coefficient": 0.47}, "ageing": {}})
    (fall, heap) = whole.outcomes
    (twin,) = fall.twins
    acting = replace(twin, settings={**twin.settings, "numerics": {**twin.settings["numerics"], "effects": "air drag"}})
    found = replace(whole, lab=replace(whole.lab, model=model), outcomes=(replace(fall, twins=(acting,)), heap))
    text = methods(found, VERSIONS).markdown
    assert "drag_coefficient = 0.47 (SI)" in text
    assert "[@newton1687; @clift1978]" in text
    assert "dieterich1979" not in text, "it acts in no twin"


def test_names_of_the_lab_are_text_in_the_page(comparison):
    text = methods(comparison(title="<b> [@nobody2020; @jcgm] `x`"), VERSIONS)
    html = "".join(part for _, parts in text.html for part in parts)
    assert "<b>" not in html
    assert "&lt;b&gt; [@nobody2020; @jcgm]" in html


def test_sizes_and_clumps_are_in_words(comparison):
    whole = comparison()
    fall = whole.outcomes[0]
    bead: Particle = sized(fall.experiment.particle, uniform(5e-3, 6.2e-3))
    mixed = replace(fall, experiment=replace(fall.experiment, particle=bead))
    text = methods(replace(whole, outcomes=(mixed,)), VERSIONS).markdown
    median = ((5**4 + 6.2**4) / 2) ** (1 / 4)
    assert f"spheres of different sizes (uniform from 5 mm to 6.2 mm; median by mass {median:.4g} mm)" in text
    assert f"mean {1e3 * bead.mean_mass:.3g} g" in text


def test_every_source_of_an_effect_with_a_year_is_in_the_bibliography():
    for effect in library():
        for part in effect.source.split(";"):
            if re.search(r"\b(1[6-9]|20)\d\d\b", part):
                (key,) = cited(part)
                assert references()[key].fields["year"] in part, effect.name


def test_every_reference_has_what_its_kind_of_bibtex_needs():
    needed = {"article": {"journal", "volume"}, "book": {"publisher"}, "techreport": {"institution"}}
    for key, one in references().items():
        kind = one.bibtex[1 : one.bibtex.index("{")]
        assert {"author", "title", "year"} | needed.get(kind, set()) <= set(one.fields), key
        assert key == "jcgm100" or key.endswith(one.fields["year"]) or key == "rigtwin"
        assert not set(one.fields) & {""}
        assert f"({one.fields['year']})" in one.in_words
    assert bibtex(["zener1941", "zener1941"]).count("@article") == 1
