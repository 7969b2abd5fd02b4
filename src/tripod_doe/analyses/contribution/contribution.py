"""Contribution of each friction mechanism to an amplitude: by switching it off, on alone, by Shapley value, directly.

The waveforms of two combinations of mechanisms differ in phase as well as in amplitude, so shares are taken of the
complex amplitude A exp(i p), projected on that with all mechanisms on. The effective value is A/sqrt 2 at every order
but the mean: a factor that cancels, so its shares are those of the amplitude.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from tripod_doe.analyses.contribution.ablation import (
    OperatingPoints,
    Projections,
    has_all_combinations,
    switches_and_points,
)
from tripod_doe.analyses.contribution.shapley_values import shapley_bounds, shapley_index
from tripod_doe.analyses.diff.definitions import fixed_parameters
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.output_table import is_level
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.chosen_models import asked_orders, chosen_models, models_used
from tripod_doe.phases import is_phase
from tripod_doe.study.definition.responses import ERROR
from tripod_doe.study.definition.study_file_schema import Table
from tripod_doe.study.memory import refuse_too_much_memory

PAPER_SHARES = {"groove_spinning": 2.0, "groove_rolling": 5.0, "needle_sliding": 1.0, "needle_rolling": 6.0}
"""Shares of the third order in percent that the paper prints in 3.5; groove sliding is the rest, 86 %."""

_GROUPS = ("operating point", "friction", "geometry", "material")  # of parameters; it gives no skew for these
PAPER_POINT = {
    name: value
    for name, each in JOINT_PARAMETERS.items()
    if each.group in _GROUPS
    and "skew" not in name
    and (value := JOINT_PARAMETERS[each.follows].default if each.follows else each.default) is not None
}
"""The paper's joint and operating point, for which these hold: values of parameters by name."""

_Variable = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]

_COPIES = 6  # of the complex amplitudes, which are in memory together
_FLAGS = {0: "valid", 1: "zero_amplitude", 2: "point_missing"}


_DEGREES = ("degree", "degrees", "deg", "1", "")  # a function's output may have no unit


class ContributionSettings(Table):
    """[analysis.NAME] of kind contribution."""

    output: str = Field(
        "thrust_amplitude", description="amplitude, effective value or real output to split into shares"
    )
    phase: str | None = Field(
        None, description='its phase in degrees; if omitted, X_phase_deg for X_amplitude or X_rms; "" for a real output'
    )

    @property
    def phase_name(self) -> str:
        """Variable with the phase; empty if the output is a signed number."""
        stem = self.output.removesuffix("_amplitude").removesuffix("_rms")
        return (f"{stem}_phase_deg" if stem != self.output else "") if self.phase is None else self.phase

    @property
    def outputs(self) -> list[str]:
        """Outputs that the study must keep."""
        return [self.output] + ([self.phase_name] if self.phase_name else [])

    def key_of(self, output: str) -> str:
        """The key that names an output of `outputs`, or would."""
        return "output" if output == self.output else "phase"

    @property
    def part_names(self) -> tuple[str, ...]:
        """Variables with amplitude and phase of the parts of an amplitude; none for an output without a phase."""
        stem = self.output.removesuffix("_amplitude").removesuffix("_rms")
        return (f"{stem}_part_amplitude", f"{stem}_part_phase_deg") if stem != self.output else ()


