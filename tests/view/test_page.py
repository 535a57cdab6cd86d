"""The page without a browser: what its panel holds."""

import pytest

from springgym import view

pytest.importorskip("viser")

SCENE = """
title: two tops
bodies:
  left:
    body: {kind: top}
    pinned: [tip]
    start: {tilt: 0.3, spin: 50}
  right:
    body: {kind: top, mass: 6}
    pinned: [tip]
    start: {tilt: 0.3, spin: 40, position: [3, 0, 0]}
collisions: none
trace: right.crown
duration: 0.1
"""


@pytest.fixture
def page(tmp_path):
    scene = tmp_path / "tops.yaml"
    scene.write_text(SCENE)
    server = view._server(8470)
    yield view.Page(server, view.scenes(str(scene)))
    view._end(server)


def apart(motion):
    """The motion of each body, of 14 particles."""
    return [motion.positions[:, :14], motion.positions[:, 14:]]


def test_each_of_several_bodies_has_sliders_that_move_it_alone(page):
    sliders = {knob.path: (knob, slider) for knob, slider in page._sliders.items()}
    assert [folder.label for folder in page._folders] == ["left", "right"]
    knob, slider = sliders["bodies", "right", "start", "spin"]
    assert slider.value == knob.value == 40.0
    assert sliders["bodies", "right", "body", "mass"][0].value == 6.0
    assert ("gravity",) in sliders
    before = page.motion
    after = page._subject.make(page.name, {knob.path: 20.0})
    (left, right), (same, other) = apart(before), apart(after)
    assert (left == same).all()
    assert abs(right - other).max() > 0.1
    heavier = page._subject.make(page.name, {("bodies", "left", "body", "mass"): 20.0})
    assert not (apart(heavier)[0] == left).all()
    # what is chosen next has its own
    page._turn_to("top", before)
    assert page._folders == []
    assert {knob.body for knob in page._sliders} == {""}
