"""Findings and table of the effects of a factorial or response-surface design."""

import json

import numpy as np
import xarray as xr

from tripod_doe.analyses.sensitivity.sentences import nothing_varies
from tripod_doe.number_text import count_of, interval, number, r2_text, squared, with_unit
from tripod_doe.page_parts.main_outputs import OutputPart, left_points, main_outputs
from tripod_doe.page_parts.words import listed, spoken

_MOST_NAMED = 4
_SURE = 0.05  # largest probability by chance of an effect that a sentence names


def effect_parts(result: xr.Dataset) -> list[OutputPart]:
    """Main outputs with their effects over ``term`` alone."""
    return main_outputs(result, "effect", ("term",))


def term_text(name: str) -> str:
    """A term in words: ``joint angle x torque``."""
    return " x ".join(
        spoken(factor.removesuffix("^2")) + (" squared" if "^" in factor else "") for factor in name.split(":")
    )


def find_in_effects(result: xr.Dataset, name: str) -> list[str]:
    """Sentences on the largest effects of each main output, on aliases, and on missing points."""
    sentences = []
    parts = effect_parts(result)
    if not parts and "effect" in result:
        sentences.append(nothing_varies(name, "term has an effect"))
    for _, what, unit, part in parts:
        rows = list(
            zip(
                part["term"].values,
                part["effect"].values,
                part["effect_conf"].values,
                part["p_value"].values,
                strict=True,
            )
        )
        sure = sorted((row for row in rows if row[3] <= _SURE), key=lambda row: -abs(row[1]))
        text = [
            f"{term_text(str(term))} {with_unit(interval(float(effect), float(half)), unit)}"
            for term, effect, half, _ in sure[:_MOST_NAMED]
        ]
        weak = f"; {count_of(len(rows) - len(sure), 'term')} not significant" if len(sure) < len(rows) else ""
        saturated = int(result.attrs["degrees_of_freedom"]) == 0  # R2 is one, whatever the terms
        known = np.isfinite(part["r_squared"]) and not saturated
        explained = f", R2 {r2_text(float(part['r_squared']))}" if known else ""
        if text:
            sentences.append(f"{_largest(what, text)}{weak}{explained} (analysis {name}).")
        elif saturated and rows:
            sentences.append(_without_scatter(what, unit, rows, name))
        else:
            sentences.append(f"No effect on {what} is significant{explained} (analysis {name}).")
    aliases: dict[str, list[str]] = json.loads(str(result.attrs.get("aliases", "{}")))
    mixed = [
        f"{term_text(left)} with {listed([term_text(each) for each in kept])}" for left, kept in aliases.items() if kept
    ]
    if mixed:
        more = f" and {len(mixed) - _MOST_NAMED} more" if len(mixed) > _MOST_NAMED else ""
        sentences.append(f"Effects that this design confounds: {'; '.join(mixed[:_MOST_NAMED])}{more}.")
    return sentences + left_points(result)


def _without_scatter(what: str, unit: str, rows: list[tuple[str, float, float, float]], name: str) -> str:
    """The largest effects where the only scatter that they could be judged by is that among themselves."""
    largest = sorted(rows, key=lambda row: -abs(row[1]))[:_MOST_NAMED]
    text = [f"{term_text(str(row[0]))} {with_unit(number(float(row[1])), unit)}" for row in largest]
    why = "there are as many terms as points, so their significance is not known"
    return f"{_largest(what, text)}; {why} (analysis {name})."


def _largest(what: str, text: list[str]) -> str:
    way = "from low to high" + ", of squares from the middle to the ends" * any(" squared" in each for each in text)
    return f"Largest effects on {what}, {way}: {listed(text)}"


def effect_table(result: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """The analysis of variance of the main outputs, the largest sums of squares first."""
    rows = []
    for _, what, unit, part in effect_parts(result):
        for at in np.argsort(-part["sum_of_squares"].values):
            values = {
                key: float(part[key].values[at])
                for key in ("effect", "effect_conf", "sum_of_squares", "f_value", "p_value")
            }
            rows.append(
                [
                    what,
                    term_text(str(part["term"].values[at])),
                    with_unit(interval(values["effect"], values["effect_conf"]), unit),
                    with_unit(number(values["sum_of_squares"]), squared(unit)),
                    number(values["f_value"]),
                    number(values["p_value"], 2),
                ]
            )
        residual = with_unit(number(float(part["residual_sum_of_squares"])), squared(unit))
        rows.append([what, "residual", "", residual, "", ""])
    return ["output", "term", "effect", "sum of squares", "F", "p"], rows
