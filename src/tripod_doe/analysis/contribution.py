"""Contribution of each friction mechanism to an amplitude: by switching it off, on alone, by Shapley value, directly.

The waveforms of two combinations of mechanisms differ in phase as well as in amplitude, so shares are taken of the
complex amplitude A exp(i p), projected on that with all mechanisms on. The effective value is A/sqrt 2 at every order
but the mean: a factor that cancels, so its shares are those of the amplitude.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from tripod_doe.analysis.kinds import makes_kind
from tripod_doe.errors import InputError, near_match
from tripod_doe.simulator import Outcome
from tripod_doe.study.cube import SWITCH_ROLE
from tripod_doe.study.file import parse_file

__all__ = ["PAPER_SHARES", "ContributionSettings", "contribution_shares"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

PAPER_SHARES = {"groove_spinning": 2.0, "groove_rolling": 5.0, "needle_sliding": 1.0, "needle_rolling": 6.0}
"""Shares of the third order in percent that the paper prints in 3.5; groove sliding is the rest, 86 %."""

_Variable = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]

_ROUNDING = 1e-6  # part of the largest amplitude of an operating point below which an amplitude is only error
_FLAGS = {0: "valid", 1: "zero_amplitude", 2: "point_missing"}


class ContributionSettings(BaseModel):
    """[analysis.NAME] of kind contribution."""

    model_config = ConfigDict(extra="forbid")
    output: str = Field(
        "thrust_amplitude", description="amplitude, effective value or real output to split into shares"
    )
    phase: str | None = Field(
        None, description='its phase in degrees; if omitted, X_phase_deg for X_amplitude or X_rms; "" for a real output'
    )  # fmt: skip

    @property
    def phase_name(self) -> str:
        """Variable with the phase; empty where the output is a signed number."""
        stem = self.output.removesuffix("_amplitude").removesuffix("_rms")
        return (f"{stem}_phase_deg" if stem != self.output else "") if self.phase is None else self.phase

    @property
    def outputs(self) -> list[str]:
        """Outputs that the study must keep."""
        return [self.output] + ([self.phase_name] if self.phase_name else [])

    @property
    def part_names(self) -> tuple[str, str]:
        """Variables with amplitude and phase of the parts that a model itself splits the output into."""
        stem = self.output.removesuffix("_amplitude").removesuffix("_rms")
        return f"{stem}_part_amplitude", f"{stem}_part_phase_deg"


@dataclass(frozen=True)
class _Operating:
    """Operating points of an ablation: which one each point of the cube belongs to, and their dimensions."""

    of_point: NDArray[np.int64]
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    labels: dict[str, xr.Variable]

    @property
    def count(self) -> int:
        """Number of operating points."""
        return math.prod(self.shape)


class _Projections:
    """P(S) in percent, for combinations S written as bits, the first mechanism the lowest; NaN where it is not known.

    Attributes
    ----------
    count
        Number of mechanisms.
    total
        |A_all|, shape (operating point, own dimensions).
    error
        Its error: as known, at least rounding; same shape.
    weak
        Where the magnitude is not above its error, same shape.
    """

    def __init__(self, switched: NDArray[np.int64], operating: _Operating, values: ComplexArray, error: FloatArray):
        self.count = switched.shape[1]
        self._values = np.concatenate([values, np.full_like(values[:1], np.nan)])  # row -1: no such point
        self._row: dict[tuple[int, int], int] = {}
        codes = switched @ (1 << np.arange(self.count))
        for row, at in enumerate(zip(operating.of_point.tolist(), codes.tolist(), strict=True)):
            self._row.setdefault(at, row)
        self._points = operating.count
        self.all_on = (1 << self.count) - 1
        self._reference = self._amplitudes(self.all_on)
        self.total: FloatArray = np.abs(self._reference)
        largest = np.zeros(self._points)
        np.fmax.at(largest, operating.of_point, _largest(values))
        known = np.concatenate([error, np.full_like(error[:1], 0)])[self._rows(self.all_on)]
        floor = _ROUNDING * largest.reshape(-1, *(1,) * (values.ndim - 1))
        self.error: FloatArray = np.fmax(known, floor)
        self.weak: NDArray[np.bool_] = self.total <= self.error

    def _rows(self, combination: int) -> NDArray[np.int64]:
        return np.array([self._row.get((at, combination), -1) for at in range(self._points)], np.int64)

    def _amplitudes(self, combination: int) -> ComplexArray:
        amplitudes: ComplexArray = self._values[self._rows(combination)]
        return amplitudes

    def missing(self, combination: int) -> NDArray[np.bool_]:
        """Whether a combination has no result at all, of each operating point."""
        lost = np.isnan(self._amplitudes(combination)).reshape(self._points, -1)
        return np.asarray(lost.all(axis=1), bool)

    def __call__(self, combination: int) -> FloatArray:
        """P of one combination, shape (operating point, own dimensions)."""
        square = np.where(self.weak, np.nan, self.total) ** 2
        projected: FloatArray = 100 * (self._amplitudes(combination) * self._reference.conj()).real / square + 0.0
        return projected  # the 0 added makes -0 a 0

    def of_whole(self, parts: ComplexArray) -> FloatArray:
        """Parts of A_all in percent, (point, part, own dimensions) -> (operating point, part, own dimensions)."""
        square = np.where(self.weak, np.nan, self.total)[:, None] ** 2
        there = np.concatenate([parts, np.full_like(parts[:1], np.nan)])[self._rows(self.all_on)]
        projected: FloatArray = 100 * (there * self._reference[:, None].conj()).real / square + 0.0
        return projected


def _largest(values: ComplexArray) -> FloatArray:
    """Largest magnitude of each point over its own dimensions, zero where it has none."""
    magnitude: FloatArray = np.nan_to_num(np.abs(values).reshape(len(values), -1))
    largest: FloatArray = magnitude.max(axis=1, initial=0.0)
    return largest


@makes_kind("contribution")
def contribution_shares(cube: xr.Dataset, settings: ContributionSettings | None = None) -> xr.Dataset:
    r"""Shares of the mechanisms in an amplitude by four definitions, what does not add up, and the interactions.

    With A_S the complex amplitude with the mechanisms S on, P(S) = 100 Re(A_S conj(A_all)) / \|A_all\|^2 is the part
    of the whole that S produces, in percent; a mechanism that opposes the others has negative shares.

    - share_off(m) = 100 - P(all but m): what is lost when it is switched off.
    - share_on(m) = P({m}): what it makes alone.
    - share_shapley(m) = sum over S without m of \|S\|! (n - \|S\| - 1)! / n! (P(S with m) - P(S)): the mean of what it
      adds, over all orders of switching on. These add up to 100 - P(none).
      Where combinations did not finish, missing_combinations names them by the mechanisms that are on, and
      share_shapley_low and share_shapley_high say what the value is at least and at most, if the missing P lie between
      the smallest and the largest known P of that operating point.
    - share_direct(m) = 100 Re(A_m conj(A_all)) / \|A_all\|^2 with A_m what the forces of m add to the output while all
      mechanisms are on, for cubes that hold it (X_part_amplitude and X_part_phase_deg of the output X; for the thrust
      see `joint.thrust_parts`). direct_remainder = 100 - sum of share_direct: inertia, numerical error, and mechanisms
      that are not switched here.
    - closure = 100 - sum of share_off: what switching off one at a time leaves out or counts twice.
    - interaction(i, j) = sum over S without i and j of \|S\|! (n - \|S\| - 2)! / (n - 1)! (P(S with both) - P(S with i)
      - P(S with j) + P(S)): the Shapley interaction index, what two mechanisms make only together (positive) or make
      twice (negative).

    Parameters
    ----------
    cube
        Cube of an ablation, alone or as a part of a product with operating points. Shapley values and interactions
        need all 2^n combinations of n mechanisms; they take n^2 2^n sums per operating point.
    settings
        Which output.

    Returns
    -------
    xarray.Dataset
        share_off, share_on, share_shapley, share_direct (mechanism, dimensions of the output), closure,
        direct_remainder, share_none = P(none), amplitude = \|A_all\| and its error amplitude_error, interaction
        (pair, ...), strongest_pair and strongest_interaction, in percent. Dimensions of the operating points stand in
        front: one per factor where they fill a grid, else ``operating_point``.
        Every variable X has a flag variable X_flag: NaN is either zero_amplitude (\|A_all\| not above its error: the
        cube's scatter of it, at least 1e-6 of the largest amplitude there) or point_missing (a point that it needs did
        not finish, or is not in the design).

    Raises
    ------
    InputError
        If the cube is of another design, or lacks the output or its phase.

    References
    ----------
    Shapley 1953, A value for n-person games. Grabisch and Roubens 1999, An axiomatic approach to the concept of
    interaction among players in cooperative games. The question is that of the paper's section 3.5.
    """
    settings = settings or ContributionSettings()
    mechanisms, operating = _roles(cube)
    amplitude, error = _amplitudes(cube, settings)
    switched = np.stack([cube[name].values for name in mechanisms], axis=1).astype(np.int64)
    part = _Projections(switched, operating, amplitude.values, error)
    own = tuple(str(dim) for dim in amplitude.dims[1:])
    variables = _shares(part, own, cube[settings.output].attrs)
    if _has_all_combinations(cube):
        variables |= _cooperation(part, own, mechanisms)
    variables |= _direct(cube, settings, part, own, mechanisms)
    comment = "shares of the effective value (rms) are those of the amplitude" if settings.phase_name else ""
    return xr.Dataset(
        _with_flags(operating, part, variables),
        coords=operating.labels
        | {dim: cube[dim].variable for dim in own if dim in cube.coords}
        | {"mechanism": ("mechanism", list(mechanisms), {"long_name": "mechanism that is switched"})}
        | ({"pair": _pair_labels(mechanisms)} if "interaction" in variables else {}),
        attrs={"outputs": settings.output, "operating_dims": " ".join(operating.dims)}
        | _counts(cube)
        | ({"comment": comment} if comment else {})
        | ({"model": model} if (model := _model(cube)) else {}),
    )


def _counts(cube: xr.Dataset) -> dict[str, int]:
    """Points that finished, and points that did not: shares that need one of these are missing."""
    used = int((cube["outcome"] == Outcome.FINISHED).sum())
    return {"points_used": used, "points_dropped": cube.sizes["point"] - used}


def _model(cube: xr.Dataset) -> str:
    """The model of all points; empty where they have none, or several."""
    return str(json.loads(str(cube.attrs.get("fixed_parameters", "{}"))).get("model", ""))


def _has_all_combinations(cube: xr.Dataset) -> bool:
    """Whether the design of the cube asks for all combinations, so that a missing one is a gap and no choice."""
    file = parse_file(cube.attrs["study"], "the study in the cube")
    designs = [file.design, *(file.designs[name] for name in file.design.of)]
    return any(design.kind == "ablation" and design.combinations == "all" for design in designs)


def _roles(cube: xr.Dataset) -> tuple[list[str], _Operating]:
    """Names of the switched mechanisms, and the operating points that the other factors make."""
    factors = [str(name) for name in cube.coords if cube[name].dims == ("point",) and "source" in cube[name].attrs]
    switches = [name for name in factors if cube[name].attrs.get("role") == SWITCH_ROLE]
    if not switches:
        raise InputError("this analysis needs the cube of an ablation design, alone or as a part of a product")
    return switches, _operating(cube, [name for name in factors if name not in switches])


def _operating(cube: xr.Dataset, factors: list[str]) -> _Operating:
    """Operating points: one dimension per factor where they fill a grid, else one dimension for all."""
    columns = [cube[name].values.tolist() for name in factors]
    levels = [list(dict.fromkeys(column)) for column in columns]
    shape = tuple(len(values) for values in levels)
    rows = list(zip(*columns, strict=True)) if factors else [()] * cube.sizes["point"]
    distinct = {row: position for position, row in enumerate(dict.fromkeys(rows))}

    def label(name: str, dim: str, values: list[Any]) -> xr.Variable:
        return xr.Variable((dim,), np.array(values, cube[name].dtype), cube[name].attrs)

    if len(distinct) == math.prod(shape):
        places = [{value: at for at, value in enumerate(values)} for values in levels]
        at = [[place[value] for value in column] for place, column in zip(places, columns, strict=True)]
        index = np.ravel_multi_index(tuple(np.array(a) for a in at), shape) if factors else np.zeros(len(rows), int)
        labels = {name: label(name, name, values) for name, values in zip(factors, levels, strict=True)}
        return _Operating(np.asarray(index, np.int64), tuple(factors), shape, labels)
    dim = "operating_point"
    listed = {
        name: label(name, dim, list(values)) for name, values in zip(factors, zip(*distinct, strict=True), strict=True)
    }
    number = {dim: xr.Variable((dim,), np.arange(len(distinct), dtype=np.int32), {"long_name": "operating point"})}
    return _Operating(np.array([distinct[row] for row in rows], np.int64), (dim,), (len(distinct),), number | listed)


def _amplitudes(cube: xr.Dataset, settings: ContributionSettings) -> tuple[xr.DataArray, FloatArray]:
    """Complex amplitudes of all points, NaN where one did not finish, and the errors known of their magnitudes."""
    numbers = [str(name) for name, variable in cube.data_vars.items() if variable.dtype.kind == "f"]
    for key, name in (("output", settings.output), ("phase", settings.phase_name)):
        if name and name not in numbers:
            raise InputError(f"{key}: {name!r} is not in the cube{near_match(name, numbers)}")
    size = cube[settings.output].where(cube["outcome"] == Outcome.FINISHED)
    turn = np.exp(1j * np.radians(cube[settings.phase_name])) if settings.phase_name else 1.0
    values = (size * turn).transpose("point", ...).astype(complex)
    scatter = f"{settings.output}_scatter"
    known = cube[scatter].transpose("point", ...).values if scatter in cube else np.zeros(values.shape)
    return values, known.astype(float)


def _shares(part: _Projections, own: tuple[str, ...], output: Mapping[str, Any]) -> dict[str, _Variable]:
    """What every ablation gives, each of shape (operating point, ...)."""
    bits = [1 << position for position in range(part.count)]
    off = np.stack([100 - part(part.all_on - bit) for bit in bits], axis=1)
    on = np.stack([part(bit) for bit in bits], axis=1)
    by_mechanism = ("mechanism", *own)
    return {
        "share_off": (by_mechanism, off, _percent("share by switching off: 100 - P(all but the mechanism)")),
        "share_on": (by_mechanism, on, _percent("share on alone: P(the mechanism)")),
        "closure": (own, 100 - off.sum(axis=1), _percent("closure: 100 - sum of the shares by switching off")),
        "share_none": (own, part(0), _percent("what is there with all mechanisms off: P(none)")),
        "amplitude": (
            own, part.total,
            {"long_name": "amplitude with all mechanisms on", "units": str(output.get("units", "1"))},
        ),
        "amplitude_error": (
            own, part.error,
            {"long_name": "scatter of that amplitude, at least rounding", "units": str(output.get("units", "1"))},
        ),
    }  # fmt: skip


def _direct(
    cube: xr.Dataset, settings: ContributionSettings, part: _Projections, own: tuple[str, ...], mechanisms: list[str]
) -> dict[str, _Variable]:
    """Shares that the model's own split gives, where the cube holds a part for every mechanism."""
    amplitude, phase = settings.part_names
    if not {amplitude, phase} <= set(cube.data_vars) or not set(mechanisms) <= set(cube["part"].values.tolist()):
        return {}
    known = cube[[amplitude, phase]].sel(part=mechanisms).where(cube["outcome"] == Outcome.FINISHED)
    parts = (known[amplitude] * np.exp(1j * np.radians(known[phase]))).transpose("point", "part", *own)
    direct = part.of_whole(parts.values)
    meaning = "share by direct decomposition: what the mechanism's forces add with all mechanisms on"
    rest = "100 - sum of the shares by direct decomposition"
    return {
        "share_direct": (("mechanism", *own), direct, _percent(meaning)),
        "direct_remainder": (own, 100 - direct.sum(axis=1), _percent(rest)),
    }


