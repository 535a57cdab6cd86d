"""Figures of recordings, of the kinds that scene files name. Needs matplotlib.

Each has a picture of the body, drawn as in films, beside graphs. Colours have the same meaning in all:

======  ==========================================
orange  the traced particle
ink     the centre of mass
slate   what is lowest or farthest: tip, lowest particle
purple  angular velocity, in three shades
dashes  the rigid twin, and sums
others  energies, and what they belong to
======  ==========================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle
from typing import Any, Literal

import numpy as np

from springgym.checks import instance, printable
from springgym.core.extras import missing
from springgym.model.bodies.elastic import Elastic
from springgym.rendering import Camera
from springgym.rendering.ground import round_down
from springgym.scenes import film
from springgym.scenes.graphs import graphs, scaled
from springgym.scenes.recording import Recording, rigid_twin

try:
    import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec
    from matplotlib.ticker import MaxNLocator, ScalarFormatter
except ImportError as error:
    raise ImportError(missing("a plot", "matplotlib", "plot")) from error

__all__ = [
    "FINER",
    "SMALL",
    "bodies",
    "draw",
    "drop",
    "pendulum",
    "ringing",
    "rope",
    "rotation",
    "slide",
    "top",
]

TRACE = "#e45e2c"
CENTRE = "#343c4c"
OTHER = "#8b98a9"
SPRINGS = "#d39b2a"
TURNING = ("#b58bd6", "#8048a0", "#4a1f66")
OF_BODIES = ("#2b5c96", "#e45e2c", "#22966a", "#8048a0", "#d39b2a", "#3e929e", "#be323c", "#8b98a9")
DASHES = (0, (4, 3))
SMALL = 12.0
"""Size of the smallest text [pt]: 11 pixels in a figure of 11 inches shown 736 pixels wide."""
STYLE: dict[Any, Any] = {
    "font.size": SMALL,
    "axes.titlesize": SMALL,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e9ed",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": SMALL,
    "legend.handlelength": 1.2,
    "lines.linewidth": 1.3,
    "text.parse_math": False,  # titles and names are from files, and may hold a $
}
DPI = 130
FINER = 1.5
"""Pixels of a body's picture per pixel of the figure."""


def draw(recording: Recording) -> Figure:
    """Draw the figure of a recording; save it with its ``savefig``.

    Raises
    ------
    gymnasium.error.DependencyNotInstalled
        Without pygame, which draws the body.
    """
    plan = instance("recording", recording, Recording).plan
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(11, 4.6 if plan.plot == "top" else 5.8), dpi=DPI, layout="constrained")
        figure.suptitle(printable(plan.title[:1].upper() + plan.title[1:]), fontsize=13)
        PLOTS[plan.plot](recording, figure)
    return figure


# --- The picture ------------------------------------------------------------------------------------


def _picture(
    recording: Recording,
    figure: Figure,
    place: SubplotSpec,
    size: tuple[float, float],
    moments: Sequence[int] = (),
    title: str = "",
    until: int | None = None,
) -> Axes:
    """Draw the body at some moments, with the path of the traced particle and that of the centre of mass.

    ``size`` is that of the picture in inches. Without moments, it is drawn at the end.
    """
    if not moments:
        moments = [len(recording.times) - 1]
        title = f"at {recording.times[-1]:g} s"
    pixels = (round(FINER * DPI * size[0]), round(FINER * DPI * size[1]))
    camera = film.camera(recording, pixels, moments)
    axes = figure.add_subplot(place)
    axes.set_title(title)
    axes.imshow(film.strobe(recording, moments, camera, pixels), aspect="equal")
    axes.set_axis_off()
    plan = recording.plan
    shown = slice(0, None if until is None else until + 1)
    traced = None if plan.trace is None else recording.positions[shown, plan.trace]
    centre = recording.measures.centre[shown]
    if (
        len(plan.scene.bodies) == 1
        and not plan.scene.pinned
        and (traced is None or len(plan.scene.masses) > 1)
    ):
        _path_in(axes, camera, pixels, centre, CENTRE, "centre of mass")
    if traced is not None:
        _path_in(axes, camera, pixels, traced, TRACE, _part(recording))
    if len(moments) > 1:
        _clock(axes, recording, moments, camera, pixels)
    _ruler(axes, camera, pixels)
    axes.set(xlim=(0, pixels[0]), ylim=(pixels[1], 0))
    return axes


