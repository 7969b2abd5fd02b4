"""Routes about views: figures of cubes for Plotly, and single points with their figures."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from starlette.responses import HTMLResponse, Response

from tripod_doe.service import questions
from tripod_doe.service.explorer.view import MEANINGS
from tripod_doe.service.routes.dependencies import CHANGES, IN_SANDBOX, REFUSALS, AnyService, errors_at, gives

_VIEW = {
    "parameters": [
        {"name": n, "in": "query", "schema": {"type": "string"}, "description": m} for n, m in MEANINGS.items()
    ]
}

At = Annotated[
    str, Query(description="factor values from the answer about a point; finds it after the study has grown")
]

router = APIRouter(prefix="/runs/{run_id}", responses=REFUSALS | errors_at(404, 409))


@router.get("/figure", response_class=Response, openapi_extra=_VIEW)
def figure(run_id: str, request: Request, service: AnyService, step: str | None = None) -> Response:
    """A view of a cube as a figure for Plotly; the cube decides what the query leaves out."""
    items = list(request.query_params.multi_items())
    return Response(questions.figure(service, run_id, items, step), media_type="application/json")


@router.get("/points/{number}/motion", response_class=Response, responses=gives("text/html") | CHANGES)
def motion(run_id: str, number: int, service: AnyService, at: At = "", step: str | None = None) -> Response:
    """A page that moves the joint at one point, which is simulated again with its contacts; not for who only reads."""
    return HTMLResponse(questions.motion(service, run_id, number, at, step), headers=IN_SANDBOX)


@router.get("/points/{number}")
def point(run_id: str, number: int, service: AnyService, at: At = "", step: str | None = None) -> dict[str, Any]:
    """One point: its factors, how it ended, its numbers, and figures of the rest for Plotly."""
    return questions.point(service, run_id, number, at, step)
