"""Pictures and films of bodies in motion, drawn in software from particle positions alone.

A `Renderer` joins a `Look` (how a body is drawn), a `Camera` and a `Scenery`; every frame takes the
positions and, if wanted, `Marks` and the strains of the springs.
"""

from springgym.rendering.camera import Camera
from springgym.rendering.look import Arrow, Look, Marks, Scenery, two_tone
from springgym.rendering.renderer import Renderer
from springgym.rendering.video import save_video

__all__ = ["Arrow", "Camera", "Look", "Marks", "Renderer", "Scenery", "save_video", "two_tone"]
