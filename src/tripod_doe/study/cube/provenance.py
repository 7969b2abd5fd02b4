"""Attributes of a cube: the study and the software that made it, independent of how it was run."""

import json
import platform
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

from tripod_doe.model_interface import Value
from tripod_doe.study.cube.model_records import ModelRecords
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.study_points import StudyPoints

_PACKAGES = ("tripod-doe", "numpy", "scipy", "numba", "xarray", "netCDF4", "dask", "SALib", "pydoe")


def cube_attributes(study: Study, points: Points, models: ModelRecords) -> dict[str, Any]:
    """Provenance of a cube."""
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
    rows = StudyPoints(study, points).of_each_kind(np.arange(points.count))
    samples = [study.simulator.effective({**study.base, **points.settings_of(row)}) for row in rows.tolist()]
    first, varied, parameters = samples[0], points.setting_names, study.simulator.parameters
    following = [name for name, each in parameters.items() if each.follows in varied and name not in study.base]
    return {
        name: value
        for name, value in first.items()
        if name not in (*varied, *following) and value is not None and all(other[name] == value for other in samples)
    }
