"""Every argument of every public function and class of theory, given what it could not be."""

from __future__ import annotations

import copy
import inspect
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from springgym import theory
from springgym.theory import (
    contact,
    dominoes,
    frames,
    free_body,
    impact,
    oscillation,
    pendulum,
    rolling,
    rope,
    solid,
    top,
)
from tests.hostile import Call, complaints

ANY = "-1; -0.5; 0; 2.5; 10**9"
"""Values that a number of any sign may have."""

POSITIVE = "2.5; 10**9"
NOT_NEGATIVE = f"0; {POSITIVE}"
STEEP = "0"
"""A slope of up to a right angle."""

SHAPES = "two; three; (); []; one axis more; one row more; one row fewer"
"""Arrays of other shapes, of positive numbers."""

TIMES = f"{ANY}; {SHAPES}"
PAIR_TIMES = f"{NOT_NEGATIVE}; {SHAPES}"
ROWS = "one row more; one row fewer"
FRAMES = f"one axis more; {ROWS}"
FEWER = f"three; {FRAMES}"

X, Y, Z = np.eye(3)
ONE = np.eye(3)
BODY = [0.2, 0.3, 0.4]
T = np.array([0.1, 0.2])
TOP = top.HeavyTop(9.75, 1.5, 88.29)
STATE = top.TopState(0.4, 45.0)
RULE = solid.box_rule((1.0, 2.0, 3.0), 2)
TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
SPRING = np.zeros((6, 6))
SPRING[np.ix_([2, 5], [2, 5])] = [[200.0, -200.0], [-200.0, 200.0]]

HEAVY = {"top": TOP, "state": STATE}
ROW = {"height": 0.048, "thickness": 0.0075, "space": 0.0144}
FLOOR = {"strength": 0.05, "reach": 0.02}
CHAIN = {"masses": [0.1, 0.2, 0.3], "rest_length": [0.5, 0.5, 0.6], "stiffness": [1e3, 1e3, 2e3]}

TAKES_ROW = {"height": POSITIVE, "thickness": "0"}
TAKES_FLOOR = {"strength": POSITIVE, "reach": POSITIVE}
TAKES_CHAIN = {
    "masses": "three",
    "rest_length": f"{NOT_NEGATIVE}; three",
    "stiffness": f"{POSITIVE}; inf; three; inf inside",
}
OTHERS = {"masses": "masses|rest_length|stiffness"}
"""They must be as many as there are masses."""

