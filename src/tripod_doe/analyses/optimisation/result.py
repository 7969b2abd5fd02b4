"""The results of an optimisation as datasets: the front, and all candidates with the reasons of those left out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.optimisation.measures import Judged
from tripod_doe.analyses.optimisation.neighbours import Neighbours
from tripod_doe.analyses.optimisation.pareto_front import Archive, knee
from tripod_doe.analyses.optimisation.problem import Problem
from tripod_doe.array_types import FloatArray
from tripod_doe.study.definition.responses import ERROR
from tripod_doe.study.query.look_for_sentence import found_rows

_FLAG = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "no yes"}


@dataclass(frozen=True)
class Solved:
    """The result of a search."""

    archive: Archive  # all candidates; the first one is where the search started
    front: Archive  # the front as the model that was asked for judges it, on the sample that confirms
    searched: Judged  # the same candidates as the search judged them
    start: Judged  # the start as the model that was asked for judges it
    confirmed: int  # number of candidates that were judged once more; 0 where the search is the last word
    counts: Mapping[str, int] = field(default_factory=dict)  # points, computed, failed
    ended: tuple[float, ...] = ()  # the best objective, to minimise, of each search from another place
    around: Neighbours | None = None  # of the ends and the knee of the front; None where the front is empty
    # of those that were judged once more where none is feasible: the one nearest to it, and what it breaks
    nearest: tuple[FloatArray, str] | None = None
    polished: float = np.nan  # step around the best candidate at which none is better, as part of a range


@makes_kind("optimisation")
def front_dataset(problem: Problem, solved: Solved) -> xr.Dataset:
    """The front: variables, objectives and constraints of each candidate, with their errors where known."""
    variables = _variables(problem, solved.front)
    aims = solved.front.judged.objectives * problem.signs
    if len(aims):
        flags = np.zeros(len(aims), np.int8)
        flags[knee(aims)] = 1
        variables["knee"] = xr.Variable(
            "candidate",
            flags,
            {"long_name": "whether it is the knee, whose worst objective, scaled from 0 to 1 over the front, is best"}
            | _FLAG,
        )
    if solved.confirmed:
        for at, name in enumerate(problem.objectives):
            attributes = variables[name].attrs | {"long_name": f"{name} in the search", "role": "searched"}
            variables[f"{name}_search"] = xr.Variable("candidate", solved.searched.objectives[:, at], attributes)
    return xr.Dataset(variables, attrs=_attributes(problem, solved))


def found_candidates(problem: Problem, front: xr.Dataset) -> str:
    """The sentence on the candidates of a front that meet the condition of an optimisation; empty without one."""
    condition, first = problem.request.file.optimisation.look_for, next(iter(problem.objectives))
    return found_rows(condition, front, first, problem.variables.names, "candidate", " of the front")


@makes_kind("optimisation")
def candidates_dataset(problem: Problem, solved: Solved) -> xr.Dataset:
    """All candidates that were tried, with the reason of each that is not feasible."""
    variables = _variables(problem, solved.archive)
    feasible = solved.archive.judged.feasible.astype(np.int8)
    variables["feasible"] = xr.Variable(
        "candidate", feasible, {"long_name": "whether it can be built, finishes and keeps all limits"} | _FLAG
    )
    reasons = np.array(solved.archive.judged.reasons, object)
    variables["reason"] = xr.Variable("candidate", reasons, {"long_name": "why it is not feasible"})
    generation = solved.archive.generation.astype(np.int32)
    variables["generation"] = xr.Variable("candidate", generation, {"long_name": "generation in which it was tried"})
    title = f"{problem.request.file.optimisation.name}: candidates"
    return xr.Dataset(variables, attrs=_attributes(problem, solved) | {"title": title})


def _variables(problem: Problem, archive: Archive) -> dict[str, xr.Variable]:
    variables: dict[str, xr.Variable] = {}
    columns = problem.variables.columns(archive.units) if len(archive.units) else {}
    for name in problem.variables.names:
        parameter = problem.simulator.parameters[name]
        column = columns.get(name, np.empty(0))
        whole = column.dtype.kind == "f" and bool((np.isfinite(column) & (column == np.round(column))).all())
        if column.dtype.kind == "i" or (whole and parameter.kind in ("integer", "switch")):
            column = column.astype(np.int32)
        attributes: dict[str, Any] = {"long_name": parameter.meaning, "role": "variable"}
        if column.dtype.kind in "fi":
            attributes["units"] = parameter.unit
        variables[name] = xr.Variable("candidate", column, attributes)
    judged = archive.judged
    kinds: list[tuple[str, Mapping[str, Any], FloatArray, FloatArray]] = [
        ("objective", problem.objectives, judged.objectives, judged.objective_errors),
        ("constraint", problem.constraints, judged.constraints, judged.constraint_errors),
    ]
    for role, tables, values, errors in kinds:
        for at, (name, table) in enumerate(tables.items()):
            attributes = {"units": _unit(problem, table.output), "long_name": _meaning(table), "role": role}
            variables[name] = xr.Variable("candidate", values[:, at], attributes)
            if np.isfinite(errors[:, at]).any():
                text = f"half width of the known error of {name}: numerical, of the model and of the sample"
                variables[f"{name}{ERROR}"] = xr.Variable(
                    "candidate", errors[:, at], {"units": attributes["units"], "long_name": text}
                )
    return variables


def _unit(problem: Problem, output: str) -> str:
    if output in problem.simulator.outputs:
        return problem.simulator.outputs[output].unit
    if output in problem.request.file.responses:
        return problem.request.file.responses[output].unit
    return problem.simulator.parameters[output].unit if output in problem.simulator.parameters else "1"


def _meaning(table: Any) -> str:
    order = "" if table.order is None else f", order {table.order}"
    return f"{table.output}{order}, {table.over or 'nearest to its limit'} over the operating points"


def _attributes(problem: Problem, solved: Solved) -> dict[str, Any]:
    head = problem.request.file.optimisation
    scatter = problem.request.file.scatter
    return (
        {
            "Conventions": "CF-1.8",
            "title": head.name,
            "institution": "tripod_doe",
            "source": f"tripod-doe {version('tripod-doe')}, simulator {problem.simulator.name}",
            "question": head.question,
            "optimisation": problem.request.text,
            "kernel_source_hash": problem.simulator.source_hash,
            "objectives": ", ".join(problem.objectives),
            "goals": ", ".join(table.goal for table in problem.objectives.values()),
            "constraints": ", ".join(problem.constraints),
            "variables": ", ".join(problem.variables.names),
            "operating_points": problem.operating.count,
            "search_model": problem.model,
            "model": problem.confirm,
            "candidates": len(solved.archive.units),
            "feasible_candidates": int(solved.archive.judged.feasible.sum()),
            "confirmed": solved.confirmed,
        }
        | ({"quantile": head.quantile, "scatter": ", ".join(scatter)} if scatter else {})
        | dict(solved.counts)
    )


def base_values(problem: Problem, unit: FloatArray) -> dict[str, Any]:
    """Values of all parameters that a candidate sets, as plain numbers and words."""
    columns = problem.variables.columns(unit[None])
    values = {name: column.tolist()[0] for name, column in columns.items()}
    kinds = problem.simulator.parameters
    return {
        name: int(value)
        if kinds[name].kind in ("integer", "switch") and isinstance(value, float) and value.is_integer()
        else value
        for name, value in values.items()
    }


def best_so_far(archive: Archive, sign: float) -> FloatArray:
    """The best feasible objective after each candidate, shape (candidate,); NaN before the first feasible one."""
    values = np.where(archive.judged.feasible, archive.judged.objectives[:, 0] * sign, np.inf)
    best = np.minimum.accumulate(values)
    return np.where(np.isfinite(best), best * sign, np.nan)
