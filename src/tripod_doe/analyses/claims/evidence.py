"""Evidence for claims: points of any number of cubes, chosen by their parameters."""

import json
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import is_study
from tripod_doe.joint.parameters import JOINT_PARAMETERS, MECHANISMS
from tripod_doe.model_interface import Outcome

ANY = object()
"""Matches points with any value of a parameter."""

_IDENTITY = (
    "model",
    "joint_angle_deg",
    "torque_n_m",
    "speed_rpm",
    "groove_sliding_friction",
    *(f"initial_skew_{k}_deg" for k in (1, 2, 3)),
    *MECHANISMS,
)
_OTHERS = [  # what makes another joint of points that are else alike
    name
    for name, parameter in JOINT_PARAMETERS.items()
    if parameter.group not in ("numerics", "limits") and name not in _IDENTITY
]
_SAME = 1e-9


class MissingPointError(Exception):
    """The points that decide a claim are missing."""


@dataclass(frozen=True)
class Measured:
    """A number from the cubes, its numerical error (NaN if unknown), and a note for the reader."""

    # value, error: in the unit of the claim
    value: float
    error: float = math.nan
    note: str = ""  # further numbers in words; empty for none


@dataclass(frozen=True)
class Point:
    """One point of a cube."""

    parameters: Mapping[str, Any]  # factors and base values by name
    data: xr.Dataset  # its part of the cube
    # cube, number: name of its cube, and its number there
    cube: str
    number: int

    @property
    def outcome(self) -> Outcome:
        """How it ended."""
        return Outcome(int(self.data["outcome"]))

    def value(self, name: str) -> Any:
        """The value of a parameter, or its default if the study does not set it."""
        known = JOINT_PARAMETERS.get(name)
        own = self.parameters.get(name, known.default if known else None)
        return self.value(known.follows) if own is None and known and known.follows else own

    def output(self, name: str) -> xr.DataArray:
        """An output of it; MissingPointError if the cube does not keep it."""
        if name not in self.data or bool(self.data[name].isnull().all()):
            raise MissingPointError(f"the cube has no {name}")
        return self.data[name]

    def amplitude(self, order: int) -> Measured:
        """Amplitude of an order of the thrust, with the larger of its numerical error and its scatter."""
        errors = [
            float(self.data[name].sel(order=order))
            for name in ("thrust_amplitude_error", "thrust_amplitude_step_error", "thrust_amplitude_scatter")
            if name in self.data
        ]
        known = [error for error in errors if math.isfinite(error)]
        return Measured(float(self.output("thrust_amplitude").sel(order=order)), max(known, default=math.nan))

    def phase_deg(self, order: int) -> float:
        """Phase of an order of the thrust."""
        return float(self.output("thrust_phase_deg").sel(order=order))

    def at_grooves(self, order: int) -> np.ndarray[Any, np.dtype[np.complex128]]:
        """Complex amplitudes of an order in the three grooves."""
        size = self.output("groove_thrust_amplitude").sel(order=order).values
        turn = np.exp(1j * np.radians(self.output("groove_thrust_phase_deg").sel(order=order).values))
        return np.asarray(size * turn, np.complex128)


def _differ(points: Collection[Point], name: str) -> bool:
    """Whether points differ in a parameter, other than as each follows what it has of another one."""
    follows = JOINT_PARAMETERS[name].follows
    alike = follows is not None and all(point.value(name) == point.value(follows) for point in points)
    return not alike and len({point.value(name) for point in points}) > 1


def _matches(point: Point, wanted: Mapping[str, Any]) -> bool:
    for name, value in wanted.items():
        own = point.value(name)
        if value is ANY:
            continue
        if isinstance(value, str) or own is None or isinstance(own, str):
            if own != value:
                return False
        elif abs(own - value) > _SAME * max(1.0, abs(value)):
            return False
    return True