@makes_kind("contribution")
def contribution_shares(cube: xr.Dataset, settings: ContributionSettings | None = None) -> xr.Dataset:
    r"""Shares of the mechanisms in an amplitude by four definitions, what does not add up, and the interactions.

    With A_S the complex amplitude with the mechanisms S on, P(S) = 100 Re(A_S conj(A_all)) / \|A_all\|^2 is the part
    of the whole that S produces, in percent; a mechanism that opposes the others has negative shares.

    - share_off(m) = 100 - P(all but m): what is lost when it is switched off.
    - change_off(m) = 100 (\|A_all but m\| / \|A_all\| - 1): change of the amplitude without it; change_halved(m): with
      half of its friction, of designs with `halved`.
    - share_on(m) = P({m}): what it contributes alone.
    - share_shapley(m) = sum over S without m of \|S\|! (n - \|S\| - 1)! / n! (P(S with m) - P(S)): the mean of what it
      adds, over all orders of switching on. These add up to 100 - P(none).
      Where combinations did not finish, missing_combinations names them by the mechanisms that are on, and
      share_shapley_low and share_shapley_high say what the value is at least and at most, if the missing P lie between
      the smallest and the largest known P of that operating point.
    - share_direct(m) = 100 Re(A_m conj(A_all)) / \|A_all\|^2 with A_m what the forces of m add to the output while all
      mechanisms are on, for cubes that hold it (X_part_amplitude and X_part_phase_deg of the output X; for the thrust
      see `thrust_parts`). direct_remainder = 100 - sum of share_direct: inertia, numerical error, and mechanisms
      that are not switched here.
    - closure = 100 - sum of share_off: what switching off one at a time leaves out or counts twice.
    - interaction(i, j) = sum over S without i and j of \|S\|! (n - \|S\| - 2)! / (n - 1)! (P(S with both) - P(S with i)
      - P(S with j) + P(S)): the Shapley interaction index, what two mechanisms contribute more (positive) or less
      (negative) together than separately.

    Args:
        cube: Cube of an ablation, alone or as a part of a product with operating points. Shapley values and
            interactions need all 2^n combinations of n mechanisms; they take n^2 2^n sums per operating point.

    Returns:
        change_off, change_halved, share_off, share_on, share_shapley, share_direct (mechanism, dimensions of the
        output), closure, direct_remainder, share_none = P(none), amplitude = \|A_all\| and its error
        amplitude_error, interaction (pair,
        ...), strongest_pair and strongest_interaction, in percent. Dimensions of the operating points are in front:
        one per factor where they fill a grid, else ``operating_point``. Every variable X has a flag variable X_flag:
        NaN is either zero_amplitude (\|A_all\| not above its error: the cube's scatter of it, else its numerical error,
        at least 1e-6 of the largest amplitude there) or point_missing (a point that it needs has no number, or is not
        in the design).

    Raises:
        InputError: If the cube is of another design, lacks the output or its phase, the output is a level or a phase,
            or does not fit into the free memory.

    References:
        Shapley 1953, A value for n-person games. Grabisch and Roubens 1999, An axiomatic approach to the concept of
        interaction among players in cooperative games. The question is in section 3.5 of the paper.
    """
    settings = settings or ContributionSettings()
    mechanisms, operating = switches_and_points(cube)
    amplitude, error = _amplitudes(cube, settings)
    switched = np.stack([cube[name].values for name in mechanisms], axis=1).astype(float)
    part = Projections(switched, operating, amplitude.values, error)
    own = tuple(str(dim) for dim in amplitude.dims[1:])
    variables = _shares(part, own, cube[settings.output].attrs)
    if has_all_combinations(cube):
        variables |= _cooperation(part, own, mechanisms)
    variables |= _direct(cube, settings, part, own, mechanisms)
    comment = "shares of the effective value (rms) equal the shares of the amplitude" if settings.phase_name else ""
    return xr.Dataset(
        _with_flags(operating, part, variables),
        coords=operating.labels
        | {dim: cube[dim].variable for dim in own if dim in cube.coords}
        | {"mechanism": ("mechanism", list(mechanisms), {"long_name": "mechanism that is switched"})}
        | ({"pair": _pair_labels(mechanisms)} if "interaction" in variables else {}),
        attrs={"outputs": settings.output, "operating_dims": " ".join(operating.dims)}
        | _counts(cube)
        | ({"comment": comment} if comment else {})
        | ({"left_out": "\n".join(left_out)} if (left_out := _left_out(variables, settings)) else {})
        | _of_fixed(fixed_parameters(cube))
        | _of_models(cube, operating),
    )


def _left_out(variables: Collection[str], settings: ContributionSettings) -> list[str]:
    """A line for each missing variable: what the study needs to provide it."""
    needs = {
        "share_shapley": "the design must have all combinations of the mechanisms",
        "change_halved": "the design must have halved = true",
    }
    if settings.part_names:
        needs["share_direct"] = f"the study must keep {' and '.join(settings.part_names)}, under [keep]"
    return [f"{name}: {need}" for name, need in needs.items() if name not in variables]


def _counts(cube: xr.Dataset) -> dict[str, int]:
    """Points that finished, and points that did not: shares that need one of these are missing."""
    used = int((cube["outcome"] == Outcome.FINISHED).sum())
    return {"points_used": used, "points_dropped": cube.sizes["point"] - used}


