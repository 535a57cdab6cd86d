"""Who may speak to a page, and what it takes from them.

viser's server listens on this machine alone. Still, every page that a browser here shows can open a
connection to it, and the browser names that page in the header ``Origin``. viser looks at neither this nor
``Host``, and takes any value for anything. The door stands before it:

- A connection comes from a page of this very server, see `stranger`.
- A message is one that the page can send: a camera, a command, or a value of what the panel shows. A choice
  is one of those offered; a number is clamped to the ends of its slider. See `Door.admitted`.
- There are at most `CONNECTIONS` at once, and no message is longer than `LONGEST`.

What is refused goes no further, and nobody is told.
"""

from __future__ import annotations

import errno
import math
import re
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

import msgspec
import viser
import websockets.asyncio.server as websocket
from websockets.datastructures import Headers

from springgym.checks import chosen, number, whole

HOST = "127.0.0.1"
NAMES = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?")
"""What a browser on this machine calls it, with a port: that of the server, or one that is led to it."""
CONNECTIONS = 16
"""Open at once."""
LONGEST = 4096
"""Bytes of a message: a page's own have 300 at the most."""
DEPTH = 2
"""Lists within a camera's message."""


def stranger(headers: Headers) -> str:
    """Why a request is no page's of this machine; "" if it is one.

    A browser lets no page choose ``Host`` and ``Origin``. ``Host`` is the name that was asked for, and gives
    away a foreign name that was made to lead here. ``Origin`` is the page that asks; a request for a file may
    lack it, one for a connection may not.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or not NAMES.fullmatch(hosts[0].lower()):
        return f"Host is {hosts}; it must be this machine"
    own = [f"http://{hosts[0].lower()}"]
    if (origins or "Upgrade" in headers) and [origin.lower() for origin in origins] != own:
        return f"Origin is {origins}; it must be {own}"
    return ""


class Door:
    """Guards the viser server that is made while the door is `hung`.

    Parameters
    ----------
    port
        The first to listen on that is free from this one on; of 0, any that is free.
    """

    def __init__(self, port: int) -> None:
        self._socket = _bound(port)
        self.port: int = self._socket.getsockname()[1]
        self._panel: Mapping[str, Any] = {}
        self._connections = 0
        self._hung = False

    @contextmanager
    def hung(self) -> Iterator[None]:
        """Have the server that viser makes in the meantime for `HOST` and `port` listen behind the door."""
        serve = websocket.serve

        def guarded(handler: Any, host: Any = None, port: Any = None, **settings: Any) -> Any:
            if (host, port) != (HOST, self.port):
                return serve(handler, host, port, **settings)
            self._hung = True
            settings |= {
                "process_request": self._answering(settings["process_request"]),
                "create_connection": self._connection(),
                "max_size": LONGEST,
            }
            return serve(self._counting(handler), sock=self._socket, **settings)

        setattr(websocket, "serve", guarded)  # noqa: B010 (viser takes no setting that would do)
        try:
            yield
        except BaseException:
            self._socket.close()
            raise
        finally:
            setattr(websocket, "serve", serve)  # noqa: B010

    def guard(self, server: Any) -> Any:
        """Let in what the panel of a server offers; the server."""
        if not self._hung:
            server.stop()
            self._socket.close()
            raise RuntimeError(f"viser {viser.__version__} starts its server in a way that cannot be guarded")
        self._panel = server.gui._gui_input_handle_from_uuid
        return server

    # --- Connections --------------------------------------------------------------------------------

    def _answering(self, answer: Any) -> Any:
        def answered(connection: Any, request: Any) -> Any:
            if why := stranger(request.headers):
                return connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")
            return answer(connection, request)

        return answered

    def _counting(self, handler: Any) -> Any:
        async def counted(connection: Any) -> None:
            if self._connections >= CONNECTIONS:
                await connection.close(1013, f"{CONNECTIONS} pages are open already")
                return
            self._connections += 1
            try:
                await handler(connection)
            finally:
                self._connections -= 1

        return counted

    def _connection(self) -> type[websocket.ServerConnection]:
        door = self

        class Guarded(websocket.ServerConnection):
            async def recv(self, decode: bool | None = None) -> Any:
                while True:
                    message = door.admitted(await super().recv(decode))
                    if message is not None:
                        return message

        return Guarded

    # --- Messages -----------------------------------------------------------------------------------

    def admitted(self, raw: Any) -> bytes | None:
        """A message as viser may have it; None if it may not."""
        try:
            return msgspec.msgpack.encode(self._read(msgspec.msgpack.decode(raw)))
        except (TypeError, ValueError, KeyError, RecursionError):  # msgspec's are ValueErrors
            return None

    def _read(self, message: Any) -> dict[str, Any]:
        kind = message["type"]
        if kind == "ViewerCameraMessage":
            return {"type": kind} | {str(k): _pose(v) for k, v in message.items() if k != "type"}
        named = {"type": kind, "uuid": str(message["uuid"])}
        if kind == "CommandTriggerMessage":
            return named
        if kind != "GuiUpdateMessage" or set(message["updates"]) != {"value"}:
            raise ValueError("no message of a page")
        value = taken(self._panel[named["uuid"]], message["updates"]["value"])
        return named | {"updates": {"value": value}}


def taken(handle: Any, value: Any) -> Any:
    """Return what a part of the panel takes for a value that it is given.

    Raises
    ------
    TypeError, ValueError
        If it takes nothing like it.
    """
    if handle.disabled or not handle.visible:
        raise ValueError("it is not offered")
    if isinstance(handle, viser.GuiSliderHandle):
        return min(max(number("value", value), handle.min), handle.max)
    if isinstance(handle, viser.GuiDropdownHandle):
        return chosen("value", value, handle.options)
    if isinstance(handle, (viser.GuiCheckboxHandle, viser.GuiButtonHandle)) and isinstance(value, bool):
        return value
    raise TypeError("it takes no such value")


def _pose(value: Any, depth: int = DEPTH) -> Any:
    """Numbers of a camera, all finite."""
    if isinstance(value, list) and depth:
        return [_pose(part, depth - 1) for part in value]
    if not (type(value) in (int, float) and math.isfinite(value)):
        raise ValueError("it is no number")
    return value


def _bound(port: int) -> socket.socket:
    """A socket that listens on the first port that is free from one on."""
    first = whole("port", port, high=2**16 - 1)
    for free in range(first, 2**16):
        try:
            return socket.create_server((HOST, free))
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
    raise OSError(f"port is {first}; no port from it on is free")
