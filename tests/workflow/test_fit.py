"""Fits from files to answers: hidden frictions come back, a kill costs nothing, bad records and failures are named."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.analyses.fit.fit_file import load_fit
from tripod_doe.analyses.fit.problem import FitProblem
from tripod_doe.analyses.fit.sentences import find_in_fit
from tripod_doe.cli.main import main
from tripod_doe.errors import InputError
from tripod_doe.files.checksum_list import LIST
from tripod_doe.study.cube.netcdf import write_dataset
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.result_directory.directory import ResultDirectory
from tripod_doe.workflow import fit as fit_module
from tripod_doe.workflow.fit_plan import evaluations, plan_fit
from tripod_doe.workflow.point_batches import PointBatches
from tripod_doe.workflow.steps_file import found_sentences

pytestmark = pytest.mark.usefixtures("charts_not_drawn")

MEASUREMENTS = Path(__file__).parents[2] / "measurements"
sys.path.append(str(MEASUREMENTS))
import make_rig  # noqa: E402

TRUTH = {"groove_sliding_friction": 0.075, "needle_sliding_friction": 0.055}
HEAD = """
[fit]
name = "two frictions"
look_for = "low > 0.07 and verdict == 'found'"
model_error = 0
starts = 1
[base]
model = "equilibrium"
"""
UNKNOWNS = """
[unknowns.groove_sliding_friction]
low = 0.02
high = 0.15
[unknowns.needle_sliding_friction]
low = 0.01
high = 0.1
scale = "log"
"""
RECORDS = """
[records]
table = "records.csv"
orders = [3]
"""
NEXT = """
[next]
narrow = "needle_sliding_friction"
[next.at.joint_angle_deg]
values = [4, 8, 12]
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    make_rig.make_rig(folder, TRUTH, "equilibrium")
    return folder


@pytest.fixture
def written(rig, tmp_path):
    """A fit file beside a copy of the records."""

    def write(text):
        folder = tmp_path / "rig"
        if not folder.exists():
            shutil.copytree(rig, folder)
        (folder / "fit.toml").write_text(text)
        return folder / "fit.toml"

    return write


@pytest.fixture(scope="module")
def fitted(rig, tmp_path_factory):
    (rig / "fit.toml").write_text(HEAD + UNKNOWNS + RECORDS + NEXT)
    out = tmp_path_factory.mktemp("fit")
    return out, td.fit(rig / "fit.toml", out, workers=0, progress=False)


def test_hidden_frictions_come_back(fitted):
    """Exact physics: the records are of the same model; noise of 2 % in 576 samples leaves these intervals."""
    fit = xr.open_dataset(fitted[0] / "fit.nc")
    for name, truth in TRUTH.items():
        own = fit.sel(unknown=name)
        assert float(own["low"]) < truth < float(own["high"])
        assert str(own["verdict"].item()) == "found"
    assert float(fit["value"].sel(unknown="groove_sliding_friction")) == pytest.approx(0.075, rel=0.01)
    assert fit["correlation"].dims == ("unknown", "unknown_2")
    assert float(fit["correlation"].sel(unknown="needle_sliding_friction", unknown_2="groove_sliding_friction")) < -0.5
    assert fit["measured"].dims == fit["fitted"].dims == fit["residual"].dims == ("record", "order")
    assert np.allclose(fit["measured"] - fit["fitted"], fit["residual"])
    assert (np.abs(fit["residual"]) < 3 * fit["measured_error"]).all()
    assert fit["next"].dims == ("candidate",)
    assert (fit["next"] <= 1.0).all()


def test_records_are_grouped_by_an_operating_value(written):
    """Regression: a column of the table that is a parameter was "no column of the table"."""
    unknowns = UNKNOWNS.replace('scale = "log"', 'per = "speed_rpm"')
    layout = FitProblem(load_fit(written(HEAD + unknowns + RECORDS))).layout
    speeds = dict.fromkeys(speed for _, _, speed in make_rig.POINTS)
    assert layout.groups == ("", *(f"speed_rpm {speed}" for speed in speeds))


