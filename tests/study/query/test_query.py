"""Queries: the right cells, labelled, for grids and for points."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.errors import InputError, speaking_of_options
from tripod_doe.model_interface import OUTCOME_ATTRIBUTES
from tripod_doe.study.cube.netcdf import write_dataset
from tripod_doe.study.named_arrays import NamedArray
from tripod_doe.study.query import query as query_module
from tripod_doe.study.query.query import query, records, records_text, unmet
from tripod_doe.study.query.selection import labels_text, parse_selection, taken
from tripod_doe.study.result_directory.open_cube import opened_cube


@pytest.fixture
def cube():
    return xr.Dataset(
        {
            "f": (("point", "order"), np.arange(8.0).reshape(4, 2)),
            "outcome": ("point", np.array([0, 0, 1, 0], np.int8), OUTCOME_ATTRIBUTES),
            "model_used": (
                "point",
                np.array([0, 1, -1, 1], np.int8),
                {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "none equilibrium kinetostatic"},
            ),
        },
        coords={
            "point": np.arange(4),
            "x": ("point", [0.1, 0.2, 0.3, 0.4]),
            "model": ("point", np.array(["a", "b", "a", "b"], object)),
            "order": [2, 3],
        },
    )


def test_points_are_found_by_their_factors(cube):
    answer = query(cube, "f", ["x=0.2:0.35", "order=3"])
    assert answer["f"].values.tolist() == [[3.0], [5.0]]
    assert query(cube, "f", ["model=b"])["f"].values[:, 0].tolist() == [2, 6]
    assert query(cube, "f", ["x=0.2,0.4"])["f"].sizes["point"] == 2


def test_values_match_to_1e_9(cube):
    assert query(cube, "f", [f"x={0.3 * (1 + 1e-12)!r}"])["f"].sizes["point"] == 1
    assert query(cube, "f", ["x=0.3000001"])["f"].sizes["point"] == 0
    assert query(cube, "f", ["x=0.3000001"], nearest=True)["x"].values.tolist() == [0.3]


def test_the_nearest_point_is_near_in_all_that_is_asked_for():
    """Regression: the first coordinate alone decided, by a hundredth of its range."""
    cube = xr.Dataset(
        {"f": ("point", np.arange(4.0))},
        {
            "x": ("point", [0.0, 5.0, 5.1, 10.0]),
            "y": ("point", [0.0, 0.0, 1000.0, 900.0]),
            "model": ("point", np.array(["a", "a", "a", "b"], object)),
        },
    )
    for select in (["x=5", "y=950"], ["y=950", "x=5"]):
        assert query(cube, "f", select, nearest=True)["f"].values.tolist() == [2]
        assert query(cube, "f", [*select, "model=b"], nearest=True)["f"].values.tolist() == [3]
    assert query(cube, "f", ["x=5", "y=0"], nearest=True)["f"].values.tolist() == [1]
    assert query(cube, "f", ["x=5", "y=inf"], nearest=True)["f"].size == 0


def test_a_value_is_found_as_it_is_printed(cube):
    """Regression: -13.3333 of a table found nothing; two labels that print alike are ambiguous."""
    thirds = cube.assign_coords(x=("point", [-40 / 3, 1 / 3, 1 / 3 * (1 + 1e-7), 2 / 3]))
    assert query(thirds, "f", ["x=-13.3333"])["f"].sizes["point"] == 1
    assert query(thirds, "f", ["x=-13.3333,0.666667"])["f"].sizes["point"] == 2
    assert query(thirds, "f", ["x=0.333333"])["f"].sizes["point"] == 0
    assert query(thirds, "f", ["x=-13.333"])["f"].sizes["point"] == 0
    own = NamedArray(("x",), np.arange(4), {"x": thirds["x"].values})
    assert own.picked([-13.3333], ()).data == 0


def test_the_ends_of_a_range_match_to_1e_9(cube):
    """Regression: linspace gives 0.30000000000000004, and a range up to 0.3 left it out."""
    assert (
        query(cube.assign_coords(x=("point", np.linspace(0, 1, 11)[1:5])), "f", ["x=0.1:0.3"])["f"].sizes["point"] == 3
    )


def test_conditions_see_coordinates_outcome_and_values(cube):
    result = records(cube, "f", where="outcome == 'finished' and f > 2 and order == 3")
    assert result["x"].tolist() == [0.2, 0.4]
    assert result["outcome"].tolist() == ["finished", "finished"]
    assert records(cube, "f")["outcome"].tolist().count("diverged") == 2


@pytest.mark.parametrize("nearest", [False, True])
@pytest.mark.parametrize("asked", ["x=3", "x=2.2,9", "x=-4", "x=2:5", "x=:1", "x=40", "x=inf", "x=4.5"])
@pytest.mark.parametrize("left", [None, np.array([1, 2, 4, 7, 8])])
def test_labels_are_found_whatever_is_missing_among_them(asked, nearest, left):
    values = np.array([7, 3, np.nan, 2, 2.5, 3, 0, np.nan, np.nan, 1, 9])
    labels = xr.Variable("x", values)
    found = taken(labels, left, parse_selection(asked), nearest).tolist()
    assert left is None or set(found) <= set(left.tolist())
    if left is None and nearest:
        expected = {
            "x=3": [1, 5],
            "x=2.2,9": [3, 10],
            "x=-4": [6],
            "x=2:5": [1, 3, 4, 5],
            "x=:1": [6, 9],
            "x=40": [10],
            "x=inf": [],
            "x=4.5": [1, 5],
        }
        assert found == expected[asked]


def test_a_cube_and_its_file_answer_alike(cube, tmp_path):
    """Over variables of no, one and two dimensions."""
    cube = cube.assign(total=cube["f"].sum(), even=("point", [True, False, True, False]))
    cube["f"][1, 0] = np.nan
    write_dataset(cube, tmp_path / "cube.nc")
    with opened_cube(tmp_path / "cube.nc") as stored:
        for name in cube.data_vars:
            one, other = records(cube, str(name)), records(stored, str(name))
            assert one.keys() == other.keys()
            for column in one:
                np.testing.assert_array_equal(one[column], other[column])
            assert one[str(name)].size == cube[name].size
        answer = query(tmp_path / "cube.nc", "f", ["model=b"], where="x > 0.3")
        assert records(stored, "f", ["model=b"], where="x > 0.3")["f"].tolist() == answer["f"].values[1].tolist()


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (["x=0.25"], "x is 0.1, 0.2, 0.3 or 0.4; --nearest takes the closest"),
        (["x=0.2", "order=5:9"], "order is 2 or 3"),
        (["model=c"], "model is a or b"),
        (["x=0.2", "model=a"], "no cell meets all conditions"),
    ],
)
def test_an_empty_answer_says_what_there_is(cube, asked, message):
    assert query(cube, "f", asked)["f"].size == 0
    assert unmet(cube, asked) == message


def test_many_labels_are_told_by_their_ends():
    many = xr.Variable("point", np.linspace(0.5, 20, 100))
    assert labels_text(many) == "has 100 values from 0.5 to 20"


def test_a_cube_without_a_finished_point_says_so(cube):
    none = cube.drop_vars("f").assign(outcome=cube["outcome"] * 0 + 1)
    with pytest.raises(InputError, match="not in this cube, of which no point finished; allowed: out"):
        query(none, "f")
    with pytest.raises(InputError, match="not in this cube; allowed"):
        query(cube.drop_vars("f"), "f")


def test_a_text_like_a_formula_is_none_in_a_spreadsheet():
    columns = {
        "a": np.array(["=cmd|' /C calc'!A0", "+1", "-x", "@x", "ok"], object),
        "b": np.array([-1.5, 1, 2, 3, np.nan]),
    }
    lines = records_text(columns, "csv").split("\n")
    assert lines == ["a,b", "'=cmd|' /C calc'!A0,-1.5", "'+1,1.0", "'-x,2.0", "'@x,3.0", "ok,"]


def test_what_a_terminal_would_obey_is_written_as_an_escape():
    for form in ("table", "csv", "json"):
        assert "\x1b" not in records_text({"a": np.array(["\x1b[2J"], object)}, form)
    table = records_text({"a": np.array(["b 1\nc"], object), "n": np.array([2])}, "table")
    assert table.split("\n") == ["     a n", r"b 1\nc 2"]  # the label was shown as two rows


def test_records_as_text():
    """JSON and CSV hold every digit and no NaN; a table is aligned for people."""
    columns = {"x": np.array([1.0, np.nan]), "word": np.array(["a", "b,c"], object), "n": np.array([3, 4])}
    assert records_text(columns, "json") == '[{"x": 1.0, "word": "a", "n": 3}, {"x": null, "word": "b,c", "n": 4}]'
    assert records_text(columns, "csv") == 'x,word,n\n1.0,a,3\n,"b,c",4'
    assert records_text(columns, "table") == "  x word n\n  1    a 3\nNaN  b,c 4"
    assert records_text({"x": np.array([])}, "table") == "no cell matches"
    assert records_text({"x": np.array([])}, "json") == "[]"


@pytest.mark.parametrize("text", ["x", "=3", "x="])
def test_selections_that_are_none(text):
    with pytest.raises(InputError, match=r"^select="):
        parse_selection(text)


def test_a_range_of_words_is_none_of_numbers(cube):
    with pytest.raises(InputError, match=r"^select='x': 'a:b': a range is two numbers"):
        query(cube, "f", ["x=a:b"])


@pytest.mark.parametrize("label", ["1", "1e3", "1.0", "nan", "a:b", "1:2", "a,b", "inf", "0x1"])
def test_labels_that_read_like_numbers_or_ranges_are_selected_as_texts(label):
    """Regression: "1" was looked for as "1.0"."""
    labels = ["1", "1e3", "1.0", "nan", "a:b", "1:2", "a,b", "inf", "0x1", "2", "1000"]
    cube = xr.Dataset({"f": ("point", np.arange(11.0))}, {"kind": ("point", np.array(labels, object))})
    for select in ([f"kind={label}"], {"kind": label}):
        assert query(cube, "f", select)["f"].values.tolist() == [labels.index(label)]
    assert query(cube, "f", ["kind=2,1"])["f"].values.tolist() == [0, 9]
    assert query(cube, "f", {"kind": 2})["f"].values.tolist() == [9]


def test_flags_are_answered_and_asked_for_by_their_meanings(cube, tmp_path):
    write_dataset(cube, tmp_path / "cube.nc")
    with opened_cube(tmp_path / "cube.nc") as stored:
        for arrays in (stored, cube):
            result = records(arrays, "model_used")["model_used"].tolist()
            assert result == ["equilibrium", "kinetostatic", "none", "kinetostatic"]
            assert records(arrays, "f", where="model_used == 'kinetostatic' and order == 2")["x"].tolist() == [0.2, 0.4]


@pytest.mark.parametrize(
    ("where", "told"),
    [
        ("outcome == 'ok'", "at character 1: outcome never has the value 'ok'; allowed: finished, diverged"),
        ("order == 2 and 'finishd' != outcome", "outcome never has the value 'finishd'; did you mean 'finished'"),
        ("model_used == 'needle'", "model_used never has the value 'needle'"),
        ("model != 'needels'", "model never has the value 'needels'"),
    ],
)
def test_a_comparison_with_no_label_of_a_flag_is_refused(cube, where, told):
    """Regression: it gave nothing without a word."""
    with pytest.raises(InputError, match=told):
        query(cube, "f", where=where)
    assert query(cube, "f", where="outcome == 'jammed'")["selected"].sum() == 0


def test_messages_name_what_the_user_wrote(cube):
    """In Python an argument, on the command line an option."""
    with pytest.raises(InputError, match=r"^select='z': not a coordinate here"):
        query(cube, "f", ["z=3"])
    with pytest.raises(InputError, match=r"^select='x': 'y=2' is not a number; select each coordinate"):
        query(cube, "f", ["x=1,y=2"])
    with speaking_of_options(), pytest.raises(InputError, match=r"^--select z: not a coordinate here"):
        query(cube, "f", ["z=3"])


def test_python_selects_by_name(cube):
    """Regression: a mapping was refused with the syntax of the command line."""
    assert query(cube, "f", {"order": 3, "x": slice(0.2, 0.35)})["f"].values.tolist() == [[3.0], [5.0]]
    assert query(cube, "f", {"x": slice(None, 0.2), "model": "b"})["x"].values.tolist() == [0.2]
    assert query(cube, "f", {"x": [0.1, 0.4]})["x"].values.tolist() == [0.1, 0.4]
    assert query(cube, "f", {"x": np.array([0.1, 0.4])})["x"].values.tolist() == [0.1, 0.4]


@pytest.mark.parametrize(
    "select",
    [
        {"x": []},
        {"x": None},
        {"x": [None]},
        {"x": slice("a", 3)},
        {"x": slice("0.2", 0.3)},
        {"x": slice(True, 3)},
        {"x": slice(0.1, 0.4, 2)},
        {"x": {0.1: 1}},
        {"x": [[0.1, 0.2]]},
        {"x": 10**400},
        {"x": 1j},
        {"x": np.complex128(0.1 + 1j)},
        {"x": slice(np.complex128(0.1 + 1j), None)},
        {3: 0.1},
    ],
)
def test_what_is_no_value_is_refused(cube, select):
    """Regression: an empty list chose everything, a step was dropped, and others ended as errors of Python."""
    with pytest.raises(InputError, match=r"^select: .*a value, a list of values, or slice\(a, b\) with two numbers"):
        query(cube, "f", select)


def test_a_truth_is_no_number(cube):
    """Regression: True counted as 1; a label may be a truth itself."""
    with pytest.raises(InputError, match=r"^select='order': True is no number"):
        query(cube, "f", {"order": True})
    switched = cube.assign_coords(x=("point", [False, True, False, False]))
    assert query(switched, "f", {"x": True})["x"].values.tolist() == [True]
    with pytest.raises(InputError, match="select: 3: write 'name=value'"):
        query(cube, "f", [3])


def test_open_ranges():
    assert parse_selection("x=:3").high == 3
    assert parse_selection("x=1:").low == 1


@pytest.mark.parametrize("cells", [4_000_000, 3])
@pytest.mark.parametrize(
    ("where", "expected"),
    [
        ("f[3] > 2 and order == 2", [[False, False], [True, False], [False, False], [True, False]]),
        ("max(f) == f and outcome == 'finished'", [[False, False], [False, True], [False, False], [False, True]]),
        ("wave[90] > 1", [[False, False], [True, True], [True, True], [True, True]]),
        ("f > mean(wave) and outcome == 'finished'", [[False, False], [True, True], [False, False], [True, True]]),
    ],
)
def test_conditions_may_index_and_reduce(monkeypatch, where, expected, cells):
    """Exact: by hand, whole and slab by slab; other orders than the selected ones may be named."""
    monkeypatch.setattr(query_module, "_SLAB_CELLS", cells)
    cube = xr.Dataset(
        {
            "f": (("point", "order"), [[np.nan, np.nan], [2.0, 3.0], [np.nan, np.nan], [4.0, 5.0]]),
            "wave": (("point", "angle"), [[0.0, 1.0], [0.0, 2.0], [0.0, 3.0], [0.0, 4.0]]),
            "outcome": (("point",), np.array([1, 0, 1, 0], np.int8), OUTCOME_ATTRIBUTES),
        },
        coords={"order": [2, 3], "angle": [0, 90]},
    )
    assert query(cube, "f", where=where)["selected"].values.tolist() == expected
    chosen = query(cube, "f", ["order=2"], where=where)["selected"].values
    assert chosen.tolist() == [[row[0]] for row in expected]


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("wave > 1", r"differ along angle.*as NAME\[\d+\], or the max"),
        ("f[2:2] > 1", "some order only"),
        ("f[7] > 1", "no order 7; it has 2, 3"),
    ],
)
def test_a_condition_has_one_answer_for_each_cell(where, message):
    cube = xr.Dataset(
        {
            "f": (("point", "order"), np.ones((2, 2))),
            "wave": (("point", "angle"), np.ones((2, 3))),
            "outcome": (("point",), np.zeros(2, np.int8), OUTCOME_ATTRIBUTES),
        },
        coords={"order": [2, 3]},
    )
    with pytest.raises(InputError, match=message):
        query(cube, "f", where=where)


@pytest.mark.parametrize(
    ("select", "told"),
    [
        ("order=3:2", "no number lies in 3:2; write the smaller end first"),
        ("order=nan", "no label is nan"),
        ("order=nan:3", "no label is nan"),
        ("order=2,nan", "no label is nan"),
        ({"order": slice(3, 2)}, "no number lies in 3:2"),
    ],
)
def test_a_selection_that_nothing_can_meet_is_refused(select, told):
    """It gave an empty answer; a value that is merely not there still does."""
    cube = xr.Dataset(
        {"f": (("point", "order"), np.ones((2, 2))), "outcome": (("point",), np.zeros(2, np.int8), OUTCOME_ATTRIBUTES)},
        coords={"order": [2, 3]},
    )
    with pytest.raises(InputError, match=told):
        query(cube, "f", [select] if isinstance(select, str) else select)
    assert query(cube, "f", ["order=7"])["f"].size == 0


@pytest.mark.parametrize(
    ("select", "told"),
    [
        ("angle=12,5", r"select='angle': no label is 12; angle is 5, 10 or 15; write 12\.5 with a decimal point"),
        ("angle=10,12.5,5", r"no label is 12\.5; angle is 5, 10 or 15$"),
        ({"angle": [5, 12]}, r"no label is 12; angle is 5, 10 or 15$"),
        ("angle=1,200", r"no label is 1 or 200; .*write 1\.2 or 1200 with a decimal point"),
        ("kind=a,c", "no label is c; kind is a, b,c or d$"),
        ({"kind": ["a", "c"]}, "no label is c"),
        ("point=1,7", "no label is 7"),
    ],
)
def test_listed_values_that_no_label_has_are_refused(select, told):
    """Regression: 12,5 for 12.5 answered with the point at 5, and said nothing of 12."""
    labels = {"angle": ("point", [5.0, 10.0, 15.0]), "kind": ("point", ["a", "d", "b,c"]), "point": [0, 1, 2]}
    cube = xr.Dataset({"f": ("point", np.arange(3.0))}, labels)
    with pytest.raises(InputError, match=told):
        query(cube, "f", [select] if isinstance(select, str) else select)
    assert query(cube, "f", ["kind=b,c"])["f"].values.tolist() == [2]
    assert query(cube, "f", ["angle=5,15", "kind=a"])["f"].values.tolist() == [0]  # 15 is elsewhere
    assert query(cube, "f", ["angle=12,5"], nearest=True)["f"].values.tolist() == [0, 1]


def test_headings_are_escaped_as_values_are():
    """Regression: the name of a stranger's variable was a formula of the spreadsheet, or a command of the terminal."""
    columns = {"=HYPERLINK(1)": np.array([1.0]), "a\x1b]0;x\x07": np.array([2.0])}
    assert records_text(columns, "csv").split("\n")[0] == "'=HYPERLINK(1),a\\x1b]0;x\\x07"
    assert "\x1b" not in records_text(columns, "table")


