"""The tables of a report: points that did not finish, costs, and the parameters with their sources."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from markupsafe import Markup, escape
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import OUTCOME_MEANINGS, Outcome, Parameter
from tripod_doe.number_text import duration, level_or_word, number, value_range
from tripod_doe.page_parts.chosen_models import models_used
from tripod_doe.page_parts.main_results import asked, computed_once, factor_names, finished, study_tables, waiting
from tripod_doe.page_parts.words import factor_unit, unit_text
from tripod_doe.study.cube.dataset import THIS_STUDY
from tripod_doe.study.cube.slab_reading import largest_magnitude
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.journal import PILOT

_GREEK = {"theta": "θ", "omega": "ω", "mu": "μ", "psi": "ψ", "nu": "ν", "delta": "δ"}


@dataclass(frozen=True)
class OutcomeCount:
    """Number of points with one outcome, and the meaning of that outcome."""

    label: str
    count: int
    meaning: str


@dataclass(frozen=True)
class FailedPoint:
    """A point without results: its position in the design, its factors, outcome and reason."""

    position: int
    inputs: list[str]
    outcome: str
    reason: str


@dataclass(frozen=True)
class ParameterRow:
    """One parameter as the setting lists it."""

    name: str
    symbol: Markup
    value: str
    unit: str
    meaning: str
    source: str
    group: str = ""

    @property
    def assumed(self) -> bool:
        """Whether the paper does not print its value; the source then says what the value rests on, if on anything."""
        return self.source.startswith("assumed")


def outcome_counts(cube: xr.Dataset) -> list[OutcomeCount]:
    """Number of points per outcome; those that a constraint excludes are counted separately."""
    outcome, inside = cube["outcome"].values, asked(cube).values
    counts = [
        OutcomeCount(kind.label, int((outcome[inside] == kind).sum()), OUTCOME_MEANINGS[kind])
        for kind in Outcome
        if (outcome[inside] == kind).any()
    ]
    if not inside.all():
        counts.append(OutcomeCount("excluded", int((~inside).sum()), "excluded by a constraint of the design"))
    return counts


def failed_points(cube: xr.Dataset, most: int = 50, lost: NDArray[np.bool_] | None = None) -> list[FailedPoint]:
    """The first of the points that are `lost`, if omitted those that failed, without those not computed yet."""
    lost = (asked(cube) & ~finished(cube) & ~waiting(cube)).values if lost is None else lost
    failed = np.flatnonzero(lost.ravel())[:most]
    sizes = cube["outcome"].sizes
    places = dict(zip(sizes, np.unravel_index(failed, tuple(sizes.values())), strict=True))
    factors = [cube[name].values[places[cube[name].dims[0]]] for name in factor_names(cube)]
    outcome = cube["outcome"].values.ravel()
    detail = cube["outcome_detail"].values.ravel() if "outcome_detail" in cube else np.full(outcome.size, "")
    return [
        FailedPoint(
            int(at), [_text(column[row]) for column in factors], Outcome(int(outcome[at])).label, str(detail[at])
        )
        for row, at in enumerate(failed)
    ]


def _text(value: Any) -> str:
    value = value.item() if isinstance(value, np.generic) else value
    return "-" if value != value else str(value) if isinstance(value, bool) else level_or_word(value)


def cost_rows(cube: xr.Dataset) -> list[tuple[str, str, str]]:
    """Costs of the points: (quantity, value, how it was measured); empty if no costs are recorded."""
    if "cpu_seconds" not in cube or not bool(cube["cpu_seconds"].notnull().any()):
        return []
    cube = computed_once(cube)
    run = cube["cpu_seconds"].notnull().values
    count, cpu, wall = int(run.sum()), float(cube["cpu_seconds"].sum()), cube["wall_seconds"].values[run]
    rows = [
        ("CPU time", duration(cpu), "sum of all points, without compilation"),
        ("CPU time per point", duration(cpu / count), f"mean of {count:,} points that were run"),
    ]
    if cpu > 0:
        rows.append(("Points per CPU second", number(count / cpu), "one core, inside the blocks"))
    if "worker" in cube:
        rows.extend(_worker_rows(cube["worker"].values[run].astype(object), wall))
    for name, label in (("steps", "Steps"), ("force_evaluations", "Force evaluations"), ("solves", "Solves")):
        if name in cube:
            total = float(cube[name].sum())
            rows.append(
                (label, f"{total:,.0f}", f"{number(total / count)} per point; {cube[name].attrs.get('long_name', '')}")
            )
    return rows


def _worker_rows(worker: NDArray[np.object_], wall: FloatArray) -> list[tuple[str, str, str]]:
    """Who computed the points, and how fast; points of the pilot are listed separately."""
    rows, here = [], worker != PILOT
    if here.any():
        which, names = pd.factorize(worker[here], sort=True)
        busiest = float(np.bincount(which, wall[here]).max())
        rows.append(("Workers", f"{names.size}", ", ".join(names[:12]) + (", ..." if names.size > 12 else "")))
        rows.append(("Wall-clock time", duration(busiest), "of the busiest worker, inside its blocks"))
        if busiest > 0:
            pace = number(float(here.sum()) / busiest)
            rows.append(("Points per second", pace, "all workers together, inside the blocks"))
    if not here.all():
        rows.append(("Points from the pilot", f"{int((~here).sum()):,}", "computed before, to choose the model"))
    return rows


def numerics_rows(cube: xr.Dataset) -> list[tuple[str, str, str]]:
    """Numerical checks stored in the cube: (check, largest value, meaning)."""
    rows = []
    for name in ("energy_residual", "thrust_amplitude_scatter", "largest_penetration_um"):
        if name in cube and np.isfinite(largest := largest_magnitude(cube[name].variable)):
            attrs = cube[name].attrs
            unit = unit_text(str(attrs.get("units", "1")))
            rows.append(
                (
                    name.replace("_um", "").replace("_", " "),
                    f"{number(largest)} {unit}".strip(),
                    str(attrs.get("long_name", "")) + (_revolutions(cube) if name.endswith("_scatter") else ""),
                )
            )
    rows.extend(
        (name.replace("_", " "), f"{number(100 * float(cube[name].max()), 2)} %", cube[name].attrs["long_name"])
        for name in map(str, cube.data_vars)
        if name.endswith("_error_estimate") and bool(cube[name].notnull().any())
    )
    return rows


_NEEDLES_TURN = ("kinetostatic", "needles")
"""Models whose needles keep turning from one revolution to the next."""


def _revolutions(cube: xr.Dataset) -> str:
    """The revolutions used for the orders, if they are the same at all points and revolutions may differ."""
    fixed = json.loads(str(cube.attrs.get("fixed_parameters", "{}")))
    if (
        not {*(models_used(cube) or [fixed.get("model")])} <= {*_NEEDLES_TURN}
        or "settled_needles" not in fixed
        or not isinstance(fixed.get("cycles"), int)
    ):
        return ""
    if fixed["settled_needles"]:
        return ", once the needles repeat"
    return f", {fixed['cycles'] - 1} and {fixed['cycles']} after the start; the needles may turn on"


def symbol(text: str) -> Markup:
    """A symbol with Greek letters and subscripts: ``psi_1`` becomes ψ with the index 1."""
    greek = re.sub(r"[a-z]+", lambda word: _GREEK.get(word[0], word[0]), text.replace("_", " _"))
    return Markup(re.sub(r" _(\w+)", r"<sub>\1</sub>", str(escape(greek))))


def factor_rows(cube: xr.Dataset) -> list[ParameterRow]:
    """The factors: their range or values, and the metadata of their coordinates."""
    rows = []
    for name in factor_names(cube):
        attrs = cube[name].attrs
        source = str(attrs.get("source", "unknown"))
        rows.append(
            ParameterRow(
                name,
                symbol(str(attrs.get("symbol", ""))),
                _levels(cube[name].values),
                factor_unit(cube, name),
                str(attrs.get("long_name", "")),
                source,
            )
        )
    return rows


def _levels(values: np.ndarray[Any, Any]) -> str:
    distinct = np.unique(values.astype(float) if values.dtype.kind in "fiu" else values.astype(str))
    distinct = distinct[distinct == distinct]  # an empty field of a table is no level
    if distinct.size <= 6 or distinct.dtype.kind not in "fiu":
        return ", ".join(_text(value) for value in distinct)
    return f"{value_range(float(distinct[0]), float(distinct[-1]))} ({distinct.size:,} values)"


def fixed_rows(cube: xr.Dataset) -> list[tuple[str, list[ParameterRow]]]:
    """The fixed parameters in groups, with unit, meaning and source if known."""
    values: Mapping[str, Any] = json.loads(str(cube.attrs.get("fixed_parameters", "{}")))
    known, where = _known_parameters(cube)
    given = study_tables(cube).get("base", {})
    rows = []
    for name, value in values.items():
        if name in known:
            p = known[name]
            follows = f"as {p.follows}" if p.follows in given else p.source
            unit, source = unit_text(p.unit), THIS_STUDY if name in given else follows
            row = ParameterRow(name, symbol(p.symbol), _text(value), unit, p.meaning, source, p.group)
        else:
            row = ParameterRow(name, Markup(""), _text(value), "", where, THIS_STUDY, "parameters")
        rows.append(row)
    return [(group, list(members)) for group, members in groupby(rows, key=lambda row: row.group)]


def _known_parameters(cube: xr.Dataset) -> tuple[Mapping[str, Parameter], str]:
    """Metadata of the scene's parameters; a user's function is not imported for a report."""
    asked_for = study_tables(cube).get("study", {})
    if function := asked_for.get("function"):
        return {}, f"argument of {function}"
    try:
        return load_simulator(str(asked_for.get("scene", "joint"))).parameters, ""
    except InputError:
        return {}, "unknown to this version of tripod_doe"
