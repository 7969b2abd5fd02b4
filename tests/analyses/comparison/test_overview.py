"""Many records beside one cube: which agree, which points the cube lacks, which records cannot be read."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.analyses.comparison.comparison import AGREES, DIFFERS, UNDECIDED, VERDICTS
from tripod_doe.analyses.comparison.overview import OverviewRow, compare_records, overview_rows, read_table
from tripod_doe.analyses.comparison.page import _differing_orders
from tripod_doe.analyses.comparison.record_comparison import Reading
from tripod_doe.cli import main
from tripod_doe.errors import InputError
from tripod_doe.number_text import numbers_in_words

pytestmark = pytest.mark.usefixtures("charts_not_drawn")

STUDY = """
[study]
name = "rig"
[base]
model = "equilibrium"
speed_rpm = 450
groove_sliding_friction = 0.06
[factors]
joint_angle_deg = {values = [5, 11]}
torque_n_m = {values = [-90, 140]}
[keep]
outputs = ["thrust_amplitude", "thrust_phase_deg"]
"""
NOT_COMPARED = VERDICTS[-1]


@pytest.mark.parametrize(
    "heading", ["Torque [kNm]", "torque_n_m [Nm]", "TORQUE_N_M", "torque_n_m (Nm)", "Torque Nm", "Drehmoment [Nm]"]
)
def test_a_column_that_names_a_parameter_otherwise_is_refused(tmp_path, heading):
    """Regression: such torques were labels, and the record was compared at another point."""
    (tmp_path / "t.csv").write_text(f"file,{heading},joint\na.csv,0.1,left\n")
    with pytest.raises(InputError, match=re.escape(f"{heading} would be a label; write torque_n_m")):
        read_table(tmp_path / "t.csv")
    (tmp_path / "t.csv").write_text("file,joint\na.csv,left\n")
    assert len(read_table(tmp_path / "t.csv")) == 1


REVOLUTIONS, SAMPLES = 12, 180


def write_record(path, friction, seed, **parameters):
    """A record of the joint with another friction, with noise; made from its orders alone."""
    point = td.simulate(model="equilibrium", speed_rpm=450, groove_sliding_friction=friction, **parameters)
    angle = np.arange(REVOLUTIONS * SAMPLES) * 360 / SAMPLES
    orders = point["thrust_amplitude"].values * np.exp(1j * np.radians(point["thrust_phase_deg"].values))
    thrust = (np.exp(1j * np.radians(angle)[:, None] * np.arange(orders.size)) @ orders).real
    noise = np.random.default_rng(seed).normal(0, 0.02 * np.abs(orders).max(), angle.size)
    rows = "\n".join(f"{a:.3f},{f:.6f}" for a, f in zip(angle, thrust + noise, strict=True))
    path.write_text(f"rotation_deg,thrust_n\n{rows}\n")


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    (folder / "study.toml").write_text(STUDY)
    td.run(folder / "study.toml", out=folder / "out", progress=False, workers=0)
    write_record(folder / "same.csv", 0.06, 1, joint_angle_deg=11, torque_n_m=-90)
    write_record(folder / "more.csv", 0.09, 2, joint_angle_deg=5, torque_n_m=140)
    write_record(folder / "between.csv", 0.06, 3, joint_angle_deg=8, torque_n_m=140)
    (folder / "broken.csv").write_text("rotation_deg,thrust_n\n1,x\n")
    table = ["file,joint_angle_deg,torque_n_m,place", "same.csv,11,-90,a", "more.csv,5,140,b", "between.csv,8,140,c"]
    (folder / "records.csv").write_text("\n".join([*table, "broken.csv,5,140,d"]))
    return folder


def test_the_verdict_counts_both_uncertainties(rig):
    records = compare_records(
        td.open_cube(rig / "out"), read_table(rig / "records.csv"), Reading(reference_angle_deg=0)
    )
    third = {row.file: row for row in overview_rows(records) if row.order == 3}
    assert {name: row.verdict for name, row in third.items()} == {
        "same.csv": AGREES,
        "more.csv": DIFFERS,
        "between.csv": AGREES,
        "broken.csv": NOT_COMPARED,
    }
    assert [record.name for record in records if record.simulated] == ["between.csv"]
    direct = td.simulate(
        model="equilibrium", speed_rpm=450, groove_sliding_friction=0.06, joint_angle_deg=8, torque_n_m=140
    )
    assert third["between.csv"].computed == pytest.approx(float(direct["thrust_amplitude"].sel(order=3)), rel=1e-9)
    assert 0 < third["same.csv"].computed_error < 0.3 * third["same.csv"].computed
    gap = abs(third["more.csv"].measured - third["more.csv"].computed)
    assert gap > np.hypot(third["more.csv"].measured_error, third["more.csv"].computed_error)


def test_the_command_writes_an_overview_and_a_page_per_record(rig, tmp_path, capsys, monkeypatch):
    words = ["compare", str(rig / "out"), "--table", str(rig / "records.csv"), "--reference-angle", "0"]
    assert main([*words, "--out", str(tmp_path / "page")]) == 3  # one record was not compared
    text = capsys.readouterr().out
    assert "The third order agrees within the uncertainties in 2 of 3 records" in text
    assert "The cube lacks the points of between.csv, which were simulated." in text
    assert "broken.csv was not compared" in text
    with (tmp_path / "page" / "overview.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["file", "order", "measured", "measured_error", "computed", "computed_error", "verdict"]
    assert len(rows) == 4 * 13
    page = (tmp_path / "page" / "index.html").read_text()
    links = [f"records/{name}/index.html" for name in ("001-same", "002-more", "003-between")]
    assert all(link in page and (tmp_path / "page" / link).is_file() for link in links)
    assert "004-broken" not in page
    assert main([*words, "--format", "json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert [row["verdict"] for row in told if row["order"] == 3] == [AGREES, DIFFERS, AGREES, NOT_COMPARED]
    assert told[-1]["measured"] is None


def test_one_record_has_one_page_under_either_flag(rig, tmp_path, capsys):
    """Regression: --out and --output wrote different pages."""
    words = ["compare", str(rig / "out"), str(rig / "same.csv"), "--select", "joint_angle_deg=11"]
    words += ["--select", "torque_n_m=-90", "--reference-angle", "0"]
    for flag, name in (("--out", "one"), ("--output", "two")):
        assert main([*words, flag, str(tmp_path / name)]) == 0
        assert sorted(path.name for path in (tmp_path / name).iterdir()) == [
            "checksums.sha256",
            "comparison.nc",
            "index.html",
            "overview.csv",
        ]
    assert (tmp_path / "one" / "index.html").read_text() == (tmp_path / "two" / "index.html").read_text()
    with (tmp_path / "one" / "overview.csv").open() as stream:
        assert [row["verdict"] for row in csv.DictReader(stream) if row["order"] == "3"] == [AGREES]
    assert main([*words[:3], str(rig / "more.csv"), *words[3:], "--out", str(tmp_path / "x.html")]) == 2
    assert "several records have a page each: name a folder" in capsys.readouterr().err


def test_several_files_share_a_selection(rig, capsys):
    files = [str(rig / name) for name in ("same.csv", "more.csv")]
    words = ["compare", str(rig / "out"), *files, "--select", "joint_angle_deg=11", "--select", "torque_n_m=-90"]
    assert main([*words, "--reference-angle", "0"]) == 0
    assert "agrees within the uncertainties in 1 of 2 records" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("files,torque_n_m\na.csv,3\n", "no column 'file'; did you mean 'files'"),
        ("file,torque_n_m\na.csv,much\n", "line 2: torque_n_m = 'much': expected a number"),
        ("file,torque_n_m\na.csv\n", "line 2 has 1 fields, the header 2"),
        ("file\n", "no rows below the header"),
        ("file,torque_n_m,torque_n_m\na.csv,4,8\n", "column 'torque_n_m' occurs 2 times; keep one"),
    ],
)
def test_a_wrong_table_names_line_and_column(tmp_path, table, message):
    (tmp_path / "records.csv").write_text(table)
    with pytest.raises(InputError, match=message.replace("?", r"\?")):
        read_table(tmp_path / "records.csv")


def test_without_a_record_there_is_nothing_to_compare(rig, capsys):
    assert main(["compare", str(rig / "out")]) == 2
    assert "name files, or a --table of them" in capsys.readouterr().err


def test_terminal_page_and_csv_have_one_verdict_per_order(rig, tmp_path, capsys):
    """Regression: an order was "beyond its uncertainty" in the text, which left the model's out, and agreed in the CSV."""
    point = ["--select", "joint_angle_deg=11", "--select", "torque_n_m=-90", "--reference-angle", "0"]
    for file in ("same.csv", "more.csv"):
        assert main(["compare", str(rig / "out"), str(rig / file), *point, "--out", str(tmp_path / file)]) == 0
        text = capsys.readouterr().out
        with (tmp_path / file / "overview.csv").open() as stream:
            verdicts = {int(row["order"]): row["verdict"] for row in csv.DictReader(stream)}
        table = [line.split() for line in text.splitlines()[-13:]]
        assert {int(row[0]): " ".join(row[6:-5]) for row in table} == verdicts
        differing = [order for order, verdict in verdicts.items() if verdict == DIFFERS]
        first = text.splitlines()[0]
        named = differing or [order for order, verdict in verdicts.items() if verdict == AGREES]
        assert first.startswith(f"Order{'s' * (len(named) != 1)} {numbers_in_words(named)} ")
        hidden = [order for order, verdict in verdicts.items() if verdict == UNDECIDED]
        assert (f"{numbers_in_words(hidden)} are smaller than these uncertainties" in first) == (len(hidden) > 1)
        for line, order in zip(text.splitlines()[1:3], (3, 2), strict=True):
            assert line.endswith(f"{'beyond' if order in differing else 'within'} both uncertainties together.")
        page = (tmp_path / file / "index.html").read_text()
        assert first.partition(";")[0] in page
        assert page.count(f">{DIFFERS}<") == len(differing)
    assert differing  # of another friction


