"""Start the server of the page on this machine, and end it."""

from __future__ import annotations

import os
import secrets
import socket
import threading
import webbrowser
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import uvicorn

from rigtwin.lab.errors import BadInput
from rigtwin.review.application import Review
from rigtwin.review.described import OpenLab
from rigtwin.review.guard import Guard

HOST = "127.0.0.1"
HEAD_START = 1.0  # [s], for opening the first clip; a browser that starts meanwhile would slow both down
GRACE = 1  # [s], for answers under way when the server ends


def serve(
    lab: Path,
    announce: Callable[[str], None],
    *,
    port: int | None = None,
    browser: bool = True,
    allow_outside: bool = False,
) -> None:
    """Serve the page of a lab until it is interrupted.

    Parameters
    ----------
    lab : Path
        Folder with a lab.toml, the lab.toml itself, or a photo or clip of a lab, which is shown first.
    announce : callable
        Called with the address of the page when it can be opened.
    port : int, optional
        Port on this machine; a free one by default.
    browser : bool
        Whether to open the page in a browser.
    allow_outside : bool
        Whether the lab may name files outside its folder.

    Raises
    ------
    BadLabFile
        If lab.toml is not valid.
    BadInput
        If the port is taken.
    """
    path, place = _lab_and_place(lab, allow_outside=allow_outside)
    with closing(_listening(port)) as listener, closing(Review(path, allow_outside=allow_outside)) as review:
        bound, token = listener.getsockname()[1], secrets.token_urlsafe(24)
        address = f"http://{HOST}:{bound}/?token={token}{place}"
        ahead = threading.Thread(target=review.look_ahead, daemon=True)
        ahead.start()
        ahead.join(HEAD_START)
        config = uvicorn.Config(
            Guard(review.application, bound, token),
            log_level="error" if os.environ.get("RIGTWIN_DEBUG") else "critical",
            access_log=False,
            server_header=False,
            lifespan="off",
            timeout_graceful_shutdown=GRACE,
        )

        class Announced(uvicorn.Server):
            """States its address once it serves, so that Ctrl-C then closes it like any other time."""

            async def startup(self, sockets: list[socket.socket] | None = None) -> None:
                await super().startup(sockets=sockets)
                announce(address)
                if browser:
                    threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

        Announced(config).run(sockets=[listener])


def _lab_and_place(given: Path, *, allow_outside: bool) -> tuple[Path, str]:
    """The lab.toml, and the part of the address that names the photo or clip to show first; empty for any."""
    if not given.is_file() or given.suffix == ".toml":
        path = given / "lab.toml" if given.is_dir() else given
        OpenLab.read(path, allow_outside=allow_outside)
        return path, ""
    for folder in given.absolute().parents:
        path = folder / "lab.toml"
        if path.is_file():
            lab = OpenLab.read(path, allow_outside=allow_outside)
            for place, view in lab.all_views():
                if view.resolve() == given.resolve():
                    return path, f"#{place}"
            break
    raise BadInput(
        f"{given}: no lab.toml above it names it; start a lab with `rigtwin init DIR` and name this file under "
        "repetitions there."
    )


def _listening(port: int | None) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.bind((HOST, port or 0))
        listener.listen()
    except OSError as error:
        listener.close()
        why = (error.strerror or "cannot be used").lower()
        raise BadInput(f"--port: {port}: {why}; leave it out to use a free one.") from None
    return listener
