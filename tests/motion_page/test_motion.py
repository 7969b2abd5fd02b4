"""The joint in motion: poses against an independent reconstruction, the page's data, and the page in a browser."""

from __future__ import annotations

import base64
import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from reference import spider

import tripod_doe as td
from tripod_doe.cli.main import main
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.motion_page.drawing import joint_drawing
from tripod_doe.motion_page.page import motion_data, motion_page, viewed_point
from tripod_doe.motion_page.poses import poses_of
from tripod_doe.motion_page.stored_points import points_in
from tripod_doe.reports.joint_drawing import drawing_of

FRICTIONLESS = {
    "groove_sliding": 0,
    "groove_spinning": 0,
    "groove_rolling": 0,
    "needle_sliding": 0,
    "needle_rolling": 0,
}


def outputs_of(point):
    return {name: values.data for name, values in point.outputs.items()}


def needle_poses(values, poses, sample):
    """Centres and axes of all needles at a sample, shapes (3, needle, 3), as the page places them."""
    side = -1.0 if values.torque < 0 else 1.0
    turned = poses.phi[sample] + 2 * np.pi / 3 * np.arange(3)
    flank = -side * np.stack([-np.sin(turned), np.cos(turned), 0 * turned], axis=-1)
    trunnion = poses.trunnions[sample]
    load = flank - (flank * trunnion).sum(-1, keepdims=True) * trunnion
    load /= np.linalg.norm(load, axis=-1, keepdims=True)
    across = np.cross(trunnion, load)
    angle, place, skew = (poses.needles[sample, ..., i, None] for i in range(3))
    normal = np.cos(angle) * load[:, None] + np.sin(angle) * across[:, None]
    centre = poses.spider[sample] + (values.ring_distance + place) * trunnion[:, None] + values.bearing_radius * normal
    return centre, np.cos(skew) * trunnion[:, None] + np.sin(skew) * np.cross(normal, trunnion[:, None])


def test_poses_are_those_of_three_trunnions_through_three_grooves():
    """Exact physics: a frictionless joint against a search for the spider's place, within a micrometre."""
    point = viewed_point(model="equilibrium", joint_angle_deg=14, samples_per_revolution=36, **FRICTIONLESS)
    poses, values = poses_of(point.parameters, outputs_of(point)), point_values(point.parameters).point(0)
    for i in range(0, 36, 5):
        centre, _, directions, distance, _ = spider(poses.phi[i], values.joint_angle, values.pitch_radius)
        assert poses.spider[i] == pytest.approx(centre, abs=1e-6)
        for k in range(3):
            assert poses.trunnions[i, k] == pytest.approx(directions[k], abs=1e-7)
            assert poses.rollers[i, k] == pytest.approx(centre + distance[k] * directions[k], abs=1e-3)
            flank = np.cross(directions[k], [0, 0, 1])  # without friction the force is across trunnion and groove
            assert poses.contacts[i, k] == pytest.approx(flank / np.linalg.norm(flank), abs=1e-6)


def test_needles_stand_on_their_trunnion_and_carry_on_the_loaded_side():
    point = viewed_point(joint_angle_deg=8, torque_n_m=-90, samples_per_revolution=60, initial_skew_2_deg=0.6)
    poses, values = poses_of(point.parameters, outputs_of(point)), point_values(point.parameters).point(0)
    centres, axes = needle_poses(values, poses, 7)
    for k in range(3):
        arm = centres[k] - poses.spider[7]
        along = arm @ poses.trunnions[7, k]
        radial = arm - along[:, None] * poses.trunnions[7, k]
        assert np.linalg.norm(radial, axis=1) == pytest.approx(np.full(27, values.bearing_radius))
        assert np.linalg.norm(axes[k], axis=1) == pytest.approx(np.ones(27))
        most = int(poses.needles[7, k, :, 3].argmax())
        assert radial[most] @ poses.contacts[7, k] > 0.9 * values.bearing_radius


def test_forces_of_the_page_are_those_of_the_point():
    point = viewed_point(samples_per_revolution=72)
    outputs = outputs_of(point)
    data = motion_data(point.parameters, outputs)
    read = {name: np.frombuffer(base64.b64decode(text), "<f4") for name, text in data["arrays"].items()}
    assert read["normal"].reshape(-1, 3) == pytest.approx(outputs["groove_normal_force"][:, :72].T, rel=1e-6)
    for name, output in (
        ("friction", "groove_friction_force"),
        ("slip", "groove_slip"),
        ("pressure", "groove_pressure_mpa"),
    ):
        assert read[name].reshape(-1, 3) == pytest.approx(outputs[output][:, :72].T, rel=1e-6)
    along = read["friction"] * np.cos(read["direction"])  # on the housing: with the slip of the roller
    thrust = outputs["groove_thrust"].reshape(3, 2, 72).mean(axis=1)
    assert along.reshape(-1, 3) == pytest.approx(thrust.T, abs=1e-3)
    needle = read["needle"].reshape(72, 3, -1, 5)
    assert needle[..., 3] == pytest.approx(np.moveaxis(outputs["needle_load"][..., :72], -1, 0), rel=1e-5, abs=1e-4)
    assert needle[..., 4] == pytest.approx(
        np.moveaxis(outputs["needle_stop_force"][..., :72], -1, 0), rel=1e-5, abs=1e-4
    )
    peak = 1.5 * read["normal"] / (np.pi * data["sizes"]["patch_across"] * data["sizes"]["patch_along"])
    peak /= np.cbrt(read["normal"]) ** 2  # Hertz: the ellipse that is drawn has the pressure of the output
    assert read["pressure"] == pytest.approx(peak, rel=1e-5)
    assert read["thrust"] == pytest.approx(outputs["thrust"][:72], rel=1e-5, abs=1e-5)
    orders = np.fft.rfft(outputs["thrust"].reshape(2, 72).mean(axis=0))  # parts are means of the revolutions
    orders[13:] = 0
    assert read["part"].reshape(72, -1).sum(axis=1) == pytest.approx(np.fft.irfft(orders, 72), abs=1e-3)