class Evidence:
    """All points of some cubes.

    Args:
        cubes: Cubes of studies by any name; results of analyses are skipped.

    Attributes:
        used: Numbers of the points returned since the last `begin`, by the names of their cubes.
    """

    def __init__(self, cubes: Mapping[str, xr.Dataset]) -> None:
        self.cubes = {name: cube for name, cube in cubes.items() if is_study(cube)}
        self.used: dict[str, set[int]] = {}
        self._points = [point for name, cube in self.cubes.items() for point in _points_of(name, cube)]
        self._joint: list[Point] = []  # finished points of the joint since the last `begin`

    def begin(self) -> None:
        """Begin with another claim: its points may be of another joint."""
        self.used.clear()
        self._joint.clear()

    def joint(self, **wanted: Any) -> list[Point]:
        """Points of the joint at the reference point, except for the parameters in `wanted`; `ANY` matches any value.

        Of points that differ only in numerics, returns the point with the smallest tolerance.

        Raises:
            MissingPointError: If there is none, or one did not finish: finished points alone do not decide a claim; or
                if finished points since the last `begin` are of different joints.
        """
        identity, among = self._of_joint(wanted)
        self._joint += [point for point in among if point.outcome is Outcome.FINISHED]  # others decide nothing
        if apart := [name for name in _OTHERS if _differ(self._joint, name)]:
            raise MissingPointError(f"points of different joints were run, which differ in {', '.join(apart)}")
        return self._finished(identity, among, wanted)

    def numbers(self, cube: str, **wanted: Any) -> list[int]:
        """Numbers of the points of a cube that `joint` looks at, finished or not."""
        return [point.number for point in self._of_joint(wanted)[1] if point.cube == cube]

    def _of_joint(self, wanted: Mapping[str, Any]) -> tuple[dict[str, Any], list[Point]]:
        identity = {name: JOINT_PARAMETERS[name].default for name in _IDENTITY} | dict(wanted)
        return identity, [point for point in self._points if "model" in point.parameters and _matches(point, identity)]

    def scene(self, **wanted: Any) -> list[Point]:
        """Points of another scene, identified by its own parameters; raises as `joint` does."""
        return self._finished(wanted, [point for point in self._points if set(wanted) <= set(point.parameters)], wanted)

    def _finished(self, identity: Mapping[str, Any], among: list[Point], excluded: Mapping[str, Any]) -> list[Point]:
        best: dict[tuple[Any, ...], Point] = {}
        for point in among:
            if _matches(point, identity):
                key = tuple(point.value(name) for name in identity)
                best[key] = min(best.get(key, point), point, key=_rank)
        where = (
            ", ".join(
                f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
                for name, value in excluded.items()
                if value is not ANY
            )
            or "the reference values"
        )
        for point in best.values():
            self.used.setdefault(point.cube, set()).add(point.number)
        if not best:
            raise MissingPointError(f"no point with {where} was run")
        for point in best.values():
            if point.outcome is not Outcome.FINISHED:
                raise MissingPointError(f"a point with {where} ended as {point.outcome.label}")
        return list(best.values())


def _rank(point: Point) -> tuple[bool, float]:
    """Sort key: finished points first, then the tighter tolerance."""
    answers = point.data.get("relative_tolerance_used", math.inf)
    tolerance = float(point.parameters.get("relative_tolerance", answers))
    return point.outcome is not Outcome.FINISHED, math.inf if math.isnan(tolerance) else tolerance


def _points_of(name: str, cube: xr.Dataset) -> list[Point]:
    dims = [str(dim) for dim in cube["outcome"].dims]
    fixed = json.loads(str(cube.attrs.get("fixed_parameters", "{}")))
    factors = [str(name) for name in cube.coords if set(cube[name].dims) <= set(dims)]
    points = []
    for number, index in enumerate(np.ndindex(*(cube.sizes[dim] for dim in dims))):
        data = cube.isel({dim: int(at) for dim, at in zip(dims, index, strict=True)})
        points.append(Point(fixed | {factor: data[factor].item() for factor in factors}, data, name, number))
    return points