@pytest.mark.slow
def test_minos_ends_the_intervals_of_a_rig_where_a_fit_does(written, tmp_path):
    """Referee: iminuit's MINOS on the whole covariance, where the fit has nuisances; ends to 2 % of a half width.

    Beside free markers only amplitudes count. A given error of the model is alike in all records, and half of its square
    is in each alone.
    """
    iminuit = pytest.importorskip("iminuit")
    file = written(HEAD.replace("model_error = 0", "model_error = 0.005") + UNKNOWNS + RECORDS)
    fit = td.fit(file, tmp_path / "out", workers=0, progress=False).result
    measured, chance, model = (fit[name].values[:, 0] for name in ("measured", "measured_error", "model_error"))
    chance, model = chance / 1.96, model / 1.96
    weights = np.linalg.inv(np.diag(chance**2 + model**2 / 3) + 2 / 3 * np.outer(model, model))
    operating = {name: fit[name].values for name in make_rig.OPERATING}
    simulator = load_simulator("joint")

    def chi_squared(groove, needle):
        values = {"groove_sliding_friction": groove, "needle_sliding_friction": np.exp(needle)}
        columns = operating | {name: np.full(measured.size, value) for name, value in values.items()}
        columns["model"] = np.array(["equilibrium"] * measured.size, object)
        block = simulator.simulate(simulator.columns({}, columns, measured.size), ("thrust_amplitude",))
        off = measured - block.outputs["thrust_amplitude"].data[:, 3]
        return off @ weights @ off

    value, low, high = ([float(fit[name][at]) for at in (0, 1)] for name in ("value", "low", "high"))
    minuit = iminuit.Minuit(chi_squared, groove=value[0], needle=np.log(value[1]))
    minuit.errors = ((high[0] - low[0]) / 4, np.log(high[1] / low[1]) / 4)
    minuit.errordef = float(fit.attrs["growth_at_ends"])
    minuit.migrad()
    minuit.minos()
    for name, ends in (("groove", (low[0], high[0])), ("needle", (np.log(low[1]), np.log(high[1])))):
        error = minuit.merrors[name]
        assert np.subtract(ends, minuit.values[name]) == pytest.approx(
            [error.lower, error.upper], abs=0.02 * error.upper
        )


def test_what_it_leaves_in_its_directory(fitted, capsys):
    out = fitted[0]
    page = (out / "report" / "index.html").read_text()
    assert "What to measure next" in page
    assert main(["query", str(out), "--variable", "verdict", "--format", "json"]) == 0
    assert [row["verdict"] for row in json.loads(capsys.readouterr().out)] == ["found", "found"]
    assert main(["check", str(out)]) == 0
    assert main(["report", str(out)]) == 0
    capsys.readouterr()
    base = out.parent / "study.toml"
    base.write_text(
        '[study]\nname = "pasted"\n' + (out / "base.toml").read_text() + "[factors.torque_n_m]\nvalues = [50]\n"
    )
    pasted = td.load_study(base)
    assert pasted.base["groove_sliding_friction"] == pytest.approx(0.075, rel=0.01)
    tolerance = td.load_study(out / "tolerance.toml")
    assert list(tolerance.factors) == list(TRUTH)


@pytest.mark.parametrize(
    "name", first_fast(["base.toml", "tolerance.toml", "fit.toml", "report/index.html", "steps.json"], 2)
)
def test_a_flipped_bit_in_its_files_is_named(fitted, tmp_path, capsys, name):
    """Regression: texts had no checksum, and base.toml went into the page, the service and the next study as it was."""
    path = shutil.copytree(fitted[0], tmp_path / "copy") / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert main(["check", str(tmp_path / "copy")]) == 3
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("damaged"))
    assert f"{path}: damaged or edited" in line
    code = main(["report", str(tmp_path / "copy")])
    assert code == (2 if name == "base.toml" else 0)  # the page quotes it
    assert main(["check", str(path)]) == (0 if name.startswith("report") else 3)


@pytest.mark.parametrize("name", ["fit.nc", "base.toml", "report"])
def test_files_of_another_fit_are_refused(fitted, tmp_path, capsys, name):
    """Regression: copied with their checksums they were shown in silence, and check called them whole."""
    mine, other = (shutil.copytree(fitted[0], tmp_path / name) for name in ("mine", "other"))
    for path in other.rglob(LIST):
        path.write_text(re.sub("of directory .*", "of directory 7", path.read_text()))
    assert main(["check", str(other)]) == 0
    if name == "report":
        shutil.copytree(other / name, mine / name, dirs_exist_ok=True)
    else:
        for copied in (name, LIST):
            shutil.copy(other / copied, mine / copied)
        with pytest.raises(td.CubeError, match="files of another directory were copied here"):
            td.open_cube(mine)
        assert main(["report", str(mine)]) == 2
    assert main(["check", str(mine)]) == 3
    assert "files of another directory were copied here" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["title", "question", "source", "fit", "model", "model_error_source"])