def _part(recording: Recording) -> str:
    """Return the name of the traced particle."""
    scene = recording.plan.scene
    trace = recording.plan.trace
    for placed, own in zip(scene.bodies, scene.slices, strict=True):
        for name, particles in placed.body.parts.items():
            if [own.start + i for i in particles] == [trace]:
                return name if len(scene.bodies) == 1 else f"{name} of {printable(placed.name)}"
    return "traced particle"


def _path_in(
    axes: Axes, camera: Camera, pixels: tuple[int, int], path: np.ndarray, color: str, name: str
) -> None:
    """Draw a path (T, 3) over a picture, and name it in its legend."""
    spots, _ = camera.project(path, pixels)
    axes.plot(*spots.T, color="w", linewidth=2.4, alpha=0.6)
    axes.plot(*spots.T, color=color, linewidth=1.2, label=name)
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 1.0), handlelength=1.2)


def _clock(
    axes: Axes, recording: Recording, moments: Sequence[int], camera: Camera, pixels: tuple[int, int]
) -> None:
    """Write the time over each pose that has room for it."""
    taken: list[np.ndarray] = []
    order = [moments[-1], *moments[:-1]]
    for moment in order:
        spots, _ = camera.project(recording.positions[moment], pixels)
        high = spots[np.argmin(spots[:, 1])]
        if all(np.abs((high - other) / (90, 34)).max() > 1 for other in taken):
            taken.append(high)
            time = f"{recording.times[moment]:.2g} s"
            x, y = high
            _named(axes, x, y, time, CENTRE, (0, 7), ha="center", va="baseline")


def _ruler(axes: Axes, camera: Camera, pixels: tuple[int, int]) -> None:
    """Draw a length as it is seen in the middle of the picture."""
    distance = camera.distance
    a_metre = camera.pixels_per_radian(pixels[1]) / distance
    length = round_down(0.25 * pixels[0] / a_metre)
    left = 0.04 * pixels[0]
    low = 0.965 * pixels[1]
    axes.plot([left, left + length * a_metre], [low, low], color=CENTRE, linewidth=2, solid_capstyle="butt")
    told = f"{length:g} m" if length >= 1 else f"{100 * length:g} cm"
    axes.text(left, low - 0.012 * pixels[1], told, fontsize=SMALL, color=CENTRE, va="bottom")


# --- Panels -----------------------------------------------------------------------------------------


def _panel(figure: Figure, place: SubplotSpec, title: str, across: str, up: str, **options: Any) -> Axes:
    axes = figure.add_subplot(place, **options)
    axes.set(title=title, xlabel=across, ylabel=up)
    series = across in ("", "t [s]")
    if series:
        axes.margins(x=0)
    axes.xaxis.set_major_locator(MaxNLocator(6 if series else 3, steps=[1, 2, 5, 10]))  # labels that fit
    across_format = ScalarFormatter()
    across_format.set_powerlimits((-2, 4))
    axes.xaxis.set_major_formatter(across_format)
    return axes


def _named(
    axes: Axes, x: float, y: float, text: str, color: str, aside: tuple[int, int] = (4, 0), **align: Any
) -> None:
    """Write a name ``aside`` [pt] of a point, by default to the right: that of a curve at its end."""
    look: dict[str, Any] = {"va": "center", "color": color, "fontsize": SMALL, **align}
    axes.annotate(text, (x, y), xytext=aside, textcoords="offset points", **look)


