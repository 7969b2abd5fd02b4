"""Claims: decided by the points that they name, by their limits, and never by what did not finish."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.claims.evidence import ANY, Evidence, MissingPointError
from tripod_doe.analyses.claims.over_skew import ClaimsOverSkewSettings, claims_over_skew
from tripod_doe.analyses.claims.rules import RULES
from tripod_doe.analyses.claims.verdicts import ClaimsSettings, Verdict, check_claims, claims_json
from tripod_doe.analyses.contribution.contribution import PAPER_SHARES
from tripod_doe.errors import InputError
from tripod_doe.joint.orders import ORDERS
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.dataset import SWITCH_ROLE

SKEWS = {1: (0.2, -0.2, 0.2), 2: (0.4, -0.4, 0.4), 3: (0.4, 0.4, 0.4), 4: (-0.4, 0.4, -0.4)}
SETTINGS = ClaimsSettings()


def points(rows, third, second, outcome=None, error=0.01, phase=0.0, **fixed):
    """A cube as of a zip: one row of factors per point, and what the joint would give there."""
    names = list(rows[0])
    count = len(rows)
    amplitude = np.zeros((count, ORDERS.size))
    amplitude[:, 3], amplitude[:, 2] = third, second
    phases = np.zeros_like(amplitude)
    phases[:, 2] = phase
    groove = np.repeat(amplitude[:, None] / 3, 3, axis=1)
    groove[:, :, 1] = 5.0
    per_order = ("point", "order")
    return xr.Dataset(
        {
            "thrust_amplitude": (per_order, amplitude),
            "thrust_amplitude_error": (per_order, np.full_like(amplitude, error)),
            "thrust_phase_deg": (per_order, phases),
            "groove_thrust_amplitude": (("point", "groove", "order"), groove),
            "groove_thrust_phase_deg": (("point", "groove", "order"), np.zeros_like(groove)),
            "outcome": ("point", np.zeros(count, np.int8) if outcome is None else np.array(outcome, np.int8)),
        },
        coords={"order": ORDERS, "groove": [1, 2, 3]}
        | {name: ("point", np.array([row[name] for row in rows]), {"source": "paper"}) for name in names},
        attrs={"fixed_parameters": json.dumps({"model": "needles"} | fixed)},
    )


def skewed(case, **more):
    return {f"initial_skew_{k}_deg": skew for k, skew in enumerate(SKEWS[case], 1)} | more


def over_torque(third, outcome=None):
    return points([skewed(2, torque_n_m=torque) for torque in (25.0, 50.0, 100.0)], third, 0.2, outcome)


def verdict(claims, name):
    return Verdict(int(claims["verdict"].sel(claim=name)))


def test_a_proportion_holds_and_another_curve_does_not():
    holds = check_claims({"torque": over_torque([7.0, 14.0, 28.0])}, SETTINGS)
    assert verdict(holds, "third_proportional_to_torque") is Verdict.HOLDS
    assert float(holds["value"].sel(claim="third_proportional_to_torque")) == pytest.approx(0, abs=1e-12)
    fails = check_claims({"torque": over_torque([7.0, 14.0, 24.0])}, SETTINGS)
    assert verdict(fails, "third_proportional_to_torque") is Verdict.DOES_NOT_HOLD
    # amplitude over torque 0.28, 0.28, 0.24: the last is 10 % below the mean
    assert float(fails["value"].sel(claim="third_proportional_to_torque")) == pytest.approx(10.0)
    assert "24 N at 100 N m" in str(fails["reason"].sel(claim="third_proportional_to_torque").item())


def test_a_known_reason_is_not_said_of_another_joint():
    """Regression: numbers of the usual joint (0.107, 0.113, 0.104 N) stood there as the reason for any joint."""
    rows = [skewed(case, joint_angle_deg=angle) for case in (1, 2) for angle in (4.0, 8.0, 14.0)]
    claims = check_claims({"angles": points(rows, [4.0, 8.0, 14.0] * 2, [0.7, 1.1, 2.4] * 2)}, SETTINGS)
    reason = str(claims["reason"].sel(claim="second_independent_of_angle").item())
    assert reason.index("2.4 N at 14 deg") < reason.index("usual values of all parameters") < reason.index("0.107")


def test_a_point_that_failed_decides_nothing():
    """Two finished points lie on a proportion; the third ended badly, and its number, were it one, would fit."""
    outcome = [Outcome.FINISHED, Outcome.FINISHED, Outcome.INACCURATE]
    claims = check_claims({"torque": over_torque([7.0, 14.0, 28.0], outcome)}, SETTINGS)
    assert verdict(claims, "third_proportional_to_torque") is Verdict.NOT_DECIDED
    assert np.isnan(claims["value"].sel(claim="third_proportional_to_torque"))
    assert "inaccurate" in str(claims["reason"].sel(claim="third_proportional_to_torque").item())
    assert int(claims["sure"].sel(claim="third_proportional_to_torque")) == 0


def test_without_points_only_the_scene_itself_decides():
    claims = check_claims({}, SETTINGS)
    decided = claims["claim"].values[claims["verdict"].values != Verdict.NOT_DECIDED].tolist()
    assert decided == ["degrees_of_freedom"]
    assert float(claims["value"].sel(claim="degrees_of_freedom")) == 507
    assert bool((claims["reason"].values[claims["verdict"].values == Verdict.NOT_DECIDED] != "").all())


def test_nan_is_no_value():
    claims = check_claims({"torque": over_torque([7.0, np.nan, 28.0])}, SETTINGS)
    assert verdict(claims, "third_proportional_to_torque") is Verdict.NOT_DECIDED


def cases(second, phase, error=0.01):
    return points([skewed(case) for case in SKEWS], 14.4, second, error=error, phase=phase)


def test_the_beat_turns_and_vanishes():
    claims = check_claims({"cases": cases([0.1, 0.2, 0.004, 0.2], [10, 10, 0, -173])}, SETTINGS)
    for name in ("beat_turned", "second_vanishes_equal_skews", "second_follows_skew", "third_is_three_local"):
        assert verdict(claims, name) is Verdict.HOLDS, name
    assert float(claims["value"].sel(claim="beat_turned")) == pytest.approx(183)
    turned = check_claims({"cases": cases([0.1, 0.2, 0.02, 0.2], [10, 10, 0, 100])}, SETTINGS)
    assert verdict(turned, "beat_turned") is Verdict.DOES_NOT_HOLD
    assert verdict(turned, "second_vanishes_equal_skews") is Verdict.DOES_NOT_HOLD


def test_a_value_within_its_numerical_error_of_the_limit_says_so():
    near, clear = (cases([0.1, 0.2, 0.009, 0.2], [0, 0, 0, 180], error) for error in (0.01, 1e-5))
    name = "second_vanishes_equal_skews"
    assert int(check_claims({"cases": near}, SETTINGS)["sure"].sel(claim=name)) == 0
    assert int(check_claims({"cases": clear}, SETTINGS)["sure"].sel(claim=name)) == 1
    wide = check_claims({"cases": cases([0.1, 0.2, 0.0, 0.2], [0, 0, 0, 180], 0.1)}, SETTINGS)
    assert verdict(wide, "beat_turned") is Verdict.HOLDS  # 180 +- 40 deg, both ends beyond the limits
    assert int(wide["sure"].sel(claim="beat_turned")) == 0


def test_points_are_found_by_what_they_are():
    """The reference point lies in both cubes; that with the tighter tolerance is taken, other models never."""
    rows = [skewed(2)]
    loose, tight = (
        points(rows, third, 0.2, relative_tolerance=tolerance) for third, tolerance in ((14.0, 2e-3), (14.4, 5e-4))
    )
    other = points(rows, 99.0, 0.2, model="rollers", relative_tolerance=1e-5)
    evidence = Evidence({"a": tight, "b": loose, "c": other, "analysis": other.assign_attrs(analysis_kind="morris")})
    found = evidence.joint(model="needles", **skewed(2))
    assert [point.amplitude(3).value for point in found] == [14.4]
    settled = points(rows, 14.6, 0.2).assign(relative_tolerance_used=("point", [1e-4]))
    found = Evidence({"a": tight, "b": settled}).joint(model="needles", **skewed(2))
    assert [point.amplitude(3).value for point in found] == [14.6]  # the tolerance that its run found itself
    with pytest.raises(MissingPointError, match="torque_n_m 25"):
        evidence.joint(model="needles", torque_n_m=25.0)
    with pytest.raises(MissingPointError, match="no point"):
        evidence.scene(friction_a=ANY)


def test_json_tells_every_claim_with_null_for_what_is_not_known():
    table = json.loads(claims_json(check_claims({"torque": over_torque([7.0, 14.0, 24.0])}, SETTINGS)))
    by_name = {record["claim"]: record for record in table["claims"]}
    assert len(by_name) >= 25
    failed, open_one = by_name["third_proportional_to_torque"], by_name["third_independent_of_speed"]
    assert failed["holds"] is False
    assert failed["tolerance"] == {"low": None, "high": 2.0}
    assert open_one["holds"] is None
    assert open_one["value"] is None
    assert (failed["beyond_numerical_error"], open_one["beyond_numerical_error"]) == (True, None)
    assert {"statement", "where", "quantity", "unit", "numerical_error", "reason"} <= set(failed)
    assert "does not print" in table["cases"]


def test_the_choice_of_the_skews_decides_what_depends_on_it_and_nothing_else():
    """A second order that follows the skew up to 0.4 deg and not beyond: its claim holds for that choice only."""
    second = {0.2: 0.1, 0.4: 0.2, 0.8: 0.2}
    rows = [{f"initial_skew_{k}_deg": skew * sign for k, sign in ((1, 1), (2, -1), (3, 1))} for skew in second]
    cube = points(rows, 14.4, list(second.values()))
    over = claims_over_skew({"cases": cube}, ClaimsOverSkewSettings(skews_deg=[0.4, 0.8]))
    assert over["skew_deg"].values.tolist() == [0.4, 0.8]
    assert over["verdict"].sel(claim="second_follows_skew").values.tolist() == [Verdict.HOLDS, Verdict.DOES_NOT_HOLD]
    assert over["value"].sel(claim="second_follows_skew").values == pytest.approx([1.0, 0.5])
    assert (over["verdict"].sel(claim="third_order_dominant") == Verdict.HOLDS).all()
    # what needs other points, or none at all, is left out
    assert not {"beat_turned", "degrees_of_freedom", "share_groove_rolling"} & set(over["claim"].values)
    alone = check_claims({"cases": cube}, ClaimsSettings(small_skew_deg=0.4, large_skew_deg=0.8))
    assert float(over["value"].sel(claim="beat_visible", skew_deg=0.8)) == float(
        alone["value"].sel(claim="beat_visible")
    )
    with pytest.raises(InputError, match="no claim is decided"):
        claims_over_skew({"cases": cube}, ClaimsOverSkewSettings(skews_deg=[3, 5]))


def test_shares_may_differ_from_those_of_the_paper_by_four_points():
    """Published number: the limits in the table of claims follow from the paper's shares; sliding has the rest."""
    shares = PAPER_SHARES | {"groove_sliding": 100 - sum(PAPER_SHARES.values())}
    limits = {
        rule.name.removeprefix("share_"): (rule.low, rule.high) for rule in RULES if rule.name.startswith("share_")
    }
    assert limits == {name: (share - 4, share + 4) for name, share in shares.items()}


