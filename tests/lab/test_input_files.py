"""Opening input files: what libraries write themselves is discarded."""

import os
import sys

from rigtwin.lab.input_files import silenced_stderr


def test_what_a_library_writes_to_stderr_is_discarded_and_what_follows_is_not(capfd):
    with silenced_stderr():
        os.write(2, b"a decoder")
    sys.stderr.write("ours")
    assert capfd.readouterr().err == "ours"


def test_a_process_without_stderr_goes_on():
    kept = os.dup(2)
    os.close(2)
    try:
        with silenced_stderr():
            pass
    finally:
        os.dup2(kept, 2)
        os.close(kept)
