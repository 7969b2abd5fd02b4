"""What people look at: each function puts a question to a worker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.uploads import main_file
from tripod_doe.service.service import Service

Items = Sequence[tuple[str, str]]
Answer = dict[str, Any]


def explore(service: Service, run_id: str, items: Items, step: str | None = None) -> Answer:
    """What a view of a run's cube can be changed to."""
    place, minus = str(service.results(run_id, step)), _subtracted(items)
    name = service.runs.find(minus).name if minus else ""
    answer: Answer = service.ask("explorer.questions:explore", path=place, items=items, place=place, minus_name=name)
    return answer


def figure(service: Service, run_id: str, items: Items, step: str | None = None) -> bytes:
    """A view of a run's cube as JSON of a figure for Plotly."""
    answer: bytes = service.ask("explorer.questions:figure", **_view(service, run_id, items, step))
    return answer


def numbers(service: Service, run_id: str, items: Items, step: str | None = None) -> Answer:
    """The cells of a view as texts."""
    answer: Answer = service.ask("explorer.questions:numbers", **_view(service, run_id, items, step))
    return answer


def _view(service: Service, run_id: str, items: Items, step: str | None) -> dict[str, Any]:
    minus = _subtracted(items)
    other = str(service.results(minus)) if minus else None
    return {"path": str(service.results(run_id, step)), "items": items, "other": other}


def _subtracted(items: Items) -> str:
    """Id of the run that a view subtracts, empty where it subtracts none."""
    minus = dict(items).get("minus", "")
    return "" if "=" in minus else minus


def failures(service: Service, run_id: str, step: str | None = None) -> Answer:
    """The failed points of a run."""
    answer: Answer = service.ask("explorer.questions:failures", path=str(service.results(run_id, step)))
    return answer


def results(service: Service, run_id: str, order: int | None, step: str | None = None) -> list[Answer]:
    """Results of a run's analyses in sentences and tables."""
    paths = service.analysis_files(run_id, step)
    answer: list[Answer] = service.ask("explorer.analysis_tables:results", paths=paths, order=order)
    return answer


def behind(service: Service, run_id: str, name: str, variable: str, cell: int, step: str | None = None) -> Items:
    """The address of the points behind a number of an analysis."""
    files = service.analysis_files(run_id, step)
    if name not in files:
        raise RefusedError(404, f"analysis: {name[:100]}: not made")
    cubes = service.studies_behind(run_id, name, step)
    found = service.ask(
        "explorer.analysis_tables:behind", result=files[name], cubes=cubes, variable=variable, cell=cell
    )
    return [*([("step", found["step"])] if found["step"] else []), *map(tuple, found["items"])]


def parameters(service: Service, scene: str) -> list[tuple[str, str]]:
    """Parameters of a scene with their defaults as texts."""
    answer: list[tuple[str, str]] = service.ask("explorer.questions:parameters", scene=scene)
    return answer


def study_form(service: Service, body: bytes) -> Answer:
    """A study file as the fields of a form."""
    answer: Answer = service.ask_body("study_form", body)
    return answer


def changed_text(service: Service, body: bytes) -> str:
    """The text of a study file after one field of its form was changed."""
    answer: str = service.ask_body("changed_text", body)
    return answer


def point(service: Service, run_id: str, number: int, step: str | None = None) -> Answer:
    """One point of a run, with its figures."""
    path = str(service.results(run_id, step))
    answer: Answer = service.ask("explorer.questions:point", path=path, number_of_point=number)
    return answer


def price_of_point(service: Service, body: bytes) -> Answer:
    """What one point will cost, before it is simulated."""
    answer: Answer = service.ask_body("price_of_point", body)
    return answer


def contribution_study(service: Service, run_id: str, number: int, step: str | None = None) -> str:
    """A study of the contributions of the mechanisms at one point."""
    path = str(service.results(run_id, step))
    answer: str = service.ask("explorer.what_if:contribution_study", path=path, number_of_point=number)
    return answer


def lay_over(service: Service, run_id: str, body: bytes) -> Answer:
    """A measurement over a point of a run, in words and figures."""
    answer: Answer = service.ask_body("lay_over", body, path=str(service.results(run_id)))
    return answer


def submitted(service: Service, run_id: str) -> dict[str, str]:
    """The texts that a run was submitted with, the study or the workflow first."""
    upload = service.upload_of(run_id)
    kind = next(name for name in upload if name != "files")
    return {main_file(kind): upload[kind], **upload["files"]}
