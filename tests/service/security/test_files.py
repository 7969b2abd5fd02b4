"""Files: what is delivered from directories that the command line filled, and who can read what the service makes."""

from __future__ import annotations

import fcntl
import os
import stat
import textwrap

import pytest
from service_client import COAST

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import InputError
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.security import delivered_files
from tripod_doe.service.security.delivered_files import check_delivered, file_within
from tripod_doe.service.settings import read_token

SECRET = "kept from others"


@pytest.fixture
def planted(serve, tmp_path, write_study):
    """A server in whose folder the command line fills a directory, which something is then done to."""
    results = tmp_path / "results"
    results.mkdir()
    td.run(write_study(COAST), out=results / "one", workers=0, progress=False)
    (tmp_path / "secret").write_text(SECRET)
    (tmp_path / "secret").chmod(0o600)
    server = serve("--workers", "0")
    until_found = [run["id"] for run in server.ask("/runs")[1]]
    while not until_found:
        until_found = [run["id"] for run in server.ask("/runs")[1]]
    return server, until_found[0], results / "one"


PATHS = {
    "study.toml": "/upload",
    "cube.nc": "/cube.nc",
    "run.log": "/log",
    "report/index.html": "/report/",
    "analysis/effects.nc": "/analysis/effects.nc",
}


def texts(server, run_id, path):
    import urllib.error
    import urllib.request

    headers = {"Authorization": f"Bearer {server.token}"}
    request = urllib.request.Request(f"{server.address}/api/v1/runs/{run_id}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read().decode("latin-1")
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


@pytest.mark.slow
def test_nothing_is_delivered_through_a_link_or_against_its_mode(planted):
    server, run_id, directory = planted
    assert texts(server, run_id, "/cube.nc")[0] == 200
    (directory / "analysis").mkdir()
    for name, path in PATHS.items():
        place, kept = directory / name, None
        if place.exists():
            kept = place.rename(directory.parent / "kept")
        place.symlink_to(directory.parent.parent / "secret")
        status, text = texts(server, run_id, path)
        assert status == 403, name
        assert SECRET not in text
        assert f"one/{name}: a symbolic link" in text
        place.unlink()
        if kept:
            kept.rename(place)
    for name in ("analysis/pipe.nc", "pipe"):
        os.mkfifo(directory / name)
        assert texts(server, run_id, "/upload")[0] == 403
        assert "neither a file nor a directory" in texts(server, run_id, "/analyses")[1]
        (directory / name).unlink()
    for mode, place in ((0o777, directory), (0o666, directory / "cube.nc")):
        before = stat.S_IMODE(place.stat().st_mode)
        place.chmod(mode)
        assert "other users can change it" in texts(server, run_id, "/cube.nc")[1]
        place.chmod(before)
    for name in ("cube.nc", "study.toml", "report/index.html"):
        place = directory / name
        place.chmod(0o600)
        status, text = texts(server, run_id, PATHS[name])
        assert status == 403, name
        assert "private (mode 0600)" in text
        place.chmod(0o644)
    (directory / "report").rename(directory.parent / "elsewhere")
    (directory / "report").symlink_to("../elsewhere")
    assert texts(server, run_id, "/report/")[0] == 403
    (directory / "report").unlink()
    (directory.parent / "elsewhere").rename(directory / "report")
    for place in (directory, *directory.rglob("*")):  # all of it is private, as by a umask of 077
        place.chmod(0o700 if place.is_dir() else 0o600)
    for path in ("/cube.nc", "/report/", "/query?variable=thrust_rms"):
        assert texts(server, run_id, path)[0] == 200


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="gives files to another user")
def test_what_cannot_be_checked_is_refused(tmp_path):
    """Regression: a folder whose path is too long ended the check, and links beside it were followed."""
    directory = tmp_path / "one"
    directory.mkdir()
    check_delivered(directory, found=True)
    deep = os.open(directory, os.O_RDONLY)
    for _ in range(18):
        os.mkdir("0" * 250, dir_fd=deep)
        deep, above = os.open("0" * 250, os.O_RDONLY, dir_fd=deep), deep
        os.close(above)
    os.close(deep)
    with pytest.raises(RefusedError, match="cannot be checked"):
        check_delivered(directory, found=True)


