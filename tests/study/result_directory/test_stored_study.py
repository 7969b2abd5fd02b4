"""Result directories are read by themselves: no function is imported, and nothing outside of them is opened."""

from __future__ import annotations

import shutil
import sqlite3
import sys

import pytest

import tripod_doe as td
from tripod_doe.cli.main import main
from tripod_doe.errors import InputError
from tripod_doe.files.checksum_list import write_listed as replace_text
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.journal import STUDY as STUDY_TEXT
from tripod_doe.study.journal import Journal, text_digest
from tripod_doe.study.result_directory import directory
from tripod_doe.study.result_directory.stored_study import stored_study, texts_of_study

pytestmark = pytest.mark.usefixtures("charts_not_drawn")

FUNCTION = """
def f(x, scale=0.5, mode="sum", often=3, strict=True):
    return {"y": scale * x * often if mode == "sum" else x, "z": [x, x + 1]}
"""
STUDY = '[study]\nname = "s"\nfunction = "{}:f"\n[base]\nmode = "sum"\n[factors.x]\nvalues = [1.0, 2.0, 3.0]\n'


@pytest.fixture
def results(tmp_path):
    """The results of a function, whose cube is gone, so that its points are read from the journal."""
    module = f"told_{tmp_path.name.replace('-', '_')}"
    (tmp_path / f"{module}.py").write_text(FUNCTION)
    (tmp_path / "s.toml").write_text(STUDY.format(module))
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    whole = td.open_cube(tmp_path / "out")
    (tmp_path / "out" / "cube.nc").unlink()
    yield tmp_path, module, whole
    sys.modules.pop(module, None)


def plant(folder, module):
    """Put code in the function's place that leaves a mark when it is imported."""
    mark = folder / "imported"
    (folder / f"{module}.py").write_text(f"import pathlib\npathlib.Path({str(mark)!r}).touch()\n{FUNCTION}")
    sys.modules.pop(module, None)
    return mark


def test_points_of_a_function_are_shown_without_it(results, capsys):
    folder, module, whole = results
    mark = plant(folder, module)
    shown = td.open_cube(folder / "out")
    assert shown.drop_attrs().identical(whole.drop_attrs())
    assert shown["scale"].attrs == whole["scale"].attrs if "scale" in whole else True
    assert main(["query", str(folder / "out"), "--variable", "y", "--select", "x=2", "--format", "csv"]) == 0
    assert "3.0" in capsys.readouterr().out
    assert main(["report", str(folder / "out")]) == 0
    assert not mark.exists()


def test_a_function_without_a_record_is_not_imported_either(results):
    folder, module, _ = results
    mark = plant(folder, module)
    with sqlite3.connect(folder / "out" / "journal.sqlite") as journal:
        journal.execute("DELETE FROM note WHERE key = 'function'")
    journal.close()
    assert list(stored_study(folder / "out").simulator.parameters) == ["mode", "x"]
    assert not mark.exists()


def test_a_function_that_is_not_imported_does_not_run(results):
    folder, *_ = results
    study = stored_study(folder / "out")
    with pytest.raises(InputError, match="its function is not loaded to read results"):
        study.simulator.simulate({}, ())


def test_a_study_that_grows_is_held_against_the_old_one_without_importing_its_function(results):
    """The study file in a directory may be a stranger's, and name another function than that of the run."""
    folder, module, _ = results
    mark = plant(folder, f"{module}_other")
    stored = folder / "out" / "study.toml"
    stored.write_text(stored.read_text().replace(f"{module}:f", f"{module}_other:f"))
    (folder / "s.toml").write_text(STUDY.format(module).replace("3.0]", "4.0]"))
    with pytest.raises(InputError, match="damaged or edited"):
        td.run(folder / "s.toml", folder / "out", workers=0, progress=False)
    assert not mark.exists()


def test_points_of_a_table_are_shown_without_it(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "points.csv").write_text("joint_angle_deg,torque_n_m\n3,20\n9,40\n")
    text = '[study]\nname = "t"\n[base]\nmodel = "equilibrium"\n[design]\nkind = "table"\ntable = "tables/points.csv"\n'
    (tmp_path / "t.toml").write_text(text + '[keep]\noutputs = ["thrust_rms"]\n')
    td.run(tmp_path / "t.toml", tmp_path / "out", workers=0, progress=False)
    whole = td.open_cube(tmp_path / "out")
    (tmp_path / "out" / "cube.nc").unlink()
    shutil.rmtree(tmp_path / "tables")
    shutil.move(tmp_path / "out", tmp_path / "elsewhere")
    assert td.open_cube(tmp_path / "elsewhere").drop_attrs().identical(whole.drop_attrs())
    shutil.rmtree(tmp_path / "elsewhere" / "tables")
    with pytest.raises(InputError, match=r"table = 'tables/points\.csv': no copy of it .* run the study again"):
        td.open_cube(tmp_path / "elsewhere")


def test_a_table_of_stored_results_leads_nowhere_else(tmp_path):
    (tmp_path / "t.csv").write_text("joint_angle_deg\n3\n")
    (tmp_path / "t.toml").write_text('[study]\nname = "t"\n[design]\nkind = "table"\ntable = "t.csv"\n')
    load_study(tmp_path / "t.toml")
    (out := tmp_path / "out").mkdir()
    for name in ("/etc/passwd", "../t.csv", "t.csv"):
        (out / "study.toml").write_text((tmp_path / "t.toml").read_text().replace("t.csv", name))
        with pytest.raises(InputError, match="no copy of it"):
            make_points(stored_study(out))


