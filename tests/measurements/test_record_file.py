"""Tables as recorders write them: separators, decimal commas, lines before the table, names, units."""

from __future__ import annotations

import math
import os
import random
import re
import shlex
import time
import warnings
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tripod_doe.errors import InputError, speaking_of_options
from tripod_doe.measurements.headings import parse_column, unit_factor
from tripod_doe.measurements.record_file import read_record


@pytest.fixture
def read(tmp_path):
    def read(text, given=None, encoding="utf-8"):
        (tmp_path / "record.txt").write_bytes(text.encode(encoding))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return read_record(tmp_path / "record.txt", given)

    return read


@pytest.mark.parametrize(
    "text",
    [
        "rotation_deg,thrust_n\n0.5,1.25\n1.5,-2\n",
        "# a note\n\nrotation_deg, thrust_n\n0.5, 1.25\n1.5, -2\n",
        "rotation_deg,thrust_n\ndeg,kN\n0.5,0.00125\n1.5,-0.002\n",
        "rotation_deg;thrust_n\n0,5;1,25\n1,5;-2,0\n",
        "rotation_deg;thrust_n;\n0.5;1.25;\n1.5;-2;\n",
        "Drehwinkel [°]\tAxialkraft [kN]\n0,5\t0,00125\n1,5\t-0,002\n",
        "\ufeffRotation angle (deg),Axial force (kN),note\n0.5,1.25e-3,\n1.5,-2e-3,\n",
        "Recorder 7\nChannels: 2\nangle;force\ndeg;N\n0,5;1,25\n1,5;-2\n",
        "angle   force\n[rad]   [N]\n0.00872664625997165 1.25\n0.0261799387799149 -2\n",
        '"Shaft angle [rev]","Thrust Force [N]"\n0.001388888888888889,1.25\n0.004166666666666667,-2\n',
        "channel_1,thrust_n,rotation_deg\nx,1.25,0.5\ny,-2,1.5\n",
        "x;rotation_deg;thrust_n\n1;0,5;1,25\n2;1,5;-2\n",
        "Shaft angle;Axial force housing;Oil temp;p\ndeg;N;degC;bar\n0,5;1,25;61,0;2\n1,5;-2;61,1;2\n",
        "Zeit;Drehwinkel;Axialkraft Gehäuse;Öl\ns;°;N;°C\n0;0,5;1,25;-\n1;1,5;-2;n/a\n",
        '"Rotation angle [deg]","Kraft axial [N]"\n"0,5","1,25"\n"1,5","-2"\n',
        "Shaft angle (deg)   Axial force (N)\n0.5   1.25\n1.5   -2\n",
        "# rig 7\n# rotation_deg thrust_n\n0.5 1.25\n1.5 -2\n",
        "Rotation [deg] Force [N] Torque [Nm]\n0.5 1.25 50\n1.5 -2 50\n",
        "% Rotation Force Torque\n0.5 1.25 50\n1.5 -2 50\n",
        "Torque;50;Nm\nKanal 1;Drehwinkel;F_ax/N\n1;0,5;1,25\n2;1,5;-2\n",
        "Angle de rotation;Effort axial;Température\n°;daN;°C\n0,5;0,125;40\n1,5;-0,2;40\n",
        "Angolo di rotazione [°]\tForza assiale [N]\tVelocità [giri/min]\n0.5\t1.25\t600\n1.5\t-2\t600\n",
        "Ángulo de giro [°];Fuerza axial [N];Velocidad de giro [rpm]\n0,5;1,25;600\n1,5;-2;600\n",
        "Ângulo de rotação (°);Força axial (N)\n0,5;1,25\n1,5;-2\n",
        "RotationAngle_deg,AxialForce_kN,AxialForceSetpoint_kN\n0.5,0.00125,1\n1.5,-0.002,1\n",
        '"Format","MoTeC CSV File",,"Workbook"\n"Rate","1000","Hz"\n\n\n"Shaft Angle","Axial Force"\n"deg","N"\n\n\n'
        '"0.5","1.25"\n"1.5","-2"\n',
        "Linear\tReal\nRotation\tAxial Force:+X\ndeg\tN\n0.5\t1.25\n1.5\t-2\n",
        "MTS793|BTW|ENU|1|2|/|:|1|0|0|A\n\nData Header:\tTime:\t12.5\tSec\n\nAngular Position\tAxial Force\n deg\tkN\n"
        "0.5\t0.00125\n1.5\t-0.002\n",
        '"","rotation.angle","axial.force"\n"1",0.5,1.25\n"2",1.5,-2\n',
    ],
)
def test_one_table_in_many_forms(read, text):
    record = read(text)
    assert record.columns["rotation_deg"] == pytest.approx([0.5, 1.5], rel=1e-12)
    assert record.columns["thrust_n"] == pytest.approx([1.25, -2.0], rel=1e-12)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_encodings_of_recorders(read, encoding):
    record = read("Drehwinkel [°];Axialkraft Gehäuse [N]\n0,5;1,25\n1,5;-2\n", encoding=encoding)
    assert record.headings == ("Drehwinkel [°]", "Axialkraft Gehäuse [N]")
    assert record.columns["thrust_n"].tolist() == [1.25, -2.0]


