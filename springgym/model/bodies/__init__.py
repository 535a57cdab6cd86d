"""Bodies of point masses and springs. Nothing here depends on time."""

from springgym.model.bodies.ball import ball
from springgym.model.bodies.body import Body
from springgym.model.bodies.cube import box, cube
from springgym.model.bodies.equilibrium import relative_equilibrium, stretched_shapes
from springgym.model.bodies.gyroscope import gyroscope
from springgym.model.bodies.irregular import from_mesh, from_points, union
from springgym.model.bodies.motion import InitialState, rigid_velocities, start
from springgym.model.bodies.network import vibrations
from springgym.model.bodies.rolling import capsule, disk, ellipsoid, rolling_ball
from springgym.model.bodies.rope import rope
from springgym.model.bodies.rotations import rotation
from springgym.model.bodies.round import Round, ellipsoid_of, rim, sphere
from springgym.model.bodies.solid import softened, solid_box, solid_hull, solid_mesh, solid_rope, solid_top
from springgym.model.bodies.top import top

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
