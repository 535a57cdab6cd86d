"""The page: an interactive stage, playback, sliders and a graph."""

from __future__ import annotations

import html
import logging
import threading
import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext
from fractions import Fraction
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from springgym.checks import chosen
from springgym.rendering.look import ORANGE, RED, Color
from springgym.rendering.solids import COLD, HOT, NEUTRAL
from springgym.scenes.plan import SPEEDS
from springgym.simulator import SimulationDivergedError
from springgym.view.knobs import Knob
from springgym.view.motion import Motion
from springgym.view.stage import Stage, group_of, look_from

FPS = 30.0
"""Frames per second that are sent to the browser."""
READ_EVERY = 4
"""Frames between two updates of the readings and of the graph's pointer."""
SAMPLES = 400
"""Largest number of points of a curve in the graphs."""
BRAND: Color = (43, 92, 150)
REFIT = 1.25
"""Ratio of distances from which on a changed motion moves the camera."""
PATIENCE = 0.5
"""Simulating for longer than this is reported on the page [s]."""
WIDTH = 380
"""Width of the panel [pixels]."""
STYLE = f"""<style>
.over {{position: fixed; top: .8em; left: .9em; max-width: min(26em, 85vw); pointer-events: none;
  font-size: .8em; line-height: 1.5; color: #343c4c; text-shadow: 0 0 3px #fff, 0 0 6px #fff}}
.over b {{font-size: 1.4em; margin-right: .2em}}
.told {{position: fixed; top: 40%; left: calc(50vw - {WIDTH // 2}px); transform: translate(-50%, -50%);
  width: max-content; max-width: 24em; padding: .8em 1.2em; border-radius: 6px; background: #fff;
  box-shadow: 0 1px 8px #0003; pointer-events: none; overflow-wrap: anywhere}}
.text {{max-width: 95%; padding: 0 .75rem .6rem; font-size: .875rem; line-height: 1.55;
  overflow-wrap: anywhere}}
.wrong {{border-left: 5px solid #be323c}}
@media (max-width: 36em) {{
  .over {{font-size: .7em; line-height: 1.35}}
  .told {{top: 25%; left: 50vw; max-width: 80vw}}
  [style*="max-height: 60%"] {{width: 100% !important; max-height: 50% !important}}
  [style*="max-height: 60%"] [style*="width: 20em"] {{width: 100% !important}}
}}
</style>"""
"""Style of the overlay; on a phone the panel is as wide as the page, and covers at most half of it."""
TICKS = {
    "trace": "the path of the traced particle",
    "springs": "the springs, coloured by their strain, through the body",
    "forces": "the weight, and the reaction of the pin and the surfaces",
    "rotation": "angular momentum L and angular velocity ω",
    "contacts": "contact points and contact forces",
    "rigid twin": "the trace of the same particles as a rigid body, dashed",
    "follow": "move with the centre of mass",
}
"""Names of what can be shown, with explanations."""

Changes = Mapping[tuple[str, ...], float]
TORN = "The springs cannot hold this motion: make them stiffer, or the motion slower. In numbers: "
"""Advice for changes of a scene that make it diverge."""


class Subject(NamedTuple):
    """The subject of a page: a choice of scenes or episodes."""

    kind: str
    """what the names are"""
    names: Sequence[str]
    """names to choose from; the first is shown first"""
    make: Callable[[str, Changes], Motion]
    """returns the motion for a name and the numbers changed by sliders"""
    knobs: Callable[[str], Sequence[Knob]]
    """returns the sliders for a name"""


