"""Who may speak to a page, and what it takes: asked by clients of the real server."""

import json
import math
import re
import socket
import time
import urllib.error
import urllib.parse
import urllib.request

import numpy as np
import pytest

pytest.importorskip("viser")

import msgspec
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from springgym import view
from springgym.cli import main
from springgym.view import origin_guard

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [3.0, 3, 3],
    "fov": 0.5,
    "near": 0.1,
    "far": 100,
    "image_height": 300,
    "image_width": 400,
    "look_at": [0, 0, 0],
    "up_direction": [0, 0, 1],
}
SECRET = "what nobody offered"
PROTOCOL = f"viser-v{viser.__version__}"


@pytest.fixture
def server():
    made = view._server(0)
    yield made
    view._end(made)


@pytest.fixture
def panel(server):
    """One part of each kind that the page has, and one that it has not."""
    return {
        "slider": server.gui.add_slider("slider", 0.0, 2.0, 0.1, 1.0),
        "choice": server.gui.add_dropdown("choice", ("a", "b"), initial_value="a"),
        "tick": server.gui.add_checkbox("tick", False),
        "button": server.gui.add_button("button"),
        "hidden": server.gui.add_slider("hidden", 0.0, 2.0, 0.1, 1.0, visible=False),
        "shut": server.gui.add_slider("shut", 0.0, 2.0, 0.1, 1.0, disabled=True),
        "text": server.gui.add_text("text", "as it was"),
        "upload": server.gui.add_upload_button("upload"),
    }


def own(server, name="127.0.0.1"):
    return f"http://{name}:{server.get_port()}"


def connected(server, origin=None, **settings):
    return connect(
        f"ws://127.0.0.1:{server.get_port()}",
        origin=origin or own(server),
        subprotocols=[PROTOCOL],
        max_size=None,
        **settings,
    )


def send(client, *messages):
    for message in messages:
        client.send(message if isinstance(message, bytes | str) else msgspec.msgpack.encode(message))


def value(part, given, **others):
    return {"type": "GuiUpdateMessage", "uuid": part._impl.uuid, "updates": {"value": given, **others}}


def drained(client):
    """Read what there is, until the connection ends."""
    while True:
        client.recv(timeout=60)


def until(true):
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.01)


def asked(server, path="/", **headers):
    """Status and text of a request for a file."""
    request = urllib.request.Request(f"http://127.0.0.1:{server.get_port()}{path}", headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=60) as response:
            return response.status, response.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_a_page_of_another_origin_is_refused(server):
    port = server.get_port()
    strange = ["http://evil.example", f"https://127.0.0.1:{port}", "http://localhost:3000", "null"]
    strange += [f"http://127.0.0.1:{port}.evil.example", f"http://localhost:{port}", "http://127.0.0.1"]
    for origin in strange:
        with pytest.raises(InvalidStatus) as refused:
            connected(server, origin).close()
        assert refused.value.response.status_code == 403
        assert asked(server, Origin=origin)[0] == 403
    with pytest.raises(InvalidStatus):
        connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL]).close()
    assert not server.get_clients()


def test_a_foreign_name_that_leads_here_is_refused(server):
    for host in ("evil.example", f"evil.example:{server.get_port()}", "127.0.0.1.evil.example", ""):
        status, said = asked(server, Host=host)
        assert status == 403
        assert b"it must be this machine" in said
        url = f"ws://{host or 'evil.example'}/"
        with pytest.raises(InvalidStatus), socket.create_connection(("127.0.0.1", server.get_port())) as s:
            connect(url, sock=s, origin=f"http://{host}", subprotocols=[PROTOCOL]).close()


def test_its_own_page_is_let_in_under_each_name_of_this_machine(server):
    assert asked(server)[0] == 200
    assert asked(server, Origin=own(server))[0] == 200
    for name in (f"localhost:{server.get_port()}", "localhost:9", "localhost", "[::1]:80", "127.0.0.1"):
        assert asked(server, Host=name)[0] == 200
        assert asked(server, Host=name, Origin=f"http://{name}")[0] == 200
        assert asked(server, Host=name, Origin="http://evil.example")[0] == 403
    with connected(server) as client:
        send(client, CAMERA)
        until(server.get_clients)


