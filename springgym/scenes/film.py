"""Films of recordings: how each body is drawn, and from where it is seen."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from typing import Any

import numpy as np

from springgym.bodies import Body
from springgym.rendering import Camera, Look, Marks, Renderer, Scenery, save_video, two_tone
from springgym.rendering.look import AMBER, BLUE, INK, IVORY, STEEL, TEAL
from springgym.scenes.recording import Recording
from springgym.surfaces import Dish, Plane

SIZE = (640, 640)
FPS = 50.0


def save_film(recording: Recording, path: str | PathLike[str]) -> None:
    """Write the film of a recording, in real time, as .mp4 or .gif.

    Raises
    ------
    ValueError
        If the name ends in neither.
    gymnasium.error.DependencyNotInstalled
        Without the packages of the extra ``render``.
    """
    save_video(frames(recording, FPS), path, FPS)


def frames(recording: Recording, fps: float = FPS) -> Iterator[np.ndarray]:
    """Pictures (height, width, 3) of a recording at a rate, in real time."""
    plan, x = recording.plan, recording.positions
    renderer = Renderer(look(plan.scene.body, plan.trace), camera(recording), scenery(recording), SIZE)
    moments = np.arange(0.0, recording.times[-1] + 1e-9, 1 / fps)
    for t in moments:
        n = min(int(np.searchsorted(recording.times, t - 1e-9)), len(x) - 1)
        yield renderer.frame(x[n], Marks(text=(f"{t:5.2f} s",)))  # type: ignore[misc]
    renderer.close()


def camera(recording: Recording) -> Camera:
    """A camera that sees the whole motion."""
    x, view = recording.positions, recording.plan.view
    low, high = x.min(axis=(0, 1)), x.max(axis=(0, 1))
    reach = float(np.linalg.norm(x - (low + high) / 2, axis=2).max())
    return Camera.framing(
        (low + high) / 2, 2.2 * reach or 1.0, azimuth=view.azimuth, elevation=view.elevation
    )


def scenery(recording: Recording) -> Scenery:
    """The surfaces, or a ground below what is pinned."""
    scene, x = recording.plan.scene, recording.positions
    planes = tuple((s.point, s.normal) for s in scene.surfaces if isinstance(s, Plane))
    dishes = [(s.centre, s.radius) for s in scene.surfaces if isinstance(s, Dish)]
    if scene.surfaces or not scene.pinned:
        return Scenery(planes=planes, dish=dishes[0] if dishes else None)
    pin, low = x[0, scene.pinned[0]], float(x[..., 2].min())
    stands = recording.measures.centre[:, 2].min() > pin[2]
    return Scenery(
        floor=min(low, float(pin[2])) if stands else low - 0.15 * float(np.ptp(x[..., 2])),
        vertical=(tuple(pin), 1.2 * float(x[..., 2].max() - pin[2])) if stands else None,
    )


def look(body: Body, trace: int | None) -> Look:
    """How a body is drawn; ``trace`` is the particle that leaves a trace."""
    size = float(np.ptp(body.positions, axis=0).max())
    drawn = {"top": _top, "gyroscope": _gyroscope, "rope": _rope}.get(body.name)
    if drawn is None:
        drawn = _faces if len(body.triangles) else _balls
    return Look(springs=body.springs, trace=trace, **drawn(body, size if size > 0 else 0.5))


def _faces(body: Body, size: float) -> dict[str, Any]:
    return {"triangles": body.triangles, "triangle_colors": _face_colors(body)}


def _balls(body: Body, size: float) -> dict[str, Any]:
    radii = np.full(len(body.masses), 0.06 * size)
    return {"bars": body.springs, "bar_radius": 0.015 * size, "radii": radii, "ball_colors": BLUE}


def _top(body: Body, size: float) -> dict[str, Any]:
    upper = "crown" if "crown" in body.parts else "heart"  # of a solid top
    ring, poles = len(body.parts["ring"]), [body.particle(upper), body.particle("tip")]
    heavy = body.masses > 1.01 * np.median(body.masses[:ring])
    radii, colors = np.where(heavy, 0.04 * size, 0.0), np.tile(AMBER, (len(body.masses), 1))
    radii[poles], colors[poles] = 0.02 * size, INK
    return {
        "triangles": body.triangles,
        "triangle_colors": np.tile(two_tone(ring), (2, 1)),
        "radii": radii,
        "ball_colors": colors,
    }


def _gyroscope(body: Body, size: float) -> dict[str, Any]:
    ring, centre = len(body.parts["ring"]), body.particle("centre")
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
    """One colour for each flat face, those of opposite direction alike."""
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
