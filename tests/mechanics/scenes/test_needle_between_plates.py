"""The needle between two plates (paper 2.3.3, Fig. 8): closed form, loci, and explicit methods that lie."""

import math

import numpy as np
import pytest

from tripod_doe.errors import InputError
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.forces.inertia import add_mass_blocks
from tripod_doe.mechanics.integrators.monitor import Settings
from tripod_doe.mechanics.scenes.needle_between_plates import build, closed_form, simulator, transition_velocity
from tripod_doe.mechanics.solve.equations_of_motion import linearise
from tripod_doe.model_interface import Outcome


def _points(count=1, **values):
    full = simulator.effective({name: value for name, value in values.items() if not isinstance(value, list)})
    points = {name: np.array([value] * count, object) for name, value in full.items()}
    return points | {name: np.array(value, object) for name, value in values.items() if isinstance(value, list)}


def _simulate(keep=("axial_drift_mm", "travel_mm"), count=1, **values):
    return simulator.simulate(_points(count, **values), keep)


def _numbers(**values):
    return {k: float(v) for k, v in simulator.effective(values).items() if isinstance(v, int | float)}


def test_closed_form_is_the_published_one():
    slip, drift = closed_form(_numbers())
    assert slip == pytest.approx(0.35105, rel=2e-5)  # FACTS: printed digits
    assert drift == pytest.approx(0.139307270, rel=1e-8)


@pytest.mark.parametrize(
    ("method", "numerics"),
    [
        ("implicit-euler", {"step_s": 1e-4}),
        ("bdf2", {"step_s": 1e-4}),
        ("rosenbrock", {}),
        ("linearly-implicit-euler", {"step_s": 1e-6}),
        ("generalized-alpha", {"step_s": 1e-5}),
    ],
)
def test_steady_drift_is_the_closed_form(method, numerics):
    """Measured 1.3e-7: second order in the tilt that the couple of the two frictions gives the needle."""
    path = _simulate(["axial_path_mm"], method=method, duration_s=0.02, **numerics).outputs["axial_path_mm"].data[0]
    steady = (path[-1] - path[50]) / (0.5 * 0.02)
    assert steady == pytest.approx(0.139307270 / 0.1, rel=2e-6)


def test_drift_from_the_start_contains_a_transient():
    """The friction couple tilts the needle at once and moves its centre by 1.5e-6 mm (FACTS)."""
    result = _simulate(method="bdf2")
    assert result.outcome[0] == Outcome.FINISHED
    assert result.outputs["axial_drift_mm"].data[0] - 0.139307270 == pytest.approx(-1.5e-6, abs=1e-7)


@pytest.mark.parametrize(("friction_b", "sign"), [(0.03, 0), (0.02, 1), (0.04, -1)])
def test_three_loci(friction_b, sign):
    """Fig. 8(b): straight along V for equal friction, towards the rolling direction of the plate with more."""
    result = _simulate(friction_b=friction_b, duration_s=0.02)
    drift = result.outputs["axial_drift_mm"].data[0]
    if sign == 0:
        # equal coefficients hold the needle only by the tails of tanh: 1e-3 of half the slip path, 35 um
        assert abs(drift) < 1e-3 * 0.0349
    else:
        assert math.copysign(1, drift) == sign
        assert drift == pytest.approx(closed_form(_numbers(friction_b=friction_b, duration_s=0.02))[1], rel=2e-4)


def test_a_reversing_plate_takes_the_needle_to_and_fro():
    """Quasi-steady limit: the closed form at every speed V cos(2 pi f t), integrated over one revolution of the crank.

    Measured 4e-4 of the path: the needle lags while its slip passes through zero.
    """
    given = {"reversing_frequency_hz": 100.0, "duration_s": 0.01}
    result = _simulate(["axial_path_mm", "travel_mm"], method="rosenbrock", **given)
    assert result.outcome[0] == Outcome.FINISHED, result.detail
    path = result.outputs["axial_path_mm"].data[0]
    values, times = _numbers(**given), np.linspace(0.0, 0.01, 2001)
    v_st = transition_velocity(values)
    speeds = 100.0 * np.cos(2 * math.pi * 100.0 * times)
    rates = [
        closed_form({**values, "plate_speed_mm_s": v, "transition_ratio": _ratio(v, v_st), "duration_s": 1.0})[1]
        for v in speeds
    ]
    expected = np.concatenate([[0.0], np.cumsum(0.5 * np.add(rates[1:], rates[:-1]) * np.diff(times))])[::20]
    assert np.abs(path - expected).max() < 1e-3 * np.ptp(expected)
    assert abs(result.outputs["travel_mm"].data[0]) < 1e-3 * 100.0 / (2 * math.pi * 100.0)


def _ratio(speed, v_st):
    """The transition ratio with which another speed of the plate has the same transition velocity."""
    return v_st / max(abs(speed) / 2 * math.sin(math.radians(2.0)), 1e-12)


