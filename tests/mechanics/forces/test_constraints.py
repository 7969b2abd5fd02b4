"""Constraint equations against differences along a motion, and redundancy (exact physics)."""

import numpy as np
import pytest

from tripod_doe.errors import InputError
from tripod_doe.mechanics.arithmetic.rotations import move
from tripod_doe.mechanics.assembly import assemble
from tripod_doe.mechanics.forces.constraints import evaluate_constraints
from tripod_doe.mechanics.forces.inertia import add_mass_blocks
from tripod_doe.mechanics.scene import (
    GROUND,
    Body,
    Distance,
    Fixed,
    Friction,
    Plane,
    PointInPlane,
    PrescribedRotation,
    Revolute,
    Scene,
    SphereRow,
    Spherical,
    Universal,
)
from tripod_doe.mechanics.solve.equations_of_motion import constraint_rate, evaluate, linearise
from tripod_doe.mechanics.solve.newton import factorise_system, solve_system

POINTS = {"point_a": (0.3, -0.2, 0.5), "point_b": (-0.4, 0.1, 0.2)}
JOINTS = {
    "fixed": (Fixed("a", "b"), 6),
    "spherical": (Spherical("a", "b", **POINTS), 3),
    "revolute": (Revolute("a", "b", axis_a=(1.0, 2.0, 0.5), axis_b=(0.3, 1.0, 0.0), **POINTS), 5),
    "universal": (Universal("a", "b", axis_a=(1.0, 2.0, 0.5), axis_b=(0.3, 1.0, 0.0), **POINTS), 4),
    "distance": (Distance("a", "b", 1.7, **POINTS), 1),
    "point in plane": (PointInPlane("a", "b", normal_a=(0.2, 1.0, 0.4), **POINTS), 1),
    "prescribed rotation": (PrescribedRotation("a", "b", angle=0.4, rate=1.3, acceleration=0.7), 1),
}


def _assembly(joint):
    a = Body(
        "a",
        2.0,
        (1.0, 2.0, 3.0),
        position=(0.1, 0.2, 0.3),
        attitude=(0.9, 0.1, -0.3, 0.2),
        velocity=(0.4, -0.3, 0.2),
        angular_velocity=(1.0, -0.5, 0.3),
    )
    b = Body(
        "b",
        1.0,
        (0.4, 0.6, 0.8),
        position=(1.1, -0.2, 0.6),
        attitude=(0.8, 0.3, 0.2, -0.1),
        velocity=(-0.2, 0.5, 0.7),
        angular_velocity=(-0.4, 0.8, 1.2),
    )
    return assemble(Scene((a, b), constraints=(joint,)))


def _evaluate(assembly, positions, velocities, time):
    work = assembly.work()
    evaluate_constraints(
        assembly.tables.rows, positions, velocities, time, work.phi, work.phi_t, work.gamma, work.jacobian
    )
    rates = [
        constraint_rate(row, jacobian, velocities) + by_time
        for row, jacobian, by_time in zip(assembly.tables.rows, work.jacobian, work.phi_t, strict=True)
    ]
    return work.phi.copy(), np.array(rates), work.gamma.copy()


@pytest.mark.parametrize("name", JOINTS)
def test_rate_and_gamma_are_derivatives_along_a_motion(name):
    joint, equations = JOINTS[name]
    assembly = _assembly(joint)
    state = assembly.initial_state()
    time, h = 0.6, 1e-5
    phi, rate, gamma = _evaluate(assembly, state.positions, state.velocities, time)
    assert phi.size == equations

    def at(step):
        """Constraints after motion with constant velocity and angular velocity: q'' = 0, so Phi'' = -gamma."""
        moved = state.positions.copy()
        for body in range(3):
            move(moved[body], step * state.velocities[body], moved[body])
        return _evaluate(assembly, moved, state.velocities, time + step)

    ahead, behind = at(h), at(-h)
    np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * h), rate, atol=1e-8)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * h), -gamma, atol=1e-7)


def test_fixed_bodies_start_without_residual():
    state = _assembly(JOINTS["fixed"][0]).initial_state()
    phi, _, _ = _evaluate(_assembly(JOINTS["fixed"][0]), state.positions, state.velocities, 0.0)
    np.testing.assert_allclose(phi, 0, atol=1e-14)


def test_redundant_joints_leave_accelerations_unchanged():
    """A door on one hinge and on three: ten equations more, the same motion, and the multipliers stay finite."""
    door = Body(
        "door",
        3.0,
        (1.0, 2.0, 1.5),
        position=(0.5, 0.0, 0.0),
        angular_velocity=(0, 0, 2.0),
        velocity=(0.0, 1.0, 0.0),
        force=(0.3, 1.0, -9.0),
    )

    def hinge(height):
        return Revolute(GROUND, "door", point_a=(0, 0, height), point_b=(-0.5, 0, height))

    results = []
    for hinges in ((0.0,), (0.0, 1.0, -1.0)):
        assembly = assemble(Scene((door,), constraints=tuple(hinge(height) for height in hinges)))
        state, work = assembly.initial_state(), assembly.work()
        evaluate(assembly.tables, work, state.positions, state.velocities, 0.0, 0.0)
        assert work.pivots[-1] == 5
        assert np.all(np.isfinite(work.multipliers))
        results.append(work.acceleration.copy())
    np.testing.assert_allclose(results[1], results[0], atol=1e-13)
    # turning about the hinge: moment 0.5 * 1 over Izz + m r^2 = 1.5 + 0.75
    assert results[0][1, 5] == pytest.approx(0.5 / 2.25, rel=1e-12)
    assert results[0][1, 0] == pytest.approx(-(2.0**2) * 0.5, rel=1e-12)


