"""The choice of model of a study with model = "auto", as its result directory holds it: `choice.nc`.

Made by `tripod_doe.analyses.model_choice`; readers of results need only this module.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.errors import InputError, option
from tripod_doe.study.cube.lazy_dataset import read_dataset
from tripod_doe.study.definition.accuracy_table import AutoModel
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs import Points
from tripod_doe.study.fingerprints import point_keys

CHOICE = "choice.nc"
"""Name of the file."""


def frozen_choice(study: Study, directory: Path) -> xr.Dataset | None:
    """The stored choice of a directory, None without one; InputError if it was made for another accuracy."""
    if not (directory / CHOICE).exists():
        return None
    frozen, auto = read_dataset(directory / CHOICE), auto_model_of(study)
    old = json.loads(frozen.attrs["accuracy"]) | {key: frozen.attrs[key] for key in ("confidence", "floor")}
    new: dict[str, float] = {quantity.name: quantity.allowed for quantity in auto.accuracy.quantities}
    new |= {"confidence": auto.confidence, "floor": auto.accuracy.floor}
    changes = [
        f"  accuracy.{key}: {old.get(key, 'not set')} -> {new.get(key, 'not set')}"
        for key in sorted(old.keys() | new.keys())
        if old.get(key) != new.get(key)
    ]
    if changes:
        raise InputError(
            f"{study.origin}: the model was chosen in {directory} for another accuracy; choose another "
            f"{option('out')}, or undo these changes\n" + "\n".join(changes)
        )
    return frozen


def chosen_keys(study: Study, directory: Path) -> NDArray[np.void]:
    """Fingerprints of the points with a chosen model."""
    frozen = frozen_choice(study, directory)
    keys = [] if frozen is None else frozen["point_key"].values.tolist()
    return np.frombuffer(b"".join(bytes.fromhex(key) for key in keys), dtype="V16")


def chosen_points(study: Study, points: Points, choice: xr.Dataset) -> Points:
    """The points with the model that is chosen for each."""
    rows = {key: row for row, key in enumerate(choice["point_key"].values.tolist())}
    at = np.array([rows.get(key, 0) for key in key_texts(study, points).tolist()])
    chosen = {}
    for name in auto_model_of(study).parameters:
        chosen[name] = study.simulator.parameters[name].column(choice[name].values[at].tolist())
    names = [str(name) for name in choice["quantity"].values]
    errors = {name: choice["error_estimate"].values[at, k] for k, name in enumerate(names)}
    return replace(points, chosen=chosen, error_estimate=errors, accuracy_met=choice["accuracy_met"].values[at])


def key_texts(study: Study, points: Points) -> NDArray[np.str_]:
    """Fingerprints of the points before anything is chosen, as text."""
    return np.array([key.tobytes().hex() for key in point_keys(study, replace(points, chosen={}))])


def auto_model_of(study: Study) -> AutoModel:
    """The accuracy that a study with model = "auto" requires."""
    assert study.auto_model is not None
    return study.auto_model