@pytest.mark.parametrize("given", [{}, {"needle_count": 80, "needle_diameter_mm": 0.6, "samples_per_revolution": 720}])
def test_poses_of_a_revolution_take_a_megabyte_at_most(given):
    point = viewed_point(**given)
    data = motion_data(point.parameters, outputs_of(point))
    assert 200_000 < sum(map(len, data["arrays"].values())) <= 1_000_000
    assert data["count"] >= 120


@pytest.mark.parametrize(
    "given", [{}, {"roller_radius_mm": 24, "pitch_radius_mm": 40}, {"needle_count": 1, "roller_width_mm": 7}]
)
def test_the_drawing_is_to_scale(given):
    """Exact: circles of the drawing have the radii of the joint; nothing else is needed to draw one."""
    root = ET.fromstring(joint_drawing(given))
    values = point_values(given).point(0)
    radii = sorted({float(node.get("r")) for node in root.iter("{http://www.w3.org/2000/svg}circle")})
    for wanted in (values.groove_radius, values.bore_radius, values.trunnion_radius, values.needle_radius):
        assert min(abs(np.array(radii) - wanted)) < 1e-3


@pytest.mark.parametrize(
    "given",
    [{"pitch_radius_mm": np.inf}, {"roller_radius_mm": 0.0}, {"needle_count": 10**7}, {"pitch_radius_mm": "wide"}],
)
def test_a_joint_that_cannot_be_is_not_drawn(given):
    """Regression: sizes in the cube of a stranger divided by zero, or filled the memory with needles."""
    assert drawing_of(given) == ""


def test_the_page_asks_for_nothing_and_escapes_its_data():
    page = motion_page(viewed_point(model="equilibrium", samples_per_revolution=36))
    assert not re.findall(r"(?:src|href)=|@import|url\(", page)
    assert page.count("</script>") == 2
    assert "@" not in re.sub(r"@media", "", page.split("<body>")[1].split("<script")[0])


def test_a_point_without_motion_is_refused():
    with pytest.raises(td.InputError, match="no motion to show: the point is jammed"):
        td.view(needle_count=40)
    with pytest.raises(td.InputError, match="no forces of the grooves are known"):
        td.view(model="equilibrium", torque_n_m=0)
    for name in ("also", "keep"):  # arguments of our own functions are no parameters
        with pytest.raises(td.InputError, match=f"{name} = 5: unknown parameter"):
            td.simulate(**{name: 5})


def test_commands_write_pages(tmp_path, capsys):
    few = ["--samples-per-revolution", "36", "--model", "equilibrium"]
    assert main(["simulate", *few, "--view", str(tmp_path / "a.html"), "--format", "json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert "groove_normal_force" not in answer
    assert "motion-data" in (tmp_path / "a.html").read_text()
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "s"\n[base]\nsamples_per_revolution = 36\nmodel = "equilibrium"\n'
        "[factors]\ntorque_n_m = { values = [20, 40] }\n"
    )
    td.run(tmp_path / "s.toml", out=tmp_path / "out", progress=False, workers=0)
    assert [point["torque_n_m"] for point in points_in(tmp_path / "out", ["torque_n_m=40"])] == [40]
    page = str(tmp_path / "b.html")
    assert main(["view", str(tmp_path / "out"), "--select", "torque_n_m=40", "--output", page]) == 0
    assert "40 N m" in (tmp_path / "b.html").read_text()
    assert main(["view", str(tmp_path / "out"), "--output", page]) == 0
    assert (tmp_path / "b.html").read_text().count('class="scene"') == 2
    assert main(["view", str(tmp_path / "out"), "--output", page, "--against", "torque_n_m=3"]) == 2
    assert "the selection leaves two points" in capsys.readouterr().err
    assert (
        main(
            [
                "view",
                str(tmp_path / "out"),
                "--select",
                "torque_n_m=40",
                "--output",
                page,
                "--against",
                "torque_n_m=-40",
            ]
        )
        == 0
    )
    both = (tmp_path / "b.html").read_text()
    assert both.count('class="scene"') == 2
    assert "<h2>torque_n_m = -40.0</h2>" in both
    for wrong, told in (
        ("torque_n_m", "write NAME=VALUE"),
        ("torque=3", "did you mean 'torque_n_m'"),
        ("torque_n_m=x", "expected a number"),
    ):
        assert main(["simulate", *few, "--view", page, "--against", wrong]) == 2
        assert told in capsys.readouterr().err
    assert main(["simulate", *few, "--against", "torque_n_m=3"]) == 2
    assert main(["simulate", *few, "--view", f"{page}/a.html"]) == 1
    assert "cannot write" in capsys.readouterr().err


def test_a_jammed_joint_has_no_page_and_says_so(tmp_path, capsys):
    assert main(["simulate", "--needle-count", "40", "--view", str(tmp_path / "a.html")]) == 3
    assert "a.html: not written, since the point has no motion to show" in capsys.readouterr().err
    assert not (tmp_path / "a.html").exists()
