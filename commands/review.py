"""``rigtwin review LAB``: the page on which a lab's measurements are seen and corrected."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigtwin.commands.display import print_json
from rigtwin.commands.options import Json, Outside, Quiet


def review(
    lab: Annotated[
        Path, typer.Argument(metavar="LAB", help="Lab folder with a lab.toml, or one of its photos or clips.")
    ],
    *,
    port: Annotated[
        int | None, typer.Option("--port", min=1, max=65535, help="Port on this machine; a free one by default.")
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
    allow_outside: Outside = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """See in a browser what was measured in a lab, and correct it.

    The page is served on this machine only, at the printed address. Every change made there is one entry in lab.toml,
    which all other commands read too. Ctrl-C ends it.
    """
    from rigtwin.lab.errors import Interrupted
    from rigtwin.review.serve import serve

    def announce(address: str) -> None:
        if as_json:
            print_json({"address": address, "lab": str(lab)})
        elif not quiet:
            typer.echo(f"Review {lab} at {address} (Ctrl-C ends it).")
        elif not browser:
            typer.echo(address)

    try:
        serve(lab, announce, port=port, browser=browser, allow_outside=allow_outside)
    except KeyboardInterrupt:
        raise Interrupted("the page is closed; every change that was made on it stands in lab.toml.") from None
