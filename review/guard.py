"""Answer only the page that was opened with the printed address, in this browser, on this machine."""

from __future__ import annotations

import secrets
from dataclasses import dataclass

from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY = "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; object-src 'none'"

HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}
"""Headers of every answer that does not set them itself."""


def refusal(sentence: str, status: int) -> JSONResponse:
    """A refusal as the page shows it."""
    return JSONResponse({"error": sentence}, status)


@dataclass(frozen=True)
class Guard:
    """An ASGI application behind a token, with a check of Host and Origin.

    Parameters
    ----------
    app : ASGIApp
        What is behind it.
    port : int
        Port of the server.
    token : str
        What the address must carry at the first visit; a cookie carries it from then on.
    """

    app: ASGIApp
    port: int
    token: str

    @property
    def cookie(self) -> str:
        """Name of the cookie; cookies of one machine are shared by all ports."""
        return f"rigtwin-{self.port}"

    @property
    def hosts(self) -> tuple[str, ...]:
        """Names of this server: others reach it only through a name that somebody else has pointed here."""
        return (f"127.0.0.1:{self.port}", f"localhost:{self.port}")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                there = {name.lower() for name, _ in message["headers"]}
                added = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message["headers"] = [*message["headers"], *(pair for pair in added if pair[0] not in there)]
            await send(message)

        answer = self.app if scope["type"] == "http" else refusal("only HTTP is spoken here.", 400)
        if scope["type"] == "http":
            request = HTTPConnection(scope)
            if why := self._refused(request):
                # the address itself is opened by a person, who reads plain text
                kind = PlainTextResponse if request.scope["path"] == "/" else refusal
                answer = kind(why, 403)
            elif "token" in request.query_params:  # out of the address, which is seen on screens and in histories
                answer = RedirectResponse(scope["path"], 303)
                answer.set_cookie(self.cookie, self.token, httponly=True, samesite="strict", path="/")
        await answer(scope, receive, send_with_headers)

    def _refused(self, request: HTTPConnection) -> str:
        """Why a request is not answered; empty if it is."""
        if request.headers.get("host") not in self.hosts:
            return "refused: this page is only there for this machine; open the address that rigtwin printed."
        origin = request.headers.get("origin")
        own = origin in [f"http://{host}" for host in self.hosts]
        reads = request.scope["method"] in ("GET", "HEAD")
        asked_from = request.headers.get("sec-fetch-site", "same-origin")
        visited = request.headers.get("sec-fetch-mode") == "navigate" and request.scope["method"] == "GET"
        if (origin is not None and not own) or (origin is None and not reads):
            return "refused: another page asks; only the page of this server may."
        if asked_from not in ("same-origin", "none") and not visited:
            return "refused: another page asks; only the page of this server may."
        given = request.query_params.get("token") or request.cookies.get(self.cookie, "")
        if not secrets.compare_digest(given.encode(), self.token.encode()):
            return "refused: the token is missing or wrong; open the address that rigtwin printed, with its token."
        return ""
