"""A scene: the frozen description of bodies, elements and constraints. It holds no state and computes nothing.

Any consistent system of units works; the package uses mm, N, s, t and rad. Vectors are triples of floats. "World axes"
are those of the ground, which is body 0 of every assembly and called ``"ground"``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = [
    "GROUND", "Body", "Constraint", "Cylinder", "Distance", "Fixed", "Friction", "NeedleBearing", "Plane",
    "PointInPlane", "PrescribedRotation", "Revolute", "Scene", "SphereRow", "Spherical", "Spring", "Universal",
]  # fmt: skip

Vector = tuple[float, float, float]

GROUND = "ground"
ORIGIN: Vector = (0.0, 0.0, 0.0)
X: Vector = (1.0, 0.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Attributes
    ----------
    name
        Unique in its scene.
    mass, inertia
        Mass and principal moments of inertia about the centre of mass; the body axes are the principal ones.
    position, attitude
        Centre of mass and unit quaternion (scalar first, body to world axes) at the start.
    velocity, angular_velocity
        In world axes at the start.
    force, moment
        Constant load at the centre of mass, in world axes.
    own_moment
        Constant moment in body axes: a torque that turns with the body's axis.
    locked
        Velocity components (three of translation, three of rotation, world axes) that keep their starting value. A
        locked rotation needs all three locked, or the locked axes to be principal ones (checked at the start).
    """

    name: str
    mass: float
    inertia: Vector
    position: Vector = ORIGIN
    attitude: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    velocity: Vector = ORIGIN
    angular_velocity: Vector = ORIGIN
    force: Vector = ORIGIN
    moment: Vector = ORIGIN
    own_moment: Vector = ORIGIN
    locked: tuple[bool, bool, bool, bool, bool, bool] = (False,) * 6


@dataclass(frozen=True)
class Friction:
    """Coefficients and transition velocities of a contact: Eq. 3 (sliding), Eq. 4 (rolling), Eq. 6-7 (spinning).

    Attributes
    ----------
    sliding, sliding_transition
        Friction coefficient and transition velocity v_st.
    rolling, lever, rolling_transition
        Rolling friction coefficient, lever D/2, and transition angular velocity.
    spinning, spinning_transition
        Factor k of M_s = k f_n^(4/3), and transition angular velocity.
    """

    sliding: float = 0.0
    sliding_transition: float = 1.0
    rolling: float = 0.0
    lever: float = 0.0
    rolling_transition: float = 1.0
    spinning: float = 0.0
    spinning_transition: float = 1.0


@dataclass(frozen=True)
class Plane:
    """A half space of a body: a point of its face and the outward unit normal, in body axes."""

    body: str
    point: Vector = ORIGIN
    normal: Vector = Z


@dataclass(frozen=True)
class Cylinder:
    """A circular cylinder of a body: point on its axis, unit axis (body axes) and radius; `concave` for a bore."""

    body: str
    radius: float
    point: Vector = ORIGIN
    axis: Vector = X
    concave: bool = False


@dataclass(frozen=True)
class SphereRow:
    """Contact between a row of spheres on one body and a surface of another; one sphere is a row of one.

    Needle rollers are rows (paper 2.3.2); the side contact of neighbouring needles is the row of one against the
    convex cylinder of the other; an end stop is a row of one with radius 0 at the needle's end against a plane.

    Attributes
    ----------
    body
        The body that carries the spheres.
    surface
        What they touch.
    radius
        Radius of the spheres.
    stiffness, exponent
        C of each sphere and m of Eq. 2.
    centre, axis
        Middle of the row and unit vector along it, in body axes.
    count, length
        Number of spheres N_s and length l of the row; sphere k sits at l ((k + 1/2) / N_s - 1/2).
    crown
        Drop of the profile at the ends of the row: the radius falls by crown (2 x / l)^2.
    damping
        Factor of Hunt and Crossley on the penetration rate.
    friction
        Coefficients of sliding, rolling and spinning.
    """

    body: str
    surface: Plane | Cylinder
    radius: float
    stiffness: float
    exponent: float = 1.5
    centre: Vector = ORIGIN
    axis: Vector = X
    count: int = 1
    length: float = 0.0
    crown: float = 0.0
    damping: float = 0.0
    friction: Friction = field(default_factory=Friction)


