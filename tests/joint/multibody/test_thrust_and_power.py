"""What is read off a state: skews that were put in come back, and every watt lost has a mechanism."""

from __future__ import annotations

import numpy as np
import pytest
from few import FEW
from scipy.spatial.transform import Rotation

from tripod_doe.joint.multibody.thrust_and_power import groove_readings, needle_skews
from tripod_doe.joint.parameters import MECHANISMS
from tripod_doe.mechanics.solve.equations_of_motion import generalized_forces

SKEWS = {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.3, "initial_skew_3_deg": 2.0}


def test_the_needle_that_carries_gives_the_skew(joint_assembly, joint_values):
    """Exact physics: at the start every needle has its trunnion's skew, so whichever carries most reads it."""
    assembly, values = joint_assembly(True, **FEW, **SKEWS), joint_values(**FEW, **SKEWS)
    positions = np.stack([assembly.initial_state().positions] * 4)
    skews, summary = needle_skews(assembly, positions, values, 2)
    expected = np.radians(list(SKEWS.values()))
    assert skews == pytest.approx(np.repeat(expected[:, None], 4, axis=1), abs=1e-12)
    assert summary == pytest.approx(np.broadcast_to(expected[:, None, None], (3, 2, 3)), abs=1e-12)


def test_another_needle_that_dips_deeper_is_read(joint_assembly, joint_values):
    """Exact physics: needle 4 of trunnion 1 is pressed into it and turned by 1 deg about the outward normal."""
    assembly, values = joint_assembly(True, **FEW, **SKEWS), joint_values(**FEW, **SKEWS)
    positions = assembly.initial_state().positions
    shaft = positions[assembly.names.index("shaft")]
    to_world = Rotation.from_quat(shaft[3:], scalar_first=True)
    axis = to_world.apply([1.0, 0.0, 0.0])
    spider = shaft[:3] - to_world.apply([0.0, 0.0, values.shaft_length / 2])
    needle = positions[assembly.names.index("needle 1.4")]
    normal = needle[:3] - spider - axis * ((needle[:3] - spider) @ axis)
    normal /= np.linalg.norm(normal)
    needle[:3] -= 0.05 * normal
    turned = Rotation.from_rotvec(np.radians(1.0) * normal) * Rotation.from_quat(needle[3:], scalar_first=True)
    needle[3:] = turned.as_quat(scalar_first=True)
    skews, _ = needle_skews(assembly, positions[None], values, 1)
    assert np.degrees(skews[:, 0]) == pytest.approx([1.4, -0.3, 2.0], abs=1e-9)


@pytest.mark.parametrize("needles", [False, True])
def test_friction_powers_are_those_of_the_ledger(joint_assembly, needles):
    """Exact physics: the five mechanisms together lose what the engine's energy ledger loses, in any state of motion."""
    assembly = joint_assembly(needles, **FEW, **SKEWS)
    state, work = assembly.initial_state(), assembly.work()
    state.velocities[1:] += np.random.default_rng(3).normal(0, 5, state.velocities[1:].shape)
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    _, powers = groove_readings(assembly, state.positions[None], state.velocities[None])
    assert powers.shape == (len(MECHANISMS), 1)
    assert (powers > 0).all()
    assert powers.sum() == pytest.approx(work.ledger[2:5].sum(), rel=1e-12)


@pytest.mark.parametrize("needles", [False, True])
def test_thrust_is_the_force_on_the_ground(joint_assembly, needles):
    """Exact physics: nothing but the grooves touches the housing."""
    assembly = joint_assembly(needles, **FEW)
    state, work = assembly.initial_state(), assembly.work()
    generalized_forces(assembly.tables, work, state.positions, state.velocities)
    thrust, _ = groove_readings(assembly, state.positions[None], state.velocities[None])
    assert thrust.sum() == pytest.approx(work.force[0, 2], rel=1e-12)
