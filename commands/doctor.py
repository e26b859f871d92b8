"""``rigtwin doctor``: does everything that rigtwin needs work on this machine?"""

from __future__ import annotations

import typer

from rigtwin.commands.display import print_json
from rigtwin.commands.options import Json, Quiet


def doctor(*, as_json: Json = False, quiet: Quiet = False) -> None:
    """Check the installation and the machine.

    Each line is one check: ok, warning (works with a limitation), failed (with what to do) or note (optional). The exit
    code is 1 if something required does not work.
    """
    from rigtwin.commands.installation import findings

    found = []
    for finding in findings():
        found.append(finding)
        if not (as_json or quiet):
            typer.echo(f"{finding.state:<8} {finding.check}: {finding.message}")
    works = all(finding.state != "failed" for finding in found)
    if as_json:
        print_json({"works": works, "checks": [vars(finding) for finding in found]})
    if not works:
        raise typer.Exit(1)
