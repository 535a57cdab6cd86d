import numpy as np
import pytest

from springgym.model.bodies.precession import heavy_top
from springgym.model.materials import Grain, Material
from springgym.model.surfaces import Bowl, Contact, HeightField, PaperContact, Pipe, Plane, scales, waves
from springgym.scenes import load, names
from springgym.scenes.strict_yaml import YamlError
from springgym.theory.contact import force
from springgym.theory.rope import catenary
from springgym.theory.top import steady_precession

ROPE = "title: a rope\nbody: {kind: rope}\nduration: 1\npinned: [top]\n"
BOX = "title: a box\nbody: {kind: box}\nduration: 1\n"
SOLID = "title: a box\nbody: {kind: solid_box, sides: [1, 1, 1], material: %s}\nduration: 1\n"
TWO = (
    "title: two\nduration: 1\nbodies:\n  a: {body: {kind: cube}}\n"
    "  b: {body: {kind: cube}, start: {position: [3, 0, 0]}}\n"
)
UNION = "title: a\nbody:\n  kind: union\n  parts:\n   - %s\nduration: 1"
MESH = "title: a ball\nbody: {%s}\nduration: 1"
CLAY = "{name: clay, young: 2e7, poisson: 0.4, density: 1900, loss: 0.2}"


@pytest.fixture
def read(tmp_path):
    def write(text):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return load(str(path))

    return write


def test_the_paper_s_scenes_are_there():
    wanted = (
        "rope-swing rope-hanging bungee cube-pendulum irregular-pendulum top elongated-top unbalanced-top "
        "sleeping-top gyroscope top-on-ice top-with-friction top-in-bowl cube-drop irregular-fall "
        "sliding-block block-holds block-slides flipping-box"
    )
    assert set(wanted.split()) <= set(names())