def _of_fixed(fixed: Mapping[str, Any]) -> dict[str, str]:
    """Attributes by the parameters with one value in all points: those that are not the paper's, and the model."""
    unlike = {name: fixed[name] for name, value in PAPER_POINT.items() if fixed.get(name, value) != value}
    return {"unlike_paper": json.dumps(unlike)} | ({"model": str(fixed["model"])} if "model" in fixed else {})


def _of_models(cube: xr.Dataset, operating: OperatingPoints) -> dict[str, Any]:
    """Attributes where a pilot or retries chose models: the only one, or where combinations have several of them.

    Shares there hold what the models differ by. `orders_asked` are those for which they were chosen.
    """
    used, asked = models_used(cube), asked_orders(cube)
    orders = {} if asked is None else {"orders_asked": " ".join(map(str, asked))}
    if len(used) < 2:
        return ({"model": used[0]} if used else {}) | orders
    done = np.flatnonzero(cube["outcome"].values == Outcome.FINISHED)
    pairs = set(zip(operating.of_point[done].tolist(), chosen_models(cube)[done].tolist(), strict=True))
    each = np.bincount([at for at, _ in pairs], minlength=operating.count)
    return {"model": "", "models": ", ".join(used), "points_of_several_models": int((each > 1).sum())} | orders


def _amplitudes(cube: xr.Dataset, settings: ContributionSettings) -> tuple[xr.DataArray, FloatArray]:
    """Complex amplitudes of all points, NaN where one has no number, and the errors known of their magnitudes."""
    numbers = [str(name) for name, variable in cube.data_vars.items() if variable.dtype.kind == "f"]
    for key, name in (("output", settings.output), ("phase", settings.phase_name)):
        if name and name not in numbers:
            raise InputError(f"{key}: {name!r} is not in the cube{near_match(name, numbers)}")
    attributes = cube[settings.output].attrs
    if is_level(attributes) or (is_phase(cube[settings.output]) and not settings.phase_name):
        kind = "a level" if is_level(attributes) else "a phase"
        raise InputError(
            f"output: {settings.output!r} is {kind}, whose zero is arbitrary: mechanisms have no shares of it"
        )
    if settings.phase_name and (unit := cube[settings.phase_name].attrs.get("units", "1")) not in _DEGREES:
        raise InputError(f"phase: {settings.phase_name!r} is in {unit}; give it in degree")
    needed = _COPIES * 16 * cube[settings.output].size
    what = f"the contribution to {settings.output} at {cube.sizes['point']:,} points"
    refuse_too_much_memory(needed, what, "choose an output with fewer numbers, or fewer operating points")
    size = cube[settings.output].where(cube["outcome"] == Outcome.FINISHED)
    size = size.where(np.isfinite(size))
    turn = np.exp(1j * np.radians(cube[settings.phase_name])) if settings.phase_name else 1.0
    values = (size * turn).transpose("point", ...).astype(complex)
    recorded = [name for end in ("_scatter", ERROR) if (name := f"{settings.output}{end}") in cube]
    known = cube[recorded[0]].transpose("point", ...).values if recorded else np.zeros(values.shape)
    return values, known.astype(float)


def _shares(part: Projections, own: tuple[str, ...], output: Mapping[str, Any]) -> dict[str, _Variable]:
    """Results of every ablation, each of shape (operating point, ...)."""
    bits = [1 << position for position in range(part.count)]
    off = np.stack([100 - part(part.all_on - bit) for bit in bits], axis=1)
    on = np.stack([part(bit) for bit in bits], axis=1)
    by_mechanism = ("mechanism", *own)
    halved = {
        "change_halved": (
            by_mechanism,
            part.changes([-bit for bit in bits]),
            _percent("change of the amplitude with half of its friction"),
        )
    }
    changed = part.changes([part.all_on - bit for bit in bits])
    return {
        "change_off": (by_mechanism, changed, _percent("change of the amplitude without it")),
        **(halved if part.is_halved else {}),
        "share_off": (by_mechanism, off, _percent("share by switching off: 100 - P(all but the mechanism)")),
        "share_on": (by_mechanism, on, _percent("share on alone: P(the mechanism)")),
        "closure": (own, 100 - off.sum(axis=1), _percent("closure: 100 - sum of the shares by switching off")),
        "share_none": (own, part(0), _percent("share that is left with all mechanisms off: P(none)")),
        "amplitude": (
            own,
            part.total,
            {"long_name": "amplitude with all mechanisms on", "units": str(output.get("units", "1"))},
        ),
        "amplitude_error": (
            own,
            part.error,
            {
                "long_name": "scatter or error of that amplitude, at least rounding",
                "units": str(output.get("units", "1")),
            },
        ),
    }


