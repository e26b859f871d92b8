"""``python -m rigtwin`` is the command line."""

from rigtwin.cli import main

if __name__ == "__main__":
    main()
