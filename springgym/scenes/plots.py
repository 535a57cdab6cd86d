"""The figure a person would want of a recording: one kind a scene file can ask for by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from springgym.scenes.plan import Plot
from springgym.scenes.recording import Recording, rigid_twin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, SLATE, GOLD = "#2b5c96", "#e45e2c", "#22966a", "#60707f", "#d39b2a"
PALE = "#c3ccd6"
DASHES = (0, (4, 3))
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e9ed",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.3,
}


def draw(recording: Recording) -> Figure:
    """The figure of a recording; save it with its ``savefig``.

    Raises
    ------
    ImportError
        Without matplotlib.
    """
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install springgym[plot]") from error
    plan = recording.plan
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(11, 4.8 if plan.plot == "top" else 6.2), dpi=130, layout="constrained")
        figure.suptitle(plan.title[:1].upper() + plan.title[1:], fontsize=11, parse_math=False)
        PLOTS[plan.plot](recording, figure)
    return figure


# --- Panels -----------------------------------------------------------------------------------------


def _panel(figure: Figure, place: Any, title: str, across: str, up: str, **options: Any) -> Axes:
    axes = figure.add_subplot(place, **options)
    axes.set(title=title, xlabel=across, ylabel=up)
    return axes


def _legend(axes: Axes, below: bool = False) -> None:
    """Above the panel, beside its title; or below it."""
    rows: Any = axes.get_subplotspec()
    short = len(rows.rowspan) == 1
    place: Any = (
        ("upper center", (0.5, -0.26 if short else -0.19)) if below else ("lower right", (1.01, 0.985))
    )
    axes.legend(
        loc=place[0],
        bbox_to_anchor=place[1],
        ncols=6,
        columnspacing=1.0,
        handlelength=1.4,
        borderpad=0,
    )


def _energies(recording: Recording, axes: Axes, change: bool = False) -> None:
    """Where the energy is, and where it went; or how much of it moved since the start.

    Those of gravity and of the springs count from their least.
    """
    m, t = recording.measures, recording.times
    lost = m.damping_loss + m.contact_loss + m.friction_loss
    shown = {
        "kinetic": (m.kinetic, BLUE),
        "gravity": (m.gravity - m.gravity.min(), GREEN),
        "springs": (m.elastic - m.elastic.min(), GOLD),
        "contact": (m.contact, SLATE),
        "lost": (lost, ORANGE),
    }
    everything = np.sum([values for values, _ in shown.values()], axis=0)
    scale = everything.max()
    if change:
        shown = {name: (values - values[0], color) for name, (values, color) in shown.items()}
        everything = everything - everything[0]
        scale = max(np.abs(values).max() for values, _ in shown.values())
    for name, (values, color) in shown.items():
        if np.abs(values).max() > 3e-3 * scale:
            axes.plot(t, values, color=color, label=name)
    axes.plot(t, everything, "k--", linewidth=1, label="sum")
    if not change:
        axes.set_ylim(0, 1.06 * scale or 1.0)
    axes.margins(x=0)
    _legend(axes, below=change)


def _path(recording: Recording) -> np.ndarray:
    """Path of the traced particle, or of the centre of mass, from the pin if there is one, (T, 3)."""
    plan = recording.plan
    path = recording.measures.centre if plan.trace is None else recording.positions[:, plan.trace]
    if plan.scene.pinned:
        return path - recording.positions[:, plan.scene.pinned[0]]
    return path


def _square(axes: Axes) -> None:
    axes.set_aspect("equal", adjustable="datalim")


# --- Kinds of plots ---------------------------------------------------------------------------------


def top(recording: Recording, figure: Figure) -> None:
    """The crown's trace in space and from above, beside the rigid twin's; the tilt; the energies."""
    path, twin, pinned = _path(recording), rigid_twin(recording), bool(recording.plan.scene.pinned)
    grid = figure.add_gridspec(2, 3, width_ratios=(1.3, 1.15, 1.15))
    space = _space(recording, figure, grid[:, 0], path)
    if pinned:
        space.plot([0, 0], [0, 0], [0, 1.15 * path[:, 2].max()], color=SLATE, linestyle=":", linewidth=1)

    above = _panel(figure, grid[:, 1], "trace from above", "x [m]", "y [m]")
    above.plot(*path[:, :2].T, color=ORANGE, label="springs" if pinned else "crown")
    if twin is not None:
        above.plot(*_path(twin)[:, :2].T, color="k", linestyle=DASHES, linewidth=0.8, label="rigid")
    if pinned:
        above.plot(0, 0, "+", color=SLATE)
    else:
        foot = recording.positions[:, recording.plan.scene.body.frame[0]]
        above.plot(*foot[:, :2].T, color=BLUE, linewidth=0.8, label="tip")
        above.plot(*recording.measures.centre[:, :2].T, color=GREEN, label="centre of mass")
    above.set_aspect("equal", adjustable="datalim" if not pinned else "box")
    _legend(above, below=not pinned)

    tilt = _panel(figure, grid[0, 2], "tilt", "", "[°]")
    tilt.plot(recording.times, _tilt(recording), color=ORANGE)
    if twin is not None:
        tilt.plot(twin.times, _tilt(twin), color="k", linestyle=DASHES, linewidth=0.8)
    tilt.margins(x=0)
    _energies(recording, _panel(figure, grid[1, 2], "energy moved", "t [s]", "[J]"), change=True)


def _tilt(recording: Recording) -> np.ndarray:
    x, y, z = recording.measures.axis.T
    return np.degrees(np.arctan2(np.hypot(x, y), z))


def _space(recording: Recording, figure: Figure, place: Any, path: np.ndarray) -> Any:
    """The body at the end, and a path, in space."""
    space: Any = figure.add_subplot(place, projection="3d")
    x = recording.positions[-1]
    if recording.plan.scene.pinned:
        x = x - x[recording.plan.scene.pinned[0]]
    _draw_body(recording, x, space)
    space.plot(*path.T, color=ORANGE, linewidth=1.2)
    every = np.vstack([x, path])
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    reach = np.linalg.norm(every - middle, axis=1).max() or 1.0
    space.set(**{f"{name}lim": (m - reach, m + reach) for name, m in zip("xyz", middle, strict=True)})
    space.set_box_aspect((1, 1, 1), zoom=1.5)
    space.view_init(elev=25, azim=-60)
    space.set_axis_off()
    return space


def _draw_body(recording: Recording, x: np.ndarray, axes: Any) -> None:
    """A body at positions (N, 3): its surface and its springs."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    body = recording.plan.scene.body
    if len(body.springs):
        axes.add_collection3d(Line3DCollection(x[body.springs], colors=BLUE, linewidths=0.6, alpha=0.55))
    else:
        axes.plot(*x.T, "o", color=BLUE)
    if len(body.triangles):
        faces = Poly3DCollection(x[body.triangles], facecolors=BLUE, edgecolors="none", alpha=0.13)
        axes.add_collection3d(faces)


