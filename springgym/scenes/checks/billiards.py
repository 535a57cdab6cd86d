"""Checks of rolling balls that collide against theory: on a table, at a cushion, on a turntable."""

from __future__ import annotations

import math

import numpy as np

from springgym.dynamics.contact.law import SLOW
from springgym.model.scene import Placed
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, within
from springgym.scenes.checks.rolling import ROLLED, moment_share, refuse_other_than_balls
from springgym.scenes.plan import Plan
from springgym.scenes.recording import Recording
from springgym.theory import contact, rolling

STRUCK = 0.01
"""Relative tolerance of the speeds of two balls after impact: restitution is accurate to 0.5 % of them."""

REBOUND = 0.02
"""Relative tolerance of a rebound's speed and angle: restitution, and with it friction, errs by 0.5 %."""

CIRCLED = 1e-3
"""Relative tolerance of the rate and the radius of a circle on a turntable."""


def _balls(plan: Plan) -> None:
    """Raise ValueError unless all bodies are balls of equal size."""
    needs.collide(plan)
    for placed in plan.scene.bodies:
        refuse_other_than_balls(placed.body)
    shares = {(placed.body.mass, *moment_share(placed.body)) for placed in plan.scene.bodies}
    if np.ptp(np.array(list(shares)), axis=0).max() > 1e-9:
        raise ValueError("the balls differ in mass, radius or moment of inertia")


def _slippery_balls(plan: Plan) -> None:
    """Raise ValueError if there is friction between bodies, which theory neglects."""
    if any(met.contact.friction > 0 for met in plan.scene.meetings):
        raise ValueError("there is friction between the balls, which theory leaves out")


def _ball_and(plan: Plan, held: bool) -> None:
    """Raise ValueError unless there are balls and one other body that they collide with."""
    needs.collide(plan)
    others = [placed for placed in plan.scene.bodies if not placed.body.rounds]
    if len(others) != 1 or bool(others[0].pinned) != held:
        raise ValueError(f"it applies to balls, and one {'pinned' if held else 'free'} body is not a ball")
    for placed in plan.scene.bodies:
        if placed is not others[0]:
            refuse_other_than_balls(placed.body)


def _cushion(plan: Plan) -> None:
    _ball_and(plan, held=True)


def _turntable(plan: Plan) -> None:
    _ball_and(plan, held=False)
    if len(plan.scene.bodies) != 2:
        raise ValueError(f"it applies to a ball on a table, and there are {len(plan.scene.bodies)} bodies")


def _other(recording: Recording) -> tuple[int, Placed]:
    """Return the index of the body that is no ball, and the body."""
    bodies = recording.plan.scene.bodies
    number = next(n for n, placed in enumerate(bodies) if not placed.body.rounds)
    return number, bodies[number]


