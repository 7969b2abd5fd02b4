"""Another server on this machine, opened in the same browser: what it gets to see is worth nothing."""

from __future__ import annotations

import http.server
import threading
import urllib.error
import urllib.request
from urllib.parse import urlsplit

import pytest

API = "/api/v1"


class Other(http.server.BaseHTTPRequestHandler):
    """A server that keeps all requests, and whose page asks for everything that a page can ask for."""

    page = b""

    def do_GET(self):
        self.server.seen.append((self.path, dict(self.headers)))
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(self.page)

    def log_message(self, *words):
        """Say nothing."""


@pytest.fixture
def other():
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Other) as server:
        server.seen = []
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


def status(address, headers, data=None):
    request = urllib.request.Request(address, data, headers)
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        with error:
            return error.code


@pytest.mark.slow
def test_what_another_server_gets_opens_nothing(served, window, coast, other):
    """The browser is signed in here and opens a page there: no request there holds the session, and none can be replayed."""
    elsewhere = f"http://127.0.0.1:{other.server_port}"
    other.RequestHandlerClass.page = (
        f"<script>document.cookie='planted=1;path=/';"
        f"for (const path of ['/', '{API}/runs', '/runs/{coast}', '/s-x/'])"
        f" for (const to of ['{elsewhere}', '{served.address}']) {{"
        "  fetch(to + path, {credentials: 'include', mode: 'no-cors'}).catch(() => 0); new Image().src = to + path;"
        "  new EventSource(to + path); }</script>"
        f"<iframe src='{elsewhere}/runs/{coast}'></iframe><a id=there href='{served.address}/runs/{coast}'>there</a>"
    ).encode()
    (session,) = [cookie for cookie in window.cookies() if cookie["name"].startswith("tripod_doe_")]
    page = window.new_page()
    page.goto(f"{elsewhere}/runs/{coast}")
    page.wait_for_timeout(1000)
    page.goto(f"{served.home}/runs/{coast}")  # and it gets no address of a page that led to it
    page.goto(elsewhere)
    page.wait_for_timeout(500)
    assert len(other.seen) > 10
    root = urlsplit(served.home).path
    told = "\n".join(f"{path} {headers}" for path, headers in other.seen)
    for secret in (session["value"], served.token, root):
        assert secret not in told
    for _, headers in other.seen:  # all that the browser sent, with headers as this server's own page would send them
        kept = {name: value for name, value in headers.items() if name.lower() not in ("host", "connection")}
        forged = kept | {"Origin": served.address, "Sec-Fetch-Site": "same-origin", "Content-Type": "application/json"}
        assert status(f"{served.address}{API}/runs", forged) == 401
        assert status(f"{served.address}{API}/runs/{coast}/stop", forged, b"{}") == 401
    stolen = {"Cookie": f"{session['name']}={session['value']}", "Sec-Fetch-Site": "same-origin"}
    assert status(f"{served.address}{API}/runs", stolen) == 401  # nor would the cookie alone open anything
    assert status(f"{served.home}{API}/runs", stolen) == 200
    page.close()


@pytest.mark.slow
def test_addresses_without_the_first_part_lead_to_the_same_page(served, page, coast):
    page.goto(f"{served.address}/runs/{coast}?kind=map")
    page.wait_for_url(f"{served.home}/runs/{coast}?kind=map*")
    page.wait_for_selector("#figure[data-drawn]")


def test_downloads_ranges_and_streams_work_from_the_page(served, page, coast):
    page.goto(f"{served.home}/runs/{coast}")
    told = page.evaluate(
        """async (api) => {
            const part = await fetch(`${api}/cube.nc`, {headers: {Range: 'bytes=0-7'}});
            const event = await new Promise((done) => { const stream = new EventSource(`${api}/events`);
                stream.onmessage = (message) => { stream.close(); done(JSON.parse(message.data).id); }; });
            return [part.status, (await part.arrayBuffer()).byteLength, event];
        }""",
        f"{served.home}{API}/runs/{coast}",
    )
    assert told == [206, 8, coast]
    with page.expect_download() as download:
        page.get_by_text("Save as", exact=True).click()
        page.get_by_text("netCDF, whole cube").click()
    assert download.value.failure() is None


def test_a_file_is_saved_before_the_first_figure_has_come(served, page, coast):
    held = []
    page.route("**/figure*", lambda request: held.append(request))
    page.route(f"**/{coast}/view*", lambda request: held.append(request))
    page.goto(f"{served.home}/runs/{coast}?variable=thrust_amplitude&select=order%3D3")
    page.get_by_text("Save as", exact=True).click()
    with page.expect_download(timeout=10_000) as download:
        page.get_by_text("CSV, numbers of this view").click()
    assert "thrust_amplitude" in download.value.path().read_text().splitlines()[0]
    for request in held:
        request.continue_()
    page.wait_for_selector("#figure[data-drawn]")
    assert page.get_by_text("netCDF, whole cube").is_visible()  # an open menu stays open


def test_a_report_opens_in_a_page_of_its_own_without_the_session(served, page, coast):
    page.goto(f"{served.home}/runs/{coast}/report")
    address = page.locator("iframe.report").get_attribute("src")
    page.goto(f"{served.address}{address}")
    assert page.locator("h1").first.is_visible()
    assert urlsplit(served.home).path not in page.url