def pendulum(recording: Recording, figure: Figure) -> None:
    """The path from in front and from above; the swing in time, beside the rigid twin's; the energies."""
    path, twin = _path(recording), rigid_twin(recording)
    sideways = path[np.argmax(np.hypot(path[:, 0], path[:, 1])), :2]
    sideways = sideways / (np.linalg.norm(sideways) or 1.0)
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.4))
    front = _panel(figure, grid[0, 0], "path from the side", "along the swing [m]", "z [m]")
    front.plot(path[:, :2] @ sideways, path[:, 2], color=ORANGE)
    front.plot(0, 0, "^", color=SLATE)
    _square(front)
    above = _panel(figure, grid[1, 0], "path from above", "x [m]", "y [m]")
    above.plot(*path[:, :2].T, color=ORANGE)
    _square(above)
    swing = _panel(figure, grid[0, 1], "angle from hanging", "t [s]", "[°]")
    swing.plot(recording.times, _angle(path, sideways), color=ORANGE, label="springs")
    if twin is not None:
        angle = _angle(_path(twin), sideways)
        swing.plot(twin.times, angle, "k", linestyle=DASHES, linewidth=0.8, label="rigid")
    swing.margins(x=0)
    _legend(swing)
    _energies(recording, _panel(figure, grid[1, 1], "energy", "t [s]", "[J]"))