def test_a_result_that_another_program_wrote_is_said(fitted, tmp_path, capsys, text):
    """Regression: a text that is missing, or is no text, was an internal error."""
    with td.open_cube(fitted[0]) as fit:
        strange = fit.assign_attrs({text: 1.5})
    write_dataset(strange, tmp_path / "fit.nc")
    assert main(["report", str(tmp_path)]) == 2
    assert f"the attribute {text} holds no text" in capsys.readouterr().err


def test_records_beyond_the_range_of_the_model_are_counted(fitted):
    """Regression: `simulate` called such points doubtful, and a fit said nothing of them."""
    fit = fitted[1].result
    friction = float(fit["value"].sel(unknown="needle_sliding_friction"))
    outside = friction / np.radians(fit["joint_angle_deg"].values) > 0.2
    (line,) = (line for line in fit.attrs["remarks"].splitlines() if "needle_ratio" in line)
    count, first = int(outside.sum()), fit["record"].values[outside.argmax()]
    assert f"equilibrium is outside its valid range at {count} of {outside.size} records, the first {first}: " in line
    assert line in find_in_fit(fit)


def test_one_page_of_a_fit_is_refused(fitted, capsys):
    """Regression: it was an internal error."""
    assert main(["report", str(fitted[0]), "--format", "html"]) == 2
    assert f"its studies are folders of {fitted[0] / 'steps'}" in capsys.readouterr().err


def test_formulas_are_refused_by_a_fit(fitted, tmp_path, capsys):
    file = tmp_path / "formulas.toml"
    file.write_text('[responses.r]\nformula = "2 * thrust_amplitude[3]"\n')
    assert main(["derive", str(fitted[0]), str(file)]) == 2
    points = fitted[0] / "steps" / "points"
    assert f"name the result directory of a study, as {points}\n" in capsys.readouterr().err


def test_the_unknowns_that_it_looks_for(fitted, written):
    assert fitted[1].found == found_sentences(fitted[0])
    assert fitted[1].found == (
        "1 of 2 unknowns meets low > 0.07 and verdict == 'found'; the first at unknown = groove_sliding_friction."
    )
    with pytest.raises(InputError, match=r"\[fit\]: look_for: .*unknown name 'lo'; did you mean"):
        load_fit(written((HEAD + UNKNOWNS + RECORDS).replace("low > 0.07", "lo > 0.07")))


@pytest.mark.slow
def test_a_kill_loses_no_point_and_changes_nothing(fitted, rig, tmp_path, monkeypatch):
    """Invariance: stopped in the middle, run again, the result is the same, and no point is computed twice."""
    (rig / "again.toml").write_text(xr.open_dataset(fitted[0] / "fit.nc").attrs["fit"])
    whole = PointBatches._compute

    def stopped(self, asked, missing):
        whole(self, asked, missing)
        if self.computed > 300:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(PointBatches, "_compute", stopped)
        with pytest.raises(KeyboardInterrupt):
            td.fit(rig / "again.toml", tmp_path / "out", workers=0, progress=False)
    assert not (tmp_path / "out" / "fit.nc").exists()
    page = fit_module.write_fit_page

    def written_while_held(directory, result):
        with pytest.raises(InputError, match="is writing here"):  # no other fit begins until the page is there
            ResultDirectory(directory / "steps" / "points")
        page(directory, result)

    monkeypatch.setattr(fit_module, "write_fit_page", written_while_held)
    again = td.fit(rig / "again.toml", tmp_path / "out", workers=0, progress=False)
    assert again.reused > 300
    assert again.computed + again.reused == fitted[1].computed
    first, second = (xr.open_dataset(path / "fit.nc") for path in (fitted[0], tmp_path / "out"))
    xr.testing.assert_identical(first.drop_attrs(), second.drop_attrs())


