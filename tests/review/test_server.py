"""Whom the server of `rigtwin review` answers, and what it hands out."""

import json
import shutil
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import trimesh

from rigtwin.cli import run

MEDIA = Path(__file__).parents[2] / "sample_media"
LAB = """
[[experiments]]
id = "heap"
rig = "pile"
variant = "piling"
particle = "D6"
wall = "steel"
base_diameter = "90 mm"
repetitions = ["view1.jpg"]
"""


class Caller:
    """Asks the server as a browser does that has opened its address."""

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        self.host, self.port, self.query = parts.netloc, parts.port, parts.query
        self.token = self.query.removeprefix("token=")
        self.cookie = {"Cookie": f"rigtwin-{self.port}={self.token}"}
        self.own = {**self.cookie, "Origin": f"http://{self.host}"}

    def __call__(self, path, headers=None, method="GET", body=None) -> tuple[int, bytes, dict[str, str]]:
        connection = HTTPConnection("127.0.0.1", self.port, timeout=20)
        content = None if body is None else json.dumps(body).encode()
        connection.request(method, path, content, {"Host": self.host, **(self.cookie if headers is None else headers)})
        answer = connection.getresponse()
        found = answer.status, answer.read(), {name.lower(): value for name, value in answer.getheaders()}
        connection.close()
        return found


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bench") / "lab"
    (folder / "out").mkdir(parents=True)
    shutil.copy(MEDIA / "pile/view1.jpg", folder)
    (folder / "lab.toml").write_text(LAB)
    (folder / "out" / "report.html").write_text("<h1>Compared</h1>")
    (folder / "out" / "elsewhere.html").symlink_to(folder.parent / "secret.html")
    (folder.parent / "secret.html").write_text("not of the lab")
    (folder / "secret.csv").write_text("not a result")
    return folder


@pytest.fixture(scope="module")
def ask(lab, served) -> Iterator[Caller]:
    with served(lab) as address:
        yield Caller(address)


CHANGE = {"experiment": 0, "key": "region", "value": "0,0,900,700", "file": None}


def test_the_address_with_the_token_sets_a_cookie_and_leads_to_the_page(ask):
    status, _, headers = ask(f"/?{ask.query}", {})
    assert (status, headers["location"]) == (303, "/")
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=strict" in headers["set-cookie"]
    status, page, headers = ask("/")
    assert status == 200
    assert b"<title>rigtwin review</title>" in page
    assert headers["content-security-policy"].startswith("default-src 'self'")


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/api/lab", "/api/result/0/0", "/frame/0/0/0/0"])
@pytest.mark.parametrize("headers", [{}, {"Cookie": "rigtwin-{port}=guessed"}])
def test_without_the_token_nothing_is_answered(ask, path, headers):
    given = {name: value.format(port=ask.port) for name, value in headers.items()}
    status, said, _ = ask(path, given)
    assert status == 403
    assert b"token" in said


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1"])
def test_another_host_name_is_refused(ask, host):
    for path in ("/api/lab", "/frame/0/0/0/0"):
        status, said, _ = ask(path, {**ask.cookie, "Host": host.format(port=ask.port)})
        assert status == 403
        assert "only there for this machine" in json.loads(said)["error"]


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://{host}", "Sec-Fetch-Site": "cross-site"},
        {"Origin": "https://{host}"},
    ],
)
def test_another_page_changes_nothing(ask, lab, headers):
    given = {name: value.format(host=ask.host) for name, value in headers.items()}
    status, said, _ = ask("/api/set", {**ask.cookie, **given}, "POST", CHANGE)
    assert status == 403
    assert b"another page asks" in said
    assert (lab / "lab.toml").read_text() == LAB


def test_another_page_reads_nothing(ask):
    given = {**ask.cookie, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}
    assert ask("/frame/0/0/0/0", given)[0] == 403


def test_the_page_itself_may_change_lab_toml_and_take_it_back(ask, lab):
    status, said, _ = ask("/api/set", ask.own, "POST", CHANGE)
    assert (status, json.loads(said)["can_undo"]) == (200, True)
    assert (lab / "lab.toml").read_text() == f'{LAB}\n[experiments.camera]\nregion = "0,0,900,700"\n'
    assert ask("/api/undo", ask.own, "POST")[0] == 200
    assert (lab / "lab.toml").read_text() == LAB


@pytest.mark.parametrize(
    "path",
    [
        "/results/../lab.toml",
        "/results/..%2Fsecret.csv",
        "/results/%2e%2e/%2e%2e/secret.html",
        "/results//etc/passwd",
        "/results/elsewhere.html",
        "/static/../guard.py",
        "/static/..%2Fguard.py",
        "/frame/0/0/1/0",
        "/frame/0/0/-1/0",
        "/frame/1/0/0/0",
        "/api/media/0/7/0",
        "/api/twin/0/0",
    ],
)
def test_only_files_of_the_lab_are_handed_out(ask, path):
    status, said, _ = ask(path)
    assert status == 404
    assert b"not" not in said.replace(b"Not Found", b"")