def _cooperation(part: _Projections, own: tuple[str, ...], mechanisms: list[str]) -> dict[str, _Variable]:
    """What needs all combinations: Shapley values and interactions."""
    everything = [part(combination) for combination in range(part.all_on + 1)]
    pairs = list(combinations(range(part.count), 2))
    shapley = np.stack([_index(everything, part.count, (each,)) for each in range(part.count)], axis=1)
    shares: dict[str, _Variable] = {
        "share_shapley": (("mechanism", *own), shapley, _percent("share by Shapley value of P")),
        "missing_combinations": ((), _missing(part, mechanisms), {"long_name": "combinations without a result"}),
    }
    for name, extreme, position in (("low", "least", 0), ("high", "most", 1)):
        bound = np.stack([_bounds(everything, part.count, each)[position] for each in range(part.count)], axis=1)
        meaning = f"share by Shapley value at {extreme}, if missing P lie between the smallest and largest known ones"
        shares[f"share_shapley_{name}"] = (("mechanism", *own), bound, _percent(meaning))
    if not pairs:
        return shares
    together = np.stack([_index(everything, part.count, pair) for pair in pairs], axis=1)
    largest = np.argmax(np.abs(together), axis=1)  # NaN counts as the largest, and stays NaN
    size = np.take_along_axis(together, largest[:, None], axis=1)[:, 0]
    names = np.array(_pair_labels(mechanisms)[1], dtype=object)
    return shares | {
        "interaction": (("pair", *own), together, _percent("Shapley interaction index of two mechanisms")),
        "strongest_pair": (
            own, np.where(np.isnan(size), "", names[largest]), {"long_name": "pair with the largest interaction"},
        ),
        "strongest_interaction": (own, size, _percent("interaction of the strongest pair")),
    }  # fmt: skip


