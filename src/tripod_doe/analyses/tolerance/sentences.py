"""Findings and table of a tolerance analysis: quantiles, probabilities to exceed limits, what to tighten first."""

import json
import math
from collections.abc import Mapping
from statistics import NormalDist

import numpy as np
import xarray as xr

from tripod_doe.analyses.tolerance.chances import points_to_decide
from tripod_doe.analyses.tolerance.confirmation import CONFIRMED, RUNS, factor_tables, limit_key
from tripod_doe.analyses.tolerance.narrower_scatter import SCALES, together
from tripod_doe.number_text import chance_in_percent, count_of, duration, interval, number, text_range, with_unit
from tripod_doe.page_parts.main_outputs import (
    OutputPart,
    differ,
    in_table,
    left_points,
    main_outputs,
    output_part,
    quantile_text,
)
from tripod_doe.page_parts.words import listed, place_text, spoken, unit_text
from tripod_doe.study.definition.distributions import scaled_table, scatter_density, shifted_table
from tripod_doe.study.definition.study_file_schema import FactorTable

_MOST_NAMED = 3
_MOST_EXCEED = 0.5  # part of the points beyond a limit, from which on its nominal value is what is wrong
_AMPLITUDE = "thrust_amplitude"
_NOTABLE = 0.1  # of the largest order, from which on another one is stated
_MOST_ORDERS = 6
_NARROWEST = f"{100 * min(SCALES):g} %"  # scale that is tried
_WIDER = 1.2  # times an interval, from which on the error of the model is worth a sentence


def tolerance_parts(result: xr.Dataset) -> list[OutputPart]:
    """Main outputs with their quantiles and gains; also orders of the thrust that are large, and what has a limit."""
    parts = main_outputs(result, "mean", orders=_orders(result))
    outputs = result["output"].values.tolist() if "output" in result.dims else []
    return parts + [
        _most_exceeding(result, output)
        for output in outputs
        if output not in {part.output for part in parts}
        and bool(result["exceedance"].sel(output=output).notnull().any())
    ]


def _most_exceeding(result: xr.Dataset, output: str) -> OutputPart:
    """An output with limits at the labels where it exceeds its limit most often."""
    answers = result.sel(output=output)
    chance = answers["exceedance"]
    place = {dim: int(at) for dim, at in chance.argmax(...).items()}
    named = {dim: at for dim, at in place.items() if differ(answers[in_table(result)], dim)}
    return output_part(output, output + place_text(answers, named), answers.isel(place))


def _orders(result: xr.Dataset) -> tuple[int, ...]:
    """The third and second order, those with a limit, and those of at least a tenth of the largest one."""
    usual = (3, 2)
    if "order" not in result.dims:
        return usual
    several = "output" in result.dims
    outputs = result["output"].values.tolist() if several else [str(result.attrs["outputs"])]
    own = result.sel(output=_AMPLITUDE) if several and _AMPLITUDE in outputs else result
    limits = own["limit"].notnull().any([dim for dim in own["limit"].dims if dim != "order"])
    limited = own["order"].values[limits.values].tolist()
    if _AMPLITUDE not in outputs:
        return tuple(dict.fromkeys([*usual, *limited]))[:_MOST_ORDERS]
    means = own["mean"].sel(order=own["order"] > 0)
    means = means.isel(dict.fromkeys((dim for dim in means.dims if dim != "order"), 0)).fillna(0.0)
    large = means.sel(order=means >= _NOTABLE * means.max()).sortby(-means)["order"].values.tolist()
    return tuple(dict.fromkeys([*usual, *limited, *large]))[:_MOST_ORDERS]


def find_in_tolerance(result: xr.Dataset, name: str) -> list[str]:
    """Sentences on quantiles, limits and gains of each main output."""
    sentences = []
    for each in tolerance_parts(result):
        what, unit, part = each.what, each.unit, each.answers
        sentences += [_quantiles(each, name), *_exceedance(what, part, unit), *_gains(what, part, unit)]
        sentences += _keeping(what, part, unit)
    return sentences + _not_judged(result) + left_points(result)


def _not_judged(result: xr.Dataset) -> list[str]:
    """The factors for which neither another scatter nor another nominal value is judged."""
    related, in_lists = ([spoken(name) for name in names] for names in _unweighted(result))
    sentences = []
    if related:
        sentences.append(
            f"Some factors are correlated ({listed(related)}): these points do not show a change of the scatter or of "
            "the nominal value of one of them alone; a run of the changed study does."
        )
    if in_lists:
        sentences.append(
            f"The scatter of factors with listed values ({listed(in_lists)}) is not judged, however large their effect."
        )
    return sentences


