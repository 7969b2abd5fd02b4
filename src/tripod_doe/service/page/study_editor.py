"""Addresses for writing a study: text and form side by side, the price, and studies to start from."""

from __future__ import annotations

import json

from fastapi import APIRouter
from starlette.responses import HTMLResponse

from tripod_doe.service.page.rendering import part, show
from tripod_doe.service.requests.gallery import gallery, gallery_upload
from tripod_doe.service.routes.dependencies import Body, WritingService

router = APIRouter(include_in_schema=False)


@router.get("/new")
def new(
    service: WritingService,
    study: str = "",
    origin: str = "",
    contributions: str = "",
    point: int = 0,
    step: str | None = None,
) -> HTMLResponse:
    """Write a study: from the gallery, from an earlier run, or on the contributions at a point of one."""
    if contributions:
        path = str(service.results(contributions, step))
        study_text = service.ask("explorer.what_if:contribution_study", path=path, number_of_point=point)
        upload = {"study": study_text, "files": {}}
    else:
        upload = service.upload_of(origin) if origin else gallery_upload(study or "template-grid")
    text = str(upload["study" if "study" in upload else "workflow"])
    form = service.ask_body("study_form", json.dumps({"study": text}).encode()) if "study" in upload else None
    return show(
        "new.html",
        service.settings,
        here="/new",
        text=text,
        form=form,
        files=upload["files"],
        gallery=gallery(),
        chosen=study or origin or contributions,
    )


@router.post("/parts/form")
def form(body: Body, service: WritingService) -> HTMLResponse:
    """The form of a text."""
    return HTMLResponse(part("study_form.html", form=service.ask_body("study_form", body)))


@router.post("/parts/change")
def change(body: Body, service: WritingService) -> dict[str, str]:
    """The text after a field was changed."""
    return {"study": service.ask_body("changed_text", body)}


@router.post("/parts/price")
def price(body: Body, service: WritingService) -> HTMLResponse:
    """The price in words."""
    return HTMLResponse(part("price.html", plan=service.plan(body)))
