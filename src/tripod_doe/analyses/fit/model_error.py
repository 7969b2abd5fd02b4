"""Errors of the model at the points of records, as standard deviations of the real and of the imaginary part.

What a model leaves out is a function of the operating point, and a smooth one: at joints of `needles` with random
geometry the errors of `kinetostatic` in both orders, and of `equilibrium` in the third, follow the joint angle and
hardly anything else (benchmarks/RESULTS.md). So records at similar joint angles share a part of the error (a Gaussian
process over the logarithm of the angle, whose values are nuisance parameters of a fit); the rest is independent.

- A recorded error is a median, which of a normal error is 0.67 of its deviation. Its square counts once in the
  independent part, and twice in the shared one. How large it is in a fit follows from its residuals (error_size.py).
- The second order of `kinetostatic` is what the skew of the needles gives at each groove; three grooves nearly cancel,
  and their errors do not. It errs by a part of what each groove gives, and by a part of what the turning of its needles
  since the start has added: how fast needles turn is the least certain. The likelihood of these errors is e^40 times
  as large as with errors in proportion to the order itself.
- Phases err by more than amplitudes, as far as that is on record: the third order of `kinetostatic` by 0.8 to 1 % of
  itself across and 0.3 % along. That matters where the angle of the marker is known.

A given error is taken as it is: shared by all records, with half of its square independent in each. The numerical error
that a run reports, and the difference of its last two revolutions, are part of what is on record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.joint.known_errors.other_orders import SOURCE, deviations_of_orders
from tripod_doe.joint.orders import ORDERS
from tripod_doe.model_interface import Accuracy, Quantity, Simulator
from tripod_doe.number_text import number, numbers_in_words

_DEVIATION = 1.48  # of a normal error over its median
_ASSUMED = 0.03  # relative, where nothing is on record
_LEAST = 0.003  # relative, of the third order: medians of ten similar points are no surer
_OTHER = 0.13  # relative error of any order but the third where it is not on record, or not next to the third
_FINEST = {3: 0.003, 2: 0.05}  # between two implementations of the finest model
_FINEST_OTHER = 0.05
_LENGTH = {"kinetostatic": 0.2}  # correlation length of errors over the logarithm of the joint angle
_USUAL_LENGTH = 1.0
_LOW, _HIGH = np.log(0.1), np.log(60.0)  # logarithms of deg: smaller angles count as the first
TURNING = "kinetostatic"
"""The model whose errors are recorded in the parts below."""

# of the second order at a groove, and of what its needles' turning has added: independent, and shared
_OWN_PARTS = np.array([0.08, 0.04])
_ALIKE_PARTS = np.array([0.06, 0.22])
_AHEAD = np.exp(2j * np.radians(120) * np.arange(3))  # second order of equally skewed needles at the three grooves


@dataclass(frozen=True)
class ModelError:
    """Errors of the model at the points of the records, N."""

    own: FloatArray  # deviation in one record alone, with any phase and more across, shape (2, record, order)
    # changes of the complex orders by errors that records share, each by a factor of deviation 1 and any phase, shape
    # (record, order, nuisance)
    shared: ComplexArray
    # further ones across the amplitude, as phases err by more, each by a real factor, shape (record, order, nuisance)
    turning: FloatArray
    source: str  # in words, where it comes from

    @property
    def whole(self) -> FloatArray:
        """Deviation of an amplitude, all errors together, shape (record, order)."""
        return np.asarray(np.sqrt(self.own[0] ** 2 + (np.abs(self.shared) ** 2).sum(axis=2)), float)

    def at(self, record: int) -> Self:
        """The errors at one of the records."""
        own, shared, turning = self.own[:, [record]], self.shared[[record]], self.turning[[record]]
        return replace(self, own=own, shared=shared, turning=turning)

    def times(self, factors: FloatArray) -> Self:
        """The same errors, larger or smaller by factors: with any phase, and more across, shape (2, order)."""
        shared, turning = factors[0][:, None] * self.shared, factors[1][:, None] * self.turning
        return replace(self, own=factors[:, None] * self.own, shared=shared, turning=turning)


@dataclass(frozen=True)
class Needles:
    """What a model says of needles at some points."""

    second: ComplexArray  # second order at each groove, N, shape (point, groove)
    skew: FloatArray  # mean skew in the last revolution, deg, shape (point, groove); NaN of models without needles

    def turned(self, initial: FloatArray) -> FloatArray:
        """How far they have turned since the start, root mean square over grooves, deg, shape (point,)."""
        return np.asarray(np.sqrt(((self.skew - initial) ** 2).mean(axis=1)), float)


def model_error(
    simulator: Simulator,
    columns: Mapping[str, NDArray[Any]],
    orders: Sequence[int],
    predicted: ComplexArray,
    setting: Literal["recorded"] | float,
    needles: Needles | None = None,
) -> ModelError:
    """Errors at the points of the records.

    Args:
        orders, predicted: The fitted orders, and their complex amplitudes, shape (record, order).
        setting: The relative error, or "recorded".
        needles: Where they are known, the error of the second order follows from them.
    """
    amplitude = np.abs(predicted)
    unit = np.divide(predicted, amplitude, out=np.ones_like(predicted), where=amplitude > 0)
    if setting != "recorded":
        whole = float(setting) * amplitude
        words = f"{100 * float(setting):g} % of each order, as given" if setting else "none, as given"
        shared = _each_order(np.asarray(whole * unit, complex), np.ones((len(amplitude), 1)))
        own = np.stack([whole / np.sqrt(2), np.zeros_like(whole)])
        return ModelError(own, shared, np.zeros((*amplitude.shape, 0)), words)
    relative, known = np.empty(amplitude.shape), np.ones(len(amplitude), bool)
    second, third = _second_and_third(simulator, columns)
    finest = np.array([str(model) == simulator.model_names[-1] for model in columns["model"]])
    for column, order in enumerate(orders):
        if order == 3:
            known = np.isfinite(third) | finest
            usual = np.where(np.isfinite(third), np.maximum(_DEVIATION * third, _LEAST), _ASSUMED)
        else:
            usual = np.full(len(amplitude), _OTHER)
        relative[:, column] = np.where(finest, _FINEST.get(order, _FINEST_OTHER), usual)
    others, across = _other_orders(simulator, columns, orders, amplitude)
    on_record = np.isfinite(others)
    whole = np.where(on_record, others / np.sqrt(3), relative * amplitude)
    recorded = np.zeros(len(amplitude), bool)  # whether the error of the second order is
    if 2 in orders and 3 in orders and not on_record.any():
        at, by = list(orders).index(2), list(orders).index(3)
        missed = second * amplitude[:, by]
        recorded = np.isfinite(missed) & ~finest
        whole[recorded, at] = np.minimum(whole[recorded, at], _DEVIATION * missed[recorded])
    models = set(columns["model"].astype(str).tolist())
    alike = _alike(columns["joint_angle_deg"], max(_LENGTH.get(model, _USUAL_LENGTH) for model in models))
    turned = np.sqrt(np.fmax(across**2 - 3 * whole**2, 0.0) / 3)  # as a part of the error in one record alone
    turned[:, [order == 2 for order in orders]] = 0.0  # its complex errors are on record
    own, shared = whole.copy(), _each_order(np.sqrt(2) * whole * unit, alike)
    of_second = f"of order 2 at most {100 * _OTHER:g} %" if 2 in orders and recorded.all() else None
    if 2 in orders and needles is not None and models == {TURNING}:
        initial = np.stack([columns[f"initial_skew_{at}_deg"] for at in (1, 2, 3)], axis=1)
        of_turning = second_of_skews(needles, needles.skew - initial)
        parts = np.stack([needles.second, of_turning], axis=1)  # (point, 2, groove)
        if np.isfinite(parts).all():
            at = list(orders).index(2)
            own[:, at] = np.sqrt(((np.abs(parts) * _OWN_PARTS[:, None]) ** 2).sum(axis=(1, 2)))
            of_grooves = np.zeros((*amplitude.shape, parts[0].size * alike.shape[1]), complex)
            by_node = (parts * _ALIKE_PARTS[:, None])[..., None] * alike[:, None, None]
            of_grooves[:, at] = by_node.reshape(len(parts), -1)
            shared[:, at] = 0.0
            shared = np.concatenate([shared, of_grooves], axis=2)
            of_second = (
                "of the second order, parts of what each groove gives and of what the turning of its needles adds"
            )
    words = _origin(orders, bool(finest.all()), known, of_second, bool(on_record.any()), bool(turned.any()))
    turning = _each_order(np.sqrt(2) * turned, alike) if turned.any() else np.zeros((*amplitude.shape, 0))
    return ModelError(np.stack([own, turned]), shared, turning, words)


def _other_orders(
    simulator: Simulator, columns: Mapping[str, NDArray[Any]], orders: Sequence[int], amplitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Standard deviations on record, N, shape (record, order): of all orders but the third, and across, by the phases.

    They are parts of the third order, too, so that none is known without it; NaN where none is.
    """
    if 3 not in orders:
        return np.full(amplitude.shape, np.nan), np.full(amplitude.shape, np.nan)
    every = np.zeros((len(amplitude), ORDERS.size))
    every[:, list(orders)] = amplitude
    sizes, phases = (each[:, list(orders)] for each in deviations_of_orders(simulator, columns, every))
    return sizes, np.radians(phases) * amplitude


