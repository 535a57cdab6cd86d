"""The page without a browser: what its panel holds."""

import threading
from contextlib import contextmanager

import pytest

from springgym import view

pytest.importorskip("viser")

from tests.view.test_door import CAMERA, connected, send, until, value

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


@contextmanager
def run(page):
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        yield thread
    finally:
        page.stop()
        thread.join()


def test_whatever_making_raises_the_page_lives_on(page, caplog):
    make, motion = page._subject.make, page.motion

    def raising(name, changes):
        raise changes["error"]

    with run(page) as playing:
        page._subject = page._subject._replace(make=raising)
        for kind in (ValueError, KeyError, RuntimeError, MemoryError, AttributeError, RecursionError):
            page._ask(page.name, {"error": kind("it went wrong")})
            until(lambda: "it went wrong" in page._summary.content)
            page._summary.content = ""
        page._ask(page.name, {"error": RuntimeError()})
        until(lambda: page._summary.content == "⚠ RuntimeError")
        assert page.motion is motion
        page._subject = page._subject._replace(make=make)
        page._ask(page.name, {("gravity",): 5.0})
        until(lambda: page.motion is not motion)
        assert playing.is_alive()
    # faults of the program have a traceback; what a user can mend has none
    assert len(caplog.records) == 6
    assert all(record.exc_info for record in caplog.records)


def test_whatever_drawing_raises_the_page_lives_on(page, monkeypatch):
    with run(page) as playing:
        with monkeypatch.context() as patched:
            patched.setattr(page._stage, "draw", lambda time: 1 / 0)
            until(lambda: not page.playing)
            assert page._summary.content == "⚠ division by zero"
        page.play(True)
        was = page.time
        until(lambda: page.time != was)
        assert playing.is_alive()


def test_only_what_is_offered_is_made(page):
    for name in ("/etc/passwd", "", None):
        with pytest.raises((ValueError, TypeError), match=r"scene is .*; it must be one of"):
            page._ask(name, {})
    assert page._wanted is None


def test_what_a_client_sends_is_done_once_a_frame(page):
    """However much it sends; and what it may not send changes nothing, and ends nothing."""
    made = []
    make = page._subject.make
    page._subject = page._subject._replace(
        make=lambda name, changes: made.append((name, dict(changes))) or make(name, changes)
    )
    page.play(False)
    knob, slider = next(iter(page._sliders.items()))
    with connected(page._server) as client, run(page) as playing:
        send(client, CAMERA)
        until(page._server.get_clients)
        for wrong in (float("nan"), "9", -1e30, None):
            send(client, value(page._moment, wrong), value(page._speed, wrong))
        until(lambda: not page._due and page.time == 0.0)
        for n in range(2000):
            send(client, value(slider, knob.low + (knob.high - knob.low) * n / 1999))
        until(lambda: made and made[-1][1].get(knob.path) == pytest.approx(knob.number(knob.high)))
        until(lambda: not page._due and page._server._thread_executor._work_queue.empty())
        assert len(made) < 500
        assert playing.is_alive()
        assert page._speed.value in page._speed.options
