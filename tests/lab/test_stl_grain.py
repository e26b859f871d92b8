"""A clump in place of an STL body: mass properties against closed forms, its distance against points on the body."""

import re
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from rigtwin.lab import stl, stl_grain
from rigtwin.lab.clumps import mass_properties
from rigtwin.lab.errors import BadInput
from rigtwin.lab.stl_grain import filled, filled_file, read_stl

MM = 1e-3
SIDES = (8.0, 6.0, 4.0)


def box(*, away: bool = False) -> trimesh.Trimesh:
    """A box in millimetres, turned and moved with `away`."""
    mesh = trimesh.creation.box(SIDES)
    if away:
        mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
        mesh.apply_translation([300.0, -40.0, 70.0])
    return mesh


def ellipsoid(a: float = 3.0, b: float = 2.2, c: float = 1.8) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.vertices = mesh.vertices * [a, b, c]
    return mesh


def in_metres(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    mesh.vertices = mesh.vertices * MM
    return mesh


def test_mass_properties_are_those_of_the_body_and_not_of_the_spheres(tmp_path):
    box(away=True).export(tmp_path / "box.stl")
    clump = filled_file(tmp_path / "box.stl", MM, spheres=10).clump
    a, b, c = (side * MM for side in SIDES)
    assert clump.volume == pytest.approx(a * b * c, rel=1e-6)
    wanted = [(b * b + c * c) / 12, (a * a + c * c) / 12, (a * a + b * b) / 12]
    assert sorted(clump.gyration) == pytest.approx(wanted, rel=1e-5)
    # the spheres have turned with the body: the moment about an axis is least where the side along it is longest
    along = np.array([a, b, c])[np.argsort(np.argsort(clump.gyration))]
    assert (np.abs(np.array(clump.offsets)) < along / 2).all()


@pytest.mark.parametrize("mesh", [box(), ellipsoid(), trimesh.creation.torus(5.0, 2.0)], ids=["box", "egg", "ring"])
@pytest.mark.parametrize("asked", [{"spheres": 12}, {"error": 0.35 * MM}], ids=["number", "error"])
def test_no_point_of_the_body_is_farther_from_the_clump_than_stated(mesh, asked):
    body = in_metres(mesh.copy())
    found = filled(body, **asked)
    if "error" in asked:
        assert found.error <= asked["error"]
    else:
        assert len(found.clump.radii) <= asked["spheres"]
    # back from the principal axes to those of the body, in which each of these bodies has its own
    centres, radii = np.array(found.clump.offsets), np.array(found.clump.radii)
    points = trimesh.sample.sample_surface(body, 20_000, seed=5)[0]
    gap = (np.linalg.norm(points[:, None] - centres, axis=2) - radii).min(axis=1)
    assert gap.max() <= found.error
    assert gap.max() > 0.5 * (found.error - found.enlarged)  # the bound is no loose one
    # each sphere reaches out of the body by the same small amount: its distance to the surface is short by that
    depth = np.linalg.norm(points[:, None] - centres, axis=2).min(axis=0)
    assert (radii - depth <= found.enlarged + 1e-9).all()
    assert found.enlarged <= found.error


def test_the_clump_has_the_volume_of_the_body_and_nearly_its_inertia():
    body = in_metres(ellipsoid())
    found = filled(body, spheres=24)
    union = mass_properties(found.clump.offsets, found.clump.radii, accuracy=1e-3)
    assert union.volume == pytest.approx(body.volume, rel=0.01)
    assert found.volume == pytest.approx(union.volume, rel=0.01)
    inertia = np.linalg.eigvalsh(np.array(union.inertia)) / union.volume
    assert inertia == pytest.approx(sorted(found.clump.gyration), rel=0.03)
    assert np.linalg.norm(union.centre) < 0.01 * 3 * MM


def test_more_spheres_come_nearer():
    body = in_metres(box())
    one, some, many = (filled(body, spheres=count) for count in (1, 9, 40))
    assert one.error > some.error > many.error
    assert many.error < 0.6 * one.error
    assert filled(body, spheres=9) == some


def test_a_sphere_is_one_sphere_whatever_its_unit(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=3.0)
    ball.export(tmp_path / "ball.stl")
    (tmp_path / "text.stl").write_text(trimesh.exchange.stl.export_stl_ascii(ball))
    assert read_stl(tmp_path / "text.stl", MM).volume == pytest.approx(read_stl(tmp_path / "ball.stl", MM).volume)
    for path, unit in (("text.stl", MM), ("ball.stl", 0.0254)):
        found = filled_file(tmp_path / path, unit, spheres=20)
        (radius,) = found.clump.radii
        assert radius == pytest.approx(3 * unit, rel=2e-3)
        assert found.clump.gyration == pytest.approx([0.4 * (3 * unit) ** 2] * 3, rel=5e-3)
        assert found.error < 2e-3 * 3 * unit


def test_the_facets_of_a_coarse_ball_are_no_reason_for_more_spheres():
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3 * MM)
    assert len(filled(ball, spheres=24).clump.radii) == 1


