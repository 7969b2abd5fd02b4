"""Designs: from the factors of a study to its points. All are static and reproducible: same study, same points."""

from __future__ import annotations

import csv
import hashlib
import itertools
import math
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError, closest, near_match
from tripod_doe.simulator import Parameter, Value
from tripod_doe.study.definition import Factor, Study
from tripod_doe.study.distributions import is_unbounded, quantile
from tripod_doe.study.expressions import Expression
from tripod_doe.study.file import DesignTable
from tripod_doe.study.size import refuse_too_many_points

__all__ = ["Points", "axis_levels", "make_points", "point_keys", "salib_problem", "unit_sample"]

Column = NDArray[Any]

_CHUNK = 10_000  # points whose full parameter lists are held at once
_MOST_SWITCHES = 16  # of which all combinations can still be meant


@dataclass(frozen=True)
class Points:
    """All points of a study.

    Attributes
    ----------
    columns
        Values of the factors, each of shape (point,).
    shape
        Lengths of the cube's dimensions: one a factor for a grid, else the number of points.
    dims
        Names of these dimensions.
    allowed
        Whether a point meets the constraints, shape (point,); only a grid keeps cells that do not.
    labels
        Further coordinates along ``point``, for instance which row of a sub-design a point belongs to.
    chosen
        Values of parameters that a pilot chose, each of shape (point,): not factors, but what a point runs with.
    error_estimate, accuracy_met
        Estimated relative errors of such a choice by quantity, and whether they meet the accuracy that was asked for
        (1, 0, or -1 where nobody knows), each of shape (point,).
    """

    columns: dict[str, Column]
    shape: tuple[int, ...]
    dims: tuple[str, ...]
    allowed: NDArray[np.bool_]
    labels: dict[str, Column] = field(default_factory=dict)
    chosen: dict[str, Column] = field(default_factory=dict)
    error_estimate: dict[str, Column] = field(default_factory=dict)
    accuracy_met: Column | None = None

    @property
    def settings(self) -> dict[str, Column]:
        """Everything that differs between points: factors, and what was chosen."""
        return self.columns | self.chosen

    @property
    def count(self) -> int:
        """Number of points, excluded cells of a grid included."""
        return int(self.allowed.size)


def make_points(study: Study) -> Points:
    """All points of a study, in the order of its cube.

    Raises
    ------
    InputError
        If the design lacks what it needs, has more points than fit into memory, excludes every point, or gives points
        outputs of different lengths.
    """
    design = study.file.design
    try:
        refuse_too_many_points(study)
        columns, labels = _columns(study, design, dict(study.factors))
        names = list(columns)
        count = len(columns[names[0]]) if names else 1
        allowed = np.ones(count, bool)
        for text in design.constraints:
            allowed &= Expression(text, names)(columns)
        study.simulator.check_lengths(columns, study.keep)
    except InputError as error:
        raise study.fail("[design]", error) from error
    if not allowed.any():
        raise study.fail("[design]", "constraints exclude every point; relax them")
    if design.kind == "grid":
        levels = tuple(len(factor.values or ()) for factor in study.factors.values())
        return Points(columns, levels, tuple(names), allowed)
    if not allowed.all():
        if design.kind in ("saltelli", "morris"):
            raise study.fail("[design]", f"a {design.kind} design cannot leave points out; choose ranges instead")
        columns = {name: column[allowed] for name, column in columns.items()}
        labels = {name: column[allowed] for name, column in labels.items()}
        allowed = allowed[allowed]
    return Points(columns, (allowed.size,), ("point",), allowed, labels)


def _columns(
    study: Study, design: DesignTable, factors: Mapping[str, Factor]
) -> tuple[dict[str, Column], dict[str, Column]]:
    """Columns of one design and labels of its points; a product asks again for its sub-designs."""
    if design.factors is not None and design.kind != "product":
        unknown = [name for name in design.factors if name not in factors]
        if unknown:
            raise InputError(f"factors: {unknown[0]!r} is not among [factors]{near_match(unknown[0], factors)}")
        factors = {name: factors[name] for name in design.factors}
    elif design.kind == "ablation":
        factors = {name: factors[name] for name in study.switches}
    if not factors and design.kind != "table":
        raise InputError("the study has no factors; add [factors.PARAMETER] with values")
    match design.kind:
        case "grid":
            return _grid(factors), {}
        case "zip":
            return _zip(factors), {}
        case "one-at-a-time":
            return _one_at_a_time(study, factors)
        case "table":
            return _table(study, design, factors), {}
        case "ablation":
            return _ablation(design, factors), {}
        case "product":
            return _product(study, factors)
        case _:
            unbounded = [name for name, factor in factors.items() if is_unbounded(factor)]
            if design.kind == "morris" and unbounded:
                raise InputError(
                    f"[factors.{unbounded[0]}]: morris needs bounded factors; use a truncated-normal distribution"
                )
            unit = unit_sample(design, factors)
            return {name: quantile(factor, unit[:, i]) for i, (name, factor) in enumerate(factors.items())}, {}


