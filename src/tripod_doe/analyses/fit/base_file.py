"""The fitted joint as TOML: values to paste into [base], and a study of tolerances with what is not known of them."""

import itertools
import json
import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from tripod_doe.analyses.fit.estimation.identifiability import FOUND
from tripod_doe.errors import printable
from tripod_doe.model_interface import Value
from tripod_doe.number_text import value_range
from tripod_doe.study.designs.correlation import rank_correlation

_DEVIATIONS = 1.96  # of half a 95 % interval of a normal distribution
_SAMPLES = 256
_DEFINITE = 1e-7  # smallest eigenvalue of correlations, above what rounding changes


def base_text(result: xr.Dataset, base: Mapping[str, Value]) -> str:
    """The table [base] with what was known and what was fitted, each fitted value with its interval as a comment."""
    lines = [f"# {_in_a_comment(result.attrs['title'])}: the joint as it was fitted, to paste into a study", "[base]"]
    lines += [f"{name} = {json.dumps(value)}" for name, value in _of_these_needles(result, base).items()]
    for name in result["unknown"].values.tolist():
        own = result.sel(unknown=name, unknown_2=name)
        if not math.isfinite(float(own["value"])):
            lines += _values_of_groups(own, "without one of these lines, it has its default")
            continue
        words = value_range(float(own["low"]), float(own["high"]))
        verdict = str(own["verdict"].item())
        lines.append(f"{name} = {_rounded(own)}  # 95 %: {words}; {verdict}")
    return "\n".join(lines) + "\n"


def _values_of_groups(own: xr.Dataset, here: str) -> list[str]:
    """Comments with the value of an unknown in each record or group, and which of them the file is of."""
    name, values = own["unknown"].item(), own["value_of_record"].values.tolist()
    groups = dict(zip(map(_in_a_comment, own["group_of_record"].values.tolist()), values, strict=True))
    return [
        f"# {name} differs between records; {here}:",
        *(f"# {name} = {value:.6g}  # {group}" for group, value in groups.items()),
    ]


def _of_these_needles(result: xr.Dataset, base: Mapping[str, Value]) -> Mapping[str, Value]:
    """What was known, with a model whose needles keep their skew if the fitted skews are of such."""
    return {**base, "model": "rollers"} if result.attrs.get("skews_stay") else base


def _in_a_comment(text: object) -> str:
    """A text that a file from a stranger gives, in one line: what stood behind a line end would be read as tables."""
    return printable(str(text)).replace("\n", "\\n")


def _rounded(own: xr.Dataset) -> str:
    """A value to two digits more than its interval leaves."""
    value, width = float(own["value"]), float(own["high"] - own["low"])
    if width <= 0:
        return f"{value:.6g}"
    digits = max(3 - math.floor(math.log10(width)), 0)
    return f"{round(value, min(digits, 12)):.{min(digits, 12)}f}".rstrip("0").rstrip(".") or "0"


def tolerance_text(result: xr.Dataset, base: Mapping[str, Value]) -> str:
    """A study of what is not known: the unknowns with their distributions and correlations, for the tolerance analysis.

    An unknown that the records determine is normal, cut off at its bounds. Of any other one only its interval is known.
    One that differs between records is as in the first of them.
    """
    operating = {
        name: values[values.size // 2]
        for name in result.coords
        if result[name].dims == ("record",) and name != "record" and (values := np.sort(result[name].values)).size
    }
    lines = [
        f"# {_in_a_comment(result.attrs['title'])}: parameters that the fit leaves uncertain, as distributions; run "
        f"it like any study",
        "[study]",
        f"name = {json.dumps(str(result.attrs['title']) + ': uncertain parameters')}",
        'question = "How much do the uncertain parameters of the joint scatter the orders of its thrust force?"',
        "",
        "[base]",
        *(f"{name} = {json.dumps(value)}" for name, value in _of_these_needles(result, base).items()),
        *(
            f"{name} = {json.dumps(value.item())}  # in the middle of the records"
            for name, value in operating.items()
            if name not in base
        ),
        "",
    ]
    for name in result["unknown"].values.tolist():
        own = result.sel(unknown=name)
        if not math.isfinite(float(own["value"])):
            first = own.isel(record=0)
            lines += _values_of_groups(
                own, f"its distribution here is of {_in_a_comment(first['group_of_record'].item())}"
            )
            own = first.assign({key: first[f"{key}_of_record"] for key in ("low", "high", "value", "verdict")})
        lines += [f"[factors.{name}]", *_distribution(own), ""]
    lines += ["[design]", 'kind = "sobol"', f"samples = {_SAMPLES}"]
    if pairs := _correlations(result):
        lines += ["correlation = [", *(f"    {json.dumps(pair)}," for pair in pairs), "]"]
    return "\n".join([*lines, "", "[keep]", 'outputs = ["thrust_amplitude"]', "", "[analysis.tolerance]", ""])


def _distribution(own: xr.Dataset) -> list[str]:
    """Keys of the distribution of one unknown."""
    low, high, value = (float(own[name]) for name in ("low", "high", "value"))
    if own["verdict"].item() != FOUND:
        return [f"low = {low:.6g}", f"high = {high:.6g}", f"# {own['verdict'].item()}: only its interval is known"]
    std = max((high - low) / (2 * _DEVIATIONS), 1e-9 * max(abs(value), 1e-9))
    return [
        'distribution = "truncated-normal"',
        f"mean = {value:.6g}",
        f"std = {std:.4g}",
        f"low = {float(own['bound_low']):.6g}",
        f"high = {float(own['bound_high']):.6g}",
    ]


def _correlations(result: xr.Dataset) -> list[list[str | float]]:
    """Rank correlations of pairs of unknowns, as a design takes them.

    They are those of the fit; where these are not definite, as of two unknowns of which only the sum is known, all are
    made smaller by the smallest common factor that is enough.
    """
    names, matrix = result["unknown"].values.tolist(), np.nan_to_num(result["correlation_in_first"].values)
    np.fill_diagonal(matrix, 1.0)
    least = float(np.linalg.eigvalsh(matrix).min(initial=1.0))
    ranks = rank_correlation(matrix * min((1 - _DEFINITE) / (1 - least), 1.0) if least < 1 else matrix)
    pairs = itertools.combinations(range(len(names)), 2)
    rows: list[list[str | float]] = [
        [names[at], names[other], round(float(ranks[at, other]), 9)] for at, other in pairs
    ]
    return [row for row in rows if row[2]]
