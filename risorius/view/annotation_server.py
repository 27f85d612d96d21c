"""`risorius view --annotation`: a page in which annotations are corrected by hand."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import SplitResult, parse_qs

from aam.model_file import read_model
from risorius.view.annotation_residual import MeanResidual, ModelResidual, Residual
from risorius.view.annotation_state import (
    AnnotationFolder,
    OpenAnnotation,
    description,
    jpeg,
    shown,
)
from risorius.view.local_page import HTML, JPEG, JSON, TEXT, PageHandler, PageServer
from shared_model.errors import UserError

# Bytes of a request's body at most: every landmark and value takes less.
MOST_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class AnnotationViewOptions:
    """What to show and where.

    path: a folder of annotations, or the JSON file of one.  pictures: where to look for pictures
    that are not where they were.  model: a trained model, by which the residual is shown.
    port: TCP port on this host; 0: any free one.
    """

    path: Path
    pictures: Path | None = None
    model: Path | None = None
    port: int = 0


def view_annotations(options: AnnotationViewOptions, announce: Callable[[str], None]) -> None:
    """Serve the page until interrupted.

    announce: called with the page's address once it can be opened.
    Raises `UserError` if there are no annotations, or the port is taken.
    """
    folder = AnnotationFolder(options.path, options.pictures)
    residual: Residual
    if options.model is not None:
        residual = ModelResidual(read_model(options.model))
    else:
        residual = MeanResidual(folder.path, folder.names)
    folder.open(folder.names[0])
    with _Server(options.port, folder, residual) as server:
        announce(server.access.address)
        server.serve_forever()


class _Server(PageServer):
    def __init__(self, port: int, folder: AnnotationFolder, residual: Residual) -> None:
        self.page = (files("risorius.view") / "annotation.html").read_bytes()
        self._folder, self._residual, self._lock = folder, residual, Lock()
        self._last: OpenAnnotation | None = None
        super().__init__(port, _Handler)

    def described(self) -> dict[str, Any]:
        """See `description`."""
        return description(self._folder, self._residual.name)

    def picture(self, name: str) -> bytes:
        """What the page shows of a picture, JPEG."""
        with self._lock:
            return jpeg(self._open(name).view.picture)

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


class _Handler(PageHandler):
    server: _Server

    def do_GET(self) -> None:
        """The page, what holds for all annotations, one of them, or its picture."""
        where = self.admitted()
        if where is None:
            return
        if where.path == "":
            self.reply(HTTPStatus.OK, HTML, self.server.page)
        elif where.path == "annotations.json":
            self._values(self.server.described)
        elif where.path == "annotation.json":
            self._values(lambda: self.server.stored(_name(where)))
        elif where.path == "picture.jpg":
            self._answer(JPEG, lambda: self.server.picture(_name(where)))
        else:
            self.no_such_page()

    def do_POST(self) -> None:
        """Fit with what the page has set, or save that."""
        where = self.admitted()
        if where is None:
            return
        if where.path not in ("fit", "save"):
            self.close_connection = True
            self.no_such_page()
            return
        is_saved = where.path == "save"
        body = self._body()
        self._values(lambda: self.server.corrected(_name(where), _parsed(body), is_saved))

    def _body(self) -> bytes:
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MOST_BYTES:
            self.close_connection = True
            return b""
        return self.rfile.read(int(length))

    def _values(self, make: Callable[[], dict[str, Any]]) -> None:
        self._answer(JSON, lambda: json.dumps(make()).encode())

    def _answer(self, kind: str, make: Callable[[], bytes]) -> None:
        try:
            body = make()
        except (ValueError, UserError) as error:
            self.reply(HTTPStatus.BAD_REQUEST, TEXT, f"{error}\n".encode())
        else:
            self.reply(HTTPStatus.OK, kind, body)


def _name(where: SplitResult) -> str:
    return parse_qs(where.query).get("name", [""])[0]


def _parsed(body: bytes) -> dict[str, Any]:
    values = json.loads(body or b"null")
    if not isinstance(values, dict):
        raise ValueError("this is no correction: not an object")
    return values