def _legend(axes: Axes, below: bool = False) -> None:
    """Draw the legend between a panel and its title, or below the panel."""
    entries = len(axes.get_legend_handles_labels()[0])
    columns = entries if entries <= 4 else 3
    place: Literal["upper center", "lower left"]
    if below:
        rows: Any = axes.get_subplotspec()
        place = "upper center"
        spot = (0.5, -0.36 if len(rows.rowspan) == 1 else -0.17)
    else:
        place = "lower left"
        spot = (-0.01, 0.985)
        axes.set_title(axes.get_title("left"), pad=5 + 1.5 * SMALL * -(-entries // max(columns, 1)))
    axes.legend(
        loc=place, bbox_to_anchor=spot, ncols=columns, columnspacing=1.0, handlelength=1.4, borderpad=0
    )


def _energies(recording: Recording, figure: Figure, place: SubplotSpec, below: bool = False) -> None:
    """Plot the energies and the losses over time; the legend may be ``below``."""
    title, curves = next(iter(graphs(recording.measures, recording.plan.scene).items()))
    name, unit = title.split(" [")
    axes = _panel(figure, place, name, "t [s]", f"[{unit}")
    for part, (values, color) in curves.items():
        style: dict[str, Any] = {"linestyle": DASHES, "linewidth": 1} if part == "sum" else {}
        axes.plot(recording.times, values, color=np.divide(color, 255), label=part, **style)
    if name == "energy":
        axes.set_ylim(0, 1.06 * float(curves["sum"].values.max()) or 1.0)
    _legend(axes, below)


def _path(recording: Recording) -> np.ndarray:
    """Return the path (T, 3) of the traced particle, or of the centre of mass, from the pin if any."""
    plan = recording.plan
    path = recording.measures.centre if plan.trace is None else recording.positions[:, plan.trace]
    if plan.scene.pinned:
        return path - recording.positions[:, plan.scene.pinned[0]]
    return path


# --- Kinds of plots ---------------------------------------------------------------------------------


def top(recording: Recording, figure: Figure) -> None:
    """Draw the crown's trace in space and from above, beside the rigid twin's; the tilt; the energies."""
    path = _path(recording)
    twin = rigid_twin(recording)
    pinned = bool(recording.plan.scene.pinned)
    grid = figure.add_gridspec(2, 3, width_ratios=(1.25, 1.15, 1.15))
    _picture(recording, figure, grid[:, 0], (3.7, 4.1))
    above = _panel(figure, grid[:, 1], "trace from above", "x [m]", "y [m]")
    above.plot(*path[:, :2].T, color=TRACE, label="springs" if pinned else _part(recording))
    if twin is not None:
        above.plot(*_path(twin)[:, :2].T, color="k", linestyle=DASHES, linewidth=0.8, label="rigid twin")
    if pinned:
        above.plot(0, 0, "+", color=CENTRE)
    else:
        foot = recording.positions[:, recording.plan.scene.body.markers[0]]
        above.plot(*foot[:, :2].T, color=OTHER, linewidth=0.8, label="tip")
        above.plot(*recording.measures.centre[:, :2].T, color=CENTRE, label="centre of mass")
    above.set_aspect("equal", adjustable="datalim" if not pinned else "box")
    _legend(above, below=True)
    tilt = _panel(figure, grid[0, 2], "tilt", "", "[°]")
    tilt.plot(recording.times, _tilt(recording), color=TRACE)
    if twin is not None:
        tilt.plot(twin.times, _tilt(twin), color="k", linestyle=DASHES, linewidth=0.8)
    _energies(recording, figure, grid[1, 2], below=True)


def _tilt(recording: Recording) -> np.ndarray:
    x, y, z = recording.measures.axis.T
    return np.degrees(np.arctan2(np.hypot(x, y), z))


def pendulum(recording: Recording, figure: Figure) -> None:
    """Draw the swing in space and from above; in time, beside the rigid twin's; the energies."""
    path = _path(recording)
    twin = rigid_twin(recording)
    sideways = path[np.argmax(np.hypot(path[:, 0], path[:, 1])), :2]
    sideways = sideways / (np.linalg.norm(sideways) or 1.0)
    grid = figure.add_gridspec(2, 3, width_ratios=(1.25, 0.9, 1.3))
    moments = film.poses(recording, 0.5)
    _picture(recording, figure, grid[:, 0], (3.9, 5.2), moments, "the swing")
    above = _panel(figure, grid[:, 1], "from above", "x [m]", "y [m]")
    above.plot(*path[:, :2].T, color=TRACE)
    above.plot(0, 0, "+", color=CENTRE)
    above.set_aspect("equal", adjustable="datalim")
    swing = _panel(figure, grid[0, 2], "angle from hanging", "", "[°]")
    swing.plot(recording.times, _angle(path, sideways), color=TRACE, label="springs")
    if twin is not None:
        angle = _angle(_path(twin), sideways)
        swing.plot(twin.times, angle, "k", linestyle=DASHES, linewidth=0.8, label="rigid twin")
    _legend(swing)
    _energies(recording, figure, grid[1, 2])


def _angle(path: np.ndarray, sideways: np.ndarray) -> np.ndarray:
    return np.degrees(np.unwrap(np.arctan2(path[:, :2] @ sideways, -path[:, 2])))


def rope(recording: Recording, figure: Figure) -> None:
    """Draw the rope at some moments; its length and its end in time; the energies."""
    x = recording.positions
    t = recording.times
    lengths = np.linalg.norm(np.diff(x, axis=1), axis=2).sum(axis=1)
    rest = float(recording.plan.scene.body.lengths.sum())
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.3))
    wide = np.ptp(x[..., 0])
    high = np.ptp(x[..., 2])
    if 1e-6 * high < wide < 0.05 * high:
        _stretched(recording, _panel(figure, grid[:, 0], "the rope, x stretched", "x [m]", "z [m]"))
    else:
        _picture(recording, figure, grid[:, 0], (4.4, 5.2), film.poses(recording, 0.05, 9), "the rope")
    unit, factor = scaled("m", lengths - rest)
    long = _panel(
        figure, grid[0, 1], f"length of the rope, less the {rest:g} m without load", "", f"[{unit}]"
    )
    long.plot(t, factor * (lengths - rest), color=SPRINGS)
    end = _panel(figure, grid[1, 1], "end of the rope, from its top", "", "[m]")
    ways = x[:, -1] - x[:, 0]
    for axis, style in ((0, "-"), (2, ":")):
        end.plot(t, ways[:, axis], style, color=TRACE)
        _named(end, t[-1], ways[-1, axis], "xyz"[axis], TRACE)
    _energies(recording, figure, grid[2, 1])


