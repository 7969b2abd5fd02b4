"""Files of the page: its scripts and styles, the report's style sheet, and Plotly as its wheel ships it."""

import gzip
import hashlib
import threading
from functools import cache
from importlib.resources import files

from fastapi import APIRouter, Request
from starlette.responses import Response

from tripod_doe.service.problems import RefusedError

router = APIRouter(include_in_schema=False)

_TYPES = {"js": "text/javascript; charset=utf-8", "css": "text/css; charset=utf-8", "svg": "image/svg+xml"}
_ELSEWHERE = {
    "plotly.js": ("plotly", "package_data/plotly.min.js"),
    "report.css": ("tripod_doe.page_parts", "page.css"),
}
_KEPT = "private, max-age=31536000, immutable"
_BRIEFLY = "private, max-age=60"
_READING = threading.Lock()  # else hundreds of simultaneous first requests would each read and compress a file


@router.get("/assets/{stamp}/{name}")
def versioned(stamp: str, name: str, request: Request) -> Response:
    """A file whose address names its version."""
    return _answer(name, request, _KEPT)


@router.get("/assets/{name}")
def unversioned(name: str, request: Request) -> Response:
    """A file that the browser requests again from time to time."""
    return _answer(name, request, _BRIEFLY)


def _answer(name: str, request: Request, kept: str) -> Response:
    with _READING:
        data, packed = _read(name)
    headers = {"cache-control": kept, "vary": "accept-encoding"}
    small = "gzip" in request.headers.get("accept-encoding", "")
    if small:
        headers["content-encoding"] = "gzip"
    return Response(packed if small else data, media_type=_TYPES[name.rpartition(".")[2]], headers=headers)


@cache
def stamp() -> str:
    """Part of every file's address: a browser caches the files until one of them changes."""
    own = sorted(file.name for file in files("tripod_doe.service.page").joinpath("assets").iterdir())
    digest = hashlib.sha256()
    for name in [*own, "report.css"]:
        with _READING:
            digest.update(_read(name)[0])
    return digest.hexdigest()[:12]


@cache
def _read(name: str) -> tuple[bytes, bytes]:
    """A file, plain and compressed; `name` is the name of an existing file, never a path."""
    package, inside = _ELSEWHERE.get(name, ("tripod_doe.service.page", f"assets/{name}"))
    known = {file.name for file in files("tripod_doe.service.page").joinpath("assets").iterdir()} | _ELSEWHERE.keys()
    if name not in known:
        raise RefusedError(404, "there is no such file")
    data = files(package).joinpath(inside).read_bytes()
    return data, gzip.compress(data, 6)
