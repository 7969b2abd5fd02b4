"""Assembly: a scene turned into tables, checked once, with the block graph and its order of elimination."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import roots_gegenbauer

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.mechanics import scene as parts
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH
from tripod_doe.mechanics.solve.elimination import elimination_pattern
from tripod_doe.mechanics.tables import (
    BODY,
    CONSTRAINT_ROW,
    CONTACT,
    DISTANCE,
    IN_PLANE,
    LEDGER,
    LOAD_ZONE_NODES,
    NEEDLE_BEARING,
    PERPENDICULAR,
    SPRING,
    Pattern,
    Tables,
    Work,
)

_AXES = np.eye(3)
_CACHE_LINE = 64
"""Bytes of a cache line."""


@dataclass
class State:
    """Positions and velocities of all bodies at one time: the only data that change."""

    time: float  # time
    positions: FloatArray  # centre of mass and quaternion, shape (body, 7); body 0 is the ground
    velocities: FloatArray  # velocity and angular velocity in world axes, shape (body, 6)

    def copy(self) -> State:
        """An independent copy."""
        return State(self.time, self.positions.copy(), self.velocities.copy())


@dataclass(frozen=True)
class Assembly:
    """A scene ready to run."""

    scene: parts.Scene  # its source
    names: tuple[str, ...]  # body names in the order of the tables; the ground is first
    tables: Tables  # input of the kernels

    def initial_state(self) -> State:
        """The state that the scene describes, at time 0."""
        positions, velocities = np.zeros((len(self.names), 7)), np.zeros((len(self.names), 6))
        positions[:, 3] = 1.0
        for i, body in enumerate(self.scene.bodies, start=1):
            positions[i] = *body.position, *_unit(body.attitude)
            velocities[i] = *body.velocity, *body.angular_velocity
        return State(0.0, positions, velocities)

    @cached_property
    def memory(self) -> Work:
        """Memory that all who read states share: making it costs as much as reading a revolution of some joints."""
        return self.work()

    def work(self, traced: int = 0) -> Work:
        """Memory for one run, with room for the states after a number of steps."""
        bodies, rows, zeros = len(self.names), self.tables.rows.size, _aligned_zeros
        groups = int(self.tables.contacts["groups"].sum())
        blocks = max(self.tables.pattern.row.size, 1)
        pivots = max(self.tables.pattern.order.size, 1)
        return Work(
            force=zeros((bodies, 6)),
            acceleration=zeros((bodies, 6)),
            ledger=zeros(len(LEDGER)),
            slip=zeros((groups, 3, WIDTH)),
            slip_before=zeros((groups, 3, WIDTH)),
            touching=zeros((self.tables.contacts.size, 2), np.int64),
            stiffness=zeros((blocks, 6, WIDTH)),
            dissipation=zeros((blocks, 6, WIDTH)),
            matrix=zeros((blocks, 6, WIDTH)),
            phi=zeros(rows),
            phi_t=zeros(rows),
            gamma=zeros(rows),
            jacobian=zeros((rows, 12)),
            weighted=zeros((rows, bodies, 6)),
            schur=zeros((rows, rows + 1)),
            multipliers=zeros(rows),
            pivots=zeros(2 * rows + 1, np.int64),
            blocks=zeros((pivots, WIDTH)),
            momenta=zeros((pivots, WIDTH)),
            displacement=zeros((bodies, WIDTH)),
            change=zeros((bodies, WIDTH)),
            nothing=zeros((0, WIDTH)),
            stages=zeros((17, bodies, WIDTH)),
            pair=zeros((2, 6, WIDTH)),
            counters=zeros(7, np.int64),
            balance=zeros(5),
            power_before=zeros(5),
            motion_before=zeros((bodies, 6)),
            paths=zeros((groups, 2, WIDTH)),
            extremes=zeros(1),
            failure=zeros(2),
            trace=zeros((traced, 1 + 13 * bodies)),
        )


def _aligned_zeros(shape: int | tuple[int, ...], dtype: type = np.float64) -> NDArray[Any]:
    """Zeros whose rows of lanes begin at a cache line: a row across two lines costs two reads."""
    size = (math.prod(shape) if isinstance(shape, tuple) else shape) * np.dtype(dtype).itemsize
    memory = np.zeros(size + _CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % _CACHE_LINE
    return memory[start : start + size].view(dtype).reshape(shape)


def _unit(values: Iterable[float]) -> FloatArray:
    vector: FloatArray = np.asarray(tuple(values), float)
    unit: FloatArray = vector / math.sqrt(vector @ vector)
    return unit


def _checked_direction(where: str, values: Iterable[float]) -> FloatArray:
    vector = tuple(values)
    if not (all(map(math.isfinite, vector)) and any(vector)):
        raise InputError(f"{where}: {vector} has no direction")
    return _unit(vector)


def _rotation(quaternion: Iterable[float]) -> FloatArray:
    w, x, y, z = _unit(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _across(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that complete a direction to a right-handed frame."""
    first = _unit(_cross(direction, _AXES[np.argmin(np.abs(direction))]))
    return first, _cross(direction, first)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product of two vectors; numpy's takes ten times as long, since it first looks whether they are two."""
    (a_x, a_y, a_z), (b_x, b_y, b_z) = a.tolist(), b.tolist()
    return np.array([a_y * b_z - a_z * b_y, a_z * b_x - a_x * b_z, a_x * b_y - a_y * b_x])


