"""The page of symbols, units and signs: each statement of its lists is computed, each row of its tables held against the code."""

from __future__ import annotations

import math
import re
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from tripod_doe.joint.geometry.kinematics import ideal_motion
from tripod_doe.joint.multibody.joint_scene import build_joint
from tripod_doe.joint.multibody.needle_bearing import needle_body
from tripod_doe.joint.multibody.scene_constants import derive_constants
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.unit_conversion import internal_values
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.simulate import simulate_point

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "reference" / "signs.md").read_text(encoding="utf-8")
STATEMENTS = re.findall(r"^- (.+)$", PAGE, re.MULTILINE)
SIMULATOR = load_simulator("joint")
CHECKS = {}


def states(beginning):
    """Marks the check of the statement that begins so."""

    def register(check):
        CHECKS[beginning] = check
        return check

    return register


@cache
def joint(*also, **parameters):
    """Outputs of the reference joint with these parameters, as arrays."""
    return {name: values.data for name, values in simulate_point("joint", also, **parameters).outputs.items()}


def third(**parameters):
    return float(joint(**parameters)["thrust_amplitude"][3])


def derived(**parameters):
    """What the multibody models start from."""
    columns = {name: np.array([float(value)]) for name, value in parameters.items()}
    return derive_constants(internal_values(SIMULATOR.columns({}, columns, 1)).point(0))


def body(constants, name):
    return next(body for body in build_joint(constants.values, False).bodies if body.name == name)


def rotated(force, degrees):
    """A waveform with a sample per degree, from this angle on."""
    return np.roll(force, -degrees, axis=-1)


def opposite(first, second):
    return abs(abs((first - second + 180) % 360 - 180) - 180) < 1


@states("The input axis points")
def thrust_is_positive_along_the_input_axis():
    """Sliding friction drags the housing with the roller: along its velocity, which the kinematics count along that axis."""
    middle = math.radians(45)
    moves = ideal_motion.py_func(math.cos(middle), math.sin(middle), math.cos(0.17), math.sin(0.17), 21.0, 60.0)
    assert moves.along_groove > 0
    assert moves.t_r > 0.9  # trunnion 1 points outward
    assert joint()["groove_thrust"][0, 45] > 0
    assert "towards the intermediate shaft" in SIMULATOR.outputs["thrust"].convention


@states("A groove is pushed")
def a_groove_is_pushed_along():
    for torque, first in ((50, 21), (-50, -16)):
        force = rotated(joint(torque_n_m=torque)["groove_thrust"][0], first)
        assert (force[1:180] > 0).all()
        assert (force[181:360] < 0).all()
        assert f"from {first} to {first + 180} deg" in PAGE
    velocity = [
        ideal_motion.py_func(math.cos(x), math.sin(x), 0.98, 0.17, 21.0, 60.0).along_groove for x in (1, 2, 4, 5)
    ]
    assert np.sign(velocity).tolist() == [1, 1, -1, -1]


@states("A positive torque is drive")
def positive_torque_is_drive():
    assert body(derived(torque_n_m=50), "output").own_moment[2] < 0
    assert "coast" in SIMULATOR.parameters["torque_n_m"].meaning


@states("On drive the rollers bear")
def drive_loads_trailing_flanks():
    """Needle 1 of a trunnion starts in the middle of the load zone, between trunnion and the loaded flank."""
    for torque, sense in ((50, -1), (-50, 1)):
        constants = derived(torque_n_m=torque)
        arm = (
            np.array(needle_body(constants, 0, 0, body(constants, "roller 1")).position)
            - constants.initial.shaft.position
        )
        assert sense * arm[1] > 5  # along the rotation at phi = 0 is +y


@states("Coast does not reverse")
def coast_does_not_reverse():
    assert f"{third():.1f} N with 50 N m and {third(torque_n_m=-50):.1f} N with -50 N m" in PAGE
    phases = [joint(torque_n_m=torque)["thrust_phase_deg"][3] for torque in (50, -50)]
    assert abs(phases[0] - phases[1]) > 10


