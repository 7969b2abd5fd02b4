"""Findings and table of a multifidelity analysis: what the truth would answer, and what the cheaper models gain."""

import numpy as np
import xarray as xr

from tripod_doe.analyses.sensitivity.sentences import nothing_varies, sobol_sentence, without_intervals
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import count_of, duration, interval, number, squared, with_unit
from tripod_doe.page_parts.main_outputs import OutputPart, main_outputs, quantile_text
from tripod_doe.page_parts.words import listed


def multifidelity_parts(result: xr.Dataset) -> list[OutputPart]:
    """Main outputs with their answers."""
    return main_outputs(result, "variance")


def find_in_multifidelity(result: xr.Dataset, name: str) -> list[str]:
    """Sentences on the distribution of each main output, the gain over the truth alone, and what was dropped."""
    sentences = []
    truth = str(result.attrs["truth"])
    parts = multifidelity_parts(result)
    if not parts and "variance" in result:
        sentences.append(nothing_varies(name))
    for part in parts:
        sentences.append(f"{_distribution(part, truth)} (analysis {name}).")
        if np.isnan(part.answers["mean_conf"]):
            sentences.append(without_intervals(part.what))
        sentences += _gain(part, truth)
        if "ST" in part.answers:
            sentences.append(f"{sobol_sentence(part)}.")
    return [*sentences, _samples(result), *_holes(result)]


def _distribution(part: OutputPart, truth: str) -> str:
    answers, unit = part.answers, part.unit
    mean = with_unit(interval(float(answers["mean"]), float(answers["mean_conf"])), unit)
    variance = with_unit(interval(float(answers["variance"]), float(answers["variance_conf"])), squared(unit))
    return f"Scatter of {part.what} by {truth}: mean {mean}, variance {variance}; {quantile_text(part)}"


def _gain(part: OutputPart, truth: str) -> list[str]:
    """Gain by the cheaper models at equal price; nothing where prices are not known."""
    answers = part.answers
    if not np.isfinite(answers["gain"]):
        return []
    shares = [f"{number(1 / float(answers['gain']), 2)} for its mean"]
    if np.isfinite(answers["variance_gain"]):
        shares.append(f"{number(1 / float(answers['variance_gain']), 2)} for its variance")
    if "ST_gain" in answers:
        gains = answers["ST_gain"].values[np.isfinite(answers["ST_gain"].values)]
        if gains.size:
            ends = list(dict.fromkeys(number(1 / gain, 2) for gain in (gains.max(), gains.min())))
            shares.append(f"{' to '.join(ends)} for its total indices")
    worse = any(float(f"{1 / each:.1e}") > 1 for each in _known_gains(answers))  # as written
    more = "; above 1, the truth alone would have been better" if worse else ""
    return [f"The squared error for {part.what}, relative to {truth} alone at the same price: {listed(shares)}{more}."]


def _known_gains(answers: xr.Dataset) -> FloatArray:
    """All gains that the sentence on them states, shape (gain,)."""
    stated = [answers[key].values.ravel() for key in ("gain", "variance_gain", "ST_gain") if key in answers]
    gains = np.concatenate(stated)
    return np.asarray(gains[np.isfinite(gains)], float)


def _samples(result: xr.Dataset) -> str:
    """Number of samples of each model, and their price."""
    block = int(result.attrs["block_size"])
    rows = zip(result["model"].values, result["samples"].values, result["price"].values, strict=True)
    text = listed([f"{int(count):,} of {model}" for model, count, _ in rows])
    seconds = float((result["samples"] * result["price"]).sum(skipna=False))
    price = f", at a price of {duration(seconds)} of CPU time" if np.isfinite(seconds) else ""
    return f"Samples{f' of {block} points' if block > 1 else ''}: {text}{price}."


def _holes(result: xr.Dataset) -> list[str]:
    lost = int(result.attrs["samples_dropped"])
    if not lost:
        return []
    verb = "is" if lost == 1 else "are"
    region = str(result.attrs.get("failing_region", ""))
    text = f"{count_of(lost, 'sample')} {verb} dropped in all models, because of points that failed in one."
    return [text] + [f"Points fail {region}."] * bool(region)


def model_table(result: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Samples, price and correlation with the truth of each model."""
    parts = multifidelity_parts(result)
    rows = []
    for at, model in enumerate(result["model"].values):
        price = float(result["price"][at])
        correlations = [number(float(part.answers["correlation"][at]), 3) for part in parts]
        text = duration(price) if np.isfinite(price) else "-"
        rows.append([str(model), f"{int(result['samples'][at]):,}", text, *correlations])
    heads = [f"correlation, {part.what.removeprefix('the ')}" for part in parts]
    return ["model", "samples", "price per sample", *heads], rows