def _unweighted(result: xr.Dataset) -> tuple[list[str], list[str]]:
    """Factors whose points cannot be weighted for another scatter: correlated ones, and others with listed values."""
    related, tables = str(result.attrs.get("correlated", "")).split(", "), factor_tables(result)
    levels = str(result.attrs.get("levels", "")).split(", ")  # whole numbers are not in the tables
    in_lists = [
        name for name in tables if name not in related and (name in levels or scatter_density(tables[name]) is None)
    ]
    return [name for name in tables if name in related], in_lists


def _quantiles(part: OutputPart, name: str) -> str:
    if float(part.answers["std"]) == 0:
        return f"Scatter of {part.what}: none beyond rounding (analysis {name})."
    mean, deviation = (with_unit(number(float(part.answers[key])), part.unit) for key in ("mean", "std"))
    centre = f"mean {mean}, standard deviation {deviation}"
    return f"Scatter of {part.what}: {centre}; {quantile_text(part)} (analysis {name})."


def _exceedance(what: str, part: xr.Dataset, unit: str) -> list[str]:
    if not np.isfinite(part["exceedance"]):
        return []
    limit = with_unit(number(float(part["limit"])), unit)
    return [f"The probability that {what} exceeds {limit} is {_chance(part, 'exceedance')}{_of_model(part)}."]


def _of_model(part: xr.Dataset) -> str:
    """What the error of the model makes of a chance, where it widens the interval notably."""
    ends = [(float(part[f"exceedance_{end}"]), float(part[f"exceedance_model_{end}"])) for end in ("low", "high")]
    own, wide = (abs(ends[1][at] - ends[0][at]) for at in (0, 1))
    if not wide > _WIDER * own:
        return ""
    low, high = (chance_in_percent(end[1]) for end in ends)
    usual = number(100 * float(part.attrs["model_error_usual"]), 2)
    return (
        f" by this model, and between {low} and {high} % if the model is off at each point by its 90th percentile "
        f"error (for half of the points at most {usual} %)"
    )


def _chance(part: xr.Dataset, key: str) -> str:
    """A chance in per cent with its interval: ``0.4 % (0.2 to 0.8 %)``."""
    low, value, high = (chance_in_percent(float(part[name])) for name in (f"{key}_low", key, f"{key}_high"))
    return f"{value} % ({text_range(low, high)} %)"


def _gains(what: str, part: xr.Dataset, unit: str) -> list[str]:
    """Which scatter to halve first: gains beyond what noise gives to the largest of all factors."""
    if float(part["std"]) == 0:
        return []
    names, confidence = [str(name) for name in part["factor"].values], float(part.attrs.get("confidence_level", 0.95))
    gain, half = part["gain_of_halving"].values, part["gain_of_halving_conf"].values
    beyond = half * _wider(confidence, int(np.isfinite(gain).sum()))
    resolved = [at for at in np.argsort(-np.nan_to_num(gain)) if gain[at] - beyond[at] > 0]
    if not resolved:
        return [f"These points resolve no effect on the scatter of {what} from halving the scatter of a single factor."]
    best = resolved[0]
    level = [at for at in resolved if gain[at] + beyond[at] >= gain[best] - beyond[best]]
    rest = [at for at in resolved if at not in level]
    parts = [f"{_percent(gain[at], half[at])} ({spoken(names[at])})" for at in range(len(names))]
    reduces = "reduces the standard deviation by"
    if len(level) == 1:
        reduced = _percent(gain[best], half[best])
        head = f"For {what}, tighten {spoken(names[best])} first: halving its scatter {reduces} {reduced}"
    else:
        stated = listed([parts[at] for at in level[:_MOST_NAMED]])
        head = f"For {what}, these points do not show which scatter to tighten first: halving one {reduces} {stated}"
    after = _exceedance_if_halved(part.isel(factor=int(best)), unit) if len(level) == 1 else ""
    others = listed([parts[at] for at in rest[: _MOST_NAMED - 1]])
    return [f"{head}{after}{f'; halving another one, by {others}' if others else ''}."]


def _wider(confidence: float, ways: int) -> float:
    """By how much an interval grows that holds for several things together."""
    normal = NormalDist()
    return normal.inv_cdf(0.5 + together(confidence, ways) / 2) / normal.inv_cdf(0.5 + confidence / 2)


