"""Questions of pages and views of runs: each function asks a worker."""

from collections.abc import Sequence
from typing import Any

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.runs.listing import names_of
from tripod_doe.service.service import Service

Items = Sequence[tuple[str, str]]
Answer = dict[str, Any]


def explore(service: Service, run_id: str, items: Items, step: str | None = None) -> Answer:
    """Changes that a view of a run's cube allows."""
    place, minus = str(service.results(run_id, step)), _subtracted(items)
    name = names_of(service.runs.all())[service.runs.find(minus).id] if minus else ""
    return service.ask("explorer.answers:explore", path=place, items=items, place=place, minus_name=name)


def figure(service: Service, run_id: str, items: Items, step: str | None = None) -> bytes:
    """A view of a run's cube as JSON of a figure for Plotly."""
    return service.ask("explorer.answers:figure", **_view(service, run_id, items, step))


def numbers(service: Service, run_id: str, items: Items, step: str | None = None) -> Answer:
    """The cells of a view as texts."""
    return service.ask("explorer.answers:numbers", **_view(service, run_id, items, step))


def _view(service: Service, run_id: str, items: Items, step: str | None) -> dict[str, Any]:
    minus = _subtracted(items)
    other = str(service.results(minus)) if minus else None
    return {"path": str(service.results(run_id, step)), "items": items, "other": other}


def _subtracted(items: Items) -> str:
    """Id of the run that a view subtracts; empty if it subtracts no run."""
    minus = dict(items).get("minus", "")
    return "" if "=" in minus else minus


def behind(service: Service, run_id: str, name: str, variable: str, cell: int, step: str | None = None) -> Items:
    """The address of the points behind a number of an analysis."""
    files = service.analysis_files(run_id, step)
    if name not in files:
        raise RefusedError(404, f"analysis: {name[:100]}: not made")
    cubes = service.studies_behind(run_id, name, step)
    answer = service.ask(
        "explorer.analysis_tables:behind", result=files[name], cubes=cubes, variable=variable, cell=cell
    )
    return [*([("step", answer["step"])] if answer["step"] else []), *map(tuple, answer["items"])]


def motion(service: Service, run_id: str, number: int, at: str = "", step: str | None = None) -> str:
    """The page that animates one point of a run."""
    page: str = service.simulate_again(
        "explorer.answers:motion", path=str(service.results(run_id, step)), number_of_point=number, at=at
    )
    return page


def point(service: Service, run_id: str, number: int, at: str = "", step: str | None = None) -> Answer:
    """One point of a run, with its figures."""
    path = str(service.results(run_id, step))
    return service.ask("explorer.answers:point", path=path, number_of_point=number, at=at)
