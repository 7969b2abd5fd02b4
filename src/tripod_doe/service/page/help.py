"""The documentation behind the link "Help": the site in the installation, or how to get it."""

from fastapi import APIRouter
from starlette.responses import FileResponse, Response

from tripod_doe.documentation import BUILD, INSTALL, site_folder
from tripod_doe.service.page.rendering import show
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.routes.dependencies import AnyService
from tripod_doe.service.security import content_policy
from tripod_doe.service.security.delivered_files import file_within

router = APIRouter(include_in_schema=False)

_KINDS = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".ipynb": "application/json",
    ".js": "text/javascript; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
}


@router.get("/help/{place:path}")
def help_page(place: str, service: AnyService) -> Response:
    """A file of the site; it contains no data of this server's runs, so it needs no token."""
    site = site_folder()
    if site is None:
        return show("help.html", service.settings, root="", install=INSTALL, build=BUILD)
    path = file_within(site, place or "index.html")
    if path is None or path.suffix not in _KINDS:
        raise RefusedError(404, "the documentation has no such page")
    headers = {"content-security-policy": content_policy.DOCUMENTATION, "cache-control": "private, max-age=60"}
    return FileResponse(path, media_type=_KINDS[path.suffix], headers=headers)