def _exceedance_if_halved(one: xr.Dataset, unit: str) -> str:
    """The chance to exceed the limit with half the scatter, where its interval lies below the present one."""
    if not float(one["exceedance_if_halved_high"]) < float(one["exceedance_low"]):
        return ""
    limit = with_unit(number(float(one["limit"])), unit)
    now = chance_in_percent(float(one["exceedance"]))
    return f", and the probability to exceed {limit} falls from {now} % to {_chance(one, 'exceedance_if_halved')}"


def _keeping(what: str, part: xr.Dataset, unit: str) -> list[str]:
    """Ways to keep the limit that are resolved, and the run that confirms them; nothing where it is kept."""
    keep = float(part.attrs.get("keep", np.nan))
    if not np.isfinite(part["exceedance"]) or "scale_to_keep" not in part:
        return []
    value = float(part["exceedance"])
    within = f"within {with_unit(number(float(part['limit'])), unit)}"
    said = []
    resolved = float(part["exceedance_low"]) > 1 - keep or float(part["exceedance_high"]) <= 1 - keep
    if not resolved:
        said = [
            f"Whether {what} stays {within} with a probability of {100 * keep:g} % is not resolved by these points."
        ]
    if not value > 1 - keep:
        kept = (
            f"{what} keeps its limit" if resolved else "none is proposed before it is known whether the limit is kept"
        )
        return said + _run_more(part, keep, resolved) + _nothing_to_confirm(part, kept)
    names = [str(name) for name in part["factor"].values]
    tables = factor_tables(part)
    aim = f"To keep {what} {within} with a probability of {100 * keep:g} %"
    ways = [_smaller_scatter(part, names, tables), _cheapest(part, names, tables), _shifts(part, names, tables)]
    chances = [chance for _, each in ways for chance in each]
    return [
        *said,
        *([f"{aim}, {ways[0][0]}"] if ways[0][1] else [_unresolved(aim, part)]),
        *(sentence for sentence, _ in ways[1:] if sentence),
        *_run_more(part, keep, resolved, bool(chances)),
        *(_confirmed(what, part, tables, keep) or (_confirmation(part, max(chances), 1 - keep) if chances else [])),
        *([] if chances else _nothing_to_confirm(part, "these points resolve no change that keeps the limit")),
    ]


def _run_more(part: xr.Dataset, keep: float, resolved: bool, proposed: bool = False) -> list[str]:
    """How many points resolve what these leave open: whether the limit is kept, and by which smaller scatter."""
    used = int(part.attrs["samples_of_points"])
    needed = [float(part["samples_to_resolve"])]
    if not (resolved or proposed) and (points := points_to_decide(float(part["exceedance"]), 1 - keep, used)):
        needed.append(float(points))
    known = [points for points in needed if np.isfinite(points)]
    if not known:
        return []
    smaller = "by which smaller scatter it is kept"
    what = smaller if resolved else "whether the limit is kept, and by which smaller scatter"
    grows = part.attrs.get("kind_of_points") not in ("latin-hypercube", "rbd-fast")  # whose points all change
    return [
        f"To resolve {what}, set samples = {int(max(known))} in [design] and run the study again"
        f"{'' if grows else ', into another directory'}; that many are enough if the chances are about what these "
        "points estimate."
    ]


def _nothing_to_confirm(part: xr.Dataset, reason: str) -> list[str]:
    """Why a confirmation that was asked for ran no points."""
    return [f"No other points were run to confirm a change: {reason}."] if part.attrs.get("confirm") else []


def _changed(name: str, table: FactorTable, now: FactorTable) -> str:
    """What the table of a factor becomes: ``[factors.torque_n_m] std = 0.2``."""
    keys = [key for key in ("mean", "mode", "std", "low", "high") if getattr(table, key) is not None]
    changed = [key for key in keys if not math.isclose(getattr(table, key), getattr(now, key), rel_tol=1e-12)]
    return f"[factors.{name}] " + ", ".join(f"{key} = {getattr(table, key):.6g}" for key in changed)


def _smaller(name: str, scale: float, tables: Mapping[str, FactorTable]) -> str:
    """The demand on one scatter: ``halve the scatter of torque ([factors.torque_n_m] std = 0.2)``."""
    keys = _changed(name, scaled_table(tables[name], scale), tables[name])
    if math.isclose(scale, 0.5):
        return f"halve the scatter of {spoken(name)} ({keys})"
    return f"reduce the scatter of {spoken(name)} to {100 * scale:.3g} % ({keys})"


