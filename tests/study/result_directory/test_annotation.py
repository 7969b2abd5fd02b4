"""What people write about a result: a small file that no run and no hash depends on."""

from __future__ import annotations

import json
import os
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tripod_doe.cli import main
from tripod_doe.errors import InputError
from tripod_doe.study.result_directory.annotation import FILE, Annotation, annotated, read_annotation, write_annotation

LINE = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), max_size=30).map(str.strip)
NAME = LINE.filter(lambda name: "/" not in name and name not in (".", ".."))
NOTE = st.lists(LINE).map("\n".join).map(str.strip)


@settings(deadline=None)  # a busy machine is no fault
@given(NAME, LINE, st.lists(LINE.filter(lambda tag: tag and "," not in tag), unique=True, max_size=5), NOTE)
def test_what_is_written_is_read(tmp_path_factory, name, owner, tags, note):
    folder = tmp_path_factory.mktemp("about")
    annotation = annotated(Annotation(), {"name": name, "owner": owner, "tags": tags, "note": note})
    write_annotation(folder, annotation)
    assert read_annotation(folder) == annotation == Annotation(name, owner, tuple(tags), note)
    assert (folder / FILE).exists() == bool(annotation)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"nam": "x"}, "unknown key 'nam'; allowed: name, owner, tags, note"),
        ({"tags": "one"}, "expected a list of texts"),
        ({"tags": ["a,b"]}, "has no comma"),
        ({"tags": [""]}, "not empty"),
        ({"tags": [str(n) for n in range(21)]}, "21 tags, at most 20"),
        ({"name": "x" * 201}, "201 characters, at most 200"),
        ({"name": "../../etc"}, "not '', '.' or '..'"),
        ({"name": "two\nlines"}, "line ends are not allowed"),
        ({"note": "\x1b[31m"}, "control characters are not allowed"),
        ({"owner": 7}, "expected text"),
    ],
)
def test_what_cannot_be_written_is_refused(changes, message):
    with pytest.raises(InputError, match=message.replace("[", r"\[")):
        annotated(Annotation(), changes)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    for content in (
        b"tags = 0x" + b"f" * 100_000,
        b"name = ",
        b"\xff",
        b'name = "' + bytes(300_000) + b'"',
        b"note = 3",
    ):
        (tmp_path / FILE).write_bytes(content)
        with pytest.raises(InputError, match=FILE):
            read_annotation(tmp_path)
    (tmp_path / FILE).unlink()
    (tmp_path / FILE).symlink_to("/etc/hostname")
    with pytest.raises(InputError, match="a link, but a file is needed"):
        read_annotation(tmp_path)
    (tmp_path / FILE).unlink()
    os.mkfifo(tmp_path / FILE)  # nobody writes to it: reading it would wait for ever
    with pytest.raises(InputError, match="a pipe"):
        read_annotation(tmp_path)


def test_the_command_changes_only_what_it_names(tmp_path, capsys):
    assert main(["annotate", str(tmp_path), "--name", "customer/joint-7", "--note", "# Steel\nby hand"]) == 0
    assert main(["annotate", str(tmp_path), "--tags", "a, b", "--format", "json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told == {"name": "customer/joint-7", "owner": "", "tags": ["a", "b"], "note": "# Steel\nby hand"}
    assert tomllib.loads((tmp_path / FILE).read_text())["note"] == "# Steel\nby hand"
    assert main(["annotate", str(tmp_path), "--name", "", "--note", "", "--tags", ""]) == 0
    assert not (tmp_path / FILE).exists()
    assert main(["annotate", str(tmp_path / "none"), "--name", "x"]) == 2


@pytest.mark.parametrize("part", ["a", r'"\""', r'"\\\""', r"""'"\'"""])
def test_a_name_of_many_parts_is_refused_at_once(tmp_path, part):
    """Exact: a file of 120 kB took 15 s and 7 GB, since the cost of a dotted name grows with the square of its parts."""
    (tmp_path / FILE).write_text(".".join([part] * 3000) + " = 1")
    with pytest.raises(InputError, match=r"about\.toml.*parts with dots"):
        read_annotation(tmp_path)


def test_the_longest_annotation_is_read_and_no_larger_file(tmp_path):
    widest = Annotation(
        "\U0001f529" * 200, "\U0001f529" * 100, tuple(f"{i:060}" for i in range(20)), '"\U0001f529' * 10_000
    )
    write_annotation(tmp_path, widest)
    assert read_annotation(tmp_path) == widest
    (tmp_path / FILE).write_text("#" * 110_000)
    with pytest.raises(InputError, match="at most 100,000 are read"):
        read_annotation(tmp_path)
