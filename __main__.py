"""Entry point of the command ``rigtwin`` and of ``python -m rigtwin``: `rigtwin.cli`, also while that still loads."""

import os
import signal


def main() -> None:
    """Run the command line; Ctrl-C while its modules load ends the process at once, with nothing to clear up."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    from rigtwin.cli import main as run_command_line

    run_command_line()


if __name__ == "__main__":
    main()