def _stretched(recording: Recording, axes: Axes) -> None:
    """Draw a rope that hardly moves sideways, at quarters of a second, later ones darker."""
    x = recording.positions
    t = recording.times
    shapes = x[:: max(1, round(0.25 / (t[1] - t[0])))][:24]
    for n, shape in enumerate(shapes):
        shade = 0.15 + 0.85 * n / len(shapes)
        axes.plot(shape[:, 0], shape[:, 2], ".-", color=OTHER, alpha=shade, linewidth=1, markersize=3)
    axes.plot(x[:, -1, 0], x[:, -1, 2], color=TRACE, linewidth=0.8)
    axes.plot(*x[0, 0, [0, 2]], "^", color=CENTRE)


def drop(recording: Recording, figure: Figure) -> None:
    """Draw the body at some moments; heights and energies in time."""
    x = recording.positions
    t = recording.times
    m = recording.measures
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.05))
    calm = int(np.argmax(m.energy < m.energy[-1] + 0.02 * (m.energy[0] - m.energy[-1]))) or len(t) - 1
    moments = film.poses(recording, 0.6, last=calm)
    title = f"until {t[calm]:.2g} s"
    _picture(recording, figure, grid[:, 0], (5.0, 5.2), moments, title, calm)
    high = _panel(figure, grid[0, 1], "height", "", "[m]")
    high.plot(t, m.centre[:, 2], color=CENTRE, label="centre of mass")
    high.plot(t, x[:, :, 2].min(axis=1), color=OTHER, label="lowest particle")
    high.axhline(0, color="k", linewidth=1)
    _legend(high)
    _energies(recording, figure, grid[1, 1])


def slide(recording: Recording, figure: Figure) -> None:
    """Draw the body at some moments; way and speed of its centre of mass; the energies."""
    t = recording.times
    m = recording.measures
    way = np.linalg.norm(m.centre - m.centre[0], axis=1)
    # from its displacement: where friction holds it, the velocity has the pull of half a step
    speed = np.linalg.norm(np.gradient(m.centre, t, axis=0), axis=1)
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.05))
    _picture(recording, figure, grid[:, 0], (5.0, 5.2), film.poses(recording, 1.1, 8), "")
    unit, factor = scaled("m", way)
    far = _panel(figure, grid[0, 1], "how far the centre of mass is from its start", "", f"[{unit}]")
    far.plot(t, factor * way, color=CENTRE)
    unit, factor = scaled("m/s", speed)
    fast = _panel(figure, grid[1, 1], "how fast it is", "", f"[{unit}]")
    fast.plot(t, factor * speed, color=CENTRE)
    for axes in (far, fast):
        axes.set_ylim(0, None)
    _energies(recording, figure, grid[2, 1])


def rotation(recording: Recording, figure: Figure) -> None:
    """Draw the angular velocity in the body's axes, with the twin's; a particle's path; the energies."""
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.4))
    _picture(recording, figure, grid[:, 0], (4.4, 5.2))
    where = "the world's" if _straight(recording) else "the body's"
    turning = _panel(figure, grid[0, 1], f"angular velocity in {where} axes", "", "[rad/s]")
    twin = rigid_twin(recording)
    for n, (name, color) in enumerate(zip(("ω₁", "ω₂", "ω₃"), TURNING, strict=True)):
        turning.plot(recording.times, _turning(recording)[:, n], color=color, label=name)
        if twin is not None:
            label = "rigid twin" if n == 2 else None
            turning.plot(twin.times, _turning(twin)[:, n], "k", linestyle=DASHES, linewidth=0.7, label=label)
    _legend(turning)
    _energies(recording, figure, grid[1, 1])


