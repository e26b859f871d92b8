"""Each key of a TOML text is found on the line where it stands."""

import tomllib

from hypothesis import given, settings
from hypothesis import strategies as st

from rigtwin.lab.file.toml_lines import dotted, key_lines

KEYS = st.sampled_from(["a", "b-2", "C_3", '"dotted.key"', "'hash # key'", '"quote \\" key"', "4"])
SCALARS = st.sampled_from(
    [
        '"{}"',
        "'{}'",
        '"{} # ] }} \\" ="',
        "'{} \\'",
        '"""{}\n[not.a.table]\nkey = 1 # \\""" "" """',
        "'''{}\n]\n#'''",
        '"""{}"""""',
    ]
)
SPACE = st.sampled_from(["", " ", "\t"])
BREAKS = st.sampled_from(["", "\n", " # a comment, with ] and }\n", "\n\n"])
NOISE = st.sampled_from(["", "\n", "# [comment]\n", "  # key = 1\n\n"])


class Writer:
    """Writes a random valid TOML text in which every value holds a word of its own."""

    def __init__(self, draw):
        self.draw = draw
        self.text = ""
        self.words = {}  # path -> its word

    def document(self):
        for _ in range(self.draw(st.integers(0, 2))):
            self.text += self.draw(NOISE)
        self.top_keys = self.pairs(())
        tables = self.draw(st.lists(KEYS, max_size=3, unique=True))
        for raw in tables:
            name = tomllib.loads(f"{raw} = 1").popitem()[0]
            if name in self.top_keys:
                continue
            if self.draw(st.booleans()):
                for number in range(self.draw(st.integers(1, 3))):
                    self.section(f"[[{raw}]]", (name, number))
                    if self.draw(st.booleans()):
                        self.section(f"[ {raw} . sub ]", (name, number, "sub"))
            else:
                self.section(f"[{raw}.deeper]", (name, "deeper"))

    def section(self, header, path):
        self.text += self.draw(SPACE) + header + self.draw(SPACE) + f"# {header}\n" + self.draw(NOISE)
        self.pairs(path)

    def pairs(self, path):
        names = []
        for raw in self.draw(st.lists(KEYS, max_size=3, unique=True)):
            name = tomllib.loads(f"{raw} = 1").popitem()[0]
            names.append(name)
            dots = self.draw(st.booleans())
            self.text += self.draw(SPACE) + raw + (" . inner" if dots else "") + self.draw(SPACE) + "="
            self.value((*path, name, "inner") if dots else (*path, name), depth=0)
            self.text += self.draw(SPACE) + "\n" + self.draw(NOISE)
        return names

    def value(self, path, depth):
        kind = self.draw(st.sampled_from(["scalar", "array", "inline"] if depth < 2 else ["scalar"]))
        self.text += self.draw(SPACE)
        if kind == "scalar":
            word = f"word{len(self.words)}word"
            self.words[path] = word
            self.text += self.draw(SCALARS).format(word)
        elif kind == "array":
            self.text += "[" + self.draw(BREAKS)
            for number in range(self.draw(st.integers(0, 3))):
                self.value((*path, number), depth + 1)
                self.text += self.draw(BREAKS) + "," + self.draw(BREAKS)
            self.text += "]"
        else:
            self.text += "{"
            for number in range(self.draw(st.integers(0, 2))):
                self.text += (", " if number else " ") + f"k{number} ="
                self.value((*path, f"k{number}"), depth + 1)
            self.text += " }"


@settings(deadline=None, derandomize=True)
@given(data=st.data(), line_end=st.sampled_from(["\n", "\r\n"]))
def test_every_value_is_found_on_the_line_where_it_stands(data, line_end):
    writer = Writer(data.draw)
    writer.document()
    text = writer.text.replace("\n", line_end)
    content = tomllib.loads(text)  # a text that TOML itself refuses would prove nothing
    lines = key_lines(text)
    for path, word in writer.words.items():
        value = content
        for part in path:
            value = value[part]
        assert word in value
        assert word in text.split("\n")[lines[path] - 1]


def test_a_table_inside_an_array_of_tables_belongs_to_the_latest():
    text = "[[runs]]\n[runs.camera]\nrate = 1\n\n[[runs]]\nid = 2\n[runs.camera]\nrate = 3\n[[runs.views]]\nx = 1\n"
    lines = key_lines(text)
    assert lines["runs", 0, "camera", "rate"] == 3
    assert lines["runs", 1] == 5
    assert lines["runs", 1, "camera"] == 7
    assert lines["runs", 1, "views", 0, "x"] == 10


def test_dates_and_numbers_end_where_they_end():
    lines = key_lines("a = 1979-05-27 07:32:00 # when\nb = [1, 2.5e3,\n -inf]\nc = {x = true, y = 0x1F}\nd = 1")
    assert (lines["a",], lines["b", 2], lines["c", "y"], lines["d",]) == (1, 3, 4, 5)


def test_a_path_is_written_as_a_person_writes_it():
    assert dotted(("experiments", 2, "camera", "frame_rate")) == "experiment 3, camera.frame_rate"
    assert dotted(("experiments", 0, "camera", "region", 3)) == "experiment 1, camera.region, number 4"
    assert dotted(("contacts", "two words-steel", "restitution")) == 'contacts."two words-steel".restitution'