def test_what_a_small_file_means(read):
    plan = read(BOX)
    assert plan.name == "mine"
    assert plan.scene.gravity == (0.0, 0.0, -9.81)
    assert plan.scene.positions == pytest.approx(plan.scene.body.positions)
    assert (plan.interval, plan.integrator, plan.step, plan.trace) == (0.01, "verlet", None, None)
    assert read(BOX + "gravity: 0").scene.gravity is None
    assert read(BOX + "gravity: 1.62").scene.gravity == (0.0, 0.0, -1.62)
    assert read(BOX + "gravity: [1, 0, 0]").scene.gravity == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOX + "pined: [0]", "mine.yaml:4: unknown key 'pined'; did you mean 'pinned'?"),
        ("title: a box\nduration: 1", "the file lacks body"),
        ("title: a\nbody: box\nduration: 1", "mine.yaml:2: body must be a mapping with a kind"),
        ("title: a\nbody: {kind: bax}\nduration: 1", "mine.yaml:2: unknown kind 'bax'; did you mean 'box'?"),
        (BOX + "interval: 1e-99", "mine.yaml:4: interval: interval is 1e-99 s; it must be at least 1e-09 s"),
        (BOX + "step: 1e-300", "mine.yaml:4: step: step is 1e-300 s; it must be at least 1e-09 s"),
        (BOX + "gravity: .nan", "mine.yaml:4: gravity: expected a number of size at most 1e+30, got nan"),
        (BOX + "surfaces: false", "mine.yaml:4: surfaces: expected a list of surfaces, got False"),
        (
            "title: a\nbody:\n  kind: box\n  mass: -1\nduration: 1",
            "body: mass is -1.0; it must be a positive number",
        ),
        ("title: a\nbody: {kind: top, scaled: {40: 2}}\nduration: 1", "a particle that scaled names is 40"),
        (BOX.replace("duration: 1", "duration: 0"), "mine.yaml:3: duration: duration is 0 s"),
        (BOX + "integrator: hop", "mine.yaml:4: integrator: unknown integrator 'hop'; choose from: verlet"),
        (BOX + f"trace: {'x' * 1000}", "mine.yaml:4: trace: unknown part 'xxx"),
        (BOX + "gravity: -9.81", "mine.yaml:4: gravity: gravity is -9.81; it pulls down if it is positive"),
        (
            BOX + "start: {height: rest}\ngravity: 0\nsurfaces: [{kind: floor}]",
            "height: gravity does not press the body onto the plane",
        ),
        (BOX + "pinned: [tip]", "mine.yaml:4: pinned: unknown part 'tip'"),
        (BOX + "pinned: [8]", "mine.yaml:4: pinned: there is no particle 8; there are 0 to 7"),
        (BOX + "pinned: [0, 1, 0]", "mine.yaml:4: pinned: pinned names 0 twice; it must name each once"),
        (BOX + "pinned: [top, 0]", "mine.yaml:4: pinned: pinned names"),
        (BOX + "trace: top", "mine.yaml:4: trace: 'top' is 4 particles; trace takes one"),
        (BOX + "contact: {friction: 1}", "mine.yaml:4: contact: a single body has no contact without"),
        (BOX + "plot: pie", "mine.yaml:4: plot: expected one of top, pendulum"),
        (BOX + "checks:\n - energy\n - sleeep", "mine.yaml:6: unknown check 'sleeep'; did you mean 'sleep'?"),
        (BOX + "start: {hanging: true}", "mine.yaml:4: start: body 'box' is not pinned: it cannot hang"),
        (BOX + "start: {tilt: 30}", "mine.yaml:4: start: tilt [rad] is 30.0; it must be a number from -6.28"),
        (SOLID % "3", "mine.yaml:2: body.material: expected a mapping or text, got 3"),
        (SOLID % "cheese", "mine.yaml:2: body: material is 'cheese'; it must be one of steel"),
        (SOLID % CLAY.replace("1900", "-1"), "mine.yaml:2: body.material: density of 'clay' is -1.0"),
        (BOX + "view: {speed: 3}", "mine.yaml:4: view: speed is 3; it must be one of 0.015625, 0.03125"),
        (BOX + "start: {precession: slow}", "mine.yaml:4: start: body 'box' is not a heavy top"),
        (BOX + "start: {kick: {tip: [0, 0, 1]}}", "mine.yaml:4: start: kick names an unknown part 'tip'"),
        (BOX + "start: {kick: {9: [0, 0, 1]}}", "mine.yaml:4: start: kick names particle 9"),
        (BOX + "start: {end: [1, 0, 0]}", "mine.yaml:4: start: end needs a rope"),
        (ROPE + "start: {end: [0, 0, -1]}", "mine.yaml:5: start: end is straight below or above"),
        (ROPE + "gravity: 1e-300\nstart: {end: [1, 0, 0]}", "start: end needs a rope, and gravity straight"),
        (BOX + "surfaces: floor", "mine.yaml:4: surfaces: expected a list of surfaces"),
        (
            BOX + "surfaces: [{kind: flor}]",
            "mine.yaml:4: unknown kind of surface 'flor'; did you mean 'floor'?",
        ),
        (BOX + "surfaces: [{kind: incline}]", "mine.yaml:4: surfaces.0 lacks angle"),
        (BOX + "surfaces: [{kind: floor}]", "mine.yaml: particle 4 starts 0.5 m behind surface 0"),
        (BOX + "contact: {friction: -1}", "mine.yaml:4: contact: friction of the contact is -1.0"),
        (UNION % "{kind: box}", "mine.yaml:5: body.parts.0 lacks name"),
        (UNION % "{kind: box, name: a, length: 3}", "mine.yaml:5: unknown key 'length'"),
        (UNION % "{kind: box, name: a, at: 3}", "5: body.parts.0.at: expected a list of 3 values, got 3"),
        (UNION % "5", "mine.yaml:5: body.parts.0 must be a mapping with a kind"),
        (MESH % "kind: mesh, file: no.stl", "mine.yaml:2: body: mesh file "),
        (MESH % "kind: solid_mesh, file: no.stl, material: steel", "2: body: mesh file "),
    ],
)
def test_error_names_file_line_and_key(read, text, message):
    with pytest.raises(YamlError) as error:
        read(text)
    assert message in str(error.value)
    assert len(str(error.value)) < 400


