"""Drawing of motions with viser, by nodes that are created once and moved from frame to frame."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from springgym.rendering import Camera, Marks, srgb
from springgym.rendering.look import GRAPHITE, GREEN, ORANGE, RED, STEEL, Arrow, Color, Point
from springgym.rendering.solids import arrow_path, circle, strain_colors
from springgym.scenes.film import BALL, globe, round_up, strain_scale
from springgym.view.motion import Motion

FOV = 0.5
"""Vertical angle of view [rad]."""
SKY = ((250, 251, 253), (222, 229, 238))
"""Colours of the background at the top and at the bottom."""
GROUND = (244, 247, 251)
CELL = (222, 228, 236)
SECTION = (196, 205, 217)
GLASS = 0.12
"""Opacity of a body whose springs are shown."""
SKYLIGHT = 1.85
"""Ambient light, besides viser's lamp of 3 above: surfaces that face the sky are 1.5 times as bright as those
that face the horizon, as in the films."""
LIT = (3.0 * 0.96 + SKYLIGHT) / np.pi
"""Light that a white face reflects if it faces the sky."""
TO_ACES = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
FROM_ACES = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
"""Tone mapping of three.js: between the matrices each channel x becomes (x² + a x − b)/(c x² + d x + e)."""
BEFORE = np.linalg.inv(TO_ACES).T
AFTER = np.linalg.inv(FROM_ACES).T
EXPOSURE = 1 / 0.6
ASIDE = (-0.25, -0.1)
"""Shift of the camera right and up, in half heights of the picture: the graph is at the lower left."""
MARK = re.compile(r"/world/marks/(?P<kind>[a-z]+)(?P<n>\d+)")
"""Names of the nodes of marks: a field of `Marks`, and a number."""
SHEET = 0.5
"""Fraction of a narrow picture, as on a phone held upright, that the panel takes at the bottom."""
MOMENTS = 300
"""Number of states of a motion for which the camera is fitted."""
TRAIL = 400
"""Number of segments of a trace."""
SHORTEST = 0.02
"""Shortest arrow that is drawn, relative to a body's extent."""


