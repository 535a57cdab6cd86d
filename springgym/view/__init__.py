"""``springgym view``: turn, play and change a scene or an episode in the browser.

`motion`    what is shown: positions over time, and how they are drawn
`stage`     draws it with viser
`page`      clock, sliders, graph
`origin_guard`  who may speak to it, and what it takes from them
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
from os.path import isfile
from pathlib import Path
from typing import Any

from springgym.extras import missing
from springgym.registration import nearest_id
from springgym.scenes import load, names
from springgym.scenes.film import told
from springgym.scenes.recording import Recording, record
from springgym.stability import automatic_step
from springgym.view.knobs import knobs
from springgym.view.motion import Motion, of_recording
from springgym.view.page import FPS, STYLE, TICKS, Changes, Page, Subject, key

PORT = 8080


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "what",
        nargs="?",
        default="top",
        help="scene (springgym simulate --list), YAML file, or environment id",
    )
    parser.add_argument(
        "--agent", help="run folder of springgym train, id of a published agent, zero or random"
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
    _check_saved(args.save)
    subject = _subject(args)
    save_page(subject.make(subject.names[0], {}), args.save)
    print(f"wrote {args.save}")
    return 0


def show(subject: Subject, port: int = PORT, browser: bool = True, address: str | None = None) -> None:
    """Serve a page, print where it is and, unless told not to, open it, until Ctrl-C is pressed.

    Parameters
    ----------
    port
        The first that is free from this one on; of 0, any.
    address
        The IPv4 address to serve it at for others in the network, or "0.0.0.0" for all that this machine has;
        then the printed address holds a token, without which nobody is let in. If None, it is served to this
        machine alone.

    Raises
    ------
    ValueError
        If this machine has no such address.
    """
    server, url = _served(port, address)
    try:
        page = Page(server, subject)
        print(f"{subject.names[0]}: {url} (Ctrl-C ends)", flush=True)
        if browser:
            webbrowser.open(url)
        page.run()
    except KeyboardInterrupt:
        print()
    finally:
        _end(server)


def _subject(args: argparse.Namespace) -> Subject:
    """Return what the arguments name."""
    if args.agent is None and not _is_environment(args.what):
        return scenes(args.what)
    from springgym.view.episodes import episodes, find_agent

    return episodes(find_agent(args.agent, args.what), args.seed)


def _is_environment(what: str) -> bool:
    """Return whether a name is like the id of an environment, and not that of a scene or a file."""
    if what in names() or isfile(what):
        return False
    return re.search(r"-v[0-9]+$", what) is not None or nearest_id(what) is not None


def scenes(first: str) -> Subject:
    """Offer a scene by name or file and, to choose from, those that come with the package."""
    load(first)  # says what is wrong with the name
    others = [name for name in names() if name != first]
    return Subject("scene", [first, *others], simulated, knobs)


def simulated(scene: str, changes: Changes) -> Motion:
    """Simulate a scene with some numbers of its file changed.

    A step that the file gives is kept where it is small enough for what has become of the body.
    """
    plan = load(scene, changes)
    if plan.step is not None and changes:
        from springgym.integrators import integrator

        plan = replace(plan, step=min(plan.step, automatic_step(plan.scene, integrator(plan.integrator))))
    return of_recording(record(plan, contacts=True))


def save_page(motion: Motion | Recording, path: str | Path, speed: float | None = None) -> None:
    """Write a motion as a page that turns and plays without springgym, or anything else.

    Parameters
    ----------
    motion
        Or a recording of a scene.
    path
        A .html file holds the viewer, too: some 1 MB, that any browser opens from where it lies. A .viser
        file is a fifth of it, and is played by the viewer of `save_viewer`. It shows what films show, without
        arrows and springs: it has no key to them.
    speed
        Seconds of the motion a second of playing; if not given, the fastest at which the eye can follow.

    Raises
    ------
    ValueError
        If the name ends in neither.
    """
    from springgym.view.stage import Stage, look_from
    from springgym.view.stage import record as play

    path = Path(path)
    _check_saved(path)
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
            path.write_text(f"{head}{STYLE}{legend}</body>{tail}", encoding="utf-8")
        else:
            path.write_bytes(serializer.serialize())
    finally:
        _end(server)


def save_viewer(path: str | Path) -> None:
    """Write the viewer that plays .viser files from a web server.

    Saved as view.html, it plays top.viser beside it at the address ``view.html?playbackPath=top.viser``.
    """
    import viser

    page = Path(viser.__file__).parent / "client" / "build" / "index.html"
    Path(path).write_bytes(page.read_bytes())


def _check_saved(path: Path) -> None:
    """Refuse a file of the wrong kind before the work is done."""
    if path.suffix.lower() not in (".html", ".viser"):
        raise ValueError(f"{path}: the name of a saved page must end in .html or .viser")
    if not path.absolute().parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.absolute().parent}")


def _server(port: int) -> Any:
    """Start a server that pages of this machine alone reach."""
    return _served(port, None)[0]


def _served(port: int, address: str | None) -> tuple[Any, str]:
    """Start a server, and return where a browser finds it, see `springgym.view.origin_guard`."""
    try:
        import viser
    except ImportError as error:
        raise ImportError(missing("viewing", "viser", "view")) from error
    from springgym.view.origin_guard import HOST, OriginGuard

    guard = OriginGuard(port, address)
    with (
        guard.installed(),
        redirect_stdout(io.StringIO()),
    ):  # it prints its address in a frame; ours is a line
        server = viser.ViserServer(host=HOST, port=guard.port, label="springgym", verbose=False)
    return guard.guard(server), guard.url


def _end(server: Any) -> None:
    with redirect_stdout(io.StringIO()):
        server.stop()
