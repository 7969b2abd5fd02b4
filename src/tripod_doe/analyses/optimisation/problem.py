"""An optimisation as a problem: candidates become points of a study, and answers objectives and constraints."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.optimisation.manufacturing_scatter import Scatter, make_scatter
from tripod_doe.analyses.optimisation.measures import Ends, Judged, PointValues, judged
from tripod_doe.analyses.optimisation.operating_points import OperatingPoints, operating_points
from tripod_doe.analyses.optimisation.optimisation_file import ConstraintTable, ObjectiveTable, OptimisationRequest
from tripod_doe.analyses.optimisation.variables import Variables, make_variables
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.joint.accuracy import SMALLEST_THIRD
from tripod_doe.joint.known_errors.other_orders import deviations_of_orders
from tripod_doe.model_interface import Simulator, Value, check_parameters
from tripod_doe.phases import JUMPS, is_phase_name
from tripod_doe.study.cube.responses import response_values
from tripod_doe.study.definition.responses import ERROR
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.definition.toml_text import toml_text
from tripod_doe.study.designs import Points

_AMPLITUDE, _THIRD = "thrust_amplitude", 3
_MODEL = "model"
_OTHER_SAMPLE = 1_000_003  # added to the seed for the confirming sample

Sample = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Problem:
    """A checked optimisation."""

    request: OptimisationRequest
    simulator: Simulator
    base: Mapping[str, Value]  # checked base values that all points share
    start: Mapping[str, Value]  # values of the variables where the search starts
    variables: Variables
    operating: OperatingPoints
    scatter: Scatter
    model: str  # model of the search; empty where there is one only
    confirm: str  # model that confirms

    @property
    def objectives(self) -> dict[str, ObjectiveTable]:
        """Their tables by name."""
        return self.request.file.objectives

    @property
    def constraints(self) -> dict[str, ConstraintTable]:
        """Their tables by name."""
        return self.request.file.constraints

    @property
    def signs(self) -> FloatArray:
        """1 for an objective to minimise, -1 for one to maximise."""
        return np.array([1.0 if table.goal == "minimise" else -1.0 for table in self.objectives.values()])

    @property
    def is_corrected(self) -> bool:
        """Whether a better model corrects the search, which takes at least two confirmed candidates."""
        return self.confirm != self.model and self.request.file.search.confirmed > 1

    @property
    def confirmed_base(self) -> dict[str, Value]:
        """[base] of the file with the model whose answers the front holds."""
        return confirmed_base(self.request.file.base, self.model, self.confirm)

    @property
    def start_unit(self) -> FloatArray:
        """Start of the search on the unit cube, shape (variable,)."""
        return np.array([each.unit(self.start[each.name]) for each in self.variables.chosen])

    @cached_property
    def search_sample(self) -> Sample:
        """The sample of the scatter that stands for each candidate of the search; empty without scatter."""
        table = self.request.file.search
        return self.scatter.sample(table.samples, table.seed)

    @cached_property
    def confirming_sample(self) -> Sample:
        """The other sample, by which candidates are confirmed."""
        table = self.request.file.search
        return self.scatter.sample(table.confirm_samples, table.seed + _OTHER_SAMPLE)

    def misfits(self, units: FloatArray) -> list[str]:
        """Why candidates cannot be, empty where they can: a value follows or scatters beyond its parameter's range."""
        reasons = self.variables.misfits(units)
        if not self._reach or not len(units):
            return reasons
        columns = self.variables.columns(units)
        for name, (least, most) in self._reach.items():
            for row, value in enumerate(columns[name].tolist()):
                reasons[row] = reasons[row] or self.scatter.misfit(name, (value + least, value + most))
        return reasons

    @cached_property
    def _reach(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest difference from the value of a candidate, by variable that scatters."""
        both = {
            name: np.concatenate([self.search_sample[name], self.confirming_sample[name]])
            for name in sorted(self.scatter.relative)
        }
        return {name: (float(apart.min()), float(apart.max())) for name, apart in both.items()}

    def joints(self, sample: Sample) -> int:
        """Number of joints that stand for a candidate."""
        return len(next(iter(sample.values()))) if sample else 1

    def columns(self, units: FloatArray, sample: Sample, model: str) -> dict[str, NDArray[Any]]:
        """Points of candidates: for each candidate all joints of the sample, for each joint all operating points.

        Args:
            units: Candidates on the unit cube, shape (candidate, variable).
            model: Their model; empty where there is one only.
        """
        candidates, joints, places = len(units), self.joints(sample), self.operating.count
        columns = {name: np.repeat(column, joints * places) for name, column in self.variables.columns(units).items()}
        for name, column in sample.items():
            own = np.tile(np.repeat(column, places), candidates)
            columns[name] = columns[name] + own if name in columns else own
        for name in self.operating.names:
            column = self.simulator.parameters[name].column([row[name] for row in self.operating.values])
            columns[name] = np.tile(column, candidates * joints)
        if model:
            columns[_MODEL] = np.array([model] * (candidates * joints * places), object)
        return columns

    def study(self, origin: str, folder: Path, table: str, keep: tuple[str, ...] = ()) -> Study:
        """The study of all points; its design is a table.

        Args:
            keep: Outputs that it keeps besides those that are judged.
        """
        head, names, rules = self.request.file.optimisation, self._varied, self.request.folder
        factors: dict[str, Any] = {name: {} for name in names if name != _MODEL}
        if _MODEL in names:
            factors[_MODEL] = {"values": list(dict.fromkeys((self.model, self.confirm)))}
        content: dict[str, Any] = {
            "study": {"name": f"{head.name}: points"}
            | ({"function": head.function} if head.function else {"scene": head.scene}),
            "base": dict(self.base),
            "factors": factors,
            "design": {"kind": "table", "table": table},
        }
        if self.request.file.responses:
            content["responses"] = {
                name: each.model_dump(exclude_unset=True) for name, each in self.request.file.responses.items()
            }
        if self.simulator.outputs:
            outputs = [*keep, *(name for name, _ in self.quantities if name in self.simulator.outputs)]
            outputs += [f"{name}{ERROR}" for name in outputs if f"{name}{ERROR}" in self.simulator.outputs]
            content["keep"] = {"outputs": list(dict.fromkeys(outputs)) or [next(iter(self.simulator.outputs))]}
        return parse_study(
            toml_text(content), origin, _PointsFolder(rules.path, rules.trusted, rules.most_points, folder)
        )

    @property
    def _varied(self) -> list[str]:
        names = [*self.variables.names, *self.scatter.factors, *self.operating.names]
        return list(dict.fromkeys([*names, *([_MODEL] if self.model else [])]))

    @property
    def quantities(self) -> list[tuple[str, int | None]]:
        """Output and order of all that is judged, each once."""
        aims = [(table.output, table.order) for table in self.objectives.values()]
        return list(dict.fromkeys([*aims, *((table.output, table.order) for table in self.constraints.values())]))

    def judge(
        self,
        study: Study,
        points: Points,
        ends: Ends,
        outputs: Mapping[str, Any],
        labels: Mapping[str, Any],
        sample: Sample,
    ) -> Judged:
        """Objectives and constraints of candidates from the answers of their points, in the order of `columns`."""
        finished = ~ends.failed.ravel()
        own = {each.response.name: each for each in response_values(study, points, outputs, labels, finished)}
        columns = study.simulator.columns(study.base, points.at(slice(None)), points.count)
        errors = study.simulator.model_errors(columns)
        shape = (len(ends.outcome), self.joints(sample), self.operating.count)
        values: dict[tuple[str, int | None], PointValues] = {}
        for name, order in self.quantities:
            value, numerical = self._values(name, order, outputs, labels, own, columns)
            if value is None:
                value = np.full(points.count, np.nan)
            elif name in self.simulator.outputs:
                value = self.simulator.outputs[name].given(value)
            value = np.where(finished, value, np.nan)
            numerical = np.full(points.count, np.nan) if numerical is None else numerical
            expected = np.full(points.count, np.nan)
            if name == _AMPLITUDE and order and errors is not None and name in outputs:
                expected = self._expected(order, np.nan_to_num(outputs[name][1]), columns, errors.expected)
            if name in columns:  # a parameter is exact
                numerical, expected = np.zeros(points.count), np.zeros(points.count)
            values[name, order] = PointValues(*(each.reshape(shape) for each in (value, numerical, expected)))
        quantile = self.request.file.optimisation.quantile
        quotients = [each.response.name for each in own.values() if "/" in each.response.formula]
        return judged(self.objectives, self.constraints, values, ends, self.operating.weights, quantile, quotients)

    def _expected(
        self, order: int, amplitude: FloatArray, columns: Mapping[str, NDArray[Any]], third: FloatArray
    ) -> FloatArray:
        """Error to expect of an order of the thrust, N: an optimum may be small as parts of it cancel, its error not.

        Args:
            amplitude: N, shape (point, order).
            third: Relative error of the third order on record, shape (point,).
        """
        if order != _THIRD:
            return deviations_of_orders(self.simulator, columns, amplitude)[0][:, order]
        least = SMALLEST_THIRD * np.abs(columns["torque_n_m"]) * 1e3 / columns["pitch_radius_mm"]
        return np.asarray(third * np.maximum(amplitude[:, order], least))

    def _values(
        self,
        name: str,
        order: int | None,
        outputs: Mapping[str, Any],
        labels: Mapping[str, Any],
        own: Mapping[str, Any],
        columns: Mapping[str, NDArray[Any]],
    ) -> tuple[FloatArray | None, FloatArray | None]:
        """A quantity of all points with its numerical error; None where no point has it."""
        if name in columns:
            column, parameter = columns[name], self.simulator.parameters[name]
            if parameter.follows and column.dtype.kind == "f":
                column = np.where(np.isnan(column), columns[parameter.follows], column)
            return np.asarray(column, float), None
        if name in own:
            dims, data, error = own[name].dims, own[name].values, own[name].error
        elif name in outputs:
            dims, data = outputs[name]
            beside = outputs.get(f"{name}{ERROR}", (None, None))
            error = beside[1] if beside[0] == dims else None
        else:
            if not self.simulator.outputs and outputs:
                known = [*outputs, *own, *columns]
                what = f"not among what {self.simulator.name} returns{near_match(name, known)}"
                raise InputError(f"{self.request.origin}: output = {name!r}: {what}")
            return None, None
        at = self._at(name, order, dims, labels)
        return data[at], None if error is None else error[at]

    def _at(self, name: str, order: int | None, dims: tuple[str, ...], labels: Mapping[str, Any]) -> tuple[Any, ...]:
        """The place of one number a point."""
        if order is None and not dims:
            return (slice(None),)
        if order is not None and dims == ("order",):
            places = np.flatnonzero(np.asarray(labels["order"]) == order)
            if places.size:
                return slice(None), int(places[0])
            raise InputError(f"{self.request.origin}: output = {name!r}: no order {order}")
        raise InputError(f"{self.request.origin}: output = {name!r}: {_not_one_number(order, dims)}")


@dataclass(frozen=True)
class _PointsFolder(StudyFolder):
    """The folder of an optimisation file, with the table of the points elsewhere."""

    tables: Path = Path()

    def file(self, name: str, key: str) -> Path:
        """The table of the points."""
        return self.tables / name  # an absolute name stays as it is

    def check_file(self, name: str, key: str) -> None:
        """Do nothing: the table is written here."""


def _not_one_number(order: int | None, dims: tuple[str, ...]) -> str:
    if order is not None and "order" not in dims:
        return "it has no orders; leave order out"
    if dims == ("order",):
        return "give the order"
    return (
        f"it has values along {', '.join(dims)}; define a response that reduces it to one number, "
        "[responses.NAME] formula"
    )


def make_problem(request: OptimisationRequest) -> Problem:
    """Check an optimisation file against its simulator, before anything runs.

    Raises:
        InputError: If a name, value or combination in it is wrong.
    """
    file = request.file
    head = file.optimisation
    _refuse_unread(request)
    try:
        simulator = load_simulator(head.scene, head.function, request.folder)
    except InputError as error:
        raise request.fail("[optimisation]", error) from error
    try:
        base = {
            name: value
            for name, value in check_parameters(simulator.parameters, file.base).items()
            if value is not None
        }
    except InputError as error:
        raise request.fail("[base]", error) from error
    operating = operating_points(request, simulator.parameters)
    scatter = make_scatter(request, simulator.parameters, base)
    varied = {
        **dict.fromkeys(scatter.factors.keys() - scatter.relative, "[scatter]"),
        **dict.fromkeys(operating.names, "[at]"),
    }
    variables = make_variables(request, simulator, base, varied)
    model, confirm = _models(request, simulator, base, [*variables.names, *operating.names])
    start = {each.name: _start_value(each.name, base, simulator, each) for each in variables.chosen}
    for each in variables.chosen:
        if not each.levels and isinstance(start[each.name], str):
            raise request.fail("[base]", f"{each.name} = {start[each.name]!r}: [variables.{each.name}] has numbers")
    fixed = {
        name: value for name, value in base.items() if name not in {*variables.names, *varied, _MODEL * bool(model)}
    }
    problem = Problem(request, simulator, fixed, start, variables, operating, scatter, model, confirm)
    _check_quantities(problem)
    study = problem.study(request.origin, request.folder.path, "points.csv")
    _refuse_phases(problem, [response.name for response in study.responses if response.expression.is_phase])
    return problem


def _refuse_phases(problem: Problem, formulas: list[str]) -> None:
    """Refuse objectives and constraints of phases; those formulas are some, too."""
    for table, entries in (("objectives", problem.objectives), ("constraints", problem.constraints)):
        for name, entry in entries.items():
            if is_phase_name(entry.output) or entry.output in formulas:
                remedy = f"a response with abs, as abs({entry.output} - 30), is its distance from an angle"
                raise problem.request.fail(f"[{table}.{name}]", f"output = {entry.output!r}: {JUMPS}; {remedy}")


def _refuse_unread(request: OptimisationRequest) -> None:
    """Refuse keys that other keys of the file leave without effect."""
    file, search = request.file, request.file.search
    if file.optimisation.function and "scene" in file.optimisation.model_fields_set:
        raise request.fail("[optimisation]", "scene and function: give one of them")
    if grouped := [name for name, table in file.scatter.items() if table.group is not None]:
        raise request.fail(f"[scatter.{grouped[0]}]", "group: used by designs only; leave it out")
    if file.scatter:
        return
    unread = [
        ("[optimisation]", file.optimisation.model_fields_set & {"quantile"}, "[scatter]"),
        ("[search]", search.model_fields_set & {"samples", "confirm_samples"}, "[scatter]"),
        ("[search]", search.model_fields_set & {"confirmed"} if search.confirm is None else (), "confirm or [scatter]"),
    ]
    for where, keys, needed in unread:
        if keys:
            raise request.fail(where, f"{', '.join(sorted(keys))}: used with {needed} only; leave out")


def _start_value(name: str, base: Mapping[str, Value], simulator: Simulator, variable: Any) -> Value:
    """The value of a variable where the search starts: in [base], else its default, else the middle of its range."""
    value = base.get(name, simulator.parameters[name].default)
    if value is None:
        value = simulator.effective(base).get(name)
    return variable.values(np.array([0.5])).tolist()[0] if value is None else value


def _models(
    request: OptimisationRequest, simulator: Simulator, base: Mapping[str, Value], taken: list[str]
) -> tuple[str, str]:
    """The model of the search, and the one that confirms; empty where there is one only."""
    confirm = request.file.search.confirm
    if not simulator.model_names or _MODEL in taken:
        if confirm is not None:
            reason = (
                "the model is a variable or an operating parameter" if _MODEL in taken else "there is only one model"
            )
            raise request.fail("[search]", f"confirm = {confirm!r}: {reason}; leave it out")
        return "", ""
    model = str(base.get(_MODEL, simulator.parameters[_MODEL].default))
    if confirm is not None and confirm not in simulator.model_names:
        raise request.fail(
            "[search]", f"confirm = {confirm!r}: unknown model{near_match(confirm, simulator.model_names)}"
        )
    return model, confirm or model


def _check_quantities(problem: Problem) -> None:
    """Refuse objectives and constraints of what does not exist, or of more than one number."""
    request, simulator = problem.request, problem.simulator
    own = list(request.file.responses)
    for table, entries in (("objectives", problem.objectives), ("constraints", problem.constraints)):
        for name, entry in entries.items():
            where = f"[{table}.{name}]"
            known = [*simulator.outputs, *own, *simulator.parameters]
            if simulator.outputs and entry.output not in known:
                raise request.fail(where, f"output = {entry.output!r}: unknown{near_match(entry.output, known)}")
            if entry.output in simulator.outputs:
                dims = simulator.outputs[entry.output].dims
                if dims != (() if entry.order is None else ("order",)):
                    raise request.fail(where, f"output = {entry.output!r}: {_not_one_number(entry.order, dims)}")
                labels = simulator.labels([entry.output], {}) if dims else {}
                if entry.order is not None and entry.order not in (known := labels["order"].tolist()):
                    raise request.fail(where, f"order = {entry.order}: the orders are {known[0]} to {known[-1]}")
            elif entry.order is not None and simulator.outputs:
                raise request.fail(where, f"output = {entry.output!r}: {_not_one_number(entry.order, ())}")


def confirmed_base(base: Mapping[str, Value], model: str, confirm: str) -> dict[str, Value]:
    """[base] of a file, with the confirming model in place of the one of the search."""
    return {**base, **({_MODEL: confirm} if confirm != model else {})}


def pasted(values: Mapping[str, Value], fixed: Mapping[str, Value]) -> str:
    """The [base] of a joint, to paste into a study."""
    lines = ["[base]"]
    lines += [f"{name} = {json.dumps(value)}" for name, value in {**fixed, **values}.items()]
    return "\n".join(lines) + "\n"