def test_the_nearest_point_is_named_and_nothing_is_simulated(rig, capsys):
    words = ["compare", str(rig / "out"), "--table", str(rig / "records.csv"), "--reference-angle", "0", "--nearest"]
    assert main(words) == 3
    text = capsys.readouterr().out
    assert "between.csv: The nearest point of the cube is compared: joint angle 5 deg in place of 8 deg." in text
    assert "simulated" not in text


def test_a_factor_of_one_value_counts_for_points_that_are_simulated(rig, tmp_path):
    """Regression: a cube with [factors.model] values = ["equilibrium"] refused points between its own."""
    study = STUDY.replace('model = "equilibrium"\n', "") + '\n[factors.model]\nvalues = ["equilibrium"]\n'
    assert study.count("equilibrium") == 1
    (tmp_path / "study.toml").write_text(study)
    td.run(tmp_path / "study.toml", out=tmp_path / "out", progress=False, workers=0)
    (tmp_path / "one.csv").write_text(f"file,joint_angle_deg,torque_n_m\n{rig / 'between.csv'},8,140\n")
    assert main(["compare", str(tmp_path / "out"), "--table", str(tmp_path / "one.csv")]) == 0


def test_a_point_that_can_neither_be_taken_nor_simulated_says_what_differs(rig, tmp_path, capsys):
    """Regression: "the cube has another speed_rpm"."""
    (tmp_path / "one.csv").write_text(f"file,speed_rpm\n{rig / 'same.csv'},700\n")
    assert main(["compare", str(rig / "out"), "--table", str(tmp_path / "one.csv")]) == 3
    assert "the record is at speed 700 rpm, all points of the cube at speed 450 rpm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("others", "text"),
    [
        ({}, "Orders 1 to 12 all agree within the uncertainties of measurement and model together in 2 records."),
        ({7: UNDECIDED}, "in 2 records; order 7 agrees or is too small to tell."),
        (
            {7: UNDECIDED, 3: DIFFERS},
            "order 3 in 1 of 2 records; orders 1, 2, 4 to 6 and 8 to 12 agree in all; order 7",
        ),
    ],
)
def test_orders_that_agree_where_they_can_be_judged_do_not_agree_in_all(others, text):
    """Orders 7 and 8 "agreed in all" of eight records, and were too small to tell in six of them."""
    rows = [
        OverviewRow(name, order, 1.0, 0.1, 1.0, 0.1, others.get(order, AGREES) if name == "b" else AGREES)
        for name in "ab"
        for order in range(1, 13)
    ]
    assert text in " ".join(_differing_orders(rows))
