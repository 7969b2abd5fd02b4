"""Addresses for writing a study: text and form side by side, the price, and studies to start from."""

from fastapi import APIRouter
from starlette.responses import HTMLResponse

from tripod_doe.service.page.rendering import part, show
from tripod_doe.service.requests.forms import FieldChange, StudyText
from tripod_doe.service.requests.gallery import gallery, gallery_upload, study_of_joint
from tripod_doe.service.requests.uploads import main_file
from tripod_doe.service.routes.dependencies import Body, WritingService
from tripod_doe.study.definition.toml_text import parse_toml

router = APIRouter(include_in_schema=False)

_FORM = "requests.study_form:study_form"


@router.get("/new")
def new(
    service: WritingService,
    study: str = "",
    origin: str = "",
    contributions: str = "",
    point: int = 0,
    at: str = "",
    step: str | None = None,
    joint: str = "",
    candidate: int | None = None,
) -> HTMLResponse:
    """Write a study, starting from the gallery, an earlier run, a point's contributions, or the joint of a search."""
    if joint:
        search, run = service.upload_of(joint), service.runs.find(joint)
        file = parse_toml(search.get(run.kind, ""), main_file(run.kind))
        text = study_of_joint(run.shown_name, service.base_of(joint, candidate), candidate, file)
        upload = {"study": text, "files": {}}
    elif contributions:
        path = str(service.results(contributions, step))
        study_text = service.ask("explorer.what_if:contribution_study", path=path, number_of_point=point, at=at)
        upload = {"study": study_text, "files": {}}
    else:
        upload = service.upload_of(origin) if origin else gallery_upload(study or "template-grid")
    text = str(next(text for kind, text in upload.items() if kind != "files"))
    form = service.ask(_FORM, study=text) if "study" in upload else None
    return show(
        "new.html",
        service.settings,
        here="/new",
        text=text,
        form=form,
        files=upload["files"],
        gallery=gallery(),
        chosen=study or origin or contributions or joint,
        extended=None,
    )


@router.get("/runs/{run_id}/extend")
def extend(run_id: str, service: WritingService) -> HTMLResponse:
    """Write a larger version of a run's study, with the price of the new points."""
    run = service.runs.refuse_extension(run_id)
    upload = service.upload_of(run_id)
    form = service.ask(_FORM, study=upload["study"])
    values = {"text": upload["study"], "form": form, "files": upload["files"]}
    return show("new.html", service.settings, gallery=[], chosen=run_id, extended=run, **values)


@router.post("/parts/form")
def form(body: Body, service: WritingService) -> HTMLResponse:
    """The form of a text."""
    return HTMLResponse(part("study_form.html", form=service.ask(_FORM, fields=service.fields_of(body, StudyText))))


@router.post("/parts/change")
def change(body: Body, service: WritingService) -> dict[str, str]:
    """The text after a field was changed."""
    return {"study": service.ask("requests.study_form:changed_text", fields=service.fields_of(body, FieldChange))}


@router.post("/parts/runs/{run_id}/price")
def price_of_extension(run_id: str, body: Body, service: WritingService) -> HTMLResponse:
    """The price, in words, of the additions of a larger study or of variables by formula."""
    return HTMLResponse(part("price.html", plan=service.plan_extension(run_id, body)))


@router.post("/parts/price")
def price(body: Body, service: WritingService) -> HTMLResponse:
    """The price in words."""
    return HTMLResponse(part("price.html", plan=service.plan(body)))
