"""The tables of a result directory as a workbook: points, parameters, analyses, provenance, the study."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.registry import table_of
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.main_results import factor_names
from tripod_doe.page_parts.tables import factor_rows, fixed_rows
from tripod_doe.page_parts.words import factor_unit, unit_text
from tripod_doe.page_parts.xlsx_file import MOST_COLUMNS, Sheet, workbook
from tripod_doe.reports.study_report import read_analyses
from tripod_doe.study.result_directory.annotation import read_annotation
from tripod_doe.study.result_directory.open_cube import is_shown, opened_cube, opened_study

_KNOWN = ("title", "question", "source", "study_hash", "kernel_source_hash", "model_notes", "design_notes", "history")
_MOST_PARTS = 60  # numbers per point of a variable that become columns; waveforms have more, and stay in the cube


def tables_of(directory: Path) -> bytes:
    """The workbook of a result directory.

    Raises:
        CubeError: If the cube or an analysis is missing or damaged.
        InputError: If it has more points than a sheet has rows.
    """
    analyses = read_analyses(directory) if is_shown(directory) else {}
    about = read_annotation(directory)
    with opened_study(directory) as cube:
        sheets = [_points(cube), _parameters(cube), *_of_analyses(analyses)]
        said = {"name": about.name, "owner": about.owner, "tags": ", ".join(about.tags), "note": about.note}
        lines = str(cube.attrs.get("study", "")).splitlines()
        study = Sheet("Study", ("Study file",), [(line,) for line in lines])
        return workbook([*sheets, provenance(cube.attrs, said), study])


def answer_workbook(path: str | Path, columns: Mapping[str, Any], asked: Mapping[str, str]) -> bytes:
    """The workbook of an answer to a query.

    Args:
        path: The queried result directory or cube.
        columns: The answer, as `records` gives it.
        asked: The parts of the query by name.

    Raises:
        InputError: If it has more rows than a sheet.
    """
    values = [column.tolist() for column in columns.values()]
    with opened_cube(path) as cube:
        units = [unit_text(str(cube[name].attrs.get("units", "1"))) if name in cube else "" for name in columns]
        return workbook(
            [Sheet("Answer", list(columns), list(zip(*values, strict=True)), units), provenance(cube.attrs, asked)]
        )


def provenance(attributes: Mapping[Any, Any], further: Mapping[str, str]) -> Sheet:
    """The origin of the numbers, one line per fact.

    Args:
        attributes: Attributes of the cube.
        further: Further facts by name.
    """
    rows = [(name, text) for name, text in further.items() if text]
    rows += [(name, str(attributes[name])) for name in _KNOWN if attributes.get(name)]
    versions = json.loads(str(attributes.get("package_versions", "{}")))
    return Sheet("Provenance", ("What", "Value"), [*rows, *versions.items()])


def _points(cube: xr.Dataset) -> Sheet:
    """A row for each point: its factors, its outcome, all its numbers except waveforms."""
    dims, count = cube["outcome"].dims, cube["outcome"].size
    columns: list[tuple[str, str, list[Any]]] = []
    for name in factor_names(cube):
        values = cube[name].broadcast_like(cube["outcome"]).transpose(*dims).values.ravel()
        columns.append((name, factor_unit(cube, name), values.tolist()))
    columns.append(("outcome", "", [Outcome(code).label for code in cube["outcome"].values.ravel().tolist()]))
    columns.append(("outcome_detail", "", [str(text) for text in cube["outcome_detail"].values.ravel().tolist()]))
    for output, variable in cube.data_vars.items():
        own = [dim for dim in variable.dims if dim not in dims]
        parts = int(np.prod([variable.sizes[dim] for dim in own], dtype=int))
        if variable.dtype.kind not in "fiu" or str(output).startswith("outcome") or not 0 < parts <= _MOST_PARTS:
            continue
        if "flag_values" in variable.attrs or not set(dims) <= set(variable.dims):
            continue
        table = variable.transpose(*dims, *own).values.reshape(count, parts)
        labels = [_label(cube, own, at, [variable.sizes[dim] for dim in own]) for at in range(parts)]
        unit = unit_text(str(variable.attrs.get("units", "1")))
        columns += [(f"{output}{label}", unit, table[:, at].tolist()) for at, label in enumerate(labels)]
    columns = columns[:MOST_COLUMNS]
    heads, units, values = zip(*columns, strict=True)
    return Sheet("Points", heads, list(zip(*values, strict=True)), units)


def _label(cube: xr.Dataset, dims: list[Any], at: int, sizes: list[int]) -> str:
    """The labels of one part of a variable, written as in a formula: ``[3]`` for order 3."""
    if not dims:
        return ""
    places = np.unravel_index(at, sizes)
    words = [
        str(cube[dim].values[place]) if dim in cube.coords else str(place)
        for dim, place in zip(dims, places, strict=True)
    ]
    return f"[{', '.join(words)}]"


def _parameters(cube: xr.Dataset) -> Sheet:
    grouped = [row for _, rows in fixed_rows(cube) for row in rows]
    rows = [(row.name, row.value, row.unit, row.meaning, row.source) for row in (*factor_rows(cube), *grouped)]
    return Sheet("Parameters", ("Parameter", "Value", "Unit", "Meaning", "Source"), rows)


def _of_analyses(analyses: Mapping[str, xr.Dataset]) -> Iterator[Sheet]:
    """The table of each analysis; without a table, one sheet per set of dimensions, without waveforms."""
    for name, result in analyses.items():
        if table := table_of(result):
            heads, rows = table
            yield Sheet(name, [str(head) for head in heads], [[str(cell) for cell in row] for row in rows])
            continue
        alike: dict[tuple[Any, ...], list[Any]] = {}
        for variable, values in result.data_vars.items():
            if values.dtype.kind in "fi" and values.dims and max(values.shape) <= _MOST_PARTS:
                alike.setdefault(values.dims, []).append(variable)
        for dims, variables in alike.items():
            frame = result[variables].to_dataframe().reset_index()[[*dims, *variables]]
            units = [unit_text(str(result[column].attrs.get("units", "1"))) for column in variables]
            yield Sheet(name, [str(head) for head in frame.columns], frame.values.tolist(), [*[""] * len(dims), *units])