def _origin(
    orders: Sequence[int], finest: bool, third: NDArray[np.bool_], second: str | None, recorded: bool, phases: bool
) -> str:
    """Where the errors come from, in words.

    Args:
        orders: The orders.
        finest: Whether all points are of the finest model.
        third: Whether an error of the third order is on record, shape (record,).
        second: What is known of the second order, in words; None where nothing is.
        recorded: Whether the errors of other orders are on record.
        phases: Whether phases err by more than amplitudes.
    """
    if finest:
        words, known, assumed = "from two implementations of this model", {*_FINEST}, _FINEST_OTHER
    else:
        known, assumed = {*orders} if recorded else {3, 2 if second else 3}, _OTHER
        words = "recorded for similar points"
        if not third.all():
            words += (
                f"; at {int((~third).sum())} of {third.size} records none is, and {_deviation(_ASSUMED)} is assumed"
            )
        words += f"; {second}" if second else ""
        rest = sorted(set(orders) - {3, 2 if second else 3}) if recorded else []
        others_known = [f"order{'s' * (len(rest) > 1)} {numbers_in_words(rest)}"] * bool(rest) + ["phases"] * phases
        words += f"; of {' and of '.join(others_known)} from {SOURCE}" if others_known else ""
    if others := sorted(set(orders) - known):
        which = f"order{'s' * (len(others) > 1)} {numbers_in_words(others)}"
        words += f"; of {which} none is, and {_deviation(assumed)} is assumed"
    return words