def test_an_answer_checks_the_part_that_it_reads(tmp_path):
    """Measured: 20,000 files in other steps cost each answer 0.3 CPU-s, several times."""
    one, two = tmp_path / "run" / "steps" / "one", tmp_path / "run" / "steps" / "two"
    one.mkdir(parents=True)
    (two / "report").mkdir(parents=True)
    (two / "cube.nc").symlink_to("/etc/hostname")
    for part in ("", "report", "steps/one", "steps/two/report"):
        check_delivered(tmp_path / "run", False, part)
    for part in ("steps", "steps/two", "steps/two/cube.nc"):
        with pytest.raises(RefusedError, match=r"two/cube\.nc: a symbolic link"):
            check_delivered(tmp_path / "run", False, part)
    one.rmdir()
    one.symlink_to(two)
    for part in ("steps/one", "steps/one/report"):  # behind the link
        with pytest.raises(RefusedError, match="steps/one: a symbolic link"):
            check_delivered(tmp_path / "run", False, part)


def test_a_part_has_a_limited_number_of_files(tmp_path, monkeypatch):
    monkeypatch.setattr(delivered_files, "_MOST_FILES", 3)
    for name in ("steps/one", "steps/two"):
        (tmp_path / name).mkdir(parents=True)
    for name in (".a", ".b", ".c", ".d", "a", "b"):
        (tmp_path / "steps" / "one" / name).touch()
    check_delivered(tmp_path, False, "steps/two")
    check_delivered(tmp_path, False, "")
    with pytest.raises(RefusedError, match="steps/one: more than 3 files"):
        check_delivered(tmp_path, False, "steps/one")


def test_a_directory_of_another_user_is_neither_shown_nor_delivered(planted, serve, tmp_path):
    """Between a check and the opening of a file, its owner could put a link into its place."""
    server, run_id, directory = planted
    for place in (directory, directory / "study.toml"):
        os.chown(place, 65534, 65534)
        assert "another user owns it" in texts(server, run_id, "/upload")[1]
        os.chown(place, 0, 0)
    os.chown(directory, 65534, 65534)
    server.end()
    later = serve("--workers", "0")
    mine = later.submit(COAST)
    later.wait(mine, lambda run: run["state"] == "finished")
    assert texts(later, run_id, "/cube.nc")[0] in (403, 404)


@pytest.mark.slow
def test_a_directory_that_is_a_link_is_not_shown(serve, tmp_path, write_study):
    (tmp_path / "results").mkdir()
    td.run(write_study(COAST), out=tmp_path / "elsewhere", workers=0, progress=False)
    (tmp_path / "results" / "link").symlink_to(tmp_path / "elsewhere")
    server = serve()
    run_id = server.submit(COAST)
    server.wait(run_id, lambda run: run["state"] == "finished")
    assert [run["id"] for run in server.ask("/runs")[1]] == [run_id]


@pytest.mark.slow
def test_what_the_service_makes_is_its_owners_alone(serve, tmp_path):
    """Whatever the umask was when it started; and nobody else can hold the file that tells whether a run is alive."""
    before = os.umask(0)
    try:
        server = serve("--workers", "0")
        run_id = server.submit(textwrap.dedent(COAST))
        server.wait(run_id, lambda run: run["state"] == "finished")
    finally:
        os.umask(before)
    places = [tmp_path / "results", *(tmp_path / "results").rglob("*")]
    assert len(places) > 10
    open_to_others = [place for place in places if stat.S_IMODE(place.lstat().st_mode) & 0o077]
    assert open_to_others == []


def test_files_of_an_earlier_version_are_closed_to_others(tmp_path):
    from tripod_doe.service.runs.processes import _ALIVE, start_run
    from tripod_doe.service.server import _locked_folder
    from tripod_doe.service.settings import Settings

    for name in ("service.sqlite", ".service.lock"):
        (tmp_path / name).touch(0o644)
    with _locked_folder(Settings(tmp_path)):
        assert [stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()] == [0o600, 0o600]
    (tmp_path / _ALIVE).touch(0o666)
    with (tmp_path / _ALIVE).open() as other:  # one that is held cannot be started, and is closed all the same
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="a run is at work here"):
            start_run(tmp_path, [], 10**10)
    assert stat.S_IMODE((tmp_path / _ALIVE).stat().st_mode) == 0o600


