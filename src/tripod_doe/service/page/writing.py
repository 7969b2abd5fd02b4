"""Addresses for writing a study: text and form side by side, the price, and studies to start from."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import HTMLResponse

from tripod_doe.service.forms import PlanRequest
from tripod_doe.service.gallery import gallery, gallery_upload
from tripod_doe.service.page import answers
from tripod_doe.service.page.pages import part, show
from tripod_doe.service.routes.access import WritingService

router = APIRouter(include_in_schema=False)


class Text(BaseModel):
    """The text of a study file."""

    model_config = ConfigDict(extra="forbid")

    study: str


class Change(Text):
    """One field of the form, and what it says now."""

    key: str = Field(pattern=r"^(study|design|parameter)\.[a-z0-9_]+$")
    value: str


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
        upload = {"study": answers.contribution_study(service, contributions, point, step), "files": {}}
    else:
        upload = service.upload_of(origin) if origin else gallery_upload(study or "template-grid")
    text = str(upload["study" if "study" in upload else "workflow"])
    form = answers.study_form(service, text) if "study" in upload else None
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
def form(body: Text, service: WritingService) -> HTMLResponse:
    """The form of a text."""
    return HTMLResponse(part("study_form.html", form=answers.study_form(service, body.study)))


@router.post("/parts/change")
def change(body: Change, service: WritingService) -> dict[str, str]:
    """The text after a field was changed."""
    return {"study": answers.changed_text(service, body.study, body.key, body.value)}


@router.post("/parts/price")
def price(body: PlanRequest, service: WritingService) -> HTMLResponse:
    """The price in words."""
    plan = service.plan(body.model_dump(exclude={"timing"}), body.timing)
    return HTMLResponse(part("price.html", plan=plan))