def bodies(recording: Recording, figure: Figure) -> None:
    """Draw the bodies at the end; over time, the heights of their centres of mass, their rates of rotation,
    the energies and, if they collide, the impulses between them.
    """
    t = recording.times
    scene = recording.plan.scene
    met = recording.plan.scene.meetings
    grid = figure.add_gridspec(4 if met else 3, 2, width_ratios=(1, 1.05))
    _picture(recording, figure, grid[:, 0], (5.0, 5.2))
    high = _panel(figure, grid[0, 1], "height of the centres of mass", "", "[m]")
    turning = _panel(figure, grid[1, 1], "angular speed", "", "[rad/s]")
    for placed, m, color in zip(scene.bodies, recording.bodies, cycle(OF_BODIES)):  # endless
        high.plot(t, m.centre[:, 2], color=color, label=printable(placed.name))
        if not placed.body.floppy:
            turning.plot(t, np.linalg.norm(m.angular_velocity, axis=1), color=color)
    for axes in (high, turning):
        low, top = axes.get_ylim()
        if top - low < 0.02 * abs(top):  # almost constant values are shown as constant
            axes.set_ylim(0, 1.15 * top)
    if len(scene.bodies) <= len(OF_BODIES):
        _legend(high)
    if met:
        given = _panel(figure, grid[2, 1], "impulse from body to body, so far", "", "[N·s]")
        for n, color in zip(np.flatnonzero(recording.pairs.impulse[-1] > 0).tolist(), cycle(OF_BODIES)):
            names = (printable(scene.bodies[body].name) for body in (met[n].first, met[n].second))
            given.plot(t, recording.pairs.impulse[:, n], color=color, label=" on ".join(names))
        if 0 < len(given.lines) <= 4:
            _legend(given)
    _energies(recording, figure, grid[-1, 1])


def ringing(recording: Recording, figure: Figure) -> None:
    """Draw a chord of the body, from the traced particle to the farthest one, in time; the energies.

    For a solid, a dashed line shows the decay of the first swing by its loss factor η: e^(−η ω₁ t/2).
    """
    plan = recording.plan
    x = recording.positions
    t = recording.times
    body = plan.scene.body
    first = plan.trace or 0
    far = int(np.argmax(np.linalg.norm(body.positions - body.positions[first], axis=1)))
    longer = np.linalg.norm(x[:, far] - x[:, first], axis=1)
    longer = longer - np.linalg.norm(body.positions[far] - body.positions[first])
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.4))
    _picture(recording, figure, grid[:, 0], (4.4, 5.2), [0], "")
    unit, factor = scaled("m", longer)
    swings = _panel(figure, grid[0, 1], "how much longer it is across", "", f"[{unit}]")
    swings.plot(t, factor * longer, color=TRACE, linewidth=0.7, label="springs")
    if isinstance(body.solid, Elastic):
        left = np.abs(longer).max() * np.exp(-body.solid.material.loss * body.solid.frequency * t / 2)
        for side, label in ((1, "solid"), (-1, None)):
            swings.plot(t, side * factor * left, "k", linestyle=DASHES, linewidth=0.7, label=label)
    _legend(swings)
    _energies(recording, figure, grid[1, 1])


def _straight(recording: Recording) -> bool:
    """Return whether the triad of the body has only a third axis, because its particles lie on a line."""
    return bool((np.linalg.norm(recording.measures.side, axis=1) < 0.5).any())


def _turning(recording: Recording) -> np.ndarray:
    """Return the angular velocity along the body's triad, (T, 3); along the world's without one."""
    m = recording.measures
    if _straight(recording):
        return m.angular_velocity
    triad = np.stack([m.side, np.cross(m.axis, m.side), m.axis], axis=1)
    return np.einsum("tki,ti->tk", triad, m.angular_velocity)


PLOTS: dict[str, Callable[[Recording, Figure], None]] = {
    plot.__name__: plot for plot in (top, pendulum, rope, drop, slide, rotation, bodies, ringing)
}