@pytest.mark.slow
def test_a_record_that_does_not_fit_is_left_out_and_named(written, tmp_path):
    file = written(HEAD + UNKNOWNS + RECORDS)
    bad = file.parent / "record_3.csv"
    head, *rows = bad.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    bad.write_text("\n".join([head, *(f"{t},{a},{1.3 * float(f):.3f}" for t, a, f in cells), ""]))
    result = td.fit(file, tmp_path / "out", workers=0, progress=False).result
    assert result["record"].values[result["left_out"].values == 1].tolist() == ["record_3.csv"]
    own = result.sel(unknown="groove_sliding_friction")
    assert float(own["low"]) < 0.075 < float(own["high"])
    assert "record_3.csv" in (tmp_path / "out" / "report" / "index.html").read_text()


def test_records_lie_beside_their_table(written, tmp_path):
    file = written(HEAD + UNKNOWNS + RECORDS)
    above = file.parent.parent / "fit.toml"
    above.write_text(file.read_text().replace("records.csv", "rig/records.csv"))
    assert main(["plan", str(above), "--no-timing"]) == 0


@pytest.mark.parametrize("again", ["record_1.csv", "copy.csv"])
def test_a_record_that_would_count_twice_is_refused(written, again):
    """Before, its intervals were too short by the root of two."""
    file = written(HEAD + UNKNOWNS + RECORDS)
    (file.parent / "copy.csv").write_bytes((file.parent / "record_1.csv").read_bytes())
    table = file.with_name("records.csv")
    first = table.read_text().splitlines()[1].partition(",")[2]
    table.write_text(f"{table.read_text().rstrip()}\n{again},{first}\n")
    with pytest.raises(InputError, match=rf"{again}: the same record as .*record_1.csv, which would count twice"):
        plan_fit(file, timing=False)


