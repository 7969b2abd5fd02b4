"""Speed and accuracy as sentences and tables: the cheapest method, ratios of prices, and failures."""

import math
import re

import numpy as np
import xarray as xr

from tripod_doe.analyses.speed_accuracy.speed_accuracy import Known
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import capital, level, number

_HOW = {
    Known.INTERPOLATED: "interpolated",
    Known.AT_MOST: "at its coarsest setting",
    Known.LIMITED: "at the coarsest setting that does not fail",
}

_TARGETS = (0.1, 0.01, 0.001)  # errors for which a sentence says what to use
_MISS = 0.05
"""Error above which a finished run is one that its checks missed."""


def find_in_speed_accuracy(data: xr.Dataset, name: str = "") -> list[str]:
    """State the price of each default relative to the best method, the error of its model, and failures."""
    advice = [_what_to_use(data, str(scene)) for scene in dict.fromkeys(data["scene"].values.tolist())]
    spread = _spread(data)
    repeated = f", median of the repetitions, which differ by at most a factor of {spread:.2f} in nine of ten runs"
    sentences = [
        f"Prices are CPU seconds per simulated second, all checks of a run included{repeated * math.isfinite(spread)}."
    ]
    for case in data["case"].values:
        row = data.sel(case=case)
        lead = _lead(row)
        if lead:
            sentences.append(_front_sentence(row.sel(quantity=lead), str(case)))
        mine = data.isel(
            run=np.flatnonzero((data["scene"] == row["case_scene"]) & (data["model"] == row["case_model"]))
        )
        if failed := _failures(mine):
            sentences.append(f"Failed in {_spoken(str(case))}: {failed}.")
        if lead and (missed := _missed(mine.sel(quantity=lead))):
            sentences.append(
                f"Finished in {_spoken(str(case))} with an undetected error above {level(100 * _MISS)} %: {missed}."
            )
    return [each for each in advice if each] + sentences + _model_sentences(data)


def _what_to_use(data: xr.Dataset, scene: str) -> str:
    """The cheapest run of any model within each of three errors of the first quantity; empty with one model."""
    of_scene = data.isel(run=np.flatnonzero(data["scene"].values == scene))
    referred = (data["case_scene"].values == scene) & (data["reference"].values != "")
    if not referred.any():
        return ""
    lead = "third_order" if "third_order" in data["quantity"].values else str(data["quantity"].values[0])
    runs = of_scene.sel(quantity=lead)
    finest = data.isel(case=int(np.flatnonzero(referred)[-1])).sel(quantity=lead)
    error, price = runs["total_error"].values, runs["cpu_per_second"].values
    if np.unique(runs["model"].values[np.isfinite(error)]).size < 2:
        return ""
    parts = []
    for target in _TARGETS:
        within = np.flatnonzero((error <= target) & np.isfinite(price))
        if within.size == 0:
            parts.append(f"{level(100 * target)} % is reached by none")
            continue
        best = runs.isel(run=int(within[np.argmin(price[within])]))
        setting = f"{best['setting_kind'].item()} = {level(float(best['setting']))}".replace("_", " ")
        default = "its default" if int(best["is_default"]) == 1 else setting
        run = ", ".join(filter(None, [best["run_method"].item(), default]))  # a balance has no method
        parts.append(
            f"{level(100 * target)} % {best['model'].item()} ({run}; "
            f"{number(float(best['cpu_per_second']))} s per simulated second)"
        )
    errors = f"numerical error plus the model's difference to {finest['case_model'].item()} there"
    what = f"the {runs['quantity_meaning'].item()}, by {errors}"
    return f"What to use in the {_spoken(scene)} for {what}: within {'; within '.join(parts)}."


def _spoken(case: str) -> str:
    return case.replace("_", " ")


def _spread(data: xr.Dataset) -> float:
    """Ratio of slowest to fastest repetition, not exceeded by nine of ten repeated runs."""
    repeated = data["repetitions"].values > 1
    ratios = (data["cpu_per_second_high"].values / data["cpu_per_second_low"].values)[repeated]
    ratios = ratios[np.isfinite(ratios)]
    return float(np.quantile(ratios, 0.9)) if ratios.size else math.nan


def _lead(row: xr.Dataset) -> str:
    """The quantity by which methods are compared in a case: the first with a reference."""
    known = np.isfinite(row["reference_error"].values)
    return str(row["quantity"].values[known][0]) if known.any() else ""


def _front_sentence(row: xr.Dataset, case: str) -> str:
    default, best = str(row["default_method"].item()), str(row["best_method"].item())
    what, target = str(row["quantity_meaning"].item()), 100 * float(row.attrs["target"])
    sharp = 100 * float(row["reference_error"])
    known_to = f"to {number(sharp, 2)} %" if sharp > 0 else "to rounding"
    start = f"{capital(_spoken(case))}, {what}, reference known {known_to}"
    if not best:
        return f"{start}: no method reaches {level(target)} %."
    over = float(row["default_over_best"])
    if not math.isfinite(over):
        known = (
            Known(int(row["price_known"].sel({"method": default}))).label
            if default in row["method"].values
            else "not run"
        )
        return f"{start}: at {level(target)} % error {best} is the cheapest; the default, {default}: {known}."
    of_default = "is the cheapest" if best == default else f"costs {number(over)} times the cheapest, {best}"
    own = Known(int(row["price_known"].sel({"method": default})))
    price, peers = number(float(row["price"].sel({"method": default}))), ", ".join(_peers(row, own))
    return (
        f"{start}: at {level(target)} % error the default, {default}, {of_default} ({default} {price} s per simulated "
        f"second, {_HOW[own]}).{f' Ratio to the default: {peers}.' if peers else ''}"
    )


