"""Opening input files: what libraries write themselves stays unheard."""

import os
import sys

from rigtwin.lab.input_files import unheard


def test_what_a_library_writes_to_stderr_is_unheard_and_what_follows_is_not(capfd):
    with unheard():
        os.write(2, b"a decoder")
    sys.stderr.write("ours")
    assert capfd.readouterr().err == "ours"


def test_a_process_without_stderr_goes_on():
    kept = os.dup(2)
    os.close(2)
    try:
        with unheard():
            pass
    finally:
        os.dup2(kept, 2)
        os.close(kept)
