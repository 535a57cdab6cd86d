"""Films of recordings: the appearance of each body, and the camera."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import cycle
from os import PathLike
from typing import Any

import numpy as np

from springgym.checks import TINY, function, instance, number, readings, refusing_unknown, whole, whole_array
from springgym.dynamics.measures import Measures
from springgym.model.bodies import Body
from springgym.model.bodies.round import points_of
from springgym.model.collisions import shape
from springgym.model.scene import Scene
from springgym.model.surfaces import Plane
from springgym.rendering import Camera, Look, Marks, Renderer, Scenery, save_video, two_tone
from springgym.rendering.look import AMBER, BLUE, GREEN, INK, IVORY, ORANGE, STEEL, TEAL, Color, together
from springgym.rendering.video import RATES
from springgym.scenes.plan import SPEEDS
from springgym.scenes.recording import Progress, Recording

__all__ = [
    "BALLS",
    "CALM",
    "CAP",
    "COLUMNS",
    "FAR",
    "FLAT",
    "GIF_FPS",
    "PILL",
    "ROWS",
    "SLOWEST",
    "THIN",
    "TURN_A_FRAME",
    "UNEVEN",
    "camera",
    "frames",
    "globe",
    "look",
    "poses",
    "round_up",
    "save_film",
    "scenery",
    "strain_scale",
    "strains",
    "strobe",
    "surfaces",
    "told",
    "turning",
    "visible_speed",
    "way",
]

PIXELS = (640, 640)
FPS = 50.0
SLOWEST = 1e-6
"""Least speed of a film: simulated seconds per second."""
GIF_FPS = 25.0
"""Frames per second of a GIF: browsers show GIFs with many more at the wrong speed."""
TURN_A_FRAME = 1.05
"""Largest rotation of a body between frames that the eye can follow [rad]."""
FAR = 8.0
"""Largest path of a body, in units of its size, that the camera does not follow."""
BALLS = (BLUE, ORANGE, TEAL, AMBER, GREEN)
"""Colours of round bodies, used cyclically."""
ROWS = 10
"""Number of facets of round bodies from pole to pole."""
COLUMNS = 24
"""Number of facets of round bodies around."""

POLAR = np.pi * np.arange(1, ROWS) / ROWS
BALL = np.sin(POLAR), np.cos(POLAR)
COIN = np.array([0.9999, 1.0, 1.0, 0.9999]), np.array([1.0, 0.99, -0.99, -1.0])
PILL = np.insert(np.sin(POLAR), [4, 5], 1.0), np.insert(np.cos(POLAR), [4, 5], [1e-9, -1e-9])
"""Radii and heights of the rings of a ball, of a coin before it is flattened, and of a capsule before its
halves are moved apart."""
FLAT = 1e-4
"""Ratio of the least to the largest squared semi-axis below which a feature is a disk."""
THIN = 0.02
"""Half of the drawn thickness of a flat round feature, as a fraction of its radius."""
UNEVEN = 0.1
"""A ball whose centre of mass is off its centre by more than this fraction of its radius has a dark cap on
its lighter end."""
CAP = 0.75
"""Cosine of the angle of such a cap, from its middle to its rim."""
CALM = 0.5
"""Time over which the camera's path is smoothed [s]."""


@refusing_unknown
def save_film(
    recording: Recording, path: str | PathLike[str], speed: float | None = None, progress: Progress = iter
) -> None:
    """Write the film of a recording as .mp4 or .gif.

    The scene's view gives the speed of the film. Without it, the film is in real time or, if the body turns
    too fast for the eye, slower, see `visible_speed`. The film states its speed if it is not real time.

    Parameters
    ----------
    speed
        Simulated seconds per second of the film, instead of that speed.
    progress
        A function that wraps the iterator over frames, to show progress.

    Raises
    ------
    ValueError
        If the name ends in neither .mp4 nor .gif.
    gymnasium.error.DependencyNotInstalled
        Without the packages of the extra ``render``.
    """
    instance("recording", recording, Recording)
    fps = GIF_FPS if str(path).lower().endswith(".gif") else FPS
    save_video(frames(recording, fps, speed, progress), path, fps)


def frames(
    recording: Recording, fps: float = FPS, speed: float | None = None, progress: Progress = iter
) -> Iterator[np.ndarray]:
    """Return pictures (height, width, 3) of a recording, ``fps`` per second of the film, see `save_film`."""
    instance("recording", recording, Recording)
    fps = number("fps", fps, *RATES)
    function("progress", progress)
    speed = None if speed is None else number("speed", speed, SLOWEST)
    return _frames(recording, fps, speed, progress)