def test_multipliers_of_the_tail_solve_the_dense_saddle_system():
    """Needles on a jointed pair: matrix and constraints together against one dense solve."""
    needles = [
        Body(
            f"needle {i}",
            0.1,
            (0.1, 0.2, 0.3),
            position=(0.3 * i, 0.0, 0.99),
            angular_velocity=(0.1, 0.2, 0.3),
            locked=(False, i == 1, False, False, False, False),
        )
        for i in range(3)
    ]
    pair = [
        Body("a", 2.0, (1.0, 2.0, 3.0), attitude=(0.9, 0.1, -0.3, 0.2)),
        Body("b", 1.0, (0.4, 0.6, 0.8), position=(0.4, 0.0, 0.0), locked=(False, False, True, False, False, False)),
    ]
    friction = Friction(0.1, 1.0, 0.01, 1.0, 1.0, 0.01, 1.0)
    contacts = [
        SphereRow(f"needle {i}", Plane(body), 1.0, 1e3, 1.5, count=3, length=0.5, friction=friction)
        for i in range(3)
        for body in ("a", "b")
    ]
    contacts += [SphereRow("needle 0", Plane("needle 1"), 1.0, 1e3, friction=friction)]
    joints = (Spherical(GROUND, "a"), Universal("a", "b", axis_a=(1.0, 2.0, 0.5), axis_b=(0.3, 1.0, 0.0), **POINTS))
    assembly = assemble(Scene((*needles, *pair), contacts=tuple(contacts), constraints=joints))
    tables, state, work = assembly.tables, assembly.initial_state(), assembly.work()
    pattern, rows = tables.pattern, tables.rows
    assert pattern.tail == 3
    linearise(tables, work, state.positions, state.velocities, 1.0, 1e-2, 1e-4, work.matrix)
    blocks = work.matrix.copy()
    add_mass_blocks(tables, state.positions, blocks)
    dense = np.zeros((5, 6, 5, 6))
    for block, i, j in zip(blocks, pattern.row, pattern.column, strict=True):
        dense[i, :, j] = block[:, :6]
    dense = dense.reshape(30, 30)
    evaluate_constraints(rows, state.positions, state.velocities, 0.0, work.phi, work.phi_t, work.gamma, work.jacobian)
    jacobian = np.zeros((rows.size, 6, 6))
    for k, row in enumerate(rows):
        jacobian[k, row["body_a"]] += work.jacobian[k, :6]
        jacobian[k, row["body_b"]] += work.jacobian[k, 6:]
    jacobian = jacobian[:, 1:].reshape(rows.size, 30)
    rng = np.random.default_rng(5)
    right, wanted = rng.normal(size=30), rng.normal(size=rows.size)
    locked = np.array([body.locked for body in (*needles, *pair)]).ravel()
    dense[locked], right[locked] = np.eye(30)[locked], 0.0
    free = np.where(locked, 0.0, jacobian)  # reactions do not move what is locked
    saddle = np.block([[dense, free.T], [jacobian, np.zeros((rows.size, rows.size))]])
    solution = np.linalg.solve(saddle, np.concatenate([right, wanted]))
    assert factorise_system(tables, work, state.positions)
    work.blocks[:, :6] = right.reshape(5, 6)
    out = np.zeros((6, 6))
    solve_system(tables, work, wanted, out)
    np.testing.assert_allclose(out[1:].ravel(), solution[:30], rtol=1e-8, atol=1e-9 * np.abs(solution).max())
    np.testing.assert_allclose(work.multipliers, solution[30:], rtol=1e-8, atol=1e-9 * np.abs(solution).max())


def test_mistakes_are_named():
    with pytest.raises(InputError, match="no body is called 'dor'; did you mean 'door'"):
        assemble(Scene((Body("door", 1.0, (1, 1, 1)),), constraints=(Spherical(GROUND, "dor"),)))
    with pytest.raises(InputError, match="named twice: a"):
        assemble(Scene((Body("a", 1.0, (1, 1, 1)), Body("a", 1.0, (1, 1, 1)))))
    with pytest.raises(InputError, match="must be positive"):
        assemble(Scene((Body("a", 0.0, (1, 1, 1)),)))
    drive = PrescribedRotation(GROUND, "a", axis_a=(1.0, 0.0, 0.0), rate=1.0)
    with pytest.raises(InputError, match=r"reference_a .* is not across axis_a"):  # it would drive nothing
        assemble(Scene((Body("a", 1.0, (1, 1, 1)),), constraints=(drive,)))
    half = (True, False, False, True, False, True)
    assemble(Scene((Body("a", 1.0, (1, 2, 3), locked=half),)))
    with pytest.raises(InputError, match="principal axes"):
        assemble(Scene((Body("a", 1.0, (1, 2, 3), attitude=(0.9, 0.3, 0.2, 0.1), locked=half),)))
    slippery = SphereRow("a", Plane(GROUND), 1.0, 1e5, friction=Friction(-0.1))
    with pytest.raises(InputError, match="must not be negative"):
        assemble(Scene((Body("a", 1.0, (1, 1, 1)),), contacts=(slippery,)))
