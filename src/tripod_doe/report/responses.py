"""Which numbers of a cube a reader asks for first, as labelled responses over the design."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.results import Outcome
from tripod_doe.study.cube import COST_VARIABLES

__all__ = ["Response", "factor_names", "finished", "numeric_factors", "responses", "spoken", "unit_text"]

_ORDINALS = {0: "mean thrust force", 1: "first order", 2: "second order", 3: "third order"}
_VISIBLE = 1e-3  # orders smaller than this part of the largest one are not worth a sentence
_UNIT_SUFFIX = re.compile(r"_(deg|n_m|rpm|mm_s|mm|um|kg_m2|kg_m3|kg|gpa|s_per_mm|s|w)$")


@dataclass(frozen=True)
class Response:
    """One number a point.

    Attributes
    ----------
    label
        In words, for instance ``third order``.
    unit
        Its unit, empty without dimension.
    values
        Over the dimensions of the design; NaN where the point did not finish.
    """

    label: str
    unit: str
    values: xr.DataArray


def spoken(name: str) -> str:
    """A parameter's name in words, without its unit: ``joint_angle_deg`` becomes ``joint angle``."""
    return _UNIT_SUFFIX.sub("", name).replace("_", " ")


def unit_text(unit: str) -> str:
    """A unit for people."""
    return {"1": "", "degree": "deg", "N m": "N m", "mm s-1": "mm/s", "kg m-3": "kg/m3", "s mm-1": "s/mm"}.get(
        unit, unit
    )


def finished(cube: xr.Dataset) -> xr.DataArray:
    """Where the points finished, over the dimensions of the design."""
    return cube["outcome"] == Outcome.FINISHED


def factor_names(cube: xr.Dataset) -> list[str]:
    """Names of the factors, in the order of the study file."""
    design = cube["outcome"].dims
    if design == ("point",):
        labels = ("point", "varied")
        return [
            str(name)
            for name in cube.coords
            if cube[name].dims == design and name not in labels and "source" in cube[name].attrs
        ]
    return [str(dim) for dim in design]


def numeric_factors(cube: xr.Dataset) -> list[str]:
    """Factors that are numbers and take more than one value."""
    return [name for name in factor_names(cube) if cube[name].dtype.kind in "fiu" and np.ptp(cube[name].values) > 0]


def _is_own(cube: xr.Dataset, name: str) -> bool:
    return name not in COST_VARIABLES and cube[name].dtype.kind == "f" and cube[name].dims == cube["outcome"].dims


def responses(cube: xr.Dataset) -> list[Response]:
    """The responses that sentences and figures show: orders of the thrust, or a function's own numbers.

    Orders that are rounding against the largest one are left out, as are checks of the numerics.
    """
    if "thrust_amplitude" in cube:
        amplitude = cube["thrust_amplitude"]
        largest = float(amplitude.max()) if amplitude.notnull().any() else 0.0
        found = []
        for order in (3, 2, 1):
            values = amplitude.sel(order=order, drop=True)
            if order == 3 or float(values.max()) > _VISIBLE * largest:
                found.append(Response(f"{_ORDINALS[order]} of the thrust force", "N", values))
        return found
    own = [str(name) for name in cube.data_vars if _is_own(cube, str(name)) and name != "energy_residual"]
    return [Response(spoken(name), unit_text(cube[name].attrs.get("units", "1")), cube[name]) for name in own[:6]]


def along(response: Response, cube: xr.Dataset, factor: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Every point's factor value and response, shape (point,) each, finished points only."""
    values, levels = xr.broadcast(response.values, cube[factor])
    good = np.isfinite(values.values)
    return levels.values[good], values.values[good]