def _index(everything: list[FloatArray], count: int, members: tuple[int, ...]) -> FloatArray:
    """Shapley value of one mechanism or interaction index of two: the mean of their mixed difference over all S."""
    bits, width = [1 << member for member in members], len(members)
    chosen = [(sum(some), (-1) ** (width - size)) for size in range(width + 1) for some in combinations(bits, size)]
    total = np.zeros_like(everything[0])
    for others in range(len(everything)):
        if others & sum(bits):
            continue
        size = others.bit_count()
        weight = math.factorial(size) * math.factorial(count - size - width) / math.factorial(count - width + 1)
        total += weight * sum(sign * everything[others | some] for some, sign in chosen)
    return total


def _bounds(everything: list[FloatArray], count: int, member: int) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest Shapley value of a mechanism, with every missing P between the smallest and largest known."""
    smallest, largest = np.fmin.reduce(everything), np.fmax.reduce(everything)

    def filled(with_it: FloatArray, without_it: FloatArray) -> FloatArray:
        """With these values for combinations with and without the mechanism, of which the value rises and falls."""
        guesses = [with_it if combination >> member & 1 else without_it for combination in range(len(everything))]
        known = [np.where(np.isnan(p), guess, p) for p, guess in zip(everything, guesses, strict=True)]
        return _index(known, count, (member,))

    return filled(smallest, largest), filled(largest, smallest)


def _missing(part: _Projections, mechanisms: list[str]) -> NDArray[Any]:
    """Combinations without a result at each operating point, by the mechanisms that are on."""
    names = [
        " + ".join(name for bit, name in enumerate(mechanisms) if combination >> bit & 1) or "none"
        for combination in range(part.all_on + 1)
    ]
    gone = np.array([part.missing(combination) for combination in range(part.all_on + 1)])
    return np.array(["; ".join(names[k] for k in np.flatnonzero(column)) for column in gone.T], dtype=object)


def _percent(meaning: str) -> dict[str, str]:
    return {"long_name": meaning, "units": "percent"}


def _pair_labels(mechanisms: list[str]) -> tuple[str, list[str], dict[str, str]]:
    names = [f"{first} + {second}" for first, second in combinations(mechanisms, 2)]
    return "pair", names, {"long_name": "two mechanisms"}


def _with_flags(operating: _Operating, part: _Projections, variables: dict[str, _Variable]) -> dict[str, xr.Variable]:
    """The variables over the operating points, with a flag beside every number: why it is NaN."""
    labelled = {}
    for name, (dims, data, attrs) in variables.items():
        over = (*operating.dims, *dims)
        shape = (*operating.shape, *data.shape[1:])
        if data.dtype.kind == "f":
            attrs = attrs | {"ancillary_variables": f"{name}_flag"}
            weak = part.weak if data.ndim == part.weak.ndim else part.weak[:, None]
            why = np.where(np.isnan(data.astype(float)), np.where(weak, 1, 2), 0).astype(np.int8)
            meanings = {
                "long_name": f"why {name} is missing", "flag_values": np.array(list(_FLAGS), np.int8),
                "flag_meanings": " ".join(_FLAGS.values()),
            }  # fmt: skip
            labelled[f"{name}_flag"] = xr.Variable(over, why.reshape(shape), meanings)
        labelled[name] = xr.Variable(over, data.reshape(shape), attrs)
    return labelled