def _angle(path: np.ndarray, sideways: np.ndarray) -> np.ndarray:
    return np.degrees(np.unwrap(np.arctan2(path[:, :2] @ sideways, -path[:, 2])))


def rope(recording: Recording, figure: Figure) -> None:
    """The rope at many moments; its length and its end in time; the energies."""
    x, t = recording.positions, recording.times
    lengths = np.linalg.norm(np.diff(x, axis=1), axis=2).sum(axis=1)
    grid = figure.add_gridspec(3, 2, width_ratios=(1, 1.3))
    wide, high = np.ptp(x[..., 0]), np.ptp(x[..., 2])
    narrow = 1e-6 * high < wide < 0.05 * high
    title = "every quarter of a second, later ones darker" + (", x stretched" if narrow else "")
    side = _panel(figure, grid[:, 0], title, "x [m]", "z [m]")
    every = max(1, round(0.25 / (t[1] - t[0])))
    shapes = x[::every][:24]
    for n, shape in enumerate(shapes):
        shade = 0.15 + 0.85 * n / len(shapes)
        side.plot(shape[:, 0], shape[:, 2], ".-", color=BLUE, alpha=shade, linewidth=1, markersize=3)
    side.plot(x[:, -1, 0], x[:, -1, 2], color=ORANGE, linewidth=0.8)
    side.plot(*x[0, 0, [0, 2]], "^", color=SLATE)
    if not narrow:
        _square(side)
    long = _panel(figure, grid[0, 1], "length of the rope", "", "[m]")
    long.plot(t, lengths, color=ORANGE)
    long.axhline(recording.plan.scene.body.lengths.sum(), color=SLATE, linestyle=":", linewidth=1)
    end = _panel(figure, grid[1, 1], "end of the rope", "", "[m]")
    end.plot(t, x[:, -1, 0] - x[:, 0, 0], color=BLUE, label="x")
    end.plot(t, x[:, -1, 2] - x[:, 0, 2], color=GREEN, label="z")
    _legend(end)
    for axes in (long, end):
        axes.margins(x=0)
    _energies(recording, _panel(figure, grid[2, 1], "energy", "t [s]", "[J]"))


def drop(recording: Recording, figure: Figure) -> None:
    """The body at many moments; heights and energies in time."""
    from matplotlib.collections import LineCollection, PolyCollection

    x, t, m = recording.positions, recording.times, recording.measures
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.2))
    calm = int(np.argmax(m.energy < m.energy[-1] + 0.02 * (m.energy[0] - m.energy[-1]))) or len(t) - 1
    every = float(t[calm]) / 9
    side = _panel(figure, grid[:, 0], f"every {every:.2g} s", "x [m]", "z [m]")
    body = recording.plan.scene.body
    moments = np.linspace(0, calm, 10).astype(int)
    for n, moment in enumerate(moments):
        shade = 0.4 + 0.6 * n / len(moments)
        lines, faces = (x[moment][corners][:, :, [0, 2]] for corners in (body.springs, body.triangles))
        side.add_collection(LineCollection(list(lines), colors=BLUE, alpha=0.6 * shade, linewidths=0.7))
        side.add_collection(PolyCollection(list(faces), facecolors=BLUE, alpha=0.06 * shade))
        if not len(lines):
            side.plot(*x[moment][:, [0, 2]].T, "o", color=BLUE, alpha=shade)
    side.plot(m.centre[:, 0], m.centre[:, 2], color=ORANGE, label="centre of mass")
    if recording.plan.trace is not None and x.shape[1] > 1:
        traced = x[:, recording.plan.trace]
        side.plot(traced[:, 0], traced[:, 2], color=GREEN, linewidth=0.8, label="traced particle")
    side.axhline(0, color="k", linewidth=1)
    _legend(side)
    _square(side)
    high = _panel(figure, grid[0, 1], "height", "", "[m]")
    high.plot(t, m.centre[:, 2], color=ORANGE, label="centre of mass")
    high.plot(t, x[:, :, 2].min(axis=1), color=BLUE, label="lowest particle")
    high.axhline(0, color="k", linewidth=1)
    high.margins(x=0)
    _legend(high)
    _energies(recording, _panel(figure, grid[1, 1], "energy", "t [s]", "[J]"))


