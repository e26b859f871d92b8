"""Opening input files: what libraries write themselves is kept from the user."""

import os
import sys

from rigtwin.lab.input_files import captured_stderr


def test_what_a_library_writes_to_stderr_is_kept_from_the_user_and_what_follows_is_not(capfd):
    with captured_stderr() as lines:
        os.write(2, b"a decoder\nsays \xff")
    sys.stderr.write("ours")
    assert capfd.readouterr().err == "ours"
    assert lines == ["a decoder", "says \ufffd"]


def test_a_process_without_stderr_goes_on():
    kept = os.dup(2)
    os.close(2)
    try:
        with captured_stderr():
            pass
    finally:
        os.dup2(kept, 2)
        os.close(kept)
