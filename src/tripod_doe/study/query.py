"""Questions to a cube: choose cells by value, by range or by a condition, and get them as labelled records."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.errors import InputError, near_match
from tripod_doe.simulator import Outcome
from tripod_doe.study.expressions import Expression
from tripod_doe.study.netcdf import open_cube

__all__ = ["Selection", "frame_text", "narrowed", "parse_selection", "query", "to_frame"]

_MATCH = 1e-9


@dataclass(frozen=True)
class Selection:
    """One ``--select``: a coordinate, and the values or the range that it may take."""

    name: str
    values: tuple[float | str, ...] = ()
    low: float = -math.inf
    high: float = math.inf


def parse_selection(text: str) -> Selection:
    """Parse ``name=value``, ``name=a,b,c`` or ``name=a:b`` (either end may be left out).

    Raises
    ------
    InputError
        If the text has another form.
    """
    name, equals, wanted = text.partition("=")
    name = name.strip().replace("-", "_")
    if not equals or not name or not wanted:
        raise InputError(f"--select {text!r}: write name=value, name=a,b,c or name=a:b")
    if ":" in wanted:
        try:
            low, high = (float(end) if end.strip() else None for end in wanted.split(":"))
        except ValueError as error:
            raise InputError(f"--select {text!r}: a range is two numbers, a:b") from error
        return Selection(name, (), -math.inf if low is None else low, math.inf if high is None else high)
    return Selection(name, tuple(_word(part.strip()) for part in wanted.split(",")))


def _word(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def query(
    cube: xr.Dataset | str | Path,
    variable: str,
    select: Sequence[Selection | str] = (),
    nearest: bool = False,
    where: str | None = None,
) -> xr.Dataset:
    """Choose cells of one variable.

    Parameters
    ----------
    cube
        An open cube, or where it is.
    variable
        The variable that is asked for.
    select
        Values, lists or ranges of coordinates. Values match to 1e-9 relative.
    nearest
        Take the nearest value of a coordinate where none matches.
    where
        Condition on coordinates, scalar variables, the variable itself and ``outcome`` (by its label).

    Returns
    -------
    xarray.Dataset
        The variable, the outcome of its points where the cube has one, and ``selected``: whether a cell meets `where`.

    Raises
    ------
    InputError
        If a name is unknown, with the nearest known one. An empty answer is no error.
    """
    data = open_cube(cube) if not isinstance(cube, xr.Dataset) else cube
    if variable not in data.data_vars:
        raise InputError(f"--variable {variable!r}: not in this cube{near_match(variable, map(str, data.data_vars))}")
    names = [variable] + (["outcome"] if "outcome" in data and variable != "outcome" else [])
    chosen = data[names]
    chosen = chosen.drop_vars(
        [name for name in chosen.coords if not set(chosen[name].dims) <= set(chosen[variable].dims)]
    )
    for item in select:
        chosen = _apply(chosen, parse_selection(item) if isinstance(item, str) else item, nearest)
    if where is None:
        return chosen
    return chosen.assign(selected=_condition(where, chosen, data, variable))


def _apply(chosen: xr.Dataset, selection: Selection, nearest: bool) -> xr.Dataset:
    if selection.name not in chosen.coords:
        raise InputError(
            f"--select {selection.name}: not a coordinate here{near_match(selection.name, map(str, chosen.coords))}"
        )
    labels = chosen[selection.name]
    if labels.ndim != 1:
        raise InputError(f"--select {selection.name}: it has one value only, nothing to select")
    values = labels.values
    if values.dtype.kind not in "fiub":
        keep = np.isin(values.astype(str), [str(wanted) for wanted in selection.values])
    elif not selection.values:
        slack = _MATCH * np.abs(values)  # linspace's 0.30000000000000004 lies in 0.1:0.3
        keep = (values >= selection.low - slack) & (values <= selection.high + slack)
    else:
        keep = _matching(values.astype(float), selection, nearest)
    return chosen.isel({str(labels.dims[0]): np.flatnonzero(keep)})


def _matching(values: NDArray[np.float64], selection: Selection, nearest: bool) -> NDArray[np.bool_]:
    keep = np.zeros(values.size, bool)
    for wanted in selection.values:
        if isinstance(wanted, str):
            raise InputError(f"--select {selection.name}={wanted}: it takes numbers")
        match = np.abs(values - wanted) <= _MATCH * max(abs(wanted), 1e-300)
        if nearest and not match.any() and values.size:
            match = values == values[np.argmin(np.abs(values - wanted))]
        keep |= match
    return keep


def _condition(where: str, chosen: xr.Dataset, data: xr.Dataset, variable: str) -> xr.DataArray:
    """Cells that meet the condition, over the dimensions of the variable."""
    target = chosen[variable]
    usable = {str(name): chosen[name] for name in (*chosen.coords, *chosen.data_vars)}
    for name, values in data.data_vars.items():
        if str(name) not in usable and set(values.dims) <= set(target.dims):
            usable[str(name)] = values.reindex_like(target) if values.sizes != target.sizes else values
    if "outcome" in usable:
        usable["outcome"] = _labels(usable["outcome"])
    expression = Expression(where, usable)
    columns = {name: xr.broadcast(target, usable[name])[1].transpose(*target.dims).values for name in usable}
    return xr.DataArray(expression(columns), dims=target.dims)


def _labels(outcome: xr.DataArray) -> xr.DataArray:
    words = np.array([kind.label for kind in Outcome], dtype=object)
    return xr.DataArray(words[outcome.values.astype(int)], dims=outcome.dims)


def narrowed(answer: xr.Dataset) -> xr.Dataset:
    """An answer as a cube: cells that a condition left out are NaN."""
    if "selected" not in answer:
        return answer
    variable = str(next(iter(answer.data_vars)))
    kept = answer[variable].where(answer["selected"])
    return answer.drop_vars("selected").assign({variable: kept})


def to_frame(answer: xr.Dataset) -> pd.DataFrame:
    """Records of an answer: the coordinates by name, the variable, and the outcome by its label."""
    if "outcome" in answer:
        answer = answer.assign(outcome=_labels(answer["outcome"]))
    variable = str(next(iter(answer.data_vars)))
    dims = answer[variable].dims
    frame = (
        answer.to_dataframe(dim_order=list(dims)).reset_index()
        if dims
        else pd.DataFrame({n: [answer[n].item()] for n in answer.data_vars})
    )
    if "selected" in frame:
        frame = frame[frame["selected"]].drop(columns="selected")
    others = [name for name in frame.columns if name not in answer.data_vars]
    tail = [variable] + (["outcome"] if "outcome" in frame and variable != "outcome" else [])
    return frame[others + tail]


def frame_text(answer: xr.Dataset, form: str) -> str:
    """An answer as text: ``table``, ``csv`` or ``json`` (a list of records, NaN as null)."""
    frame = to_frame(answer)
    if form == "json":
        records = [{key: _json_value(value) for key, value in row.items()} for row in frame.to_dict("records")]
        return json.dumps(records)
    if form == "csv":
        buffer = io.StringIO()
        frame.to_csv(buffer, index=False)
        return buffer.getvalue().rstrip("\n")
    return frame.to_string(index=False, float_format=lambda value: f"{value:.6g}") if len(frame) else "no cell matches"


def _json_value(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