class Stage:
    """The scene tree of a viser server, showing one motion at a time.

    Parameters
    ----------
    server
        A `viser.ViserServer`.
    """

    def __init__(self, server: Any) -> None:
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction("+z")
        shades = np.linspace(SKY[0], SKY[1], 64)[:, None].repeat(2, axis=1)
        self._scene.set_background_image(np.rint(shades).astype(np.uint8), format="png")
        self._scene.configure_environment_map(None)
        self._scene.add_light_hemisphere(
            "/light", sky_color=(255, 255, 255), ground_color=(210, 214, 224), intensity=SKYLIGHT
        )
        self._shown = dict.fromkeys(("springs", "forces", "rotation", "contacts", "trace"), True)
        self._shown["rigid twin"] = False
        self._follows = False
        self._motion: Motion | None = None

    # --- What is shown ------------------------------------------------------------------------------

    def set_up(self, motion: Motion) -> None:
        """Show another motion, at its start."""
        for name in ("/world", "/ground"):
            self._scene.remove_by_name(name) if self._motion is not None else None
        self._motion = motion
        self._strain = motion.strain
        self._ground = self._scene.add_frame("/ground", show_axes=False)
        self._world = self._scene.add_frame("/world", show_axes=False)
        self.strain_scale = strain_scale(self._strain)
        """the strain of full colour"""
        self._add_scenery(motion)
        self._add_body(motion)
        self._nodes: dict[str, Any] = {}
        self._marked: dict[str, Any] = {}
        self._eye = np.asarray(self.camera(motion).eye)
        self.draw(0.0)

    def show(self, **shown: bool) -> None:
        """Show or hide elements by their names in `TICKS`; with ``follow``, the camera follows the body."""
        self._follows = shown.pop("follow", self._follows)
        self._shown |= {name.replace("_", " "): value for name, value in shown.items()}

    def shows(self, name: str) -> bool:
        """Return whether a tick of a page is set."""
        return self._follows if name == "follow" else self._shown[name]

    def clear(self) -> None:
        """Remove the motion from the stage, until the next one is set up."""
        self._world.visible = False

    def camera(self, motion: Motion, aspect: float = 1.0) -> Camera:
        """Return a camera that shows the whole motion or, if it follows the body, the body's surroundings.

        In a picture with an aspect (width over height) below 1, the motion is in the upper part, above the
        panel.
        """
        every = slice(None, None, -(-len(motion.times) // MOMENTS))
        x = motion.look.points(motion.positions[every])
        tips = [
            (origins + vectors)[every, None]
            for name, (origins, vectors, _) in motion.arrows.items()
            if group_of(name) == "rotation" and self._shown["rotation"]
        ]
        x = np.concatenate([x, *tips], axis=1)
        if self._follows:
            x = x - (motion.centre - motion.centre[0])[every, None]
        aside, share = (ASIDE, 1.0) if aspect >= 1.0 else ((0.0, -SHEET), 1.0 - SHEET)
        size = (max(1, round(1000 * min(1.0, aspect / share))), 1000)
        narrow = 2.0 * float(np.arctan(share * np.tan(0.5 * FOV)))
        camera = replace(Camera.fitting(x, size, *motion.direction, narrow, 0.1), fov=FOV)
        right, up, _ = camera.axes()
        reach = camera.distance * np.tan(0.5 * FOV)
        return camera.moved(reach * (aside[0] * right + aside[1] * up))

    def write(self, text: str) -> None:
        """Write a line below the motion."""
        assert self._motion is not None
        camera = self.camera(self._motion)
        _, up, _ = camera.axes()
        reach = camera.distance * np.tan(0.5 * FOV)
        self._scene.add_label(
            "/text", text, position=np.add(camera.target, -0.85 * reach * up), anchor="bottom-center"
        )

    # --- Building -----------------------------------------------------------------------------------

    def _add_scenery(self, motion: Motion) -> None:
        scenery = motion.scenery
        x = motion.positions
        extent = max(float(np.ptp(x, axis=(0, 1)).max()), motion.extent)
        middle = x.reshape(-1, 3).mean(axis=0)
        flat = [] if scenery.floor is None else [((0.0, 0.0, scenery.floor), (0.0, 0.0, 1.0))]
        for n, (point, normal) in enumerate([*flat, *scenery.planes]):
            unit = np.asarray(normal, float) / np.linalg.norm(normal)
            foot = middle - unit * float((middle - np.asarray(point)) @ unit)
            section = round_up(extent / 3)
            foot = section * np.round(foot / section) if abs(unit[2]) > 0.999 else foot
            foot = foot - unit * float((foot - np.asarray(point)) @ unit)
            level = abs(unit[2]) > 0.999
            self._scene.add_grid(
                f"/ground/plane{n}",
                width=(8 if level else 2.6) * extent,
                height=(8 if level else 2.6) * extent,
                cell_size=section / 5,
                section_size=section,
                cell_color=CELL,
                section_color=SECTION,
                plane_color=GROUND,
                plane_opacity=1.0 if level else 0.9,
                fade_distance=(5 if level else 40) * extent,
                fade_from="origin" if np.linalg.norm(foot) < extent else "camera",
                shadow_opacity=0.3,
                position=foot,
                wxyz=_turned(unit),
            )
        for n, surface in enumerate(scenery.surfaces):
            self._add_net(n, surface.net(middle, 1.5 * extent))
        for n, disk in enumerate(scenery.disks):
            self._add_disk(f"/ground/disk{n}", 1 + n, *disk)
        if scenery.vertical is not None:
            foot, height = scenery.vertical
            steps = np.linspace(0.0, height, 41)[:-1].reshape(-1, 2)
            points = np.asarray(foot) + steps[..., None] * np.array([0.0, 0.0, 1.0])
            self._scene.add_line_segments(
                "/ground/vertical", points, GRAPHITE, thickness=1.6, thickness_units="screen"
            )

    def _add_net(self, number: int, net: np.ndarray) -> None:
        """Show a curved surface by points (m, n, 3) in rows and columns."""
        self._scene.add_mesh_simple(
            f"/ground/surface{number}",
            net.reshape(-1, 3).astype(np.float32),
            _cells(*net.shape[:2]),
            color=(225, 232, 242),
            opacity=0.55,
            side="double",
            cast_shadow=False,
        )
        across = net[::4]
        along = net[:, ::6]
        lines = [np.stack([across[:, :-1], across[:, 1:]], axis=2), np.stack([along[:-1], along[1:]], axis=2)]
        self._scene.add_line_segments(
            f"/ground/net{number}",
            np.concatenate([of.reshape(-1, 2, 3) for of in lines]),
            (170, 181, 198),
            thickness=1.0,
            thickness_units="screen",
        )

    def _add_disk(self, name: str, rank: int, centre: Point, radius: float, color: Color) -> Any:
        """Show a horizontal disk; those of higher rank, from 1 on, lie imperceptibly above others."""
        rim = circle((0.0, 0.0, 0.0), radius, 72)
        up = np.array([0.0, 0.0, 1e-3 * rank])
        n = np.arange(1, len(rim) - 1)
        return self._scene.add_mesh_simple(
            name,
            rim.astype(np.float32),
            np.stack([0 * n, n, n + 1], axis=1),
            color=tuple(toned(color, LIT, linear=False).tolist()),
            cast_shadow=False,
            position=np.asarray(centre) + up,
        )

    def _add_body(self, motion: Motion) -> None:
        look = motion.look
        x = motion.look.points(motion.positions[0])
        triangles = np.asarray(look.triangles)
        colors = np.asarray(look.triangle_colors)
        self._faces: list[tuple[Any, np.ndarray]] = []
        self._opacities: list[float | None] = []
        kinds = np.column_stack([colors, np.asarray(look.opacity)])
        for n, (*color, opacity) in enumerate(np.unique(kinds, axis=0).tolist()) if len(triangles) else ():
            corners = triangles[(kinds == (*color, opacity)).all(axis=1)].ravel()
            self._opacities.append(opacity if opacity < 1 else None)
            mesh = self._scene.add_mesh_simple(
                f"/world/body/faces{n}",
                x[corners].astype(np.float32),
                np.arange(len(corners)).reshape(-1, 3),
                color=tuple(toned(color, LIT, linear=False).tolist()),
                flat_shading=True,
                side="double",
                opacity=self._opacities[n],
            )
            self._faces.append((mesh, corners))
        self._bars: Any = None
        pairs = np.asarray(look.bars)
        if len(pairs):
            tube, faces = _tube()
            self._bars = self._scene.add_batched_meshes_simple(
                "/world/body/bars",
                tube,
                faces,
                *self._bar_poses(x)[:2],
                batched_scales=self._bar_poses(x)[2],
                batched_colors=toned(np.asarray(look.bar_colors), LIT),
                lod="off",
            )
        self._balls: Any = None
        radii = np.asarray(look.radii)
        self._round = np.flatnonzero(radii > 0)
        if len(self._round):
            ball, faces, _ = globe(*BALL)
            count = len(self._round)
            self._balls = self._scene.add_batched_meshes_simple(
                "/world/body/balls",
                ball.astype(np.float32),
                faces,
                np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
                x[self._round],
                batched_scales=np.repeat(radii[self._round, None], 3, axis=1),
                batched_colors=toned(np.asarray(look.ball_colors)[self._round], LIT),
                lod="off",
            )

    def _bar_poses(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return quaternions, positions and scales of the bars."""
        assert self._motion is not None
        look = self._motion.look
        first, second = np.asarray(look.bars).T
        along = x[second] - x[first]
        length = np.linalg.norm(along, axis=1)
        radius = np.asarray(look.bar_radius)
        unit = along / np.maximum(length, 1e-12)[:, None]
        return _turned(unit), x[first], np.stack([radius, radius, length], axis=1)

    # --- Drawing ------------------------------------------------------------------------------------

    def draw(self, time: float) -> None:
        """Show the motion at a time [s]."""
        motion = self._motion
        assert motion is not None
        n, share = motion.at(time)
        x = motion.positions[n] + share * (motion.positions[n + 1] - motion.positions[n])
        x = motion.look.points(x)
        if self._follows:
            way = motion.centre[n] + share * (motion.centre[n + 1] - motion.centre[n]) - motion.centre[0]
            self._world.position = self._ground.position = -way
        elif self._world.position.any():
            self._world.position = self._ground.position = np.zeros(3)
        glass = self._shown["springs"]
        for (mesh, corners), own in zip(self._faces, self._opacities, strict=True):
            mesh.vertices = x[corners].astype(np.float32)
            opacity = GLASS if glass else own
            if mesh.opacity != opacity:
                mesh.opacity = opacity
        if self._bars is not None:
            wxyzs, positions, scales = self._bar_poses(x)
            self._bars.batched_wxyzs = wxyzs
            self._bars.batched_positions = positions
            self._bars.batched_scales = scales
            self._bars.visible = not glass or not len(motion.lengths)
        if self._balls is not None:
            self._balls.batched_positions = x[self._round]
        self._draw_springs(motion, x, n, share)
        self._draw_trace(motion, x, n)
        self._draw_arrows(motion, n, share)
        self._draw_contacts(motion, n)
        if motion.marks:
            self._draw_marks(motion, motion.marks[n])

    def _draw_springs(self, motion: Motion, x: np.ndarray, n: int, share: float) -> None:
        shown = self._shown["springs"] and len(motion.lengths) > 0
        if shown:
            pairs = np.asarray(motion.look.springs)
            strain = self._strain[n] + share * (self._strain[n + 1] - self._strain[n])
            colors = strain_colors(strain, self.strain_scale)
            self._lines("/world/springs", x[pairs], np.repeat(colors[:, None], 2, axis=1), 4.0)
        self._hide("/world/springs", not shown)

    def _draw_trace(self, motion: Motion, x: np.ndarray, n: int) -> None:
        trace = motion.look.trace
        shown = self._shown["trace"] and trace is not None and n > 0
        if shown:
            every = max(1, -(-n // TRAIL))
            points = np.concatenate([motion.positions[: n + 1 : every, trace], x[None, trace]])
            self._lines("/world/trace", np.stack([points[:-1], points[1:]], axis=1), np.array(ORANGE), 3.0)
        self._hide("/world/trace", not shown)
        for name, (path, color) in motion.paths.items():
            seen = self._shown["rigid twin"] and n > 0
            if seen:
                every = max(1, -(-len(path) // (2 * TRAIL)))
                points = path[::every]
                count = len(points) // 2
                dashes = np.stack([points[0 : 2 * count : 2], points[1 : 2 * count : 2]], axis=1)
                if f"/world/{name}" not in self._nodes:
                    self._lines(f"/world/{name}", dashes, np.array(color), 1.6)
            self._hide(f"/world/{name}", not seen)

    def _draw_arrows(self, motion: Motion, n: int, share: float) -> None:
        for name, (origins, vectors, color) in motion.arrows.items():
            start = origins[n] + share * (origins[n + 1] - origins[n])
            along = vectors[n] + share * (vectors[n + 1] - vectors[n])
            shown = self._shown[group_of(name)] and float(np.linalg.norm(along)) > SHORTEST * motion.extent
            if shown:
                self._arrows(f"/world/arrows/{name}", start[None], along[None], color, motion.extent)
            self._hide(f"/world/arrows/{name}", not shown)

    def _draw_contacts(self, motion: Motion, n: int) -> None:
        """Draw the contacts of time ``n``; they are not interpolated between times."""
        points = np.zeros((0, 3))
        vectors = np.zeros((0, 3))
        if motion.touches is not None and self._shown["contacts"]:
            points, vectors, mutual = (of[n] for of in motion.touches)
            there = np.isfinite(points).all(axis=1)
            points = np.concatenate([points[there], points[there & mutual]])
            vectors = np.concatenate([vectors[there], -vectors[there & mutual]])
        name = "/world/contacts/points"
        if len(points):
            look = {"point_size": 0.012 * motion.extent, "point_shape": "circle", "point_shading": "flat"}
            self._put(name, self._scene.add_point_cloud, points, colors=RED, precision="float32", **look)
        self._hide(name, not len(points))
        seen = np.linalg.norm(vectors, axis=1) > SHORTEST * motion.extent
        if seen.any():
            self._arrows("/world/contacts/forces", points[seen], vectors[seen], RED, 0.35 * motion.extent)
        self._hide("/world/contacts/forces", not seen.any())

    def _arrows(self, name: str, starts: np.ndarray, along: np.ndarray, color: Any, size: float) -> None:
        """Draw arrows from points (n, 3) by vectors (n, 3) [m]."""
        points = np.stack([starts, starts + along], axis=1)
        shaft = 0.014 * size
        head = 0.04 * size
        sizes = {"shaft_radius": shaft, "head_radius": head, "head_length": 0.1 * size}
        self._put(name, self._scene.add_arrows, points, colors=toned(color, LIT), **sizes)

    def _lines(self, name: str, points: np.ndarray, colors: np.ndarray, thickness: float) -> None:
        if colors.ndim == 1:
            colors = np.broadcast_to(colors, points.shape)
        look = {"thickness": thickness, "thickness_units": "screen"}
        if node := self._put(name, self._scene.add_line_segments, points, colors=toned(colors), **look):
            node.colors = toned(colors)

    def _put(self, name: str, add: Callable[..., Any], points: np.ndarray, **look: Any) -> Any:
        """Move a node to points, and return it; add one if there is none with this number of points."""
        points = points.astype(np.float32)
        node = self._nodes.get(name)
        if node is None or node.points.shape != points.shape:
            self._nodes[name] = add(name, points, **look)
            return None
        node.points = points
        return node

    def _hide(self, name: str, hidden: bool) -> None:
        node = self._nodes.get(name)
        if node is not None and node.visible == hidden:
            node.visible = not hidden

    # --- Marks --------------------------------------------------------------------------------------

    def _draw_marks(self, motion: Motion, marks: Marks) -> None:
        extent = motion.extent
        for n, disk in enumerate(marks.disks):
            name = f"/world/marks/disks{n}"
            if name not in self._nodes:
                self._nodes[name] = self._add_disk(name, 9, *disk)
        for n, (centre, radius) in enumerate(marks.rings):
            points = circle(centre, radius, 73)
            ring = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
            self._marked_lines(f"/world/marks/rings{n}", ring, GREEN, 4.0)
        for n, (start, stop) in enumerate(marks.lines):
            self._marked_lines(f"/world/marks/lines{n}", np.array([[start, stop]]), STEEL, 3.0)
        for n, (start, stop, color) in enumerate(marks.edges):
            self._marked_lines(f"/world/marks/edges{n}", np.array([[start, stop]]), color, 3.0)
        for n, (centre, radius) in enumerate(marks.balls):
            name = f"/world/marks/balls{n}"
            if name not in self._nodes:
                self._nodes[name] = self._scene.add_icosphere(
                    name,
                    radius=radius,
                    color=tuple(toned(GREEN, LIT, linear=False).tolist()),
                    opacity=0.6,
                    position=np.asarray(centre, float),
                )
            self._nodes[name].position = np.asarray(centre, float)
        for n, arrow in enumerate(marks.arrows):
            self._draw_mark(f"/world/marks/arrows{n}", arrow, extent)
        for name in self._nodes:
            if of := MARK.match(name):
                beyond = int(of["n"]) >= len(getattr(marks, of["kind"]))  # another moment has more of them
                if beyond or of["kind"] != "arrows":  # arrows are shown by their length
                    self._hide(name, beyond)

    def _draw_mark(self, name: str, arrow: Arrow, extent: float) -> None:
        """Draw an arrow, or hide one that is too short; one around an axis as an arc with a head."""
        start = np.asarray(arrow.origin, float)
        along = np.asarray(arrow.vector, float)
        length = float(np.linalg.norm(along))
        shown = length > SHORTEST * extent
        if shown and arrow.radius:
            head = min(0.1 * extent, 0.6 * length)
            points, axis = arrow_path(arrow, along / length, length, head, self._eye)
            self._lines(
                f"{name}/arc", np.stack([points[:-1], points[1:]], axis=1), np.array(arrow.color), 5.0
            )
            start = points[-1]
            along = head * axis
        if shown:
            self._arrows(name, start[None], along[None], arrow.color, extent)
        self._hide(name, not shown)
        self._hide(f"{name}/arc", not shown)

    def _marked_lines(self, name: str, points: np.ndarray, color: Any, thickness: float) -> None:
        if name in self._marked and np.array_equal(self._marked[name], points):
            return
        self._marked[name] = points
        self._lines(name, points, np.array(color), thickness)


def play(server: Any, stage: Stage, motion: Motion, fps: float, speed: float) -> Any:
    """Record a motion once with viser's serializer, and return that."""
    moments = np.arange(0.0, motion.times[-1] + 1e-9, speed / fps)
    serializer = server.get_scene_serializer()
    for time in moments:
        stage.draw(float(time))
        serializer.insert_sleep(1 / fps)
    return serializer


def look_from(view: Any, camera: Camera) -> None:
    """Set the camera of a viser client, or the initial one of clients."""
    view.fov = camera.fov
    view.position = np.array(camera.eye)
    view.look_at = np.array(camera.target)


def toned(colors: ArrayLike, light: float = 1.0, linear: bool = True) -> np.ndarray:
    """Return colours (…, 3) from 0 to 255 that appear in the browser as the given ones, under some ``light``.

    Light and tone mapping are inverted; colours too bright for them become a little darker. Colours of lines
    and of instances are ``linear`` in viser, those of meshes are sRGB.
    """
    y = np.clip(srgb.to_light(np.asarray(colors, float) / 255.0) @ AFTER, 0.0, 1.0)
    a = 0.0245786
    b = 0.000090537
    c = 0.983729
    d = 0.432951
    e = 0.238081
    first = 1.0 - c * y
    second = a - d * y
    third = -(b + e * y)
    x = (np.sqrt(second**2 - 4.0 * first * third) - second) / (2.0 * first)
    sent = np.maximum(x @ BEFORE / EXPOSURE / light, 0.0)
    sent = sent / np.maximum(sent.max(axis=-1, keepdims=True), 1.0)
    if not linear:
        sent = srgb.from_light(sent)
    return np.rint(255.0 * sent).astype(np.uint8)


def group_of(arrow: str) -> str:
    """Return the tick that an arrow belongs to."""
    return "rotation" if arrow.startswith("angular") else "forces"


def _turned(direction: np.ndarray) -> np.ndarray:
    """Return quaternions (…, 4), w first, that turn z to unit vectors (…, 3)."""
    x, y, z = np.moveaxis(np.asarray(direction, float), -1, 0)
    half = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=-1)
    upside = half[..., 0] < 1e-9
    half[upside] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(half / np.linalg.norm(half, axis=-1, keepdims=True))


def _tube(sides: int = 14) -> tuple[np.ndarray, np.ndarray]:
    """Return the mesh of a round bar of radius 1 from z = 0 to 1, without ends."""
    rim = circle((0.0, 0.0, 0.0), 1.0, sides)
    vertices = np.concatenate([rim, rim + np.array([0.0, 0.0, 1.0])])
    n = np.arange(sides)
    m = (n + 1) % sides
    faces = np.concatenate([np.stack([n, m, m + sides], 1), np.stack([n, m + sides, n + sides], 1)])
    return vertices.astype(np.float32), faces


def _cells(rows: int, columns: int) -> np.ndarray:
    """Return two triangles (T, 3) for each cell of a grid of points, which are numbered row by row."""
    points = np.arange(rows * columns).reshape(rows, columns)
    a = points[:-1, :-1]
    b = points[1:, :-1]
    c = points[1:, 1:]
    d = points[:-1, 1:]
    return np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
