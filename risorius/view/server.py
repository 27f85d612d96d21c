"""`risorius view`: one local page with a slider for every actuator, drawn by the real renderer.

page -> request -> the newest of each page -> actor -> JPEG.  Requests come to an event loop in a
thread of its own; all drawing is done on the thread that calls `view`, since a GL context belongs
to one.
"""

import asyncio
import json
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Condition
from typing import Any

import numpy as np
from aiohttp import web

from risorius.animation.animate import Actor, open_actor, side_light
from risorius.animation.animation_script import AnimationState, parse_script
from risorius.page.access import HEADERS
from risorius.page.local_site import LocalSite, answer, fixed, page_files
from risorius.page.loop_thread import LoopThread
from risorius.view.view_state import page_description, state_from_query
from runtime.image_ops import jpeg
from shared_model.arrays import Picture
from shared_model.errors import UserError
from shared_model.parameters import clip_eau

JPEG_QUALITY = 92
FILES = ["panel.css", "view.css", "blink.js", "muscle_rows.js", "view.js"]
NAP_S = 0.2
# The generic head's studio: a head fills the picture at the distance of a portrait.
STUDIO = {"width": 720, "height": 800, "distance_mm": 1000, "focal_px": 2750, "mottle": 0}


@dataclass(frozen=True, slots=True)
class RenderRequest:
    """A picture to draw; `picture` becomes JPEG bytes, or None if a newer request replaces it."""

    state: AnimationState
    picture: Future[bytes | None] = field(default_factory=Future)


class RequestQueue:
    """Requests that wait: of each page the newest alone."""

    def __init__(self) -> None:
        self._waiting: dict[str, RenderRequest] = {}
        self._changed = Condition()

    def ask(self, page: str, state: AnimationState) -> "Future[bytes | None]":
        """The picture to come; None if the same page has asked for another since.

        It fails with `UserError` if it cannot be drawn.
        """
        request = RenderRequest(state)
        with self._changed:
            older = self._waiting.pop(page, None)
            self._waiting[page] = request
            self._changed.notify()
        if older is not None:
            older.picture.set_result(None)
        return request.picture

    def pages(self) -> set[str]:
        """The pages whose picture is not being drawn yet."""
        with self._changed:
            return set(self._waiting)

    def take(self) -> RenderRequest:
        """Wait for the next picture to draw: pages take turns."""
        with self._changed:
            while not self._waiting:
                # With a time limit: a Ctrl-C just before the wait would not end it.
                self._changed.wait(NAP_S)
            return self._waiting.pop(next(iter(self._waiting)))


def view(call_file: Path | None, port: int, announce: Callable[[str], None]) -> None:
    """Serve the page until interrupted.

    call_file: whose face; None: the generic head.  port: TCP port on this host; 0: any free one.
    announce: called with the page's address once it can be opened.
    Raises `UserError` if the call has no person, there is no EGL, or the port is taken.
    """
    studio = parse_script(STUDIO, Path())
    with ExitStack() as stack:
        actor = open_actor(studio, call_file)
        stack.callback(actor.close)
        requests = RequestQueue()
        loop = LoopThread()
        stack.callback(loop.close)
        camera = actor.geometry(studio.at(0)).camera
        caller = None if call_file is None else call_file.name
        site = _site(requests, page_description(camera.width, camera.height, caller))
        loop.run(site.open(port))
        stack.callback(lambda: loop.run(site.close()))
        announce(site.address)
        while True:
            serve(requests.take(), actor)


def serve(request: RenderRequest, actor: Actor) -> None:
    """Draw the picture of a request, or answer it with the error."""
    try:
        # Of a person sliders at 0 are the face of their typical picture: its skin has the folds of
        # that expression, and any other one would be a grimace.
        state = replace(request.state, eau=clip_eau(actor.rest_eau + request.state.eau))
        picture = _lit(actor.draw(state, actor.geometry(state)), state)
    except UserError as error:
        request.picture.set_exception(error)
        return
    request.picture.set_result(jpeg(picture, JPEG_QUALITY))


def _lit(picture: Picture, state: AnimationState) -> Picture:
    if state.brightness == 1 and state.side == 0:
        return picture
    light = state.brightness * side_light(picture.shape[1], state.side)
    return np.asarray(np.clip(picture * light[:, None], 0, 255), dtype=np.uint8)


def _site(requests: RequestQueue, described: dict[str, Any]) -> LocalSite:
    """The page, the model's description, and pictures."""

    async def picture(request: web.Request) -> web.Response:
        # The client: the name that a page gives itself, else the connection.
        peer = request.transport and request.transport.get_extra_info("peername")
        page = request.headers.get("X-Page") or str(peer)
        state = state_from_query(request.query_string)
        data = await asyncio.wrap_future(requests.ask(page, state))
        if data is None:
            return web.Response(status=204, headers=HEADERS)
        return answer(data, "image/jpeg")

    return LocalSite(
        {
            **page_files("risorius.view", "view.html", FILES),
            ("GET", "model.json"): fixed(json.dumps(described).encode(), "application/json"),
            ("GET", "picture.jpg"): picture,
        }
    )