@applies(_balls, _slippery_balls, needs.level, needs.friction, needs.moves, needs.gravity, together=True)
def billiards(recording: Recording) -> list[Check]:
    """Compare the quantity that equal balls conserve on a rough table, and their speeds when they roll again.

    The table's friction f acts at the lowest point: m dv = f and z × I dω = r f. So it does not change
    m v − z × I ω/r of any ball. Balls without friction between them exchange m v and no spin. So the sum over
    all is conserved.
    """
    scene = recording.plan.scene
    bodies = recording.bodies
    body = scene.bodies[0].body
    radius, share = moment_share(body)
    up = np.array([0.0, 0.0, 1.0])
    each = [(m.centre_velocity - share * radius * np.cross(up, m.angular_velocity))[:, :2] for m in bodies]
    kept = np.sum(each, axis=0) / (1 + share)
    size = float(np.linalg.norm(kept[0]))
    way = kept[0] / size
    along = kept[-1] @ way
    across = kept[-1] @ (-way[1], way[0])
    sag = max(2 * float(m.strain[len(recording.times) // 2 :].max(initial=0.0)) for m in bodies)
    slip = max(
        float(np.linalg.norm((m.centre_velocity[-1] - radius * np.cross(m.angular_velocity[-1], up))[:2]))
        for m in bodies
    )
    found = [
        within(ROLLED, "sum of what rolls, along", size, float(along), "m/s", sag),
        Check("sum of what rolls, across", 0.0, float(across), ROLLED * size, "m/s", sag * size),
        Check("largest slip at the end", 0.0, slip, ROLLED * size, "m/s"),
    ]
    return found if len(bodies) > 2 else [*found, *_struck(recording, radius, share)]


def _struck(recording: Recording, radius: float, share: float) -> list[Check]:
    """Compare the final speeds of two balls with theory, after one rolled into the other at rest."""
    met = recording.plan.scene.meetings[0]
    bodies = recording.bodies
    came, rests = sorted(range(2), key=lambda n: -float(np.linalg.norm(bodies[n].centre_velocity[0])))
    velocity = bodies[came].centre_velocity[0] * (1, 1, 0)
    speed = float(np.linalg.norm(velocity))
    way = velocity / speed
    apart = (bodies[rests].centre[0] - bodies[came].centre[0]) * (1, 1, 0)
    aside = apart - (apart @ way) * way
    sine = float(np.linalg.norm(aside)) / (2 * radius + met.reach / 2)
    line = aside / (2 * radius + met.reach / 2) + math.sqrt(max(1 - sine**2, 0.0)) * way
    restitution = contact.rebound(speed, met.contact.restitution, SLOW)
    names = [recording.plan.scene.bodies[n].name for n in (came, rests)]
    ends = rolling.after_struck(velocity, line, share, restitution)
    checks = []
    for name, n, end in zip(names, (came, rests), ends, strict=True):
        measured = float(np.linalg.norm(bodies[n].centre_velocity[-1]))
        expected = float(np.linalg.norm(end))
        checks.append(Check(f"{name}: speed of rolling", expected, measured, STRUCK * speed, "m/s"))
    return checks


@applies(_cushion, needs.ice, needs.moves, needs.coulomb, together=True)
def cushion(recording: Recording) -> list[Check]:
    """Compare the speed and the angle of balls that struck a cushion with Coulomb's law.

    The table must be smooth, as its friction would continue to change both.
    """
    scene = recording.plan.scene
    number, wall = _other(recording)
    how = next(met.contact for met in scene.meetings if number in met[:2])
    corners = wall.positions[wall.body.triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = faces / np.linalg.norm(faces, axis=1)[:, None]
    checks = []
    for n, placed in enumerate(scene.bodies):
        if n == number:
            continue
        m = recording.bodies[n]
        # the ball is in front of the face from which it is farthest outwards
        normal = faces[int(np.einsum("fi,fi->f", m.centre[0] - corners[:, 0], faces).argmax())]
        radius, share = moment_share(placed.body)
        velocity = m.centre_velocity[0]
        restitution = contact.rebound(abs(float(velocity @ normal)), how.restitution, SLOW)
        expected = rolling.off_a_wall(
            velocity, m.angular_velocity[0], normal, radius, share, how.friction, restitution
        )
        along = np.cross((0.0, 0.0, 1.0), normal)
        (speed, angle), (far, wide) = (
            (math.hypot(*v[:2]), math.atan2(float(v @ along), float(v @ normal)))
            for v in (expected, m.centre_velocity[-1])
        )
        checks += [
            within(REBOUND, f"{placed.name}: speed of rebound", speed, far, "m/s"),
            within(REBOUND, f"{placed.name}: angle of rebound", angle, wide, "rad"),
        ]
    return checks


@applies(_turntable, needs.level, needs.ice, needs.gravity, together=True)
def turntable(recording: Recording) -> list[Check]:
    """Compare the rate and the radius of the circle of a ball on a turning table with theory.

    The second half of the run counts. The table is free, and slower the farther out the ball is.
    """
    scene = recording.plan.scene
    number, _ = _other(recording)
    table = recording.bodies[number]
    ball = recording.bodies[1 - number]
    # as the table is free, the slip is that of the reduced mass
    _, share = moment_share(scene.bodies[1 - number].body)
    share *= 1 + scene.bodies[1 - number].body.mass / scene.bodies[number].body.mass
    late = recording.times > 0.5 * recording.times[-1]
    times = recording.times[late]
    velocity = (ball.centre_velocity - table.centre_velocity)[late]
    expected = rolling.turntable_rate(float(table.angular_velocity[late, 2].mean()), share)
    enough = late.sum() > 3
    turned = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    rate = float(np.polyfit(times, turned, 1)[0]) if enough else math.nan
    x, y = (ball.centre - table.centre)[late, :2].T
    # x² + y² = 2 x x₀ + 2 y y₀ + (r² − x₀² − y₀²)
    fit, *_ = np.linalg.lstsq(np.stack([2 * x, 2 * y, np.ones_like(x)], axis=1), x**2 + y**2)
    radius = math.sqrt(max(fit[2] + fit[0] ** 2 + fit[1] ** 2, 0.0)) if enough else math.nan
    speed = float(np.linalg.norm(velocity[:, :2], axis=1).mean()) if enough else math.nan
    doubt = float(np.ptp(table.angular_velocity[late, 2])) / abs(expected) if enough else math.nan
    return [
        within(CIRCLED, "rate of going round", expected, rate, "rad/s", doubt),
        within(CIRCLED, "radius of the circle", speed / abs(expected), radius, "m", doubt),
    ]
