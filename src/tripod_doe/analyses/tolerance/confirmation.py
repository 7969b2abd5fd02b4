"""What a run with other points is to confirm: the change of scatter or of a nominal value that keeps a limit."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from tripod_doe.page_parts.main_outputs import differ
from tripod_doe.study.definition.distributions import scaled_table, shifted_table
from tripod_doe.study.definition.study_file_schema import FactorTable

CONFIRMED = "exceedance_confirmed"
"""Variable of a result: the probability to exceed a limit by the points of a further run."""
RUNS = "confirmed"
"""Attribute of a result with the points and the factors of these runs, by limit."""
_ENDS = ("", "_low", "_high")
_MEANINGS = {
    "": "probability to exceed the limit with the first proposed change, from other points",
    "_low": "lower end of the interval of the exceedance from other points",
    "_high": "upper end of the interval of the exceedance from other points",
}


@dataclass(frozen=True)
class Change:
    """A change of factors that keeps a limit."""

    place: Mapping[str, int]  # of the component with the limit, by dimension; not along those that its output lacks
    label: str  # of that component, for a folder: ``thrust_amplitude_3``
    factors: Mapping[str, FactorTable]  # the factors that change, as the study file would have them


def changes_to_confirm(result: xr.Dataset) -> list[Change]:
    """The first change, if any, that a tolerance analysis proposes for each limit that is not kept.

    The cheapest scatters where costs are given, else the scatter that shrinks least, else two of them, else the shift
    of the first factor that one is resolved for.
    """
    keep, changes = float(result.attrs["keep"]), []
    tables = factor_tables(result)
    limit = result["limit"]
    for at in np.argwhere(np.isfinite(np.atleast_1d(limit.values))):
        place = dict(zip(map(str, limit.dims), at.tolist(), strict=False))
        part = result.isel(place)
        if float(part["exceedance"]) > 1 - keep and (factors := _first_proposal(part, tables)):
            if "output" in place:
                own = result.isel(output=place["output"])
                place = {dim: at for dim, at in place.items() if dim == "output" or differ(own, dim)}
            changes.append(Change(place, limit_key(part, "order" in place), factors))
    return list({change.label: change for change in reversed(changes)}.values())[::-1]


def factor_tables(result: xr.Dataset) -> dict[str, FactorTable]:
    """The tables of the factors of a result, by their names."""
    return {name: FactorTable(**table) for name, table in json.loads(str(result.attrs["factor_tables"])).items()}


def limit_key(part: xr.Dataset, of_order: bool) -> str:
    """The component of a part of a result, as its limit is written: ``thrust_amplitude_3``."""
    output = str(part["output"].values) if "output" in part.coords else str(part.attrs["outputs"]).split(", ")[0]
    return f"{output}_{int(part['order'])}" if of_order else output


def _first_proposal(part: xr.Dataset, tables: Mapping[str, FactorTable]) -> dict[str, FactorTable]:
    """The factors of the first change that is proposed; empty without any."""
    names = [str(name) for name in part["factor"].values]
    if "cheapest_scale" in part and np.isfinite(part["cheapest_cost"]):
        scales = zip(names, part["cheapest_scale"].values.tolist(), strict=True)
        return {name: scaled_table(tables[name], scale) for name, scale in scales if scale < 1}
    scale, shift = part["scale_to_keep"].values, part["shift_to_keep"].values
    alone = np.diag(scale)
    if np.isfinite(alone).any():
        at = int(np.nanargmax(alone))
        return {names[at]: scaled_table(tables[names[at]], float(alone[at]))}
    if np.isfinite(scale).any():
        pair = np.unravel_index(int(np.nanargmax(scale)), scale.shape)
        return {names[at]: scaled_table(tables[names[at]], float(scale[pair])) for at in map(int, pair)}
    for at in np.flatnonzero(np.isfinite(shift)).tolist():
        return {names[at]: shifted_table(tables[names[at]], float(shift[at]))}
    return {}


def with_confirmed(result: xr.Dataset, answers: Sequence[tuple[Change, xr.Dataset]]) -> xr.Dataset:
    """The result with what other points say of the changes.

    Args:
        answers: The changes with the tolerance analyses of their points.
    """
    limit, texts = result["limit"], {}
    own = {end: xr.full_like(limit, np.nan) for end in _ENDS}
    for change, other in answers:
        part = other.isel(change.place)
        for end in _ENDS:
            own[end][change.place] = part[f"exceedance{end}"]
        texts[change.label] = {
            "points": int(other.attrs["points_used"]),
            "dropped": int(other.attrs["points_dropped"]),
            "factors": {name: table.model_dump(exclude_none=True) for name, table in change.factors.items()},
        }
    variables = {f"{CONFIRMED}{end}": own[end].assign_attrs(long_name=_MEANINGS[end], units="1") for end in _ENDS}
    return result.assign(variables).assign_attrs({RUNS: json.dumps(texts)})
