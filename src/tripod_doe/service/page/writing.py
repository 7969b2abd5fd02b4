"""Addresses for writing a study: text and form side by side, the price, and studies to start from."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import HTMLResponse

from tripod_doe.service.forms import PlanRequest
from tripod_doe.service.gallery import gallery, gallery_text
from tripod_doe.service.page import answers
from tripod_doe.service.page.pages import part, show
from tripod_doe.service.routes.access import WritingService

__all__ = ["router"]

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
def new(service: WritingService, study: str = "", origin: str = "") -> HTMLResponse:
    """Write a study; one of the gallery or of an earlier run to start from."""
    text = answers.submitted(service, origin)["study.toml"] if origin else gallery_text(study or "template-grid")
    form = answers.study_form(service, text)
    return show("new.html", service.settings, here="/new", text=text, form=form, gallery=gallery(),
                chosen=study or origin)  # fmt: skip


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
