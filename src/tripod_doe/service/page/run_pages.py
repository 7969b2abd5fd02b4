"""Pages of runs: the list, one run, and the parts that scripts fetch again."""

import json
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from tripod_doe.errors import InputError
from tripod_doe.service import questions
from tripod_doe.service.page.rendering import part, show
from tripod_doe.service.problems import RefusedError, among_runs
from tripod_doe.service.requests.forms import Comparison, PointRequest, Table
from tripod_doe.service.routes.dependencies import AnyService, AskedRuns, Body, PageNumber
from tripod_doe.service.runs.listing import SORTS, folders_of, names_of, page_count, page_of, short_ids, tags_of
from tripod_doe.service.runs.run_end import has_report
from tripod_doe.service.runs.run_table import Run, State
from tripod_doe.service.security.tokens import report_key
from tripod_doe.service.service import Service

router = APIRouter(include_in_schema=False)

_MOST_DIFFERENCES = 60  # rows of a table of results
_KINDS = (("lines", "Lines"), ("map", "Map"), ("points", "Points"), ("matrix", "Matrix"), ("parallel", "Parallel axes"))
_TABS = (
    ("", "Explore"),
    ("analyses", "Analyses"),
    ("report", "Report"),
    ("failed", "Failed points"),
    ("study", "Study"),
)
_WORKFLOW_TABS = (("steps", "Steps"), *_TABS[:3], _TABS[4])
_SEARCH_TABS = (
    ("result", "Result"),
    ("steps", "Progress"),
    ("?step=points", "Explore"),
    *_TABS[2:4],
    ("study", "File"),
)


Order = Annotated[int, Query(ge=0, le=12, description="order of the thrust whose extremes are shown")]


def _listed(
    service: AnyService, request: Request, asked: AskedRuns, order: Order = 3, page: PageNumber = 1, bin: bool = False
) -> dict[str, Any]:
    """Values that a page of the list shows: of all runs, or of those in the bin."""
    service.found.look_soon()
    newest = service.runs.events.newest()  # read before the list, so that later changes arrive as events
    everything = service.runs.in_bin() if bin else service.runs.all()
    passed, page = asked.select(everything), page or 1
    shown = page_of(passed, page)
    query = [(name, value) for name, value in _items(request) if name != "page" and value]
    return {
        "newest": newest,
        "everything": everything,
        "asked": asked,
        "runs": shown,
        "count": len(passed),
        "page": page,
        "pages_of_runs": page_count(passed),
        "query": urlencode(query),
        "in_bin": bin,
        "short_ids": short_ids(passed),
        "order": order,
        "extremes": service.extremes.known(shown, order),
    }


Listed = Annotated[dict[str, Any], Depends(_listed)]


@router.get("/")
def runs(service: AnyService, listed: Listed) -> HTMLResponse:
    """The list of runs, or of those in the bin."""
    everything = listed["everything"]
    choices: dict[str, Any] = {
        "tags": tags_of(everything),
        "folders": folders_of(everything),
        "states": list(State),
        "sorts": SORTS,
    }
    return show("runs.html", service.settings, here="/", **choices, **listed)


@router.get("/parts/runs")
def run_list(service: AnyService, listed: Listed) -> HTMLResponse:
    """The list alone."""
    return _part("run_list.html", service, **listed)


@router.get("/parts/extremes")
def extremes(service: AnyService, asked: AskedRuns, order: Order = 3, page: PageNumber = 1) -> dict[str, bool]:
    """Look up the best and worst points of the runs on a page of the list; tell whether any are new."""
    everything = service.runs.all()
    return {"new": service.extremes.update(page_of(asked.select(everything), page or 1), order, everything)}


@router.get("/parts/runs/{run_id}")
def run_head(run_id: str, service: AnyService) -> HTMLResponse:
    """State, counts and price of a run."""
    return _part("run_head.html", service, run=service.runs.find(run_id))


@router.get("/runs/{run_id}")
def explorer(run_id: str, request: Request, service: AnyService) -> Response:
    """The cube explorer; the query string is the view. For a search without a view, its progress or its result."""
    run = service.runs.find(run_id)
    if run.is_search and not request.query_params:
        return RedirectResponse(
            f"{service.settings.root}/runs/{run.id}/{'steps' if run.counts.missing else 'result'}", 303
        )
    steps = [name for name, step in run.plan.get("steps", {}).items() if "points" in step]
    steps += service.analysis_files(run_id) if run.kind == "optimisation" else []
    begun = (name for name in steps if service.results(run_id, name).exists())
    chosen = request.query_params.get("step") or next(begun, next(iter(steps), None))
    explored, trouble = _explored(service, run, request, chosen)
    return _run_page(
        "explore.html",
        service,
        run,
        "Explore",
        steps=steps,
        chosen_step=chosen,
        trouble=trouble,
        **_control_values(service, run, explored, chosen),
    )