@pytest.mark.parametrize("flags", [[], ["--read-only"]])
@pytest.mark.parametrize("inside", ["", "results"])
def test_a_folder_that_anybody_can_exchange_is_refused(tmp_path, capsys, flags, inside):
    """Regression: a read-only server, and one in a folder below an open one, delivered what others put in its place."""
    (tmp_path / "results").mkdir()
    tmp_path.chmod(0o777)
    assert main(["serve", "--folder", str(tmp_path / inside), *flags]) == 2
    assert f"chmod go-w {tmp_path}\n" in capsys.readouterr().err


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o620, 0o604])
def test_a_token_file_that_others_can_use_is_refused(tmp_path, mode):
    path = tmp_path / "token"
    path.write_text("x" * 40)
    path.chmod(mode)
    with pytest.raises(InputError, match=f"other users can use this file .mode {mode:04o}.*chmod go-rwx"):
        read_token(path)
    path.chmod(0o600)
    assert read_token(path) == "x" * 40


def test_a_planted_file_gets_no_token(tmp_path):
    """Neither a file with a name that could be foreseen nor a link at the token's own place is written to."""
    target = tmp_path / "target"
    for name in (".token.new", ".token.tmp"):
        (tmp_path / name).symlink_to(target)
    read_token(tmp_path / "token")
    assert not target.exists()
    (tmp_path / "other").symlink_to(target)
    with pytest.raises(InputError):
        read_token(tmp_path / "other")
    assert not target.exists()
    assert sorted(path.name for path in tmp_path.iterdir() if not path.is_symlink()) == ["token"]


@pytest.mark.parametrize("what", ["folder", "pipe", "missing"])
def test_what_is_no_token_file_is_refused(tmp_path, what):
    path = tmp_path / "token"
    if what == "folder":
        path.mkdir(mode=0o700)
    elif what == "pipe":
        path = tmp_path / "none" / "token"
        path.parent.touch()
    else:
        path.write_bytes(b"\xff" * 40)
        path.chmod(0o600)
    with pytest.raises(InputError, match="token_file"):
        read_token(path)


@pytest.mark.parametrize(
    "place", ["a" * 300 + ".html", "b/" * 3_000, "../out.html", "/etc/passwd", "", "in/../../out.html"]
)
def test_no_address_names_a_file_outside_or_fails(tmp_path, place):
    """Regression: a name of 300 letters was an internal error of the help site and of report pages, without a token."""
    inside = tmp_path / "site"
    inside.mkdir()
    (tmp_path / "out.html").touch()
    (inside / "in.html").touch()
    assert file_within(inside, place) is None
    assert file_within(inside, "x/../in.html") == inside / "in.html"


@pytest.mark.parametrize("place", [".x.html", ".hidden/page.html", "inner/.x.html"])
def test_hidden_files_are_not_delivered(tmp_path, place):
    """Exact: entries whose names begin with a dot are not checked, so a link among them led anywhere."""
    (tmp_path / "secret.html").write_text(SECRET)
    path = tmp_path / "report" / place
    path.parent.mkdir(parents=True)
    path.symlink_to(tmp_path / "secret.html")
    assert file_within(tmp_path / "report", place) is None


def test_nothing_is_written_through_a_link_in_place_of_a_run(api, coast, settings, tmp_path):
    """Regression: a note went into the directory to which the link led."""
    place, away = settings.folder / coast, tmp_path / "away"
    place.rename(away)
    place.symlink_to(away)
    try:
        assert api.patch(f"/runs/{coast}", {"note": "elsewhere"}).status_code == 403
        assert "elsewhere" not in "".join(path.read_text() for path in away.glob("about.toml"))
    finally:
        place.unlink()
        away.rename(place)