def test_times_of_day_pass_midnight(read):
    record = read("Zeit;thrust_n;tacho\n25.11.2026 23:59:59,5;1;0\n26.11.2026 00:00:00,25;2;5\n")
    assert record.columns["time_s"].tolist() == [0.0, 0.75]


@pytest.mark.parametrize("offset", ["+01:00", "-0530", " +01:00", "Z"])
def test_times_of_day_may_have_an_offset(read, offset):
    """Regression: the offset was taken for the time, which stood still."""
    rows = "".join(f"2026-11-25T12:00:0{at}.5{offset};{at};0\n" for at in (1, 2, 3))
    assert read("Zeit;thrust_n;tacho\n" + rows).columns["time_s"].tolist() == [0.0, 1.0, 2.0]


def test_times_with_hundredths_behind_a_colon_are_refused(read):
    """Regression: 12:00:01:25 was taken for 1 min 25 s."""
    with pytest.raises(InputError, match=r"'12:00:01:25' in row 1: expected a time of day as 12:00:01\.5, a number"):
        read("Zeit;thrust_n;tacho\n12:00:01:25;1;0\n12:00:01:50;2;5\n")


def test_a_column_of_torque_or_speed_is_no_other_one(read):
    text = "Time;Axial force;Drehzahl;Torque;Joint angle\ns;N;V;Nm;deg\n0,1;1;0;50;8\n0,2;2;5;51;8\n"
    assert set(read(text).columns) == {"time_s", "thrust_n", "tacho", "torque_n_m", "joint_angle_deg"}
    assert "speed_rpm" in read(text.replace("V", "1/min")).columns
    assert "torque_n_m" not in read(text.replace("Nm", "V")).columns


def test_what_was_taken_for_what_is_stated(read):
    taken = read("Time [ms];Axial force [kN];Tacho [V]\n0,5;1,25;0\n1,5;-2;5\n").taken
    assert (
        taken
        == "thrust_n from 'Axial force [kN]' times 1000, time_s from 'Time [ms]' times 0.001, tacho from 'Tacho [V]'"
    )
    assert read("time_s,thrust_n,tacho\n1,2,3\n4,5,6\n").taken == ""