def test_a_changed_file_is_read_again(tmp_path):
    path = tmp_path / "grain.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=3.0).export(path)
    first = filled_file(path, MM)
    trimesh.creation.icosphere(subdivisions=2, radius=4.0).export(path)
    assert filled_file(path, MM).clump.volume > 2 * first.clump.volume


def two_bodies() -> trimesh.Trimesh:
    return trimesh.util.concatenate([box(), box(away=True)])


def inward() -> trimesh.Trimesh:
    mesh = box()
    mesh.invert()
    return mesh


def open_box() -> trimesh.Trimesh:
    return trimesh.Trimesh(box().vertices, box().faces[:-1])


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (open_box(), r"not closed \(3 facets at open"),
        (two_bodies(), "2 separate bodies"),
        (inward(), "look inwards"),
        (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "not closed"),
    ],
)
def test_a_body_that_is_none_is_refused(tmp_path, mesh, words):
    mesh.export(tmp_path / "grain.stl")
    with pytest.raises(BadInput, match=words) as refused:
        filled_file(tmp_path / "grain.stl", MM)
    assert str(refused.value).startswith(str(tmp_path / "grain.stl"))


@pytest.mark.parametrize(("spheres", "error"), [(24, None), (None, 2e-3)])
def test_a_body_too_thin_for_so_few_spheres_is_refused(spheres, error):
    ring = in_metres(trimesh.creation.torus(major_radius=10, minor_radius=0.15))
    with pytest.raises(BadInput, match="so thin that"):
        filled(ring, spheres=spheres, error=error)


def test_a_sheet_is_no_grain():
    sheet = trimesh.creation.cylinder(radius=20.0, height=0.2)
    sheet.vertices = sheet.vertices + np.column_stack([np.zeros((len(sheet.vertices), 2)), sheet.vertices[:, 0] * 20])
    with pytest.raises(BadInput, match="give a solid grain"):
        filled(sheet, spheres=3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "STL"),
        (b"solid nothing\nendsolid nothing\n", "STL"),
        (b"not a mesh at all", "STL"),
        (b"\x00" * 80 + b"\xff\xff\xff\xff" + b"\x00" * 50, "cut off"),  # claims four billion facets
        (b"\xff\xd8\xff\xe0" + b"\xff" * 200 + b"\x00", r"grain.stl: is a picture \(JPEG\), no STL file"),
    ],
)
def test_what_is_no_stl_is_refused(tmp_path, content, words):
    (tmp_path / "grain.stl").write_bytes(content)
    with pytest.raises(BadInput, match=words):
        read_stl(tmp_path / "grain.stl", MM)
    with pytest.raises(BadInput, match="no such file"):
        read_stl(tmp_path / "other.stl", MM)


