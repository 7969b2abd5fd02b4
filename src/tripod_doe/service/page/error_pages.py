"""Answers to refused requests: a page for a browser, JSON for a program."""

from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, Response

from tripod_doe.service.page.rendering import show
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.settings import Settings

_OF_PROGRAMS = ("/api/", "/assets/", "/parts/")


def refusal_answer(request: HTTPConnection, refusal: RefusedError, settings: Settings, root: str) -> Response:
    """The answer to a refused request: a page for a browser, else JSON; `root` is empty without a session."""
    if not _is_page(request):
        return JSONResponse(refusal.answer(), refusal.status, refusal.headers)
    message = "; ".join(problem.message for problem in refusal.problems)
    page = show("error.html", settings, root=root, status=refusal.status, message=message)
    page.status_code = refusal.status
    page.headers.update(refusal.headers)
    return page


def _is_page(request: HTTPConnection) -> bool:
    """Whether a browser opens this address, not a program or a script of the page."""
    path = str(request.scope["path"]).removeprefix(request.scope["root_path"])
    return "text/html" in request.headers.get("accept", "") and not path.startswith(_OF_PROGRAMS)