def _levels(factor: Factor) -> Column:
    if factor.values is None:
        raise InputError(
            f"[factors.{factor.parameter.name}]: this design needs levels; give values, or low, high and count"
        )
    return _column(factor, factor.values)


def _column(factor: Factor, values: Iterable[Any]) -> Column:
    return factor.parameter.column(list(values))


def axis_levels(factor: Factor) -> Column:
    """Levels of a factor along an axis of a grid: numbers ascend, or descend where the study lists them so.

    An axis in the order in which levels were added could not be asked for a range.
    """
    levels = _levels(factor)
    if levels.dtype.kind not in "iuf" or (np.diff(levels) < 0).all():
        return levels
    return np.sort(levels)


def _grid(factors: Mapping[str, Factor]) -> dict[str, Column]:
    levels = [axis_levels(factor) for factor in factors.values()]
    for name, values in zip(factors, levels, strict=True):
        if len(set(values.tolist())) < len(values):
            raise InputError(f"[factors.{name}]: the same value occurs twice; a grid needs different values")
    meshes = np.meshgrid(*levels, indexing="ij")
    return {name: mesh.ravel() for name, mesh in zip(factors, meshes, strict=True)}


def _zip(factors: Mapping[str, Factor]) -> dict[str, Column]:
    columns = {name: _levels(factor) for name, factor in factors.items()}
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} has {length}" for name, length in lengths.items())
        raise InputError(f"zip needs as many values for every factor, but {told}")
    return columns


def _one_at_a_time(study: Study, factors: Mapping[str, Factor]) -> tuple[dict[str, Column], dict[str, Column]]:
    """The base point, then each factor through its values with all others at their defaults."""
    home = {name: study.simulator.effective(study.base)[name] for name in factors}
    rows, varied = [home], ["base"]
    for name, factor in factors.items():
        if home[name] is None:
            raise InputError(f"[factors.{name}]: it has no default value; one-at-a-time cannot vary it")
        for value in _levels(factor):
            rows.append({**home, name: value})
            varied.append(name)
    columns = {name: _column(factor, (row[name] for row in rows)) for name, factor in factors.items()}
    return columns, {"varied": np.array(varied, dtype=object)}


def _table(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> dict[str, Column]:
    """A CSV file with a header: one column a factor; fields of a parameter without default may be empty."""
    if design.table is None:
        raise InputError("a table design needs table = a CSV file")
    path = study.folder / design.table
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            header, *rows = [row for row in csv.reader(stream) if row] or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"table = {design.table!r}: cannot read {path}: {reason}") from error
    header = [name.strip() for name in header]
    for name in factors:
        if name not in header:
            raise InputError(f"table = {design.table!r}: no column {name!r}{closest(name, header)}")
    if not rows:
        raise InputError(f"table = {design.table!r}: it has no rows")
    columns = {}
    for index, name in enumerate(header):
        if name not in study.simulator.parameters:
            raise InputError(
                f"table = {design.table!r}: column {name!r} is not a parameter"
                f"{near_match(name, study.simulator.parameters)}"
            )
        if name in study.base:
            raise InputError(f"table = {design.table!r}: {name} is also a base value; remove it from [base]")
        parameter = study.simulator.parameters[name]
        values = []
        for line, row in enumerate(rows, start=2):
            if len(row) != len(header):
                raise InputError(
                    f"table = {design.table!r}: line {line} has {len(row)} fields, the header {len(header)}"
                )
            try:
                values.append(_cell(parameter, row[index].strip()))
            except (InputError, ValueError) as error:
                raise InputError(f"table = {design.table!r}: line {line}: {name}: {error}") from error
        columns[name] = parameter.column(values)
    return columns


def _cell(parameter: Parameter, text: str) -> Value:
    """One field of a CSV file as its parameter takes it; an empty one leaves open what follows from others."""
    if not text and parameter.default is None and parameter.kind != "argument":
        return None if parameter.kind == "choice" else math.nan
    if parameter.kind == "choice":
        return parameter.check(text)
    try:
        number = float(text)
    except ValueError:
        if parameter.kind == "argument":
            return parameter.check(text)
        raise
    return parameter.check(number)


def _ablation(design: DesignTable, switches: Mapping[str, Factor]) -> dict[str, Column]:
    """All on first; then every combination, or with none on, with each off alone and with each on alone."""
    for name, factor in switches.items():
        if factor.table.model_fields_set and set(factor.values or ()) != {0, 1}:
            raise InputError(f"[factors.{name}]: an ablation switches between 0 and 1; give values = [0, 1]")
    count = len(switches)
    if design.combinations == "all":
        if count > _MOST_SWITCHES:
            raise InputError(
                f"all combinations of {count} switches are {2**count:,} points, more than {_MOST_SWITCHES} make; "
                'set combinations = "single" or name fewer factors'
            )
        rows = list(itertools.product((1, 0), repeat=count))
    else:
        alone = [tuple(int(each == on) for each in range(count)) for on in range(count)]
        without = [tuple(1 - state for state in row) for row in alone]
        rows = list(dict.fromkeys([(1,) * count, (0,) * count, *without, *alone]))  # two switches: some are the same
    return {name: _column(factor, (row[at] for row in rows)) for at, (name, factor) in enumerate(switches.items())}


