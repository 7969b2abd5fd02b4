"""Points without a study: arrays as dimensions, failed points as data."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td

JOINT = {"model": "equilibrium", "torque_n_m": -35}


def test_arrays_are_dimensions_and_each_point_is_what_it_is_alone():
    """Invariance: points do not depend on their neighbours."""
    many = td.simulate(joint_angle_deg=[3, 25], speed_rpm=np.array([90, 5000.0]), **JOINT)
    assert many["thrust"].dims == ("joint_angle_deg", "speed_rpm", "rotation_deg")
    assert many["joint_angle_deg"].attrs["units"] == "degree"
    alone = td.simulate(joint_angle_deg=25, speed_rpm=90, **JOINT)
    xr.testing.assert_equal(many["thrust"].sel(joint_angle_deg=25, speed_rpm=90, drop=True), alone["thrust"])
    assert many.attrs["parameters"] == {
        name: value for name, value in alone.attrs["parameters"].items() if name not in ("joint_angle_deg", "speed_rpm")
    }


def test_arrays_that_share_a_dimension_vary_together_in_the_given_order():
    case = {"case": ["a", "b"]}
    angle = xr.DataArray([3, 25], case, ["case"])
    clearance = xr.DataArray([0.01, 0.03], case, ["case"])
    found = td.simulate(
        joint_angle_deg=angle, bearing_radial_clearance_mm=clearance, model=["kinetostatic", "equilibrium"]
    )
    assert found["outcome"].dims == ("case", "model")
    one = td.simulate(joint_angle_deg=25, bearing_radial_clearance_mm=0.03)
    np.testing.assert_array_equal(found["thrust"].sel(case="b", model="kinetostatic"), one["thrust"])


def test_a_failed_point_is_data():
    """The same variables as of one that finished, without numbers, and the reason."""
    good, bad = td.simulate(roller_width_mm=11, **JOINT), td.simulate(roller_width_mm=80, **JOINT)
    assert set(good.variables) == set(bad.variables)
    assert good.sizes == bad.sizes
    assert bad["thrust_amplitude"].isnull().all()
    assert td.Outcome(int(bad["outcome"])) is td.Outcome.JAMMED
    assert "roller_width_mm" in bad["outcome_detail"].item()
    assert (good.attrs["finished"], bad.attrs["finished"]) == (True, False)
    both = td.simulate(roller_width_mm=[11, 80], **JOINT)
    assert both["thrust_amplitude"].isnull().all("order").values.tolist() == [False, True]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"joint_angle_deg": []}, "joint_angle_deg: an array without values"),
        ({"joint_angle_deg": np.ma.array([3, 4], mask=[0, 1])}, "joint_angle_deg: masked values"),
        ({"joint_angle_deg": np.ma.masked}, "joint_angle_deg: masked values"),
        ({"joint_angle_deg": [3, 99]}, "joint_angle_deg = 99: must be"),
        ({"joint_angle": [3]}, "did you mean 'joint_angle_deg'"),
        ({"joint_angle_deg": [[3]]}, "2 dimensions; give an xarray.DataArray"),
        ({"joint_angle_deg": xr.DataArray([3.0], dims="order")}, "dimension order is one of the outputs"),
        ({"samples_per_revolution": [90, 180]}, "different lengths"),
        ({"joint_angle_deg": np.zeros(10**9, np.int8)}, "a list of 1,000,000,000 points needs"),
        (
            {
                "joint_angle_deg": xr.DataArray([3.0, 4], {"case": [1, 2]}, ["case"]),
                "torque_n_m": xr.DataArray([3.0, 4], {"case": [1, 3]}, ["case"]),
            },
            "different labels",
        ),
    ],
)
def test_arrays_that_cannot_be_used_are_refused(parameters, message):
    with pytest.raises(td.InputError, match=message):
        td.simulate(**parameters)


def test_a_study_may_be_a_dict_with_arrays():
    study = {"study": {"name": "x"}, "factors": {"joint_angle_deg": {"values": np.linspace(4, 8, 3), "low": None}}}
    assert td.load_study(study).factors["joint_angle_deg"].values == (4.0, 6.0, 8.0)
    with pytest.raises(td.InputError, match=r"factors.joint_angle_deg.values = \{4\}: expected"):
        td.load_study({"study": {"name": "x"}, "factors": {"joint_angle_deg": {"values": {4}}}})
