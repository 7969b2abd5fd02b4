"""What a run was to look for: the points that meet a condition, in a sentence for the end of the run."""

from __future__ import annotations

import json
import sys

import pytest

import tripod_doe as td
from tripod_doe.cli.main import main
from tripod_doe.errors import InputError
from tripod_doe.study.result_directory.latest_run import found_in

pytestmark = pytest.mark.usefixtures("pages_not_made")

STUDY = """
[study]
name = "map"
[base]
model = "equilibrium"
needle_count = 25
[factors.joint_angle_deg]
values = [2, 7, 13]
[factors.torque_n_m]
values = [-60, 90]
[responses.third]
formula = "thrust_amplitude[3]"
unit = "N"
[keep]
outputs = ["thrust_amplitude"]
[run]
look_for = "{}"
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """A study that has run: its directory and its file."""
    folder = tmp_path_factory.mktemp("found")
    (folder / "s.toml").write_text(STUDY.format("third > 1 and joint_angle_deg > 5"))
    return folder / "out", folder / "s.toml", td.run(folder / "s.toml", out=folder / "out", workers=0, progress=False)


def looked_for(out, condition, **words):
    out[1].write_text(STUDY.format(condition))
    return td.run(out[1], out=out[0], workers=0, progress=False).answers


@pytest.mark.slow
def test_the_points_that_meet_it_are_counted(out):
    """Exact: as many as `query` gives, and a changed condition runs no point again."""
    rows = td.query(out[0], "third", where="third > 1 and joint_angle_deg > 5")
    count = int(rows["selected"].sum())
    assert 0 < count < 6
    assert out[2].answers[0].startswith(f"{count} of 6 points meet third > 1 and joint_angle_deg > 5; the first at ")
    assert found_in(out[0]) == out[2].answers[0]
    assert looked_for(out, "max(thrust_amplitude) > 1e6") == ["No point meets max(thrust_amplitude) > 1e6."]
    assert found_in(out[0]).startswith("No point")
    assert looked_for(out, "thrust_amplitude > 1")[0].startswith("The condition of look_for failed: ")
    assert looked_for(out, "third > 1e9 or third <= 1e9")[0].startswith("6 of 6 points meet")


@pytest.mark.parametrize("text", ["thrid > 1", "third >", "__import__('os')", "third.real > 1", "cpu > 1"])
def test_a_condition_is_checked_before_anything_runs(text):
    with pytest.raises(InputError, match=r"\[run\]: look_for: "):
        td.load_study({"study": {"name": "x"}, "run": {"look_for": text}, "keep": {"outputs": ["thrust_rms"]}})


def test_word_of_it_is_passed_on(out, tmp_path):
    script = tmp_path / "n.py"
    script.write_text(f"import sys; open({str(tmp_path / 'facts')!r}, 'w').write(sys.stdin.read())")
    out[1].write_text(STUDY.format("third > -1"))
    assert main(["run", str(out[1]), "--out", str(out[0]), "--notify", f"{sys.executable} {script}"]) == 0
    facts = json.loads((tmp_path / "facts").read_text())
    assert facts["message"].startswith("6 of 6 points meet third > -1")
    assert facts["message"].replace(">", "&gt;") in facts["text"]