def test_a_panel_takes_what_it_offers(server, panel):
    with connected(server) as client:
        send(client, CAMERA, value(panel["slider"], 0.5), value(panel["choice"], "b"))
        send(client, value(panel["tick"], True), value(panel["button"], True))
        until(lambda: panel["tick"].value and panel["choice"].value == "b" and panel["slider"].value == 0.5)
        for number, clamped in ((1e30, 2.0), (-5, 0.0), (2, 2.0)):
            send(client, value(panel["slider"], 1.5), value(panel["slider"], number))
            until(lambda c=clamped: panel["slider"].value == c)


def test_a_panel_takes_nothing_else(server, panel, recwarn):
    """Each as a message of its own, between two that are taken: the server is not ended by it, either."""
    slider = panel["slider"]
    choice = panel["choice"]
    tick = panel["tick"]
    before = {name: part.value for name, part in panel.items()}
    start = {"type": "FileTransferStartUpload", "source_component_uuid": panel["upload"]._impl.uuid}
    start |= {"transfer_uuid": "t", "filename": "f", "mime_type": "m", "part_count": 1, "size_bytes": 4}
    part = {"type": "FileTransferPart", "source_component_uuid": panel["upload"]._impl.uuid}
    part |= {"transfer_uuid": "t", "part_index": 0, "content": b"data"}
    deep = b"\x91" * 4000 + b"\xc0"
    wrong = [
        *(value(slider, v) for v in (math.nan, math.inf, -math.inf, "1", None, True, [1.0])),
        *(value(choice, v) for v in ("/etc/passwd", "9", "", 1, None, ["b"], {"b": 1})),
        *(value(tick, v) for v in (1, 0.5, "yes", None, [True])),
        *(value(panel[name], 0.5) for name in ("hidden", "shut")),
        *(value(panel["text"], v) for v in (SECRET, SECRET * 50)),
        *(value(slider, 1.5, **{name: 1}) for name in ("update_cb", "removed", "min", "uuid")),
        {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {"removed": True}},
        {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {}},
        {"type": "GuiUpdateMessage", "uuid": "nobody", "updates": {"value": 1.0}},
        {"type": "GuiUpdateMessage", "uuid": [slider._impl.uuid], "updates": {"value": 1.5}},
        {"type": "GuiUpdateMessage"},
        *(start, part),
        {"type": "ShareUrlRequest"},
        {"type": "GuiFormDirtyMessage", "uuid": slider._impl.uuid},
        {"type": "GuiButtonHoldMessage", "uuid": panel["button"]._impl.uuid, "frequency": 10.0},
        {"type": "RunJavascriptMessage", "source": "1"},
        {"type": "nothing"},
        {**CAMERA, "fov": math.nan},
        {**CAMERA, "position": [[[[1.0]]]]},
        *(
            {**CAMERA, name: wrong}
            for name in CAMERA
            for wrong in ("here", [1.0], None, {})
            if name != "type"
        ),
        *({n: v for n, v in CAMERA.items() if n in ("type", kept)} for kept in CAMERA),
        {**CAMERA, "image_height": 0},
        {**CAMERA, "more": 1},
        *([], 1, None, b"", b"\xc1", deep, json.dumps(value(slider, 1.5))),
    ]
    with connected(server) as client:
        send(client, CAMERA)
        until(server.get_clients)
        for turn, message in enumerate(wrong):
            send(client, message, value(panel["tick"], turn % 2 == 0))
            until(lambda n=turn: tick.value == (n % 2 == 0))
            now = {name: part.value for name, part in panel.items() if part is not tick}
            assert now == {name: was for name, was in before.items() if name != "tick"}, message
        assert not slider._impl.removed
        assert slider.min == 0.0
        assert server.gui._current_file_upload_states == {}
        camera = next(iter(server.get_clients().values())).camera
        assert np.isfinite(camera.position).all()