OF_A_PAIR = "[{first: a, second: b, contact: {friction: 3}}]"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *(
            (
                ROPE + f"start:\n  end: [1, 0, 0]\n  {key}",
                f"mine.yaml:7: start.{key.split(':')[0]}: a rope held at",
            )
            for key in (
                "omega: [0, 1, 0]",
                "tilt: 1",
                "spin: 1",
                "hanging: true",
                "stretched: true",
                "height: 1",
            )
        ),
        (ROPE + "start:\n  end: [1, 0, 0]\n  tlt: 1", "mine.yaml:7: unknown key 'tlt'; did you mean 'tilt'?"),
        (
            BOX + "start: {height: 1, position: [0, 0, 5]}",
            "5 m along the normal of the plane, beside a height",
        ),
        (
            BOX + "start: {height: 1, position: [1, 0, 0]}\nsurfaces: [{kind: incline, angle: 0.3}]",
            "position is (1.0, 0.0, 0.0), ",
        ),
        *(
            (
                TWO + f"contact: {{friction: 1}}\ncollisions: {how}",
                "mine.yaml:6: contact: no bodies collide by it",
            )
            for how in ("none", "[]", "{friction: 2}", OF_A_PAIR)
        ),
        (
            TWO + "contact:\n  friction: 1\n  paper_damping: 1",
            "mine.yaml:8: contact.paper_damping: there are no surfaces",
        ),
        *(
            (BOX + f"collisions: {how}", "mine.yaml:4: collisions: a single body collides with no other")
            for how in ("all", "none", "{friction: 1}")
        ),
        (BOX + "checks:\n - energy\n - energy", "mine.yaml:6: check 'energy' is given twice"),
        (
            TWO.replace("cube}}", "cube}, checks: [sleep]}", 1) + "checks: [sleep]",
            "mine.yaml:4: bodies.a: checks names 'sleep' twice",
        ),
        (
            BOX + "surfaces:\n - {kind: floor, z: -2}\n - {kind: floor, z: -2}",
            "mine.yaml:6: surfaces.1: this surface is given twice",
        ),
        *((TWO + f"trace: {part}", f"trace is '{part}'; it must be body.part") for part in ("a", "a.")),
    ],
)
def test_keys_without_effect_are_refused(read, text, message):
    with pytest.raises(YamlError) as error:
        read(text)
    assert message in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        ROPE + "start: {end: [1, 0, 0], position: [0, 0, 2], velocity: [0, 0, 0], kick: {1: [0, 0, 1]}}",
        BOX + "start: {height: 1, position: [0, 2, 0]}",
        BOX + "start: {height: 1, position: [0.2, 0, 0.0619]}\nsurfaces: [{kind: incline, angle: 0.3}]",
        TWO + "contact: {friction: 1}",
        TWO + "contact: {friction: 1}\ncollisions: [{first: a, second: b}]",
        TWO + "contact: {friction: 1}\ncollisions: none\nsurfaces: [{kind: floor, z: -2}]",
        TWO + "trace: a.3",
    ],
)
def test_keys_with_effect_are_taken(read, text):
    read(text)


def test_a_folder_is_no_scene(tmp_path):
    with pytest.raises(ValueError, match="is a folder; give the name of a scene, or of a YAML file"):
        load(str(tmp_path))


def test_material_of_ones_own(read):
    assert read(SOLID % CLAY).scene.body.solid.material == Material("clay", 2e7, 0.4, 1900.0, 0.2)
    moduli = "young_r: 2e9, young_t: 1e9, shear_lr: 1e9, shear_lt: 1e9, shear_rt: 2e8"
    grain = f"{{{moduli}, poisson_lt: 0.4, poisson_rt: 0.5}}"
    fir = f"{{name: fir, young: 1e10, poisson: 0.4, density: 400, grain: {grain}}}"
    assert read(SOLID % fir).scene.body.solid.material.grain == Grain(2e9, 1e9, 1e9, 1e9, 2e8, 0.4, 0.5)


def test_unknown_scene():
    with pytest.raises(ValueError, match="there is no scene 'tops'; did you mean 'top'"):
        load("tops")
    with pytest.raises(YamlError, match=r"nowhere\.yaml: cannot read it"):
        load("nowhere.yaml")
    with pytest.raises(TypeError, match="scene is 3; it must be str or Path"):
        load(3)
    with pytest.raises(TypeError, match="changes is 3; it must be Mapping"):
        load("top", 3)


# --- Bodies -----------------------------------------------------------------------------------------


def test_body_given_particle_by_particle(read):
    body = read(
        """
title: a triangle
body:
  kind: net
  positions: [[0, 0, 0], [3, 0, 0], [0, 4, 0]]
  masses: [1, 2, 3]
  springs: [[0, 1], [1, 2], [2, 0]]
  stiffness: 10
  parts: {corner: [0]}
duration: 1
trace: corner
"""
    ).scene.body
    assert body.lengths.tolist() == [3, 5, 4]
    assert body.mass == 6