def test_points_of_different_joints_decide_nothing():
    """Regression: one joint gave 7 and 14 N, another one 28 N, and the claim held; the first of two joints counted."""
    rows = [skewed(2, torque_n_m=torque, pitch_radius_mm=21.0) for torque in (25.0, 50.0, 100.0)]
    rows[2]["pitch_radius_mm"] = 30.0
    claims = check_claims({"torque": points(rows, [7.0, 14.0, 28.0], 0.2)}, SETTINGS)
    assert verdict(claims, "third_proportional_to_torque") is Verdict.NOT_DECIDED
    reason = str(claims["reason"].sel(claim="third_proportional_to_torque").item())
    assert "points of different joints were run, which differ in pitch_radius_mm" in reason
    failed = points(rows, [7.0, 14.0, 28.0], 0.2)
    failed["outcome"][2] = Outcome.JAMMED
    claims = check_claims({"torque": failed}, SETTINGS)
    assert "jammed" in str(claims["reason"].sel(claim="third_proportional_to_torque").item())
    two = {f"at {radius}": cases([0.1, 0.2, 0.004, 0.2], 0) for radius in (21, 30)}
    two["at 30"].attrs["fixed_parameters"] = json.dumps({"model": "needles", "pitch_radius_mm": 30})
    assert verdict(check_claims(two, SETTINGS), "second_vanishes_equal_skews") is Verdict.NOT_DECIDED


