"""Study files, read and checked: a TOML text becomes a `Study`, or an error that names file, key, value and remedy."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tripod_doe.errors import InputError, first_messages, near_match
from tripod_doe.model_interface import NUMERICS, Accuracy, Outcome, Simulator, Value, check_parameters
from tripod_doe.study.definition.accuracy_table import AUTO, AutoModel, check_accuracy, check_auto_model
from tripod_doe.study.definition.design_tables import (
    ablation_at_operating_points,
    check_parts,
    designs_of,
    fidelity_factor,
    refuse_unread_keys,
    switches_of_study,
    varied_around_base,
)
from tripod_doe.study.definition.factors import Factor, checked_factor, refuse_unread
from tripod_doe.study.definition.responses import check_responses, stored_outputs
from tripod_doe.study.definition.retry_plan import check_retries
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file_schema import (
    AccuracyTable,
    FactorTable,
    RunTable,
    StudyFile,
    StudyTable,
    parse_file,
)
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.definition.toml_text import parse_toml, read_text, toml_text
from tripod_doe.study.expressions import Expression


def load_study(study: str | Path | Mapping[str, Any], folder: StudyFolder | None = None) -> Study:
    """Read and check a study.

    Args:
        study: Its file, or its tables as a dict: ``{"study": {"name": "..."}, "factors": {...}}``.
        folder: Where its files and functions are looked up; its own folder if omitted, or the current one of a dict,
            without restriction.

    Raises:
        InputError: If the file cannot be read, or a table, key or value in it is wrong.
    """
    if isinstance(study, Mapping):
        return parse_study(toml_text(study), folder=folder)
    path = Path(study)
    return parse_study(read_text(path, "study file"), str(path), folder or StudyFolder.of(path))


def parse_study(text: str, origin: str = "study", folder: StudyFolder | None = None) -> Study:
    """Check the text of a study file; see `load_study`.

    Args:
        text: The study file.
        folder: Where its files and functions are looked up; the current folder if omitted, without restriction.
    """
    folder = folder or StudyFolder(Path.cwd())
    try:
        file = parse_file(text, origin)
    except InputError as error:
        raise InputError("\n".join([str(error), *_wrong_besides(text, origin)])) from error
    simulator = _with_place(origin, "[study]", lambda: load_simulator(file.study.scene, file.study.function, folder))
    _check_sources(origin, file, folder)
    _with_place(origin, "[design]", lambda: check_parts(file))
    if not folder.has_results:
        _refuse_unread(origin, file)
    auto = file.base.get("model") == AUTO
    base = _base(origin, simulator, _given(file.base), file.factors)
    file = _with_place(origin, "[design]", lambda: ablation_at_operating_points(simulator, file))
    switches = _with_place(origin, "[design]", lambda: switches_of_study(simulator, file))
    tables = file.factors | {name: FactorTable(values=[0, 1]) for name in switches if name not in file.factors}
    tables |= _with_place(origin, "[design]", lambda: fidelity_factor(simulator, file))
    center = {name: base.pop(name) for name in varied_around_base(file) & base.keys()}
    factors = _factors(origin, simulator, tables, base)
    keep = _with_place(origin, "[keep]", lambda: _kept(simulator, file.keep.outputs))
    first = {name: factor.values[0] for name, factor in factors.items() if factor.values} | center
    responses = _with_place(origin, "", lambda: check_responses(simulator, file.responses, {**base, **first}))
    stored = stored_outputs(simulator, keep, responses)
    _check_run(origin, file.run)
    if file.run.look_for is not None and simulator.outputs:  # those of a function are known when it has run
        along = [dim for name in keep for dim in simulator.outputs[name].dims]
        names = dict.fromkeys([*tables, *keep, *along, *(response.name for response in responses), "outcome"])
        words = {"outcome": [outcome.label for outcome in Outcome]}
        _with_place(origin, "[run]: look_for", lambda: Expression(str(file.run.look_for), names, words))
    auto_model = _auto_model(origin, simulator, file, {*base, *factors}) if auto else None
    accuracy = _accuracy(origin, simulator, file, {*base, *factors}) if file.accuracy and not auto else None
    levels = _levels(factors, center, auto_model)
    run = file.run
    tabulated = "table" in (part.kind for part in designs_of(file))
    unknown = simulator.parameters.keys() - base if tabulated else ()
    retry = _with_place(
        origin,
        "[run]",
        lambda: check_retries(simulator, base, levels, stored, run.retry, run.expected_outcomes, unknown),
    )
    study = Study(
        file, simulator, base, factors, keep, (), text, origin, folder, switches, retry, auto_model, accuracy, responses
    )
    warnings = _with_place(origin, "[base]", lambda: simulator.check(base, levels, stored))
    return replace(study, warnings=tuple(warnings))


def _factors(
    origin: str, simulator: Simulator, tables: Mapping[str, FactorTable], base: Collection[str]
) -> dict[str, Factor]:
    """Check the tables [factors.PARAMETER], none of which may be a base value."""
    if twice := [name for name in tables if name in base]:
        lines = [f"{origin}: {name} is both a base value and a factor; remove it from [base]" for name in twice]
        raise InputError("\n".join(lines))
    return {
        name: _with_place(
            origin, f"[factors.{name}]", lambda n=name, t=table: checked_factor(simulator.parameters[n], t)
        )
        for name, table in tables.items()
    }


def _levels(
    factors: Mapping[str, Factor], center: Mapping[str, Value], auto_model: AutoModel | None
) -> dict[str, tuple[Value, ...]]:
    """Values that each factor takes; empty for one that is sampled."""
    levels = {name: factor.values or () for name, factor in factors.items()}
    levels |= {name: (*levels[name], value) for name, value in center.items()}
    if auto_model is None:
        return levels
    return levels | {  # all candidates are possible
        name: tuple(dict.fromkeys(candidate.values[name] for candidate in auto_model.candidates))
        for name in auto_model.parameters
    }


def _auto_model(origin: str, simulator: Simulator, file: StudyFile, taken: set[str]) -> AutoModel:
    """The table [accuracy] of a study whose model is to be chosen."""
    table = file.accuracy or AccuracyTable()
    asked = table.__pydantic_extra__ or {}
    try:
        return check_auto_model(simulator, asked, table.confidence, table.floor, table.budget_cpu_s, taken)
    except InputError as error:
        raise InputError(f"{origin}: {error}") from error


def _accuracy(origin: str, simulator: Simulator, file: StudyFile, taken: set[str]) -> Accuracy:
    """The table [accuracy] of a study that names its model."""
    table = file.accuracy or AccuracyTable()
    if unused := table.model_fields_set & {"confidence", "budget_cpu_s"}:
        raise InputError(
            f'{origin}: [accuracy]: {", ".join(sorted(unused))}: used with model = "{AUTO}" only; leave it out'
        )
    if given := taken & {"accuracy", *NUMERICS}:
        raise InputError(
            f"{origin}: [accuracy]: {', '.join(sorted(given))} is set as well, which decides how runs are refined; "
            "leave one of them out"
        )
    try:
        accuracy = check_accuracy(simulator, table.__pydantic_extra__ or {}, table.floor)
        simulator.refined_to(accuracy)
    except InputError as error:
        raise InputError(f"{origin}: {error}") from error
    return accuracy


def _with_place(origin: str, where: str, step: Any) -> Any:
    """Run one check, and put file and key before every line of its error."""
    try:
        return step()
    except InputError as error:
        raise error.at(f"{origin}: {where}" if where else origin) from error


def _check_sources(origin: str, file: StudyFile, folder: StudyFolder) -> None:
    """Refuse forbidden tables, and factors with more values than allowed, before any value is made."""
    for design in (file.design, *file.designs.values()):
        if design.table is not None:
            _with_place(origin, "[design]", lambda d=design: folder.check_file(d.table, "table"))
    for name, table in file.factors.items():
        _with_place(origin, f"[factors.{name}]", lambda t=table: folder.refuse_many(t.count or 0, "values"))


def _given(base: Mapping[str, Any]) -> dict[str, Any]:
    """Base values of parameters, without model = "auto" and tables."""
    return {
        name: value
        for name, value in base.items()
        if isinstance(value, str | bool | int | float) and (name, value) != ("model", AUTO)
    }


def _wrong_besides(text: str, origin: str) -> list[str]:
    """Errors in names and base values of a study with errors of form elsewhere; empty if they cannot be checked."""
    try:
        raw = parse_toml(text, origin)
        study, base, factors = (raw.get(table, {}) for table in ("study", "base", "factors"))
        if not all(isinstance(table, dict) for table in (study, base, factors)) or "function" in study:
            return []
        simulator = load_simulator(str(study.get("scene", StudyTable.model_fields["scene"].default)))
    except InputError:
        return []
    try:
        _base(origin, simulator, _given(base), [name for name, table in factors.items() if isinstance(table, dict)])
    except InputError as error:
        return str(error).splitlines()
    return []


def _base(origin: str, simulator: Simulator, given: Mapping[str, Value], factors: Collection[str]) -> dict[str, Value]:
    """Check the base values; the error lists unknown factors as well."""
    wrong, base = [], dict[str, Value]()
    try:
        base = _with_place(origin, "[base]", lambda: check_parameters(simulator.parameters, given))
    except InputError as error:
        wrong.append(str(error))
    wrong += first_messages(
        [name for name in factors if name not in simulator.parameters],
        lambda name: f"{origin}: [factors.{name}]: unknown parameter{near_match(name, simulator.parameters)}",
    )
    if wrong:
        raise InputError("\n".join(wrong))
    return base


def _refuse_unread(origin: str, file: StudyFile) -> None:
    """Refuse what a study would leave out in silence: a scene, keys of designs, sub-designs and factors."""
    design = file.design
    if file.study.function and "scene" in file.study.model_fields_set:
        raise InputError(f"{origin}: [study]: scene and function: give one of them")
    _with_place(origin, "[design]", lambda: refuse_unread_keys(design))
    for name, part in file.designs.items():
        where = f"[design.{name}]"
        _with_place(origin, where, lambda p=part: refuse_unread_keys(p))
        if name not in design.of:
            remedy = "add it to of" if design.kind == "product" else 'only kind = "product" has sub-designs'
            raise InputError(f"{origin}: {where}: no design uses it: {remedy}, or leave it out")
        if part.constraints:
            raise InputError(f"{origin}: {where}: constraints belong to all points; move them to [design]")
    for name, table in file.factors.items():
        _with_place(origin, f"[factors.{name}]", lambda t=table: refuse_unread(t))
        if design.factors is not None and name not in design.factors and design.kind != "ablation":
            raise InputError(f"{origin}: [design]: factors leaves out {name}; add it, or leave out [factors.{name}]")


def _kept(simulator: Simulator, names: list[str]) -> tuple[str, ...]:
    if not simulator.outputs:
        return tuple(names)
    for name in names:
        if name not in simulator.outputs:
            raise InputError(f"outputs: unknown output {name!r}{near_match(name, simulator.outputs)}")
    usual = (name for name, output in simulator.outputs.items() if not output.on_request)
    return tuple(dict.fromkeys(names)) or tuple(usual)


def _check_run(origin: str, run: RunTable) -> None:
    labels = [outcome.label for outcome in Outcome]
    for label in run.expected_outcomes:
        if label not in labels:
            raise InputError(
                f"{origin}: [run]: expected_outcomes: {label!r} is not an outcome{near_match(label, labels)}"
            )
