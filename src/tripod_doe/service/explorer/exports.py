"""A view in other forms: the command, the lines of Python, and the study file that give the same numbers."""

import shlex
from typing import Any

import xarray as xr

from tripod_doe.page_parts.chosen_models import models_used, words_of
from tripod_doe.page_parts.main_results import factor_names, study_tables
from tripod_doe.service.explorer.axes import design_of
from tripod_doe.service.explorer.figures.elements import shown
from tripod_doe.service.explorer.view import View, selected_text
from tripod_doe.study.cube.dataset import COST_VARIABLES, RECORD_ROLE
from tripod_doe.study.definition.toml_text import toml_text

_MOST_ROWS = 500


def query_command(place: str, view: View) -> str:
    """The command that prints the numbers of a view."""
    words = ["tripod-doe", "query", place, "--variable", view.variable]
    for text in view.select:
        words += ["--select", text]
    return shlex.join(words + (["--where", view.where] if view.where else []))


def query_python(place: str, view: View) -> str:
    """Lines of Python that give the numbers of a view as a Dataset."""
    call = [repr(place), repr(view.variable)] + ([f"select={list(view.select)!r}"] if view.select else [])
    call += [f"where={view.where!r}"] if view.where else []
    return f"import tripod_doe as td\n\ntd.query({', '.join(call)})"


def simulate_command(cube: xr.Dataset, point: xr.Dataset) -> str:
    """The command that computes one point again; empty for a point of a user's function."""
    study = study_tables(cube)
    head = study.get("study", {})
    if head.get("function"):
        return ""
    words = ["tripod-doe", "simulate"] + (["--scene", head["scene"]] if head.get("scene", "joint") != "joint" else [])
    for name, value in point_values(cube, point).items():
        words += [f"--{name.replace('_', '-')}", selected_text(value)]
    return shlex.join(words)


def point_values(cube: xr.Dataset, point: xr.Dataset) -> dict[str, Any]:
    """The parameters that one point ended with: base values and factors, a chosen model, what a retry changed."""
    values = {name: value for name, value in study_tables(cube).get("base", {}).items() if value != "auto"}
    values |= {name: point[name].item() for name in factor_names(cube)}
    if answering := models_used(point):
        values["model"] = answering[0]
    if "attempt" in point and int(point["attempt"]) > 0:
        used = {str(name): each for name, each in point.data_vars.items() if each.attrs.get("role") == RECORD_ROLE}
        values |= {
            name.removesuffix("_used"): words_of(each).item() for name, each in used.items() if name.endswith("_used")
        }
    return {name: value for name, value in values.items() if value not in ("", "none") and value == value}


def study_of_view(cube: xr.Dataset, view: View, data: xr.Dataset) -> str:
    """A study file whose points are the points of a view, for the variable of the view.

    Returns:
        TOML; the whole study if the view has too many points for a list, points with empty fields, or does not show
        points of a study.
    """
    whole, study = str(cube.attrs.get("study", "")), study_tables(cube)
    names = factor_names(cube) if design_of(cube) else []
    if not study or not names:
        return whole
    listed = "point" in shown(data).dims
    columns = {
        name: data[name].values.tolist()
        for name in names
        if name in data.coords and (listed or name in shown(data).dims)
    }
    if any(len(column) > _MOST_ROWS or any(value != value for value in column) for column in columns.values()):
        return whole
    fixed = {name: value for name, value in _pinned(cube, view, names).items() if name not in columns}
    design: dict[str, Any] = {"kind": "zip" if listed else "grid"}
    if not listed and (constraints := study.get("design", {}).get("constraints")):  # may name any factor
        design["constraints"] = constraints
        columns, fixed = columns | {name: [value] for name, value in fixed.items()}, {}
    of_study, run = study["study"], study.get("run", {})
    name, base = f"{of_study['name']}: {view.variable}", study.get("base", {})
    document: dict[str, Any] = {
        "study": {"name": name} | _with_keys(of_study, "scene", "function"),
        "base": {name: value for name, value in base.items() if name not in columns} | fixed,
        "factors": {name: {"values": [_number(value) for value in column]} for name, column in columns.items()},
        "design": design if columns else {},
        **_kept(cube, view.variable, study),
        "accuracy": study.get("accuracy", {}),
        "run": _with_keys(run, "retry", "expected_outcomes"),
    }
    return toml_text({key: table for key, table in document.items() if table or key in ("base", "factors")})


def _with_keys(table: dict[str, Any], *keys: str) -> dict[str, Any]:
    return {key: table[key] for key in keys if key in table}


def _kept(cube: xr.Dataset, variable: str, study: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Tables of a study by which its cube has a variable."""
    attributes = cube[variable].attrs if variable in cube else {"formula": ""}
    if "user function" in str(attributes.get("long_name")):
        return {}
    if "formula" in attributes or attributes.get("role") == RECORD_ROLE or variable in COST_VARIABLES:
        return {"responses": study.get("responses", {}), "keep": study.get("keep", {})}
    return {"keep": {"outputs": [variable]}}


def _pinned(cube: xr.Dataset, view: View, names: list[str]) -> dict[str, Any]:
    """Factors that a view fixes at one value."""
    fixed: dict[str, Any] = {}
    for text in view.select:
        name, _, wanted = text.partition("=")
        if name in names and not any(mark in wanted for mark in ":,"):
            fixed[name] = float(wanted) if cube[name].dtype.kind in "fiu" else wanted
    return {name: _number(value) for name, value in fixed.items()}


def _number(value: Any) -> Any:
    return int(value) if isinstance(value, float) and value.is_integer() else value
