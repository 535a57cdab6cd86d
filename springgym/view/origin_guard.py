"""Access control of a page: which clients may connect, and which messages are accepted.

viser's server listens only on this machine, unless another address is given. Still, every page open in a
browser here can connect to it; the browser names that page in the header ``Origin``. viser checks neither
this nor ``Host``, and accepts any value. So the guard checks:

- A connection must come from a page of this server, see `reject_reason`.
- With an address given by the user, everybody in the network can connect. Then the path of every request must
  begin with a random token, which is part of the printed URL.
- A message must be one that the page can send: a camera, a command, or a value of a control. A choice must be
  one of those offered; a number is clamped to the range of its slider. See `OriginGuard.accepted`.
- There are at most `CONNECTIONS` at once, and no message is longer than `LONGEST`.

Refused messages are dropped without notice.
"""

from __future__ import annotations

import errno
import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

import msgspec
import viser
import websockets.asyncio.server as websocket
from websockets.datastructures import Headers

from springgym.checks import HUGE, array, chosen, instance, number, shown, whole

HOST = "127.0.0.1"
"""The loopback address."""
ANY = "0.0.0.0"
"""The address that stands for all addresses of this machine."""
NAMES = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?")
"""Names by which a browser on this machine addresses it, with the server's port or a forwarded one."""
CONNECTIONS = 40
"""Largest number of open connections."""
LONGEST = 4096
"""Largest size of a message [bytes]: a page's own have at most 300."""
CAMERA: dict[str, tuple[int, ...]] = {
    "wxyz": (4,),
    **dict.fromkeys(("position", "look_at", "up_direction"), (3,)),
    **dict.fromkeys(("fov", "near", "far", "image_height", "image_width"), ()),
}
"""Shapes of the arrays in a camera's message."""
TOKEN = 16
"""Number of random bytes in a token."""


def reject_reason(headers: Headers, names: re.Pattern[str] | None = NAMES) -> str:
    """Return the reason why a request does not come from a page of this server; "" if it does.

    ``names`` are the allowed hosts; with None any host is allowed, and a token decides about access. Pages
    cannot choose ``Host`` and ``Origin`` in a browser. ``Host`` is the requested name, which reveals foreign
    names that resolve to this machine. ``Origin`` is the requesting page; requests for files may lack it,
    those for connections may not.
    """
    hosts = headers.get_all("Host")
    origins = headers.get_all("Origin")
    if len(hosts) != 1 or not (names is None or names.fullmatch(hosts[0].lower())):
        return f"Host is {hosts}; it must be this machine"
    own = [f"http://{hosts[0].lower()}"]
    if (origins or "Upgrade" in headers) and [origin.lower() for origin in origins] != own:
        return f"Origin is {origins}; it must be {own}"
    return ""