@dataclass(frozen=True)
class NeedleBearing:
    """A full complement of needle rollers between a trunnion and the bore of a roller, as one element without bodies.

    The needles are smeared over the circumference. They stay with the trunnion along its axis, centred on the
    trunnion's point; the bore slides over them and must be long enough. What is left over between the bore, the
    trunnion and the needles' diameter is the radial clearance, negative for preload.

    Attributes
    ----------
    trunnion, bore
        The two raceways: a convex and a concave cylinder of two bodies. The trunnion's point is the middle of the
        needles, the bore's lies anywhere on its axis.
    diameter, length, count
        Of the needles, and their number.
    stiffness, exponent
        C of one slice of a needle against one raceway, and m of Eq. 2.
    slices
        Number N_s of slices of a needle; they sit where the spheres of a `SphereRow` do.
    crown
        Drop of the needle's profile at its ends, as in `SphereRow`.
    damping
        Factor of Hunt and Crossley on the rate of each contact's compression.
    skew
        Angle of the needles to the trunnion's axis, positive counterclockwise about the outward normal of the trunnion.
    friction
        Sliding along the needles and rolling across them, at each of their two contacts. `rolling_transition` is the
        roller's spin on its trunnion, with which both contacts reach theirs (s r_b and s r_t over the diameter). The
        lever is half the diameter; lever and spinning stay zero.
    """

    trunnion: Cylinder
    bore: Cylinder
    diameter: float
    length: float
    count: int
    stiffness: float
    exponent: float = 10 / 9
    slices: int = 7
    crown: float = 0.0
    damping: float = 0.0
    skew: float = 0.0
    friction: Friction = field(default_factory=Friction)


@dataclass(frozen=True)
class Spring:
    """A spring with a parallel damper between a point of each of two bodies (body axes)."""

    body_a: str
    body_b: str
    stiffness: float
    free_length: float
    point_a: Vector = ORIGIN
    point_b: Vector = ORIGIN
    damping: float = 0.0


@dataclass(frozen=True)
class Spherical:
    """Two points coincide: three equations."""

    body_a: str
    body_b: str
    point_a: Vector = ORIGIN
    point_b: Vector = ORIGIN


@dataclass(frozen=True)
class Revolute:
    """Two points coincide and two axes (body axes) stay parallel: five equations."""

    body_a: str
    body_b: str
    point_a: Vector = ORIGIN
    point_b: Vector = ORIGIN
    axis_a: Vector = Z
    axis_b: Vector = Z


@dataclass(frozen=True)
class Universal:
    """Two points coincide and two axes (body axes) stay perpendicular: four equations."""

    body_a: str
    body_b: str
    point_a: Vector = ORIGIN
    point_b: Vector = ORIGIN
    axis_a: Vector = X
    axis_b: Vector = Z


@dataclass(frozen=True)
class Fixed:
    """Two bodies keep their relative place and attitude, that of their start: six equations."""

    body_a: str
    body_b: str


@dataclass(frozen=True)
class Distance:
    """Two points keep a distance: one equation."""

    body_a: str
    body_b: str
    length: float
    point_a: Vector = ORIGIN
    point_b: Vector = ORIGIN


@dataclass(frozen=True)
class PointInPlane:
    """A point of body b stays in a plane of body a, given by a point and its normal (body axes): one equation."""

    body_a: str
    body_b: str
    point_a: Vector = ORIGIN
    point_b: Vector = ORIGIN
    normal_a: Vector = Z


@dataclass(frozen=True)
class PrescribedRotation:
    """Body b turns against body a about a common axis by angle + rate t + acceleration t^2 / 2: one equation.

    The angle is that of `reference_b` against `reference_a`, both across the axis, in body axes; a revolute joint or
    its equal must keep the axes together.
    """

    body_a: str
    body_b: str
    axis_a: Vector = Z
    reference_a: Vector = X
    reference_b: Vector = X
    angle: float = 0.0
    rate: float = 0.0
    acceleration: float = 0.0


Constraint = Spherical | Revolute | Universal | Fixed | Distance | PointInPlane | PrescribedRotation


@dataclass(frozen=True)
class Scene:
    """Bodies, elements and constraints of one model.

    Attributes
    ----------
    bodies, contacts, springs, constraints, bearings
        The parts; a body is known by its name.
    gravity
        Acceleration of free fall, in world axes.
    frame
        Constant angular velocity of the world axes and the ground about their origin: a scene that turns as a whole is
        slow, and its positions almost constant, when it is described in axes that turn with it.
    core
        Bodies that many others touch: they are eliminated last, as all that take part in constraints are.
    length_scale, speed_scale, rotation_scale
        Displacement, speed and angular velocity that matter in this scene: tolerances and bounds are relative to them.
    time_scale
        Time in which the motion of the scene changes by itself: the pace of `adaptive-euler`.
    """

    bodies: tuple[Body, ...]
    contacts: tuple[SphereRow, ...] = ()
    springs: tuple[Spring, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    gravity: Vector = ORIGIN
    frame: Vector = ORIGIN
    length_scale: float = 1.0
    speed_scale: float = 1.0
    rotation_scale: float = 1.0
    time_scale: float = 1.0
    core: tuple[str, ...] = ()
    bearings: tuple[NeedleBearing, ...] = ()
