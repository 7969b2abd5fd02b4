"""Dependencies of all routes: the service, the body of a request, and the errors that any route may give."""

from __future__ import annotations

from datetime import UTC, date, datetime, time
from typing import Annotated, Any, Literal

from fastapi import Depends, Query, Request
from pydantic import AwareDatetime, BaseModel, Field

from tripod_doe.errors import near_match
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.forms import Errors
from tripod_doe.service.runs.listing import PAGE, RunFilter, Sort
from tripod_doe.service.runs.run_table import State, stamp
from tripod_doe.service.security import content_policy
from tripod_doe.service.security.connections import left_of
from tripod_doe.service.security.guard import API
from tripod_doe.service.service import Service


def errors_at(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Statuses with a list of errors, for the description of a route."""
    return {status: {"model": Errors} for status in statuses}


def gives(*media_types: str) -> dict[int | str, dict[str, Any]]:
    """The answer of a route that is a file, a text or JSON of one of these types."""
    text = {"schema": {"type": "string"}}
    return {200: {"content": {name: {"schema": {}} if name == "application/json" else text for name in media_types}}}


IN_SANDBOX = {"content-security-policy": content_policy.SANDBOX}
"""Headers of pages with inline styles and scripts."""

REFUSALS = errors_at(400, 401, 413, 422, 500, 503)
"""Errors that any route may give."""

CHANGES = errors_at(403, 408, 409, 415)
"""Additional errors of routes that change something."""


async def _service(request: Request) -> Service:  # without async, each request would wait for a thread
    service: Service = request.app.state.service
    access, left = request.scope.get("access"), left_of(request.scope)
    if access is not None and not access.owns:
        service = service.seen_by(access.settings, access.is_open)
    return service if left is None else service.asked_by(left)


async def _body(request: Request) -> bytes:
    body: bytes = request.scope["body"]  # `Guard` has received it
    return body


Body = Annotated[bytes, Depends(_body)]
"""The body of a request; a worker reads it, see `bodies`."""


_EMPTY = (b"", b"{}", b"null")  # the page sends an object with every change


async def refuse_unread(request: Request) -> None:
    """Refuse (422) what a route would leave out in silence: a body, and parameters in the query."""
    route, method = request.scope["route"], request.method.lower()
    described = request.app.openapi()["paths"][API + route.path_format][method]
    known = [each["name"] for each in described.get("parameters", ()) if each["in"] == "query"]
    reads_body = "requestBody" in described or method == "get"
    if not reads_body and request.scope["body"].strip() not in _EMPTY:
        remedy = f"; write {', '.join(known)} into the query" if known else ""
        raise RefusedError(422, f"this address takes no body: leave it out{remedy}")
    if unknown := next((name for name in request.query_params if name not in known), None):
        raise RefusedError(422, f"unknown parameter {unknown[:100]!r} in the query{near_match(unknown, known)}")


def takes(form: type[BaseModel] | None) -> dict[str, Any]:
    """The description of a body that has a form, or is any object."""
    schema = {"type": "object"} if form is None else form.model_json_schema()
    return {"requestBody": {"required": True, "content": {"application/json": {"schema": schema}}}}


AnyService = Annotated[Service, Depends(_service)]
"""The service behind a route."""


async def _writing_service(service: AnyService) -> Service:
    if service.settings.read_only:
        raise RefusedError(403, "this server or this token is read-only")
    return service


WritingService = Annotated[Service, Depends(_writing_service)]
"""The service behind a route that changes something; refused (403) where the server is read-only."""


_EARLIEST, _LATEST = datetime(1970, 1, 2, tzinfo=UTC), datetime(9000, 1, 1, tzinfo=UTC)
Moment = Annotated[
    Annotated[AwareDatetime, Field(ge=_EARLIEST, le=_LATEST)]
    | Annotated[date, Field(ge=_EARLIEST.date(), le=_LATEST.date())]
    | Literal[""],
    Field(union_mode="left_to_right"),
]
"""A day in UTC, YYYY-MM-DD, or a time with its offset; empty where none is asked for."""


def _stamp_of(moment: Moment, time_of_day: time) -> str:
    """A time as runs have it; of a day the given one."""
    if isinstance(moment, datetime):
        return stamp(moment.astimezone(UTC))
    return stamp(datetime.combine(moment, time_of_day, UTC)) if moment else ""


def _asked_runs(
    text: Annotated[str, Query(max_length=200, description="words in name, question, note, tags, factors")] = "",
    tag: Annotated[list[str], Query(description="tag that a run has; repeatable")] = [],  # noqa: B006
    state: Annotated[list[State | Literal[""]], Query(description="state of a run; repeatable: one of them")] = [],  # noqa: B006
    folder: Annotated[str, Query(max_length=200, description="beginning of the name, up to a /")] = "",
    since: Annotated[
        Moment, Query(description="submitted on this day (YYYY-MM-DD in UTC) or at this time, or later")
    ] = "",
    until: Annotated[Moment, Query(description="submitted on this day or at this time, or earlier")] = "",
    sort: Sort = "newest",
) -> RunFilter:
    states, tags = tuple(str(each) for each in state if each), tuple(each for each in tag if each)
    first, last = _stamp_of(since, time.min), _stamp_of(until, time.max)
    return RunFilter(text, tags, states, folder, first, last, sort)


AskedRuns = Annotated[RunFilter, Depends(_asked_runs)]
"""The filter that a request asks for."""

PageNumber = Annotated[int | None, Query(ge=1, le=1_000_000, description=f"page of {PAGE} runs; all if omitted")]