class OriginGuard:
    """A guard in front of the viser server that is created while the guard is `installed`.

    Parameters
    ----------
    port
        First port to try; 0 takes any free port.
    address
        IPv4 address to listen on, for clients that have the token; "0.0.0.0" for all addresses of this
        machine. If None, only this machine can connect, without a token.

    Raises
    ------
    ValueError
        If this machine has no such address.
    """

    def __init__(self, port: int, address: str | None = None) -> None:
        self._socket = _bound(port, HOST if address is None else address)
        self.port: int = self._socket.getsockname()[1]
        self._host: str = self._socket.getsockname()[0]
        self._token = None if address is None else secrets.token_urlsafe(TOKEN)
        self._panel: Mapping[str, Any] = {}
        self._connections = 0
        self._installed = False

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Context in which the server that viser creates for `HOST` and `port` is behind the guard."""
        serve = websocket.serve

        def guarded(handler: Any, host: Any = None, port: Any = None, **settings: Any) -> Any:
            if (host, port) != (HOST, self.port):
                return serve(handler, host, port, **settings)
            self._installed = True
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

    @property
    def url(self) -> str:
        """Return the address of the page, with the token."""
        host = _own_address() if self._host == ANY else self._host
        return f"http://{host}:{self.port}" + ("" if self._token is None else f"/{self._token}/")

    def guard(self, server: Any) -> Any:
        """Accept messages for the controls of a server's panel, and return the server."""
        if not self._installed:
            server.stop()
            self._socket.close()
            raise RuntimeError(f"viser {viser.__version__} starts its server in a way that cannot be guarded")
        self._panel = server.gui._gui_input_handle_from_uuid
        return server

    # --- Connections --------------------------------------------------------------------------------

    def _answering(self, answer: Any) -> Any:
        def answered(connection: Any, request: Any) -> Any:
            why = reject_reason(request.headers, NAMES if self._token is None else None)
            if self._token is not None:
                first, _, rest = request.path.removeprefix("/").partition("?")[0].partition("/")
                if not hmac.compare_digest(first.encode(errors="surrogateescape"), self._token.encode()):
                    why = "The token is missing or wrong; use the URL that springgym view printed"
                request.path = f"/{rest}"
            if why:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")
            return answer(connection, request)

        return answered

    def _counting(self, handler: Any) -> Any:
        async def counted(connection: Any) -> None:
            if self._connections >= CONNECTIONS:
                await connection.close(1013, f"too many open pages: at most {CONNECTIONS}")
                return
            self._connections += 1
            try:
                await handler(connection)
            finally:
                self._connections -= 1

        return counted

    def _connection(self) -> type[websocket.ServerConnection]:
        guard = self

        class Guarded(websocket.ServerConnection):
            async def recv(self, decode: bool | None = None) -> Any:
                while True:
                    message = guard.accepted(await super().recv(decode))
                    if message is not None:
                        return message

        return Guarded

    # --- Messages -----------------------------------------------------------------------------------

    def accepted(self, raw: Any) -> bytes | None:
        """Return a message in the form that is passed to viser; None if it is refused."""
        try:
            return msgspec.msgpack.encode(self._read(msgspec.msgpack.decode(raw)))
        except (TypeError, ValueError, KeyError, RecursionError):  # msgspec's are ValueErrors
            return None

    def _read(self, message: Any) -> dict[str, Any]:
        kind = message["type"]
        if kind == "ViewerCameraMessage":
            return _checked_camera(message)
        named = {"type": kind, "uuid": str(message["uuid"])}
        if kind == "CommandTriggerMessage":
            return named
        if kind != "GuiUpdateMessage" or set(message["updates"]) != {"value"}:
            raise ValueError("no message of a page")
        value = taken(self._panel[named["uuid"]], message["updates"]["value"])
        return named | {"updates": {"value": value}}


def taken(handle: Any, value: Any) -> Any:
    """Return the value that a control accepts for a given one.

    Raises
    ------
    TypeError, ValueError
        If it accepts no such value.
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


def _checked_camera(message: dict[str, Any]) -> dict[str, Any]:
    """Return a camera's message after checking that it has all its numbers, and no others."""
    for name, shape in CAMERA.items():
        array(name, message[name], shape, low=1.0 if name.startswith("image") else -HUGE)
    if message.keys() != {"type", *CAMERA}:
        raise ValueError("a camera has no such entry")
    return message


def _own_address() -> str:
    """Return the address under which others in the network find this machine; without a network, `HOST`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an unused address, to which nothing is sent
        except OSError:
            return HOST
        return str(probe.getsockname()[0])


def _bound(port: int, address: str) -> socket.socket:
    """Return a socket that is bound to the first free port from ``port`` on."""
    try:
        ipaddress.IPv4Address(instance("address", address, str))
    except ValueError:
        raise ValueError(f"address is {shown(address)}; it must be an IPv4 address such as {ANY}") from None
    first = whole("port", port, high=2**16 - 1)
    for free in range(first, 2**16):
        try:
            return socket.create_server((address, free))
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise ValueError(f"address is {address}; this machine has no such address") from None
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
    raise OSError(f"port is {first}; no port from it on is free")