@router.get("/runs/{run_id}/view")
def view(run_id: str, request: Request, service: AnyService) -> dict[str, str]:
    """Controls, copies and title of a view; only a message if no point has finished yet."""
    run = service.runs.find(run_id)
    step = request.query_params.get("step")
    explored = questions.explore(service, run_id, _items(request), step) if _has_ended_points(run) else None
    values = _control_values(service, run, explored, step)
    return {
        "title": explored["title"] if explored else "",
        "controls": part("controls.html", trouble="", **values),
        "exports": part("exports.html", **values),
    }


@router.get("/runs/{run_id}/points/{number}")
def point(run_id: str, number: int, service: AnyService, at: str = "", step: str | None = None) -> dict[str, Any]:
    """One point in words and figures."""
    answer = questions.point(service, run_id, number, at, step)
    text = part(
        "point.html",
        root=service.settings.root,
        point=answer,
        run_id=run_id,
        step=step,
        read_only=service.settings.read_only,
        computes=service.computes,
    )
    return {"html": text} | {name: answer[name] for name in ("figures", "number", "at")}


@router.get("/parts/parameters")
def parameters(scene: str, service: AnyService) -> HTMLResponse:
    """Parameters of a scene as a list to choose from."""
    return _part("parameters.html", service, parameters=service.ask("explorer.answers:parameters", scene=scene))


@router.post("/parts/price-of-point")
def price_of_point(body: Body, service: AnyService) -> dict[str, str]:
    """The price of one point in words, before it is simulated."""
    price = service.ask("explorer.what_if:price_of_point", fields=service.fields_of(body, PointRequest))
    return {"text": part("price_of_point.txt", **price)}


@router.post("/parts/simulate")
def simulate(body: Body, service: AnyService) -> dict[str, Any]:
    """One point simulated, in words and figures."""
    answer = service.compute("explorer.what_if:simulated", fields=service.fields_of(body, PointRequest))
    return {"text": part("simulated.txt", **answer), "figures": answer["figures"]}


@router.get("/runs/{run_id}/numbers")
def numbers(run_id: str, request: Request, service: AnyService) -> HTMLResponse:
    """The cells of a view as a table."""
    shown = questions.numbers(service, run_id, _items(request), request.query_params.get("step"))
    return _part("numbers.html", service, **shown)


@router.get("/runs/{run_id}/analyses")
def analyses(run_id: str, service: AnyService, order: int | None = None, step: str | None = None) -> HTMLResponse:
    """Findings of a run's analyses; each number links to its points."""
    run = service.runs.find(run_id)
    found = service.ask("explorer.analysis_tables:results", paths=service.analysis_files(run_id, step), order=order)
    return _run_page("analyses.html", service, run, "Analyses", analyses=found, step=step, order=order)


@router.get("/runs/{run_id}/behind")
def behind(
    run_id: str, analysis: str, variable: str, cell: int, service: AnyService, step: str | None = None
) -> RedirectResponse:
    """Redirects from a number of an analysis to the view of its points."""
    items = questions.behind(service, run_id, analysis, variable, cell, step)
    return RedirectResponse(f"{service.settings.root}/runs/{service.runs.find(run_id).id}?{urlencode(items)}", 303)


@router.get("/runs/{run_id}/report")
def report(run_id: str, service: AnyService) -> HTMLResponse:
    """The report in its sandbox."""
    run = service.runs.find(run_id)
    written = has_report(service.directory(run_id, "report"))
    return _run_page("report.html", service, run, "Report", written=written, key=report_key(service.settings, run.id))


@router.get("/runs/{run_id}/failed")
def failed(run_id: str, service: AnyService, step: str | None = None) -> HTMLResponse:
    """Points that failed, with their reasons."""
    run = service.runs.find(run_id)
    rows = {"heads": [], "rows": [], "count": 0}
    if run.counts.failed:
        step = step or ("points" if run.is_search else None)
        rows = service.ask("explorer.answers:failures", path=str(service.results(run_id, step)))
    return _run_page("failed.html", service, run, "Failed points", step=step, **rows)


@router.get("/runs/{run_id}/study")
def study(run_id: str, service: AnyService) -> HTMLResponse:
    """The submitted text."""
    run = service.runs.find(run_id)
    tab = "File" if run.is_search else "Study"
    return _run_page("study.html", service, run, tab, texts=service.submitted_texts(run_id))


