"""The contributions by several models side by side: where the cheaper ones agree with the finest, and where not."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from tripod_doe.analyses.contribution.contribution import PAPER_SHARES
from tripod_doe.analyses.kinds import of_kind
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.number_text import number
from tripod_doe.page_parts.words import ORDINALS, listed, spoken

_RIGHT = 5.0  # percent of an amplitude within which a model gets it right
_RIGHT_SHARE = 4.0  # percentage points of a share; the claims' own tolerance
_ORDERS = (3, 2)


def of_one_ladder(data: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Contributions of all five mechanisms at one operating point by different models, the coarsest first.

    Returns:
        By their names in `data`; empty unless there are at least two models.
    """
    candidates = {
        name: each
        for name, each in of_kind(data, "contribution").items()
        if each.attrs.get("model") in MODELS
        and not each.attrs.get("operating_dims")
        and set(each["mechanism"].values) == set(MECHANISMS)
        and set(_ORDERS) <= set(each["order"].values.tolist())
    }
    ranks = {name: list(MODELS).index(each.attrs["model"]) for name, each in candidates.items()}
    ordered = sorted(candidates, key=lambda name: ranks[name])
    of_one = len({each.attrs.get("unlike_paper") for each in candidates.values()}) == 1
    return {name: candidates[name] for name in ordered} if of_one and len(set(ranks.values())) == len(ranks) > 1 else {}


def _amplitudes(ladder: Mapping[str, xr.Dataset], order: int) -> list[float]:
    return [float(each["amplitude"].sel(order=order)) for each in ladder.values()]


def _shares(ladder: Mapping[str, xr.Dataset], order: int, mechanism: str) -> list[float]:
    return [float(each["share_off"].sel(order=order, mechanism=mechanism)) for each in ladder.values()]


def _models(ladder: Mapping[str, xr.Dataset]) -> list[str]:
    return [str(each.attrs["model"]) for each in ladder.values()]


def side_by_side_table(ladder: Mapping[str, xr.Dataset]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: the third and the second order, and their shares by switching off, one column per model.

    Args:
        ladder: From `of_one_ladder`.
    """
    rest = 100 - sum(PAPER_SHARES.values())
    of_paper = all(each.attrs.get("unlike_paper") == "{}" for each in ladder.values())
    rows = []
    for order in _ORDERS:
        rows.append([f"{ORDINALS[order]} (N)", *(number(value) for value in _amplitudes(ladder, order)), ""])
        for mechanism in MECHANISMS:
            paper = f"{PAPER_SHARES.get(mechanism, rest):g}{'' if mechanism in PAPER_SHARES else ' (rest)'}"
            cells = [_percent(value) for value in _shares(ladder, order, mechanism)]
            rows.append(
                [
                    f"{ORDINALS[order]}, share of {spoken(mechanism)} by switching off (%)",
                    *cells,
                    paper if of_paper and order == _ORDERS[0] else "",
                ]
            )
    return ["Quantity", *_models(ladder), "paper, 3.5"], rows


def _percent(value: float) -> str:
    return f"{value:.1f}".replace("-0.0", "0.0") if np.isfinite(value) else "unknown"


def find_side_by_side(ladder: Mapping[str, xr.Dataset]) -> list[str]:
    """State where the cheaper models agree with the finest, where they differ, and what they do not compute."""
    models = _models(ladder)
    right: list[str] = []
    wrong: list[str] = []
    for order in _ORDERS:
        *cheap, finest = _amplitudes(ladder, order)
        off = [100 * (value / finest - 1) for value in cheap]
        text = f"the {ORDINALS[order]} ({number(finest)} N; {_by_model(models, [f'{value:+.1f} %' for value in off])})"
        (right if max(map(abs, off)) <= _RIGHT else wrong).append(text)
        shares = {mechanism: _shares(ladder, order, mechanism) for mechanism in MECHANISMS}
        apart = {name: max(abs(value - values[-1]) for value in values[:-1]) for name, values in shares.items()}
        good = [name for name in MECHANISMS if apart[name] <= _RIGHT_SHARE]
        if good:
            right.append(
                f"the shares of {listed([spoken(name) for name in good])} in the {ORDINALS[order]} (difference at most "
                f"{max(apart[name] for name in good):.1f} percentage points)"
            )
        for name in (name for name in MECHANISMS if name not in good):
            *cheap, finest = shares[name]
            wrong.append(
                f"the share of {spoken(name)} in the {ORDINALS[order]} ({_percent(finest)} %; "
                f"{_by_model(models, [f'{_percent(value)} %' for value in cheap])})"
            )
    sentences = [
        f"Within {_RIGHT:g} % of an amplitude, or {_RIGHT_SHARE:g} percentage points of a share by switching off, "
        f"{listed(models[:-1])} agree with {models[-1]} on: {'; '.join(right) or 'nothing'}."
    ]
    if wrong:
        sentences.append(f"They differ on: {'; '.join(wrong)}.")
    if not any("needle_skew_deg" in MODELS[model].outputs for model in models[:-1]):
        sentences.append(f"They keep every needle at its initial skew: only {models[-1]} computes how it changes.")
    return sentences


def _by_model(models: list[str], values: list[str]) -> str:
    return ", ".join(f"{model} {value}" for model, value in zip(models, values, strict=False))
