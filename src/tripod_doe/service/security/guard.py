"""The guard of every request: host, token, origin, content type and size are checked before anything reads it.

A browser on this machine also shows pages of strangers, which can send requests here. So the guard checks the host name
of each request (with a rebound name, a stranger's page would count as ours), the token, which strangers lack, and for
changes the page that sends the request.
"""

import asyncio
import ipaddress
import re
import socket
from collections import Counter, defaultdict
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from urllib.parse import parse_qsl, urlencode

from anyio import BrokenResourceError
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from tripod_doe.http_opener import LOOPBACK
from tripod_doe.service.problems import SERVER_ENDS, RefusedError
from tripod_doe.service.security import content_policy
from tripod_doe.service.security.connections import BODY_RATE, BODY_SECONDS, giving_way, left_of
from tripod_doe.service.security.sessions import LIFETIME, Sessions
from tripod_doe.service.security.tokens import Access, Accesses
from tripod_doe.service.settings import Settings

API = "/api/v1"
"""Where the routes of the interface start."""

_OPEN = f"{API}/health"
_WITH_FILES = ("/compare", "/plans", "/price", "/runs", "/extend")  # endings of addresses whose bodies may hold tables
_PUBLIC = ("/assets/", "/help/")
_TOKENS = ("token", "share")
_SAFE = ("GET", "HEAD", "OPTIONS")
_ANYWHERE = ("0.0.0.0", "::")
_AT_ONCE, _READERS_AT_ONCE = 8, 24  # answers to one link or reader, and to all of them: of 40 threads, some stay free
_MOST_WAITING = 32  # requests of one link or reader that wait or are answered, and its streams of events
_STRANGERS_AT_ONCE = 4  # answers to those without access: each takes a moment of the loop in which the owner waits
_OWNERS_AT_ONCE, _MOMENT = 8, 0.05  # answers to the owner that begin together, and seconds for which one counts
_STRANGER = ("", False)
_PIECE = (
    65_536  # bytes of an answer that are written together: only as much of it is kept for a client that does not read
)
_HOST = re.compile(r"(?P<name>[a-z0-9._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?")