@router.get("/runs/{run_id}/steps")
def steps(run_id: str, service: AnyService) -> HTMLResponse:
    """The steps of a workflow, or the stages of a search, with states and times."""
    run = service.runs.find(run_id)
    if run.is_search:
        return _run_page("progress.html", service, run, "Progress")
    if run.kind != "workflow":
        raise RefusedError(404, "this run is a study; it has no steps")
    return _run_page("steps.html", service, run, "Steps")


@router.get("/runs/{run_id}/result")
def result(run_id: str, service: AnyService) -> HTMLResponse:
    """The result of a search, and its joint."""
    run = service.runs.find(run_id)
    if not run.is_search:
        raise RefusedError(404, "only fits and optimisations have a result of this kind")
    found: Any = None
    if files := service.analysis_files(run_id):
        place, question = next(iter(files.values())), "explorer.candidates:front"
        if run.kind == "optimisation":
            found = service.ask(question, path=place)
        else:
            found = service.ask("explorer.analysis_tables:results", paths=files, order=None)[0]
    base = service.base_of(run_id) if found and found.get("count", 1) else ""
    return _run_page(f"{run.kind}.html", service, run, "Result", found=found, base=base)


@router.get("/diff")
def diff(service: AnyService, a: str = "", b: str = "") -> HTMLResponse:
    """What differs between two runs."""
    studies = [run for run in service.runs.all() if run.kind == "study"]
    differences, trouble = None, ""
    if a and b:
        try:
            differences = json.loads(service.diff(a, b, []))
        except InputError as error:
            trouble = among_runs(str(error), service.settings.folder)
    names = names_of(studies)
    return show(
        "diff.html",
        service.settings,
        here="/diff",
        names=names,
        chosen=(a, b),
        differences=differences,
        trouble=trouble,
        most=_MOST_DIFFERENCES,
    )


@router.get("/compare")
def compare(service: AnyService, run: str = "") -> HTMLResponse:
    """Upload a measurement and compare it with a point."""
    studies = [other for other in service.runs.all() if other.kind == "study" and other.counts.finished]
    chosen = next((other.id for other in studies if other.id == run), studies[0].id if studies else "")
    axes = questions.explore(service, chosen, [("kind", "parallel")])["design"] if chosen else []
    return show("compare.html", service.settings, here="/compare", names=names_of(studies), chosen=chosen, axes=axes)


@router.post("/parts/runs/{run_id}/compare")
def lay_over(run_id: str, body: Body, service: AnyService) -> dict[str, Any]:
    """A measurement compared with a point, in words and figures."""
    path, fields = str(service.results(run_id)), service.fields_of(body, Comparison)
    found = service.ask("explorer.uploaded_measurement:lay_over", path=path, fields=fields)
    return {"html": part("laid_over.html", **found), "figures": found["figures"], "third": found["third"]}


@router.post("/parts/compare/preview")
def preview(body: Body, service: AnyService) -> dict[str, Any]:
    """Headings and first rows of a measurement."""
    question = "explorer.uploaded_measurement:preview"
    found: dict[str, Any] = service.ask(question, fields=service.fields_of(body, Table))
    return found


def _part(template: str, service: Service, **values: Any) -> HTMLResponse:
    """A part of a page that a script puts into it."""
    own = {"root": service.settings.root, "read_only": service.settings.read_only}
    return HTMLResponse(part(template, **own, **values))


def _run_page(template: str, service: Service, run: Run, tab: str, **values: Any) -> HTMLResponse:
    tabs = _SEARCH_TABS if run.is_search else _WORKFLOW_TABS if run.kind == "workflow" else _TABS
    return show(template, service.settings, run=run, tabs=tabs, tab=tab, **values)


def _items(request: Request) -> list[tuple[str, str]]:
    return list(request.query_params.multi_items())


def _has_ended_points(run: Run) -> bool:
    """Whether any point of a run has ended."""
    return run.counts.total > run.counts.missing


def _explored(service: Service, run: Run, request: Request, step: str | None) -> tuple[dict[str, Any] | None, str]:
    """Changes that the view allows; or a message why there is nothing to see."""
    if not _has_ended_points(run):
        return None, ""
    try:
        return questions.explore(service, run.id, _items(request), step), ""
    except (InputError, RefusedError) as error:
        return None, among_runs(str(error), service.settings.folder)


def _control_values(service: Service, run: Run, explored: dict[str, Any] | None, step: str | None) -> dict[str, Any]:
    kinds = [kind for kind in _KINDS if explored and kind[0] in explored["kinds"]]
    others = [
        other for other in service.runs.all() if other.id != run.id and other.kind == "study" and other.counts.finished
    ]
    return {
        "explored": explored,
        "kinds": kinds,
        "others": names_of(others) if explored and explored["points"] else {},
        "data": f"{service.settings.root}/api/v1/runs/{run.id}",
        "step_items": [("step", step)] if step else [],
    }
