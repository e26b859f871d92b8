"""``python -m rigtwin`` is the command line."""

from rigtwin.cli import main

main()
