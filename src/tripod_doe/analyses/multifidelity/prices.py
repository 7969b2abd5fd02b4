"""Prices of the models of a multifidelity study."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from tripod_doe.array_types import IntArray
from tripod_doe.simulator import Candidate
from tripod_doe.study.file import DesignTable, StudyFile
from tripod_doe.study.scenes import load_simulator

_OVERHEAD = 2e-4  # CPU seconds that a point of any model costs besides: its fingerprint, its place in journal and cube
_DIGITS = 3  # of a price in the study file


def price_of_point(
    cube: xr.Dataset, candidates: Sequence[Candidate], design: DesignTable, model: str, rows: IntArray
) -> float:
    """CPU seconds of a point: as the study says, else counted work at its recorded price, else measured.

    Parameters
    ----------
    cube
        Points that ran.
    candidates
        What is known of the price of counted work.
    design
        The multifidelity design.
    model
        The model.
    rows
        Points of it in the cube.

    Returns
    -------
    float
        NaN where the study says nothing and the cube has no costs.
    """
    if model in design.prices:
        return design.prices[model]
    if "cpu_seconds" not in cube:
        return np.nan
    alike = [each for each in candidates if each.values.get(design.fidelity) == model]
    plain = [each for each in alike if not each.substitute]
    if plain:
        seconds = float(cube["force_evaluations"].values[rows].mean()) * plain[0].evaluation_seconds
    else:
        seconds = float(cube["cpu_seconds"].values[rows].mean())
    return float(f"{seconds + _OVERHEAD:.{_DIGITS}g}")


def known_candidates(file: StudyFile) -> Sequence[Candidate]:
    """What the scene of a study knows of prices; nothing of a user's function, whose file may be gone."""
    return () if file.study.function else load_simulator(file.study.scene, None).candidates
