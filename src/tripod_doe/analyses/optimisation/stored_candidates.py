"""Stored candidates of an optimisation: what was said of them, a table of them, and one of them as a joint."""

from typing import Any

import numpy as np
import xarray as xr
from pydantic import ValidationError

from tripod_doe.analyses.optimisation.candidate_text import digits_of_columns
from tripod_doe.analyses.optimisation.optimisation_file import OptimisationFile
from tripod_doe.analyses.optimisation.problem import confirmed_base, pasted
from tripod_doe.errors import CubeError, InputError
from tripod_doe.number_text import interval, number
from tripod_doe.page_parts.words import unit_text, with_brackets
from tripod_doe.study.definition.toml_text import parse_toml

FINDINGS = "findings"
"""Attribute of a front with its sentences, one a line."""

_MOST_ROWS = 200
_MOST_LINES = 12  # candidates that the terminal shows


def findings_in(candidates: xr.Dataset, name: str = "") -> list[str]:
    """The sentences on a front; none of all candidates."""
    return str(candidates.attrs.get(FINDINGS, "")).splitlines()


def names_of(candidates: xr.Dataset, role: str) -> list[str]:
    """Names of the variables, objectives or constraints of stored candidates.

    Raises:
        CubeError: If one of them has no value for each candidate, as in a file of another program.
    """
    of_role = [each for each in candidates.data_vars.values() if str(each.attrs.get("role", "")) == role]
    if wrong := [each.name for each in of_role if each.dims != ("candidate",)]:
        raise CubeError(f"{wrong[0]}: no value for each candidate: this is no result of an optimisation")
    return [str(each.name) for each in of_role]


def candidate_table(candidates: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Candidates with their objectives, constraints and variables, at most 200 of them."""
    shown = [name for role in ("objective", "constraint", "variable") for name in names_of(candidates, role)]
    units = {name: unit_text(str(candidates[name].attrs.get("units", "1"))) for name in shown}
    heads = ["candidate", *(with_brackets(name, unit) for name, unit in units.items())]
    columns = [candidates[name].values[:_MOST_ROWS].tolist() for name in shown]
    return heads, [[str(at), *map(_value_text, row)] for at, row in enumerate(zip(*columns, strict=True))]


def knee_of(front: xr.Dataset) -> int:
    """The candidate at the knee of a stored front, or the best one of a single objective.

    Raises:
        InputError: If the front is empty.
    """
    if not front.sizes["candidate"]:
        raise InputError("the front has no candidate: no joint keeps all limits")
    if "knee" not in front or front["knee"].dims != ("candidate",):
        raise CubeError("knee: no value for each candidate: this is no front of an optimisation")
    return int(np.argmax(front["knee"].values))


def base_of(front: xr.Dataset, candidate: int) -> str:
    """The [base] of a candidate of a stored front, to paste into a study; InputError if there is no such candidate."""
    count = front.sizes["candidate"]
    if not 0 <= candidate < count:
        raise InputError(f"candidate = {candidate}: the front has {count:,}, counted from 0")
    values: dict[str, Any] = {name: front[name][candidate].item() for name in names_of(front, "variable")}
    models = (str(front.attrs.get(key, "")) for key in ("search_model", "model"))
    return pasted(values, confirmed_base(file_of(front).base, *models))


def file_of(candidates: xr.Dataset) -> OptimisationFile:
    """The file of the optimisation to which stored candidates belong; CubeError if it is not with them."""
    try:
        return OptimisationFile.model_validate(parse_toml(str(candidates.attrs["optimisation"]), "optimise.toml"))
    except (KeyError, InputError, ValidationError) as error:
        raise CubeError("the attribute optimisation holds no file of an optimisation: the result is damaged") from error


def front_lines(front: xr.Dataset) -> list[str]:
    """Lines for the terminal, one for each of some candidates of a front."""
    objectives = str(front.attrs["objectives"]).split(", ")
    variables = str(front.attrs["variables"]).split(", ")
    count = front.sizes["candidate"]
    shown = np.unique(np.linspace(0, count - 1, _MOST_LINES).round().astype(int)).tolist() if count else []
    lines = [] if count <= _MOST_LINES else [f"{len(shown)} of the {count:,} candidates of the front:"]
    digits = digits_of_columns(np.stack([front[name].values.astype(float) for name in objectives], axis=1))
    for at in shown:
        one = front.isel(candidate=at)
        errors = [float(one[f"{name}_error"]) if f"{name}_error" in one else 0.0 for name in objectives]
        values = [(float(one[name]), error) for name, error in zip(objectives, errors, strict=True)]
        texts = [
            interval(value, error) if error > 0 else number(value, each)
            for (value, error), each in zip(values, digits, strict=True)
        ]
        aims = ", ".join(f"{name} {text}" for name, text in zip(objectives, texts, strict=True))
        chosen = ", ".join(f"{name} {_value_text(one[name].item())}" for name in variables)
        lines.append(f"candidate {at}: {aims}; {chosen}")
    return lines


def _value_text(value: float | str) -> str:
    """A value of a variable in a few digits, or a word."""
    return value if isinstance(value, str) else number(float(value), 5)