def _product(study: Study, factors: Mapping[str, Factor]) -> tuple[dict[str, Column], dict[str, Column]]:
    """Every point of the first sub-design with every point of the next."""
    names, tables = study.file.design.of, study.file.designs
    if len(names) < 2:
        raise InputError("a product needs of = at least two sub-designs")
    parts: list[dict[str, Column]] = []
    taken: dict[str, str] = {}
    for name in names:
        if name not in tables:
            raise InputError(f"of: no sub-design [design.{name}]{near_match(name, tables)}")
        if tables[name].factors is None and tables[name].kind != "ablation":
            raise InputError(f"[design.{name}]: give the factors that it varies")
        if tables[name].kind == "product":
            raise InputError(f"[design.{name}]: a product of products is not supported; list all parts in of")
        part = _columns(study, tables[name], factors)[0]
        for factor in part:
            if factor in taken:
                raise InputError(f"{factor} is varied by [design.{taken[factor]}] and by [design.{name}]")
            taken[factor] = name
        parts.append(part)
    left = [name for name in factors if name not in taken]
    if left:
        raise InputError(f"{', '.join(left)} belongs to no sub-design; add it to the factors of one")
    counts = [len(next(iter(part.values()))) for part in parts]
    index = np.meshgrid(*(np.arange(count) for count in counts), indexing="ij")
    columns = {
        key: column[rows.ravel()] for part, rows in zip(parts, index, strict=True) for key, column in part.items()
    }
    labels = {f"{name}_row": rows.ravel() for name, rows in zip(names, index, strict=True)}
    return {name: columns[name] for name in factors}, labels


def salib_problem(names: Iterable[str]) -> dict[str, Any]:
    """SALib's description of factors on the unit cube; distributions are applied by `quantile`."""
    names = list(names)
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}


def unit_sample(design: DesignTable, names: Collection[str]) -> NDArray[np.float64]:
    """The sampled designs on the unit cube, shape (point, factor).

    latin-hypercube and sobol by scipy.stats.qmc, saltelli and morris by SALib. The Sobol' sequences are prefix-stable:
    more samples keep the points that were there.
    """
    if design.samples is None:
        raise InputError(f"a {design.kind} design needs samples")
    # slow to import, and most studies sample nothing
    from SALib.sample import morris as salib_morris
    from SALib.sample import sobol as salib_sobol
    from scipy.stats import qmc

    width, count = len(names), design.samples
    makers: dict[str, Callable[[], NDArray[np.float64]]] = {
        "latin-hypercube": lambda: qmc.LatinHypercube(width, rng=design.seed).random(count),
        "sobol": lambda: qmc.Sobol(width, rng=design.seed).random(count),
        "saltelli": lambda: salib_sobol.sample(
            salib_problem(names), count, calc_second_order=design.second_order, seed=design.seed
        ),
        "morris": lambda: salib_morris.sample(
            salib_problem(names), count, num_levels=design.levels or 4, seed=design.seed
        ),
    }
    if design.kind == "saltelli" and count & (count - 1):
        raise InputError(
            f"samples = {count}: a saltelli design needs a power of 2, for instance {1 << count.bit_length()}"
        )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*power of 2.*")  # of qmc.Sobol: any count is allowed there
        return makers[design.kind]()


def point_keys(study: Study, points: Points) -> NDArray[np.void]:
    """A fingerprint of each point from the values of all its parameters, shape (point,), 16 bytes each.

    It does not depend on which parameters are factors, so that a study that grew finds its old points again.
    """
    chunks = [
        _fingerprints(study, {name: column[start : start + _CHUNK] for name, column in points.settings.items()}, count)
        for start in range(0, points.count, _CHUNK)
        for count in [min(_CHUNK, points.count - start)]
    ]
    return np.frombuffer(b"".join(chunks), dtype="V16")


def _fingerprints(study: Study, columns: Mapping[str, Column], count: int) -> bytes:
    """Fingerprints of some points, one after the other."""
    full = study.simulator.columns(study.base, columns, count)
    matrix = np.empty((count, len(full)))
    for position, name in enumerate(sorted(full)):
        column = full[name]
        if column.dtype == object:
            words, inverse = np.unique(column.astype(str), return_inverse=True)
            codes = [hashlib.blake2b(word.encode(), digest_size=8).digest() for word in words]
            matrix[:, position] = np.frombuffer(b"".join(codes))[inverse]
        else:
            matrix[:, position] = np.where(column == 0, 0.0, column)  # -0.0 is the same point as 0.0
    start = hashlib.blake2b("\n".join([study.simulator.name, *sorted(full)]).encode(), digest_size=16)

    def fingerprint(row: NDArray[np.float64]) -> bytes:
        digest = start.copy()
        digest.update(row.tobytes())
        return digest.digest()

    return b"".join(fingerprint(row) for row in matrix)
