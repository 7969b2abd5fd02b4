"""Routes about runs: submit, list, watch, stop, resume, delete."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Query, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent
from starlette.responses import PlainTextResponse

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.forms import Derivation, ExtensionPlan, RunChange, RunRecord, Submission
from tripod_doe.service.routes.dependencies import (
    CHANGES,
    REFUSALS,
    AnyService,
    AskedRuns,
    Body,
    PageNumber,
    WritingService,
    errors_at,
    gives,
    takes,
)
from tripod_doe.service.runs.listing import page_of
from tripod_doe.service.runs.processes import LOG, run_log

router = APIRouter(responses=REFUSALS)

_HEARTBEAT = 15.0  # seconds of silence on a stream
_KEY_LETTERS = 200


InBin = Annotated[bool, Query(description="what is in the bin")]
LastEventId = Annotated[str | None, Header(alias="Last-Event-ID")]


@router.post("/runs", status_code=201, responses=CHANGES, openapi_extra=takes(Submission))
def submit(
    body: Body,
    service: WritingService,
    response: Response,
    idempotency_key: Annotated[str | None, Header(max_length=_KEY_LETTERS)] = None,
) -> RunRecord:
    """Put a study, workflow, fit or optimisation into the queue; with the same Idempotency-Key, it is the same run."""
    run = service.submit(body, idempotency_key)
    response.headers["location"] = f"/api/v1/runs/{run.id}"
    return RunRecord(**run.record())


@router.get("/runs", response_model=list[RunRecord])
async def list_runs(asked: AskedRuns, service: AnyService, page: PageNumber = None, bin: InBin = False) -> Response:
    """Runs, the newest first: the texts that their watchers get. All that pass the filter, or one page of them.

    The header X-Total-Count counts the runs that pass.
    """
    if bin:
        passed = asked.select(service.runs.in_bin())
        texts = [json.dumps(run.record(), allow_nan=False) for run in passed]
    else:
        service.found.look_soon()
        passed = asked.select(service.runs.all())
        texts = [service.runs.events.latest(run.id) for run in passed]
    if page is not None:
        texts = page_of(texts, page)
    headers = {"x-total-count": str(len(passed))}
    return Response(f"[{','.join(text for text in texts if text)}]", media_type="application/json", headers=headers)


async def _stream_slot(service: AnyService) -> AsyncIterator[None]:
    """Count a stream until its answer ends; count it before it begins, the last moment to refuse it."""
    most, events = service.settings.limits.streams, service.runs.events
    if events.streams >= most:
        raise RefusedError(503, f"{most:,} event streams are open, the limit here")
    events.streams += 1
    try:
        yield
    finally:
        events.streams -= 1


async def _is_run(run_id: str, service: AnyService) -> None:
    service.runs.find(run_id)


@router.get("/events", response_class=EventSourceResponse, dependencies=[Depends(_stream_slot)])
async def watch_all(
    service: AnyService,
    last_event_id: LastEventId = None,
    after: Annotated[str | None, Query(max_length=100, description="in place of Last-Event-ID")] = None,
) -> AsyncIterator[ServerSentEvent]:
    """The object of every run whenever it changes, in one stream; ``deleted`` events name runs that are gone."""
    async for event in _stream(service, None, last_event_id or after):
        yield event


@router.get("/runs/{run_id}", responses=errors_at(404), response_model=RunRecord)
async def show_run(run_id: str, service: AnyService) -> Response:
    """One run: the text that its watchers get, as this is asked for most."""
    service.runs.find(run_id)
    return Response(service.runs.events.latest(run_id), media_type="application/json")


@router.get(
    "/runs/{run_id}/events",
    response_class=EventSourceResponse,
    responses=errors_at(404),
    dependencies=[Depends(_is_run), Depends(_stream_slot)],
)
async def watch_run(
    run_id: str, service: AnyService, last_event_id: LastEventId = None
) -> AsyncIterator[ServerSentEvent]:
    """The object of a run whenever it changes; Last-Event-ID goes on where a stream broke off."""
    async for event in _stream(service, run_id, last_event_id):
        yield event


async def _stream(service: AnyService, run_id: str | None, last_event_id: str | None) -> AsyncIterator[ServerSentEvent]:
    events = service.runs.events
    async for event in events.watch(run_id, last_event_id, _HEARTBEAT):
        if not service.is_open():  # the link was revoked meanwhile
            return
        if event is None:
            yield ServerSentEvent(comment="still here")
        elif event.text is None:
            yield ServerSentEvent(data={"id": event.run_id}, event="deleted", id=events.name_of(event))
        else:
            yield ServerSentEvent(raw_data=event.text, id=events.name_of(event))


@router.post("/runs/{run_id}/stop", responses=CHANGES | errors_at(404))
def stop(run_id: str, service: WritingService) -> RunRecord:
    """Stop a run: what is finished is kept."""
    return RunRecord(**service.runs.stop(run_id).record())


@router.post("/runs/{run_id}/resume", responses=CHANGES | errors_at(404))
def resume(run_id: str, service: WritingService) -> RunRecord:
    """Run what is missing; of a finished run, make damaged files again. Finished points are kept."""
    return RunRecord(**service.resume(run_id).record())


@router.post("/runs/{run_id}/retry-failed", responses=CHANGES | errors_at(404))
def retry_failed(run_id: str, service: WritingService) -> RunRecord:
    """Run failed points again."""
    return RunRecord(**service.runs.resume(run_id, retry_failed=True).record())


@router.post("/runs/{run_id}/extend", responses=CHANGES | errors_at(404), openapi_extra=takes(Submission))
def extend(run_id: str, body: Body, service: WritingService) -> RunRecord:
    """Run a study that grew on the results of this run: its new and its missing points are computed."""
    return RunRecord(**service.extend(run_id, body).record())


@router.post("/runs/{run_id}/derive", responses=CHANGES | errors_at(404), openapi_extra=takes(Derivation))
def derive(run_id: str, body: Body, service: WritingService) -> RunRecord:
    """Add variables by formula to the results of a study; finished points do not run again, missing ones run."""
    return RunRecord(**service.derive(run_id, body).record())


@router.post(
    "/runs/{run_id}/plans",
    responses=CHANGES | errors_at(404),
    response_model=dict[str, Any],
    openapi_extra=takes(ExtensionPlan),
)
def plan_extension(run_id: str, body: Body, service: WritingService) -> Response:
    """Price of what a larger study, or variables by formula, add to the results of a run; nothing is kept.

    ``new_points`` counts them, and ``cpu_seconds`` is theirs alone.
    """
    return Response(service.plan_extension(run_id, body, as_json=True), media_type="application/json")


@router.get("/runs/{run_id}/plan", responses=errors_at(404))
def plan_of_run(run_id: str, service: AnyService) -> dict[str, Any]:
    """The price of a run when it was submitted, and its choice of models where a pilot makes one."""
    return service.plan_of(run_id)


@router.get("/runs/{run_id}/upload", responses=errors_at(404))
def upload_of_run(run_id: str, service: AnyService) -> dict[str, Any]:
    """What was submitted, as it can be submitted again."""
    return service.upload_of(run_id)


@router.get("/runs/{run_id}/steps", responses=errors_at(404))
async def steps_of_run(run_id: str, service: AnyService) -> list[dict[str, Any]]:
    """The steps of a workflow, or the stages of a search, with their states and times; none for a study.

    The search of an optimisation has ``generations`` with candidates, feasible ones and the best objectives so far.
    """
    return [dict(step) for step in service.runs.find(run_id).steps]


@router.get("/runs/{run_id}/log", response_class=Response, responses=gives("text/plain") | errors_at(404))
def log_of_run(run_id: str, service: AnyService) -> PlainTextResponse:
    """What the latest process of a run said."""
    return PlainTextResponse(run_log(service.directory(run_id, LOG)))


@router.delete("/runs/{run_id}", status_code=204, responses=CHANGES | errors_at(404))
def delete(run_id: str, service: WritingService, bin: InBin = False) -> None:
    """Put a run into the bin, where its results are kept for some weeks; with `bin`, remove them from there."""
    service.runs.delete(run_id, from_bin=bin)


@router.post("/runs/{run_id}/restore", responses=CHANGES | errors_at(404))
def restore(run_id: str, service: WritingService) -> RunRecord:
    """Take a run out of the bin."""
    return RunRecord(**service.runs.restore(run_id).record())


@router.patch("/runs/{run_id}", responses=CHANGES | errors_at(404), openapi_extra=takes(RunChange))
def change(run_id: str, body: Body, service: WritingService) -> RunRecord:
    """Change the name, the owner, the tags or the note of a run, in ``about.toml`` of its directory."""
    return RunRecord(**service.runs.annotate(run_id, service.ask_body("changes", body)).record())


@router.get("/runs/{run_id}/diff/{other_id}", responses=errors_at(404, 409), response_model=dict[str, Any])
def diff(
    run_id: str,
    other_id: str,
    service: AnyService,
    variable: Annotated[list[str], Query(description="variable to compare; repeatable")] = [],  # noqa: B006
) -> Response:
    """What differs between two runs: the object of `tripod-doe diff --format json`."""
    return Response(service.diff(run_id, other_id, variable), media_type="application/json")
