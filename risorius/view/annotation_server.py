"""`risorius view --annotation`: a page in which annotations are corrected by hand."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any

from aiohttp import web

from aam.model_file import read_model
from risorius.page.local_site import Handler, LocalSite, answer, page_files
from risorius.view.annotation_residual import MeanResidual, ModelResidual, Residual
from risorius.view.annotation_state import (
    JPEG_QUALITY,
    AnnotationFolder,
    OpenAnnotation,
    description,
    shown,
)
from runtime.image_ops import jpeg

PARTS = ("panel.css", "annotation.css", "annotation.js")


def view_annotations(
    path: Path,
    pictures: Path | None,
    model: Path | None,
    port: int,
    announce: Callable[[str], None],
) -> None:
    """Serve the page until interrupted.

    path: a folder of annotations, or the JSON file of one.  pictures: where to look for pictures
        that are not where they were; None: nowhere else.
    model: a trained model, by which the residual is shown; None: by the folder's mean.
    port: TCP port on this host; 0: any free one.
    announce: called with the page's address once it can be opened.
    Raises `UserError` if there are no annotations, or the port is taken.
    """
    folder = AnnotationFolder(path, pictures)
    residual: Residual
    if model is not None:
        residual = ModelResidual(read_model(model))
    else:
        residual = MeanResidual(folder.path, folder.names)
    folder.open(folder.names[0])
    asyncio.run(_serve(port, _Annotations(folder, residual), announce))


async def _serve(port: int, shown: "_Annotations", announce: Callable[[str], None]) -> None:
    async with LocalSite(shown.pages()) as site:
        await site.open(port)
        announce(site.address)
        await asyncio.Event().wait()


class _Annotations:
    """What the page asks for; the fits are made in threads, one at a time."""

    def __init__(self, folder: AnnotationFolder, residual: Residual) -> None:
        self._folder, self._residual, self._lock = folder, residual, Lock()
        self._last: OpenAnnotation | None = None

    def pages(self) -> dict[tuple[str, str], Handler]:
        """Handlers by page: of all annotations, of one, of its picture; to fit, to save."""

        async def described(request: web.Request) -> web.Response:
            return _json(description(self._folder, self._residual.name))

        async def stored(request: web.Request) -> web.Response:
            return _json(await asyncio.to_thread(self.stored, _name(request)))

        async def picture(request: web.Request) -> web.Response:
            data = await asyncio.to_thread(self.picture, _name(request))
            return answer(data, "image/jpeg")

        def corrects(is_saved: bool) -> Handler:
            async def corrected(request: web.Request) -> web.Response:
                values = _parsed(await request.read())
                name = _name(request)
                return _json(await asyncio.to_thread(self.corrected, name, values, is_saved))

            return corrected

        return {
            **page_files("risorius.view", "annotation.html", PARTS),
            ("GET", "annotations.json"): described,
            ("GET", "annotation.json"): stored,
            ("GET", "picture.jpg"): picture,
            ("POST", "fit"): corrects(False),
            ("POST", "save"): corrects(True),
        }

    def picture(self, name: str) -> bytes:
        """What the page shows of a picture, JPEG."""
        with self._lock:
            return jpeg(self._open(name).view.picture, JPEG_QUALITY)

    def stored(self, name: str) -> dict[str, Any]:
        """An annotation as its files hold it, see `shown`."""
        with self._lock:
            self._last = None
            opened = self._open(name)
            return shown(opened, opened.present, self._residual)

    def corrected(self, name: str, values: dict[str, Any], is_saved: bool) -> dict[str, Any]:
        """An annotation with what the page has set, see `OpenAnnotation.corrected`."""
        with self._lock:
            opened = self._open(name)
            corrected = opened.corrected(values)
            if is_saved:
                self._folder.save(opened, corrected)
            return shown(opened, corrected, self._residual)

    def _open(self, name: str) -> OpenAnnotation:
        if self._last is None or self._last.original.name != name:
            self._last = self._folder.open(name)
        return self._last


def _json(values: dict[str, Any]) -> web.Response:
    return answer(json.dumps(values).encode(), "application/json")


def _name(request: web.Request) -> str:
    return request.query.get("name", "")


def _parsed(body: bytes) -> dict[str, Any]:
    values = json.loads(body or b"null")
    if not isinstance(values, dict):
        raise ValueError("this is no correction: not an object")
    return values
