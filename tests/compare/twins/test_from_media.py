"""What a twin takes from the media, what it assumes, and when it has failed."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigtwin.compare.twins.many_body import Cast, filling_count
from rigtwin.compare.twins.pile import pile_twin
from rigtwin.compare.twins.registry import entry_of
from rigtwin.lab.camera import Camera
from rigtwin.lab.drum_flow import fill_check
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_file import Experiment
from rigtwin.lab.materials import Contact
from rigtwin.lab.quantity import Measurement
from rigtwin.lab.records import Profile, Series
from rigtwin.lab.reference import hlosta2020
from rigtwin.lab.rigs import DrumSettings, HopperSettings, PackingSettings, Pile, PileSettings, TiltSettings

BEAD, STEEL = hlosta2020.particle("D6"), hlosta2020.material("steel")


def experiment(settings):
    return Experiment("one", settings, BEAD, STEEL, Camera(), ((Path("clip.mp4"),),))


def media(**records):
    return Measurement("rig", Path("clip.mp4"), "0" * 64, (), **records)


def completed(settings, *measurements):
    one = experiment(settings)
    filled, said = entry_of(one).completed(one, measurements)
    return filled.rig, said, entry_of(one).assumed(filled, None)


def test_a_drum_is_filled_as_the_films_show_unless_it_is_stated():
    films = [media(checks=(fill_check(share, "the bed fills"),)) for share in (0.22, 0.24)]
    drum = DrumSettings(0.1, 0.6)
    filled, said, assumed = completed(drum, *films)
    assert filled.fill == pytest.approx(0.23)
    assert (said, assumed) == ("a fill of 0.23", ["a depth of 50 mm"])
    for stated in (replace(drum, fill=0.4), replace(drum, count=900, depth=0.05)):
        assert completed(stated, *films)[0] == stated
    filled, said, assumed = completed(replace(drum, count=360), *films)
    assert filled.depth * 0.23 * math.pi / 4 * 0.1**2 * 0.6 == pytest.approx(360 * BEAD.volume)
    assert "a fill of 0.23, for which 360 particles need a depth of" in said
    assert "at a volume fraction of 0.6 (state depth" in said
    assert not assumed
    # a single layer between the walls holds about 0.53 of its volume
    layer = round(0.53 * 0.23 * math.pi / 4 * 0.1**2 * 1.04 * BEAD.diameter / BEAD.volume)
    one = experiment(completed(replace(drum, count=layer), *films)[0])
    assert one.rig.depth == pytest.approx(BEAD.diameter, rel=0.05)
    entry_of(one).check_count(one, layer)
    rig, said, assumed = completed(drum, media())
    assert (rig, said, assumed) == (drum, "", ["a depth of 50 mm", "a fill of 0.35"])


def test_a_plate_is_tilted_as_fast_as_in_the_film():
    time = np.linspace(0, 10, 400)
    angle = Series(time, np.radians(np.clip(3 * (time - 1), 0, 24)), "plate_angle", "rad")
    rig, said, assumed = completed(TiltSettings("slide"), media(series=(angle,)))
    assert math.degrees(rig.speed) == pytest.approx(3, rel=0.02)
    assert ("3 degrees per second" in said, assumed) == (True, [])
    stated = TiltSettings("slide", speed=0.02)
    assert completed(stated, media(series=(angle,)))[0] == stated
    assert completed(TiltSettings("slide"), media())[2] == ["a plate that rises by 1 degree per second"]


def cone(radius, height):
    x = np.linspace(-0.2, 0.2, 801)
    return Profile(x, np.maximum(height * (1 - np.abs(x) / radius), 0), np.zeros(801))


def test_a_heap_has_the_particles_that_its_volume_holds():
    base = PileSettings(0.4)
    rig, said, _ = completed(base, media(profiles=(cone(0.1, 0.05),)))
    within = 0.6 * math.pi / 3 * 0.1**2 * 0.05 / BEAD.volume
    assert rig.count == pytest.approx(within, rel=0.01)
    assert said == f"{rig.count} particles, by the volume of the heap"
    full, said, _ = completed(PileSettings(0.2), media(profiles=(cone(0.1, 0.05),)))
    assert full.count == pytest.approx(2 * within, rel=0.01)
    assert "twice the volume" in said
    small, said, assumed = completed(PileSettings(0.06), media(profiles=(cone(0.03, 0.02),)))
    assert small.count == 1000
    assert "twice the volume of the filmed heap, which reaches the edge of its base, is " in said
    assert said.endswith(" particles, and at least 1000 are poured")
    assert not any("particles" in one for one in assumed)
    assert completed(replace(base, count=500), media(profiles=(cone(0.1, 0.05),)))[0].count == 500


def test_a_number_of_particles_that_no_bench_holds_is_refused_unless_it_is_stated(monkeypatch):
    heap = media(profiles=(cone(0.19, 0.09),))
    assert completed(PileSettings(0.4), heap)[0].count < 100_000
    monkeypatch.setattr("rigtwin.compare.twins.run_cost.MOST_UNSTATED", 5000)
    with pytest.raises(
        BadInput, match=r"^base_diameter: .* second on one core, by the volume of the heap on a base of 400 mm"
    ):
        completed(PileSettings(0.4), heap)
    assert completed(PileSettings(0.4, count=9000), heap)[0].count == 9000
    with pytest.raises(
        BadInput, match=r"^total_mass: .* by the stated mass over .* state count \(--count\) to run so many"
    ):
        filling_count(PackingSettings(0.1, total_mass=6000 * BEAD.mean_mass), BEAD, None)
    assert filling_count(PackingSettings(0.1, count=6000), BEAD, None) == 6000
    wide = experiment(DrumSettings(1.0, 0.6, depth=0.05))
    with pytest.raises(BadInput, match=r"^drum_diameter: .* by the filling of a drum of 1000 mm"):
        entry_of(wide).check_count(wide, None)
    entry_of(wide).check_count(wide, 6000)


def test_a_hopper_names_what_it_assumes():
    _, said, assumed = completed(HopperSettings("slot", outlet=0.03), media())
    assert (said, assumed) == ("", ["a bin 150 mm wide", "a slot 68 mm long", "walls at 60 degrees"])
    stated = HopperSettings("slot", 0.1, 0.06, 0.03, inclination=1.0)
    assert completed(stated, media())[2] == []


def test_a_heap_that_rolled_off_its_base_has_failed_and_says_what_to_change():
    slippery, contact = Contact(0.4, 0.3, 0.0), Contact(0.4, 0.3, 0.05)
    with pytest.raises(BadInput, match=r"^0 of 150 particles are on the base.*give a rim_height"):
        pile_twin(Pile(0.06), Cast(BEAD, STEEL, slippery, slippery), count=150, seed=1, threads=1)
    twin = pile_twin(Pile(0.06), Cast(BEAD, STEEL, contact, contact), count=150, seed=1, threads=1)
    assert twin.settings["fallen"] > 75
    assert "particles are on the base, and one layer has about" in twin.failed
    assert twin.failed.endswith("give a rim_height, or contacts with more rolling_friction")
    rimmed = pile_twin(Pile(0.06, 0.006), Cast(BEAD, STEEL, contact, contact), count=150, seed=1, threads=1)
    assert rimmed.failed == ""


HEAP = """\
[[experiments]]
id = "heap"
rig = "pile"
variant = "piling"
particle = "D6"
wall = "steel"
base_diameter = "400 mm"
repetitions = ["heap.csv"]
"""


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("count", [None, 700])
def test_a_calibration_takes_the_same_from_the_media_and_says_so(tmp_path, monkeypatch, count):
    from rigtwin.compare.campaign import calibrate as subject

    asked = {}
    monkeypatch.setattr(subject, "calibrate_lab", lambda lab, *_, **given: asked.update(given, lab=lab))
    x = np.linspace(-0.12, 0.12, 200)
    rows = [f"{a:.5f},{max(0.05 * (1 - abs(a) / 0.1), 0):.5f}" for a in x]
    (tmp_path / "heap.csv").write_text("\n".join(["x_m,height_m", *rows]))
    (tmp_path / "lab.toml").write_text(HEAP)
    subject.calibrate(tmp_path, tmp_path / "out", count=count)
    (heap,) = asked["lab"].experiments
    seen = round(0.6 * math.pi / 3 * 0.1**2 * 0.05 / BEAD.volume)
    if count is None:
        assert heap.rig.count == pytest.approx(seen, rel=0.01)
        assert asked["remarks"] == [
            f"heap: its twins take from the media {heap.rig.count} particles, by the volume of the heap"
        ]
    else:
        assert (heap.rig.count, asked["remarks"]) == (None, [])
