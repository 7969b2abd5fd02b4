"""What a fit says of records with the wrong sign or unit of the force, and where no joint fits."""

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.analyses.fit.sentences import find_in_fit

POINTS = ((5, 60), (9, 120), (13, 200))


@pytest.fixture(scope="module")
def orders():
    """Complex orders of a joint at three operating points, N."""
    angle, torque = zip(*POINTS, strict=True)
    joint = [td.simulate(model="equilibrium", joint_angle_deg=a, torque_n_m=t, groove_sliding_friction=0.07)
             for a, t in zip(angle, torque, strict=True)]  # fmt: skip
    return [own["thrust_amplitude"].values * np.exp(1j * np.radians(own["thrust_phase_deg"].values)) for own in joint]


@pytest.mark.parametrize(
    ("factor", "high", "told"),
    [
        pytest.param(1.0, 0.2, [], marks=pytest.mark.slow),
        (-1.0, 0.2, ["Check the sign of the force and reference_angle_deg", "No joint within the bounds"]),
        pytest.param(1e-3, 0.2, ["Check the unit of the force", "No joint within the bounds"], marks=pytest.mark.slow),
        pytest.param(1.0, 0.05, ["No joint within the bounds fits these records"], marks=pytest.mark.slow),
    ],
)
def test_what_is_wrong_with_all_records_is_said_first(tmp_path, orders, factor, high, told):
    """Regression: frictions "with 95 % confidence" of records with the wrong sign, and no word on it."""
    random, rotation, rows = np.random.default_rng(0), np.arange(0, 3600, 5.0), ["file,joint_angle_deg,torque_n_m"]
    for at, ((angle, torque), own) in enumerate(zip(POINTS, orders, strict=True)):
        force = factor * np.cos(np.radians(rotation)[:, None] * np.arange(13) + np.angle(own)) @ np.abs(own)
        force *= 1 + 0.01 * random.standard_normal(rotation.size)
        np.savetxt(tmp_path / f"{at}.csv", np.column_stack([rotation, force]), "%.7g", ",", header="rotation_deg,thrust_n",
                   comments="")  # fmt: skip
        rows.append(f"{at}.csv,{angle},{torque}")
    (tmp_path / "records.csv").write_text("\n".join([*rows, ""]))
    (tmp_path / "fit.toml").write_text(
        '[fit]\nname = "a"\nmodel_error = 0\n[base]\nmodel = "equilibrium"\nspeed_rpm = 600\n'
        f"[unknowns.groove_sliding_friction]\nlow = 0.01\nhigh = {high}\n"
        '[records]\ntable = "records.csv"\norders = [3]\nreference_angle_deg = 0\n'
    )
    said = find_in_fit(td.fit(tmp_path / "fit.toml", out=tmp_path / "out", workers=0, progress=False).result)
    assert [line.startswith(start) for line, start in zip(said, told, strict=False)] == [True] * len(told)
    assert not any(line.startswith(("Check", "No joint")) for line in said[len(told) :])
    assert any("95 % confidence" in line for line in said) == (not told)
