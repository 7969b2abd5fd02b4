"""Third order of the thrust of a vibrating joint, from a part of a revolution in steps that resolve the vibration.

Whichever departure grows first, the vibration of full size is mostly one: the output shaft oscillates against the
grooves at 800 to 1,400 Hz, and all three normal forces swing together up to 2.5 to 4 times their mean, at all angles of
a revolution (measured at seven joints; at five of them contacts open). So the joint with lumped bearings starts
with such a swing, and is followed through a third of a revolution, in which the vibration takes its size, and half a
revolution, over which the thrust is averaged: after half a revolution it repeats with the opposite sign, but for skews.

At low speed, a few periods are followed in each part of these angles. Each part starts with the departure from the
smooth motion in which the part before ended: the size of a vibration hardly changes with the angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.revolutions import RevolvingJoint
from tripod_doe.joint.multibody.run_result import StoppedError, Wanted
from tripod_doe.joint.multibody.scene_constants import derive_constants
from tripod_doe.joint.multibody.thrust_and_power import groove_thrust
from tripod_doe.joint.values import JointValues
from tripod_doe.joint.vibration.vibrating_run import compile_undamped, undamped
from tripod_doe.mechanics.assembly import Assembly, State, assemble
from tripod_doe.mechanics.run import Limits, Run

_PARTS, _BUILDS_UP, _AVERAGED = 24, 8, 12
"""Parts of a revolution; parts in which the vibration builds up; parts over which the thrust is averaged."""

_LEAST, _IN_A_PART = 10, 4
"""Least number of periods of the vibration in which it builds up, and over which the thrust is averaged; and the same
in a part. Third orders from a sixth of a revolution, 3 to 10 periods, scatter by 8 %."""

_LIMITS = Limits(energy=math.inf, reversals=1.0, drift=1e-2, windows=0)
_Z = np.array([0.0, 0.0, 1.0])


def third_with_vibration(values: JointValues[float], smooth: Sequence[State]) -> float:
    """Third order of the thrust with the vibration, in N; NaN if the motion stops on its way.

    Within 10 % of `rollers` at 31 of 34 joints. Without the swing at the start, a vibration that takes more than a
    revolution to grow tenfold stays small; with it, a joint with two vibrations shows the larger one.

    Args:
        smooth: States of the smooth motion at both ends of equal parts of a revolution, some in each of `_PARTS`
            (`Vibration.revolution`).
    """
    assembly = assemble(build_joint(values, needles=False))
    method, tolerance = undamped(needles=False, frequency=math.inf)
    compile_undamped(assembly, method)
    joint = RevolvingJoint(assembly, values, method, Wanted(samples=1), _LIMITS, int(values.evaluation_budget))
    revolution, (twist, period) = 2 * math.pi / values.speed, _torsion(assembly, values)
    joint.state = _kicked(assembly, smooth[0].time, twist, period)
    between, in_a_part = revolution / (len(smooth) - 1), (len(smooth) - 1) // _PARTS
    few = math.ceil(_IN_A_PART * period / between)
    try:
        if few < in_a_part:
            order = _part_by_part(joint, smooth, tolerance, few, in_a_part)
        else:
            joint.advance(tolerance, max(_BUILDS_UP / _PARTS * revolution, _LEAST * period))
            averaged = _AVERAGED / _PARTS * revolution
            order = _third(joint.advance(tolerance, math.ceil(_LEAST * period / averaged) * averaged), values)
    except StoppedError:
        return math.nan
    return abs(order)


def _part_by_part(
    joint: RevolvingJoint, smooth: Sequence[State], tolerance: float, few: int, in_a_part: int
) -> complex:
    """Complex third order from the first `few` of the `in_a_part` stretches between smooth states in each part."""
    runs = list[Run]()
    for begin in range(0, (_BUILDS_UP + _AVERAGED) * in_a_part, in_a_part):
        if runs:
            ended = State(float(runs[-1].times[-1]), runs[-1].positions[-1], runs[-1].velocities[-1])
            joint.state = departed(joint.assembly, ended, smooth[begin - in_a_part + few], smooth[begin])
        runs.append(joint.advance(tolerance, smooth[begin + few].time - smooth[begin].time))
    return complex(np.mean([_third(run, joint.values) for run in runs[_BUILDS_UP:]]))


def _third(run: Run, values: JointValues[float]) -> complex:
    """Complex third order of the thrust over a run, from all its steps."""
    thrust = groove_thrust(run.assembly, run.positions, run.velocities).sum(0)
    angle = values.speed * run.times
    return complex(2 * np.trapezoid(thrust * np.exp(-3j * angle), angle) / (angle[-1] - angle[0]))


def _torsion(assembly: Assembly, values: JointValues[float]) -> tuple[float, float]:
    """Twist of the output shaft against the grooves under the torque, and period of its oscillation at that stiffness.

    Returns:
        In rad and s.
    """
    in_groove = (values.groove_load / values.groove_stiffness) ** (2 / 3)
    twist = (in_groove + 2 * derive_constants(values).needle_load) / values.pitch_radius
    bodies = {body.name: body for body in assembly.scene.bodies}
    inertia = bodies["output"].inertia[2] + bodies["shaft"].inertia[2]
    inertia += 3 * bodies["roller 1"].mass * values.pitch_radius**2
    return twist, 2 * math.pi * math.sqrt(inertia * twist / abs(values.torque))


def _kicked(assembly: Assembly, time: float, twist: float, period: float) -> State:
    """The start of the scene, with its shafts turning so fast that they swing back until the contacts just open."""
    state = replace(assembly.initial_state(), time=time)
    shafts = [assembly.names.index(name) for name in ("shaft", "output")]
    state.velocities[shafts, 5] += 2 * math.pi * twist / period
    return state


def departed(assembly: Assembly, state: State, smooth: State, other: State) -> State:
    """A state that departs from a smooth one as a given state departs from another.

    Rollers may turn on their trunnions by any angle; only their axes depart.
    """
    new = other.copy()
    for body in np.flatnonzero(assembly.tables.bodies["free"].any(axis=1)):
        new.positions[body, :3] += state.positions[body, :3] - smooth.positions[body, :3]
        new.velocities[body] += state.velocities[body] - smooth.velocities[body]
        at, there, then = (
            Rotation.from_quat(each.positions[body, 3:], scalar_first=True) for each in (state, smooth, other)
        )
        turn = at * there.inv()
        if assembly.names[body].startswith("roller"):
            turn = Rotation.from_rotvec(np.cross(there.apply(_Z), at.apply(_Z)))
        new.positions[body, 3:] = (turn * then).as_quat(scalar_first=True)
    return new
