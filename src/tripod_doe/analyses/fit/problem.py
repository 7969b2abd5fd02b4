"""A fit as a problem: its file and records, checked, laid out as scalars, and turned into points of the model.

The function that computes points is an argument, so that this module needs neither journals nor workers.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.comparison.plausibility import doubts_of_fit
from tripod_doe.analyses.fit.estimation.identifiability import skews_alike
from tripod_doe.analyses.fit.estimation.kept_skews import (
    UNLIKELY,
    first_look,
    improbability_of,
    joined,
    with_initial_skews,
)
from tripod_doe.analyses.fit.estimation.least_squares import Descent, Predict
from tripod_doe.analyses.fit.estimation.misfit import Rows
from tripod_doe.analyses.fit.estimation.solution import Skews, Solution, solve
from tripod_doe.analyses.fit.estimation.unknowns import Layout, Unknown, make_layout
from tripod_doe.analyses.fit.fit_file import FitRequest
from tripod_doe.analyses.fit.model_error import TURNING, ModelError, Needles, model_error
from tripod_doe.analyses.fit.records import RigRecord, make_rows, measured_orders, read_records
from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.files.csv_table import read_csv_table
from tripod_doe.model_interface import Parameter, Simulator, Value, check_parameters
from tripod_doe.number_text import level_or_word
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.typed_numbers import number_or_text

Answers = Callable[[Mapping[str, NDArray[Any]]], tuple[ComplexArray, Needles]]
"""Complex orders 0 to 12 of points, and what their runs say of needles; NaN where one failed."""

_CHEAP = {"needles": "kinetostatic"}
"""The model on which the search runs, by the model asked for: one that is near it wherever the search goes."""

_KEEP_SKEW = "rollers"
"""The model whose needles keep the skew that they start with."""

_SKEWS = tuple(f"initial_skew_{at}_deg" for at in (1, 2, 3))
_MOST_CANDIDATES = 10_000  # operating points of [next]


class FitProblem:
    """A fit file with its records, unknowns, and the points that they need."""

    def __init__(self, request: FitRequest) -> None:
        self.request, self.file = request, request.file
        self.simulator: Simulator = load_simulator("joint")
        self._check_names()
        self.records = read_records(request, self.simulator.parameters)
        self.orders = self.file.orders
        self.layout = self._make_layout()
        self.candidates = self._candidates()
        self.model = str(self.file.base.get("model", self.simulator.parameters["model"].default))
        self.cheap = _CHEAP.get(self.model, self.model)

    def _check_names(self) -> None:
        """Refuse unknown parameters and values or ranges that they do not take."""
        request, parameters = self.request, self.simulator.parameters
        try:
            check_parameters(parameters, self.file.base)
        except InputError as error:
            raise request.fail("[base]", error) from error
        for name, table in self.file.unknowns.items():
            where = f"[unknowns.{name}]"
            if name not in parameters:
                raise request.fail(where, f"unknown parameter{near_match(name, parameters)}")
            if parameters[name].kind != "number":
                raise request.fail(where, f"only a parameter with a range of numbers can be fitted, {name} has none")
            try:
                parameters[name].check(table.low)
                parameters[name].check(table.high)
            except InputError as error:
                raise request.fail(where, error) from error

    def _make_layout(self) -> Layout:
        unknowns, groups = [], []
        names = self.record_names
        columns = [*self.records[0].labels, *dict.fromkeys(key for each in self.records for key in each.parameters)]
        for name, table in self.file.unknowns.items():
            if table.per not in ("all", "record", *columns):
                raise self.request.fail(
                    f"[unknowns.{name}]",
                    f"per = {table.per!r}: neither all, record, nor a column of the table of records"
                    f"{near_match(table.per, ('all', 'record', *columns))}",
                )
            unknowns.append(
                Unknown(name, table.low, table.high, table.scale == "log", table.per, table.mean, table.std)
            )
            own = {"all": [""] * len(names), "record": names}.get(table.per)
            groups.append(own or [f"{table.per} {self._label(record, table.per)}" for record in self.records])
        return make_layout(unknowns, names, groups)

    def _label(self, record: RigRecord, column: str) -> str:
        """What a record has in a column by which records are grouped: a word, or a value of the joint."""
        if column in record.labels:
            return record.labels[column]
        return level_or_word(record.parameters.get(column, self.file.base.get(column, "")))

    @cached_property
    def record_names(self) -> list[str]:
        """Names of the records, each once."""
        names = [record.name for record in self.records]
        return [f"{name} ({at + 1})" if names.count(name) > 1 else name for at, name in enumerate(names)]

    def _candidates(self) -> list[dict[str, Value]]:
        """Operating points of [next], as values of parameters."""
        table, parameters = self.file.next, self.simulator.parameters
        if table is None:
            return []
        if table.table is not None:
            where = f"[next]: table = {table.table!r}"
            path = self.request.folder.file(table.table, "table")
            header, lines = read_csv_table(path, f"{self.request.origin}: {where}", _MOST_CANDIDATES)
            rows = [dict(zip(header, map(number_or_text, line), strict=True)) for line in lines.values()]
        else:
            where, names = "[next.at]", list(table.at)
            if (count := math.prod(len(table.at[name].values) for name in names)) > _MOST_CANDIDATES:
                raise self.request.fail(where, f"{count:,} candidates; at most {_MOST_CANDIDATES:,} are allowed")
            rows = [
                dict(zip(names, values, strict=True))
                for values in itertools.product(*(table.at[name].values for name in names))
            ]
        checked = list[dict[str, Value]]()
        for row in rows:
            try:
                checked.append({n: v for n, v in check_parameters(parameters, row).items() if v is not None})
            except InputError as error:
                raise self.request.fail(where, error) from error
        return checked

    @cached_property
    def varied(self) -> list[str]:
        """Parameters that differ between records or candidates."""
        own = [name for record in self.records for name in record.parameters]
        own += [name for candidate in self.candidates for name in candidate]
        return [name for name in dict.fromkeys(own) if name != "model" and name not in self.file.unknowns]

    @cached_property
    def base(self) -> dict[str, Value]:
        """Values that all points share."""
        known = check_parameters(self.simulator.parameters, self.file.base)
        return {name: value for name, value in known.items() if name not in ("model", *self.varied)}

    def operating(self, own: Mapping[str, Value]) -> dict[str, Value]:
        """Values of one record or candidate that differ between records."""
        usual: dict[str, Value] = {}
        for name in self.varied:
            parameter: Parameter = self.simulator.parameters[name]
            from_records = [record.parameters[name] for record in self.records if name in record.parameters]
            usual[name] = self.file.base.get(name, _middle(from_records) if from_records else parameter.default)
        return {name: own.get(name, usual[name]) for name in self.varied}

    def columns(
        self, operating: Sequence[Mapping[str, Value]], values: FloatArray, model: str
    ) -> dict[str, NDArray[Any]]:
        """Columns of some points, from their operating values and their unknowns, shape (point, unknown)."""
        parameters = self.simulator.parameters
        rows = [self.operating(own) for own in operating]
        columns = {"model": np.array([model] * len(rows), object)}
        columns |= {name: parameters[name].column([row[name] for row in rows]) for name in self.varied}
        return columns | {u.name: values[:, at] for at, u in enumerate(self.layout.unknowns)}

    def columns_at_middle(self, model: str) -> dict[str, NDArray[Any]]:
        """Columns of one point a record, with the unknowns in the middle of their ranges."""
        values = self.layout.values(np.full((1, self.layout.count), 0.5))[0]
        return self.columns([record.parameters for record in self.records], values, model)

    def doubts(self, points: Answers) -> list[str]:
        """What the records together say against sign or unit of the force; of points that the search computes, too."""
        model = points(self.columns_at_middle(self.cheap))[0][:, 3]
        measured = np.array([measured_orders(record, [3]).mean[0] for record in self.records])
        known = [record.reference_angle_deg is not None and record.sign is not None for record in self.records]
        return doubts_of_fit(measured, model, np.array(known))

    def predictor(self, points: Answers, model: str) -> Predict:
        """The model as the search takes it."""
        operating = [record.parameters for record in self.records]

        def predict(places: FloatArray) -> ComplexArray:
            values = self.layout.values(places)  # (trial, record, unknown)
            trials = values.shape[0]
            flat = values.reshape(-1, values.shape[-1])
            orders, _ = points(self.columns(operating * trials, flat, model))
            return np.asarray(orders[:, self.orders].reshape(trials, -1), complex)

        return predict

    def all_columns(self, columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Every parameter at some points."""
        return self.simulator.columns(self.base, columns, len(columns["model"]))

    def first_error(self) -> ModelError:
        """Errors of the model asked for at the records, from the measured orders."""
        own = measured_sizes(self.records, self.orders)
        columns = self.columns_at_middle(self.model)
        return self.error(columns, own.astype(complex))

    def error_at(self, points: Answers, place: FloatArray) -> ModelError:
        """Errors of the model asked for at the records, for unknowns at some places."""
        columns = self._columns_at(place, self.cheap)
        orders, needles = points(columns)
        own, chosen = measured_sizes(self.records, self.orders), orders[:, self.orders]
        columns["model"] = np.array([self.model] * len(self.records), object)
        return self.error(columns, np.where(np.isfinite(chosen), chosen, own), needles)

    def error(
        self, columns: Mapping[str, NDArray[Any]], predicted: ComplexArray, needles: Needles | None = None
    ) -> ModelError:
        """Error of the model at some points, from its predicted orders there, shape (point, order)."""
        every, setting = self.all_columns(columns), self.file.fit.model_error
        return model_error(self.simulator, every, self.orders, predicted, setting, needles)

    def rows(self, error: ModelError) -> Rows:
        """Measured orders with the errors of the model."""
        return make_rows(self.records, self.orders, error, self.file.records.force_scale_error)

    def fit(self, points: Answers, tell: Callable[[str], None]) -> tuple[Solution, ModelError]:
        """Search, refine, and profile, with needles that turn and, where that may be, with skews that stay.

        Args:
            tell: Takes the name of each stage as it begins.
        """
        turning, error = self._fit(points, tell)
        if not self.skews_may_stay:
            return turning, error
        tell("needles that keep their skew")
        staying = self.with_initial_skews(points)
        look = first_look(
            turning,
            self.predictor(staying, self.cheap),
            lambda best: self.rows(self.error_at(staying, best.place)),
            self.places_alike,
            self.file.fit.seed,
        )
        turned = self._turned(points, turning.best.place)
        if (lead := look - improbability_of(turning)) > UNLIKELY:
            return replace(turning, skews=Skews(False, lead, None, turned)), error
        other, error_of_other = self._fit(staying, tell, stay=True)
        likelier = joined(turning, other, turned)
        return likelier, error_of_other if likelier.problem is other.problem else error

    def _turned(self, points: Answers, place: FloatArray) -> float:
        """How far needles turn since the start, in the record where most, root mean square over trunnions, deg."""
        columns = self._columns_at(place, self.cheap)
        return float(np.nan_to_num(points(columns)[1].turned(self._initial_skews(columns))).max())

    def _columns_at(self, place: FloatArray, model: str) -> dict[str, NDArray[Any]]:
        """Columns of one point a record, for unknowns at some places."""
        values = self.layout.values(place[None])[0]
        return self.columns([record.parameters for record in self.records], values, model)

    def _initial_skews(self, columns: Mapping[str, NDArray[Any]]) -> FloatArray:
        """Skews of the needles at the start, deg, shape (point, groove)."""
        every = self.all_columns(columns)
        return np.stack([every[name] for name in _SKEWS], axis=1)

    @property
    def skews_may_stay(self) -> bool:
        """Whether skews are fitted to orders of a model whose needles turn, with errors that are on record."""
        fitted = any(name in self.file.unknowns for name in _SKEWS) and set(self.orders) == {2, 3}
        return fitted and self.model == TURNING and self.file.fit.model_error == "recorded"

    def with_initial_skews(self, points: Answers) -> Answers:
        """Answers of a joint whose needles keep the skew that they start with."""

        def answers(columns: Mapping[str, NDArray[Any]]) -> tuple[ComplexArray, Needles]:
            return with_initial_skews(*points(columns), self._initial_skews(columns))

        return answers

    def _fit(self, points: Answers, tell: Callable[[str], None], stay: bool = False) -> tuple[Solution, ModelError]:
        """Search, refine, and profile with these answers, of needles that turn or that keep their skew."""
        circle = stay or self.model == _KEEP_SKEW
        errors = [self.first_error()]

        def weigh(best: Descent) -> Rows:
            errors.append(self.error_at(points, best.place))
            return self.rows(errors[-1])

        try:
            solution = solve(
                self.layout,
                self.rows(errors[0]),
                self.predictor(points, self.cheap),
                finer=None if self.cheap == self.model else self.predictor(points, self.model),
                starts=self.file.fit.starts,
                seed=self.file.fit.seed,
                robust=self.file.fit.robust,
                weigh=weigh,
                alike=self.places_alike,
                same=self.places_of_same_joint if circle else lambda place: [],
                sized=self.file.fit.model_error == "recorded",
                tell=tell,
            )
        except InputError as error:
            raise self.request.fail("[unknowns]", error) from error
        return solution, errors[-1].times(solution.error_size.of(self.orders))

    @cached_property
    def skews_change_places(self) -> bool:
        """Whether the records leave open which trunnion is the first, and skews are fitted that this matters to."""
        free = all(record.reference_angle_deg is None for record in self.records)
        return free and sum(name in self.file.unknowns for name in _SKEWS) > 1

    def skews_alike(self, place: FloatArray) -> dict[int, list[list[float]]]:
        """Skews of the trunnions at some places, in deg, and others that records hardly tell apart: see `skews_alike`.

        Returns:
            By the first record of each group with skews of its own; empty where the records tell them apart, or where
            groups share one skew and not another one.
        """
        fitted = {unknown.name: at for at, unknown in enumerate(self.layout.unknowns) if unknown.name in _SKEWS}
        scalars, values = self.layout.index[list(fitted.values())], self.layout.values(place[None])[0]
        groups, first = np.unique(scalars, axis=1, return_index=True)
        if not self.skews_change_places or groups.size != np.unique(scalars).size:
            return {}
        usual = {name: self.file.base.get(name, self.simulator.parameters[name].default) for name in _SKEWS}
        known, either_sign = [n not in fitted for n in _SKEWS], all(record.sign is None for record in self.records)
        alike = {}
        for record in first.tolist():
            skews = [float(str(values[record, fitted[n]] if n in fitted else usual[n])) for n in _SKEWS]
            alike[record] = [skews, *skews_alike(skews, known, either_sign)]
        return alike

    def places_alike(self, place: FloatArray) -> list[FloatArray]:
        """Places with such other skews, at the nearest bounds where they are beyond."""
        return [np.clip(other, 0.0, 1.0) for other in self._places_alike(place)]

    def places_of_same_joint(self, place: FloatArray) -> list[FloatArray]:
        """Places within the bounds with such skews: where needles keep them, trunnions numbered from another one."""
        return [other for other in self._places_alike(place) if ((other >= 0) & (other <= 1)).all()]

    def _places_alike(self, place: FloatArray) -> list[FloatArray]:
        """Places with skews on other trunnions in one group, or with opposite signs in all groups."""
        groups = self.skews_alike(place)
        changes = [{first: skews} for first, alike in groups.items() for skews in alike[1:3]]
        changes += [dict(zip(groups, skews, strict=True)) for skews in list(zip(*groups.values(), strict=True))[3:]]
        places = [place.copy() for _ in changes]
        for other, change in zip(places, changes, strict=True):
            for unknown, scalars in zip(self.layout.unknowns, self.layout.index, strict=True):
                if unknown.name in _SKEWS:
                    for first, skews in change.items():
                        other[scalars[first]] = unknown.place(skews[_SKEWS.index(unknown.name)])
        return places


def _middle(values: Sequence[Value]) -> Value:
    """The middle one of some values."""
    ordered = sorted(values, key=lambda value: (isinstance(value, str), value))
    return ordered[len(ordered) // 2]


def measured_sizes(records: Sequence[RigRecord], orders: Sequence[int]) -> FloatArray:
    """Measured amplitudes, shape (record, order)."""
    return np.array([np.abs(measured_orders(record, orders).mean) for record in records])
