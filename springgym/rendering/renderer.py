"""Software rendering of frames with pygame, with the same code for arrays and for the window."""

from __future__ import annotations

from collections import deque
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from springgym.checks import TINY, chosen, instance, number, readings, refusing_unknown, whole_array
from springgym.rendering.camera import Camera
from springgym.rendering.canvas import Array, Canvas, import_pygame
from springgym.rendering.ground import paint_background, paint_disk, paint_ring, paint_shadows
from springgym.rendering.look import GREEN, INK, ORANGE, Look, Marks, Scenery
from springgym.rendering.solids import THROUGH, arrow, body, dashes, rail, strain_colors

WIDEST = 2**13
"""Largest number of pixels of a side of a picture."""
CHORDS = 4
"""Number of straight pieces of the trace from one moment to the next."""
PLATE = (250, 251, 253, 190)
"""Colour and opacity of the plates behind words, on which dark words can be read before any background."""


@refusing_unknown
class Renderer:
    """Draws a body, its scenery and marks, and keeps the trace between frames.

    pygame is imported with the first frame. A window opens only in mode "human".

    Parameters
    ----------
    look : Look
    camera : Camera
        May be exchanged between frames.
    scenery : Scenery
        May be exchanged between frames.
    size : tuple of 2 ints
        Width and height of the picture, pixels.
    mode : {"rgb_array", "human"}
        Return the picture, or show it in a window.
    fps : float
        Largest number of frames per second in the window.

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or value; the message names it.
    """

    def __init__(
        self,
        look: Look,
        camera: Camera,
        scenery: Scenery | None = None,
        size: tuple[int, int] = (640, 640),
        mode: Literal["rgb_array", "human"] = "rgb_array",
        fps: float = 50.0,
    ) -> None:
        self.look = instance("look", look, Look)
        self.camera = instance("camera", camera, Camera)
        self.scenery = Scenery() if scenery is None else instance("scenery", scenery, Scenery)
        width, height = whole_array("size", size, (2,), low=16, high=WIDEST).tolist()
        self.size = (width, height)
        self.mode = chosen("mode", mode, ("rgb_array", "human"))
        self.fps = number("fps", fps, TINY)
        self._trace: deque[Array] = deque(maxlen=look.trace_length)
        self._followed = False
        self._drawn_for: tuple[Camera, Scenery] | None = None
        self._canvas: Canvas | None = None
        self._window: Any = None
        self._clock: Any = None

    def draw(
        self, positions: ArrayLike, marks: Marks | None = None, strain: ArrayLike | None = None
    ) -> NDArray[np.uint8] | None:
        """Draw a picture of the particles at given positions.

        Parameters
        ----------
        positions : (N, 3) array_like
            Positions of the particles, m. Parts with a particle that is not finite are left out.
        marks : Marks, optional
        strain : (S,) array_like, optional
            Strain of each spring of the look. If given, the springs are drawn and the surface is translucent.

        Returns
        -------
        (height, width, 3) uint8 array, or None in mode "human".

        Raises
        ------
        gymnasium.error.DependencyNotInstalled
            Without pygame.
        ValueError
            If shapes do not fit.
        """
        look = self.look
        x = _places(positions, self.look.particles, "the look draws")
        s = None if strain is None else readings("strain", strain, (len(np.asarray(look.springs)),))
        if marks is not None:
            instance("marks", marks, Marks)
        if not self._followed:
            self._leave(x)
        with np.errstate(invalid="ignore", over="ignore"):  # values that are not finite are not drawn
            picture = self._paint(look.points(x), marks if marks is not None else Marks(), s)
        return self._show(picture)

    def follow(self, positions: ArrayLike) -> None:
        """Add a state that is not drawn to the trace.

        After the first call, and until the next `reset`, the trace passes only through the moments given
        here. So if you draw one moment in ten, call this for all ten.

        Parameters
        ----------
        positions : (N, 3) array_like
            Particles, m.
        """
        traced = 0 if self.look.trace is None else 1 + self.look.trace
        x = _places(positions, traced, "the trace follows the last of")
        self._followed = True
        self._leave(x)

    def _leave(self, x: Array) -> None:
        if self.look.trace is not None:
            self._trace.append(x[self.look.trace].copy())

    def reset(self) -> None:
        """Delete the trace."""
        self._trace.clear()
        self._followed = False

    def close(self) -> None:
        """Close the window, if there is one, and free the surfaces. May be called again."""
        if self._window is not None:
            import_pygame().display.quit()
        self._canvas = self._window = self._clock = None
        self._drawn_for = None
        self.reset()

    def _prepared_canvas(self) -> Canvas:
        """Return a canvas that shows only the background."""
        if self._canvas is None or self._drawn_for != (self.camera, self.scenery):
            instance("camera", self.camera, Camera)
            instance("scenery", self.scenery, Scenery)
            self._canvas = Canvas(self.size, self.camera)
            paint_background(self._canvas, self.scenery)
            self._canvas.keep()
            self._drawn_for = (self.camera, self.scenery)
        self._canvas.wipe()
        return self._canvas

    def _paint(self, x: Array, marks: Marks, strain: Array | None) -> Any:
        """Paint one picture."""
        canvas = self._prepared_canvas()
        for disk in marks.disks:
            paint_disk(canvas, *disk)
        for center, radius in marks.rings:
            paint_disk(canvas, center, radius, GREEN, 40)
            paint_disk(canvas, center, 0.5 * radius, GREEN, 50)
        paint_shadows(canvas, self.look, x, self.scenery)
        body(canvas, self.look, x, strain, marks.balls)
        for center, radius in marks.rings:
            paint_ring(canvas, center, radius)
        for ends in marks.lines:
            rail(canvas, *ends)
        for edge in marks.edges:
            rail(canvas, *edge)
        for mark in marks.arrows:
            arrow(canvas, mark)
        if self.scenery.vertical is not None:
            dashes(canvas, *self.scenery.vertical)
        self._paint_trace(canvas)
        picture = canvas.picture()
        self._write(picture, marks, strain is not None)
        return picture

    def _paint_trace(self, canvas: Canvas) -> None:
        """Paint the trace, pale where it is hidden: much of a trace runs inside the body."""
        if len(self._trace) < 2:
            return
        curve = _curve(np.array(self._trace))
        young = np.linspace(0.0, 1.0, self.look.trace_length)[1 - len(self._trace) :].repeat(CHORDS)
        segments = np.stack([curve[:-1], curve[1:]], axis=1)
        canvas.strokes(segments, 1.2 + 1.8 * young, ORANGE, 0.95 * young**1.2, THROUGH)

    def _write(self, picture: Any, marks: Marks, legend: bool) -> None:
        """Write text and legends on the finished picture."""
        pygame = import_pygame()
        pygame.font.init()
        height = self.size[1]
        unit = max(height // 32, 11)  # then an em is at least 11 pixels: pygame's font has 0.69 of its size
        font = pygame.font.Font(None, round(1.5 * unit))

        def write(line: str, left: int = 0, **place: tuple[int, int]) -> None:
            """Write dark text on a bright plate, which begins ``left`` pixels before it."""
            word = font.render(line, True, INK)
            box = word.get_rect(**place)
            under = pygame.Rect(box.left - left, box.top, box.width + left, box.height).inflate(unit // 2, 0)
            plate = pygame.Surface(under.size, pygame.SRCALPHA, 32)
            pygame.draw.rect(plate, PLATE, plate.get_rect(), border_radius=unit // 4)
            picture.blit(plate, under)
            picture.blit(word, box)

        for row, line in enumerate(marks.text):
            write(line.strip(), topleft=(unit, round(unit * (1.0 + 1.4 * row))))
        bottom = height - (4 if legend else 1) * unit
        for row, (color, line) in enumerate(reversed(marks.key)):
            middle = (round(1.35 * unit), round(bottom - 1.4 * unit * row - 0.4 * unit))
            write(line, left=unit, midleft=(2 * unit, middle[1]))
            pygame.draw.circle(picture, color, middle, round(0.4 * unit))
        if legend:
            scale = self.look.strain_scale
            steps = np.linspace(-scale, scale, 11 * unit)
            bar = np.repeat(strain_colors(steps, scale)[:, None], unit // 2, axis=1)
            box = picture.blit(pygame.surfarray.make_surface(bar), (unit, height - 3 * unit // 2))
            for place, label in ("midleft", f"-{scale:g}"), ("center", "strain"), ("midright", f"+{scale:g}"):
                write(label, **{place: getattr(box.move(0, -unit), place)})

    def _show(self, picture: Any) -> NDArray[np.uint8] | None:
        pygame = import_pygame()
        if self.mode == "rgb_array":
            raw = pygame.image.tobytes(picture, "RGB")
            return np.frombuffer(bytearray(raw), np.uint8).reshape(*self.size[::-1], 3)
        if self._window is None:
            pygame.display.init()
            pygame.display.set_caption("springgym")
            self._window = pygame.display.set_mode(self.size)
            self._clock = pygame.time.Clock()
        self._window.blit(picture, (0, 0))
        pygame.event.pump()
        self._clock.tick(self.fps)
        pygame.display.flip()
        return None


def _curve(points: Array) -> Array:
    """Return points (CHORDS (n − 1) + 1, 3) on Catmull and Rom's smooth curve through points (n, 3)."""
    along = np.gradient(points, axis=0)
    t = (np.arange(CHORDS) / CHORDS)[:, None]
    start = (1 + 2 * t) * (1 - t) ** 2 * points[:-1, None] + t * (1 - t) ** 2 * along[:-1, None]
    stop = t**2 * (3 - 2 * t) * points[1:, None] - t**2 * (1 - t) * along[1:, None]
    return np.vstack([(start + stop).reshape(-1, 3), points[-1:]])


def _places(positions: ArrayLike, least: int, why: str) -> Array:
    """Return positions (N, 3) of at least ``least`` particles; those not finite are not drawn."""
    x = readings("positions", positions, (None, 3))
    if len(x) < least:
        raise ValueError(
            f"positions are {len(x)}; {why} {least} particles, so that there must be at least as many"
        )
    return x