def _deviation(own: float) -> str:
    """The standard deviation of one record in words: its own part, and a shared part of twice its square."""
    return f"a standard deviation of {number(100 * np.sqrt(3) * own, 2)} %"


def _alike(angles: FloatArray, length: float) -> FloatArray:
    """Weights of nodes whose sums of products are exp(-d^2/2), d the distance of logarithms of angles over the length.

    Returns:
        shape (record, node).
    """
    nodes = np.linspace(_LOW, _HIGH, 1 + round(2 * (_HIGH - _LOW) / length))
    places = np.clip(np.log(np.maximum(np.abs(angles), 1e-9)), _LOW, _HIGH)
    weights = np.exp(-(((places[:, None] - nodes) / length) ** 2))
    return np.asarray(weights / np.linalg.norm(weights, axis=1)[:, None], float)


def _each_order(changes: Any, alike: FloatArray) -> Any:
    """Changes that records share in each order by itself, shape (record, order, order times node)."""
    width = changes.shape[1]
    by_node = changes[:, :, None, None] * np.eye(width)[:, :, None] * alike[:, None, None]
    return by_node.reshape(len(changes), width, -1)


def second_of_skews(needles: Needles, skews: FloatArray) -> ComplexArray:
    """The second order at each groove by needles with some skews, in proportion to them, shape (point, groove).

    Args:
        needles: What the model says of its own; each deg of skew gives the same.
        skews: Their skews, deg, shape (point, groove).
    """
    skew, ahead = needles.skew, _AHEAD
    size = (skew**2).sum(axis=1)
    each = np.divide((needles.second * np.conj(ahead) * skew).sum(axis=1), size, out=0j * size, where=size != 0)
    return np.asarray(each[:, None] * ahead * skews, complex)


def _second_and_third(simulator: Simulator, columns: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Typical errors of both orders over the third, shape (2, point); NaN where they are not known.

    Those of similar points count where it is known whether the joint itself vibrates, else all that may be.
    """
    asked = tuple(Quantity(f"thrust_amplitude_{order}", "thrust_amplitude", order, 1.0) for order in (2, 3))
    errors = np.full((2, len(columns["model"])), np.nan)
    for model in dict.fromkeys(columns["model"].tolist()):
        rows = np.flatnonzero(columns["model"] == model)
        own = {name: column[rows] for name, column in columns.items()}
        similar = simulator.recorded_errors(own, Accuracy(asked, floor=1.0))
        if similar is not None:
            errors[:, rows] = np.median(similar, axis=1).T
    either = simulator.model_errors(columns)
    if either is not None:
        errors[1] = np.where(np.isfinite(errors[1]), errors[1], either.expected)
    return errors
