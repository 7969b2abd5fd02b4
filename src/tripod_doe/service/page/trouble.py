"""Errors as pages, where a person asked for one."""

from __future__ import annotations

from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse

from tripod_doe.service.page.pages import show
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.settings import Settings

_OF_PROGRAMS = ("/api/", "/assets/", "/parts/")


def is_page(request: HTTPConnection) -> bool:
    """Whether a person opens this address in a browser, in place of a program or a script of the page."""
    path = str(request.scope["path"]).removeprefix(request.scope["root_path"])
    return "text/html" in request.headers.get("accept", "") and not path.startswith(_OF_PROGRAMS)


def trouble_page(refusal: RefusedError, settings: Settings, root: str) -> HTMLResponse:
    """What is wrong, in a page; `root` as the request gave it, empty without a session."""
    told = "; ".join(problem.message for problem in refusal.problems)
    page = show("trouble.html", settings, root=root, status=refusal.status, told=told)
    page.status_code = refusal.status
    page.headers.update(refusal.headers)
    return page
