"""What an interrupt says that is kept."""

import pytest

from rigtwin.compare.interrupted import note_on_interrupt


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ((), ["the runs in {} are kept"]),
        (("2 of 4 measurements are kept",), ["2 of 4 measurements are kept", "the runs in {} are kept"]),
        (("the run goes on from {}/one.npz",), ["the run goes on from {}/one.npz"]),
    ],
)
def test_a_note_is_added_unless_one_names_the_folder(tmp_path, before, after):
    stop = KeyboardInterrupt()
    for note in before:
        stop.add_note(note.format(tmp_path))
    with (
        pytest.raises(KeyboardInterrupt) as caught,
        note_on_interrupt(tmp_path, lambda: f"the runs in {tmp_path} are kept"),
    ):
        raise stop
    assert getattr(caught.value, "__notes__", []) == [note.format(tmp_path) for note in after]


def test_nothing_is_added_where_nothing_is_kept(tmp_path):
    with pytest.raises(KeyboardInterrupt) as caught, note_on_interrupt(tmp_path, str):
        raise KeyboardInterrupt
    assert not getattr(caught.value, "__notes__", [])
