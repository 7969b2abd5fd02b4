"""What people look at: each function puts a question of the explorer or of `study_form` to a process that answers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tripod_doe.service.service import Service
from tripod_doe.service.supervisor import UPLOAD
from tripod_doe.service.uploads import STUDY, WORKFLOW

__all__ = [
    "changed_text", "explore", "failures", "figure", "lay_over", "numbers", "parameters", "point", "study_form",
    "submitted",
]  # fmt: skip

Items = Sequence[tuple[str, str]]


def explore(service: Service, run_id: str, items: Items, step: str | None = None) -> dict[str, Any]:
    """What a view of a run's cube can be changed to."""
    place = str(service.results(run_id, step))
    told: dict[str, Any] = service.look("explore", path=place, items=items, place=place)[0]
    return told


def figure(service: Service, run_id: str, items: Items, step: str | None = None) -> bytes:
    """A view of a run's cube as JSON of a figure for Plotly."""
    minus = dict(items).get("minus")
    other = str(service.results(minus)) if minus else None
    return service.look("figure", path=str(service.results(run_id, step)), items=items, other=other)[1]


def numbers(service: Service, run_id: str, items: Items, step: str | None = None) -> dict[str, Any]:
    """The cells of a view as texts."""
    told: dict[str, Any] = service.look("numbers", path=str(service.results(run_id, step)), items=items)[0]
    return told


def failures(service: Service, run_id: str, step: str | None = None) -> dict[str, Any]:
    """The failed points of a run."""
    told: dict[str, Any] = service.look("failures", path=str(service.results(run_id, step)))[0]
    return told


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


def lay_over(service: Service, run_id: str, measurement: str, settings: dict[str, Any]) -> dict[str, Any]:
    """A measurement over a point of a run, in words and figures."""
    place = str(service.results(run_id))
    told: dict[str, Any] = service.look("lay_over", path=place, measurement=measurement, **settings)[0]
    return told


def submitted(service: Service, run_id: str) -> dict[str, str]:
    """The texts that a run was submitted with, the study or the workflow first."""
    folder = service.runs.directory(run_id) / UPLOAD
    first = WORKFLOW if service.runs.find(run_id).kind == "workflow" else STUDY
    files = sorted(folder.iterdir(), key=lambda file: (file.name != first, file.name))
    return {file.name: file.read_text(encoding="utf-8") for file in files if file.is_file()}