def _remaining_chance(part: xr.Dataset, way: str) -> str:
    return f"then {_chance(part, f'exceedance_at_{way}')} exceed the limit"


_Way = tuple[str, list[float]]  # a sentence, and the chances to exceed the limit that it states


def _smaller_scatter(part: xr.Dataset, names: list[str], tables: Mapping[str, FactorTable]) -> _Way:
    """The single scatters that are enough, else two."""
    scale, excluded = part["scale_to_keep"].values, part["scale_excluded"].values
    every = range(len(names))
    alone = sorted((k for k in every if np.isfinite(scale[k, k])), key=lambda k: -scale[k, k])[:_MOST_NAMED]
    if alone:
        own = [part.isel(factor=k, factor_2=k) for k in alone]
        ways = [
            f"{_smaller(names[k], float(scale[k, k]), tables)}: {_remaining_chance(one, 'scale')}"
            for k, one in zip(alone, own, strict=True)
        ]
        return f"{'; or '.join(ways)}. {_widest(part)}", [float(one["exceedance_at_scale"]) for one in own]
    pairs = sorted(((m, k) for k in every for m in range(k) if np.isfinite(scale[k, m])), key=lambda p: -scale[p])
    if not pairs:
        return "", []
    first, second = pairs[0]
    size, one = float(scale[first, second]), part.isel(factor=first, factor_2=second)
    start = f"no single scatter suffices, even at {_NARROWEST}: " if all(excluded[k, k] for k in every) else ""
    both = f"{_smaller(names[first], size, tables)} and {_smaller(names[second], size, tables)}"
    return f"{start}{both}: {_remaining_chance(one, 'scale')}. {_widest(part)}", [float(one["exceedance_at_scale"])]


def _widest(part: xr.Dataset) -> str:
    """Why a wider scatter may do as well."""
    points = f"{int(part.attrs['points_used']):,} points"
    return f"In steps of 5 %, these {points} prove no wider scatter sufficient; more points may."


def _unresolved(aim: str, part: xr.Dataset) -> str:
    """Why no smaller scatter is proposed."""
    if bool(part["scale_excluded"].values.astype(bool).all()):
        most = float(part["exceedance_low"]) > _MOST_EXCEED
        move = f"shift a nominal value: {_chance(part, 'exceedance')} exceed the limit now, and " if most else ""
        return f"{aim}, {move}reducing the scatter of one or two factors to {_NARROWEST} is not enough."
    points = f"{int(part.attrs['points_used']):,} points"
    return f"{aim}, these {points} prove no reduced scatter of one or two factors sufficient."


def _cheapest(part: xr.Dataset, names: list[str], tables: Mapping[str, FactorTable]) -> _Way:
    """The cheapest set of smaller scatters, where costs are given."""
    if "cheapest_scale" not in part or not np.isfinite(part["cheapest_cost"]):
        return "", []
    sizes = part["cheapest_scale"].values
    changed = [_smaller(name, float(size), tables) for name, size in zip(names, sizes, strict=True) if size < 1]
    return (
        f"At the costs given, the cheapest way that these points resolve is: {listed(changed)}, for "
        f"{number(float(part['cheapest_cost']), 3)} (a scale s costs 1 / s - 1 times what it costs to halve that "
        f"scatter); {_remaining_chance(part, 'cheapest')}.",
        [float(part["exceedance_at_cheapest"])],
    )


def _shifts(part: xr.Dataset, names: list[str], tables: Mapping[str, FactorTable]) -> _Way:
    """Which nominal value to move, with the scatter as it is."""
    units = json.loads(str(part.attrs.get("factor_units", "{}")))
    shifts = part["shift_to_keep"].values
    moved = [at for at in range(len(names)) if np.isfinite(shifts[at])][:_MOST_NAMED]
    if not moved:
        return _no_shift(part, names, tables), []
    ways = []
    for at in moved:
        name, shift = names[at], float(shifts[at])
        keys = _changed(name, shifted_table(tables[name], shift), tables[name])
        by = with_unit(f"{shift:+.3g}", unit_text(units.get(name, "1")))
        ways.append(f"{spoken(name)} by {by} ({keys}): {_remaining_chance(part.isel(factor=at), 'shift')}")
    chances = part["exceedance_at_shift"].values[moved].tolist()
    return f"With unchanged scatter, shift the nominal value of {'; or of '.join(ways)}.", chances


