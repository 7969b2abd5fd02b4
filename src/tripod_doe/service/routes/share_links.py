"""Routes for links that open one run for reading; only the server's owner can make, list and revoke them."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query, Request

from tripod_doe.service.requests.forms import NewShare, ShareRecord
from tripod_doe.service.routes.dependencies import CHANGES, REFUSALS, WritingService, errors_at
from tripod_doe.service.runs.run_table import stamp
from tripod_doe.service.security.share_links import Share

router = APIRouter(prefix="/runs/{run_id}/shares", responses=REFUSALS | errors_at(403, 404))

Days = Annotated[int, Query(ge=1, le=365, description="days until the link ends")]


@router.post("", status_code=201, responses=CHANGES)
def share(run_id: str, request: Request, service: WritingService, days: Days = 14) -> NewShare:
    """Make a link that opens this run for reading, and nothing else; its secret is shown this once."""
    made, secret = service.shares.add(service.runs.find(run_id).id, days)
    host = f"{request.scope['scheme']}://{request.headers['host']}"
    return NewShare(**_described(made), address=f"{host}/?share={secret}")


@router.get("")
def shares(run_id: str, service: WritingService) -> list[ShareRecord]:
    """The links to this run that are open, without their secrets."""
    return [ShareRecord(**_described(share)) for share in service.shares.of(service.runs.find(run_id).id)]


@router.delete("/{share_id}", status_code=204, responses=CHANGES)
def revoke(run_id: str, share_id: str, service: WritingService) -> None:
    """End a link, and all sessions that it began."""
    service.shares.revoke(run_id, share_id)


def _described(share: Share) -> dict[str, str]:
    created, expires = (stamp(datetime.fromtimestamp(time, UTC)) for time in (share.created, share.expires))
    return {"id": share.id, "created": created, "expires": expires}
