"""Candidates of an optimisation as a list of points, so that the explorer shows a front as it shows other results."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import kind_of
from tripod_doe.analyses.optimisation.stored_candidates import candidate_table, file_of, findings_in, knee_of, names_of
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.lazy_dataset import read_dataset
from tripod_doe.study.definition.toml_text import toml_text

_LABELS = {outcome.label: outcome for outcome in Outcome}


def as_points(data: xr.Dataset) -> xr.Dataset:
    """Turn stored candidates into points: variables become factors, objectives and constraints become results."""
    if kind_of(data) != "optimisation":
        return data
    points = data.rename(candidate="point").assign_coords(point=np.arange(data.sizes["candidate"], dtype=np.int32))
    factors = names_of(data, "variable")
    for name in factors:
        points[name].attrs["source"] = "variable of an optimisation"
    aims = names_of(data, "objective")
    whole = np.isfinite(np.stack([points[name].values for name in aims])).all(axis=0)
    reasons = points["reason"].values.astype(str) if "reason" in points else np.full(whole.shape, "")
    labels = [str(reason).partition(":")[0].partition(" (")[0] for reason in reasons.tolist()]
    ends = np.array([_LABELS.get(label, Outcome.OUT_OF_RANGE) for label in labels], np.int8)
    points = points.drop_vars("reason", errors="ignore").set_coords(factors)
    points["outcome"] = xr.Variable("point", np.where(whole, np.int8(Outcome.FINISHED), ends))
    points["outcome_detail"] = xr.Variable("point", reasons.astype(object))
    return points.assign_attrs(study=_study(data))


def _study(data: xr.Dataset) -> str:
    """The head and the base values of a study of the candidates' joints."""
    file = file_of(data)
    base = {name: value for name, value in file.base.items() if name not in file.variables}
    return toml_text({"study": {"name": file.optimisation.name, "scene": file.optimisation.scene}, "base": base})


def front(path: str) -> Any:
    """A stored front for a page.

    Returns:
        ``findings``, ``heads`` and ``rows`` of texts, the ``knee`` (None for an empty front), and the ``count`` of
        candidates.
    """
    data = read_dataset(Path(path))
    heads, rows = candidate_table(data)
    count = data.sizes["candidate"]
    return {
        "findings": findings_in(data),
        "heads": heads[1:],
        "rows": [row[1:] for row in rows],
        "knee": knee_of(data) if count else None,
        "count": count,
    }