def _index(names: dict[str, int], name: str, where: str) -> int:
    if name not in names:
        raise InputError(f"{where}: no body is called {name!r}{near_match(name, names)}")
    return names[name]


def _body_table(scene: parts.Scene) -> NDArray[np.void]:
    table = np.zeros(len(scene.bodies) + 1, BODY)
    table["mass"], table["inertia"], table["block"] = 1.0, 1.0, -1
    blocks = 0
    for row, body in zip(table[1:], scene.bodies, strict=True):
        if not (body.mass > 0 and min(body.inertia) > 0):
            raise InputError(f"body {body.name!r}: mass and moments of inertia must be positive")
        row["mass"], row["inertia"] = body.mass, body.inertia
        row["load"], row["own_moment"] = (*body.force, *body.moment), body.own_moment
        row["free"] = [0.0 if locked else 1.0 for locked in body.locked]
        _check_locked_rotation(body)
        if not all(body.locked) or any(body.velocity) or any(body.angular_velocity):  # its motion stays in the matrix
            row["block"], blocks = blocks, blocks + 1
    return table


def _check_locked_rotation(body: parts.Body) -> None:
    """Refuse locked and free rotations that the inertia couples: dividing by the inertia would need the free part."""
    turn, locked = _rotation(body.attitude), np.array(body.locked[3:], bool)
    coupling = (turn * np.array(body.inertia)) @ turn.T
    if np.abs(coupling[np.ix_(locked, ~locked)]).max(initial=0.0) > 1e-9 * max(body.inertia):
        raise InputError(f"body {body.name!r}: lock all three rotations, or about principal axes of inertia")