def _no_shift(part: xr.Dataset, names: list[str], tables: Mapping[str, FactorTable]) -> str:
    """Why no nominal value is proposed to be moved."""
    related, listed_values = _unweighted(part)
    bounded = [name for name in names if name not in [*related, *listed_values] and tables[name].high is not None]
    reasons = []
    if bounded:
        reasons.append(
            f"the points lie within the bounds of {listed(list(map(spoken, bounded)))}, and the bounds would shift, too"
        )
    if listed_values:
        has = "has" if len(listed_values) == 1 else "have"
        reasons.append(f"{listed(list(map(spoken, listed_values)))} {has} listed values")
    if related:
        reasons.append(f"{listed(list(map(spoken, related)))} are correlated")
    if len(bounded) + len(listed_values) + len(related) < len(names):
        reasons.append("too few points lie in the range of a shifted distribution")
    return (
        f"Whether shifting one nominal value keeps the limit is not resolved: {', and '.join(reasons)}. Run "
        "the study with a shifted value to find out."
    )


def _confirmed(what: str, part: xr.Dataset, tables: Mapping[str, FactorTable], keep: float) -> list[str]:
    """What the points of another run say of the first change; nothing where there was none."""
    if CONFIRMED not in part or not np.isfinite(part[CONFIRMED]):
        return []
    runs = json.loads(str(part.attrs[RUNS]))
    run = runs.get(limit_key(part, False)) or runs[limit_key(part, True)]
    keys = listed([_changed(name, FactorTable(**table), tables[name]) for name, table in run["factors"].items()])
    low, high = (float(part[f"{CONFIRMED}_{end}"]) for end in ("low", "high"))
    verdict = "confirmed" if high <= 1 - keep else "refuted" if low > 1 - keep else "neither confirmed nor refuted"
    points, more = count_of(int(run["points"]), "other point"), ""
    if low <= 1 - keep < high:
        needed = points_to_decide(float(part[CONFIRMED]), 1 - keep, int(run["points"]))
        more = f"; confirm = {needed} would decide" if needed else ""
    chance = _chance(part, CONFIRMED)
    return [f"The change of {keys} is {verdict} by {points}: {chance} exceed the limit of {what}{more}."]


def _confirmation(part: xr.Dataset, chance: float, allowed: float) -> list[str]:
    """The run that confirms a proposal: other points, and enough of them for the chance that is expected."""
    samples = points_to_decide(chance, allowed, int(part.attrs["samples_of_points"]))
    if samples is None:
        return []
    seed = int(part.attrs["seed_of_points"]) + 1
    scramble = "" if part.attrs["scramble_of_points"] else ", scramble = true"
    return [
        "These probabilities are estimated from the same points, reweighted. To confirm a change, write its values "
        f"into a copy of the study, with seed = {seed}{scramble} and samples = {samples} in [design], and run it: "
        f"tripod-doe run COPY.toml --out DIR{_finer(part, samples)}. With confirm = {samples} in "
        "this analysis of the study file, the run itself confirms the change that is named first."
    ]


def _finer(part: xr.Dataset, samples: int) -> str:
    """The finer models for the run that confirms, with their prices, where the error of this one matters."""
    prices = json.loads(str(part.attrs.get("finer_models", "{}")))
    if not (prices and _of_model(part)):
        return ""
    models = " or ".join(f'"{name}"' for name in prices)
    times = " or ".join(duration(samples * each, 2) for each in prices.values())
    return f"; take model = {models} in [base] (about {times} of CPU time), since the error of this model matters here"


def _percent(value: float, half: float) -> str:
    return f"{interval(100 * value, 100 * half)} %"


def tolerance_table(result: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Gain of halving the scatter of each factor for each main output, the largest first."""
    rows = []
    for _, what, _, part in tolerance_parts(result):
        gains = part["gain_of_halving"].values
        for at in np.argsort(-np.nan_to_num(gains, nan=-np.inf)):
            one = part.isel(factor=int(at))
            gain, half = float(one["gain_of_halving"]), float(one["gain_of_halving_conf"])
            if_halved = np.isfinite(one["exceedance_if_halved"])
            chance = _chance(one, "exceedance_if_halved") if if_halved else "-"
            name = spoken(str(one["factor"].values))
            rows.append([what, name, _percent(gain, half) if np.isfinite(gain) else "-", chance])
    return ["output", "factor", "standard deviation reduced by", "exceeds the limit if halved"], rows