def test_an_output_that_the_study_does_not_keep_says_how_to_get_it(tmp_path):
    """Regression: the most similar names, of an output that the model has."""
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\n[base]\nmodel = "equilibrium"\n[factors]\njoint_angle_deg.values = [5]\n[keep]\noutputs = ["thrust_rms"]\n'
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    for cube in (tmp_path / "out", td.open_cube(tmp_path / "out")):
        with pytest.raises(InputError, match=r"friction_power_w.*name it in \[keep\] outputs and run the study again"):
            query(cube, "friction_power_w")
        with pytest.raises(InputError, match=r"did you mean 'thrust_rms'"):
            query(cube, "thrust_rm")


def test_a_label_with_a_comma_is_selected_alone():
    """Regression: its parts were selected too, and blanks at its ends were lost."""
    labels = ["a", "b", "a, b", " c", "d "]
    cube = xr.Dataset({"f": ("point", np.arange(5.0))}, {"kind": ("point", np.array(labels, object))})
    chosen = {"a, b": [2], "a,b": [0, 1], "a , b": [0, 1], " c": [3], "a, c": [0, 3], "d ,b": [1, 4]}
    for written, found in chosen.items():
        assert query(cube, "f", [f"kind={written}"])["f"].values.tolist() == found
    with pytest.raises(InputError, match="no label is x"):
        query(cube, "f", ["kind=a,x"])


def test_amplitudes_below_rounding_are_zero_in_tables_and_stay_in_files():
    """Regression: tables showed an order 0 of 5.59e-15 N; a small value that is no amplitude stays."""
    columns = {"thrust_amplitude": np.array([5.59e-15, 14.0, np.nan]), "energy_residual": np.array([1e-15, 1.0, 2.0])}
    assert [line.split() for line in records_text(columns, "table").splitlines()[1:]] == [
        ["0", "1e-15"],
        ["14", "1"],
        ["NaN", "2"],
    ]
    assert "5.59e-15" in records_text(columns, "csv")
    assert "5.59e-15" in records_text(columns, "json")
