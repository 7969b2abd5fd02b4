"""Choice of the models in a cube: the requested orders, the model of each point, its estimated error."""

import json
import re

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.dataset import RESPONSE_ROLE
from tripod_doe.study.definition.toml_text import parse_toml
from tripod_doe.study.expressions import FUNCTIONS

_ESTIMATE = "_error_estimate"


def is_chosen(cube: xr.Dataset) -> bool:
    """Whether models were chosen by a pilot; without one all points run with the full model."""
    return "accuracy_met" in cube and bool((cube["accuracy_met"] >= 0).any())


def asked_orders(cube: xr.Dataset) -> list[int] | None:
    """Orders of the thrust with a requested accuracy; None where no pilot chose a model."""
    if not is_chosen(cube) or "thrust_amplitude" not in cube:
        return None
    matches = (re.fullmatch(rf"thrust_amplitude_(\d+){_ESTIMATE}", str(name)) for name in cube.data_vars)
    return sorted(int(match[1]) for match in matches if match)


def mixed_formulas(cube: xr.Dataset) -> list[str]:
    """Responses that may use what no accuracy was asked for, for which no model was chosen; none without a pilot."""
    if asked_orders(cube) is None:
        return []
    known = {str(name).removesuffix(_ESTIMATE) for name in cube.data_vars if str(name).endswith(_ESTIMATE)}
    known |= {*FUNCTIONS, *map(str, cube.coords), *json.loads(str(cube.attrs.get("fixed_parameters", "{}")))}
    formulas = {
        str(name): re.sub(r"\[(\d+)\]", r"_\1", str(each.attrs.get("formula", "unknown")))
        for name, each in cube.data_vars.items()
        if each.attrs.get("role") == RESPONSE_ROLE
    }
    return [name for name, text in formulas.items() if not known.issuperset(re.findall(r"\b[^\W\d]\w*", text))]


def chosen_models(cube: xr.Dataset) -> NDArray[np.object_]:
    """The model that answers at every point, over the dimensions of the design."""
    return words_of(cube["model_used"] if "model_used" in cube else xr.full_like(cube["outcome"], np.nan, dtype=float))


def words_of(used: xr.DataArray) -> NDArray[np.object_]:
    """Values of a variable as they are, or the words of its flags."""
    if "flag_meanings" not in used.attrs:
        return np.asarray(used.values, dtype=object)
    words = dict(zip(np.asarray(used.attrs["flag_values"]).tolist(), used.attrs["flag_meanings"].split(), strict=True))
    return np.array([words[flag] for flag in used.values.ravel().tolist()], dtype=object).reshape(used.shape)


def models_used(cube: xr.Dataset) -> list[str]:
    """Models that answer at the finished points of a cube, where a pilot or a retry chose some, the coarsest first."""
    if "model_used" not in cube:
        return []
    used = set(map(str, chosen_models(cube)[cube["outcome"].values == Outcome.FINISHED].tolist())) - {"none"}
    known = str(cube["model_used"].attrs.get("flag_meanings", "")).split()
    return sorted(used, key=known.index if known else None)


def estimated_errors(cube: xr.Dataset) -> FloatArray:
    """Largest ratio of estimated to allowed error of all requested outputs, over the dimensions of the design."""
    allowed = parse_toml(str(cube.attrs["study"]), "the study of this cube").get("accuracy", {})
    names = [str(name).removesuffix(_ESTIMATE) for name in cube.data_vars if str(name).endswith(_ESTIMATE)]
    return np.asarray(np.max([cube[name + _ESTIMATE].values / float(allowed[name]) for name in names], axis=0))