def _frames(
    recording: Recording, fps: float, speed: float | None, progress: Progress
) -> Iterator[np.ndarray]:
    plan = recording.plan
    x = recording.positions
    pace = plan.view.speed if speed is None else speed
    pace = pace or visible_speed(turning(plan.scene, recording.bodies), fps)
    drawn = look(plan.scene, plan.trace)
    strain = None
    if plan.view.strain:
        strain = strains(drawn, plan.scene.of_bodies("lengths"), x)
        drawn = replace(drawn, strain_scale=strain_scale(strain))
    renderer = Renderer(drawn, camera(recording), scenery(recording), PIXELS)
    along = way(recording)
    still = renderer.camera
    note = () if pace == 1 else (told(pace),)
    for t in progress(np.arange(0.0, recording.times[-1] + 1e-9, pace / fps)):
        n = min(int(np.searchsorted(recording.times, t - 1e-9)), len(x) - 1)
        if along is not None:
            renderer.camera = still.moved(along[n])
        marks = Marks(text=(f"{t:5.2f} s", *note))
        yield renderer.draw(x[n], marks, None if strain is None else strain[n])  # type: ignore[misc]
    renderer.close()


def strains(drawn: Look, lengths: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Return the strains (T, S) of springs of unstretched lengths (S,) [m] at positions (T, N, 3) [m]."""
    first, second = np.asarray(drawn.springs).T
    return np.linalg.norm(positions[:, second] - positions[:, first], axis=2) / lengths - 1.0


def strain_scale(strain: np.ndarray) -> float:
    """Return the strain of full colour: 1, 2 or 5 times a power of ten, which hardly any strain exceeds."""
    return round_up(float(np.percentile(np.abs(strain), 99.5))) if strain.size else 1.0


def round_up(value: float) -> float:
    """Return the least 1, 2 or 5 times a power of ten that is not below; 1 unless it is positive."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= value * (1 - 1e-9)))


def told(pace: float) -> str:
    """Return the speed of a film in words, as "1/8 of real time"."""
    share = Fraction(number("pace", pace, TINY)).limit_denominator(1000)
    return f"{share} {'of' if pace < 1 else '×'} real time"


def visible_speed(fastest: float, fps: float) -> float:
    """Return the fastest of `SPEEDS`, at most real time, at which a film shows ``fastest`` [rad/s]
    correctly."""
    fastest = float(readings("fastest", fastest, ()))
    fps = number("fps", fps, *RATES)
    return max((s for s in SPEEDS if s <= 1 and fastest * s <= TURN_A_FRAME * fps), default=SPEEDS[0])


def turning(scene: Scene, bodies: Sequence[Measures]) -> float:
    """Return the largest angular velocity of a body [rad/s], from the measures of each; 0 for floppy
    bodies."""
    placed_bodies = instance("scene", scene, Scene).bodies
    for n, measures in enumerate(instance("bodies", bodies, tuple, list)):
        instance(f"bodies[{n}]", measures, Measures)
    if len(bodies) != len(placed_bodies):
        raise ValueError(f"bodies are measures of {len(bodies)}; the scene has {len(placed_bodies)}")
    pairs = zip(placed_bodies, bodies, strict=True)
    turns = [m.angular_velocity for placed, m in pairs if not placed.body.floppy]
    return max((float(np.linalg.norm(omega, axis=1).max()) for omega in turns), default=0.0)


def camera(recording: Recording, size: tuple[int, int] = PIXELS, moments: Sequence[int] = ()) -> Camera:
    """Return a camera that shows all of the motion or, if the body goes far, the body at some ``moments``.

    Without ``moments``, it shows the body at its start, and has to move along `way`.
    """
    instance("recording", recording, Recording)
    x = recording.positions
    view = recording.plan.view
    scene = recording.plan.scene
    along = way(recording)
    if along is not None:
        x = x - along[:, None] if not moments else x[list(moments)]
    drawn = look(scene, None)
    radii = np.asarray(drawn.radii)
    thick = float(radii.max()) if len(radii) else 0.0
    thick *= 1 if x.shape[1] > 1 else 3  # a ball alone would fill the picture
    corners = thick * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    seen = drawn.points(x[:: max(1, len(x) // 500)]).reshape(-1, 1, 3) + corners
    return Camera.fitting(seen, size, view.azimuth, view.elevation)


def way(recording: Recording) -> np.ndarray | None:
    """Return the path (T, 3) [m] of a camera that follows the body; None if the camera does not move."""
    centre = instance("recording", recording, Recording).measures.centre
    size = float(np.ptp(recording.positions[0], axis=0).max())
    if recording.plan.scene.pins or not 0 < FAR * size < np.linalg.norm(np.ptp(centre, axis=0)):
        return None
    count = max(1, round(CALM / float(recording.times[1] - recording.times[0])))
    padded = np.pad(centre - centre[0], ((count, count), (0, 0)), mode="edge")
    window = np.hanning(2 * count + 3)[1:-1]
    smooth = [np.convolve(column, window / window.sum(), mode="valid") for column in padded.T]
    return np.stack(smooth, axis=1)


def strobe(
    recording: Recording, moments: Sequence[int], seen_by: Camera, size: tuple[int, int]
) -> np.ndarray:
    """Return a picture (height, width, 3) of the body at several moments; earlier ones are paler."""
    plan = instance("recording", recording, Recording).plan
    renderer = Renderer(look(plan.scene, None), seen_by, scenery(recording), size)
    ground = np.asarray(renderer.draw(np.full_like(recording.positions[0], np.nan)), np.int16)
    picture = ground.astype(np.float32)
    for rank, moment in enumerate(moments):
        drawn = np.asarray(renderer.draw(recording.positions[moment]), np.int16)
        changed = np.abs(drawn - ground).max(axis=2)
        rows, columns = (np.flatnonzero(changed.any(axis=n)) for n in (1, 0))
        if not len(rows):
            continue
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        cover = (0.25 + 0.75 * (rank + 1) / len(moments)) * np.minimum(changed[box][..., None] / 8.0, 1.0)
        picture[box] += cover * (drawn[box] - picture[box])
    renderer.close()
    return np.rint(picture).astype(np.uint8)


def poses(recording: Recording, spacing: float = 0.9, most: int = 10, last: int | None = None) -> list[int]:
    """Return indices of times at which poses are ``spacing`` sizes apart or more, and that of the last one.

    Poses at equal intervals would overlap where the body is slow, or where it returns. The spacing is
    increased if there would be more than ``most`` poses.
    """
    instance("recording", recording, Recording)
    spacing = number("spacing", spacing, TINY)
    most = whole("most", most, 1)
    x = recording.positions
    centre = recording.measures.centre
    last = None if last is None else whole("last", last, high=len(x) - 1)
    end = len(x) - 1 if last is None else last
    size = float(np.ptp(x[0], axis=0).max()) or 0.1 * float(np.ptp(x, axis=(0, 1)).max()) or 1.0
    apart = spacing * size
    while True:
        chosen = [0]
        for n in range(1, end):
            if len(chosen) <= most and np.linalg.norm(centre[chosen] - centre[n], axis=1).min() >= apart:
                chosen.append(n)
        if len(chosen) <= most:
            return [n for n in chosen if np.linalg.norm(centre[n] - centre[end]) >= 0.7 * apart] + [end]
        apart *= 1.2


def surfaces(scene: Scene) -> Scenery:
    """Return the surfaces of a scene as scenery."""
    instance("scene", scene, Scene)
    planes = tuple((s.point, s.normal) for s in scene.surfaces if isinstance(s, Plane))
    return Scenery(planes=planes, surfaces=[s for s in scene.surfaces if not isinstance(s, Plane)])


def scenery(recording: Recording) -> Scenery:
    """Return the surfaces of a recording's scene, or a ground below a pinned body."""
    scene = instance("recording", recording, Recording).plan.scene
    x = recording.positions
    if scene.surfaces or not scene.pins:
        plumb = None
        if any(abs(s.normal[2]) < 0.999 for s in scene.surfaces if isinstance(s, Plane)):
            size = float(np.ptp(x[0], axis=0).max())  # a slope is shown beside an upright
            plumb = (tuple(x[0].mean(axis=0)), 1.2 * size)
        return replace(surfaces(scene), vertical=plumb)
    pin = x[0, scene.pins[0]]
    low = float(x[..., 2].min())
    stands = recording.measures.centre[:, 2].min() > pin[2]
    plumb = (tuple(pin), 1.2 * float(x[..., 2].max() - pin[2]))
    return Scenery(
        floor=min(low, float(pin[2])) if stands else low - 0.15 * float(np.ptp(x[..., 2])),
        vertical=plumb if stands and len(scene.bodies) == 1 else None,
    )


def look(scene: Scene, trace: int | None = None, colors: Mapping[str, Color] | None = None) -> Look:
    """Return the `Look` of the bodies of a scene.

    Parameters
    ----------
    trace
        The particle, numbered among all, that leaves a trace.
    colors
        Colours of bodies by name, as red, green and blue from 0 to 255. Other bodies are blue,
        and round ones among several have `BALLS`.

    Raises
    ------
    TypeError, ValueError
        If there is no such body, or a colour is not one.
    """
    instance("scene", scene, Scene)
    given = {
        scene.number(instance("a name in colors", name, str)): tuple(
            whole_array(f"colors[{name!r}]", color, (3,), high=255).tolist()
        )
        for name, color in ({} if colors is None else instance("colors", colors, Mapping)).items()
    }
    if len(scene.bodies) == 1:
        return _look(scene.body, trace, given.get(0, BLUE))
    bodies = [placed.body for placed in scene.bodies]
    usual = zip(range(len(bodies)), cycle(BALLS))  # endless
    round_ = {n: color for n, color in usual if bodies[n].radius > 0}
    looks = [_look(body, None, (round_ | given).get(n, BLUE)) for n, body in enumerate(bodies)]
    return together(looks, [len(body.masses) for body in bodies], trace)


def _look(body: Body, trace: int | None, color: Color = BLUE) -> Look:
    size = float(np.ptp(body.positions, axis=0).max())
    drawn = {"top": _top, "gyroscope": _gyroscope, "rope": _rope}.get(body.name)
    if drawn is None:
        drawn = _faces if len(body.triangles) else _balls
    if body.radius > 0:
        drawn = partial(_round, color=color)
    if body.rounds and not len(body.triangles):
        drawn = partial(_rolling, color=color)
    shown = drawn(body, size if size > 0 else 0.5)
    if body.rounds and len(body.triangles):
        skin = _rolling(body, size, color)
        shown |= {
            name: np.concatenate([shown[name], skin.pop(name)]) for name in ("triangles", "triangle_colors")
        }
        shown |= skin
    for name in shown.keys() & {"triangle_colors", "ball_colors"}:
        table = np.asarray(shown[name])
        shown[name] = np.where((table == BLUE).all(axis=-1, keepdims=True), color, table)
    return Look(springs=body.springs, trace=trace, **shown)


def _faces(body: Body, size: float) -> dict[str, Any]:
    return {"triangles": body.triangles, "triangle_colors": _face_colors(body)}


def _balls(body: Body, size: float) -> dict[str, Any]:
    radii = np.full(len(body.masses), 0.06 * size)
    return {"bars": body.springs, "bar_radius": 0.015 * size, "radii": radii, "ball_colors": BLUE}


def _round(body: Body, size: float, color: Color) -> dict[str, Any]:
    """Draw a body with the radius that it has in contacts."""
    return {
        "bars": body.springs,
        "bar_radius": body.radius,
        "bar_colors": color,
        "radii": np.full(len(body.masses), body.radius),
        "ball_colors": color,
    }


def _rolling(body: Body, size: float, color: Color) -> dict[str, Any]:
    """Draw round features in octants of two colours, one of them odd, which show how the body turns."""
    skins = []
    triangles = []
    colors = []
    first = len(body.masses)
    met = shape(body)
    capsule = met.skin and not met.turns
    for feature in body.rounds[:1] if capsule else body.rounds:
        squares, axes = np.linalg.eigh(feature.matrix)
        half = body.rounds[1].centre - feature.centre if capsule else np.zeros(3)
        centre = feature.centre + 0.5 * half
        half = -0.5 * half
        light = centre - body.masses @ body.positions / body.masses.sum()
        off = float(np.linalg.norm(light)) / feature.extent
        capped = UNEVEN < off < 1 and np.ptp(squares) < FLAT * squares[2]
        if capped or capsule:  # any axes are principal axes of a sphere
            along = half if capsule else light
            axes, _ = np.linalg.qr(np.column_stack([along, axes]))
            axes[:, 0] = along / np.linalg.norm(along)
        semi = np.maximum(np.sqrt(np.maximum(squares, 0.0)), THIN * feature.extent)
        profile = PILL if capsule else (COIN if squares[0] < FLAT * squares[2] else BALL)
        points, faces, sector = globe(*profile)
        axes[:, 1 if capped or capsule else 0] *= np.sign(np.linalg.det(axes))
        # a flat one is a coin: its first axis is that of the globe
        skin = centre + (points[:, [2, 0, 1]] * semi) @ axes.T + np.sign(points[:, 2:]) * half
        skins.append(points_of(body.masses, body.positions, feature, skin))
        triangles.append(faces + first)
        table = np.array([color, IVORY, color, IVORY, IVORY, color, AMBER, color], np.uint8)
        own = table[sector]
        own[capped & (points[faces, 2].mean(axis=1) > CAP)] = INK
        colors.append(own)
        first += len(points)
    return {
        "triangles": np.concatenate(triangles),
        "triangle_colors": np.concatenate(colors),
        "skin": np.concatenate(skins),
    }


def globe(sines: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (V, 3) of a body of revolution, its triangles (T, 3), and the octant (T,) of each.

    Octants are numbered from 0 to 7. Its rings have the radii ``sines`` and lie at ``heights``, between the
    poles at ± 1.
    """
    angles = 2 * np.pi * np.arange(COLUMNS) / COLUMNS
    rings = [
        np.stack([s * np.cos(angles), s * np.sin(angles), np.full(COLUMNS, z)], axis=1)
        for s, z in zip(sines, heights, strict=True)
    ]
    points = np.concatenate([[[0.0, 0.0, 1.0]], *rings, [[0.0, 0.0, -1.0]]])
    faces = []
    sectors = []
    last = len(points) - 1
    rows = len(rings)
    for n in range(COLUMNS):
        m = (n + 1) % COLUMNS
        sector = 4 * n // COLUMNS
        for k in range(rows - 1):
            upper = 1 + k * COLUMNS
            lower = 1 + (k + 1) * COLUMNS
            a = upper + n
            b = upper + m
            c = lower + n
            d = lower + m
            faces += [(a, c, d), (a, d, b)]
            sectors += 2 * [sector + 4 * (2 * k + 2 > rows)]
        faces += [(0, 1 + n, 1 + m), (last, 1 + (rows - 1) * COLUMNS + m, 1 + (rows - 1) * COLUMNS + n)]
        sectors += [sector, sector + 4]
    return points, np.array(faces), np.array(sectors)


def _top(body: Body, size: float) -> dict[str, Any]:
    upper = "crown" if "crown" in body.parts else "heart"  # of a solid top
    ring = len(body.parts["ring"])
    poles = [body.particle(upper), body.particle("tip")]
    heavy = body.masses > 1.01 * np.median(body.masses[:ring])
    radii = np.where(heavy, 0.05 * size, 0.0)
    colors = np.tile(INK, (len(body.masses), 1))
    radii[poles] = 0.02 * size
    colors[poles] = INK
    return {
        "triangles": body.triangles,
        "triangle_colors": np.tile(two_tone(ring), (2, 1)),
        "radii": radii,
        "ball_colors": colors,
    }


def _gyroscope(body: Body, size: float) -> dict[str, Any]:
    ring = len(body.parts["ring"])
    centre = body.particle("centre")
    ends = [body.particle("head"), body.particle("foot")]
    radii = np.zeros(len(body.masses))
    radii[[centre, *ends]] = 0.05 * size
    return {
        "triangles": body.triangles,
        "triangle_colors": two_tone(ring),
        "opacity": 0.35,
        "bars": [(n, (n + 1) % ring) for n in range(ring)] + [(centre, end) for end in ends],
        "bar_radius": [0.032 * size] * ring + [0.02 * size] * 2,
        "bar_colors": [*two_tone(ring).tolist(), INK, INK],
        "radii": radii,
        "ball_colors": INK,
    }


def _rope(body: Body, size: float) -> dict[str, Any]:
    beads = len(body.masses) - 2
    return {
        "bars": body.springs,
        "bar_radius": 0.004 * size,
        "bar_colors": INK,
        "radii": [0.018 * size] + [0.01 * size] * beads + [0.055 * size],
        "ball_colors": [INK] + [AMBER] * beads + [BLUE],
    }


def _face_colors(body: Body) -> np.ndarray:
    """Return one colour for each flat face, the same for faces of opposite directions."""
    a, b, c = body.positions[body.triangles].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    palette = (BLUE, IVORY, AMBER, TEAL, STEEL)
    faces: list[np.ndarray] = []
    colors = []
    for normal in normals:
        known = [n for n, other in enumerate(faces) if abs(normal @ other) > 0.999]
        if not known:
            faces.append(normal)
        colors.append(palette[(known[0] if known else len(faces) - 1) % len(palette)])
    return np.array(colors)
