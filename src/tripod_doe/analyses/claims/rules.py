"""The claims of the paper as rules: `claims.toml` states them, and a number from the cubes decides each."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files

from tripod_doe.analyses.claims import order_measures as orders
from tripod_doe.analyses.claims import part_measures as parts
from tripod_doe.analyses.claims.cases import Cases
from tripod_doe.analyses.claims.evidence import Evidence, Measured


@dataclass(frozen=True)
class Rule:
    """One claim."""

    name: str  # its identifier
    # statement, place: what the paper says, and where
    statement: str
    place: str
    # quantity, unit: the number that decides it
    quantity: str
    unit: str
    # computes the number from the evidence; raises `MissingPointError` if points are missing
    measure: Callable[[Evidence, Cases], Measured]
    # low, high: limits within which it holds; None for none
    low: float | None = None
    high: float | None = None
    why_not: str = ""  # the known reason if it does not hold


_MEASURES: dict[str, Callable[[Evidence, Cases], Measured]] = {
    "degrees_of_freedom": parts.degrees_of_freedom,
    "friction_from_rest": parts.friction_from_rest,
    "locus_equal_friction": parts.locus_straight,
    "loci_unequal_friction": parts.loci_apart,
    "third_order_dominant": orders.third_dominates,
    "beat_visible": orders.beat,
    "second_above_fourth": orders.second_above_fourth,
    "skew_stays": parts.skew_stays,
    "third_independent_of_case": orders.same_third,
    "third_cases_over_angle": orders.same_third_over_angle,
    "third_linear_in_angle": orders.straight_over_angle,
    "third_proportional_to_angle": orders.offset_over_angle,
    "third_proportional_to_torque": orders.over_torque,
    "third_independent_of_speed": orders.over_speed,
    "second_from_skew": orders.without_skew,
    "second_follows_skew": orders.with_skew,
    "second_independent_of_angle": orders.second_over_angle,
    "second_vanishes_equal_skews": orders.equal_skews,
    "local_phases_regular": orders.regular_phases,
    "beat_turned": orders.turned_beat,
    "first_order_local_only": orders.local_first,
    "third_is_three_local": orders.three_local,
    "local_orders_dominant": orders.local_orders,
    "share_groove_sliding": parts.share_of("groove_sliding"),
    "share_groove_spinning": parts.share_of("groove_spinning"),
    "share_groove_rolling": parts.share_of("groove_rolling"),
    "share_needle_rolling": parts.share_of("needle_rolling"),
    "share_needle_sliding": parts.share_of("needle_sliding"),
    "third_follows_groove_friction": orders.with_groove_friction,
    "second_by_needle_sliding": orders.needle_sliding,
}
"""How the number that decides a claim is measured."""

_TABLES = tomllib.loads(files("tripod_doe.analyses.claims").joinpath("claims.toml").read_text(encoding="utf-8"))

RULES = tuple(Rule(name, **table, measure=_MEASURES[name]) for name, table in _TABLES.items())
"""All claims, in the order of the paper."""
