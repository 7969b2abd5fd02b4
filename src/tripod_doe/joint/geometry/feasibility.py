"""Feasibility of a point: whether the parts fit together, can move and slide fast enough; if not, nothing is solved.

Needles on their pitch circle, all skewed by psi, are lines of a hyperboloid: the axes of neighbours are apart by

    2 r_p sin(pi/N) / sqrt(1 + tan^2 psi cos^2(pi/N)),

which must be at least a needle's diameter. A preloaded bearing (negative clearance c) presses every needle by -c/2 into
trunnion and by -c/2 into bore. It does not fit if the preload alone exceeds the contact pressure at which needles leave
a permanent dent. It cannot move if the friction mu_s sum f of the preload alone exceeds the load |T| / (3 R_p) at the
groove: then the roller would have to climb its groove by more than 45 deg before it slides on its trunnion. tanh
friction never sticks, so a run of such a joint ends, with forces that a real one would not survive.

Solid parts in each other's place are in `overlaps`.

At rest friction may have any value below its limit, so there is no thrust to compute; a quasi-static joint has
the thrust of a low speed. If parts slide so slowly that the floor of the transition velocities applies, friction and
thrust are too small.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.derived_constants.contact_pressure import needle_pressure
from tripod_doe.joint.geometry.overlaps import MARGIN, Overlap, overlaps
from tripod_doe.joint.geometry.transition_velocities import slides_too_slowly
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.contact_damping_parameters import BOTH
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import rounded_down, rounded_up

_STATIC_PRESSURE = 4000.0
"""MPa; contact stress of the basic static load rating of roller bearings (ISO 76)."""

_EXPONENT = 10 / 9

_SLIDING = {"speed_rpm": ("speed", np.pi / 30, 10_000.0), "joint_angle_deg": ("joint_angle", np.pi / 180, 40.0)}
"""Parameters on which slips depend: their fields, the factors to internal units, and the ends of their ranges."""
_HALVINGS = 40


def infeasible(points: JointValues[FloatArray]) -> dict[int, tuple[Outcome, str]]:
    """Points that no model can run, with outcome and reason."""
    both = np.flatnonzero((points.contact_damping_time > 0) & (points.contact_damping > 0))
    reasons: dict[int, tuple[Outcome, str]] = {int(row): (Outcome.OUT_OF_RANGE, BOTH) for row in both}
    for row, reason in misfits(points):
        reasons.setdefault(row, (Outcome.JAMMED, reason))
    if (slow := np.flatnonzero(slides_too_slowly(points))).size:
        for row, reason in zip(slow.tolist(), _too_slow(points.take(slow)), strict=True):
            reasons.setdefault(row, (Outcome.OUT_OF_RANGE, reason))
    return reasons


def _too_slow(points: JointValues[FloatArray]) -> list[str]:
    """The reasons why points have no thrust, and the least speed or angle within its range at which each has one."""
    least = {name: _least(points, name) for name in _SLIDING}
    reasons = []
    for i, straight in enumerate((points.joint_angle == 0).tolist()):  # then any speed does
        known = {} if straight else {name: float(own[i]) for name, own in least.items() if own[i] == own[i]}
        ways = " or ".join(f"{name} to at least {rounded_up(value)}" for name, value in known.items())
        reasons.append(
            "the parts do not move, or so slowly that friction is not defined (transition velocities below "
            f"0.001 mm/s or 0.001 rad/s): raise {ways or 'speed_rpm' + ' and joint_angle_deg' * (not straight)}; "
            "for the quasi-static thrust take a low speed; a joint angle of 0 has no thrust"
        )
    return reasons


def _least(points: JointValues[FloatArray], name: str) -> FloatArray:
    """Least values of a parameter at which no part slides too slowly; NaN if all of its range is too low."""
    field, unit, end = _SLIDING[name]

    def slow(values: FloatArray) -> NDArray[np.bool_]:
        return slides_too_slowly(replace(points, **{field: values * unit}))

    low, high = np.zeros_like(points.speed), np.full_like(points.speed, end)
    never = slow(high)
    for _ in range(_HALVINGS):  # of all points at once: one costs as much as a hundred
        middle = (low + high) / 2
        is_slow = slow(middle)
        low, high = np.where(is_slow, middle, low), np.where(is_slow, high, middle)
    return np.where(never, np.nan, high)


def misfits(points: JointValues[FloatArray]) -> list[tuple[int, str]]:
    """Points whose parts cannot be put together or cannot move, with the reason."""
    return [(i, each.reason(i)) for each in _conflicts(points) for i in map(int, np.flatnonzero(each.bad))]


def _conflicts(points: JointValues[FloatArray]) -> list[Overlap]:
    return [*_rings(points), *overlaps(points), *_preloads(points), *_skewed(points)]


def _improved(points: JointValues[FloatArray], i: int, **changed: float) -> bool:
    """Whether a point with some sizes changed has fewer conflicts and no new one."""
    point = points.take(slice(i, i + 1))
    other = replace(point, **{name: np.full(1, value) for name, value in changed.items()})
    before, after = ({k for k, each in enumerate(_conflicts(p)) if each.bad[0]} for p in (point, other))
    return after < before


def _rings(points: JointValues[FloatArray]) -> list[Overlap]:
    """Needles that do not fit between trunnion and bore."""
    pitch, needle, spacing = points.needle_pitch_diameter, points.needle_diameter, _spacing(points, 0.0)

    def no_trunnion(i: int) -> str:
        return (
            "the trunnion has no diameter: needle_diameter_mm must be below needle_pitch_diameter_mm "
            f"({needle[i]:.4g} and {pitch[i]:.4g})"
        )

    def too_many(i: int) -> str:
        return (
            f"the needles do not fit on the pitch circle: {_room(points, i)} ({points.needle_count[i]:g} needles of "
            f"{needle[i]:.4g} mm are {rounded_down(spacing[i], 4)} mm apart)"
        )

    def no_wall(i: int) -> str:
        return (
            "the bore is larger than the roller: raise roller_radius_mm, or reduce needle_pitch_diameter_mm or "
            f"needle_diameter_mm (radii {points.bore_radius[i]:.4g} and {points.roller_radius[i]:.4g} mm)"
        )

    return [
        Overlap(needle >= pitch, no_trunnion),
        Overlap(spacing < needle, too_many),
        Overlap(points.bore_radius >= points.roller_radius, no_wall),
    ]


def _preloads(points: JointValues[FloatArray]) -> list[Overlap]:
    """Bearings whose preload dents them or blocks them."""
    load, held, pressure = _preload(points)

    def dents(i: int) -> str:
        return (
            f"the preload of the needles exceeds a contact pressure of {_STATIC_PRESSURE:g} MPa: raise "
            f"bearing_radial_clearance_mm (at {points.bearing_radial_clearance[i]:.4g} the pressure is "
            f"{pressure[i]:.4g} MPa)"
        )

    def holds(i: int) -> str:
        return (
            "the sliding friction of the preloaded needles exceeds the mean contact force of a groove, so the rollers "
            "cannot move on their trunnions: raise bearing_radial_clearance_mm or torque_n_m "
            f"({held[i]:.4g} and {load[i]:.4g} N)"
        )

    return [Overlap(pressure > _STATIC_PRESSURE, dents), Overlap((held > load) & (load > 0), holds)]


def _skewed(points: JointValues[FloatArray]) -> list[Overlap]:
    """Needles that fit unskewed, and are skewed into each other."""
    room = _spacing(points, 0.0) >= points.needle_diameter

    def crossed(k: int, skew: FloatArray) -> Overlap:
        spacing = _spacing(points, skew)

        def reason(i: int) -> str:
            return (
                f"needles skewed by initial_skew_{k}_deg do not fit next to each other: bring it to "
                f"{_largest_skew(points, i)} deg or nearer to 0, or {_room(points, i)} (at "
                f"{np.degrees(skew[i]):.4g} deg their axes are {rounded_down(spacing[i], 4)} mm apart, and "
                f"needle_diameter_mm is {points.needle_diameter[i]:.4g})"
            )

        return Overlap(room & (spacing < points.needle_diameter), reason)

    return [crossed(k, skew) for k, skew in enumerate(points.initial_skews, 1)]


def most_needles(diameter: FloatArray | float, pitch_diameter: FloatArray | float) -> FloatArray:
    """Number of unskewed needles that fit on their pitch circle; lengths in one unit, shapes broadcast."""
    most: FloatArray = np.floor(np.pi / np.arcsin(np.minimum(np.divide(diameter, pitch_diameter), 1.0)) + 1e-9)
    return most


def room_for_needles(values: JointValues[float]) -> int:
    """Number of needles that still fit on the pitch circle of an operating point, unskewed."""
    return int(most_needles(values.needle_diameter, values.needle_pitch_diameter)) - int(values.needle_count)


def _spacing(points: JointValues[FloatArray], skew: FloatArray | float) -> FloatArray:
    """Distance of the axes of neighbouring needles that all have the same skew; infinite for one needle."""
    count = points.needle_count
    half = np.pi / np.maximum(count, 2)
    spacing = points.needle_pitch_diameter * np.sin(half) / np.hypot(1.0, np.tan(skew) * np.cos(half))
    return np.where(count > 1, spacing, np.inf)


def _room(points: JointValues[FloatArray], i: int) -> str:
    """Changes with which the needles of a point fit next to each other at its skews, with values on the safe side."""
    point, needle, pitch = points.take(slice(i, i + 1)), points.needle_diameter[i], points.needle_pitch_diameter[i]
    skew = float(np.abs(point.initial_skews).max())
    most = int(most_needles(needle, pitch))
    while most > 1 and _spacing(replace(point, needle_count=np.full(1, float(most))), skew)[0] < needle:
        most -= 1
    spacing = float(_spacing(point, skew)[0])
    thinner, wider = rounded_down(spacing, 4), rounded_up(MARGIN * needle / spacing * pitch, 4)
    thin = _improved(points, i, needle_diameter=float(thinner))
    wide = _improved(points, i, needle_pitch_diameter=float(wider))
    return (
        f"reduce needle_count to {most}, or needle_diameter_mm"
        + f" to {thinner} or less" * thin
        + f", or raise needle_pitch_diameter_mm to {wider} or more" * wide
    )


def _largest_skew(points: JointValues[FloatArray], i: int) -> str:
    """Largest skew in deg at which the needles of a point fit next to each other, rounded down."""
    room = float(_spacing(points.take(slice(i, i + 1)), 0.0)[0] / points.needle_diameter[i])
    tangent = np.sqrt(max(room**2 - 1, 0.0)) / np.cos(np.pi / points.needle_count[i])
    return rounded_down(float(np.degrees(np.arctan(tangent))) / MARGIN, 3)


def _preload(points: JointValues[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean load of a groove; sliding resistance and largest pressure of a bearing from its preload alone."""
    squeeze = np.maximum(-points.bearing_radial_clearance, 0.0) / 2
    each = points.needle_stiffness * squeeze**_EXPONENT
    pressure = needle_pressure(points, each / points.needle_length)
    return points.groove_load, points.needle_sliding_friction * points.needle_count * each, pressure
