"""Bodies of point masses and springs. Nothing here depends on time."""

from springgym.bodies.ball import ball
from springgym.bodies.body import Body
from springgym.bodies.cube import box, cube
from springgym.bodies.equilibrium import relative_equilibrium, stretched_shapes
from springgym.bodies.gyroscope import gyroscope
from springgym.bodies.irregular import from_mesh, from_points, union
from springgym.bodies.motion import InitialState, rigid_velocities, start
from springgym.bodies.network import vibrations
from springgym.bodies.rolling import capsule, disk, ellipsoid, rolling_ball
from springgym.bodies.rope import rope
from springgym.bodies.rotations import rotation
from springgym.bodies.round import Round, ellipsoid_of, rim, sphere
from springgym.bodies.solid import softened, solid_box, solid_hull, solid_mesh, solid_rope, solid_top
from springgym.bodies.top import top

__all__ = [
    "Body",
    "InitialState",
    "Round",
    "ball",
    "box",
    "capsule",
    "cube",
    "disk",
    "ellipsoid",
    "ellipsoid_of",
    "from_mesh",
    "from_points",
    "gyroscope",
    "relative_equilibrium",
    "rigid_velocities",
    "rim",
    "rolling_ball",
    "rope",
    "rotation",
    "softened",
    "solid_box",
    "solid_hull",
    "solid_mesh",
    "solid_rope",
    "solid_top",
    "sphere",
    "start",
    "stretched_shapes",
    "top",
    "union",
    "vibrations",
]