def test_mirror_image():
    """Invariance: the opposite skew drifts to the other side by as much."""
    left, right = (_simulate(skew_deg=skew, duration_s=0.01).outputs["axial_drift_mm"].data[0] for skew in (3.0, -3.0))
    assert left == pytest.approx(-right, rel=1e-9)


@pytest.mark.parametrize("step", [2e-7, 1e-6])
@pytest.mark.parametrize("method", ["symplectic-euler", "rk4"])
def test_explicit_runs_beyond_the_friction_limit_are_not_called_finished(method, step):
    result = _simulate(method=method, step_s=step, duration_s=2e-3)
    assert result.outcome[0] in (Outcome.INACCURATE, Outcome.DIVERGED)
    assert np.isnan(result.outputs["axial_drift_mm"].data[0])
    assert "t = " in result.detail[0]


def test_explicit_run_within_its_limit_is_right():
    """2 m_eff v_st / (mu f_n) is 7e-9 s here: rolling has a third of the mass, both plates hold it."""
    values = {"duration_s": 1e-3, "step_s": 2e-9}
    result = _simulate(method="symplectic-euler", **values)
    assert result.outcome[0] == Outcome.FINISHED, result.detail
    assert result.outputs["axial_drift_mm"].data[0] == pytest.approx(closed_form(_numbers(**values))[1], rel=2e-3)


@pytest.mark.parametrize(("method", "reach"), [("symplectic-euler", 2.0), ("rk4", 2.785)])
def test_explicit_limit_is_that_of_the_friction_slope(method, reach):
    """h < reach / lambda with lambda the largest eigenvalue of M^-1 (-dQ/dv), far below 2 / omega of the contact."""
    values = _numbers(duration_s=1e-4)
    settled = simulator.run(values, "bdf2", 1e-6, Settings())
    assembly = assemble(build(values))
    work = assembly.work()
    state = (settled.positions[-1], settled.velocities[-1])
    linearise(assembly.tables, work, *state, 0.0, 1.0, 0.0, work.dissipation)
    linearise(assembly.tables, work, *state, 0.0, 0.0, 1.0, work.stiffness)
    needle = assembly.tables.pattern.own[assembly.tables.bodies["block"][1]]
    mass = np.zeros_like(work.matrix)
    add_mass_blocks(assembly.tables, settled.positions[-1], mass)
    friction, contact = (
        np.linalg.eigvals(np.linalg.solve(mass[needle, :, :6], blocks[needle, :, :6])).real.max()
        for blocks in (work.dissipation, work.stiffness)
    )
    limit = reach / friction
    assert limit < 0.05 * 2 / math.sqrt(contact)
    below, above = (_simulate(method=method, step_s=limit * share, duration_s=1e-4) for share in (0.9, 1.2))
    assert below.outcome[0] == Outcome.FINISHED, below.detail
    assert above.outcome[0] in (Outcome.INACCURATE, Outcome.DIVERGED)


def test_numerics_that_a_method_does_not_use():
    with pytest.raises(InputError, match="step_s = 1e-05: not used by rosenbrock"):
        simulator.check({"method": "rosenbrock", "step_s": 1e-5}, {}, [])
    points = _points(
        2, duration_s=1e-3, method=["rosenbrock", "bdf2"], step_s=[1e-5, 1e-5], relative_tolerance=[None, None]
    )
    result = simulator.simulate(points, ["axial_drift_mm"])
    assert list(result.outcome) == [Outcome.NOT_APPLICABLE, Outcome.FINISHED]


def test_values_do_not_depend_on_the_block():
    skews = [1.0, 2.0, 3.0]
    together = _simulate(count=3, skew_deg=skews, duration_s=1e-3).outputs["axial_drift_mm"].data
    alone = [_simulate(skew_deg=skew, duration_s=1e-3).outputs["axial_drift_mm"].data[0] for skew in skews]
    assert list(together) == alone


def test_an_error_of_one_point_stays_its_own(monkeypatch):
    right = type(simulator).run

    def run(self, values, *rest):
        if values["skew_deg"] == 2.0:
            raise ZeroDivisionError("no such needle")
        return right(self, values, *rest)

    monkeypatch.setattr(type(simulator), "run", run)
    result = _simulate(count=3, skew_deg=[1.0, 2.0, 3.0], duration_s=1e-3)
    assert list(result.outcome) == [Outcome.FINISHED, Outcome.ERROR, Outcome.FINISHED]
    assert result.detail[1] == "ZeroDivisionError: no such needle"
    assert list(np.isnan(result.outputs["axial_drift_mm"].data)) == [False, True, False]


def test_evaluation_budget():
    result = _simulate(method="bdf2", evaluation_budget=50)
    assert result.outcome[0] == Outcome.EVALUATION_LIMIT
    assert "force evaluations at t = " in result.detail[0]
    assert 0 < result.simulated_seconds[0] < 0.1


def test_a_finished_run_followed_its_whole_duration():
    assert _simulate(duration_s=0.003).simulated_seconds[0] == pytest.approx(0.003, rel=1e-12)
