"""Attributes of a cube: the study and the software that made it, independent of how it was run."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from typing import Any

from numpy.typing import NDArray

from tripod_doe.simulator import Value
from tripod_doe.study.cube.model_records import ModelRecords
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points

_PACKAGES = ("tripod-doe", "numpy", "scipy", "numba", "xarray", "netCDF4", "dask", "SALib", "pydoe")


def cube_attributes(study: Study, points: Points, models: ModelRecords) -> dict[str, Any]:
    """Provenance of a cube.

    Parameters
    ----------
    study, points
        The study, and all its points.
    models
        Records of their models.
    """
    return {
        "Conventions": "CF-1.8",
        "title": study.file.study.name,
        "institution": "tripod_doe",
        "source": f"tripod-doe {version('tripod-doe')}, simulator {study.simulator.name}",
        "references": "Thrust force analysis of tripod constant velocity joint using multibody model",
        "question": study.file.study.question,
        "study": study.text,
        "study_hash": study.hash,
        "kernel_source_hash": study.simulator.source_hash,
        **({"design_notes": "\n".join(points.notes)} if points.notes else {}),
        "fixed_parameters": json.dumps(_fixed_parameters(study, points)),
        "package_versions": _package_versions(),
        **models.attributes,
    }


def cost_attributes(study: Study, points: Points, models: ModelRecords) -> dict[str, Any]:
    """Provenance of the costs."""
    return cube_attributes(study, points, models) | {"title": f"{study.file.study.name}: cost"}


@cache
def _package_versions() -> str:
    """Versions as JSON, cached: reading them takes 5 ms."""
    return json.dumps({name: version(name) for name in _PACKAGES} | {"python": platform.python_version()})


def _fixed_parameters(study: Study, points: Points) -> dict[str, Value]:
    """Values that all points share, without values that follow from a factor (spin friction from sliding)."""
    rows = [0, -1, *_first_of_each(points.chosen)]
    samples = [study.simulator.effective({**study.base, **points.settings_of(row)}) for row in rows]
    first, varied = samples[0], points.setting_names
    return {
        name: value
        for name, value in first.items()
        if name not in varied and value is not None and all(other[name] == value for other in samples)
    }


def _first_of_each(columns: Mapping[str, NDArray[Any]]) -> list[int]:
    """The first row of every combination of values."""
    rows: dict[tuple[Any, ...], int] = {}
    for at, values in enumerate(zip(*(column.tolist() for column in columns.values()), strict=True)):
        rows.setdefault(values, at)
    return list(rows.values())