CALLS = [
    # contact
    Call(contact.force, {"height": T, **FLOOR}, {"height": f"{POSITIVE}; {SHAPES}", **TAKES_FLOOR}),
    Call(contact.energy, {"height": T, **FLOOR}, {"height": f"{POSITIVE}; {SHAPES}", **TAKES_FLOOR}),
    Call(contact.rest_height, {"weight": 9.81, **FLOOR}, {"weight": NOT_NEGATIVE, **TAKES_FLOOR}),
    Call(
        contact.turning_point,
        {"energy": 1.0, **FLOOR, "weight": 9.81},
        {"energy": ANY, **TAKES_FLOOR, "weight": NOT_NEGATIVE},
        beyond="the energy of rest",
    ),
    Call(
        contact.apex,
        {"energy": 1.0, **FLOOR, "weight": 9.81},
        {"energy": ANY, **TAKES_FLOOR, "weight": POSITIVE},
        beyond="the energy of rest",
    ),
    Call(
        contact.rebound,
        {"speed": 1.0, "restitution": 0.5, "slow": 0.004},
        {"speed": NOT_NEGATIVE, "restitution": "0", "slow": POSITIVE},
    ),
    Call(
        contact.stopping_distance,
        {"speed": 1.0, "friction": 0.5, "gravity": 9.81},
        {"speed": NOT_NEGATIVE, "friction": POSITIVE, "gravity": POSITIVE},
    ),
    Call(
        contact.slope_acceleration,
        {"angle": 0.5, "friction": 0.5, "gravity": 9.81},
        {"angle": STEEP, "friction": NOT_NEGATIVE, "gravity": NOT_NEGATIVE},
    ),
    Call(contact.holds, {"angle": 0.5, "friction": 0.5}, {"angle": STEEP, "friction": NOT_NEGATIVE}),
    # dominoes
    Call(dominoes.leaning, {"angle": 0.1, "count": 2, **ROW}, {"angle": "0", **TAKES_ROW}),
    Call(
        dominoes.weights,
        {"angles": T, **ROW, "friction": 0.2},
        {"angles": f"two; three; {ROWS}", **TAKES_ROW, "friction": "0; 2.5"},
    ),
    Call(
        dominoes.impacts,
        {"count": 2, **ROW, "inertia": 8e-4, "start": 7.0, "gravity": 9.81, "friction": 0.2},
        {**TAKES_ROW, "inertia": POSITIVE, "start": POSITIVE, "gravity": NOT_NEGATIVE, "friction": "0; 2.5"},
        beyond="comes to rest",
    ),
    Call(
        dominoes.speed,
        {**ROW, "inertia": 8e-4, "gravity": 9.81, "count": 2, "friction": 0.2},
        {**TAKES_ROW, "inertia": POSITIVE, "gravity": POSITIVE, "friction": "0; 2.5"},
    ),
    # frames
    Call(
        frames.euler_zxz,
        {"phi": T, "theta": T, "psi": T},
        dict.fromkeys(("phi", "theta", "psi"), f"{ANY}; two; one axis more; one row fewer"),
    ),
    Call(
        frames.carry,
        {"frame": np.stack([ONE, ONE]), "omega_world": np.ones((2, 3)), "points": np.ones((2, 3))},
        {"points": ROWS},
    ),
    # free_body
    Call(
        free_body.FreeMotion,
        {"omega_body": np.ones((2, 3)), "omega_world": np.ones((2, 3)), "attitude": np.stack([ONE, ONE])},
        {"omega_body": FEWER, "omega_world": FEWER, "attitude": FRAMES},
    ),
    Call(
        free_body.corner_box_inertia,
        {"mass": 1.0, "edges": [1.0, 0.7, 0.4]},
        {"mass": POSITIVE, "edges": "three"},
    ),
    Call(free_body.growth_rate, {"inertia": BODY, "spin": 6.0}, {"inertia": "three", "spin": ANY}),
    Call(free_body.flip_interval, {"inertia": BODY, "omega": X + Y}, {"inertia": "three", "omega": "three"}),
    Call(
        free_body.motion,
        {"inertia": BODY, "omega": X + Y, "t": T, "frame": ONE},
        {"inertia": "three", "omega": "three", "t": TIMES, "frame": "None"},
    ),
    # impact
    Call(
        impact.Impact,
        {"duration": 0.1, "speed": 1.0, "until": 0.2},
        {"duration": NOT_NEGATIVE, "speed": ANY, "until": NOT_NEGATIVE},
    ),
    Call(
        impact.impact,
        {
            "masses": [0.5, 0.5],
            "stiffness": SPRING,
            "damping": 0.001 * SPRING,
            "heights": [0.0, 1.0],
            "speed": 0.3,
            "strength": 0.1,
            "reach": 0.1,
            "gravity": 0.0,
        },
        {
            "masses": "two",
            "heights": "two",
            "speed": POSITIVE,
            "strength": POSITIVE,
            "reach": POSITIVE,
            "gravity": NOT_NEGATIVE,
        },
        {"masses": "masses|heights"},
        beyond="times as fast as|does not leave",
    ),
    # oscillation
    Call(
        oscillation.damped,
        {"mass": 2.0, "damping": 1.0, "stiffness": 50.0, "x": 0.3, "v": -2.0, "t": T},
        {"mass": POSITIVE, "damping": NOT_NEGATIVE, "stiffness": POSITIVE, "x": ANY, "v": ANY, "t": TIMES},
    ),
    Call(
        oscillation.spun_pair_length,
        {"mass": 0.5, "stiffness": 400.0, "rest_length": 1.0, "omega": 12.0},
        {"mass": POSITIVE, "stiffness": POSITIVE, "rest_length": POSITIVE, "omega": ANY},
        beyond="flies apart",
    ),
    Call(
        oscillation.spun_pair,
        {"mass": 0.5, "stiffness": 400.0, "rest_length": 1.0, "momentum": 2.0},
        {"mass": POSITIVE, "stiffness": POSITIVE, "rest_length": POSITIVE, "momentum": ANY},
    ),
    Call(
        oscillation.implicit_euler_spin,
        {"omega": 10.0, "step": 0.002, "t": T},
        {"omega": ANY, "step": NOT_NEGATIVE, "t": PAIR_TIMES},
    ),
    # pendulum
    Call(
        pendulum.CornerCube,
        {"i1": 1.25, "i3": 0.5, "length": 0.9, "mgl": 8.5},
        {"i1": POSITIVE, "i3": POSITIVE, "length": POSITIVE, "mgl": POSITIVE},
    ),
    Call(
        pendulum.cube_on_vertex,
        {"mass": 1.0, "edge": 1.0, "gravity": 9.81},
        {"mass": POSITIVE, "edge": POSITIVE, "gravity": POSITIVE},
    ),
    Call(pendulum.small_period, {"inertia": 1.0, "mgl": 1.0}, {"inertia": POSITIVE, "mgl": POSITIVE}),
    Call(
        pendulum.period,
        {"inertia": 1.0, "mgl": 1.0, "amplitude": 1.0},
        {"inertia": POSITIVE, "mgl": POSITIVE, "amplitude": "-1; -0.5; 0; 2.5"},
    ),
    Call(
        pendulum.motion,
        {"inertia": 1.0, "mgl": 1.0, "theta": 1.0, "theta_dot": 0.5, "t": T},
        {"inertia": POSITIVE, "mgl": POSITIVE, "theta": "-1; -0.5; 0; 2.5", "theta_dot": ANY, "t": TIMES},
    ),
    # rolling
    Call(
        rolling.acceleration,
        {"angle": 0.3, "moment": 0.4, "gravity": 9.81},
        {"angle": "-1; -0.5; 0", "moment": NOT_NEGATIVE, "gravity": NOT_NEGATIVE},
    ),
    Call(rolling.needed_friction, {"angle": 0.3, "moment": 0.4}, {"angle": STEEP, "moment": NOT_NEGATIVE}),
    Call(
        rolling.resisted_acceleration,
        {"angle": 0.3, "moment": 0.4, "resistance": 0.01, "radius": 0.1, "gravity": 9.81},
        {
            "angle": "-1; -0.5; 0",
            "moment": NOT_NEGATIVE,
            "resistance": NOT_NEGATIVE,
            "radius": POSITIVE,
            "gravity": NOT_NEGATIVE,
        },
    ),
    Call(
        rolling.resisted_way,
        {"speed": 0.3, "moment": 0.4, "resistance": 0.01, "radius": 0.1, "gravity": 9.81},
        {
            "speed": NOT_NEGATIVE,
            "moment": NOT_NEGATIVE,
            "resistance": POSITIVE,
            "radius": POSITIVE,
            "gravity": POSITIVE,
        },
    ),
    Call(
        rolling.resisted_spin,
        {"spin": 4.0, "moment": 0.4, "resistance": 0.01, "radius": 0.1, "gravity": 9.81},
        {
            "spin": NOT_NEGATIVE,
            "moment": NOT_NEGATIVE,
            "resistance": POSITIVE,
            "radius": POSITIVE,
            "gravity": POSITIVE,
        },
    ),
    Call(
        rolling.after_skidding,
        {"speed": 1.0, "moment": 0.4, "friction": 0.3, "gravity": 9.81},
        {"speed": NOT_NEGATIVE, "moment": NOT_NEGATIVE, "friction": POSITIVE, "gravity": POSITIVE},
    ),
    Call(
        rolling.after_struck,
        {"velocity": 2 * X, "line": X, "moment": 0.4, "restitution": 0.9},
        {"velocity": "three", "moment": NOT_NEGATIVE, "restitution": "0"},
    ),
    Call(
        rolling.off_a_wall,
        {
            "velocity": np.array([1.0, 0.5, -0.2]),
            "omega": np.array([3.0, -7.0, 60.0]),
            "normal": -X,
            "radius": 0.03,
            "moment": 0.4,
            "friction": 0.2,
            "restitution": 0.8,
        },
        {
            "velocity": "three",
            "omega": "three",
            "radius": POSITIVE,
            "moment": NOT_NEGATIVE,
            "friction": NOT_NEGATIVE,
            "restitution": "0",
        },
    ),
    Call(rolling.turntable_rate, {"rate": 7.0, "moment": 0.4}, {"rate": ANY, "moment": NOT_NEGATIVE}),
    Call(
        rolling.disk_rate,
        {"angle": 0.3, "radius": 0.1, "across": 0.0025, "gravity": 9.81},
        {"radius": POSITIVE, "across": POSITIVE, "gravity": NOT_NEGATIVE},
    ),
    Call(
        rolling.jellett,
        {"angular_momentum": np.ones((2, 3)), "axis": np.stack([X, Z]), "radius": 0.1, "offset": 0.02},
        {
            "angular_momentum": "three; one axis more; one row fewer",
            "axis": "one axis more; one row fewer",
            "radius": POSITIVE,
            "offset": NOT_NEGATIVE,
        },
    ),
    Call(
        rolling.egg_rise,
        {
            "start": 1.5,
            "end": 0.2,
            "semi_axes": (0.03, 0.02),
            "jellett": 4e-5,
            "weight": 0.6,
            "friction": 0.1,
        },
        {"end": "0", "semi_axes": "two", "jellett": POSITIVE, "weight": POSITIVE, "friction": POSITIVE},
    ),
    Call(
        rolling.rolling_ellipsoid,
        {
            "semi_axes": [0.2, 0.03, 0.02],
            "inertia": np.diag([2e-4, 2e-3, 2e-3]),
            "offset": np.array([0.0, 0.0, 0.001]),
            "frame": ONE,
            "omega": np.array([0.0, 0.1, 2.0]),
            "times": np.array([0.0, 0.01, 0.02]),
            "gravity": 9.81,
            "steps": 2,
        },
        {
            "semi_axes": "three",
            "offset": "three",
            "omega": "three",
            "times": "one row fewer",
            "gravity": NOT_NEGATIVE,
        },
        beyond="too few for so fast a motion",
    ),
    # rope
    Call(
        rope.Modes,
        {"frequencies": T, "shapes": np.eye(2)},
        {"frequencies": "two; three; (); []; one row more; one row fewer", "shapes": ROWS},
    ),
    Call(
        rope.Catenary,
        {"points": np.ones((3, 2)), "tensions": T},
        {"points": ROWS, "tensions": "two; three; (); []; one row more; one row fewer"},
    ),
    Call(
        rope.tensions,
        {"masses": [0.1, 0.2, 0.3], "gravity": 9.81},
        {"masses": f"two; three; {ROWS}", "gravity": NOT_NEGATIVE},
    ),
    Call(
        rope.stretched_lengths, {**CHAIN, "gravity": 9.81}, {**TAKES_CHAIN, "gravity": NOT_NEGATIVE}, OTHERS
    ),
    Call(rope.swing_modes, {**CHAIN, "gravity": 9.81}, {**TAKES_CHAIN, "gravity": NOT_NEGATIVE}, OTHERS),
    Call(
        rope.bounce_modes,
        {"masses": CHAIN["masses"], "stiffness": CHAIN["stiffness"]},
        {"masses": "three", "stiffness": f"{POSITIVE}; three"},
        OTHERS,
    ),
    Call(
        rope.catenary,
        {
            "span": 2.0,
            "rise": 0.5,
            "masses": [0.5, 0.5],
            "rest_length": [0.5, 0.5, 0.5],
            "stiffness": [1e3, 1e3, 1e3],
            "gravity": 9.81,
        },
        {
            "span": POSITIVE,
            "rise": ANY,
            "masses": "two",
            "rest_length": f"{NOT_NEGATIVE}; three",
            "stiffness": f"{POSITIVE}; inf; three; inf inside",
            "gravity": POSITIVE,
        },
        OTHERS,
        beyond="goes slack|cannot reach",
    ),
    Call(
        rope.cable_stretch,
        {"load": 1.0, "mass": 1.0, "young": 1e9, "section": 1e-4, "length": 2.0, "gravity": 9.81},
        {
            "load": NOT_NEGATIVE,
            "mass": NOT_NEGATIVE,
            "young": POSITIVE,
            "section": POSITIVE,
            "length": POSITIVE,
            "gravity": NOT_NEGATIVE,
        },
    ),
    Call(
        rope.cable_bounce,
        {"load": 1.0, "mass": 1.0, "young": 1e9, "section": 1e-4, "length": 2.0},
        {"load": NOT_NEGATIVE, "mass": POSITIVE, "young": POSITIVE, "section": POSITIVE, "length": POSITIVE},
    ),
    # solid
    Call(
        solid.Rule,
        {"points": np.ones((2, 3)), "weights": T, "degree": 2},
        {"points": ROWS, "weights": "two; three; (); []; one row more; one row fewer"},
    ),
    Call(
        solid.ElasticSolid,
        {
            "mass": 1.0,
            "centre": X,
            "second": ONE,
            "frequencies": T,
            "stretch": X,
            "moved": np.ones((3, 2, 3)),
        },
        {
            "mass": POSITIVE,
            "centre": "three",
            "frequencies": "two; three; (); []; one row more; one row fewer",
            "stretch": "three",
        },
    ),
    Call(solid.isotropic, {"young": 1e9, "poisson": 0.3}, {"young": POSITIVE, "poisson": "-0.5; 0"}),
    Call(
        solid.orthotropic,
        {"young": [1.0, 1.1, 1.2], "poisson": [0.3, 0.2, 0.1], "shear": [0.3, 0.4, 0.5]},
        {"young": "three", "poisson": "three", "shear": "three"},
        beyond="no material has",
    ),
    Call(solid.box_rule, {"sides": [1.0, 2.0, 3.0], "degree": 2}, {"sides": "three"}),
    Call(
        solid.cone_rule, {"radius": 1.0, "height": 2.0, "degree": 2}, {"radius": POSITIVE, "height": POSITIVE}
    ),
    Call(
        solid.cylinder_rule,
        {"radius": 1.0, "height": 2.0, "degree": 2},
        {"radius": POSITIVE, "height": POSITIVE},
    ),
    Call(solid.ball_rule, {"radius": 1.0, "degree": 2}, {"radius": POSITIVE}),
    Call(
        solid.polyhedron_rule,
        {"points": TETRAHEDRON, "triangles": FACES, "degree": 2},
        {"points": "one row more"},
        called={"points": "points|triangles"},
    ),
    Call(
        solid.elastic_solid,
        {
            "rule": RULE,
            "density": 1000.0,
            "elasticity": solid.isotropic(1e9, 0.3),
            "axes": ONE,
            "marks": np.ones((2, 3)),
        },
        {"density": POSITIVE, "axes": "None", "marks": f"(); []; three; {ROWS}"},
    ),
    # top
    Call(top.HeavyTop, {"i1": 9.75, "i3": 1.5, "mgl": 88.29}, {"i1": POSITIVE, "i3": "2.5", "mgl": POSITIVE}),
    Call(
        top.TopState,
        {"theta": 0.4, "omega3": 45.0, "theta_dot": 0.1, "phi_dot": 0.1, "phi": 0.1, "psi": 0.1},
        {"theta": "0; 2.5"} | dict.fromkeys(("omega3", "theta_dot", "phi_dot", "phi", "psi"), ANY),
    ),
    Call(
        top.Constants,
        {"a": 1.0, "b": 1.0, "alpha": 1.0, "beta": 1.0},
        {"a": ANY, "b": ANY, "alpha": ANY, "beta": POSITIVE},
    ),
    Call(
        top.TopMotion,
        dict.fromkeys(("theta", "phi", "psi", "theta_dot", "phi_dot"), T)
        | {"attitude": np.stack([ONE, ONE]), "omega_world": np.ones((2, 3))},
        dict.fromkeys(("theta", "phi", "psi", "theta_dot", "phi_dot"), TIMES)
        | {"attitude": FRAMES, "omega_world": FEWER},
    ),
    Call(
        top.cone_top_inertia,
        {"mass": 12.0, "radius": 0.5, "height": 1.0, "gravity": 9.81},
        {"mass": POSITIVE, "radius": POSITIVE, "height": POSITIVE, "gravity": POSITIVE},
    ),
    Call(top.constants, HEAVY),
    Call(top.cubic, {"u": T, "of": top.constants(TOP, STATE)}, {"u": TIMES}),
    Call(top.effective_potential, {"theta": T, **HEAVY}, {"theta": f"2.5; {SHAPES}"}),
    Call(top.turning_points, HEAVY),
    Call(
        top.steady_precession,
        {"top": TOP, "theta": 0.4, "omega3": 45.0},
        {"theta": "0; 2.5", "omega3": ANY},
        beyond="no steady precession",
    ),
    Call(
        top.nutation_frequency,
        {"top": TOP, "theta": 0.4, "precession": 1.0},
        {"theta": "0; 2.5", "precession": "-1; -0.5; 2.5; 10**9"},
    ),
    Call(top.nutation_period, HEAVY),
    Call(top.sleeping_threshold, {"top": TOP}),
    Call(top.motion, {**HEAVY, "t": T}, {"t": TIMES}),
]