def test_a_friction_that_follows_another_one_makes_no_other_joint():
    """Regression: after a study over the groove's friction no claim was decided, as it fixes no spin friction."""
    spin = cases([0.1, 0.2, 0.004, 0.2], 0)
    spin.attrs["fixed_parameters"] = json.dumps({"model": "needles", "groove_spin_friction": 0.05})
    friction = points([skewed(2, groove_sliding_friction=each) for each in (0.025, 0.05, 0.1)], [7.0, 14.0, 28.0], 0.2)
    claims = check_claims({"cases": spin, "friction": friction}, SETTINGS)
    assert verdict(claims, "second_vanishes_equal_skews") is Verdict.HOLDS
    assert verdict(claims, "third_follows_groove_friction") is Verdict.HOLDS
    friction.attrs["fixed_parameters"] = json.dumps({"model": "needles", "groove_spin_friction": 0.04})
    claims = check_claims({"cases": spin, "friction": friction}, SETTINGS)
    assert verdict(claims, "second_vanishes_equal_skews") is Verdict.NOT_DECIDED


def test_shares_are_of_the_papers_point_of_an_ablation_at_several():
    """Regression: TypeError, as a share over joint angles is no number."""
    switches = ["groove_sliding", "needle_sliding"]
    rows = [skewed(2, joint_angle_deg=angle, **dict.fromkeys(switches, 1)) for angle in (7.0, 10.0)]
    rows += [row | {name: 0} for row in rows for name in switches]
    cube = points(rows, [7.0, 10.0, 1.0, 3.5, 2.0, 9.0], 0.2).assign_attrs(study='[study]\nname = "map"\n')
    for name in switches:
        cube[name].attrs["role"] = SWITCH_ROLE
    claims = check_claims({"map": cube}, SETTINGS)
    assert float(claims["value"].sel(claim="share_needle_sliding")) == pytest.approx(10.0)


def test_the_sign_of_a_torque_does_not_count():
    rows = [skewed(2, torque_n_m=torque) for torque in (-50.0, 50.0, 100.0)]  # regression: 300 % off the mean
    claims = check_claims({"torque": points(rows, [14.0, 14.0, 28.0], 0.2)}, SETTINGS)
    assert verdict(claims, "third_proportional_to_torque") is Verdict.HOLDS
