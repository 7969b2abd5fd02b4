"""Tables that people write: what is read of them, and what is refused with line and column."""

from __future__ import annotations

import re

import pytest

from tripod_doe.errors import InputError
from tripod_doe.files.csv_table import read_csv_table


def test_rows_are_known_by_their_lines(tmp_path):
    """Exact: a byte order mark, spaces, empty lines and line breaks in quotes change no field and no line number."""
    (tmp_path / "t.csv").write_bytes(b'\xef\xbb\xbfa, b\r\n\r\n1 ,"x\ny"\r\n,\r\n')
    assert read_csv_table(tmp_path / "t.csv", "t") == (["a", "b"], {4: ["1", "x\ny"], 5: ["", ""]})


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_encodings_of_spreadsheets(tmp_path, encoding):
    """Regression: what Excel writes in Europe, and its Unicode text, were refused for a byte."""
    (tmp_path / "t.csv").write_bytes("file\tÖl\nWelle_ä.csv\t60 °C\n".encode(encoding))
    assert read_csv_table(tmp_path / "t.csv", "t") == (["file", "Öl"], {2: ["Welle_ä.csv", "60 °C"]})


@pytest.mark.parametrize(
    "text",
    [
        "# made by a script, today\n\na,b\n1,x\n2,y\n",
        "# made by a script, today\n# a,b\n1,4\n2,5\n",
        "#a;b\n1,5;4\n2;5\n",
        "a,b\n#1,4\n2,5\n",  # a row, as is any below the header
    ],
)
def test_comments_above_the_header(tmp_path, text):
    (tmp_path / "t.csv").write_text(text)
    header, rows = read_csv_table(tmp_path / "t.csv", "t.csv")
    assert header == ["a", "b"]
    assert len(rows) == 2


def test_a_comment_at_the_end_is_no_header(tmp_path):
    """Regression: of numbers without a header, the last line was read as one."""
    (tmp_path / "t.csv").write_text("1,4\n2,5\n# a,b\n")
    assert read_csv_table(tmp_path / "t.csv", "t.csv")[0] == ["1", "4"]


def test_a_column_may_be_called_by_a_number_sign(tmp_path):
    (tmp_path / "t.csv").write_text("#,file\n1,a.csv\n")
    assert read_csv_table(tmp_path / "t.csv", "t.csv") == (["#", "file"], {2: ["1", "a.csv"]})


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("first", ["sep=;", '"sep=;"'])
def test_what_spreadsheets_add(tmp_path, first, end):
    """Regressions: the first line was the header, also where lines end as Excel writes them; two empty columns were
    one that occurred twice."""
    lines = [first, "", "file;torque_n_m;;", "a.csv;1,5;;", "b.csv;;;", ""]
    (tmp_path / "t.csv").write_bytes(end.join(lines).encode())
    assert read_csv_table(tmp_path / "t.csv", "t") == (["file", "torque_n_m"], {4: ["a.csv", "1.5"], 5: ["b.csv", ""]})


@pytest.mark.parametrize("separator", [";", "\t"])
def test_tables_of_spreadsheets_that_write_decimal_commas(tmp_path, separator):
    """Regression: they were one column, and 1,200 beside 1,5 was no number."""
    rows = [["file", "torque_n_m"], ["a,b.csv", "1,5"], ["c.csv", "-12,25"], ["d.csv", "1,200"]]
    (tmp_path / "t.csv").write_text("\n".join(separator.join(row) for row in rows))
    read = read_csv_table(tmp_path / "t.csv", "t")[1]
    assert list(read.values()) == [["a,b.csv", "1.5"], ["c.csv", "-12.25"], ["d.csv", "1.2"]]


@pytest.mark.parametrize(
    ("rows", "line", "field"),
    [
        (["4,5;600", "6;1.200"], 3, "1.200"),  # beside decimal commas
        (["4;1.200", "6;900"], 2, "1.200"),  # beside whole numbers of its column
        (["4.5;1.200", "6,5;900"], 2, "1.200"),  # both signs
        (["4.5;1,200", "6;900"], 2, "1,200"),
        (["4;1,200", "6;1,500"], 2, "1,200"),
    ],
)
def test_a_sign_that_may_stand_between_thousands_is_refused(tmp_path, rows, line, field):
    """Regression: 1.200 rpm of a spreadsheet with decimal commas was 1.2 rpm, in silence."""
    (tmp_path / "t.csv").write_text("\n".join(["joint_angle_deg;speed_rpm", *rows]))
    message = f"t: line {line}: speed_rpm = {field}: may mean 1.2 or 1200; write 1200, or {field}0 for 1.2"
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        read_csv_table(tmp_path / "t.csv", "t")


@pytest.mark.parametrize(
    ("rows", "read"),
    [
        (["4.500;1.200", "6.250;0.900"], [["4.500", "1.200"], ["6.250", "0.900"]]),  # points throughout
        (["4.5;1.200", "6;900"], [["4.5", "1.200"], ["6", "900"]]),  # 4.5 shows that points are decimal
        (["4,5;1.2000", "6;1.234,5"], [["4.5", "1.2000"], ["6", "1234.5"]]),  # each can mean one number only
        (["4,5;1.200", "6;new"], [["4.5", "1.200"], ["6", "new"]]),  # a column of words
        (["4;1,200", "6;new"], [["4", "1,200"], ["6", "new"]]),
        (["4;1,125", "6;0,5"], [["4", "1.125"], ["6", "0.5"]]),  # 0,5 shows that commas are decimal
    ],
)
def test_a_sign_that_is_the_decimal_one_is_taken(tmp_path, rows, read):
    (tmp_path / "t.csv").write_text("\n".join(["a;b", *rows]))
    assert list(read_csv_table(tmp_path / "t.csv", "t")[1].values()) == read


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no rows below the header"),
        ("a\n", "no rows below the header"),
        ("a,b, a\n1,2,3\n", "column 'a' occurs 2 times; keep one of them"),
        ("a,b\n\n1\n", "line 3 has 1 fields, the header 2"),
        ('a\n"1\n', "unexpected end of data"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(InputError, match=f"^the table: .*{message}"):
        read_csv_table(tmp_path / "t.csv", "the table")


def test_a_file_that_is_not_there_or_no_file(tmp_path):
    with pytest.raises(InputError, match=r"the table: cannot read .*No such file"):
        read_csv_table(tmp_path / "t.csv", "the table")
    with pytest.raises(InputError, match="a folder, but a file is needed: name a file, or move this away"):
        read_csv_table(tmp_path, "the table")