def _contact_table(scene: parts.Scene, names: dict[str, int]) -> NDArray[np.void]:
    table = np.zeros(len(scene.contacts), CONTACT)
    for number, (row, contact) in enumerate(zip(table, scene.contacts, strict=True)):
        where = f"contact {number} ({contact.body} on {contact.surface.body})"
        row["body_a"] = _index(names, contact.body, where)
        row["body_b"] = _index(names, contact.surface.body, where)
        if row["body_a"] == row["body_b"]:
            raise InputError(f"{where}: a body cannot touch itself")
        if contact.count < 1 or contact.stiffness < 0 or contact.exponent < 1:
            raise InputError(f"{where}: count and exponent must be at least 1, the stiffness not negative")
        friction = contact.friction
        damping = min(contact.damping, contact.damping_time)
        if min(contact.radius, damping, friction.sliding, friction.rolling, friction.spinning) < 0:
            raise InputError(f"{where}: radius, damping and friction coefficients must not be negative")
        if min(friction.sliding_transition, friction.rolling_transition, friction.spinning_transition) <= 0:
            raise InputError(f"{where}: transition velocities must be positive")
        surface = contact.surface
        if isinstance(surface, parts.Plane):
            row["direction"] = _checked_direction(where, surface.normal)
            row["across"] = _across(row["direction"])[0]
        else:
            row["direction"] = _checked_direction(where, surface.axis)
            row["sign"] = -1.0 if surface.concave else 1.0
            row["surface_radius"] = surface.radius
        row["count"], row["groups"], row["point"] = contact.count, -(-contact.count // WIDTH), surface.point
        row["centre"], row["axis"] = contact.centre, _checked_direction(where, contact.axis)
        for name in ("length", "radius", "crown", "stiffness", "exponent", "damping", "damping_time"):
            row[name] = getattr(contact, name)
        for name in ("sliding", "rolling", "spinning"):
            row[name] = getattr(friction, name)
            row[f"{name}_transition"] = getattr(friction, f"{name}_transition")
        row["lever"] = friction.lever
    table["first"] = np.cumsum(table["groups"]) - table["groups"]
    return table


def _spring_table(scene: parts.Scene, names: dict[str, int]) -> NDArray[np.void]:
    table = np.zeros(len(scene.springs), SPRING)
    for number, (row, spring) in enumerate(zip(table, scene.springs, strict=True)):
        row["body_a"] = _index(names, spring.body_a, f"spring {number}")
        row["body_b"] = _index(names, spring.body_b, f"spring {number}")
        for name in ("point_a", "point_b", "stiffness", "damping", "free_length"):
            row[name] = getattr(spring, name)
    return table


def _bearing_table(scene: parts.Scene, names: dict[str, int]) -> NDArray[np.void]:
    table = np.zeros(len(scene.bearings), NEEDLE_BEARING)
    for number, (row, bearing) in enumerate(zip(table, scene.bearings, strict=True)):
        trunnion, bore, friction = bearing.trunnion, bearing.bore, bearing.friction
        where = f"bearing {number} ({bore.body} on {trunnion.body})"
        row["body_a"], row["body_b"] = _index(names, trunnion.body, where), _index(names, bore.body, where)
        _check_bearing(where, bearing)
        axis = _checked_direction(where, trunnion.axis)
        row["axis_a"], row["across_a"], row["axis_b"] = axis, _across(axis)[0], _checked_direction(where, bore.axis)
        row["point_a"], row["point_b"] = trunnion.point, bore.point
        row["trunnion_radius"], row["bore_radius"] = trunnion.radius, bore.radius
        row["clearance"] = bore.radius - trunnion.radius - bearing.diameter
        for name in ("diameter", "length", "crown", "exponent", "damping", "damping_time", "slices"):
            row[name] = getattr(bearing, name)
        row["density"] = bearing.count * bearing.stiffness / (2 * np.pi)
        row["cosine"] = np.cos(bearing.skew)
        lever = 2 * bore.radius * trunnion.radius / (bore.radius + trunnion.radius)
        row["skew_lever"] = lever * np.sin(bearing.skew)
        for name in ("sliding", "sliding_transition", "rolling", "rolling_transition"):
            row[name] = getattr(friction, name)
        row["node"], row["weight"] = _load_zone_nodes(bearing.exponent)
    return table


@cache
def _load_zone_nodes(exponent: float) -> tuple[FloatArray, FloatArray]:
    """Squares of nodes, and weights, of sums over a load zone whose loads have such an exponent."""
    node, weight = roots_gegenbauer(2 * LOAD_ZONE_NODES, exponent + 0.5)
    return node[:LOAD_ZONE_NODES] ** 2, weight[:LOAD_ZONE_NODES]  # even sums: half of them


def _check_bearing(where: str, bearing: parts.NeedleBearing) -> None:
    trunnion, bore, friction = bearing.trunnion, bearing.bore, bearing.friction
    if trunnion.body == bore.body:
        raise InputError(f"{where}: trunnion and bore must belong to two bodies")
    if trunnion.concave or not bore.concave:
        raise InputError(f"{where}: the trunnion must be convex and the bore concave")
    if min(trunnion.radius, bearing.diameter, bearing.length) <= 0 or bore.radius <= trunnion.radius:
        raise InputError(f"{where}: radii, diameter and length must be positive, the bore wider than the trunnion")
    if min(bearing.count, bearing.slices) < 1 or bearing.stiffness < 0 or bearing.exponent < 1:
        raise InputError(f"{where}: count, slices and exponent must be at least 1, the stiffness not negative")
    if min(bearing.crown, bearing.damping, bearing.damping_time, friction.sliding, friction.rolling) < 0:
        raise InputError(f"{where}: crown, damping and friction coefficients must not be negative")
    if min(friction.sliding_transition, friction.rolling_transition) <= 0:
        raise InputError(f"{where}: transition velocities must be positive")
    if friction.spinning or friction.lever:
        raise InputError(f"{where}: needles do not spin, and their lever is half the diameter; leave out both")
    if not abs(bearing.skew) < np.pi / 2:
        raise InputError(f"{where}: the skew must be below a right angle")


def _constraint_rows(scene: parts.Scene, names: dict[str, int], state: State) -> NDArray[np.void]:
    """Every joint as rows of the three kinds of equation."""
    rows: list[NDArray[np.void]] = []
    for number, joint in enumerate(scene.constraints):
        where = f"constraint {number} ({type(joint).__name__})"
        a, b = _index(names, joint.body_a, where), _index(names, joint.body_b, where)
        if a == b:
            raise InputError(f"{where}: a body cannot be joined to itself")
        for kind, values in _equations(joint, where, state.positions[a], state.positions[b]):
            new = np.zeros((), CONSTRAINT_ROW)
            new["kind"], new["body_a"], new["body_b"] = kind, a, b
            for name, value in values.items():
                new[name] = value
            rows.append(new)
    return np.array(rows, CONSTRAINT_ROW) if rows else np.zeros(0, CONSTRAINT_ROW)


def _equations(
    joint: parts.Constraint, where: str, place_a: FloatArray, place_b: FloatArray
) -> Iterator[tuple[int, dict[str, object]]]:
    """The equations of a joint, their kinds and vectors, from the places of its bodies at the start."""
    match joint:
        case parts.Distance():
            if joint.length <= 0:
                raise InputError(f"{where}: the length must be positive")
            yield DISTANCE, {"point_a": joint.point_a, "point_b": joint.point_b, "length": joint.length}
        case parts.PointInPlane():
            normal = _checked_direction(where, joint.normal_a)
            yield IN_PLANE, {"point_a": joint.point_a, "point_b": joint.point_b, "direction_a": normal}
        case parts.PrescribedRotation():
            axis, ahead = _checked_direction(where, joint.axis_a), _checked_direction(where, joint.reference_a)
            if abs(axis @ ahead) > 1e-9:
                raise InputError(f"{where}: reference_a {joint.reference_a} is not across axis_a {joint.axis_a}")
            # across the reference: zero if b's reference is at the angle
            vectors = {"direction_a": _cross(axis, ahead), "turned_a": -ahead}
            reference = _checked_direction(where, joint.reference_b)
            motion = joint.angle, joint.rate, joint.acceleration
            yield PERPENDICULAR, {**vectors, "direction_b": reference, "motion": motion}
        case parts.Fixed():
            turn_a, turn_b = _rotation(place_a[3:]), _rotation(place_b[3:])
            yield from _coincide(turn_a.T @ (place_b[:3] - place_a[:3]), parts.ORIGIN)
            relative = turn_b.T @ turn_a
            for i, j in ((0, 1), (1, 2), (2, 0)):
                yield PERPENDICULAR, {"direction_a": _AXES[i], "direction_b": relative[:, j]}
        case _:
            yield from _coincide(joint.point_a, joint.point_b)
            if isinstance(joint, parts.Revolute):
                for across in _across(_checked_direction(where, joint.axis_a)):
                    yield PERPENDICULAR, {"direction_a": across, "direction_b": _checked_direction(where, joint.axis_b)}
            elif isinstance(joint, parts.Universal):
                axes = (_checked_direction(where, joint.axis_a), _checked_direction(where, joint.axis_b))
                yield PERPENDICULAR, {"direction_a": axes[0], "direction_b": axes[1]}


def _coincide(point_a: object, point_b: object) -> Iterator[tuple[int, dict[str, object]]]:
    """Three equations by which two points are one."""
    for axis in _AXES:
        yield IN_PLANE, {"point_a": point_a, "point_b": point_b, "direction_a": axis}


def _core(scene: parts.Scene, names: dict[str, int]) -> set[int]:
    """Bodies that are eliminated last: bodies named by the scene, and all bodies with constraints."""
    core = {_index(names, name, "core") for name in scene.core}
    for number, joint in enumerate(scene.constraints):
        where = f"constraint {number} ({type(joint).__name__})"
        core |= {_index(names, joint.body_a, where), _index(names, joint.body_b, where)}
    return core


def assemble(scene: parts.Scene) -> Assembly:
    """Check a scene and turn it into tables.

    Raises:
        InputError: If a body is missing, named twice, without mass or locked across its principal axes, or an element
            cannot be.
    """
    names = (parts.GROUND, *(body.name for body in scene.bodies))
    index = {name: i for i, name in enumerate(names)}
    if len(index) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise InputError(f"bodies named twice: {', '.join(twice)}")
    bodies = _body_table(scene)
    core = _core(scene, index)
    elements = _contact_table(scene, index), _spring_table(scene, index), _bearing_table(scene, index)
    pattern = elimination_pattern(bodies["block"], elements, core)
    tables = _tables(scene, bodies, elements, pattern)
    rows = _constraint_rows(scene, index, Assembly(scene, names, tables).initial_state())
    return Assembly(scene, names, replace(tables, rows=rows))


def _tables(
    scene: parts.Scene,
    bodies: NDArray[np.void],
    elements: tuple[NDArray[np.void], NDArray[np.void], NDArray[np.void]],
    pattern: Pattern,
) -> Tables:
    scales = np.array([scene.length_scale, scene.speed_scale, scene.rotation_scale, scene.time_scale])
    return Tables(
        bodies,
        *elements,
        np.zeros(0, CONSTRAINT_ROW),
        np.array(scene.gravity, float),
        np.array(scene.frame, float),
        scales,
        np.flatnonzero(bodies["block"] >= 0),
        pattern,
    )
