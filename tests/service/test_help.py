"""The documentation behind "Help": built without a warning, nothing inline or from elsewhere, no dead link."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

import pytest

from tripod_doe import documentation
from tripod_doe.cli.main import main
from tripod_doe.service.page.rendering import HELP

pytest.importorskip("myst_parser")
ROOT = Path(__file__).parents[2]

LOADED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src"), ("source", "src"), ("use", "href")}
"""What a browser fetches by itself."""


class Page(HTMLParser):
    """Addresses, anchors and inline code of a page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loaded, self.anchors, self.inline = [], [], set(), []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.anchors |= {values[name] for name in ("id", "name") if values.get(name)}
        self.inline += [name for name in values if name == "style" or name.startswith("on")]
        if tag == "style" or (tag == "script" and "src" not in values):
            self.inline.append(tag)
        for name in ("src", "href", "action"):
            if name in values:
                (self.loaded if (tag, name) in LOADED else self.links).append(values[name])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site as one command builds it; a warning ends the build."""
    folder = tmp_path_factory.mktemp("docs")
    words = ["-m", "sphinx", "-W", "--keep-going", "-q", "-d", folder / "doctrees", ROOT / "docs", folder / "site"]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


@pytest.fixture(scope="module")
def pages(site):
    return {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}


GUIDES = {
    "halve a friction at each operating point": "halve_a_friction",
    "add levels": "add_levels",
    "run on our cluster": "run_on_our_cluster",
    "numbers to Excel": "numbers_to_excel",
    "my joint is refused": "my_joint_is_refused",
    "is this difference real": "is_this_difference_real",
    "which friction matters": "which_friction",
    "export csv decimal comma": "numbers_to_excel",
    "compare with measurement": "is_it_like_my_record",
    "generated axial force": "thrust_of_my_joint",
    "identify friction from measurements": "which_friction_does_my_joint_have",
    "resume an interrupted run": "my_run_was_interrupted",
    "email when finished": "tell_me_when_it_is_done",
    "most important parameter": "which_parameter",
    "optimise my joint": "best_joint",
    "does my joint vibrate": "thrust_of_my_joint",
    "animation of the joint": "motion",
    "share results": "show_it_to_a_colleague",
    "install with pip": "install",
    "list of load cases": "my_own_points",
    "friction coefficient from test data": "which_friction_does_my_joint_have",
}
"""What people type, and the guide that answers it; the last two have words that no page has all of."""


@pytest.mark.slow
def test_the_search_leads_to_the_guide(site, chromium):
    """Regression: 9 of 20 such phrases had their guide first or second, and several no page at all."""
    page = chromium.new_page()
    for phrase, guide in GUIDES.items():
        page.goto(f"{(site / 'search.html').as_uri()}?q={quote(phrase)}")
        page.get_by_text("Search finished").wait_for()
        links = [link.get_attribute("href") for link in page.locator("ul.search > li > a").all()[:2]]
        assert any(link.split("#")[0].endswith(f"guides/{guide}.html") for link in links), (phrase, links)
    page.close()


@pytest.mark.slow
def test_pages_stand_alone(site, pages):
    """No inline script or style, which servers may forbid, and nothing that a browser would fetch from elsewhere."""
    assert {path.name: page.inline for path, page in pages.items() if page.inline} == {}
    for path, page in pages.items():
        for address in page.loaded:
            assert not urlsplit(address).netloc, f"{path}: {address}"
            assert address.startswith("#") or (path.parent / unquote(urlsplit(address).path)).is_file(), address
    for path in site.rglob("*.css"):
        assert not re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", path.read_text(encoding="utf-8")), path


@pytest.mark.slow
def test_links_lead_somewhere(pages):
    """Files and anchors of the site; other hosts are not asked."""
    for path, page in pages.items():
        for address in page.links:
            parts = urlsplit(address)
            if parts.scheme:
                assert parts.scheme in ("http", "https"), f"{path}: {address}"
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert target.is_file(), f"{path}: {address}"
            if parts.fragment and target in pages:
                assert unquote(parts.fragment) in pages[target].anchors, f"{path}: {address}"


@pytest.mark.slow
def test_every_page_is_in_the_navigation(pages, site):
    index = site / "index.html"
    reached = {(site / urlsplit(link).path).resolve() for link in pages[index].links if not urlsplit(link).scheme}
    written = {path for path in pages if path.relative_to(site).parts[0] not in ("files", "search.html", "index.html")}
    assert written <= reached


@pytest.fixture
def small_site(tmp_path):
    """Files as the site has them: to build it takes as long as a hundred tests."""
    (tmp_path / "_static" / "styles").mkdir(parents=True)
    (tmp_path / "_static" / "styles" / "furo.css").write_text("body {}")
    (tmp_path / "objects.inv").write_text("names")
    (tmp_path / "index.html").write_text("<title>Help</title>")
    return tmp_path


def test_the_service_serves_it_without_a_token(client, small_site, monkeypatch):
    site = small_site
    monkeypatch.setattr(documentation, "_SITE", site)
    answer = client.get("/help/")
    assert answer.text == (site / "index.html").read_text(encoding="utf-8")
    assert "script-src 'self';" in answer.headers["content-security-policy"]
    assert client.get("/help/_static/styles/furo.css").headers["content-type"].startswith("text/css")
    for place in ("nothing.html", "..%2f..%2fcli%2fmain.py", "_static", "objects.inv", "/etc/passwd"):
        assert client.get(f"/help/{place}").status_code == 404, place


def test_where_it_is_not_built_a_page_says_how_to_get_it(client, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(documentation, "_SITE", tmp_path)
    answer = client.get("/help/explanation/models.html", headers={"accept": "text/html"})
    assert documentation.BUILD in answer.text
    assert main(["docs"]) == 2
    assert documentation.BUILD in capsys.readouterr().err


def test_the_command_names_its_first_page(small_site, monkeypatch, capsys):
    monkeypatch.setattr(documentation, "_SITE", small_site)
    assert main(["docs"]) == 0
    assert Path(capsys.readouterr().out.strip()) == small_site / "index.html"


def test_every_part_of_a_page_has_a_source():
    for part, address in HELP.items():
        assert (ROOT / "docs" / address.partition("#")[0]).with_suffix(".md").is_file(), part


@pytest.mark.slow
def test_every_part_of_a_page_leads_to_its_own(pages, site):
    """A page of the site, and an anchor on it where the address names one."""
    for part, address in HELP.items():
        path, _, anchor = address.partition("#")
        assert site / path in pages, part
        assert not anchor or anchor in pages[site / path].anchors, part


def test_pages_of_the_service_lead_to_it(api):
    for address, part in (("/", "Runs"), ("/new", "New study"), ("/compare", "Measurement"), ("/diff", "Differences")):
        assert f'href="/help/{HELP[part]}"' in api.client.get(address, headers={"accept": "text/html"}).text
    assert 'href="/help/"' in api.client.get("/", headers={"accept": "text/html"}).text
