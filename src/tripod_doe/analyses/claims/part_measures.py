"""Measures of claims about the parts of the joint: mechanisms, needles, laws of friction, degrees of freedom."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from tripod_doe.analyses.claims.amplitudes import point_of
from tripod_doe.analyses.claims.cases import Cases
from tripod_doe.analyses.claims.evidence import ANY, Evidence, Measured, MissingPointError
from tripod_doe.analyses.contribution.contribution import PAPER_SHARES, contribution_shares
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.number_text import level, number
from tripod_doe.study.cube.dataset import SWITCH_ROLE

_DEFINITIONS = {"share_off": "switching off", "share_on": "on alone", "share_shapley": "Shapley value"}


def share_of(mechanism: str) -> Callable[[Evidence, Cases], Measured]:
    """The share by the definition whose value is closest to the paper's."""
    paper = PAPER_SHARES.get(mechanism, 100 - sum(PAPER_SHARES.values()))

    def measure(evidence: Evidence, cases: Cases) -> Measured:
        point = point_of(evidence, cases, 2)
        switched = cases.wanted(2) | dict.fromkeys(MECHANISMS, ANY)
        ablations = {
            name: numbers
            for name, cube in evidence.cubes.items()
            if mechanism in cube.coords and cube[mechanism].attrs.get("role") == SWITCH_ROLE
            if (numbers := evidence.numbers(name, **switched))
        }
        if not ablations:
            raise MissingPointError(f"no ablation of {mechanism} with model {cases.model} in case 2 was run")
        name, numbers = next(iter(ablations.items()))
        evidence.used[name] = set(numbers)
        result = contribution_shares(evidence.cubes[name].isel(point=numbers))
        shares = {
            name: result[name].sel(mechanism=mechanism, order=3).item() for name in _DEFINITIONS if name in result
        }
        known = {name: share for name, share in shares.items() if math.isfinite(share)}
        if not known:
            raise MissingPointError("points of the ablation did not finish")
        nearest = min(known, key=lambda name: abs(known[name] - paper))
        error = 100 * math.sqrt(2) * point.amplitude(3).error / point.amplitude(3).value
        text = ", ".join(f"{_DEFINITIONS[name]} {share:.1f} %" for name, share in shares.items())
        return Measured(known[nearest], error, f"Definition closest to the paper: {_DEFINITIONS[nearest]}; {text}.")

    return measure


def skew_stays(evidence: Evidence, cases: Cases) -> Measured:
    """Largest change of the mean skew up to the last revolution, cases 1 and 2, in percent."""
    candidates = []
    for case in (1, 2):
        summary = point_of(evidence, cases, case).output("needle_skew_summary_deg").isel(cycle=-1)
        mean, least, most = (summary.sel(statistic=name).values for name in ("mean", "min", "max"))
        start = np.array(cases.skews(case))
        text = ", ".join(
            f"{level(s)} -> {m:.2f} (range {low:.2f} to {high:.2f})"
            for s, m, low, high in zip(start, mean, least, most, strict=True)
        )
        change = 100 * float(np.abs(mean / start - 1).max())
        candidates.append(
            Measured(change, note=f"Case {case}, trunnions 1 to 3 in deg: {text}, change at most {change:.0f} %.")
        )
    return Measured(max(each.value for each in candidates), note=" ".join(each.note for each in candidates))


def degrees_of_freedom(evidence: Evidence, cases: Cases) -> Measured:
    """Free velocities of the scene of the reference joint, less its constraints."""
    free, constraints = _velocities_and_constraints()
    return Measured(float(free - constraints), 0.0, f"{free} velocities minus {constraints} constraints.")


@cache
def _velocities_and_constraints() -> tuple[int, int]:
    from tripod_doe.joint.multibody.joint_scene import build_joint
    from tripod_doe.mechanics.assembly import assemble

    tables = assemble(build_joint(point_values({}).point(0), needles=True)).tables
    return int(tables.bodies["free"][tables.bodies["block"] >= 0].sum()), int(tables.rows.size)


def friction_from_rest(evidence: Evidence, cases: Cases) -> Measured:
    """Largest deviation of a tilted roller's axial force from the law mu_s tanh(v/v_st), percent of its full value."""
    points = evidence.scene(tilt_deg=ANY, axial_speed_mm_s=ANY, transition_ratio=ANY)
    velocity = np.array([1 / float(point.value("transition_ratio")) for point in points])
    if velocity.size < 3:
        raise MissingPointError("fewer than three sliding velocities were run")
    full = [float(point.value("friction")) for point in points]
    normal = [float(p.value("load_n")) * math.sin(math.radians(abs(float(p.value("tilt_deg"))))) for p in points]
    felt = np.array([float(point.output("axial_force_n")) for point in points]) / normal / full
    slow, fast = int(velocity.argmin()), int(velocity.argmax())
    note = (
        f"The coefficient is {number(100 * felt[slow])} % of its full value at {level(velocity[slow])} times the "
        f"transition velocity, {number(100 * felt[fast], 4)} % at {level(velocity[fast])} times."
    )
    return Measured(100 * float(np.abs(felt - np.tanh(velocity)).max()), note=note)


def _loci(evidence: Evidence) -> dict[str, tuple[float, float]]:
    """Drift and travel in mm by which plate has more friction."""
    candidates = {}
    for point in evidence.scene(friction_a=ANY, friction_b=ANY):
        a, b = float(point.value("friction_a")), float(point.value("friction_b"))
        key = "equal" if a == b else "A" if a > b else "B"
        candidates[key] = float(point.output("axial_drift_mm")), float(point.output("travel_mm"))
    if len(candidates) < 3:
        raise MissingPointError("the needle between plates was not run with equal and with both unequal frictions")
    return candidates


def locus_straight(evidence: Evidence, cases: Cases) -> Measured:
    """Drift over travel of a needle between plates of equal friction, in percent."""
    drift, travel = _loci(evidence)["equal"]
    return Measured(100 * abs(drift / travel), note=f"Drift {number(drift)} mm, travel {number(travel)} mm.")


def loci_apart(evidence: Evidence, cases: Cases) -> Measured:
    """Drift with more friction at plate A over drift with more at plate B."""
    loci = _loci(evidence)
    text = ", ".join(f"{key}: {drift:+.3g} mm" for key, (drift, _) in loci.items())
    return Measured(loci["A"][0] / loci["B"][0], note=f"Drift for each plate with more friction: {text}.")
