"""Sliders of scenes: where they start, how far they go, and what they change."""

import math

import pytest

from springgym.scenes import load, names
from springgym.scenes.strict_yaml import YamlError, changed, parse_yaml
from springgym.view.knobs import knobs
from tests.params import slow_but

pytest.importorskip("viser")


FEW = ("top", "ball-rolls", "rope-swing", "cube-drop", "newtons-cradle", "flipping-box", "rattleback")


@pytest.mark.parametrize("scene", slow_but(names(), *FEW))
def test_sliders_start_at_what_the_file_says(scene):
    found = knobs(scene)
    assert found
    for knob in found:
        assert knob.low <= knob.start <= knob.high, knob
        assert knob.step > 0
        assert knob.number(knob.start) == knob.value
        load(scene, {knob.path: knob.value})  # the file takes it


def by_name(scene):
    return {knob.path[-1]: knob for knob in knobs(scene)}


def test_sliders_show_what_the_file_leaves_to_defaults():
    top = by_name("top")
    assert top["spin"].value == 49.8
    assert top["mass"].value == load("top").scene.body.mass
    assert top["stiffness"].value == load("top").scene.body.stiffness[0]
    assert "friction" not in top  # it stands on a pin
    assert by_name("sliding-block")["friction"].value == 0.3
    assert by_name("block-holds")["angle"].value == 0.4


def test_bodies_of_a_crowd_have_no_sliders_of_their_own():
    assert any(knob.body for knob in knobs("pile"))
    assert [knob.path for knob in knobs("pile-300")] == [
        ("contact", "friction"),
        ("contact", "restitution"),
        ("gravity",),
    ]


def test_a_slider_changes_the_scene():
    top = by_name("top")
    stiffer = load("top", {top["stiffness"].path: top["stiffness"].number(5.5)})
    assert stiffer.scene.body.stiffness[0] == pytest.approx(10**5.5)
    heavier = load("top", {top["mass"].path: 20.0})
    assert heavier.scene.body.mass == pytest.approx(20.0)
    spun = load("top", {top["spin"].path: 10.0})
    assert abs(spun.scene.velocities).max() < 0.3 * abs(load("top").scene.velocities).max()
    rough = load("block-slides", {("contact", "friction"): 0.9})
    assert rough.scene.contact.friction == 0.9
    steep = load("block-holds", {("surfaces", "0", "angle"): 0.6, ("start", "rotation"): [0, -0.6, 0]})
    assert steep.scene.surfaces[0].normal[2] == pytest.approx(math.cos(0.6))


def test_a_change_that_the_scene_does_not_take_is_an_error():
    with pytest.raises(YamlError, match=r"a change.*unknown key 'sipn'"):
        load("top", {("start", "sipn"): 3.0})
    with pytest.raises(YamlError, match="a change"):
        load("top", {("start", "spin"): "fast"})


def test_a_change_may_add_mappings_and_lists_of_them():
    plan = load("top", {("surfaces",): [{"kind": "floor", "z": -1.0}, {"kind": "incline", "angle": 0.1}]})
    assert len(plan.scene.surfaces) == 2
    with pytest.raises(YamlError, match="a change: unknown key 'x'"):
        load("top", {("surfaces",): [{"kind": "floor", "x": -1.0}]})
    with pytest.raises(YamlError, match=r"a change: unknown kind of surface \[\]"):
        load("top", {("surfaces",): [{"kind": []}]})
    given = {"spin": 3.0}
    twice = {("start",): given, ("start", "spin"): 5.0}
    tree = parse_yaml("start: {tilt: 1}", "a file")
    assert changed(tree, twice).value == {"start": {"spin": 5.0}}
    assert given == {"spin": 3.0}


@pytest.mark.parametrize(
    "change", [{(): 1}, {"a": 1}, {3: 1}, {(3,): 1}, {("a", 0): 1}, {("a",): {0: 1}}, {("a",): [{None: 1}]}]
)
def test_a_path_of_a_change_is_keys(change):
    with pytest.raises(YamlError, match="a path must be a tuple of at least one key, and every key"):
        changed(parse_yaml("a: {b: 1}", "a file"), change)


def test_changed_leaves_the_document_alone():
    tree = parse_yaml("a: {b: 1}\nc: [1, {d: 2}]\ne: 3", "a file")
    new = changed(tree, {("a", "b"): 5, ("c", "1", "d"): 6, ("f", "g"): 7})
    assert new.value == {"a": {"b": 5}, "c": [1, {"d": 6}], "e": 3, "f": {"g": 7}}
    assert tree.value == {"a": {"b": 1}, "c": [1, {"d": 2}], "e": 3}
    assert new.where["a", "b"] == new.where["f", "g"] == new.where["f",] == "a change"
    assert new.where["e",] == tree.where["e",]
    with pytest.raises(YamlError, match=r"no e\.x in a file"):
        changed(tree, {("e", "x"): 1})
    with pytest.raises(YamlError, match=r"no c\.7"):
        changed(tree, {("c", "7"): 1})