def test_results_of_earlier_commands_are_shown_without_scripts(ask):
    assert json.loads(ask("/api/lab")[1])["results"] == ["report.html"]
    status, said, headers = ask("/results/report.html")
    assert (status, said) == (200, b"<h1>Compared</h1>")
    assert "script-src" not in headers["content-security-policy"]
    assert headers["content-security-policy"].startswith("default-src 'none'")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"value": "0,0"}, "is not of the form"),
        ({"key": "plate"}, "is not used by a pile"),
        ({"key": "nonsense"}, "unknown key"),
        ({"experiment": 3}, "has no experiment 4"),
        ({"experiment": -1}, "has no experiment 0"),
        ({"file": "other.jpg"}, "is none of the repetitions"),
        ({"value": {"a": 1}}, "is no change of lab.toml"),
        ({"experiment": True}, "is no change of lab.toml"),
    ],
)
def test_what_cannot_be_written_is_refused_in_one_sentence(ask, lab, change, said):
    status, answer, _ = ask("/api/set", ask.own, "POST", CHANGE | change)
    assert status == 422
    assert said in json.loads(answer)["error"]
    assert (lab / "lab.toml").read_text() == LAB


def test_a_request_without_end_is_cut_short(ask):
    status, answer, _ = ask("/api/set", ask.own, "POST", CHANGE | {"value": "1" * 100_000})
    assert status == 422
    assert "too large" in json.loads(answer)["error"]


def test_a_lab_that_is_broken_while_the_page_is_open_is_said_with_its_line(ask, lab):
    (lab / "lab.toml").write_text(LAB.replace("90 mm", "90 kg"))
    try:
        status, answer, _ = ask("/api/lab")
    finally:
        (lab / "lab.toml").write_text(LAB)
    assert status == 422
    assert "lab.toml, line 8: experiment 1, base_diameter" in json.loads(answer)["error"]


def test_no_page_is_served_of_a_folder_without_a_lab(tmp_path, capfd):
    assert run(["review", str(tmp_path), "--no-browser"]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "lab.toml: no such file" in err


def test_a_port_that_is_taken_is_refused(ask, lab, capfd):
    assert run(["review", str(lab), "--no-browser", "--port", str(ask.port)]) == 2
    assert "--port" in capfd.readouterr().err


def test_a_photo_of_a_lab_is_shown_first(lab, served):
    with served(lab / "view1.jpg") as address:
        assert address.endswith("#0/0/0")


def test_a_photo_that_no_lab_names_is_refused(lab, capfd):
    shutil.copy(MEDIA / "pile/view2.jpg", lab)
    assert run(["review", str(lab / "view2.jpg"), "--no-browser"]) == 2
    assert "view2.jpg: no lab.toml above it names it" in capfd.readouterr().err


def test_patterns_and_folders_are_shown_as_the_files_that_they_name_rejected_ones_too(tmp_path, served):
    for folder, names in {"heaps": ("b10.jpg", "b2.jpg"), "clips": ("r01.jpg", "r02.jpg")}.items():
        (tmp_path / folder).mkdir()
        for number, name in enumerate(names):
            content = (MEDIA / "pile/view1.jpg").read_bytes()
            (tmp_path / folder / name).write_bytes(content + f"{folder}{number}".encode())  # copies are refused
    listed = LAB.replace('["view1.jpg"]', '["heaps/", "clips/*.jpg"]')
    (tmp_path / "lab.toml").write_text(f"""{listed}
[experiments.files."./heaps/b2.jpg"]
rejected = "a hand is in view"
""")
    with served(tmp_path / "clips/r02.jpg") as address:
        assert address.endswith("#0/3/0")
        ask = Caller(address.partition("#")[0])
        (one,) = json.loads(ask("/api/lab")[1])["experiments"]
        shown = [[view["name"] for view in views] for views in one["repetitions"]]
        assert shown == [["./heaps/b2.jpg"], ["heaps/b10.jpg"], ["clips/r01.jpg"], ["clips/r02.jpg"]]
        assert one["repetitions"][0][0]["rejected"] == "a hand is in view"
        assert [ask(f"/frame/0/{repetition}/0/0")[0] for repetition in range(5)] == [200, 200, 200, 200, 404]


def test_a_lab_with_a_particle_from_an_stl_file_is_served_and_measured(tmp_path, served):
    trimesh.creation.icosphere(subdivisions=3, radius=3.1).export(tmp_path / "ball.stl")
    shutil.copy(MEDIA / "pile/view1.jpg", tmp_path)
    particle = '[particles.ball]\nmaterial = "wood_ash"\nstl = "ball.stl"\n'
    (tmp_path / "lab.toml").write_text(particle + LAB.replace('"D6"', '"ball"'))
    with served(tmp_path) as address:
        ask = Caller(address)
        status, answer, _ = ask("/api/lab")
        assert status == 200
        (experiment,) = json.loads(answer)["experiments"]
        assert experiment["particle"] == "ball"
        assert ask("/api/result/0/0")[0] == 200
        changed = ask("/api/set", ask.own, "POST", CHANGE)
        assert changed[0] == 200, changed[1]