def test_other_headings_are_named_by_the_user(read):
    text = "Kanal 3,Kanal 4,Kanal 5 [kN]\n0.5,7,1.25\n1.5,8,-2\n"
    record = read(text, dict(map(parse_column, ["rotation-deg=Kanal 3", "thrust_n = Kanal 5 [kN]"])))
    assert record.columns["thrust_n"].tolist() == [1250.0, -2000.0]
    assert read(text, {"rotation_deg": "kanal 3", "thrust_n": "Kanal 5"}).columns["thrust_n"].tolist() == [1250, -2000]
    in_newtons = {"rotation_deg": "Kanal 3", "thrust_n": "Kanal 5 [N]"}
    assert read(text, in_newtons).columns["thrust_n"].tolist() == [1.25, -2.0]
    with pytest.raises(InputError, match="no such heading; did you mean 'Kanal 3'"):
        read(text, {"thrust_n": "Kanal 33"})
    with pytest.raises(InputError, match="write NAME=HEADING, a NAME of thrust_n"):
        parse_column("force=Kanal 3")


def test_a_column_that_is_not_used_is_left_out(read):
    """Regression: who chose "none" for the rotation angle on the page got it nevertheless, in place of the tachometer."""
    text = "rotation_deg,time_s,tacho,thrust_n\n0,0,0,1\n1,0.1,1,2\n"
    assert set(read(text, dict([parse_column("rotation_deg=")])).columns) == {"time_s", "tacho", "thrust_n"}
    assert "rotation_deg" in read(text).columns


def test_dropouts_are_nan_and_words_are_named(read):
    assert np.isnan(read("rotation_deg;thrust_n\n0,5;\n1,5;2\n").columns["thrust_n"]).tolist() == [True, False]
    with pytest.raises(InputError, match=r"thrust_n = 'off' in row 2"):
        read("rotation_deg;thrust_n\n0,5;1,5\n1,5;off\n2,5;2,5\n")


_DRAWN = {
    "thrust_n": ("Axial force", {"N": 1, "kN": 1e3, "daN": 10, "mN": 1e-3}),
    "rotation_deg": ("Drehwinkel", {"deg": 1, "°": 1, "rad": 180 / math.pi}),
    "time_s": ("Zeit", {"s": 1, "ms": 1e-3, "\u00b5s": 1e-6, "\u03bcs": 1e-6, "min": 60}),
}


@pytest.mark.parametrize("seed", range(80))
def test_drawn_tables_are_read_as_they_were_drawn(read, seed):
    """Regression: where gaps were written in two ways, in µs, with a date beside decimal commas, and below a line of
    units that ends early, records were refused, or a force in kN was taken as one in N."""
    chance = random.Random(seed)
    separator, decimal = chance.choice([(";", ","), (";", "."), ("\t", ","), (",", ".")])
    force = [None if chance.random() < 0.2 else round(chance.uniform(-2e3, 2e3), 3) for _ in range(12)]
    columns = {"thrust_n": force, "rotation_deg": [7.25 * row for row in range(12)], "time_s": list(range(12))}
    dated = chance.random() < 0.3
    names, units, texts = [], [], []
    for role in chance.sample(sorted(columns), 3):
        name, known = _DRAWN[role]
        unit, digits = chance.choice(list(known)), chance.choice([3, 9])
        cells = [
            chance.choice(["", "-", "NaN", "n/a"]) if v is None else f"{v / known[unit]:.{digits}f}"
            for v in columns[role]
        ]
        if dated and role == "time_s":
            unit, cells = "", [f"10.03.2024 12:00:{second:02d}.5" for second in range(12)]
            cells = [cell[:-2] + decimal + "5" for cell in cells]
        else:
            cells = [cell.replace(".", decimal) for cell in cells]
        names, units, texts = [*names, name], [*units, unit], [*texts, cells]
        columns[role] = [math.nan if v is None else v for v in columns[role]]
    if chance.random() < 0.5:
        names, units, texts = [*names, "Index 2"], [*units, ""], [*texts, list(map(str, range(12)))]
    lines = [separator.join(row) for row in zip(*texts, strict=True)]
    if chance.random() < 0.4:
        names = [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
    else:
        lines.insert(0, chance.choice([str, lambda line: line.rstrip(separator)])(separator.join(units)))
    record = read("\n".join(["Rig 7", separator.join(names), *lines, ""]), encoding=chance.choice(["utf-8", "utf-16"]))
    for role, values in columns.items():
        rounding = 1e-3 * max(_DRAWN[role][1].values())
        assert record.columns[role] == pytest.approx(values, rel=1e-9, abs=rounding, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("rotation_deg;thrust_n\n0;1.005\n1;1.003\n2;999,9\n3;998,5\n", "thrust_n = '1.005' in row 1"),
        ("rotation_deg\tthrust_n\n0\t999,9\n1\t1.005\n", "thrust_n = '1.005' in row 2"),
        ("rotation_deg thrust_n\n0 1.005\n1 999,9\n2 998,5\n", "thrust_n = '1.005' in row 1"),
        ("time_s;rotation_deg;thrust_n\n0,0;0,0;2.010\n0,1;2,0;2.008\n", "thrust_n = '2.010' in row 1"),
        ("rotation_deg;thrust_n\n0;1,005\n1;999.9\n2;998.5\n", "thrust_n = '1,005' in row 1"),
        ("rotation_deg;thrust_n\n0;1,005\n1;999\n", "thrust_n = '1,005' in row 1 may be 1.005 or 1005"),
        ("rotation_deg;thrust_n\n0;999\n1;1.005\n", "thrust_n = '1.005' in row 2 may be 1.005 or 1005"),
        ("rotation_deg;thrust_n\n" + "0;950,5\n" * 400 + "1;1.005\n", "thrust_n = '1.005' in row 401"),
        ("rotation_deg;thrust_n\n0;950,5\n1;1_000\n", "thrust_n = '1_000' in row 2"),
        ("rotation_deg,thrust_n\n0,True\n1,True\n", "thrust_n = 'True' in row 1"),
    ],
)
def test_a_number_that_may_be_thousands_is_refused(read, text, field):
    """Each was read, most as 1.005 N for 1005 N."""
    with pytest.raises(InputError, match=re.escape(field)):
        read(text)