@pytest.mark.parametrize(
    ("scale", "offset", "words"),
    [
        (0.0, 0.0, "its thrust has none of the fitted orders (3): nothing can be fitted to it"),
        (0.0, 5.0, "its thrust has none of the fitted orders (3): nothing can be fitted to it"),
        (1e300, 0.0, "at most 1e+09 N are read: check this column and its unit"),
    ],
)
def test_a_record_without_a_usable_thrust_is_named(written, capsys, scale, offset, words):
    """Regression: "none of 0 starting points has an answer", and a traceback from the overflow of squares."""
    file = written(HEAD + UNKNOWNS + RECORDS)
    record = file.parent / "record_2.csv"
    head, *rows = record.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    record.write_text("\n".join([head, *(f"{t},{a},{scale * float(f) + offset!r}" for t, a, f in cells), ""]))
    assert main(["plan", str(file), "--no-timing"]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "record_2.csv: " in said


def test_an_empty_cell_of_the_table_is_what_the_record_states(written):
    """Wrong before: "expected a number"."""
    file = written(HEAD + UNKNOWNS + RECORDS)
    table, record = file.with_name("records.csv"), file.with_name("record_1.csv")
    head, first, *rows = table.read_text().splitlines()
    name, angle, *others = first.split(",")
    table.write_text("\n".join([head, ",".join([name, "", *others]), *rows, ""]))
    with pytest.raises(InputError, match="its joint_angle_deg is not known"):
        plan_fit(file, timing=False)
    record.write_text(f"# Joint angle: {angle} deg\n{record.read_text()}")
    assert plan_fit(file, timing=False).records == 8


def test_true_is_no_sign(written):
    """Regression: it is equal to 1, and counted as that."""
    with pytest.raises(InputError, match=r"\[records\]: sign = true: expected a number"):
        load_fit(written(HEAD + UNKNOWNS + RECORDS + "sign = true\n"))


def test_a_value_that_other_records_have_is_not_assumed(written):
    """Regression: an empty cell took the middle of the values of the other records."""
    file = written(HEAD + UNKNOWNS + RECORDS)
    table = file.with_name("records.csv")
    rows = table.read_text().split()
    for name, message in (
        ("pitch_radius_mm", r"record_2\.csv: its pitch_radius_mm is not known, but other records have one"),
        ("pitch_radus_mm", "pitch_radus_mm would be a label; write pitch_radius_mm"),
        ("Torque [kNm]", r"Torque \[kNm\] would be a label; write torque_n_m"),
        ("speed", "speed would be a label; write speed_rpm"),
    ):
        cells = [name, "20", "", *["22"] * (len(rows) - 3)]
        table.write_text("\n".join(map(",".join, zip(rows, cells, strict=True))))
        with pytest.raises(InputError, match=message):
            plan_fit(file, timing=False)


@pytest.mark.slow
def test_an_unknown_of_each_record(written, tmp_path):
    """Each record may have its own value: that of the groove comes out the same in all, within its interval."""
    text = UNKNOWNS.partition("[unknowns.needle_sliding_friction]")[0] + 'per = "record"\n'
    result = td.fit(
        written(HEAD + "needle_sliding_friction = 0.055\n" + text + RECORDS),
        tmp_path / "out",
        workers=0,
        progress=False,
    ).result
    own = result.sel(unknown="groove_sliding_friction")
    assert own["value_of_record"].dims == ("record",)
    assert (own["low_of_record"] < 0.075 * 1.002).all()
    assert (own["high_of_record"] > 0.075 * 0.998).all()
    assert own["value_of_record"].values == pytest.approx(np.full(8, 0.075), rel=0.02)
    assert set(own["verdict_of_record"].values) == {"found"}
    assert np.isnan(own["value"])


@pytest.mark.slow
def test_what_records_do_not_tell_is_said(written, tmp_path):
    """Exact physics: the thrust goes with friction over pitch radius, so one record knows nothing but their ratio."""
    size = "[unknowns.pitch_radius_mm]\nlow = 19\nhigh = 24\n"
    base = "joint_angle_deg = 6\ntorque_n_m = 100\nneedle_sliding_friction = 0.055\n"
    groove = UNKNOWNS.partition("[unknowns.needle_sliding_friction]")[0]
    file = written(HEAD + base + groove + size + '[records]\nfiles = ["record_1.csv"]\norders = [3]\n')
    result = td.fit(file, tmp_path / "out", workers=0, progress=False).result
    assert result["verdict"].values.tolist() == ["combination", "combination"]
    (known,) = json.loads(result.attrs["combinations"])
    factors = {name: factor for name, _, factor in known["parts"]}
    slope = -factors["pitch_radius_mm"] / factors["groove_sliding_friction"]  # of friction over radius along the valley
    friction = float(result["value"].sel(unknown="groove_sliding_friction"))
    assert 0 < slope < 2 * friction / float(result["value"].sel(unknown="pitch_radius_mm"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("[unknowns.groove_sliding_friction]", "[unknowns.grove_sliding_friction]"),
            "did you mean 'groove_sliding_friction'",
        ),
        (("high = 0.15", "high = 0.01"), "low = 0.02 must be below high = 0.01"),
        (("orders = [3]", "orders = [3, 13]"), "rotating orders are 1 to 12"),
        (("orders = [3]", "oders = [3]"), "did you mean 'orders'"),
        (("orders = [3]", "orders = [3]\nwaveform = true"), "orders and waveform = true: give one of them"),
        (('scale = "log"', 'per = "joint"'), "per = 'joint'"),
        (("records.csv", "record.csv"), "cannot read"),
        (("orders = [3]", 'orders = [3]\ncolumns.thrust_n = "Kraft"'), "columns.thrust_n = 'Kraft': no such heading"),
        (('table = "records.csv"', 'files = ["nothing*.csv"]'), "no file has such a name"),
        (('model = "equilibrium"', 'model = "equilibrium"\nneedle_sliding_friction = 0.05'), "remove it from [base]"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(written, tmp_path, capsys, change, words):
    file = written((HEAD + UNKNOWNS + RECORDS).replace(*change))
    assert main(["fit", str(file), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert str(file) in said
    assert not (tmp_path / "out").exists()


def test_a_plan_prices_it(written, fitted, capsys):
    file = written(HEAD + UNKNOWNS + RECORDS + NEXT)
    assert main(["plan", str(file), "--no-timing"]) == 0
    said = capsys.readouterr().out
    assert "records      8" in said
    assert "2 numbers" in said
    assert "CPU time" in said
    planned, points = plan_fit(file, timing=False), xr.open_dataset(fitted[0] / "fit.nc").attrs["points"]
    assert 6 < planned.seconds[1] < 15, "imports, page and looks cost more than the points"
    assert points / 1.4 < planned.search_points < 1.4 * points
    assert planned.search_range[0] < points < planned.search_range[1]
    assert main(["run", str(file), "--out", "nowhere"]) == 2
    assert "tripod-doe fit" in capsys.readouterr().err


@pytest.mark.slow
def test_the_answer_of_the_documentation(tmp_path):
    """Regression: the table of docs/reference/fit.md, to a tenth of each interval; the hidden values lie in all intervals."""
    text = (MEASUREMENTS.parent / "docs" / "reference" / "fit.md").read_text()
    rows = text.partition("<!-- answer -->\n")[2].partition("\n\n")[0].splitlines()[2:]
    fit = td.fit(MEASUREMENTS / "rig" / "frictions.toml", tmp_path, workers=0, progress=False).result
    for row in rows:
        name, *numbers, word = (cell.strip(" `") for cell in row.strip("|").split("|"))
        value, low, high = map(float, numbers)
        own = fit.sel(unknown=name)
        assert [float(own[key]) for key in ("value", "low", "high")] == pytest.approx(
            [value, low, high], abs=0.1 * (high - low)
        )
        assert str(own["verdict"].item()) == word
        assert low < make_rig.TRUTH[name] < high


def test_a_search_without_reference_angle_begins_at_other_places_of_the_circle(written):
    """Exact: skews of 0.4, -0.3 and 0 deg, turned, with the third as it is known."""
    skews = "".join(f"[unknowns.initial_skew_{at}_deg]\nlow = -1\nhigh = 1\n" for at in (1, 2))
    place = np.array([0.7, 0.35])
    free = FitProblem(load_fit(written(HEAD + skews + RECORDS)))
    assert np.allclose(free.places_alike(place), [[0.15, 0.3], [0.65, 0.85]])
    known = FitProblem(load_fit(written(HEAD + skews + RECORDS + "reference_angle_deg = 0\n")))
    assert not known.places_alike(place)


def test_a_plan_counts_the_circle_and_both_kinds_of_needles(written):
    """Regression: 241 evaluations were planned; 67 fits took these, in benchmarks/RESULTS.md."""
    skews = "".join(f"[unknowns.initial_skew_{at}_deg]\nlow = -1\nhigh = 1\n" for at in (1, 2))
    head = HEAD.replace("= 0\nstarts = 1", '= "recorded"').replace("equilibrium", "kinetostatic")
    records = RECORDS.replace("[3]", "[2, 3]")
    for known, measured in (("", (192, 240, 660, 1009)), ("reference_angle_deg = 0\n", (156, 198, 321))):
        least, usual, most = evaluations(FitProblem(load_fit(written(head + UNKNOWNS + skews + records + known))))
        assert least < min(measured)
        assert max(measured) < most
        assert measured[1] / 2 < usual < 2 * measured[1]


def test_records_at_one_operating_point_with_an_unknown_each_are_priced_each(tmp_path):
    """Equal records were priced as one, though each has points of its own: forty times too cheap, past any limit."""
    for which in range(10):
        rows = "".join(f"{at},{(20 + which) * np.sin(np.radians(3 * at)):.4f}\n" for at in range(0, 360 * 6, 5))
        (tmp_path / f"rig_{which}.csv").write_text(f"rotation_deg,thrust_n\n{rows}")
    prices, points = {}, {}
    for per in ("all", "record"):
        (tmp_path / "fit.toml").write_text(
            '[fit]\nname = "x"\nstarts = 1\n[base]\nmodel = "needles"\njoint_angle_deg = 8\ntorque_n_m = 200\n'
            "speed_rpm = 600\n[unknowns.groove_sliding_friction]\nlow = 0.03\nhigh = 0.12\n"
            f'per = "{per}"\n[records]\nfiles = ["rig_*.csv"]\nreference_angle_deg = 0\n'
        )
        planned = plan_fit(tmp_path / "fit.toml", timing=False)
        prices[per], points[per] = planned.seconds[1], planned.search_points
    assert points["record"] > 9 * points["all"], "points of equal records are computed once, and were counted each"
    assert prices["record"] - 8 > 9 * (prices["all"] - 6), "6 to 8 s are beside the points"
