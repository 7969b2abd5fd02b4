"""Routes about results: cells, cubes, analyses and reports of a run."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.types import Receive, Scope, Send

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.forms import Comparison
from tripod_doe.service.routes.dependencies import CHANGES, REFUSALS, AnyService, Body, errors_at, gives, takes
from tripod_doe.service.service import CHECK_FILE, Service
from tripod_doe.study.result_directory.open_cube import is_shown

router = APIRouter(prefix="/runs/{run_id}", responses=REFUSALS | errors_at(404, 409))

_TYPES = {
    "json": "application/json",
    "csv": "text/csv; charset=utf-8",
    "netcdf": "application/x-netcdf",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
}
Step = Annotated[str | None, Query(description="step of a workflow, or points of a search")]
Analysis = Annotated[str | None, Query(description="analysis of the study, in place of its cube")]


@router.get("/query", response_class=Response, responses=gives(*_TYPES.values()))
def query(
    run_id: str,
    service: AnyService,
    variable: Annotated[str, Query(description="name of the variable")],
    select: Annotated[list[str], Query(description="name=value, name=a,b,c or name=a:b; repeatable")] = [],  # noqa: B006
    nearest: Annotated[bool, Query(description="take the nearest value where none matches")] = False,
    where: Annotated[str | None, Query(description="condition on the cells, as in query --where")] = None,
    format: Literal["json", "csv", "netcdf", "xlsx"] = "json",
    decimal_comma: Annotated[bool, Query(description="csv: commas in numbers, semicolons between them")] = False,
    step: Step = None,
    analysis: Analysis = None,
) -> Response:
    """Cells of a cube or of an analysis: the same records as `tripod-doe query`.

    Of a fit or an optimisation without ``step`` and ``analysis`` the answer (``fit.nc``, ``front.nc``).
    """
    asked: dict[str, Any] = {
        "path": service.cube_path(run_id, step, analysis),
        "variable": variable,
        "select": select,
        "nearest": nearest,
        "where": where,
        "form": format,
        "decimal_comma": decimal_comma,
        "limits": service.settings.limits,
    }
    data = service.ask("workers.answers:small_query", **asked)
    if data is None:
        data = service.ask_large("workers.answers:query", **asked)
    ending = {"netcdf": "nc", "xlsx": "xlsx"}.get(format)
    headers = {"content-disposition": f'attachment; filename="answer.{ending}"'} if ending else {}
    return Response(data, media_type=_TYPES[format], headers=headers)


@router.get("/cube.nc", response_class=Response, responses=gives(_TYPES["netcdf"]))
def cube(run_id: str, service: AnyService, step: Step = None) -> Response:
    """The cube as a netCDF file, also in ranges of bytes; while the study runs, with the points that are finished."""
    return _results(service, service.results(run_id, step), "cube.nc")


@router.get("/cost.nc", response_class=Response, responses=gives(_TYPES["netcdf"]))
def costs(run_id: str, service: AnyService, step: Step = None) -> Response:
    """The costs of the points of the cube, as a netCDF file next to it."""
    return _results(service, service.results(run_id, step), "cost.nc")


def _results(service: Service, directory: Path, name: str) -> Response:
    if is_shown(directory):
        return _file(service, directory / name)
    folder = Path(tempfile.mkdtemp(prefix="tripod-doe-"))
    try:
        service.ask_large(".study.result_directory.open_cube:write_cube_so_far", path=directory, folder=folder)
        return _TemporaryFile(folder / name, media_type=_TYPES["netcdf"], filename=name)
    except BaseException:
        shutil.rmtree(folder)
        raise


@router.get("/cube", response_model=dict[str, Any])
def describe(run_id: str, service: AnyService, step: Step = None, analysis: Analysis = None) -> Response:
    """What the cube holds: dimensions, coordinates with their values, variables with units and flags."""
    path = service.cube_path(run_id, step, analysis)
    return Response(service.ask("workers.answers:describe", as_json=True, path=path), media_type=_TYPES["json"])


@router.get("/analyses", response_model=list[dict[str, Any]])
def analyses(run_id: str, service: AnyService, step: Step = None) -> Response:
    """Analyses with their kind, sentences and table."""
    paths = service.analysis_files(run_id, step)
    return Response(service.ask("workers.answers:analyses", as_json=True, paths=paths), media_type=_TYPES["json"])


@router.get("/base", response_class=Response, responses=gives("text/plain"))
def base(
    run_id: str,
    service: AnyService,
    candidate: Annotated[int | None, Query(ge=0, description="of a front; its knee if omitted")] = None,
) -> PlainTextResponse:
    """The joint that a fit or an optimisation gave, as the table [base] of a study."""
    return PlainTextResponse(service.base_of(run_id, candidate))


@router.post("/compare", responses=CHANGES, response_model=dict[str, Any], openapi_extra=takes(Comparison))
def compare(run_id: str, body: Body, service: AnyService, step: Step = None) -> Response:
    """A measurement next to a point of the cube: the object of `tripod-doe compare --format json`."""
    path, fields = str(service.results(run_id, step)), service.fields_of(body, Comparison)
    answer = service.ask("explorer.uploaded_measurement:compare_upload", as_json=True, path=path, fields=fields)
    return Response(answer, media_type=_TYPES["json"])


@router.get("/analysis/{name}.nc", response_class=Response, responses=gives(_TYPES["netcdf"]))
def analysis(run_id: str, name: str, service: AnyService, step: Step = None) -> Response:
    """The result of an analysis as a netCDF file."""
    return _file(service, service.analysis_file(run_id, name, step))


class _TemporaryFile(FileResponse):
    """A file that is sent in pieces, then removed with its folder, even if the client has left."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            shutil.rmtree(Path(self.path).parent)


def _file(service: Service, path: Path) -> Response:
    if not path.is_file():
        raise RefusedError(404, f"{path.name}: this run has no such file yet")
    service.ask(CHECK_FILE, path=path)
    return FileResponse(path, media_type=_TYPES["netcdf"], filename=path.name)