def test_memory_is_bounded(server, panel):
    # long messages end the connection
    with connected(server) as client:
        send(client, CAMERA)
        send(client, value(panel["choice"], "b" * origin_guard.LONGEST))
        with pytest.raises(ConnectionClosed):
            drained(client)
    until(lambda: not server.get_clients())
    # so does one connection more than there may be
    clients = [connected(server) for _ in range(origin_guard.CONNECTIONS)]
    with connected(server) as one, pytest.raises(ConnectionClosed, match="too many open pages"):
        drained(one)
    for client in clients:
        client.close()
    # and those that were closed make room
    until(lambda: not server._websock_server._live_connections)
    with connected(server) as client:
        send(client, CAMERA)
        until(server.get_clients)


def test_a_server_that_cannot_be_guarded_is_ended(monkeypatch):
    """A later viser may start it in another way."""
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", "0")
    with pytest.raises(RuntimeError, match=r"viser .* in a way that cannot be guarded"):
        view._server(0)


def test_the_next_free_port_is_taken_and_the_last_is_told(server):
    taken = server.get_port()
    other = view._server(taken)
    assert other.get_port() > taken
    view._end(other)
    with socket.socket() as last:
        last.bind(("127.0.0.1", 65535))
        last.listen()
        with pytest.raises(OSError, match="port is 65535; no port from it on is free"):
            view._server(65535)


@pytest.fixture
def open_to_others():
    made, url = view._served(0, "127.0.0.1")
    yield made, url
    view._end(made)


def test_at_an_address_that_is_asked_for_only_the_token_opens(open_to_others):
    server, url = open_to_others
    host, token = url.removeprefix("http://").rstrip("/").split("/")
    assert len(token) >= 4 * origin_guard.TOKEN / 3
    assert asked(server, f"/{token}/")[0] == 200
    assert asked(server, f"/{token}")[0] == 200
    assert asked(server, f"/{token}/?a=b/c")[0] == 200
    wrong = ["", token[:-1], token + "x", token.swapcase(), "x/" + token, "/" + token, f"?{token}"]
    wrong += ["%2e%2e", "..", "é"]
    for path in wrong:
        status, said = asked(server, "/" + urllib.parse.quote(path, safe="/?%."))
        assert status == 403, path
        assert token.encode() not in said
    for path in ("", token[:-1], f"?{token}", f"x/{token}", f"/{token}"):
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://{host}/{path}", origin=f"http://{host}", subprotocols=[PROTOCOL]).close()
        assert refused.value.response.status_code == 403
    for headers in ({"Origin": "http://evil.example"}, {"Host": "evil.example", "Origin": f"http://{host}"}):
        assert asked(server, f"/{token}/", **headers)[0] == 403
    assert not server.get_clients()
    with connect(
        f"ws://{host}/{token}", origin=f"http://{host}", subprotocols=[PROTOCOL], max_size=None
    ) as client:
        send(client, CAMERA)
        until(server.get_clients)


def test_bytes_that_are_no_letters_are_no_token(open_to_others):
    server, _ = open_to_others
    with socket.create_connection(("127.0.0.1", server.get_port())) as raw:
        raw.sendall(b"GET /\xff\xfe HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert raw.recv(99).split()[1] in (b"400", b"403")


def test_tokens_are_made_anew():
    first, second = (origin_guard.OriginGuard(0, "127.0.0.1") for _ in range(2))
    assert first.url.split("/")[3] != second.url.split("/")[3]
    for made in (first, second):
        made._socket.close()


def test_unasked_it_is_this_machine_alone(server):
    assert server.get_host() == "127.0.0.1"
    made = origin_guard.OriginGuard(0)
    assert made._socket.getsockname()[0] == "127.0.0.1"
    assert made.url == f"http://127.0.0.1:{made.port}"
    made._socket.close()
    everywhere = origin_guard.OriginGuard(0, "0.0.0.0")
    assert everywhere._socket.getsockname()[0] == "0.0.0.0"
    assert "0.0.0.0" not in everywhere.url
    everywhere._socket.close()


def test_the_address_with_the_token_is_printed(monkeypatch, capsys):
    monkeypatch.setattr(view.Page, "run", lambda page: None)
    assert main(["view", "top", "--address", "127.0.0.1", "--port", "0", "--no-browser"]) == 0
    printed = capsys.readouterr().out
    assert re.fullmatch(r"top: http://127\.0\.0\.1:\d+/[\w-]{22}/ \(press Ctrl-C to stop\)\n", printed)