def _direct(
    cube: xr.Dataset, settings: ContributionSettings, part: Projections, own: tuple[str, ...], mechanisms: list[str]
) -> dict[str, _Variable]:
    """Shares from the split in the model, if the cube holds a part for every mechanism."""
    names = settings.part_names
    if not names or not set(names) <= set(cube.data_vars) or not set(mechanisms) <= set(cube["part"].values.tolist()):
        return {}
    sizes, phases = (cube[name].sel(part=mechanisms).where(cube["outcome"] == Outcome.FINISHED) for name in names)
    if {*sizes.dims} != {"point", "part", *own}:
        return {}
    if settings.output.endswith("_rms"):  # the parts are amplitudes
        sizes = sizes * np.sqrt(1 - 0.5 * (cube["order"] != 0))
    parts = (sizes * np.exp(1j * np.radians(phases))).transpose("point", "part", *own)
    direct = part.of_whole(parts.values)
    meaning = "share by direct decomposition: what the mechanism's forces add with all mechanisms on"
    rest = "100 - sum of the shares by direct decomposition"
    return {
        "share_direct": (("mechanism", *own), direct, _percent(meaning)),
        "direct_remainder": (own, 100 - direct.sum(axis=1), _percent(rest)),
    }


def _cooperation(part: Projections, own: tuple[str, ...], mechanisms: list[str]) -> dict[str, _Variable]:
    """Results that need all combinations: Shapley values and interactions."""
    everything = [part(combination) for combination in range(part.all_on + 1)]
    pairs = list(combinations(range(part.count), 2))
    shapley = np.stack([shapley_index(everything, part.count, (each,)) for each in range(part.count)], axis=1)
    shares: dict[str, _Variable] = {
        "share_shapley": (("mechanism", *own), shapley, _percent("share by Shapley value of P")),
        "missing_combinations": ((), _missing(part, mechanisms), {"long_name": "combinations without a result"}),
    }
    for name, extreme, position in (("low", "least", 0), ("high", "most", 1)):
        bound = np.stack([shapley_bounds(everything, part.count, each)[position] for each in range(part.count)], axis=1)
        meaning = f"share by Shapley value at {extreme}, if missing P lie between the smallest and largest known ones"
        shares[f"share_shapley_{name}"] = (("mechanism", *own), bound, _percent(meaning))
    if not pairs:
        return shares
    together = np.stack([shapley_index(everything, part.count, pair) for pair in pairs], axis=1)
    largest = np.argmax(np.abs(together), axis=1)  # NaN counts as the largest, and stays NaN
    size = np.take_along_axis(together, largest[:, None], axis=1)[:, 0]
    names = np.array(_pair_labels(mechanisms)[1], dtype=object)
    return shares | {
        "interaction": (("pair", *own), together, _percent("Shapley interaction index of two mechanisms")),
        "strongest_pair": (
            own,
            np.where(np.isnan(size), "", names[largest]),
            {"long_name": "pair with the largest interaction"},
        ),
        "strongest_interaction": (own, size, _percent("interaction of the strongest pair")),
    }


def _missing(part: Projections, mechanisms: list[str]) -> NDArray[Any]:
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


def _with_flags(
    operating: OperatingPoints, part: Projections, variables: dict[str, _Variable]
) -> dict[str, xr.Variable]:
    """The variables over the operating points, with a flag next to every number: why it is NaN."""
    labelled = {}
    for name, (dims, data, attrs) in variables.items():
        over = (*operating.dims, *dims)
        shape = (*operating.shape, *data.shape[1:])
        if data.dtype.kind == "f":
            attrs = attrs | {"ancillary_variables": f"{name}_flag"}
            weak = part.weak if data.ndim == part.weak.ndim else part.weak[:, None]
            why = np.where(np.isnan(data.astype(float)), np.where(weak, 1, 2), 0).astype(np.int8)
            meanings = {
                "long_name": f"why {name} is missing",
                "flag_values": np.array(list(_FLAGS), np.int8),
                "flag_meanings": " ".join(_FLAGS.values()),
            }
            labelled[f"{name}_flag"] = xr.Variable(over, why.reshape(shape), meanings)
        labelled[name] = xr.Variable(over, data.reshape(shape), attrs)
    return labelled
