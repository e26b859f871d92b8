"""What the server of the page answers at which address."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from rigtwin.lab.camera import Camera
from rigtwin.lab.errors import BadInput
from rigtwin.lab.file.lab_edit import LabEdit
from rigtwin.lab.quantity import Measurement
from rigtwin.review.compared import result_file
from rigtwin.review.described import OpenLab, beside_json, has_twin_in_step, kind_of, result_json
from rigtwin.review.frames import Pictures, version_of
from rigtwin.review.guard import refusal
from rigtwin.review.remeasure import Remeasuring

STATIC = Path(__file__).parent / "static"

REPORT_POLICY = (
    "default-src 'none'; img-src 'self' data:; media-src 'self' data:; style-src 'unsafe-inline'; font-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""For reports that earlier commands wrote: their styles stand in the page itself, scripts do not run."""

LARGEST_REQUEST = 64 * 2**10  # [bytes], of a change

Outcome = TypeVar("Outcome")

Endpoint = Callable[[Request], Awaitable[Response]]


class Review:
    """The answers for one lab.

    Parameters
    ----------
    path : Path
        Its lab.toml.
    allow_outside : bool
        Whether the lab may name files outside its folder.
    """

    def __init__(self, path: Path, *, allow_outside: bool = False) -> None:
        self.path = path
        self.allow_outside = allow_outside
        self.edit = LabEdit(path, allow_outside)
        self.pictures = Pictures()
        self.measuring = Remeasuring()
        self._one_change = asyncio.Lock()
        self._reading = threading.Lock()
        self._read: tuple[int, int, OpenLab] | None = None

    @property
    def application(self) -> Starlette:
        """The ASGI application; to be set behind a `rigtwin.review.guard.Guard`."""
        place = "{experiment:int}/{repetition:int}"
        return Starlette(
            routes=[
                Route("/", _page),
                Route("/api/lab", self._answers(self.lab)),
                Route("/api/set", self._answers(self.set), methods=["POST"]),
                Route("/api/undo", self._answers(self.undo), methods=["POST"]),
                Route(f"/api/result/{place}", self._answers(self.result)),
                Route(f"/api/twin/{place}", self._answers(self.twin)),
                Route(f"/api/media/{place}/{{view:int}}", self._answers(self.media)),
                Route(f"/frame/{place}/{{view:int}}/{{index:int}}", self._answers(self.frame)),
                Route("/results/{name:path}", self._answers(self.result_file)),
                Mount("/static", StaticFiles(directory=STATIC)),
            ]
        )

    def close(self) -> None:
        self.pictures.close()
        self.measuring.close()

    def look_ahead(self) -> None:
        """Open the first clip or photo, and decode its first frame, before the page asks for it."""
        with suppress(BadInput, OSError, LookupError):
            lab = self.opened()
            number = next(k for k, one in enumerate(lab.lab.experiments) if one.with_rejected)
            experiment, view = lab.lab.experiments[number], lab.views(number, 0)[0]
            kind = kind_of(experiment, view)
            if kind in ("photo", "clip"):
                self.pictures.info(view, experiment.camera_of(view), photo=kind == "photo")

    def opened(self) -> OpenLab:
        """The lab as it stands on disk; read again only when lab.toml has changed."""
        with self._reading:
            state = self.path.stat()
            if self._read is None or self._read[:2] != (state.st_mtime_ns, state.st_size):
                lab = OpenLab.read(self.path, allow_outside=self.allow_outside)
                self._read = state.st_mtime_ns, state.st_size, lab
            return self._read[2]

    async def lab(self, _request: Request) -> Response:
        """The experiments, their repetitions and what is stated of them."""
        lab = await run_in_threadpool(self.opened)
        return JSONResponse({**lab.to_json(), "can_undo": self.edit.can_undo})

    async def set(self, request: Request) -> Response:
        """Write one key of lab.toml."""
        change = await _body(request)
        experiment, key, value, file = (change.get(name) for name in ("experiment", "key", "value", "file"))
        if (
            isinstance(experiment, bool)
            or not isinstance(experiment, int)
            or not isinstance(key, str)
            or not isinstance(file, str | None)
            or not _writable(value)
        ):
            raise BadInput("this is no change of lab.toml; load the page again.")
        async with self._one_change:
            await run_in_threadpool(self.edit.set, experiment, key, value, file=file)
        return await self.lab(request)

    async def undo(self, request: Request) -> Response:
        """Take the last change back."""
        async with self._one_change:
            await run_in_threadpool(self.edit.undo)
        return await self.lab(request)

    async def result(self, request: Request) -> Response:
        """The measurement of a repetition, as soon as it is there."""
        lab = await run_in_threadpool(self.opened)
        number, repetition = request.path_params["experiment"], request.path_params["repetition"]
        views = lab.measured_views(number, repetition)
        key, started = await run_in_threadpool(self.measuring.measured, lab.lab.experiments[number], views)
        done = await _outcome(started)
        return JSONResponse(result_json(key, done, views, lab.views(number, repetition)))

    async def twin(self, request: Request) -> Response:
        """The twin of a measured repetition, as soon as it has run."""
        lab = await run_in_threadpool(self.opened)
        number, repetition = request.path_params["experiment"], request.path_params["repetition"]
        views, experiment = lab.measured_views(number, repetition), lab.lab.experiments[number]
        if not has_twin_in_step(experiment) or kind_of(experiment, views[0]) != "clip":
            raise LookupError
        _, started = await run_in_threadpool(self.measuring.measured, experiment, views)
        measured = (await _outcome(started)).found
        if not isinstance(measured, Measurement):
            raise BadInput(f"{experiment.id}: there is no twin of what could not be measured.")
        running = await run_in_threadpool(self.measuring.in_step, experiment, lab.lab.model, measured)
        return JSONResponse(beside_json(await _outcome(running)))

    async def media(self, request: Request) -> Response:
        """Size and capture times of a clip or photo."""
        medium, camera, photo = await self._medium(request)
        info = await run_in_threadpool(self.pictures.info, medium, camera, photo=photo)
        return JSONResponse(
            {
                "width": info.width,
                "height": info.height,
                "times": [round(time, 6) for time in info.times],
                "playback_rate": info.playback_rate,
                "version": version_of(medium, camera),
            }
        )

    async def frame(self, request: Request) -> Response:
        """A photo, or one frame of a clip."""
        medium, camera, photo = await self._medium(request)
        index = request.path_params["index"]
        near = "near" in request.query_params
        shown, data = await run_in_threadpool(self.pictures.picture, medium, camera, index, photo=photo, near=near)
        # the first picture goes before the processes that measure, whose start takes all of the processor
        started = BackgroundTask(self.measuring.warm_up)
        kept = {} if near else {"cache-control": "private, max-age=600"}
        return Response(data, media_type="image/jpeg", headers={**kept, "x-frame": str(shown)}, background=started)

    async def result_file(self, request: Request) -> Response:
        """A file that an earlier command wrote into the lab's folder of results."""
        file = result_file(self.path.parent, request.path_params["name"])
        return FileResponse(file, headers={"content-security-policy": REPORT_POLICY})

    async def _medium(self, request: Request) -> tuple[Path, Camera, bool]:
        """The clip or photo that is asked for, its camera, and whether it is a photo."""
        lab = await run_in_threadpool(self.opened)
        number = request.path_params["experiment"]
        view = lab.views(number, request.path_params["repetition"])[request.path_params["view"]]
        experiment = lab.lab.experiments[number]
        kind = kind_of(experiment, view)
        if kind not in ("photo", "clip"):
            raise BadInput(f"{view}: holds no pictures.")
        return view, experiment.camera_of(view), kind == "photo"

    def _answers(self, endpoint: Endpoint) -> Endpoint:
        """Errors in one sentence, as on the command line."""

        @wraps(endpoint)
        async def answer(request: Request) -> Response:
            try:
                return await endpoint(request)
            except BadInput as error:
                return refusal(str(error), 422)
            except LookupError:
                return refusal("there is no such thing in this lab; load the page again.", 404)
            except OSError as error:
                said = f"{error.filename or self.path}: {(error.strerror or 'cannot be used').lower()}."
                return refusal(said, 422)
            except Exception as error:
                if os.environ.get("RIGTWIN_DEBUG"):
                    raise
                reason = f"{type(error).__name__}: {error}".splitlines()[0]
                said = f"a fault of rigtwin itself ({reason}); set RIGTWIN_DEBUG=1 and start the page again."
                return refusal(said, 500)

        return answer


async def _outcome(started: Future[Outcome]) -> Outcome:
    """Wait for what a process does."""
    try:
        return await asyncio.shield(asyncio.wrap_future(started))
    except asyncio.CancelledError:
        if not started.cancelled():  # the server ends
            raise
        raise BadInput("the work on this repetition was stopped; choose it again.") from None


async def _page(_request: Request) -> Response:
    return FileResponse(STATIC / "index.html")


async def _body(request: Request) -> dict[str, Any]:
    content = bytearray()
    async for part in request.stream():
        content += part
        if len(content) > LARGEST_REQUEST:
            raise BadInput("this change is too large; change one thing at a time.")
    with suppress(ValueError):  # no JSON, or no text
        change = json.loads(content)
        if isinstance(change, dict):
            return change
    raise BadInput("this is no change of lab.toml; load the page again.")


def _writable(value: Any) -> bool:
    """Whether a value is one that a key can hold."""
    if isinstance(value, list):
        return all(isinstance(each, str) for each in value)
    return isinstance(value, str | float | int | None)
