"""``springgym view``: rotate, play and change a scene or an episode in the browser.

`motion`    positions over time, with all data for drawing them
`stage`     draws motions with viser
`page`      clock, sliders, graph
`origin_guard`  access control: clients and messages
`knobs`     the numbers of a scene file that sliders change
`episodes`  episodes of environments as motions
"""

from __future__ import annotations

import argparse
import io
import re
import webbrowser
from contextlib import redirect_stdout
from dataclasses import replace
from os import PathLike
from os.path import isfile
from pathlib import Path
from typing import Any

from springgym.checks import instance, number, printable
from springgym.cli import check_new, whole_file
from springgym.core.extras import missing
from springgym.dynamics.stepping import plan_steps
from springgym.envs.registration import nearest_id
from springgym.scenes import load, names
from springgym.scenes.film import SLOWEST, told
from springgym.scenes.recording import Recording, record
from springgym.view.knobs import knobs
from springgym.view.motion import Motion, of_recording
from springgym.view.page import FPS, STYLE, TICKS, Changes, Page, Subject, key

ENDINGS = (".html", ".viser")
PORT = 8080


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "scene",
        nargs="?",
        default="top",
        help="scene (springgym simulate --list), YAML file, or environment id",
    )
    parser.add_argument(
        "--agent", help="run folder of springgym train, id of a published agent, noop or random"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the first episode")
    parser.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="write a stand-alone page (.html), or data for a viser client (.viser)",
    )
    parser.add_argument("--port", type=int, default=PORT, help="first port to try (0: any free port)")
    parser.add_argument(
        "--address",
        help="IPv4 address to listen on (0.0.0.0: all); other machines connect with the printed URL, which "
        "holds a token",
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the URL")


def run(args: argparse.Namespace) -> int:
    """Run the command with its arguments; return the exit status."""
    if args.save is None:
        show(_subject(args), args.port, browser=not args.no_browser, address=args.address)
        return 0
    check_new(args.save, ENDINGS)
    subject = _subject(args)
    save_page(subject.make(subject.names[0], {}), args.save)
    print(f"wrote {printable(str(args.save))}")
    return 0


def show(subject: Subject, port: int = PORT, browser: bool = True, address: str | None = None) -> None:
    """Serve a page, print its address and, if ``browser``, open it, until Ctrl-C is pressed.

    Parameters
    ----------
    port
        First port to try; 0 takes any free port.
    address
        IPv4 address to listen on for other machines, or "0.0.0.0" for all addresses of this machine; the
        printed URL then contains a token that is required for access. If None, only this machine has access.

    Raises
    ------
    ValueError
        If this machine has no such address.
    """
    server, url = _served(port, address)
    try:
        page = Page(server, subject)
        print(f"{printable(subject.names[0])}: {url} (press Ctrl-C to stop)", flush=True)
        if browser:
            webbrowser.open(url)
        page.run()
    except KeyboardInterrupt:
        print()
    finally:
        _end(server)


def _subject(args: argparse.Namespace) -> Subject:
    """Return the subject that the arguments name."""
    if args.agent is None and not _is_environment(args.scene):
        return scenes(args.scene)
    from springgym.view.episodes import episodes, find_agent

    return episodes(find_agent(args.agent, args.scene), args.seed)


def _is_environment(what: str) -> bool:
    """Return whether a name has the form of an environment's id, and is not that of a scene or a file."""
    if what in names() or isfile(what):
        return False
    return re.search(r"-v[0-9]+$", what) is not None or nearest_id(what) is not None


def scenes(first: str) -> Subject:
    """Return a subject with a scene, by name or file, and those of the package to choose from."""
    load(first)  # raises an error for a wrong name
    others = [name for name in names() if name != first]
    return Subject("scene", [first, *others], simulated, knobs)


def simulated(scene: str, changes: Changes) -> Motion:
    """Return the motion of a scene with some numbers of its file changed.

    A step given in the file is kept if it is small enough for the changed body.
    """
    plan = load(scene, changes)
    if plan.step is not None and changes:
        longest = plan_steps(plan.scene, integrator=plan.integrator).step
        plan = replace(plan, step=min(plan.step, longest))
    return of_recording(record(plan, contacts=True))


def save_page(motion: Motion | Recording, path: str | Path, speed: float | None = None) -> None:
    """Write a motion as an interactive page that needs neither springgym nor a server.

    Parameters
    ----------
    motion
        The motion, or a recording of a scene.
    path
        A .html file contains the viewer, too: some 1 MB, which any browser opens from disk. A .viser file has
        a fifth of this size, and is played by the viewer of `save_viewer`. The page shows what films show,
        without arrows and springs, for which it has no legend.
    speed
        Simulated seconds per second of playing; by default, the fastest speed that the eye can follow.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If the speed is out of bounds, or the name ends in neither .html nor .viser.
    """
    from springgym.view.stage import Stage, look_from, play

    instance("motion", motion, Motion, Recording)
    path = Path(instance("path", path, str, PathLike))
    speed = None if speed is None else number("speed", speed, SLOWEST)
    check_new(path, ENDINGS)
    alone = path.suffix.lower() == ".html"
    if isinstance(motion, Recording):
        motion = of_recording(motion)
    server = _server(PORT)
    try:
        stage = Stage(server)
        if alone:
            stage.show(springs=motion.glassy)
        else:
            stage.show(springs=False, forces=False, rotation=False, contacts=False)
        stage.set_up(motion)
        look_from(server.initial_camera, stage.camera(motion))
        pace = motion.speed(FPS) if speed is None else speed
        if pace != 1:
            stage.write(told(pace))
        serializer = play(server, stage, motion, FPS, pace)
        if alone:
            head, _, tail = serializer.as_html().rpartition("</body>")
            legend = key(motion, [tick for tick in TICKS if stage.shows(tick)], stage.strain_scale)
            content = f"{head}{STYLE}{legend}</body>{tail}".encode()
        else:
            content = serializer.serialize()
        with whole_file(path) as temporary:
            temporary.write_bytes(content)
    finally:
        _end(server)


def save_viewer(path: str | Path) -> None:
    """Write the viewer that plays .viser files from a web server.

    Saved as view.html, it plays top.viser in the same folder at the URL ``view.html?playbackPath=top.viser``.
    """
    import viser

    page = Path(viser.__file__).parent / "client" / "build" / "index.html"
    with whole_file(Path(instance("path", path, str, PathLike))) as temporary:
        temporary.write_bytes(page.read_bytes())


def _server(port: int) -> Any:
    """Start a server that only pages on this machine can reach."""
    return _served(port, None)[0]


def _served(port: int, address: str | None) -> tuple[Any, str]:
    """Start a server, and return it with the URL of its page, see `springgym.view.origin_guard`."""
    try:
        import viser
    except ImportError as error:
        raise ImportError(missing("viewing", "viser", "view")) from error
    from springgym.view.origin_guard import HOST, OriginGuard

    guard = OriginGuard(port, address)
    with (
        guard.installed(),
        redirect_stdout(io.StringIO()),
    ):  # viser prints its address in a frame, springgym in a line
        server = viser.ViserServer(host=HOST, port=guard.port, label="springgym", verbose=False)
    return guard.guard(server), guard.url


def _end(server: Any) -> None:
    with redirect_stdout(io.StringIO()):
        server.stop()