def public() -> Iterator[Callable[..., Any]]:
    """Yield all public functions and classes of theory, but for those that say that they check nothing."""
    for name in theory.__all__:
        module = vars(theory)[name]
        for own, found in vars(module).items():
            if (
                not own.startswith(("_", "unchecked_"))
                and getattr(found, "__module__", "") == module.__name__
            ):
                yield found


def test_every_public_function_and_class_has_a_call() -> None:
    named = {call.function for call in CALLS}
    assert [of for of in public() if of not in named] == []


@pytest.mark.parametrize("call", CALLS, ids=lambda call: f"{call.function.__module__[17:]}.{call.name}")
def test_wrong_arguments_are_refused(call: Call) -> None:
    assert list(inspect.signature(call.function).parameters) == list(call.right)
    call()
    assert list(complaints(call)) == []


# --- What takes other values to find ----------------------------------------------------------------

SKEW = np.eye(3) + np.outer(X, Y)
LONG = np.array([2.0, 0.0, 0.0])
UNPHYSICAL: dict[str, dict[str, list[Any]]] = {
    "contact.rest_height": {"weight": [-1e-9]},
    "contact.slope_acceleration": {"angle": [1.6, -0.1]},
    "contact.rebound": {"restitution": [1.1]},
    "dominoes.leaning": {"count": [10**12, 1001], "space": [0.05], "thickness": [0.05], "angle": [1.6]},
    "dominoes.impacts": {"count": [10**12, 1001, 1]},
    "dominoes.speed": {"count": [10**12, 1001, 1]},
    "frames.carry": {"frame": [np.stack([ONE, SKEW]), np.stack([ONE, -ONE]), np.stack([ONE, 2 * ONE])]},
    "free_body.growth_rate": {"inertia": [[1.0, 2.0, 9.0]]},
    "free_body.flip_interval": {"inertia": [[9.0, 2.0, 1.0]]},
    "free_body.motion": {"inertia": [[1.0, 1.0, 9.0]], "frame": [SKEW, -ONE, 2 * ONE, np.stack([ONE] * 2)]},
    "impact.impact": {
        "stiffness": [np.triu(SPRING), -SPRING, 0 * SPRING],
        "damping": [np.triu(SPRING), -SPRING],
        "heights": [[-1.0, 0.0]],
    },
    "oscillation.implicit_euler_spin": {"t": [[-1e-3]]},
    "pendulum.period": {"amplitude": [math.pi, -math.pi, 3.2]},
    "pendulum.motion": {"theta": [3.2, -3.2]},
    "rolling.after_struck": {"line": [LONG, 0 * X, X * (1 + 2e-6)], "velocity": [-X], "restitution": [1.1]},
    "rolling.off_a_wall": {"normal": [LONG, 0 * X, X * (1 + 2e-6)], "velocity": [-X], "restitution": [1.1]},
    "rolling.disk_rate": {"angle": [math.pi, 1.6]},
    "rolling.jellett": {"axis": [np.array([0.0, 0.0, 5.0]), np.stack([X, 5 * Z])]},
    "rolling.egg_rise": {"end": [1.55], "start": [0.1, 1.6]},
    "rolling.rolling_ellipsoid": {
        "inertia": [SKEW, np.diag([1.0, 1.0, 9.0]), -ONE],
        "frame": [SKEW, -ONE],
        "times": [[0.0, 0.01, 0.03], [0.0, -0.01], [0.0, 0.0]],
        "steps": [10**12, 10_001],
    },
    "solid.Rule": {"degree": [17, 10**12]},
    "solid.isotropic": {"poisson": [0.5, 0.7, -1.0, math.nextafter(0.5, 1)]},
    "solid.orthotropic": {"young": [[-1.0, 1.0, 1.0]]},
    "solid.box_rule": {"degree": [17, 10**12]},
    "solid.cone_rule": {"degree": [17, 10**12]},
    "solid.cylinder_rule": {"degree": [17, 10**12]},
    "solid.ball_rule": {"degree": [17, 10**12]},
    "solid.polyhedron_rule": {
        "triangles": [
            FACES[:, ::-1],
            FACES[:3],
            FACES + 1,
            FACES.astype(float),
            [*FACES[:3], FACES[3, ::-1]],
        ],
        "degree": [17, 10**12],
    },
    "solid.elastic_solid": {
        "elasticity": [-solid.isotropic(1e9, 0.3), np.arange(81.0).reshape((3,) * 4), np.zeros((3,) * 4)],
        "axes": [2 * ONE, SKEW],
        "rule": [RULE._replace(weights=-RULE.weights), RULE._replace(points=RULE.points[1:]), tuple(RULE)],
    },
    "top.HeavyTop": {"i1": [0.7], "i3": [20.0]},
    "top.TopState": {"theta": [-0.1, 3.2]},
    "top.effective_potential": {"theta": [[0.0], [3.2]]},
    "top.nutation_frequency": {"theta": [-0.4, 3.2]},
    "top.steady_precession": {"theta": [-0.4, 3.2]},
}