@states("`rotation_deg` is the angle")
def rotation_is_counterclockwise_from_the_shaft():
    """The shaft lies at +z, so from there a rotation about +z is counterclockwise; trunnions move so at the start."""
    initial = derived().initial
    assert initial.output.position[2] > 100
    roller = initial.rollers[1].position  # at 120 deg: left of x as seen against z
    assert roller[1] > 0 > roller[0]


@states("At phi = 0 roller 1")
def roller_1_is_between_the_axes():
    place = joint("groove_contact_place_mm")["groove_contact_place_mm"]
    assert place[0, 0] == pytest.approx(-21 * math.tan(math.radians(10)), abs=0.05)
    assert "3.7 mm" in PAGE
    assert place[0, 0] == pytest.approx(place.min(), abs=0.02)
    initial = derived().initial
    assert initial.output.position[0] > 10  # the shaft is inclined to +x
    assert initial.rollers[0].position[0] > 10
    assert abs(initial.rollers[0].position[1]) < 0.2  # by clearances


@states("Grooves and trunnions are numbered")
def grooves_are_numbered_along_the_rotation():
    force = joint(model="equilibrium")["groove_thrust"]
    assert rotated(force[0], 120) == pytest.approx(force[1], abs=1e-6)
    assert rotated(force[0], 240) == pytest.approx(force[2], abs=1e-6)
    assert joint("groove_contact_place_mm")["groove_contact_place_mm"][:, [0, 240, 120]].diagonal() == pytest.approx(
        [-3.7] * 3, abs=0.05
    )


@states("A skew is positive if")
def skew_is_counterclockwise():
    constants = derived(initial_skew_1_deg=2)
    needle = needle_body(constants, 0, 0, body(constants, "roller 1"))
    own = np.array(long_axis(needle))
    outward = constants.initial.rollers[0].attitude.apply([0, 0, 1])
    normal = np.array(needle.position) - constants.initial.shaft.position
    normal -= outward * (normal @ outward)
    turn = np.cross(outward, own) @ normal / np.linalg.norm(normal)
    assert math.degrees(math.asin(turn)) == pytest.approx(2, abs=1e-6)
    first = joint(initial_skew_1_deg=2)["needle_skew_summary_deg"][:, 0, 0]
    assert first[0] > 1
    assert abs(first[1]) < 0.5


def long_axis(needle):
    w, x, y, z = needle.attitude
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


@states("On drive, a positive skew")
def positive_skew_raises_the_force():
    for model in ("equilibrium", "kinetostatic"):
        with_skew = joint(model=model, initial_skew_1_deg=1)["groove_thrust"][0]
        change = with_skew - joint(model=model)["groove_thrust"][0]
        assert (change[[45, 225]] > 0).all()
        assert (change[[135, 315]] < 0).all()


@states("A joint that turns clockwise")
def the_other_rotation_is_the_mirror_image():
    """Mirrored at the plane of both axes, angles and speeds about z change sign, places along it and radii do not."""
    theta, phi = 0.2, 0.7
    one = ideal_motion.py_func(math.cos(phi), math.sin(phi), math.cos(theta), math.sin(theta), 21.0, 60.0)
    other = ideal_motion.py_func(math.cos(phi), -math.sin(phi), math.cos(theta), math.sin(theta), 21.0, -60.0)
    assert other.along_groove == pytest.approx(one.along_groove)
    assert other.along_trunnion == pytest.approx(one.along_trunnion)
    assert (other.t_r, other.t_t, other.t_z) == pytest.approx((one.t_r, -one.t_t, one.t_z))
    normal, axis = np.array([0.0, 1.0, 0.0]), np.array([0.2, 0.0, 1.0])  # a needle, and its mirror image in y
    mirror = np.array([1.0, -1.0, 1.0])
    outward = np.array([0.0, 0.0, 1.0])
    assert np.cross(outward, axis) @ normal == -np.cross(outward, mirror * axis) @ (mirror * normal)