def _peers(row: xr.Dataset, of_default: Known) -> list[str]:
    """Ratios of the cheapest explicit method, of linearly implicit Euler, and of the cheapest of SciPy's."""
    groups = {
        "explicit": [name for name, method in METHODS.items() if method.explicit and method.compiled],
        "": ["linearly-implicit-euler"],
        "SciPy": [name for name, method in METHODS.items() if not method.compiled],
    }
    text = []
    for group, members in groups.items():
        ratios = {name: float(row["price_ratio"].sel({"method": name})) for name in members if name in row["method"]}
        known = {name: Known(int(row["price_known"].sel({"method": name}))) for name in ratios}
        finite = [name for name, ratio in ratios.items() if math.isfinite(ratio)]
        sure = [name for name in finite if known[name] is not Known.PRICE_ONLY] or finite
        if sure:
            name = min(sure, key=lambda name: ratios[name])
            text.append(f"{group} {name} {number(ratios[name])}{_mark(known[name], of_default)}".strip())
    return text


def _mark(known: Known, of_default: Known) -> str:
    """Remark on a ratio unless both prices are known."""
    if known is Known.PRICE_ONLY:
        return " (extrapolated, error not known)"
    if known is of_default:
        return ""  # of two coarsest settings
    return " or less" if known is Known.AT_MOST else " or more" if of_default is Known.AT_MOST else ""


def _failures(runs: xr.Dataset) -> str:
    """Methods with the settings at which they failed, how, and the reason of the coarsest."""
    settings: dict[tuple[str, str], list[str]] = {}
    reasons: dict[tuple[str, str], str] = {}
    columns = (runs[name].values for name in ("run_method", "outcome", "setting", "outcome_detail"))
    for method, outcome, setting, detail in zip(*columns, strict=True):
        kind = Outcome(int(outcome))
        if kind not in (Outcome.FINISHED, Outcome.EVALUATION_LIMIT):
            key = str(method), kind.label.replace("_", " ")
            settings.setdefault(key, []).append(level(float(setting)))
            reasons.setdefault(key, re.split(r", most after t = | at t = | up to t = |;", str(detail))[0])
    return "; ".join(f"{key[0]} {', '.join(values)} ({key[1]}: {reasons[key]})" for key, values in settings.items())


def _missed(runs: xr.Dataset) -> str:
    """Finished runs whose numerical error their own checks should have detected."""
    wrong = np.flatnonzero(runs["numerical_error"].values > _MISS)
    return ", ".join(
        f"{runs['run_method'].values[at]} {level(float(runs['setting'].values[at]))} "
        f"({number(100 * float(runs['numerical_error'].values[at]), 2)} %)"
        for at in wrong
    )


def _model_sentences(data: xr.Dataset) -> list[str]:
    """State the difference of each model at its default to the finest model, and its price."""
    text = []
    at_default = np.flatnonzero((data["is_default"].values == 1) & np.isfinite(data["model_error"].values).any(axis=1))
    for at in at_default:
        run = data.isel(run=int(at))
        parts = [
            f"{number(100 * float(run['model_error'].sel(quantity=quantity)), 2)} % in the "
            f"{run['quantity_meaning'].sel(quantity=quantity).item()}"
            for quantity in run["quantity"].values
            if np.isfinite(run["model_error"].sel(quantity=quantity))
        ]
        price = number(float(run["cpu_per_second"]))
        text.append(
            f"{run['model'].item()} at its default differs from the finest model's reference by {', '.join(parts)}, "
            f"for {price} s per simulated second."
        )
    return [capital(sentence) for sentence in text]


def price_table(data: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Heads and one row per case and method: price at the target for the first quantity, and how it is known."""
    heads = ["Case", "Method", "Price at the target", "Over the default", "How known", "Finished", "Failed"]
    rows = []
    for case in data["case"].values:
        row = data.sel(case=case)
        mine = (data["scene"].values == row["case_scene"].item()) & (data["model"].values == row["case_model"].item())
        lead = _lead(row) or next(iter(data["quantity"].values.tolist()), "")
        for method in row["method"].values:
            own = mine & (data["run_method"].values == method)
            if own.any():
                done = int((data["outcome"].values[own] == Outcome.FINISHED).sum())
                cell = row.sel({"method": method} | ({"quantity": lead} if lead else {}))
                default = " (default)" if method == row["default_method"].item() else ""
                rows.append(
                    [
                        _spoken(str(case)),
                        f"{method}{default}",
                        _or_dash(float(cell["price"]) if lead else math.nan),
                        _or_dash(float(cell["price_ratio"]) if lead else math.nan),
                        Known(int(cell["price_known"])).label if _lead(row) else "no second method",
                        f"{done}",
                        f"{int(own.sum()) - done}",
                    ]
                )
    return heads, rows


def _or_dash(value: float) -> str:
    return number(value) if math.isfinite(value) else "–"
