"""Routes that need no run: schemas, limits, prices, and one simulated point."""

from importlib.metadata import version
from typing import Annotated, Any

from fastapi import APIRouter, Query
from starlette.responses import Response

from tripod_doe.service.requests.forms import Health, PlanRequest
from tripod_doe.service.routes.dependencies import CHANGES, REFUSALS, AnyService, Body, takes

router = APIRouter(responses=REFUSALS)

_VERSION = version("tripod-doe")  # read from a file


@router.get("/health")
async def health() -> Health:
    """Whether the server answers; needs no token."""
    return Health(status="ok", version=_VERSION)


@router.get("/limits")
async def limits(service: AnyService) -> dict[str, Any]:
    """What requests, studies and the queue may ask for."""
    return {"limits": service.settings.limits.described()}


@router.get("/schema/study")
def study_schema(scene: Annotated[str, Query(description="scene whose studies they are")] = "joint") -> dict[str, Any]:
    """JSON Schema of study files of a scene."""
    from tripod_doe.study.definition.json_schema import study_schema

    return study_schema(scene)


@router.get("/schema/workflow")
def workflow_schema() -> dict[str, Any]:
    """JSON Schema of workflow files."""
    from tripod_doe.workflow.workflow_file import workflow_schema

    return workflow_schema()


@router.post("/plans", responses=CHANGES, response_model=dict[str, Any], openapi_extra=takes(PlanRequest))
def plan(body: Body, service: AnyService) -> Response:
    """Points, blocks, bytes and CPU seconds of a study, a workflow, a fit or an optimisation; nothing is kept."""
    return Response(service.plan(body, as_json=True), media_type="application/json")


@router.post("/simulate", responses=CHANGES, response_model=dict[str, Any], openapi_extra=takes(None))
def simulate(body: Body, service: AnyService) -> Response:
    """One point by its parameters, with ``scene`` for another scene than the joint: as `simulate --format json`."""
    asked: dict[str, Any] = {"body": body, "limits": service.settings.limits}
    return Response(service.compute("workers.answers:simulate", as_json=True, **asked), media_type="application/json")