def called(call: Call) -> str:
    return f"{call.function.__module__[17:]}.{call.name}"


@pytest.mark.parametrize("call", [call for call in CALLS if called(call) in UNPHYSICAL], ids=called)
def test_what_no_body_has_is_refused(call: Call) -> None:
    """Vectors of another length, impossible moments, surfaces that are open, sizes beyond memory."""
    for argument, wrong in UNPHYSICAL[called(call)].items():
        for value in wrong:
            with pytest.raises((TypeError, ValueError), match=argument):
                call(**{argument: value})


def test_calls_that_are_not_checked_here_are_misspelt() -> None:
    assert set(UNPHYSICAL) <= {called(call) for call in CALLS}


@pytest.mark.parametrize("call", CALLS, ids=called)
def test_misspelt_missing_and_surplus_arguments(call: Call) -> None:
    *_, last = call.right
    with pytest.raises(TypeError, match=f"{call.name} has no argument '{last}s'; did you mean '{last}'"):
        call(**{f"{last}s": 1.0})
    with pytest.raises(TypeError, match=f"{call.name}: missing a required argument"):
        call.function()
    with pytest.raises(TypeError, match=f"{call.name}: too many positional arguments"):
        call.function(*call.right.values(), 1.0)


def test_a_named_tuple_is_checked_however_it_is_made() -> None:
    with pytest.raises(ValueError, match="degree is 17"):
        RULE._replace(degree=17)
    with pytest.raises(ValueError, match="degree is 17"):
        solid.Rule._make([RULE.points, RULE.weights, 17])
    assert copy.deepcopy(RULE).points.tobytes() == RULE.points.tobytes()


def test_checks_do_not_hide_signatures() -> None:
    """help() and editors show them."""
    for found in public():
        assert str(inspect.signature(found)) != "(*given: 'Any', **named: 'Any') -> 'Any'"
        assert found.__doc__