def test_more_facets_or_spheres_than_allowed_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "grain.stl"
    box().export(path)
    monkeypatch.setattr(stl_grain, "MOST_SPHERES", 8)
    with pytest.raises(BadInput, match=r"8 spheres come within .* mm of its surface, 0.05 mm are asked"):
        filled_file(path, MM, error=0.05 * MM)
    with pytest.raises(BadInput, match="give 1 to 8"):
        filled_file(path, MM, spheres=9)
    for wrong in ({}, {"spheres": 3, "error": 1e-3}, {"error": -1.0}):
        with pytest.raises(BadInput, match="clump"):
            filled(in_metres(box()), **wrong)
    monkeypatch.setattr(stl, "MOST_FACETS", 11)
    with pytest.raises(BadInput, match="has 12 facets, and at most 11"):
        read_stl(path, MM)


def test_a_text_file_may_have_any_name_and_one_that_is_cut_off_is_named_so(tmp_path):
    text = trimesh.exchange.stl.export_stl_ascii(box())
    named = text.replace("solid ", "solid reduced facet count", 1)
    (tmp_path / "grain.stl").write_text(named)
    assert len(read_stl(tmp_path / "grain.stl", MM).faces) == 12
    start = text.index("facet normal", text.index("endfacet") + 8)
    for cut in (start + 3, start + 8, start + 30, start + 60):
        (tmp_path / "grain.stl").write_text(text[:cut])
        with pytest.raises(BadInput, match="ends within facet 2: it is cut off"):
            read_stl(tmp_path / "grain.stl", MM)


def test_corners_that_are_no_numbers_are_refused(tmp_path):
    text = trimesh.exchange.stl.export_stl_ascii(box())
    for number in ("nan", "inf"):
        spoilt = re.sub(r"vertex \S+", f"vertex {number}", text, count=1)
        assert spoilt != text
        (tmp_path / "grain.stl").write_text(spoilt)
        with pytest.raises(BadInput, match="facet 1 has a corner that is not a finite number"):
            read_stl(tmp_path / "grain.stl", MM)


@pytest.mark.parametrize(("bytes_left", "words"), [(300, "after 4 of its 12 facets"), (84, "after 0 of its 12 facets")])
def test_a_binary_file_that_is_cut_off_is_named_so(tmp_path, bytes_left, words):
    box().export(tmp_path / "whole.stl")
    (tmp_path / "grain.stl").write_bytes((tmp_path / "whole.stl").read_bytes()[:bytes_left])
    with pytest.raises(BadInput, match=f"{words}: it is cut off"):
        read_stl(tmp_path / "grain.stl", MM)


def test_a_text_file_that_is_cut_off_is_named_so(tmp_path):
    text = trimesh.exchange.stl.export_stl_ascii(box())
    (tmp_path / "grain.stl").write_text(text[: text.index("endfacet", 600) - 20])
    with pytest.raises(BadInput, match=r"ends within facet \d+: it is cut off"):
        read_stl(tmp_path / "grain.stl", MM)


def test_bytes_behind_the_last_facet_do_no_harm(tmp_path):
    box().export(tmp_path / "grain.stl")
    with (tmp_path / "grain.stl").open("ab") as file:
        file.write(b"colours of an exporter")
    assert len(read_stl(tmp_path / "grain.stl", MM).faces) == 12


def test_the_reader_of_stl_files_writes_nothing_of_its_own_on_a_damaged_one(tmp_path):
    box(away=True).export(tmp_path / "box.stl", file_type="stl_ascii")
    text = (tmp_path / "box.stl").read_text()
    (tmp_path / "box.stl").write_text(re.sub(r"vertex \S+", "vertex one", text, count=1))
    reading = "from pathlib import Path; from rigtwin.lab.stl_grain import read_stl; read_stl(Path('box.stl'), 1e-3)"
    words = [sys.executable, "-c", reading]
    said = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False).stderr
    assert said.startswith("Traceback")
    assert said.splitlines()[-1].startswith("rigtwin.lab.errors.BadInput: box.stl: cannot be decoded as STL")