def test_three_digits_behind_every_comma_are_decimals_and_said_to_be(read):
    record = read("rotation_deg;thrust_n\n0;1,005\n1;1,010\n")
    assert record.columns["thrust_n"].tolist() == [1.005, 1.01]
    assert record.remarks == ("Numbers of thrust_n such as 1,005 are read as 1.005: ',' is taken as the decimal sign.",)
    assert read("rotation_deg;thrust_n\n0,5;1,005\n1,5;2\n").remarks == ()  # 0,5 shows the sign


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("angle,winkel,thrust\n1,2,3\n", "'angle' or 'winkel' may be rotation_deg: choose one"),
        ("rotation_deg,thrust [psi]\n1,2\n", "unit of 'thrust .psi.' is not known; known are n, newton"),
        ("1,2\n3,4\n", "one line of column names"),
        ("rotation_deg,thrust_n\n1,2\n3,4,5\n", "rows of different length"),
        ("rotation_deg,thrust_n\n" + "1,2\n" * 400 + "3,4,5\n", "rows of different length"),
    ],
)
def test_what_cannot_be_read_is_named(read, text, message):
    with pytest.raises(InputError, match=message):
        read(text)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.text('0123456789.,;- \t\n\r"#eEnrothus_dgk[]()°µ\x1a', max_size=120))
def test_any_text_is_read_or_refused_without_a_warning(read, text):
    with suppress(InputError):
        columns = read("rotation_deg;thrust_n\n" + text).columns
        assert len({values.size for values in columns.values()}) <= 1


def test_tdms_files(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "record.tdms"
    with nptdms.TdmsWriter(path) as writer:
        head = nptdms.RootObject({"Joint angle": "8 deg"})
        force = nptdms.ChannelObject(
            "rig", "Axial force", np.array([1.25, -2.0]), {"unit_string": "kN", "wf_increment": 0.1}
        )
        angle = nptdms.ChannelObject(
            "rig", "Shaft angle", np.array([0.5, 1.5]), {"unit_string": "deg", "wf_increment": 0.1}
        )
        writer.write_segment([head, force, angle])
    record = read_record(path)
    assert record.columns["thrust_n"].tolist() == [1250.0, -2000.0]
    assert record.columns["time_s"].tolist() == [0.0, 0.1]
    assert record.notes == ("Joint angle: 8 deg",)
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="TDMS"):
        read_record(path)