@states("thrust(phi) = A_0 cos(p_0)")
def the_series_gives_the_waveform():
    outputs = joint()
    orders, phi = np.asarray(ORDERS), np.radians(np.arange(720))
    assert orders.tolist() == [*range(13)]
    phase = np.radians(outputs["thrust_phase_deg"])
    series = (outputs["thrust_amplitude"] * np.cos(np.outer(phi, orders) + phase)).sum(-1)
    assert f"higher orders, which no output lists: up to {np.abs(series - outputs['thrust']).max():.1f} N" in PAGE
    assert (outputs["thrust_amplitude"] >= 0).all()
    assert (outputs["thrust_phase_deg"] > -180).all()
    assert (outputs["thrust_phase_deg"] <= 180).all()
    assert outputs["thrust_phase_deg"][0] in (0, 180)


@states("Order k repeats")
def frequency_of_an_order():
    force = joint()["thrust"]
    spectrum = np.abs(np.fft.rfft(force))
    hertz = np.fft.rfftfreq(720, d=60 / 600 / 360)
    assert hertz[spectrum.argmax()] == pytest.approx(30)


@states("Order k is largest at")
def an_order_is_largest_where_its_phase_says():
    phase = joint()["thrust_phase_deg"][3]
    assert f"p_3 = {phase:.0f} deg puts the first maximum of the third order at {-phase / 3:.0f} deg" in PAGE
    spectrum = np.fft.rfft(joint()["thrust"][:360])
    alone = np.fft.irfft(np.where(np.arange(len(spectrum)) == 3, spectrum, 0))
    assert int(alone[:120].argmax()) == round(-phase / 3)
    assert alone[:120] == pytest.approx(alone[120:240], abs=1e-9)


@states("Where an angle sensor")
def another_zero_of_the_angle():
    force = joint()["thrust"][:360]

    def phases(force):
        return np.degrees(np.angle(np.fft.rfft(force)))

    shifted = (phases(rotated(force, 50)) - phases(force))[[3, 9]]
    assert (shifted - [3 * 50, 9 * 50]) % 360 == pytest.approx(0, abs=1e-6)


@states("The three grooves do")
def grooves_cancel_or_add():
    outputs = joint(model="equilibrium")
    groove, total = outputs["groove_thrust_amplitude"][0], outputs["thrust_amplitude"]
    assert groove[1] > 5
    for order in (1, 2, 4, 5, 7, 8, 10, 11):
        assert total[order] < 1e-6
    for order in (3, 6, 9, 12):
        assert total[order] == pytest.approx(3 * groove[order], abs=1e-6)


@states("Without skew, the force")
def without_skew_half_a_turn_reverses():
    outputs = joint(model="equilibrium")
    force = outputs["groove_thrust"][0]
    assert rotated(force, 180) == pytest.approx(-force, abs=1e-6)
    assert outputs["groove_thrust_amplitude"][:, ::2].max() < 1e-6


def skewed(*degrees):
    skews = {f"initial_skew_{k}_deg": value for k, value in enumerate(degrees, start=1)}
    return joint(model="equilibrium", **skews)


@states("Skewed needles add")
def unequal_skews_leave_the_second_order():
    equal, unequal = skewed(1, 1, 1), skewed(1, -1, 1)
    assert equal["groove_thrust_amplitude"][:, 2].min() > 0.1
    assert equal["thrust_amplitude"][2] < 1e-6
    assert unequal["thrust_amplitude"][2] > 0.1


@states("With all skews reversed")
def reversed_skews_turn_the_second_order():
    one, other = skewed(1, -1, 1), skewed(-1, 1, -1)
    assert one["thrust_amplitude"][2] == pytest.approx(other["thrust_amplitude"][2], rel=1e-3)
    assert opposite(one["thrust_phase_deg"][2], other["thrust_phase_deg"][2])


