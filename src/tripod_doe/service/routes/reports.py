"""Routes to reports: pages in a sandbox, and the files they link to."""

from typing import Literal

from fastapi import APIRouter, Request
from starlette.responses import FileResponse, HTMLResponse, RedirectResponse, Response

from tripod_doe.errors import CubeError
from tripod_doe.files.checksum_list import refuse_changed
from tripod_doe.files.regular_files import read_regular
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.routes.dependencies import IN_SANDBOX, REFUSALS, AnyService, errors_at, gives
from tripod_doe.service.security.delivered_files import file_within
from tripod_doe.service.security.tokens import report_key
from tripod_doe.service.service import CHECK_FILE

router = APIRouter(prefix="/runs/{run_id}", responses=REFUSALS | errors_at(404))

_HANDED_ON = {"pdf": "application/pdf", "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"}
Form = Literal["pdf", "html", "xlsx"]
_PAGE = "index.html"
_KINDS = {".html": "text/html; charset=utf-8", ".nc": "application/x-netcdf"}


@router.get("/report", response_class=Response)
async def report_address(run_id: str, request: Request, service: AnyService) -> Response:
    """Leads to the report, one level deeper."""
    service.runs.find(run_id)
    return RedirectResponse(f"{request.scope['root_path']}/api/v1/runs/{run_id}/report/", 307)


@router.get("/report/", response_class=Response, responses=gives("text/html"))
def report(run_id: str, service: AnyService) -> Response:
    """The report, a page in a sandbox; its links lead to pages with a key, as it cannot send the cookie."""
    page = service.directory(run_id, "report") / "report" / _PAGE
    if not page.is_file():
        raise RefusedError(404, "this run has no report yet")
    whole = read_regular(page, service.settings.limits.answer_bytes, CubeError)
    refuse_changed(page, unlisted=True)
    key = report_key(service.settings, run_id)
    start = f'<head><base href="/api/v1/runs/{run_id}/pages/{key}/report/{_PAGE}">'
    return HTMLResponse(whole.replace(b"<head>", start.encode(), 1), headers=IN_SANDBOX)


@router.get("/summary.{form}", response_class=Response, responses=gives("text/html", *_HANDED_ON.values()))
def summary(run_id: str, form: Form, service: AnyService, step: str | None = None) -> Response:
    """The run on one page (pdf, html), or all its tables as a workbook (xlsx)."""
    path = str(service.results(run_id, step))
    data = service.ask_large("workers.answers:handed_on", path=path, form=form)
    if form == "html":
        return HTMLResponse(data, headers=IN_SANDBOX)
    named = {"content-disposition": f'attachment; filename="summary.{form}"'}
    return Response(data, media_type=_HANDED_ON[form], headers=named)


@router.get("/what-if", response_class=Response, responses=gives("text/html"))
def what_if(run_id: str, service: AnyService, step: str | None = None) -> Response:
    """The page that asks the surrogates of a run what if, by itself: sliders, curves and bands."""
    path = str(service.results(run_id, step))
    data = service.ask_large("workers.answers:handed_on", path=path, form="what-if")
    return HTMLResponse(data, headers=IN_SANDBOX)


@router.get("/pages/{key}/{place:path}", response_class=Response, responses=gives(*_KINDS.values()))
def page(run_id: str, key: str, place: str, service: AnyService) -> Response:
    """A page or a cube that a report links to; the report knows the key, which opens nothing else."""
    directory = service.runs.directory(service.runs.find(run_id).id)
    path = file_within(directory, place)
    if path is None or path.suffix not in _KINDS or path.relative_to(directory).parts[0] not in ("report", "steps"):
        raise RefusedError(404, "no such page of this run")
    service.directory(run_id, str(path.parent.relative_to(directory)))
    if path.suffix == ".nc":
        service.ask(CHECK_FILE, path=path)
    else:
        refuse_changed(path, unlisted=True)
    return FileResponse(path, media_type=_KINDS[path.suffix], headers=IN_SANDBOX)
