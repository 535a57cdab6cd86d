"""Bodies of point masses and springs. Nothing here knows of time."""

from springgym.bodies.body import Body
from springgym.bodies.cube import box, cube
from springgym.bodies.equilibrium import relative_equilibrium, stretched_shapes
from springgym.bodies.gyroscope import gyroscope
from springgym.bodies.irregular import from_mesh, from_points, union
from springgym.bodies.motion import Start, spinning, start
from springgym.bodies.rope import rope
from springgym.bodies.rotations import rotation
from springgym.bodies.top import top

__all__ = [
    "Body",
    "Start",
    "box",
    "cube",
    "from_mesh",
    "from_points",
    "gyroscope",
    "relative_equilibrium",
    "rope",
    "rotation",
    "spinning",
    "start",
    "stretched_shapes",
    "top",
    "union",
]