@states("The third order is proportional")
def the_third_order_follows_the_torque():
    assert third(torque_n_m=100) == pytest.approx(2 * third(), rel=0.01)
    assert third(speed_rpm=300) == pytest.approx(third(), rel=0.03)
    assert third(speed_rpm=1200) == pytest.approx(third(), rel=0.03)
    assert f"{third(joint_angle_deg=5):.1f} N at 5 deg, {third():.1f} N at 10 deg" in PAGE


@states("`thrust_amplitude` A_k is half")
def amplitude_is_half_the_distance():
    spectrum = np.fft.rfft(joint()["thrust"])
    alone = np.fft.irfft(np.where(np.arange(len(spectrum)) == 6, spectrum, 0))
    assert np.ptp(alone) / 2 == pytest.approx(third(), rel=1e-3)


@states("`thrust_rms` is the effective")
def effective_values():
    outputs = joint()
    assert outputs["thrust_rms"][1:] == pytest.approx(outputs["thrust_amplitude"][1:] / math.sqrt(2))
    assert outputs["thrust_rms"][0] == outputs["thrust_amplitude"][0]


@states("Peak to peak of the third")
def peak_to_peak():
    assert f"2 A_3 = {2 * third():.1f} N" in PAGE
    assert f"differs: {np.ptp(joint()['thrust']):.1f} N" in PAGE


@pytest.mark.parametrize("statement", STATEMENTS, ids=lambda statement: re.sub(r"\W+", " ", statement)[:40])
def test_a_statement_holds(statement):
    """Exact physics and regression, by the check of the statement, of which there is one."""
    (check,) = [check for beginning, check in CHECKS.items() if statement.startswith(beginning)]
    check()


def test_each_check_is_of_a_statement():
    assert len(CHECKS) == len(STATEMENTS)


def rows(title):
    """Cells of the table under a title."""
    text = PAGE.partition(f"## {title}\n")[2].partition("\n## ")[0]
    return [
        [cell.strip().strip("`") for cell in line.split("|")[1:-1]]
        for line in text.splitlines()
        if line.startswith("| ")
    ][2:]


@pytest.mark.parametrize("row", rows("Symbols"), ids=lambda row: row[1])
def test_a_symbol_is_that_of_the_code(row):
    symbol, name, unit, _ = row
    known = SIMULATOR.parameters.get(name) or SIMULATOR.outputs[name]
    assert known.symbol == symbol
    assert {"degree": "deg", "1": "-"}.get(known.unit, known.unit) == unit


@pytest.mark.parametrize("row", rows("Typical values"), ids=lambda row: row[0])
def test_a_typical_value_has_its_source(row):
    name, default, source, found = row
    known = SIMULATOR.parameters[name]
    assert float(default) == known.default
    assert source == known.source
    if " to " in found and name != "bearing_radial_clearance_mm":  # in um there
        assert found in (DOCS / "explanation" / "joint_of_the_paper.md").read_text(encoding="utf-8")


def test_the_drawing_shows_these_signs():
    """Groove 2 stands counterclockwise of 1, roller 1 deep in the housing, the loaded flank behind it, the skew counterclockwise."""
    drawn = {
        part.get("id"): part for part in ElementTree.parse(DOCS / "pictures" / "signs.svg").iter() if part.get("id")
    }
    one, two = (
        complex(float(drawn[f"groove-{k}"].get("cx")) - 450, 140 - float(drawn[f"groove-{k}"].get("cy")))
        for k in (1, 2)
    )
    assert np.angle(two / one, deg=True) == pytest.approx(120, abs=1)
    assert float(drawn["roller-1"].get("cx")) < 152  # the joint's centre; the shaft is on the right
    assert (
        float(drawn["flank-1"].get("d").split()[0][1:]) > 450
    )  # right of the middle: behind groove 1, which moves left
    assert float(re.search(r"rotate\((\S+)", drawn["needle"].get("transform"))[1]) < 0  # of SVG: counterclockwise
