"""Routes about runs: submit, list, watch, stop, resume, delete."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Header, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent

from tripod_doe.service.forms import RunRecord, Submission
from tripod_doe.service.routes.access import CHANGES, REFUSALS, AnyService, WritingService, errors_at

__all__ = ["router"]

router = APIRouter(responses=REFUSALS)

_HEARTBEAT = 15.0  # seconds of silence on a stream
_KEY_LETTERS = 200

LastEventId = Annotated[str | None, Header(alias="Last-Event-ID")]


@router.post("/runs", status_code=201, responses=CHANGES)
def submit(
    body: Submission,
    service: WritingService,
    response: Response,
    idempotency_key: Annotated[str | None, Header(max_length=_KEY_LETTERS)] = None,
) -> RunRecord:
    """Put a study or a workflow into the queue; sent again with the same Idempotency-Key, it is the same run."""
    run = service.submit(body.model_dump(), idempotency_key)
    response.headers["location"] = f"/api/v1/runs/{run.id}"
    return RunRecord(**run.record())


@router.get("/runs")
async def list_runs(service: AnyService) -> list[RunRecord]:
    """All runs, the newest first."""
    return [RunRecord(**run.record()) for run in service.runs.all()]


@router.get("/events", response_class=EventSourceResponse)
async def watch_all(service: AnyService, last_event_id: LastEventId = None) -> AsyncIterator[ServerSentEvent]:
    """The object of every run whenever it changes, in one stream; ``deleted`` events name runs that are gone."""
    async for event in _stream(service, None, last_event_id):
        yield event


@router.get("/runs/{run_id}", responses=errors_at(404))
async def show_run(run_id: str, service: AnyService) -> RunRecord:
    """One run."""
    return RunRecord(**service.runs.find(run_id).record())


@router.get("/runs/{run_id}/events", response_class=EventSourceResponse, responses=errors_at(404))
async def watch_run(
    run_id: str, service: AnyService, last_event_id: LastEventId = None
) -> AsyncIterator[ServerSentEvent]:
    """The object of a run whenever it changes; Last-Event-ID goes on where a stream broke off."""
    service.runs.find(run_id)
    async for event in _stream(service, run_id, last_event_id):
        yield event


async def _stream(service: AnyService, run_id: str | None, last_event_id: str | None) -> AsyncIterator[ServerSentEvent]:
    events = service.runs.events
    async for event in events.watch(run_id, last_event_id, _HEARTBEAT):
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
    """Run what is missing."""
    return RunRecord(**service.runs.resume(run_id).record())


@router.post("/runs/{run_id}/retry-failed", responses=CHANGES | errors_at(404))
def retry_failed(run_id: str, service: WritingService) -> RunRecord:
    """Run failed points again."""
    return RunRecord(**service.runs.resume(run_id, retry_failed=True).record())


@router.delete("/runs/{run_id}", status_code=204, responses=CHANGES | errors_at(404))
def delete(run_id: str, service: WritingService) -> None:
    """Remove a run with its results."""
    service.runs.delete(run_id)
