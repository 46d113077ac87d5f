"""Who may open the studio's page: programs of this machine, or whoever knows its token."""

import asyncio
import hmac
import http
import ipaddress
import secrets
import socket
import time
import urllib.parse
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from http.cookies import CookieError, SimpleCookie
from typing import Any

import websockets.asyncio.server
from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from everystate.errors import EverystateError

MESSAGE_LIMIT = 1 << 20
"""Bytes of a message from a browser; sliders and buttons send a few hundred."""
MESSAGE_RATE = 200
"""Messages a second from one browser; one that drags a slider sends about 60."""
_FORM = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Everystate</title>
<body style="font: 16px/1.5 system-ui, sans-serif; max-width: 32rem; margin: 4rem auto">
<h1 style="font-size: 1.4rem">Everystate</h1><form>
<p>The token that <code>everystate studio</code> printed, please:</p>
<input name="token" type="password" autofocus> <button>Open</button></form></body></html>
"""


class Gate:
    """Stands before a viser server, which lets in everybody.

    On this machine alone (127.0.0.1, ::1, localhost) no token is asked for, but a page of another
    site that the user happens to have open is kept out. On any other address everybody needs
    the token, once: a cookie remembers it.
    """

    def __init__(self, host: str) -> None:
        """A gate for one address; `token` is made where it is not this machine's own."""
        self.host = host
        self.local = _is_local(host)
        self.token = None if self.local else secrets.token_urlsafe(16)
        self._cookie = f"everystate_{secrets.token_hex(4)}"  # Ports share a browser's cookies.

    def address(self, port: int) -> str:
        """What to type into a browser, the token included."""
        named = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(
            self.host, f"[{self.host}]" if ":" in self.host else self.host
        )
        return f"http://{named}:{port}" + (f"/?token={self.token}" if self.token else "")

    def answer(self, request: Request) -> Response | None:
        """What to answer instead of the page, or nothing for those who may have it."""
        asked = urllib.parse.urlsplit(request.path)
        host = request.headers.get("Host", "")
        if self.local and not _is_local(urllib.parse.urlsplit(f"//{host}").hostname or ""):
            return _refusal(f"{host} is no name of this machine alone")  # a rebound name
        origin = request.headers.get("Origin")
        if origin is not None and urllib.parse.urlsplit(origin).netloc != host:
            return _refusal(f"a page of {origin} may not open a studio of {host}")
        if self.token is None or self._is_known(_cookie(request, self._cookie)):
            return None
        given = urllib.parse.parse_qs(asked.query).get("token", [""])[0]
        if not self._is_known(given):
            return _response(http.HTTPStatus.UNAUTHORIZED, _FORM)
        # To the page without the token, which is not to stay in the browser's history.
        cookie = f"{self._cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
        return _response(http.HTTPStatus.SEE_OTHER, "", {"Location": "/", "Set-Cookie": cookie})

    def _is_known(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), str(self.token).encode())

    @contextmanager
    def around(self) -> Iterator[None]:
        """A viser server that is made herein is behind the gate.

        Viser has no setting for it, so its call of `websockets.serve` gets the gate to ask.

        Raises:
            EverystateError: it was not asked for, as it might be with another version of viser.
        """
        serve, asked = websockets.asyncio.server.serve, []

        def guarded(handle: Callable, *args: Any, process_request: Callable, **options: Any) -> Any:
            def process(connection: ServerConnection, request: Request) -> Response | None:
                response = self.answer(request) or process_request(connection, request)
                if response is not None:  # Nor may it stand in a frame of another site's page.
                    response.headers["Content-Security-Policy"] = "frame-ancestors 'self'"
                return response

            async def unhurried(connection: ServerConnection) -> None:
                connection.recv = _unhurried(connection.recv)  # pyright: ignore
                try:
                    await handle(connection)
                except Exception:  # of a message that is none; the page sends no such
                    await connection.close(CloseCode.INVALID_DATA, "not a message of this page")

            asked.append(self)
            options["max_size"] = MESSAGE_LIMIT
            return serve(unhurried, *args, process_request=process, **options)

        websockets.asyncio.server.serve = guarded
        _infra.AsyncMessageBuffer = _Buffer  # pyright: ignore
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve
            _infra.AsyncMessageBuffer = AsyncMessageBuffer  # pyright: ignore
        if not asked:
            raise EverystateError("this version of viser cannot be guarded: install viser 1.1.1")


class _SetInItsLoop(asyncio.Event):
    """An event that takes no notice of other threads."""

    def set(self) -> None:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


class _Buffer(AsyncMessageBuffer):
    """What waits to be sent to all browsers.

    Viser sets its event twice: from the thread that has something to say, at once, which fails now
    and then while many browsers wait; and in the loop of those who wait, which is enough.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.message_event = _SetInItsLoop()


def _unhurried(receive: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable[Any]]:
    """Receives at most `MESSAGE_RATE` a second; the rest of a flood waits in its own socket."""
    began, count = time.monotonic(), 0

    async def receive_in_time() -> Any:
        nonlocal began, count
        passed = time.monotonic() - began
        if passed >= 1:
            began, count = time.monotonic(), 0
        elif count >= MESSAGE_RATE:
            await asyncio.sleep(1 - passed)
        count += 1
        return await receive()

    return receive_in_time


def _is_local(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _cookie(request: Request, name: str) -> str:
    try:
        cookies = SimpleCookie("; ".join(request.headers.get_all("Cookie")))
    except CookieError:
        return ""
    return cookies[name].value if name in cookies else ""


def _refusal(why: str) -> Response:
    return _response(
        http.HTTPStatus.FORBIDDEN, f"Refused: {why}.\n", {"Content-Type": "text/plain"}
    )


def _response(
    status: http.HTTPStatus, text: str, headers: dict[str, str] | None = None
) -> Response:
    body = text.encode()
    fields = {"Content-Type": "text/html", "Content-Length": str(len(body))} | (headers or {})
    fields |= {"X-Content-Type-Options": "nosniff", "Cache-Control": "no-store"}
    return Response(status, status.phrase, Headers(fields), body)
