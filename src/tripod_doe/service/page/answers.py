"""What people look at: each function puts a question of the explorer or of `study_form` to a process that answers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.service import Service
from tripod_doe.service.uploads import main_file

Items = Sequence[tuple[str, str]]


def explore(service: Service, run_id: str, items: Items, step: str | None = None) -> dict[str, Any]:
    """What a view of a run's cube can be changed to."""
    place, minus = str(service.results(run_id, step)), _subtracted(items)
    name = service.runs.find(minus).name if minus else ""
    told: dict[str, Any] = service.look("explore", path=place, items=items, place=place, minus_name=name)[0]
    return told


def figure(service: Service, run_id: str, items: Items, step: str | None = None) -> bytes:
    """A view of a run's cube as JSON of a figure for Plotly."""
    minus = _subtracted(items)
    other = str(service.results(minus)) if minus else None
    return service.look("figure", path=str(service.results(run_id, step)), items=items, other=other)[1]


def numbers(service: Service, run_id: str, items: Items, step: str | None = None) -> dict[str, Any]:
    """The cells of a view as texts."""
    minus = _subtracted(items)
    other = str(service.results(minus)) if minus else None
    told: dict[str, Any] = service.look("numbers", path=str(service.results(run_id, step)), items=items, other=other)[0]
    return told


def _subtracted(items: Items) -> str:
    """Id of the run that a view subtracts, empty where it subtracts none."""
    minus = dict(items).get("minus", "")
    return "" if "=" in minus else minus


def failures(service: Service, run_id: str, step: str | None = None) -> dict[str, Any]:
    """The failed points of a run."""
    told: dict[str, Any] = service.look("failures", path=str(service.results(run_id, step)))[0]
    return told


def results(service: Service, run_id: str, order: int | None, step: str | None = None) -> list[dict[str, Any]]:
    """Results of a run's analyses in sentences and tables."""
    told: list[dict[str, Any]] = service.look("results", paths=service.analysis_files(run_id, step), order=order)[0]
    return told


def behind(service: Service, run_id: str, name: str, variable: str, cell: int, step: str | None = None) -> Items:
    """The address of the points behind a number of an analysis."""
    files = service.analysis_files(run_id, step)
    if name not in files:
        raise RefusedError(404, f"analysis: {name[:100]}: not made")
    found = service.look(
        "behind", result=files[name], cubes=service.studies_behind(run_id, name, step), variable=variable, cell=cell
    )[0]
    return [*([("step", found["step"])] if found["step"] else []), *map(tuple, found["items"])]


def parameters(service: Service, scene: str) -> list[list[str]]:
    """Parameters of a scene with their defaults as texts."""
    told: list[list[str]] = service.look("parameters", scene=scene)[0]
    return told


def study_form(service: Service, text: str) -> dict[str, Any]:
    """A study file as the fields of a form."""
    told: dict[str, Any] = service.look("study_form", text=text)[0]
    return told


def changed_text(service: Service, text: str, key: str, value: str) -> str:
    """The text of a study file after one field of its form was changed."""
    told: str = service.look("changed_text", text=text, key=key, value=value)[0]
    return told


def point(service: Service, run_id: str, number: int, step: str | None = None) -> dict[str, Any]:
    """One point of a run, with its figures."""
    place = str(service.results(run_id, step))
    told: dict[str, Any] = service.look("point", path=place, number_of_point=number)[0]
    return told


def price_of_point(service: Service, scene: str, parameters: dict[str, Any]) -> dict[str, Any]:
    """What one point will cost, before it is simulated."""
    told: dict[str, Any] = service.look("price_of_point", scene=scene, parameters=parameters)[0]
    return told


def contribution_study(service: Service, run_id: str, number: int, step: str | None = None) -> str:
    """A study of the contributions of the mechanisms at one point."""
    place = str(service.results(run_id, step))
    told: str = service.look("contribution_study", path=place, number_of_point=number)[0]
    return told


def lay_over(service: Service, run_id: str, measurement: str, settings: dict[str, Any]) -> dict[str, Any]:
    """A measurement over a point of a run, in words and figures."""
    place = str(service.results(run_id))
    told: dict[str, Any] = service.look("lay_over", path=place, measurement=measurement, **settings)[0]
    return told


def submitted(service: Service, run_id: str) -> dict[str, str]:
    """The texts that a run was submitted with, the study or the workflow first."""
    upload = service.upload_of(run_id)
    kind = next(name for name in upload if name != "files")
    return {main_file(kind): upload[kind], **upload["files"]}
