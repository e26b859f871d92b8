"""Tables of other programs are read in SI units, and what was understood is stated."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput, BadQuantity
from rigtwin.lab.tracked.columns import parse_columns, parse_joined
from rigtwin.lab.tracked.read import read_bodies, read_profiles, read_series, scale_used
from rigtwin.lab.tracked.table import TableOptions
from rigtwin.lab.tracked.upright import by_fall, by_swing

# one body at three times: x = 1, 2, 3 mm, y = 50, 40, 20 mm, 0.1 s apart
TIME, X, Y = np.array([0.0, 0.1, 0.2]), np.array([1.0, 2.0, 3.0]) / 1e3, np.array([50.0, 40.0, 20.0]) / 1e3

SAME = {
    "units in brackets": "Time (s),X [mm],Y (mm)\n0,1,50\n0.1,2,40\n0.2,3,20\n",
    "units behind the name": "t_ms,x_mm,y_cm\n0,1,5\n100,2,4\n200,3,2\n",
    "a row of units": "time,x,y\ns,mm,mm\n0,1,50\n0.1,2,40\n0.2,3,20\n",
    "decimal comma": "t [s];x [mm];y [mm]\n0,0;1,0;50,0\n0,1;2,0;40,0\n0,2;3,0;20,0\n",
    "tabs and decimal comma": "t/s\tx/mm\ty/mm\n0,0\t1,0\t50,0\n0,1\t2,0\t40,0\n0,2\t3,0\t20,0\n",
    "comment lines": "# camera 3\n# bead 6 mm\nt_s,x_mm,y_mm\n0,1,50\n# a hand\n0.1,2,40\n0.2,3,20\n",
    "a header in a comment": "# t_s x_mm y_mm\n0 1 50\n0.1 2 40\n0.2 3 20\n",
    "columns in another order": "y_mm,sigma_mm,time_s,x_mm\n50,0.1,0,1\n40,0.1,0.1,2\n20,0.1,0.2,3\n",
    "Windows text": "Zeit [s];x [mm];y [mm]\r\n0,0;1,0;50,0\r\n0,1;2,0;40,0\r\n0,2;3,0;20,0\r\n",
    "velocities beside": "t (s),x (mm),y (mm),X Velocity (m/s),vy\n0,1,50,9,9\n0.1,2,40,9,9\n0.2,3,20,9,9\n",
}


@pytest.mark.parametrize("text", SAME.values(), ids=SAME.keys())
def test_the_same_track_in_any_spelling(tmp_path, text):
    path = tmp_path / "track.csv"
    path.write_text(text, encoding="utf-8")
    found = read_bodies(path)
    (track,) = found.tracks
    assert found.unit == "m"
    np.testing.assert_allclose(track.time, TIME)
    np.testing.assert_allclose(track.position, np.column_stack([X, Y]))


def written(tmp_path: Path, text: str, name: str = "track.csv") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


PROGRAMS = {
    "Tracker table": ("ball\nt\tx\ty\n0.0\t0.001\t0.05\n0.1\t0.002\t0.04\n0.2\t0.003\t0.02\n", {}),
    "Logger Pro table": ("Latest: Time (s),Latest: X (m),Latest: Y (m)\n0,.001,.05\n.1,.002,.04\n.2,.003,.02\n", {}),
    "Logger Pro text": (
        "Vernier Format 2\ndrop.cmbl 5/5/2024 9:37\nData Set\nTime\tX\tY\nt\tx\ty\ns\tm\tm\n\n"
        "0\t0.001\t0.05\n0.1\t0.002\t0.04\n0.2\t0.003\t0.02\n",
        {},
    ),
    "Kinovea text": (
        "#Kinovea Trajectory data export\n#T X Y\n\n0:00:00:00 10.00 500.00\n0:00:00:10 20,00 400,00\n"
        "0:00:00:20 30.00 200.00\n",
        {"scale": 1e-4},
    ),
    "Kinovea table": (
        '"Time";"Trajectory 1/0/X";"Trajectory 1/0/Y"\n0,0;10,0;500,0\n100,0;20,0;400,0\n200,0;30,0;200,0\n',
        {"scale": 1e-4},
    ),
    "trackpy table": (
        ",y,x,mass,size,ecc,signal,raw_mass,ep,frame,particle\n0,500,10,9,2,0.1,1,9,0.1,0,4\n1,400,20,9,2,0.1,1,9,0.1,1,4\n"
        "2,200,30,9,2,0.1,1,9,0.1,2,4\n",
        {"scale": 1e-4, "frame_rate": 10.0},
    ),
    "TrackMate spots": (
        "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_T,FRAME\n"
        "Label,Spot ID,Track ID,Quality,X,Y,T,Frame\nLabel,Spot ID,Track ID,Quality,X,Y,T,Frame\n"
        ",,,(quality),(micron),(micron),(sec),\n"
        "ID1,1,0,5,1000,50000,0,0\nID3,3,0,5,3000,20000,0.2,2\nID2,2,0,5,2000,40000,0.1,1\nID9,9,,5,7,7,0.1,1\n",
        {},
    ),
    "MTrack2 table": (
        "Frame\tX1\tY1\tFlag1\nTracks 1 to 1\n1\t10\t500\t \n2\t20\t400\t \n3\t30\t200\t \n\n"
        "Track \tLength\tDistance traveled\tNr of Frames\n1\t9\t9\t3\n",
        {"scale": 1e-4, "frame_rate": 10.0},
    ),
    "ImageJ results": (
        " ,Area,Mean,X,Y,Slice\n1,9,200,10,500,1\n2,9,200,20,400,2\n3,9,200,30,200,3\n",
        {"scale": 1e-4, "frame_rate": 10.0},
    ),
}


@pytest.mark.parametrize("kind", PROGRAMS)
def test_a_programs_export_is_recognised(tmp_path, kind):
    text, camera = PROGRAMS[kind]
    found = read_bodies(written(tmp_path, text, "export.txt"), **camera)
    (track,) = found.tracks
    assert found.understood.kind == kind
    assert found.unit == "m"
    np.testing.assert_allclose(np.diff(track.time), 0.1)
    np.testing.assert_allclose(track.position, np.column_stack([X, Y]), rtol=1e-6)


TRACKER = """<?xml version="1.0"?><object class="org.opensourcephysics.cabrillo.tracker.TrackerPanel">
<property name="clipcontrol" type="object"><object class="a.StepperClipControl">
<property name="delta_t" type="double">100.0</property></object></property>
<property name="coords" type="object"><object class="a.ImageCoordSystem">
<property name="framedata" type="array"><property name="[0]" type="object"><object class="a.FrameData">
<property name="xorigin" type="double">100.0</property><property name="yorigin" type="double">300.0</property>
<property name="angle" type="double">90.0</property>
<property name="xscale" type="double">1000.0</property><property name="yscale" type="double">1000.0</property>
</object></property></property></object></property>
<property name="tracks" type="collection"><property name="item" type="object"><object class="a.PointMass">
<property name="name" type="string">ball</property><property name="framedata" type="array">{}</property>
</object></property></property></object>"""

MARK = (
    '<property name="[{}]" type="object"><object class="a.FrameData"><property name="x" type="double">{}</property>'
    '<property name="y" type="double">{}</property></object></property>'
)


def test_a_tracker_project_is_read_in_its_own_axes(tmp_path):
    # an x axis that points up in the picture: a mark 2 px above the origin is at x = 2 mm, one to the left at y > 0
    marks = MARK.format(2, 100, 298) + MARK.format(3, 70, 300)
    found = read_bodies(written(tmp_path, TRACKER.format(marks), "ball.trk"))
    (track,) = found.tracks
    assert (found.understood.kind, track.body) == ("Tracker project", "ball")
    np.testing.assert_allclose(track.time, [0.2, 0.3])
    np.testing.assert_allclose(track.position, [[0.002, 0], [0, 0.03]], atol=1e-12)


def test_trackmates_xml_holds_several_bodies(tmp_path):
    points = "".join(f'<detection t="{k}" x="{k}" y="{10 * k}" z="0" />' for k in range(3))
    text = (
        '<?xml version="1.0"?><Tracks nTracks="2" spaceUnits="mm" frameInterval="0.5" timeUnits="sec">'
        f'<particle nSpots="3">{points}</particle><particle nSpots="3">{points}</particle></Tracks>'
    )
    first, second = read_bodies(written(tmp_path, text, "tracks.xml")).tracks
    assert (first.body, second.body) == ("0", "1")
    np.testing.assert_allclose(first.time, [0, 0.5, 1])
    np.testing.assert_allclose(second.position[:, 1], [0, 0.01, 0.02])


TRACKS = '<Tracks spaceUnits="mm" frameInterval="{}" timeUnits="sec"><particle>{}</particle></Tracks>'
BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("text", "name", "complaint"),
    [
        (TRACKS.format("fast", '<detection t="1" x="1" y="1" />'), "a.xml", "frameInterval of Tracks is 'fast'"),
        (TRACKS.format("1", '<detection t="now" x="1" y="1" />'), "a.xml", "frame of a point is 'now'"),
        (BOMB + TRACKS.format("1", '<detection t="&b;" x="1" y="1" />'), "a.xml", "declares XML entities"),
        (TRACKER.format(MARK.format(0, "left", 2)), "a.trk", "x is 'left'"),
        (TRACKER.format(MARK.format(0, 1, 2)).replace("1000.0", "0"), "a.trk", "xscale is 0"),
    ],
)
def test_a_project_file_with_a_bad_entry_is_refused(tmp_path, text, name, complaint):
    with pytest.raises(BadInput, match=re.escape(complaint)):
        read_bodies(written(tmp_path, text, name))


@pytest.mark.parametrize(
    "header",
    [
        "t_s,xA_mm,yA_mm,xB_mm,yB_mm",
        "t [s],x_A [mm],y_A [mm],x_B [mm],y_B [mm]",
        "t [s],A x [mm],A y [mm],B x [mm],B y [mm]",
    ],
)
def test_bodies_may_stand_side_by_side(tmp_path, header):
    a, b = read_bodies(written(tmp_path, f"{header}\n0,1,50,7,8\n0.1,2,40,7,8\n0.2,3,20,,\n")).tracks
    assert (a.body, b.body) == ("A", "B")
    np.testing.assert_allclose(a.position, np.column_stack([X, Y]))
    assert len(b.time) == 2


def test_bodies_may_stand_below_titles(tmp_path):
    text = "mass_A\t\t\tmass_B\t\t\nt\tx\ty\tt\tx\ty\n0\t0.1\t0.2\t0\t0.3\t0.4\n1\t0.1\t0.2\t1\t0.3\t0.4\n"
    a, b = read_bodies(written(tmp_path, text)).tracks
    assert (a.body, b.body) == ("mass_A", "mass_B")
    np.testing.assert_allclose(b.position[0], [0.3, 0.4])


def test_stated_columns_and_units_come_first(tmp_path):
    path = written(tmp_path, "7;0;1;50\n7;100;2;40\n7;200;3;20\n")
    found = read_bodies(path, TableOptions(parse_columns("t=2[ms],x=3[mm],y=4[mm]")))
    np.testing.assert_allclose(found.tracks[0].time, TIME)
    np.testing.assert_allclose(found.tracks[0].position, np.column_stack([X, Y]))
    with pytest.raises(BadInput, match="no column 'height' for y; the columns are '1', '2', '3', '4'"):
        read_bodies(path, TableOptions(parse_columns("y=height")))
    with pytest.raises(BadQuantity, match="names no column"):
        parse_columns("frame")


@pytest.mark.parametrize(("unit", "used"), [("px", True), ("mm", False)])
def test_a_given_scale_is_stated_as_used_for_pixels_only(tmp_path, unit, used):
    camera = Camera(scale=1e-3)
    table = f"t_s,x_{unit},y_{unit}\n0,1,50\n0.1,2,40\n0.2,3,20\n"
    found = read_bodies(written(tmp_path, table), scale=camera.given_scale)
    (track,) = found.tracks
    np.testing.assert_allclose(track.position, np.column_stack([X, Y]))
    assert scale_used(found, camera) == ({"scale_m_per_px": 1e-3, "scale_from": "given"} if used else {})


def test_pixels_stay_pixels_without_a_scale(tmp_path):
    path = written(tmp_path, "frame,x_px,y_px\n0,10,500\n1,20,400\n2,30,200\n")
    assert read_bodies(path, frame_rate=10.0).unit == "px"
    np.testing.assert_allclose(read_bodies(path, frame_rate=10.0, scale=1e-4).tracks[0].position[:, 1], Y)
    with pytest.raises(BadInput, match=r"'frame' counts frames .* --frame-rate"):
        read_bodies(path)


def fall(noise: float) -> np.ndarray:
    """Height of a ball that falls and bounces twice, with the restitution 0.8."""
    time, impact, speed = np.arange(0, 1.6, 1 / 240), math.sqrt(2 * 0.5 / 9.81), math.sqrt(2 * 9.81 * 0.5)
    y = 0.5 - 9.81 * time**2 / 2
    for _ in range(3):
        speed *= 0.8
        since = time - impact
        y = np.where(since > 0, speed * since - 9.81 * since**2 / 2, y)
        impact += 2 * speed / 9.81
    y = np.where(time < impact, y, 0.0)
    return np.column_stack([time, y + np.random.default_rng(3).normal(0, noise, len(time))])


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_fall_shows_where_up_is(tmp_path, noise, sign):
    rows = fall(noise)
    path = written(tmp_path, "t_s,y_m\n" + "".join(f"{t:.6f},{sign * y + 3:.6f}\n" for t, y in rows))
    found = read_bodies(path, direction=by_fall, only_height=True)
    assert ("turned over" in found.understood.direction) == (sign < 0)
    np.testing.assert_allclose(np.ptp(found.tracks[0].position[:, 1]), np.ptp(rows[:, 1]), rtol=1e-4)
    assert found.tracks[0].position[0, 1] > found.tracks[0].position[-1, 1]


@pytest.mark.parametrize("sign", [1, -1])
def test_the_swing_shows_where_up_is(tmp_path, sign):
    angles = np.radians(30 * np.cos(np.linspace(0, 10, 80)))
    rows = "".join(
        f"{k / 60:.6f},{0.3 * math.sin(a):.6f},{-0.3 * sign * math.cos(a):.6f}\n" for k, a in enumerate(angles)
    )
    found = read_bodies(written(tmp_path, "t_s,x_m,y_m\n" + rows), direction=by_swing)
    assert ("turned over" in found.understood.direction) == (sign < 0)


def test_a_broken_track_is_proposed_and_joined(tmp_path):
    rows = [f"{k},{2 * k},{100 - k},{3 if k < 20 else 7}\n" for k in range(40) if k != 20]
    path = written(tmp_path, "frame,x,y,particle\n" + "".join(rows) + "0,900,900,5\n1,901,900,5\n2,902,900,5\n")
    broken = read_bodies(path, frame_rate=100.0, scale=1e-3)
    assert len(broken.tracks) == 3
    (proposal,) = broken.understood.proposals
    assert "--join 3,7" in proposal
    whole = read_bodies(path, TableOptions(joined=parse_joined(["3,7"])), frame_rate=100.0, scale=1e-3)
    assert sorted(track.body for track in whole.tracks) == ["3", "5"]
    assert max(len(track.time) for track in whole.tracks) == 39
    with pytest.raises(BadInput, match="overlap in time"):
        read_bodies(path, TableOptions(joined=parse_joined(["3,5"])), frame_rate=100.0, scale=1e-3)


def test_a_given_frame_rate_is_used_before_the_tables_times(tmp_path):
    path = written(tmp_path, "t_s,x_m,y_m\n" + "".join(f"{k / 30:.3f},0,{k}\n" for k in range(10)))
    track = read_bodies(path, frame_rate=240.0).tracks[0]
    np.testing.assert_allclose(track.time, np.arange(10) / 240, atol=2e-4)


def test_a_surface_in_picture_coordinates_is_turned_over(tmp_path):
    rows = "".join(f"{x},{300 - max(0, 90 - abs(x - 100))}\n" for x in range(0, 201, 10))
    found = read_profiles(written(tmp_path, "x_px,y_px\n" + rows), scale=1e-3, heap=True)
    assert "turned over" in found.understood.direction
    np.testing.assert_allclose(found.profiles[0].height.max(), 0.09)
    # a crater that is named a height stays one
    crater = "".join(f"{x},{abs(x - 100)}\n" for x in range(0, 201, 10))
    kept = read_profiles(written(tmp_path, "x_mm,height_mm\n" + crater), heap=True)
    np.testing.assert_allclose(kept.profiles[0].height.min(), 0)


def test_a_surface_over_time_is_one_profile_for_each_time(tmp_path):
    text = "time_s,x_m,height_m,sigma_m\n0,0,1,0.1\n0,1,2,0.1\n0.5,1,3,0.1\n0.5,0,4,0.1\n"
    found = read_profiles(written(tmp_path, text))
    assert found.times.tolist() == [0, 0.5]
    assert found.profiles[1].height.tolist() == [4, 3]


@pytest.mark.parametrize(
    ("header", "role", "values", "unit"),
    [
        ("time_s,angle_deg", "angle", np.radians([10, 20]), "rad"),
        ("time_s,slope", "angle", None, ""),
        ("time_s,fraction_left", "left", [10, 20], "1"),
        ("time_s,mass_left_g", "left", [0.01, 0.02], "kg"),
        ("time_s,flow rate [g/s]", "flow", [0.01, 0.02], "kg/s"),
        ("time_s,left [%]", "left", [0.1, 0.2], "1"),
    ],
)
def test_a_value_over_time_is_read_in_si(tmp_path, header, role, values, unit):
    path = written(tmp_path, f"{header}\n0,10\n1,20\n")
    found = read_series(path, [role])
    assert found is not None
    if values is None:
        assert "degrees are taken" in "".join(found.understood.notes)
        return
    np.testing.assert_allclose(found.series.value, values)
    assert found.series.unit == unit


def test_a_refusal_names_the_columns_that_were_seen(tmp_path):
    path = written(tmp_path, "Time (s),Acceleration x (m/s^2)\n0,1\n1,2\n")
    with pytest.raises(BadInput, match=r"no column for y .* 'Time \(s\)', 'Acceleration x \(m/s\^2\)'"):
        read_bodies(path, only_height=True)


@pytest.mark.parametrize("row", ["0,1,500.1,2,40", "0,1,50;0.1,2,40"])
@pytest.mark.parametrize("head", ["t_s,x_mm,y_mm\n", ""])
def test_a_first_row_that_lost_its_end_is_no_header(tmp_path, head, row):
    path = written(tmp_path, head + row + "\n0.2,3,20\n0.3,4,0\n")
    with pytest.raises(BadInput, match="5 cells where the table has 3"):
        read_bodies(path, TableOptions(parse_columns("t=1[s],x=2[mm],y=3[mm]")))


def test_decimal_commas_between_commas_are_answered_with_what_to_do(tmp_path):
    path = written(tmp_path, "t_s,x_mm,y_mm\n0,1,50\n0,1,2,1,49,5\n0,2,3,40\n")
    with pytest.raises(BadInput, match="decimal commas need semicolons or tabs"):
        read_bodies(path, TableOptions())
    path = written(tmp_path, "t_s,x_mm,y_mm\n0,1,50\n0.1,2\n0.2,3,40\n")
    with pytest.raises(BadInput, match=r"2 cells where the table has 3\.$"):
        read_bodies(path, TableOptions())


def test_a_first_row_that_lost_a_comma_is_no_row_of_units(tmp_path):
    path = written(tmp_path, "t_s,x_mm,y_mm\n0.0000.0,50\n0.2,3,20\n0.3,4,0\n")
    with pytest.raises(BadInput, match="line 2: 2 cells where the table has 3"):
        read_bodies(path, TableOptions())


@pytest.mark.parametrize("text", ["3", "3,3", "3,7,3", ","])
def test_a_broken_track_has_several_parts_each_of_them_once(text):
    with pytest.raises(BadQuantity, match="two at least and each once"):
        parse_joined([text])