@pytest.mark.parametrize("name", ["points.csv", "../elsewhere/points.csv"])
def test_a_study_with_a_table_needs_only_its_result_directory(tmp_path, capsys, name):
    """It runs again, and goes elsewhere as texts, when the file of its points is gone."""
    (tmp_path / "own").mkdir()
    (tmp_path / "elsewhere").mkdir()
    study, table, out = tmp_path / "own" / "s.toml", tmp_path / "own" / name, tmp_path / "out"
    table.write_text("joint_angle_deg,torque_n_m\n4,60\n8,120\n")
    design = f'[design]\nkind = "table"\ntable = "{name}"\n[keep]\noutputs = ["thrust_amplitude"]\n'
    factors = "[factors.joint_angle_deg]\n[factors.torque_n_m]\n"
    study.write_text(f'[study]\nname = "t"\n[base]\nmodel = "equilibrium"\n{factors}{design}')
    td.run(study, out, workers=0, progress=False)
    table.unlink()
    assert main(["run", str(out / "study.toml"), "--out", str(out), "--workers", "0"]) == 0
    assert "2 reused" in capsys.readouterr().err
    text, tables = texts_of_study(out)
    (tmp_path / "upload").mkdir()
    for plain, content in {"study.toml": text, **tables}.items():
        (tmp_path / "upload" / plain).write_text(content + ("12,90\n" if plain != "study.toml" else ""))
    larger = tmp_path / "upload" / "study.toml"
    assert make_points(load_study(larger, StudyFolder.of(larger, untrusted=True))).count == 3
    assert main(["run", str(larger), "--out", str(out), "--workers", "0"]) == 0
    assert "1 point computed" in capsys.readouterr().err


UNREAD = '[study]\nname = "s"\n[base]\nmodel = "equilibrium"\n[factors.joint_angle_deg]\nvalues = [4, 8]\n'


def test_a_study_that_ran_goes_on_in_spite_of_keys_that_nothing_reads(tmp_path, capsys):
    """Regression: runs of versions that did not refuse such keys could not be resumed."""
    (tmp_path / "s.toml").write_text(UNREAD)
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    old = UNREAD + "[design]\nseed = 3\n"
    (tmp_path / "s.toml").write_text(old)
    assert main(["run", str(tmp_path / "s.toml"), "--out", str(tmp_path / "out"), "--workers", "0"]) == 2
    assert "seed: not used by kind" in capsys.readouterr().err
    with Journal(tmp_path / "out") as journal:
        journal.remember({STUDY_TEXT: text_digest(old.encode())})
    replace_text(tmp_path / "out" / "study.toml", old)
    assert main(["run", str(tmp_path / "s.toml"), "--out", str(tmp_path / "out"), "--workers", "0"]) == 0


@pytest.mark.slow
def test_the_study_of_a_directory_is_edited_there(tmp_path, capsys):
    """Regression: run with it, it was called damaged, and nobody had its old text. A flipped digit is refused."""
    (tmp_path / "s.toml").write_text(UNREAD)
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    stored = tmp_path / "out" / "study.toml"
    again = ["run", str(stored), "--out", str(tmp_path / "out"), "--workers", "0"]
    assert main(again) == 0
    stored.write_text(UNREAD.replace("[4, 8]", "[4, 9]"))
    assert main(again) == 2
    assert "factors.joint_angle_deg.values: [4, 8] -> [4, 9]" in capsys.readouterr().err
    stored.write_text(UNREAD.replace("[4, 8]", "[4, 8, 9]"))
    copy = shutil.copytree(tmp_path / "out", tmp_path / "copy")
    assert main(again) == 0
    assert f"{stored}: edited since it ran: factors.joint_angle_deg.values" in (said := capsys.readouterr().err)
    assert "1 point computed" in said
    assert td.open_cube(tmp_path / "out").sizes["joint_angle_deg"] == 3
    (copy / "cube.nc").unlink()  # the only other place of the old text
    assert main(["run", str(copy / "study.toml"), "--out", str(copy), "--workers", "0"]) == 2
    assert "study.toml: damaged or edited" in capsys.readouterr().err


@pytest.mark.usefixtures("pages_not_made")
@pytest.mark.parametrize("after", [0, 1])
def test_a_kill_while_the_study_is_replaced_leaves_a_directory_that_is_read(tmp_path, monkeypatch, capsys, after):
    """Regression: the journal knew the new study, and the old one beside it was called damaged."""
    (tmp_path / "s.toml").write_text(UNREAD)
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    (tmp_path / "s.toml").write_text(UNREAD.replace("[4, 8]", "[4, 8, 9]"))
    words = ["run", str(tmp_path / "s.toml"), "--out", str(tmp_path / "out"), "--workers", "0"]

    def killed(path, text):
        if after:
            replace_text(path, text)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(directory, "replace_text", killed)
        assert main(words) == 130
    angles = [4, 8, 9] if after else [4, 8]
    assert td.open_cube(tmp_path / "out")["joint_angle_deg"].values.tolist() == angles
    assert main(words) == 0
    assert "1 point computed" in capsys.readouterr().err
    assert td.open_cube(tmp_path / "out").sizes["joint_angle_deg"] == 3
