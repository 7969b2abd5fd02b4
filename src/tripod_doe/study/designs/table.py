"""Tables: a CSV file with a header gives the points, one column for each factor."""

import math

from tripod_doe.errors import InputError, closest, near_match
from tripod_doe.files.csv_table import read_csv_table
from tripod_doe.model_interface import Parameter, Value, is_set
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.designs.design_interface import Family, Made, Request
from tripod_doe.typed_numbers import typed_number


def _table(request: Request) -> Made:
    """A CSV file with a header: one column a factor; fields of a parameter without default may be empty."""
    study, design = request.study, request.table
    if design.table is None:
        raise InputError("a table design needs table = a CSV file")
    path, where = study.folder.file(design.table, "table"), f"table = {design.table!r}"
    header, rows = read_csv_table(path, where, study.folder.most_points)
    for name in request.factors:
        if name not in header:
            raise InputError(f"table = {design.table!r}: no column {name!r}{closest(name, header)}")
    for name in header:
        if name not in study.simulator.parameters:
            raise InputError(
                f"table = {design.table!r}: column {name!r} is not a parameter"
                f"{near_match(name, study.simulator.parameters)}"
            )
        if name in study.base:
            raise InputError(f"table = {design.table!r}: {name} is also a base value; remove it from [base]")
    chosen = study.auto_model.parameters if study.auto_model and not study.folder.has_results else ()
    if replaced := [name for name in header if name in chosen]:
        raise InputError(
            f"table = {design.table!r}: the choice of the model would replace {', '.join(replaced)}; to keep the "
            f"values of the table, add {', '.join(f'[factors.{name}]' for name in replaced)} without keys"
        )
    columns = {}
    for index, name in enumerate(header):
        parameter = study.simulator.parameters[name]
        values = []
        for line, row in rows.items():
            try:
                values.append(_cell(parameter, row[index]))
            except (InputError, ValueError) as error:
                raise InputError(f"table = {design.table!r}: line {line}: {name}: {error}") from error
        if parameter.kind == "argument" and any(isinstance(value, str) for value in values):
            values = [row[index] for row in rows.values()]  # words, of which some look like numbers
        if name in study.factors and not study.folder.has_results:
            _refuse_other_levels(study.factors[name], values)
        columns[name] = parameter.column(values)
    return Made(columns)


def _refuse_other_levels(factor: Factor, column: list[Value]) -> None:
    """Refuse [factors.PARAMETER] where it says otherwise than the table, which gives the values."""
    known, name = set(factor.values or ()), factor.parameter.name
    other = [value for value in column if is_set(value) and value not in known]
    if factor.table.model_fields_set and other:
        raise InputError(f"[factors.{name}]: the table has {name} = {other[0]}; leave the keys of [factors.{name}] out")


def _cell(parameter: Parameter, text: str) -> Value:
    """One field of a CSV file as its parameter takes it; an empty one leaves open what follows from others."""
    if not text and parameter.kind == "argument":
        raise InputError("this field is empty; a function needs a value for each argument")
    if not text and parameter.default is None:
        return None if parameter.kind == "choice" else math.nan
    if not text:
        raise InputError(f"this field is empty; its default would be {parameter.default}")
    if parameter.kind == "choice":
        return parameter.check(text)
    try:
        number = typed_number(text)
    except ValueError:
        if parameter.kind == "argument":
            return parameter.check(text)
        raise InputError(f"{text!r} is no number; below the header each line is a point") from None
    return parameter.check(number)


TABLE = {"table": Family(_table, lambda request: 0)}
"""The table by its kind."""
