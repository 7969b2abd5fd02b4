"""One point simulated again with other values: its price, its curves, and a study of the causes of its force."""

import re
from pathlib import Path
from typing import Any

import tomlkit
import xarray as xr

from tripod_doe.errors import InputError
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.model_interface import Outcome, check_parameters
from tripod_doe.page_parts.main_results import study_tables
from tripod_doe.service.explorer.exports import point_values
from tripod_doe.service.explorer.figures.point import point_figures
from tripod_doe.service.explorer.open_cubes import opened
from tripod_doe.service.explorer.slices import number_of, point_of
from tripod_doe.study.cube.dataset import SWITCH_ROLE
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.plan import plan
from tripod_doe.study.simulate import simulate

_FACTOR = "replicate"  # a factor that every scene has, and that has no effect
_OF_STUDY = re.compile(r"^point: \[[\w.]+\]: ")  # start of complaints about the study written for the price


def price_of_point(scene: str, parameters: dict[str, Any]) -> Any:
    """Price of one point by recorded prices.

    Returns:
        ``cpu_seconds``, None if no price is recorded, and ``foreseen``: why the point will fail, empty if no failure
        is foreseen.

    Raises:
        InputError: If a parameter cannot be used.
    """
    check_parameters(
        load_simulator(scene).parameters, {name: None for name, value in parameters.items() if value is None}
    )
    base = {name: value for name, value in parameters.items() if name != _FACTOR and value is not None}
    factors = {_FACTOR: {"values": [parameters.get(_FACTOR, 0)]}}  # a study needs a factor
    study = {"study": {"name": "a point", "scene": scene}, "base": base, "factors": factors}
    try:
        checked = parse_study(tomlkit.dumps(study), "point", StudyFolder(Path.cwd(), trusted=False))
        price = plan(checked, timing=False, recorded=True)
    except InputError as error:
        raise InputError(_OF_STUDY.sub("", str(error))) from error
    failures = [f"{failure.outcome.label}: {failure.reason}" for failure in price.foreseen]
    seconds = None if price.cpu_hours is None or failures else 3600 * price.cpu_hours[1]
    return {"cpu_seconds": seconds, "foreseen": "; ".join(failures)}


def simulated(scene: str, parameters: dict[str, Any]) -> Any:
    """One point simulated, with figures of all its outputs."""
    data = simulate(scene, **parameters)
    finished = bool(data.attrs["finished"])
    return {
        "finished": finished,
        "outcome": Outcome(int(data["outcome"])).label,
        "detail": str(data["outcome_detail"].item()),
        "cpu_seconds": data.attrs["cost"]["cpu_seconds"],
        "figures": point_figures(data) if finished else {},
    }


def contribution_study(path: str, number_of_point: int, at: str = "") -> Any:
    """A study file whose run shows which friction causes the thrust at one point of a cube.

    Raises:
        InputError: If the point does not belong to the scene of the joint.
    """
    with opened(path) as cube:
        number_of_point = number_of(cube, number_of_point, at)
        point = point_of(cube, number_of_point)
        return _contribution_study(cube, point, number_of_point)


def _contribution_study(cube: xr.Dataset, point: xr.Dataset, number_of_point: int) -> str:
    head = study_tables(cube).get("study", {})
    if head.get("scene", "joint") != "joint" or head.get("function"):
        raise InputError("only the scene joint has these mechanisms: this is another scene")
    values = point_values(cube, point)
    ablated = [name for name in cube.coords if cube[name].attrs.get("role") == SWITCH_ROLE]
    switched = [name for name in MECHANISMS if name in ablated or values.get(name) != 0]  # others are off for good
    base = {name: value for name, value in values.items() if name not in (*switched, "replicate")}
    study = {
        "study": {
            "name": f"{head.get('name', 'study')}: contributions at point {number_of_point}",
            "question": "Which friction mechanism causes which share of the thrust force at this point?",
        },
        "base": base,
        "design": {"kind": "ablation", "factors": switched},
        "keep": {"outputs": ["thrust_amplitude", "thrust_phase_deg"]},
        "analysis": {"contribution": {}},
    }
    return tomlkit.dumps(study)