_HEADERS = (
    (b"content-security-policy", content_policy.OTHERS.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)
"""Headers of every answer that does not set its own."""


def _share_of(scope: Scope) -> tuple[str, bool] | None:
    """The reader that asks, and whether for a stream of events; `_STRANGER` without access, None for the owner."""
    access: Access | None = scope["access"]
    if access is None:
        return _STRANGER
    return None if access.owns else (access.name, scope["path"].endswith("/events"))


async def _send_in_pieces(send: Send, message: Message) -> None:
    """Send an answer in pieces, as fast as the client reads: uvicorn buffers each piece completely."""
    body = message.get("body", b"")
    if message["type"] != "http.response.body" or len(body) <= _PIECE:
        await send(message)
        return
    for start in range(0, len(body), _PIECE):
        more = message.get("more_body", False) or start + _PIECE < len(body)
        await send({"type": "http.response.body", "body": body[start : start + _PIECE], "more_body": more})


def allowed_hosts(host: str) -> frozenset[str]:
    """Host names allowed in requests to a server that listens on `host`; also any address if it listens everywhere."""
    names = {*LOOPBACK, host.lower()}
    if host in _ANYWHERE:
        names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
    return frozenset(names - set(_ANYWHERE))


class Guard:
    """Middleware that checks every request, and adds security headers to every answer.

    Args:
        refusal_answer: (request, refusal, settings, root) -> answer, a page if a person asked for one.
        accesses: All who may send requests.
    """

    def __init__(
        self,
        app: ASGIApp,
        settings: Settings,
        accesses: Accesses,
        sessions: Sessions,
        refusal_answer: Callable[[HTTPConnection, RefusedError, Settings, str], Response],
    ) -> None:
        self._app, self._settings, self._accesses, self._sessions = app, settings, accesses, sessions
        self._refusal_answer = refusal_answer
        self._hosts = allowed_hosts(settings.host)
        self._any_address = settings.host in _ANYWHERE
        self._turns: defaultdict[str, asyncio.Semaphore] = defaultdict(lambda: asyncio.Semaphore(_AT_ONCE))
        self._readers = asyncio.Semaphore(_READERS_AT_ONCE)
        self._strangers = asyncio.Semaphore(_STRANGERS_AT_ONCE)
        self._owners = asyncio.Semaphore(_OWNERS_AT_ONCE)
        self._open: Counter[tuple[str, bool]] = Counter()  # open requests per reader; event streams counted separately

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":  # the lifespan; there are no websockets
            await self._app(scope, receive, send)
            return
        send = _with_headers(send)
        headers = Headers(scope=scope)
        scope["access"] = None
        try:
            self._check_host(headers)
            if not scope["path"].isprintable():  # no valid name contains such a character
                raise RefusedError(404, "the address holds a control character")
            inside = self._enter(scope)
            if response := self._welcome(scope, inside):
                await self._answer(response, scope, receive, send)
                return
            scope["access"] = self._access(scope, headers, inside)
            if scope["access"] is None and not self._is_open(scope):
                raise _unknown()
            if scope["method"] not in _SAFE:
                self._check_change(scope, headers)
                scope["body"] = await self._body(scope, headers, receive)
            self._refuse_crowd(scope)
        except RefusedError as refusal:
            if (access := scope["access"]) is not None and not access.owns:
                scope["access"] = None  # refusals of readers wait as those of strangers: a crowd is mostly refused
            await self._answer(self._refused(refusal), scope, receive, send)
            return
        await self._answer(self._app, scope, receive, send)

    async def _answer(self, app: ASGIApp, scope: Scope, receive: Receive, send: Send) -> None:
        """Let an application answer when its turn comes; say so where the server ends before it began.

        Uvicorn would send a bare 500 then.
        """
        begun = False
        try:
            async with self._turn(scope) as begin:

                async def noted(message: Message) -> None:
                    nonlocal begun
                    begun = True
                    begin()
                    await _send_in_pieces(send, message)

                left = left_of(scope)
                gone = left is not None and left.is_set()  # on its turn, uvicorn drops any answer to it
                await (Response(status_code=400) if gone else app)(scope, receive, noted)
        except BaseExceptionGroup as group:
            if not begun or group.split(BrokenResourceError)[1] is not None:
                raise  # else the client has left while an event was sent to it
        except asyncio.CancelledError:
            if begun:
                raise
            refusal = RefusedError(503, SERVER_ENDS)
            await JSONResponse(refusal.answer(), refusal.status)(scope, receive, send)

    def _refused(self, refusal: RefusedError) -> ASGIApp:
        """The answer to a request that is refused."""

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            response: ASGIApp = JSONResponse(refusal.answer(), refusal.status, refusal.headers)
            if refusal.status == 401:  # a person may read it
                response = self._refusal_answer(HTTPConnection(scope), refusal, self._settings, "")
            await response(scope, receive, send)

        return answer

    @asynccontextmanager
    async def _turn(self, scope: Scope) -> AsyncIterator[Callable[[], None]]:
        """Let all requests of the owner, of a reader, and of strangers wait for each other: a crowd delays its own.

        Readers take no thread that the owner needs. One of the owner's that waits for a worker holds up no other.
        Gives what is to be called when the answer begins: a stranger who does not read it holds up no other.
        """
        if (mine := _share_of(scope)) is None:
            await self._owners.acquire()
            with ExitStack() as held:
                held.callback(self._owners.release)
                asyncio.get_running_loop().call_later(_MOMENT, held.close)
                yield held.close
            return
        if mine == _STRANGER:
            with giving_way(scope):
                await self._strangers.acquire()
            with ExitStack() as held:  # until the loop has looked at all others: most answers begin without a pause
                held.callback(asyncio.get_running_loop().call_soon, self._strangers.release)
                yield held.close
            return
        name, streams = mine
        self._open[mine] += 1
        try:
            async with AsyncExitStack() as turns:
                if not streams:  # these hold no thread
                    await turns.enter_async_context(self._turns[name])
                    await turns.enter_async_context(self._readers)
                yield lambda: None
        finally:
            self._open[mine] -= 1

    def _refuse_crowd(self, scope: Scope) -> None:
        """Refuse a reader's request while it has too many open requests."""
        mine = _share_of(scope)
        if mine is not None and mine != _STRANGER and self._open[mine] >= _MOST_WAITING:
            what = "event streams are open" if mine[1] else "requests are open"
            text = f"{_MOST_WAITING} {what}, the limit for a link or a reader; try again later"
            raise RefusedError(503, text, headers={"retry-after": "5"})

    def _check_host(self, headers: Headers) -> None:
        given = headers.getlist("host")
        if len(given) == 1:
            match = _HOST.fullmatch(given[0].lower())
            name = match["name"].strip("[]") if match else ""
            if name in self._hosts or (self._any_address and _is_address(name)):
                return
        raise RefusedError(400, "Host: this server does not answer to this name; use the address that it printed")

    def _enter(self, scope: Scope) -> Access | None:
        """Remove the first part from the address of a page; return the access it belongs to."""
        inside = self._accesses.by_first_part("/" + scope["path"][1:].partition("/")[0])
        scope["root_path"] = inside.settings.root if inside else ""
        return inside

    def _welcome(self, scope: Scope, inside: Access | None) -> Response | None:
        """Sign in: a page address with a valid token starts a session, and redirects to the page without the token."""
        place = _place(scope)
        if scope["method"] != "GET" or place.startswith(API):
            return None
        words = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True, separator="&")
        if not place or (place == "/" and inside and inside.settings.only_run):
            return RedirectResponse(f"{inside.settings.root}{_first_page(inside)}" if inside else "/", 303)
        given = [value for name, value in words if name in _TOKENS]
        access = self._accesses.by_token(given[0]) if given else None
        if access is None:
            return None
        rest = urlencode([(name, value) for name, value in words if name not in _TOKENS])
        root = access.settings.root
        path = f"{root}{_first_page(access)}" if access.settings.only_run else f"{root}/{place.lstrip('/')}"
        response = RedirectResponse(f"{path}?{rest}" if rest else path, 303)
        session = self._sessions.open(access.name)
        response.set_cookie(self._settings.cookie, session, LIFETIME, httponly=True, samesite="strict", path=root)
        return response

    def _is_open(self, scope: Scope) -> bool:
        """Whether an address needs no token: health, assets, documentation."""
        place = _place(scope)
        return place == _OPEN or (scope["method"] in _SAFE and place.startswith(_PUBLIC))

    def _access(self, scope: Scope, headers: Headers, inside: Access | None) -> Access | None:
        """The access of a request, from a token, the key in a report page's address, or a session; None without one.

        Raises:
            RefusedError: 403 if this access may not use the address.
        """
        method, place = scope["method"], _place(scope)
        kind, _, given = headers.get("authorization", "").partition(" ")
        access = self._accesses.by_token(given.strip()) if kind.lower() == "bearer" else None
        if access is None and method in _SAFE:
            access = self._accesses.by_report(place)
        if access is None and not kind and inside and self._has_session(headers, inside):
            if method not in _SAFE and "origin" not in headers and "sec-fetch-site" not in headers:
                raise RefusedError(403, "Origin: a change by cookie must say from which page it comes")
            access = inside
        if access is not None and not self._is_open(scope):
            access.check(method, place)
        return access

    def _has_session(self, headers: Headers, inside: Access) -> bool:
        """Whether the cookie is of a session of the access to which the first part of the address belongs."""
        pairs = (pair.partition("=") for pair in headers.get("cookie", "").split(";"))
        values = [value for name, _, value in pairs if name.strip() == self._settings.cookie]
        return any(self._sessions.is_open(value, inside.name) for value in values)

    def _check_change(self, scope: Scope, headers: Headers) -> None:
        origin, site = headers.get("origin"), headers.get("sec-fetch-site")
        if origin is not None and origin.lower() != f"{scope['scheme']}://{headers['host']}".lower():
            raise RefusedError(403, "Origin: changes are taken from this server's own pages only")
        if site is not None and site != "same-origin":
            raise RefusedError(403, "Sec-Fetch-Site: changes are taken from this server's own pages only")

    async def _body(self, scope: Scope, headers: Headers, receive: Receive) -> bytes:
        """The whole body, checked for its type and size."""
        kind = headers.get("content-type")
        if kind is not None and kind.partition(";")[0].strip().lower() != "application/json":
            raise RefusedError(415, f"Content-Type: {kind[:100]}: application/json is needed")
        limits = self._settings.limits
        most = limits.measurement_bytes if scope["path"].endswith(_WITH_FILES) else limits.body_bytes
        length = headers.get("content-length", "")
        too_large = RefusedError(413, f"the body is larger than {most:,} bytes, which is the limit here")
        if length.isdecimal() and int(length[:20]) > most:
            raise too_large
        body, started = bytearray(), asyncio.get_running_loop().time()
        while True:
            try:
                async with asyncio.timeout_at(started + BODY_SECONDS + len(body) / BODY_RATE):
                    message = await receive()
            except TimeoutError as error:
                raise RefusedError(408, f"the body arrives too slowly: {len(body):,} bytes so far") from error
            if message["type"] != "http.request":
                raise RefusedError(400, "the client went away")
            body += message.get("body", b"")
            if len(body) > most:
                raise too_large
            if not message.get("more_body"):
                break
        if body and kind is None:
            raise RefusedError(415, "Content-Type: application/json is needed")
        return bytes(body)


def _first_page(access: Access) -> str:
    """The first page after signing in: the list of runs, or the only run."""
    return f"/runs/{access.settings.only_run}" if access.settings.only_run else "/"


def _unknown() -> RefusedError:
    return RefusedError(
        401,
        "a token is needed: open the address that the server printed at its start, or send "
        "'Authorization: Bearer TOKEN'",
        headers={"www-authenticate": "Bearer"},
    )


def _place(scope: Scope) -> str:
    """The address of a request without the first part of pages."""
    return str(scope["path"]).removeprefix(scope["root_path"])


def _is_address(name: str) -> bool:
    """Whether a host is a plain address, which no name server can change."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _with_headers(send: Send) -> Send:
    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = {name.lower() for name, _ in message["headers"]}
            message["headers"] = [*message["headers"], *(header for header in _HEADERS if header[0] not in given)]
        await send(message)

    return send_with_headers