def test_mesh_relative_to_the_file(read, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(subdivisions=1).export(tmp_path / "ball.stl")
    text = "title: a ball\nbody: {kind: mesh, file: ball.stl, mass: 3, by: area}\nduration: 1"
    body = read(text).scene.body
    assert body.name == "ball"
    assert body.mass == pytest.approx(3.0)


def test_union_of_bodies(read):
    plan = read(
        """
title: an L
body:
  kind: union
  name: L
  parts:
    - {kind: box, name: foot, sides: [2, 1, 1], at: [1, 0, 0.5]}
    - {kind: box, name: back, sides: [1, 1, 1], at: [2.5, 0, 0.5]}
duration: 1
pinned: [back]
"""
    )
    assert plan.scene.body.name == "L"
    assert len(plan.scene.body.masses) == 12
    assert len(plan.scene.pinned) == 8


# --- Starts -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "root"), [("steady-top", 0), ("fast-top", 1), ("gyroscope", 0)])
def test_steady_precession_by_name(name, root):
    scene = load(name).scene
    rates = steady_precession(
        heavy_top(scene.body, scene.pinned, scene.gravity),
        *{"gyroscope": (1.5707963, 40)}.get(name, (0.35, 49.8)),
    )
    pin = scene.pinned[0]
    head = scene.body.markers[1]
    # ring particles in pairs: the axle's end itself has a kick
    ring = list(scene.body.parts["ring"])
    middle = scene.positions[ring].mean(axis=0) - scene.positions[pin]
    moving = scene.velocities[ring].mean(axis=0)
    assert head not in ring
    expected = np.cross((0, 0, rates[root]), middle)
    bend = 1e-4  # what the shape is bent by [m], which goes around with the spin
    assert moving == pytest.approx(expected, abs=50 * bend)


def test_kick_adds_to_the_velocity(read):
    plan = read(BOX + "start: {velocity: [1, 0, 0], kick: {top: [0, 0, 2], 7: [0, 3, 0]}}")
    assert plan.scene.velocities[0].tolist() == [1, 0, 2]
    assert plan.scene.velocities[7].tolist() == [1, 3, 0]
    assert plan.scene.velocities[5].tolist() == [1, 0, 0]


def test_height_above_a_slope_and_at_rest(read):
    text = BOX + "surfaces: [{kind: incline, angle: 0.3}]\nstart: {rotation: [0, -0.3, 0], height: %s}"
    slope = read(text % 0.4).scene
    assert slope.surfaces[0].height(slope.positions).min() == pytest.approx(0.4)
    rest = read(text % "rest").scene
    heights = np.sort(rest.surfaces[0].height(rest.positions))
    carried = force(heights, *scales(rest.contact, rest.body)).sum()
    # four particles carry the weight's part across the slope, bent by a strain of 1e-5 of their heights
    assert carried == pytest.approx(9.81 * np.cos(0.3), rel=1e-2)
    with pytest.raises(YamlError, match="height needs a plane"):
        read(BOX + "surfaces: [{kind: bowl, centre: [0, 0, 9], radius: 9}]\nstart: {height: 1}")


def test_rope_held_at_its_end():
    scene = load("bungee").scene
    body = scene.body
    expected = catenary(0.5, 0.0, body.masses[1:-1], body.lengths, body.stiffness)
    assert scene.positions[-1] == pytest.approx([0.5, 0, 0], abs=1e-9)
    assert scene.positions[:, [0, 2]] == pytest.approx(expected.points)
    assert scene.positions[:, 2].min() < -5


def test_surfaces_and_contact(read):
    plan = read(
        BOX
        + """
start: {height: 1}
surfaces: [{kind: floor, z: -1}, {kind: plane, point: [-9, 0, 0], normal: [2, 0, 0]}]
contact: {friction: 0.3, restitution: 0.5, reach: 0.03, paper_damping: 7}
"""
    )
    assert plan.scene.surfaces == (Plane((0, 0, -1)), Plane((-9, 0, 0), (1, 0, 0)))
    assert plan.scene.contact == Contact(0.3, 0.5, None, 0.03)
    assert plan.paper == PaperContact(0.3, 7.0, None, 0.03)
    assert load("bowl-ball").scene.surfaces == (Bowl((0, 0, 2), 2.0),)
    assert load("pipe-ball").scene.surfaces == (Pipe((0, 0, 2), (0, 1, 0), 2.0),)
    assert load("wavy-ground").scene.surfaces == (waves(0.1, 1, 2, 0.04),)
    uneven = read(BOX + "surfaces: [{kind: height_field, heights: [[-1, -2], [-1, -2.5]], spacing: 9}]")
    assert uneven.scene.surfaces == (HeightField([[-1, -2], [-1, -2.5]], 9.0),)
