"""A scene: the frozen description of bodies, elements and constraints. It holds no state and computes nothing.

Any consistent system of units works; the package uses mm, N, s, t and rad. Vectors are triples of floats. "World axes"
are those of the ground, which is body 0 of every assembly and called ``"ground"``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

Vector = tuple[float, float, float]

GROUND = "ground"
ORIGIN: Vector = (0.0, 0.0, 0.0)
X: Vector = (1.0, 0.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Body:
    """A rigid body."""

    name: str  # unique in its scene
    # mass, inertia: mass and principal moments of inertia about the centre of mass; the body axes are the principal
    # ones
    mass: float
    inertia: Vector
    # position, attitude: centre of mass and unit quaternion (scalar first, body to world axes) at the start
    position: Vector = ORIGIN
    attitude: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    # velocity, angular_velocity: in world axes at the start
    velocity: Vector = ORIGIN
    angular_velocity: Vector = ORIGIN
    # force, moment: constant load at the centre of mass, in world axes
    force: Vector = ORIGIN
    moment: Vector = ORIGIN
    own_moment: Vector = ORIGIN  # constant moment in body axes: a torque that turns with the body's axis
    # velocity components (three of translation, three of rotation, world axes) that keep their starting value. A locked
    # rotation needs all three locked, or the locked axes to be principal ones (checked at the start).
    locked: tuple[bool, bool, bool, bool, bool, bool] = (False,) * 6


@dataclass(frozen=True)
class Friction:
    """Coefficients and transition velocities of a contact: Eq. 3 (sliding), Eq. 4 (rolling), Eq. 6-7 (spinning)."""

    # sliding, sliding_transition: friction coefficient and transition velocity v_st
    sliding: float = 0.0
    sliding_transition: float = 1.0
    # rolling, lever, rolling_transition: rolling friction coefficient, lever D/2, and transition angular velocity
    rolling: float = 0.0
    lever: float = 0.0
    rolling_transition: float = 1.0
    # spinning, spinning_transition: factor k of M_s = k f_n^(4/3), and transition angular velocity
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
    """

    body: str  # the body that carries the spheres
    surface: Plane | Cylinder  # what they touch
    radius: float  # radius of the spheres
    # stiffness, exponent: C of each sphere and m of Eq. 2.
    stiffness: float
    exponent: float = 1.5
    # centre, axis: middle of the row and unit vector along it, in body axes
    centre: Vector = ORIGIN
    axis: Vector = X
    # count, length: number of spheres N_s and length l of the row; sphere k sits at l ((k + 1/2) / N_s - 1/2)
    count: int = 1
    length: float = 0.0
    crown: float = 0.0  # drop of the profile at the ends of the row: the radius falls by crown (2 x / l)^2
    # damping, damping_time: factor of Hunt and Crossley on the penetration rate, and time by which the contact's
    # stiffness is multiplied (`laws.contact`)
    damping: float = 0.0
    damping_time: float = 0.0
    friction: Friction = field(default_factory=Friction)  # coefficients of sliding, rolling and spinning


@dataclass(frozen=True)
class NeedleBearing:
    """A full complement of needle rollers between a trunnion and the bore of a roller, as one element without bodies.

    The needles are smeared over the circumference. They stay with the trunnion along its axis, centred on the
    trunnion's point; the bore slides over them and must be long enough. The radial clearance (negative: preload) is
    bore radius minus trunnion radius minus needle diameter.
    """

    # trunnion, bore: the two raceways: a convex and a concave cylinder of two bodies. The trunnion's point is the
    # middle of the needles, the bore's lies anywhere on its axis.
    trunnion: Cylinder
    bore: Cylinder
    # diameter, length, count: of the needles, and their number
    diameter: float
    length: float
    count: int
    # stiffness, exponent: C of one slice of a needle against one raceway, and m of Eq. 2.
    stiffness: float
    exponent: float = 10 / 9
    slices: int = 7  # number N_s of slices of a needle; they sit where the spheres of a `SphereRow` do
    crown: float = 0.0  # drop of the needle's profile at its ends, as in `SphereRow`
    # damping, damping_time: as in `SphereRow`, of each contact
    damping: float = 0.0
    damping_time: float = 0.0
    # angle of the needles to the trunnion's axis, positive counterclockwise about the outward normal of the trunnion
    skew: float = 0.0
    # sliding along the needles and rolling across them, at each of their two contacts. `rolling_transition` is the
    # roller's spin on its trunnion, with which both contacts reach theirs (s r_b and s r_t over the diameter). The
    # lever is half the diameter; lever and spinning stay zero.
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
    """Two bodies keep the relative place and attitude of their start: six equations."""

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

    The angle is measured from `reference_a` to `reference_b`, both across the axis, in body axes; a revolute joint or
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
    """Bodies, elements and constraints of one model."""

    # bodies, contacts, springs, constraints, bearings: the parts; a body is known by its name
    bodies: tuple[Body, ...]
    contacts: tuple[SphereRow, ...] = ()
    springs: tuple[Spring, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    gravity: Vector = ORIGIN  # acceleration of free fall, in world axes
    # constant angular velocity of the world axes and the ground about their origin: a scene that turns as a whole is
    # slow, and its positions almost constant, when it is described in axes that turn with it
    frame: Vector = ORIGIN
    # length_scale, speed_scale, rotation_scale: characteristic displacement, speed and angular velocity: tolerances and
    # bounds are relative to them
    length_scale: float = 1.0
    speed_scale: float = 1.0
    rotation_scale: float = 1.0
    time_scale: float = 1.0  # time in which the motion of the scene changes by itself: the pace of `adaptive-euler`
    # bodies with many contacts: they are eliminated last, like all bodies with constraints
    core: tuple[str, ...] = ()
    bearings: tuple[NeedleBearing, ...] = ()