def test_tdms_channels_may_be_true_or_false_and_time_stamps(tmp_path):
    """Regression: both were left out, and the record was refused for want of a tachometer or of times."""
    nptdms = pytest.importorskip("nptdms")
    channels = {
        "Axial force": np.array([1.25, -2.0]),
        "Tacho": np.array([True, False]),
        "Time": np.datetime64("2024-03-10T10:00:00") + np.array([0, 250], "timedelta64[ms]"),
    }
    with nptdms.TdmsWriter(tmp_path / "record.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("rig", name, values) for name, values in channels.items()])
    columns = read_record(tmp_path / "record.tdms").columns
    assert columns["tacho"].tolist() == [1.0, 0.0]
    assert columns["time_s"] == pytest.approx([0.0, 0.25], abs=1e-6)


@pytest.mark.parametrize(
    ("timing", "refused"),
    [
        (
            {"wf_increment": 0.12},
            "'Axial force' and 'Tacho' were sampled at different times: every 0.1 s and every 0.12 s",
        ),
        ({"wf_increment": 0.1, "wf_start_offset": 0.2}, r"the second from \+0.2 s on"),
        ({"wf_increment": 0.1, "wf_start_time": np.datetime64(-1, "s")}, "the second from -1 s on"),
        ({"wf_increment": 0.1, "wf_start_offset": 0.01}, ""),
        ({"wf_increment": "0.1 s", "wf_start_offset": "none"}, ""),  # regression: an internal error
    ],
)
def test_tdms_channels_of_other_times_are_refused(tmp_path, timing, refused):
    """Regression: a force of 41.4 N was 2 N beside a tachometer at another rate, and the phase of one of another start.

    A slow channel in front gave all of them its increment.
    """
    nptdms = pytest.importorskip("nptdms")
    channels = {
        "Torque": (np.full(2, 50.0), {"wf_increment": 5.0}),
        "Axial force": (np.arange(10.0), {"wf_increment": 0.1, "wf_start_time": np.datetime64(0, "s")}),
        "Tacho": (np.arange(10.0), {"wf_start_time": np.datetime64(0, "s")} | timing),
    }
    with nptdms.TdmsWriter(tmp_path / "record.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("rig", name, *each) for name, each in channels.items()])
    if refused:
        with pytest.raises(InputError, match=refused):
            read_record(tmp_path / "record.tdms")
    else:
        assert read_record(tmp_path / "record.tdms").columns["time_s"][1] == pytest.approx(0.1)


def test_an_mdf_file_is_named(tmp_path):
    (tmp_path / "record.mf4").write_bytes(b"MDF     4.10    ")
    with pytest.raises(InputError, match="MDF file is not read: export its channels"):
        read_record(tmp_path / "record.mf4")


def test_a_pipe_is_no_record(tmp_path):
    """Nobody writes to it: reading it would wait for ever."""
    os.mkfifo(tmp_path / "record.csv")
    with pytest.raises(InputError, match="pipe"):
        read_record(tmp_path / "record.csv")


def test_a_table_of_very_many_columns_is_refused_before_it_is_taken_apart(read):
    """Regression: 100,000 columns took 16 s of the server."""
    for many in (600, 100_000):
        row = ",".join(["1.5"] * many)
        names = ",".join(f"c{number}" for number in range(many))
        started = time.process_time()
        with pytest.raises(InputError, match="more than 500 columns"):
            read(f"{names}\n{row}\n{row}\n")
        assert time.process_time() - started < 2


@pytest.mark.parametrize("names", ["Rotation deg Force N Torque Nm", "Angle Axial force Torque"])
def test_names_that_spaces_do_not_tell_apart_are_refused(read, names):
    """Regression: the third word was the name of the third column, so that torques were compared as the thrust."""
    with pytest.raises(InputError, match="words above 3 columns, and spaces do not say which name whose"):
        read(f"{names}\n0.5 1.25 50\n1.5 -2 50\n")


@pytest.mark.parametrize(
    ("heading", "factor"),
    [
        ("Thrust (mN)", 1e-3),
        ("Thrust_mN", 1e-3),
        ("Thrust mN", 1e-3),
        ("Thrust [mN]", 1e-3),
        ("Thrust (kips)", 4448.2216152605),
        ("Thrust kips", 4448.2216152605),
        ("Axial force [kN] filtered", 1e3),
        ("Axial force [daN] (raw)", 10),
        ("Axial force kN (CH3)", 1e3),
        ("Axial force (kN) CH3", 1e3),
        ("axial_force_kN_filt", 1e3),
        ("Thrust-kN", 1e3),
        ("Thrust {lbf}", 4.4482216152605),
        ("kN Axial force", 1e3),
        ("[kN] Axial force", 1e3),
        ("(lbf) Axial force", 4.4482216152605),
        ("Axial force (left)", 1),
        ("Axial force (Kanal 3)", 1),
        ("Axialkraft (Kraftmessdose 2)", 1),
        ("Axialkraft Gehäuse links", 1),
    ],
)
def test_units_of_the_force(read, heading, factor):
    assert read(f"{heading},rotation_deg\n1.25,0.5\n-2,1.5\n").columns["thrust_n"] == pytest.approx(
        [1.25 * factor, -2 * factor]
    )


@pytest.mark.parametrize(
    ("heading", "role", "factor"),
    [
        ("Time [ms] rel", "time_s", 1e-3),
        ("Time minutes", "time_s", 60),
        ("Angle rad (CH1)", "rotation_deg", 57.29577951308232),
        ("Speed [rad/s] mean", "speed_rpm", 9.549296585513721),
        ("Torque [lbf ft] mean", "torque_n_m", 1.3558179483314),
        ("Torque min (CH1)", "torque_n_m", 1),
        ("Joint angle rad, set", "joint_angle_deg", 57.29577951308232),
    ],
)
def test_a_unit_within_a_heading_counts(heading, role, factor):
    """Regression: values in another unit were read as ours in silence."""
    assert unit_factor(role, heading) == pytest.approx(factor)


@pytest.mark.parametrize(
    "heading",
    [
        "Thrust (oz)",
        "Thrust (MN)",
        "Thrust [MN]",
        "Thrust (tf)",
        "Thrust (V)",
        "Thrust V",
        "Thrust_mV",
        "Thrust (N/10)",
        "Thrust [V] raw",
        "Thrust [%] (CH2)",
        "Thrust lb",
    ],
)
def test_a_unit_that_is_not_known_is_refused(read, heading):
    """Each was read as newtons."""
    with pytest.raises(InputError, match=r"the unit of .* is not known; .* names another one"):
        read(f"{heading},rotation_deg\n1.25,0.5\n-2,1.5\n")
    assert read(f"{heading},rotation_deg\n1.25,0.5\n", {"thrust_n": f"{heading} [kN]"}).columns["thrust_n"] == 1250


@pytest.mark.parametrize(
    "heading", ["Axial force [N] / 1000", "Axial force N x 100", "Thrust 10^3 N", "Thrust [N]*10", "Thrust/1000"]
)
def test_a_factor_beside_the_unit_is_refused(read, heading):
    """Each was read as newtons."""
    with pytest.raises(InputError, match=r"may be a factor of the values; .* names the unit"):
        read(f"{heading},rotation_deg\n1.25,0.5\n-2,1.5\n")
    assert read(f"{heading},rotation_deg\n1.25,0.5\n", {"thrust_n": f"{heading} [kN]"}).columns["thrust_n"] == 1250


def test_the_option_of_a_message_can_be_typed(read):
    """Regression: a shell took the brackets of --column thrust_n=Axial force (oz) [UNIT] for its own."""
    heading = "Axial force (oz)"
    with speaking_of_options(), pytest.raises(InputError) as refused:
        read(f"{heading},rotation_deg\n1.25,0.5\n-2,1.5\n")
    words = shlex.split(str(refused.value).partition("; --column ")[2].replace("UNIT", "kN"))
    role, _, named = words[0].partition("=")
    assert read(f"{heading},rotation_deg\n1.25,0.5\n-2,1.5\n", {role: named}).columns["thrust_n"][0] == 1250


@pytest.mark.parametrize(
    "headings",
    ["Generated axial force 2 [N],Axial force 1 [N]", "CH1 axial force [N],Force [N]", "Axial force 1,Axial force 2"],
)
def test_of_two_columns_that_may_be_the_force_none_is_chosen(read, headings):
    """Regression: the one whose heading shared more letters with a name was taken."""
    with pytest.raises(InputError, match="may be thrust_n: choose one"):
        read(f"{headings},rotation_deg\n2.5,1.25,0.5\n-4,-2,1.5\n")


@pytest.mark.parametrize("heading", ["Axial force trigger", "Thrust at torque [N]", "Axial force target [N]"])
def test_a_heading_that_names_two_quantities_is_none_of_them(read, heading):
    """Regression: that of the longer word was taken, a trigger for the force."""
    assert read(f"{heading},CH3,rotation_deg\n2.5,1.25,0.5\n-4,-2,1.5\n").columns.keys() == {"rotation_deg"}


@pytest.mark.parametrize("heading", ["n", "N", "M", "last", "theta [deg]"])
def test_a_short_name_without_its_unit_is_no_operating_point(read, heading):
    """Regression: the number of the sample was the speed, the rotation the joint angle."""
    assert read(f"{heading},thrust_n,rotation_deg\n1,1.25,0.5\n2,-2,1.5\n").columns.keys() == {
        "thrust_n",
        "rotation_deg",
    }
    assert "speed_rpm" in read("n [1/min],thrust_n,rotation_deg\n600,1.25,0.5\n600,-2,1.5\n").columns


@pytest.mark.parametrize("heading", ["Axial force RMS [N]", "Axial force setpoint [N]", "Max axial force (N)"])
def test_a_column_that_is_no_signal_is_not_taken_for_it(read, heading):
    """Regression: the setpoint was the thrust where the sensor had another name."""
    record = read(f"{heading},rotation_deg,CH3\n120,0.5,1.25\n120,1.5,-2\n")
    assert set(record.columns) == {"rotation_deg"}
    assert read(f"{heading},rotation_deg\n120,0.5\n", {"thrust_n": heading}).columns["thrust_n"].tolist() == [120]


def test_long_headings_and_long_beginnings_take_no_long_time(read):
    """A heading of 3,000 spaces took 53 s for each name that was looked for."""
    began = time.process_time()
    with pytest.raises(InputError, match="a heading of more than 200 characters"):
        read(f"thrust [{3000 * ' '}x,rotation_deg\n1,2\n")
    with pytest.raises(InputError, match="no row of numbers in the first 300 lines"):
        read("\n".join([*20_000 * [f"thrust [{80 * ' '}x,rotation_deg"], "1,2", "2,3"]))
    assert time.process_time() - began < 5


@pytest.mark.slow
def test_many_long_headings_take_no_time(tmp_path):
    """The time to look for units in them must not grow with their square."""
    headings = ["time_s", "thrust_n", "rotation_deg", *("a-" * 98 + str(place) for place in range(490))]
    rows = [",".join(map(str, range(len(headings))))] * 3
    (tmp_path / "wide.csv").write_text("\n".join([",".join(headings), *rows]))
    started = time.process_time()
    read_record(tmp_path / "wide.csv")
    assert time.process_time() - started < 5