class Page:
    """A page on a viser server; `run` plays it until `stop`.

    Parameters
    ----------
    server
        A `viser.ViserServer`.
    subject
        What is shown.
    """

    def __init__(self, server: Any, subject: Subject) -> None:
        self._server = server
        self._gui = server.gui
        self._subject = subject
        self._stage = Stage(server)
        self._lock = threading.RLock()
        self._wanted: tuple[str, Changes] | None = None
        self._asked = threading.Event()
        self._due: dict[str, Callable[[], None]] = {}
        self._stopped = threading.Event()
        self._sliders: dict[Knob, Any] = {}
        self._folders: list[Any] = []
        self._frame = 0
        self._begun: float | None = None
        self.name = subject.names[0]
        """the selected name"""
        self.motion = subject.make(self.name, {})
        """the shown motion"""
        self.time = 0.0
        """present time of the motion [s]"""
        self.playing = True
        self._build()
        self._turn_to(self.name, self.motion)
        server.on_client_connect(self._welcome)

    def run(self) -> None:
        """Play until `stop` is called."""
        worker = threading.Thread(target=self._work, daemon=True)
        worker.start()
        last = clock.perf_counter()
        while not self._stopped.wait(max(0.0, last + 1 / FPS - clock.perf_counter())):
            now = clock.perf_counter()
            for name in list(self._due):
                self._tried(self._due.pop(name))
            if self._begun is None:
                if self.playing and not self._tried(partial(self._advance, now - last)):
                    self.play(False)
            else:
                with self._lock:
                    if self._begun is not None and now - self._begun > PATIENCE:
                        self._say("simulating …")
            last = now
        self._asked.set()
        worker.join()

    def _advance(self, elapsed: float) -> None:
        """Advance the motion by ``elapsed`` seconds of wall-clock time, times the chosen speed."""
        with self._lock:
            self.time += elapsed * float(Fraction(self._speed.value))
            if self.time > self.motion.times[-1]:
                self.time = 0.0
            self._draw(read=self._frame % READ_EVERY == 0)
            self._frame += 1

    def _tried(self, action: Callable[[], None]) -> bool:
        """Call ``action``, show any error on the page, and return whether there was none."""
        try:
            action()
        except Exception as error:
            if not isinstance(error, (ValueError, ArithmeticError)):
                logging.getLogger("springgym").exception("the page could not do that")
            what = str(error) or type(error).__name__
            advice = TORN if isinstance(error, SimulationDivergedError) else ""
            self._say(f"⚠ {advice}{what}", wrong=True)
            return False
        return True

    def stop(self) -> None:
        """End `run`."""
        self._stopped.set()

    def play(self, playing: bool) -> None:
        """Play or pause; without a motion, nothing is played."""
        self.playing = playing and self._shown
        self._button.label = "Pause" if self.playing else "Play"
        if self.playing:
            self._say("")
        self._due["clock"] = self._settle

    def _settle(self) -> None:
        """Update clock and readings to the current frame."""
        with self._lock:
            self._read()

    # --- The panel ----------------------------------------------------------------------------------

    def _build(self) -> None:
        gui = self._gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
        gui.set_panel_label("springgym")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        gui.add_html(STYLE)
        self._key, self._over = gui.add_html(""), gui.add_html("")
        self._shown = True
        self._chooser = None
        if len(self._subject.names) > 1:
            self._chooser = gui.add_dropdown(
                self._subject.kind, tuple(self._subject.names), initial_value=self.name
            )
            self._heed(self._chooser, "choice", lambda name: self._ask(name, {}))
        self._title = gui.add_html("")
        self._button = gui.add_button("Pause", hint="shortcut: space bar")
        self._button.on_click(lambda event: self.play(not self.playing))
        gui.add_command("play or pause", hotkey="space").on_trigger(lambda event: self.play(not self.playing))
        self._moment = gui.add_slider("Time [s]", 0.0, 1.0, 0.001, 0.0)
        self._heed(self._moment, "time", self._seek)
        self._speed = gui.add_dropdown("Speed", tuple(map(fraction, SPEEDS)), initial_value="1")
        self._readings = gui.add_html("")
        tabs = gui.add_tab_group()
        self._tab = tabs.add_tab("Parameters")
        with self._tab:
            self._nothing = gui.add_html(text_block("No adjustable parameters.", "i"))
            self._reset = gui.add_button("Reset", order=1e6)
            self._reset.on_click(lambda event: self._due.update(sliders=self._restore))
        with tabs.add_tab("Show"):
            self._ticks = {
                name: gui.add_checkbox(name, self._stage.shows(name), hint=hint)
                for name, hint in TICKS.items()
            }
        for tick in self._ticks.values():
            self._heed(tick, "ticks", lambda _: self._ticked())
        graph = gui.add_panel()
        self._graph_tab = graph.add_tab("Graph")
        with self._graph_tab:
            graphs = tuple(self.motion.graphs)
            self._graphed = gui.add_dropdown("Quantity", graphs, initial_value=graphs[0])
            self._heed(self._graphed, "graph", lambda _: self._replot())
        graph.float(x=12, y=-12, width=370, height=290)
        self._plot: Any = None
        self._summary = gui.add_html("")

    def _turn_to(self, name: str, motion: Motion) -> None:
        """Show another motion, from its start."""
        self.name = name
        self.time = 0.0
        for part in (*self._sliders.values(), *self._folders):
            part.remove()
        self._sliders = {}
        self._folders = []
        with self._tab:
            for body, knobs in groupby(self._subject.knobs(name), lambda knob: knob.body):
                folder = self._gui.add_folder(body) if body else None
                self._folders += [] if folder is None else [folder]
                with folder or nullcontext():
                    for knob in knobs:
                        self._sliders[knob] = self._gui.add_slider(
                            knob.label, knob.low, knob.high, knob.step, knob.start
                        )
        for slider in self._sliders.values():
            self._heed(slider, "sliders", lambda _: self._slid())
        self._reset.visible, self._nothing.visible = bool(self._sliders), not self._sliders
        travels = float(np.linalg.norm(np.ptp(motion.centre, axis=0))) > 6 * motion.extent
        self._ticks["follow"].value = travels
        self._ticks["springs"].value = motion.glassy
        self._stage.show(follow=travels, springs=motion.glassy)
        self._speed.value = fraction(motion.speed(FPS))
        self._show(motion)
        self._look()

    def _look(self) -> None:
        """Set the camera of all present and later clients to show the whole motion."""
        camera = self._stage.camera(self.motion)
        self._distance = camera.distance
        look_from(self._server.initial_camera, camera)
        for client in self._server.get_clients().values():
            self._place(client)

    def _welcome(self, client: Any) -> None:
        """Place the camera of a client that connects, and again whenever its aspect ratio changes.

        It changes right after connecting, when the panel takes its part of the window.
        """
        aspect = client.camera.aspect

        def seen(camera: Any) -> None:
            nonlocal aspect
            if abs(camera.aspect / aspect - 1.0) > 0.01:
                aspect = camera.aspect
                self._due[f"camera {client.client_id}"] = partial(self._place, client)

        client.camera.on_update(seen)
        self._place(client)  # only now, so that a change in between is not missed

    def _place(self, client: Any) -> None:
        """Place the camera of a client so that the motion is in the part of the picture beside the panel."""
        with self._lock:
            look_from(client.camera, self._stage.camera(self.motion, client.camera.aspect))

    def _show(self, motion: Motion) -> None:
        """Show a motion at the present time of the clock."""
        self.motion = motion
        last = float(motion.times[-1])
        self.time = min(self.time, last)
        with self._server.atomic():
            self._stage.set_up(motion)
            self._shown = True
            self._say("")
            self._offer()
            self._title.content = text_block(motion.title, "b")
            self._summary.content = text_block(motion.summary)
            self._moment.max = last
            if tuple(motion.graphs) != tuple(self._graphed.options):
                graph = self._graphed.value
                self._graphed.options = tuple(motion.graphs)
                self._graphed.value = graph if graph in motion.graphs else next(iter(motion.graphs))
            for name, tick in self._ticks.items():
                tick.visible = _there(name, motion)
            self._show_legend()
            self._replot()
            self._draw(read=True)

    def _clear(self) -> None:
        """Show nothing, as no motion belongs to the present sliders."""
        with self._lock, self._server.atomic():
            self._shown = False
            self.play(False)
            self._stage.clear()
            self._readings.content = self._summary.content = ""
            self._show_legend()
            self._offer()

    def _offer(self) -> None:
        """Enable the controls to play, seek and read, if anything is shown."""
        self._button.disabled = self._moment.disabled = not self._shown
        if self._plot is not None:
            self._plot.visible = self._shown

    def _say(self, text: str, wrong: bool = False) -> None:
        """Show a message over the stage."""
        kind = "told wrong" if wrong else "told"
        self._over.content = f"<div class='{kind}'>{html.escape(text)}</div>" if text else ""

    def _show_legend(self) -> None:
        """Show the legend of the colours over the stage."""
        shown = {name for name, tick in self._ticks.items() if tick.value}
        self._key.content = key(self.motion, shown, self._stage.strain_scale) if self._shown else ""

    # --- What the user does -------------------------------------------------------------------------

    def _heed(self, part: Any, name: str, action: Callable[[Any], None]) -> None:
        """Call ``action`` with a control's value at the next frame after a user changed it.

        Of several changes under one ``name`` in a frame, only the last one counts.
        """

        def changed(event: Any) -> None:
            if event.client is not None:  # otherwise the page itself changed it
                self._due[name] = partial(action, part.value)

        part.on_update(changed)

    def _seek(self, time: float) -> None:
        with self._lock, self._server.atomic():
            self.time = float(time)
            if self.playing:
                # earlier frames may still reach the client: the clock is sent again even if it is equal
                self._moment.value = -1.0
            self.play(False)
            self._draw(read=True)

    def _ticked(self) -> None:
        with self._lock:
            self._stage.show(**{name.replace(" ", "_"): tick.value for name, tick in self._ticks.items()})
            self._show_legend()
            self._draw(read=False)

    def _slid(self) -> None:
        numbers = {knob: knob.number(float(slider.value)) for knob, slider in self._sliders.items()}
        self._ask(self.name, {knob.path: n for knob, n in numbers.items() if n != knob.value})

    def _restore(self) -> None:
        for knob, slider in self._sliders.items():
            slider.value = knob.start
        self._ask(self.name, {})

    def _ask(self, name: str, changes: Changes) -> None:
        """Request a motion from the worker; earlier requests that were not begun are dropped."""
        wanted = (chosen(self._subject.kind, name, self._subject.names), changes)
        with self._lock:
            self._wanted, self._begun = wanted, clock.perf_counter()
            self._asked.set()

    def _work(self) -> None:
        """Make the requested motions, in the worker's thread."""
        while self._asked.wait() and not self._stopped.is_set():
            self._asked.clear()
            wanted = self._wanted
            self._wanted = None
            if wanted is not None and not self._tried(partial(self._make, *wanted)):
                self._clear()

    def _make(self, name: str, changes: Changes) -> None:
        """Make a motion and show it."""
        try:
            motion = self._subject.make(name, changes)
        finally:
            with self._lock:
                if self._wanted is None:
                    self._begun = None
        with self._lock:
            if name == self.name:
                self._show(motion)
                if not 1 / REFIT < self._stage.camera(motion).distance / self._distance < REFIT:
                    self._look()
            else:
                self._turn_to(name, motion)
            if self._chooser is not None:
                self._chooser.value = name  # a choice that failed may be selected

    # --- Drawing ------------------------------------------------------------------------------------

    def _draw(self, read: bool) -> None:
        with self._server.atomic():
            self._stage.draw(self.time)
            if read:
                self._read()

    def _read(self) -> None:
        """Set clock, readings and the graph's pointer to the time of the motion."""
        if not self._shown:
            return
        motion = self.motion
        n, share = self.motion.at(self.time)
        self._moment.value = round(self.time, 3)
        texts = list(motion.marks[n].text) if motion.marks else []
        texts += [
            f"{name.split(' [')[0]} {round(curve.at(n, share), 5) + 0.0:.3g}{_unit(name)}"
            for name, curves in motion.graphs.items()
            if len(curves) == 1
            for curve in curves.values()
        ]
        self._readings.content = text_block(" · ".join(texts))
        curves = motion.graphs.get(self._graphed.value)
        if curves and self._plot is not None:
            self._plot.data = (*self._plotted, self._pointer())

    def _replot(self) -> None:
        """Draw the selected graph."""
        from viser import uplot

        with self._lock:
            curves = self.motion.graphs.get(self._graphed.value)
            if curves is None:
                return
            every = max(1, -(-len(self.motion.times) // SAMPLES))
            self._sampled = self.motion.times[::every]
            self._plotted = (
                self._sampled,
                *(curve.values[::every].astype(float) for curve in curves.values()),
            )
            low = min(float(values.min()) for values in self._plotted[1:])
            high = max(float(values.max()) for values in self._plotted[1:])
            spread = high - low or abs(high) or 1.0
            self._range = (
                min(low, 0.0) if low > -0.05 * spread else low - 0.05 * spread,
                high + 0.05 * spread,
            )
            series = [
                uplot.Series(label=name, stroke=f"rgb{curve.color}", width=1.6, points={"show": False})
                for name, curve in curves.items()
            ]
            pointer = uplot.Series(
                label="now", stroke="rgba(40,50,70,.55)", width=1.2, points={"show": False}
            )
            shown = {
                "data": (*self._plotted, self._pointer()),
                "series": (uplot.Series(label="over t [s]"), *series, pointer),
                "scales": {
                    "x": uplot.Scale(time=False, auto=False, range=(0.0, float(self.motion.times[-1]))),
                    "y": uplot.Scale(auto=False, range=self._range),
                },
                "legend": uplot.Legend(show=len(curves) > 1, live=False),
                "height": 170 if len(curves) > 1 else 195,
            }
            if self._plot is None:
                with self._graph_tab:
                    self._plot = self._gui.add_uplot(**shown)
                return
            with self._server.atomic():
                for name, value in shown.items():
                    setattr(self._plot, name, value)

    def _pointer(self) -> np.ndarray:
        """Return a vertical line at the present time of the graph, as a curve that is NaN elsewhere."""
        values = np.full(len(self._sampled), np.nan)
        n = int(np.clip(np.searchsorted(self._sampled, self.time), 1, len(values) - 1))
        values[n - 1 : n + 1] = self._range
        return values


def text_block(text: str, tag: str = "span") -> str:
    """Return a text as a paragraph of the panel in HTML, escaped: it may come from anyone's file.

    viser's Markdown is no alternative, because it also renders the HTML in a text, and runs its scripts.
    """
    return f"<div class='text'><{tag}>{html.escape(text)}</{tag}></div>"


NAMES = {"angular velocity": "ω, angular velocity", "angular momentum": "L, angular momentum"}
"""Names of arrows in the legend that differ from their keys."""


def key(motion: Motion, ticks: Collection[str], strain: float) -> str:
    """Return the legend of the colours as HTML.

    Parameters
    ----------
    ticks
        Names of what is shown, see `TICKS`.
    strain
        The strain of full colour.
    """
    shown = {name for name in ticks if _there(name, motion)}
    lines = []
    if "springs" in shown:
        scale = f"{100 * strain:g} %"
        ramp = ", ".join(f"rgb({r:.0f},{g:.0f},{b:.0f})" for r, g, b in (COLD, NEUTRAL, HOT))
        lines.append(
            f"−{scale} <span style='display:inline-block;width:9em;height:.7em;border-radius:3px;"
            f"background:linear-gradient(to right,{ramp})'></span> +{scale} strain"
        )
    signs: list[tuple[str, Color, str]] = []
    if "trace" in shown:
        signs.append(("—", ORANGE, "trace"))
    if "rigid twin" in shown:
        signs.append(("┄", motion.paths["rigid twin"][1], "trace of the rigid twin"))
    for name, arrows in motion.arrows.items():
        if group_of(name) in shown:
            signs.append(("→", arrows.color, NAMES.get(name, name)))
    if "contacts" in shown:
        signs.append(("→", RED, "contact force"))
    signs += [("■", color, text) for text, color in motion.key.items()]
    lines += [f"<b style='color:rgb{color}'>{sign}</b>{html.escape(text)}" for sign, color, text in signs]
    lines += [html.escape(motion.note)] if motion.note else []
    return f"<div class='over'>{'<br>'.join(lines)}</div>"


def fraction(speed: float) -> str:
    """Return a speed as a text: "1/8", "1", "2"."""
    return str(Fraction(speed))


def _unit(graph: str) -> str:
    """Return the unit in the name of a graph."""
    if "[" not in graph:
        return ""
    unit = graph.split("[")[1].rstrip("]")
    return unit if unit == "°" else f" {unit}"


def _there(tick: str, motion: Motion) -> bool:
    """Return whether a motion has what a tick would show."""
    return {
        "trace": motion.look.trace is not None,
        "springs": len(motion.lengths) > 0,
        "forces": "weight" in motion.arrows,
        "rotation": any(group_of(name) == "rotation" for name in motion.arrows),
        "contacts": motion.touches is not None,
        "rigid twin": "rigid twin" in motion.paths,
        "follow": True,
    }[tick]
