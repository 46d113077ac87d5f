"""The studio lets in whom it should, and nobody hinders the others."""

import asyncio
import contextlib
import http.client
from collections.abc import Iterator
from contextlib import closing
from email.message import Message
from typing import NamedTuple
from urllib.parse import urlsplit

import msgspec
import pytest
import viser
import websockets
import websockets.asyncio.server

from everystate.errors import EverystateError
from everystate.viewing import gate
from everystate.viewing.gate import MESSAGE_LIMIT, MESSAGE_RATE, Gate
from everystate.viewing.studio import Studio
from waiting import until

PROTOCOL = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def local() -> Iterator[Studio]:
    page = Studio("ramp-pointmass", port=0)
    yield page
    page.close()


@pytest.fixture(scope="module")
def opened() -> Iterator[Studio]:
    page = Studio("ramp-pointmass", host="0.0.0.0", port=0)
    yield page
    page.close()


class Answer(NamedTuple):
    status: int
    text: str
    headers: Message


def get(studio: Studio, path: str = "/", **headers: str) -> Answer:
    with closing(
        http.client.HTTPConnection("127.0.0.1", port_of(studio), timeout=10)
    ) as connection:
        connection.request("GET", path, headers=headers)
        with connection.getresponse() as answer:
            text = answer.read().decode(errors="replace")
            return Answer(answer.status, text, answer.headers)


def port_of(studio: Studio) -> int:
    return urlsplit(studio.address).port or 0


def connect(studio: Studio, **options) -> websockets.connect:
    options.setdefault("subprotocols", [PROTOCOL])
    return websockets.connect(f"ws://127.0.0.1:{port_of(studio)}", max_size=None, **options)


async def refused(studio: Studio, **options) -> int:
    """The status with which a websocket is refused."""
    with pytest.raises(websockets.exceptions.InvalidStatus) as caught:
        async with connect(studio, **options):
            pass
    return caught.value.response.status_code


def test_this_machine_needs_no_token(local: Studio) -> None:
    assert local.gate.token is None
    assert get(local).status == 200
    assert get(local, Host="localhost:8080").status == 200


def test_pages_of_others_are_kept_out_though_a_browser_here_opened_them(local: Studio) -> None:
    assert get(local, Host="evil.example:8080").status == 403
    origin = "http://evil.example"
    assert asyncio.run(refused(local, origin=origin)) == 403
    assert asyncio.run(refused(local, origin="null")) == 403
    assert get(local).headers["Content-Security-Policy"] == "frame-ancestors 'self'"
    answer = get(local, Origin=origin)
    assert "a page of http://evil.example may not open" in answer.text


def test_others_need_the_token_once(opened: Studio) -> None:
    token = opened.gate.token
    assert token is not None
    assert opened.address.endswith(f"/?token={token}")
    answer = get(opened)
    assert answer.status == 401
    assert "everystate studio" in answer.text
    for wrong in ("", "x", token[:-1], "%C3%A9", token + "x"):
        assert get(opened, f"/?token={wrong}").status == 401
    answer = get(opened, f"/?token={token}")
    assert (answer.status, answer.headers.get("Location")) == (303, "/")
    cookie = str(answer.headers.get("Set-Cookie"))
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    named = cookie.partition(";")[0]
    assert get(opened, Cookie=named).status == 200
    assert get(opened, Cookie=f"other=1; {named}").status == 200
    assert get(opened, Cookie=f"{named.partition('=')[0]}=x").status == 401
    assert get(opened, Cookie="ü=;;=").status == 401
    assert asyncio.run(refused(opened)) == 401

    async def greeted() -> bytes | str:
        async with connect(opened, additional_headers={"Cookie": named}) as socket:
            return await socket.recv()

    assert asyncio.run(greeted())


def test_files_beside_the_page_are_not_served(local: Studio) -> None:
    for path in ("/../_viser.py", "/%2e%2e/_viser.py", "/..%5c_viser.py", "//etc/passwd"):
        assert get(local, path).status == 404


def test_addresses_are_written_as_a_browser_takes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate.socket, "gethostname", lambda: "here")
    assert Gate("127.0.0.1").address(80) == "http://127.0.0.1:80"
    assert Gate("::1").address(80) == "http://[::1]:80"
    assert Gate("0.0.0.0").address(80).startswith("http://here:80/?token=")
    assert Gate("192.168.0.7").address(80).startswith("http://192.168.0.7:80/?token=")


def test_a_server_that_cannot_be_guarded_is_not_served() -> None:
    with pytest.raises(EverystateError, match="cannot be guarded"), Gate("0.0.0.0").around():
        pass
    assert websockets.asyncio.server.serve.__name__ == "serve"


def test_no_message_stops_the_others(local: Studio) -> None:
    """Garbage, too much, and a flood: each hurts the one that sent it."""

    async def closed_by(message: bytes | str) -> int:
        async with connect(local) as socket:
            await socket.send(message)
            await asyncio.wait_for(socket.wait_closed(), 10)
            return socket.close_code or 0

    for garbage in (b"", b"\xff" * 100, b"\x81\xa4type\xa4None", "text"):
        assert asyncio.run(closed_by(garbage)) == 1007
    assert asyncio.run(closed_by(b"\x00" * (MESSAGE_LIMIT + 1))) == 1009
    before = local.world.steps
    until(lambda: local.world.steps > before)


def test_of_a_flood_so_many_a_second_are_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]

    async def sleep(seconds: float) -> None:
        now[0] += seconds

    async def receive() -> float:
        return now[0]

    async def heard(messages: int) -> list[float]:
        unhurried = gate._unhurried(receive)
        return [await unhurried() for _ in range(messages)]

    monkeypatch.setattr(gate.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(gate.asyncio, "sleep", sleep)
    times = asyncio.run(heard(3 * MESSAGE_RATE))
    assert max(times.count(second) for second in (0.0, 1.0, 2.0)) <= MESSAGE_RATE + 1
    assert times[-1] == 2.0


def test_a_flood_is_heard_to_its_end_and_stops_nobody(local: Studio) -> None:
    slider = local._panel.goal.sliders["x"]

    def moved_to(value: float) -> bytes:
        message = {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid}
        return msgspec.msgpack.encode(message | {"updates": {"value": value}})

    async def flood() -> None:
        async with connect(local) as socket:
            for i in range(2 * MESSAGE_RATE):
                await socket.send(moved_to(0.5 - i / 1000))
            await socket.send(moved_to(0.75))
            while slider.value != 0.75:
                await asyncio.sleep(0.01)

    until(lambda: local.world.steps)  # its programs are compiled
    before = local.world.steps
    asyncio.run(asyncio.wait_for(flood(), 60))
    until(lambda: local.world.steps > before)


def test_many_clients_that_do_not_listen_neither_stop_it_nor_fill_its_memory(
    local: Studio,
) -> None:
    """What is not read yet is replaced by what is newer, not heaped up."""
    waiting = local._server._websock_server._broadcast_buffer.message_from_id

    async def crowd() -> tuple[int, int]:
        async with contextlib.AsyncExitStack() as stack:
            for _ in range(20):
                await stack.enter_async_context(connect(local, max_queue=1))
            sizes = []
            for _ in range(2):
                begun = local.world.steps
                while local.world.steps < begun + 40:
                    await asyncio.sleep(0.05)
                sizes.append(len(waiting))
            return sizes[0], sizes[1]

    before, after = asyncio.run(asyncio.wait_for(crowd(), 60))
    assert after <= before + 5
