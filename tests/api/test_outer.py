"""Every argument of the outer modules' functions and classes, given what it could not be."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from numpy.random import default_rng

from springgym import Scene
from springgym.dynamics import methods as integrators
from springgym.dynamics import rigid, stability
from springgym.dynamics.contact.totals import PairReadings
from springgym.dynamics.measures import SIZE, view
from springgym.dynamics.methods.record import Integrator
from springgym.envs import starts
from springgym.envs.goals import Goals, GoalTolerance
from springgym.envs.observation import Entry, values
from springgym.envs.registration import find, nearest_id, spec_of
from springgym.model.bodies import cube, stretched_shapes, top
from springgym.model.collisions import shape
from springgym.model.surfaces import PaperContact, floor
from springgym.rendering import Arrow, Camera, Look, Marks, Renderer, Scenery, save_video, two_tone
from springgym.scenes import film, load
from springgym.scenes.checks import basis, check, fitting, of_all
from springgym.scenes.plan import Plan, View
from springgym.scenes.recording import Recording, contacts_of, record, rigid_twin
from tests.hostile import HOSTILE, Call, complaints

ANY = "; ".join(["-1", "-0.5", "0", "2.5", "10**9"])
"""Values that a number of any sign may have."""

POSITIVE = "2.5; 10**9"
NOT_NEGATIVE = f"0; {POSITIVE}"
COUNT = "10**9"
LOST = "nan inside; inf inside; -inf inside; 1e+40 inside"
"""Readings may be lost."""

READING = f"nan; inf; -inf; 1e40; {ANY}; {LOST}"

CUBE = cube()
SCENE = Scene(CUBE, positions=CUBE.positions + np.array([0, 0, 0.6]), surfaces=(floor(),))
PLAN: dict[str, Any] = {
    "name": "a",
    "title": "a cube",
    "scene": SCENE,
    "paper": PaperContact(),
    "stretched": True,
    "duration": 1.0,
    "interval": 0.01,
    "integrator": "rk4",
    "step": 1e-3,
    "trace": 2,
    "plot": "drop",
    "checks": ("energy",),
    "view": View(),
    "contacts": False,
    "parts": (),
}
FREE = Plan(**PLAN | {"scene": Scene(CUBE, gravity=None), "checks": ()})


def recorded() -> Recording:
    """Return a recording of a cube that does not move, without simulating it."""
    x = np.repeat(SCENE.positions[None], 5, axis=0)
    none = PairReadings(*np.zeros((len(PairReadings._fields), 5, 0)))
    rows = np.zeros((5, SIZE))
    return Recording(
        plan=Plan(**PLAN),
        simulator="",
        integrator=integrators.integrator("verlet"),
        step=1e-3,
        times=0.01 * np.arange(5),
        positions=x,
        velocities=0 * x,
        measures=view(rows),
        bodies=(view(rows),),
        pairs=none,
        complete=True,
        shadow=(math.nan, math.nan),
    )


RECORDING = recorded()
CAMERA = Camera((3.0, 0.0, 1.0), (0.0, 0.0, 0.0))
LOOK = Look(radii=[0.1, 0.1])
METHOD: Integrator = integrators.integrator("verlet")
VIBRATIONS = stability.vibrations(Scene(CUBE))
POINTS = np.ones((2, 3))
TIMES = np.linspace(0.0, 1.0, 20)
WAVE = np.sin(np.linspace(0.0, 20.0, 20))
TOLERANCES = (GoalTolerance("place", 2, 0.1), GoalTolerance("heading", 1, 0.1))

PICTURES = [
    Call(
        two_tone,
        {"count": 8, "blocks": 4, "colors": ((1, 2, 3), (4, 5, 6)), "odd": (1, 2, 3)},
        {"count": "0", "odd": "three"},
    ),
    Call(
        Arrow,
        {"origin": (0.0, 0.0, 1.0), "vector": (1.0, 0.0, 0.0), "color": (1, 2, 3), "radius": 0.1},
        {"origin": "three", "vector": "three", "color": "three", "radius": NOT_NEGATIVE},
    ),
    Call(
        Scenery,
        {
            "floor": 0.0,
            "planes": [((0, 0, 0), (0, 0, 1))],
            "surfaces": [floor()],
            "vertical": ((0, 0, 0), 1.0),
            "disks": [((0, 0, 0), 1.0, (1, 2, 3))],
        },
        {
            "floor": f"None; {ANY}",
            "planes": "(); []; one row more; one row fewer",
            "surfaces": "(); []",
            "vertical": "None",
            "disks": "(); []",
        },
    ),
    Call(
        Marks,
        {
            "disks": [((0, 0, 0), 1.0, (1, 2, 3))],
            "rings": [((0, 0, 0), 1.0)],
            "balls": [((0, 0, 0), 1.0)],
            "lines": [((0, 0, 0), (0, 0, 1))],
            "arrows": [Arrow((0, 0, 0), (0, 0, 1))],
            "text": ["a"],
            "key": [((1, 2, 3), "a")],
        },
        dict.fromkeys(["disks", "rings", "balls", "lines", "arrows", "key"], "(); []")
        | {"text": "(); []; [text]", "lines": "(); []; one row more; one row fewer"},
    ),
    Call(
        Camera,
        {"eye": (3.0, 0.0, 1.0), "target": (0.0, 0.0, 0.0), "fov": 0.5},
        {"eye": "three", "target": "three", "fov": "2.5"},
    ),
    Call(
        CAMERA.keeping,
        {"points": POINTS, "size": (64, 48), "margin": 0.03},
        {"points": f"{LOST}; one row more; one row fewer", "size": "two", "margin": "0"},
    ),
    Call(
        Camera.fitting,
        {"points": POINTS, "size": (64, 48), "azimuth": 0.1, "elevation": 0.1, "fov": 0.5, "margin": 0.1},
        {
            "points": f"three; one axis more; one row more; one row fewer; {LOST}",
            "azimuth": ANY,
            "elevation": ANY,
            "fov": "2.5",
            "size": "two",
            "margin": "0",
        },
    ),
    Call(CAMERA.moved, {"way": (0.0, 0.0, 0.1)}, {"way": "three"}),
    Call(
        CAMERA.project,
        {"points": POINTS, "size": (64, 48)},
        {"points": f"three; {LOST}; one axis more; one row more; one row fewer", "size": "two"},
    ),
    Call(CAMERA.rays, {"size": (64, 48)}),
    Call(CAMERA.pixels_per_radian, {"height": 480.0}, {"height": POSITIVE}),
    Call(
        Renderer,
        {
            "look": LOOK,
            "camera": CAMERA,
            "scenery": Scenery(),
            "size": (64, 48),
            "mode": "rgb_array",
            "fps": 50.0,
        },
        {"scenery": "None", "fps": POSITIVE},
    ),
    Call(
        Renderer(LOOK, CAMERA, size=(32, 32)).draw,
        {"positions": POINTS, "marks": Marks(), "strain": np.zeros(0)},
        {"positions": f"{LOST}; one row more", "marks": "None", "strain": "None; (); []"},
    ),
    Call(
        Renderer(LOOK, CAMERA, size=(32, 32)).follow,
        {"positions": POINTS},
        {"positions": f"{LOST}; one row more; one row fewer"},
    ),
]

SCENES = [
    Call(
        View,
        {"azimuth": 0.1, "elevation": 0.1, "speed": 1.0, "strain": False},
        {"azimuth": ANY, "elevation": ANY, "speed": "None", "strain": "True"},
    ),
    Call(
        Plan,
        PLAN,
        {
            "name": "text; empty",
            "title": "text; empty",
            "stretched": "True",
            "duration": POSITIVE,
            "interval": POSITIVE,
            "step": f"None; {POSITIVE}",
            "trace": "None; 0",
            "checks": "()",
            "parts": "()",
            "contacts": "True",
        },
        {"checks": "checks|scene", "parts": "parts"},
    ),
    Call(
        load,
        {"scene": "top", "changes": {}},
        {"changes": "None; {}"},
        {"scene": "scene|file", "changes": "change|changes"},
    ),
    Call(
        record,
        {"plan": Plan(**PLAN), "dynamics": "springs", "contacts": False, "progress": iter},
        {"contacts": "True", "progress": "function; class"},
        beyond="contact acts at the nodes of verlet's steps",
    ),
    Call(rigid_twin, {"recording": RECORDING}),
    Call(contacts_of, {"simulator": None}, {}),
    Call(check, {"recording": RECORDING}),
    Call(fitting, {"plan": FREE}),
    Call(of_all, {"scene": SCENE, "names": ["energy"]}, {"names": "(); []; [text]"}),
    Call(
        film.save_film,
        {"recording": RECORDING, "path": "a.txt", "speed": 1.0, "progress": iter},
        {"path": "", "speed": f"None; {POSITIVE}", "progress": "function; class"},
        {"path": "path|name"},
        beyond="cannot write 'a.txt'",
    ),
    Call(film.told, {"pace": 1.0}, {"pace": POSITIVE}),
    Call(film.visible_speed, {"fastest": 1.0, "fps": 50.0}, {"fastest": READING, "fps": "2.5"}),
    Call(film.turning, {"scene": SCENE, "bodies": RECORDING.bodies}),
    Call(film.camera, {"recording": RECORDING}),
    Call(film.way, {"recording": RECORDING}),
    Call(film.scenery, {"recording": RECORDING}),
    Call(
        film.poses,
        {"recording": RECORDING, "spacing": 1.0, "most": 3, "last": 2},
        {"spacing": POSITIVE, "most": COUNT, "last": "None; 0"},
    ),
    Call(film.surfaces, {"scene": SCENE}),
    Call(
        film.look,
        {"scene": SCENE, "trace": 1, "colors": {"cube": (1, 2, 3)}},
        {"trace": f"None; 0; {COUNT}", "colors": "None; {}"},
    ),
    Call(
        basis.applies,
        {"needs": fitting, "together": False, "contacts": False},
        {"needs": "function; class", "together": "True", "contacts": "True"},
        positional=("needs",),
    ),
    Call(
        basis.Check,
        {"quantity": "a", "theory": 1.0, "measured": 1.0, "tolerance": 0.1, "unit": "m", "doubt": 0.0},
        {
            "quantity": "text; empty",
            "unit": "text; empty",
            "measured": READING,
            "theory": f"nan; 1e40; {ANY}; nan inside; 1e+40 inside",
            "tolerance": f"nan; 1e40; {NOT_NEGATIVE}; nan inside; 1e+40 inside",
            "doubt": f"nan; inf; 1e40; {NOT_NEGATIVE}; nan inside; inf inside; 1e+40 inside",
        },
    ),
    Call(
        basis.within,
        {"share": 0.1, "quantity": "a", "theory": 1.0, "measured": 1.0, "unit": "m", "doubt": 0.0},
        {
            "quantity": "text; empty",
            "unit": "text; empty",
            "measured": READING,
            "share": NOT_NEGATIVE,
            "theory": f"nan; 1e40; {ANY}; nan inside; 1e+40 inside",
            "doubt": f"nan; inf; 1e40; {NOT_NEGATIVE}; nan inside; inf inside; 1e+40 inside",
        },
    ),
    Call(
        basis.two_figures,
        {"result": basis.within(0.1, "a", 1.0, 1.0, "m"), "difference": 0.1, "sign": "+"},
        {"difference": READING, "sign": "empty"},
    ),
    Call(basis.slack, {"recording": RECORDING, "rate": 1.0}, {"rate": READING}),
    Call(
        basis.spread,
        {"of": math.hypot, "arguments": 1.0, "by": 0.1},
        {"of": "class", "arguments": READING, "by": READING},
        positional=("of", "arguments"),
    ),
    Call(basis.gravity, {"recording": RECORDING}),
    Call(basis.turning_rate, {"recording": RECORDING}),
    Call(
        basis.crossings,
        {"times": TIMES, "values": WAVE, "rising": True},
        {"values": LOST, "rising": "None; True"},
        {"times": "times|values"},
    ),
    Call(basis.period, {"times": TIMES, "values": WAVE}, {"values": LOST}, {"times": "times|values"}),
    Call(basis.peaks, {"times": TIMES, "values": WAVE}, {"values": LOST}, {"times": "times|values"}),
]

METHODS = [
    Call(stability.highest_frequency, {"scene": SCENE}),
    Call(stability.highest_decay_rate, {"scene": SCENE}),
    Call(stability.largest_step, {"scene": SCENE, "integrator": METHOD}),
    Call(
        stability.is_unstable,
        {"step": 1.0, "limit": 1.0},
        {"step": ANY, "limit": f"inf; 1e40; inf inside; 1e+40 inside; {NOT_NEGATIVE}"},
    ),
    Call(stability.usual_step, {"scene": SCENE, "integrator": METHOD}),
    Call(stability.vibrations, {"scene": SCENE}),
    Call(stability.varied, {"of": VIBRATIONS, "factors": {"masses": (1.0, 2.0)}}, {"factors": "{}"}),
    Call(stability.damps_each_step, {"scene": SCENE, "integrator": METHOD}),
    Call(
        stability.cycles_harmless,
        {"of": VIBRATIONS, "step": 1e-4, "every": 2},
        {"step": POSITIVE, "every": COUNT},
    ),
    Call(
        stability.cycles_in,
        {"of": VIBRATIONS, "period": 0.01, "steps": 10, "exactly": True},
        {"period": POSITIVE, "steps": COUNT, "exactly": "True"},
    ),
    Call(
        stability.steps_in,
        {"period": 0.02, "step": 0.01},
        {"period": POSITIVE},
        {"period": "period", "step": "step|period"},
    ),
    Call(integrators.integrator, {"name": "verlet"}, {}, {"name": "name|integrator"}),
    Call(rigid.integrator, {"name": "verlet"}, {}, {"name": "name|integrator"}),
    Call(rigid.default, {"scene": SCENE}),
    Call(rigid.largest_step, {"scene": SCENE, "method": rigid.integrator("verlet")}),
    Call(rigid.usual_step, {"scene": SCENE, "method": rigid.integrator("verlet")}),
    Call(shape, {"body": CUBE}),
]

TOP = top(ring=6)
ENVIRONMENTS = [
    Call(starts.spawn_seeds, {"seed": 1, "copies": 2}, {"seed": "0; 10**9; 10**400", "copies": "0"}),
    Call(
        starts.uniform,
        {"rng": default_rng(0), "low": (0.0, 1.0), "high": (1.0, 2.0)},
        {"low": "two; as bools", "high": "two; as bools"},
        {"low": "low|high"},
    ),
    Call(starts.direction, {"rng": default_rng(0)}),
    Call(starts.any_rotation, {"rng": default_rng(0)}),
    Call(
        starts.tilted,
        {"azimuth": 0.1, "tilt": 0.2},
        {"azimuth": ANY, "tilt": ANY},
        {"azimuth": "azimuth|tilt"},
    ),
    Call(
        starts.headed,
        {"shapes": CUBE.positions, "headings": 0.2},
        {"shapes": "one axis more; one row more; one row fewer", "headings": f"(); []; two; three; {ANY}"},
    ),
    Call(
        starts.standing,
        {"shape": stretched_shapes(TOP, (0, 0, 1), 30.0), "tip": 0, "poses": np.ones((2, 5))},
        {"tip": "0", "poses": "one row more; one row fewer"},
    ),
    Call(
        starts.above_bowl,
        {"radius": 2.0, "away": 0.5, "height": 0.1},
        {"radius": POSITIVE, "away": "-1; -0.5; 0", "height": ANY},
    ),
    Call(starts.principal_axes, {"body": CUBE}),
    Call(Goals, {"tolerances": TOLERANCES}, {"tolerances": "(); []"}),
    Call(Goals(TOLERANCES).space, {"observation": spaces.Box(-1, 1, (2,))}),
    Call(
        Goals(TOLERANCES).compute_reward,
        {"achieved_goal": np.ones(3), "desired_goal": np.ones(3), "info": {}},
        {"achieved_goal": "three", "desired_goal": "three", "info": "; ".join(HOSTILE)},
    ),
    Call(
        Entry,
        {"name": "a", "size": 3, "unit": 1.0, "about": 0.0},
        {"name": "text; empty", "size": COUNT, "unit": POSITIVE, "about": ANY},
    ),
    Call(
        values,
        {"entries": (Entry("a", 2),), "observations": np.ones((4, 2))},
        {"entries": "(); []", "observations": f"{LOST}; one row more; one row fewer"},
    ),
    Call(find, {"env_id": "SpringTop-v0"}, {"env_id": "text; empty"}),
    Call(nearest_id, {"env_id": "SpringTop-v0"}, {"env_id": "text; empty"}),
    Call(spec_of, {"env_id": "SpringTop-v0"}, {}, {"env_id": "env_id|environment"}),
]

CALLS = [*PICTURES, *SCENES, *METHODS, *ENVIRONMENTS]


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.name)
def test_what_no_argument_can_be_is_refused_by_name(call: Call) -> None:
    found = list(complaints(call))
    assert not found, "\n".join(found)


def test_frames_and_their_rate_are_refused_by_name(tmp_path: Path) -> None:
    call = Call(
        save_video,
        {"frames": [np.zeros((16, 16, 3), np.uint8)] * 2, "path": tmp_path / "a.gif", "fps": 25.0},
        {"frames": "one row more; one row fewer", "fps": "2.5"},
        {"frames": "frames?", "path": "path|name"},
    )
    assert not list(complaints(call))


def test_pages_are_refused_by_name() -> None:
    view = pytest.importorskip("springgym.view")
    call = Call(
        view.save_page,
        {"motion": RECORDING, "path": "a.txt", "speed": 1.0},
        {"path": "text; empty", "speed": f"None; {POSITIVE}"},
        beyond="the name must end in .html or .viser",
    )
    assert not list(complaints(call))


def test_copies_for_stable_baselines3_are_refused_by_name() -> None:
    sb3 = pytest.importorskip("springgym.envs.sb3")
    call = Call(
        sb3.make_sb3,
        {"env_id": "Nothing-v0", "num_envs": 2, "seed": 0, "stagger": False, "env_kwargs": {}},
        {
            "env_id": "text; empty",
            "num_envs": COUNT,
            "seed": "None; 0; 10**9; 10**400",
            "stagger": "True",
            "env_kwargs": "None; {}",
        },
        beyond="Environment `.*` doesn't exist|Malformed environment ID",
    )
    assert not list(complaints(call))


def test_the_walker_notices_what_it_looks_for() -> None:
    def sloppy(size: float, count: int = 1) -> float:
        if isinstance(size, str):
            raise ValueError("it is text")
        return size / count

    found = list(complaints(Call(sloppy, {"size": 1.0}, {"size": "0; -1; text"})))
    name = sloppy.__qualname__
    assert f"{name}(size=nan): accepted" in found
    assert f"{name}(size=text): ValueError: it is text" in found
    assert f"{name}(size=text): not accepted" in found
    assert any(line.startswith(f"{name}(size=None): TypeError: unsupported operand") for line in found)
    assert not any("size=0)" in line or "size=-1)" in line for line in found)