def slide(recording: Recording, figure: Figure) -> None:
    """Way and speed of the centre of mass; the body from above; the energies."""
    from matplotlib.collections import LineCollection

    t, m = recording.times, recording.measures
    way = np.linalg.norm(m.centre - m.centre[0], axis=1)
    # by the way it makes: where friction holds it, half a step's pull is left in its velocity
    speed = np.linalg.norm(np.gradient(m.centre, t, axis=0), axis=1)
    grid = figure.add_gridspec(2, 2)
    far = _panel(figure, grid[0, 0], "way of the centre of mass", "t [s]", "[m]")
    far.plot(t, way, color=ORANGE)
    fast = _panel(figure, grid[1, 0], "its speed", "t [s]", "[m/s]")
    fast.plot(t, speed, color=BLUE)
    above = _panel(figure, grid[0, 1], "from above, at the start and the end", "x [m]", "y [m]")
    for shape, color in zip(recording.positions[[0, -1], :, :2], (PALE, BLUE), strict=True):
        above.plot(*shape.T, "o", color=color, markersize=3)
        above.add_collection(LineCollection(list(shape[recording.plan.scene.body.springs]), colors=color))
    above.plot(*m.centre[:, :2].T, color=ORANGE)
    _square(above)
    for axes in (far, fast):
        axes.margins(x=0)
    _energies(recording, _panel(figure, grid[1, 1], "energy", "t [s]", "[J]"))


def rotation(recording: Recording, figure: Figure) -> None:
    """Angular velocity in the body's axes, beside the rigid twin's; a particle's path; the energies."""
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.4))
    _space(recording, figure, grid[:, 0], _path(recording))
    where = "the world's" if _straight(recording) else "the body's"
    turning = _panel(figure, grid[0, 1], f"angular velocity in {where} axes", "t [s]", "[rad/s]")
    twin = rigid_twin(recording)
    for n, (name, color) in enumerate({"ω₁": BLUE, "ω₂": ORANGE, "ω₃": GREEN}.items()):
        turning.plot(recording.times, _turning(recording)[:, n], color=color, label=name)
        if twin is not None:
            label = "rigid" if n == 2 else None
            own = _turning(twin)[:, n]
            turning.plot(twin.times, own, "k", linestyle=DASHES, linewidth=0.7, label=label)
    turning.margins(x=0)
    _legend(turning)
    _energies(recording, _panel(figure, grid[1, 1], "energy", "t [s]", "[J]"))


def _straight(recording: Recording) -> bool:
    """Whether the particles of the body's triad lie on a line, so that it has a third axis alone."""
    return bool((np.linalg.norm(recording.measures.side, axis=1) < 0.5).any())


def _turning(recording: Recording) -> np.ndarray:
    """Angular velocity along the body's triad, (T, 3); along the world's if the body's is a line."""
    m = recording.measures
    if _straight(recording):
        return m.angular_velocity
    triad = np.stack([m.side, np.cross(m.axis, m.side), m.axis], axis=1)
    return np.einsum("tki,ti->tk", triad, m.angular_velocity)


PLOTS: dict[Plot, Callable[[Recording, Figure], None]] = {
    "top": top,
    "pendulum": pendulum,
    "rope": rope,
    "drop": drop,
    "slide": slide,
    "rotation": rotation,
}
