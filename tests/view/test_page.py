"""The page without a browser: what its panel holds."""

import re
import threading
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from springgym import view
from springgym.rendering import Marks
from springgym.simulator import SimulationDivergedError

pytest.importorskip("viser")

from tests.view.test_origin_guard import CAMERA, connected, send, until, value

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


@pytest.mark.parametrize("what", ["title", "body", "folder", "summary", "reading", "message", "note"])
def test_no_text_of_a_file_is_taken_as_html(what, tmp_path):
    """Nor as Markdown, in which HTML would work: in all that viser is told to render as either."""
    bad = "<script async src='data:,a'></script><iframe srcdoc='a'></iframe><img src=x onerror=a>"
    scene = tmp_path / (bad.replace("/", "|") if what == "folder" else "a") / "tops.yaml"
    scene.parent.mkdir()
    text = SCENE.replace("two tops", f'"{bad}"') if what == "title" else SCENE
    scene.write_text(text.replace("left:", f'"{bad}":') if what == "body" else text)
    server = view._server(8470)
    try:
        page = view.Page(server, view.scenes(str(scene)))
        page._show(page.motion)
        if what in ("summary", "note"):
            page._show(replace(page.motion, **{what: bad}))
        if what == "reading":
            page._show(replace(page.motion, marks=[Marks(text=(bad,))] * len(page.motion.times)))
        if what == "message":
            page._say(bad, wrong=True)
        if what in ("title", "body", "folder"):
            view.save_page(page.motion, tmp_path / "page.html")
            assert bad not in (tmp_path / "page.html").read_text(encoding="utf-8")
        sent = [vars(each) for each in server._websock_server._broadcast_buffer.message_from_id.values()]
        rendered = [
            str(value)
            for message in sent
            for parts in (message, message.get("updates") or {}, vars(message.get("props") or object))
            for name, value in parts.items()
            if name in ("content", "_markdown", "markdown")
        ]
        assert len(rendered) > 5
        assert not [html for html in rendered if re.search("<(script|iframe|img)", html)]
    finally:
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
    left, right = apart(before)
    same, other = apart(after)
    assert (left == same).all()
    assert abs(right - other).max() > 0.1
    heavier = page._subject.make(page.name, {("bodies", "left", "body", "mass"): 20.0})
    assert not (apart(heavier)[0] == left).all()
    # what is chosen next has its own
    page._turn_to("top", before)
    assert page._folders == []
    assert {knob.body for knob in page._sliders} == {""}


def test_the_camera_steps_back_from_what_has_grown(page):
    eye = page._server.initial_camera.position
    page._make(page.name, {("bodies", "left", "start", "spin"): 49.0})
    assert (page._server.initial_camera.position == eye).all()
    page._make(
        page.name, {("bodies", "left", "body", "height"): 4.0, ("bodies", "left", "body", "radius"): 2.0}
    )
    camera = page._stage.camera(page.motion)
    np.testing.assert_array_equal(page._server.initial_camera.position, camera.eye)
    assert not (camera.eye == eye).all()


def camera_of(page, client):
    """The camera of the only client, which says where it is first."""
    send(client, CAMERA)
    until(page._server.get_clients)
    (seen,) = page._server.get_clients().values()
    return seen.camera


def test_the_camera_is_placed_anew_when_the_picture_changes_its_shape(page):
    """As the panel does that takes its part of it; otherwise it stays where who looks has put it."""
    with connected(page._server) as client, run(page):
        camera = camera_of(page, client)

        def placed(width):
            eye = page._stage.camera(page.motion, width / CAMERA["image_height"]).eye
            until(lambda: np.allclose(camera.position, eye))

        placed(CAMERA["image_width"])
        for width in (240, 600):
            send(client, {**CAMERA, "image_width": width})
            placed(width)
        send(client, {**CAMERA, "image_width": 600, "image_height": 301})
        until(lambda: camera.image_height == 301 and not page._due)
        np.testing.assert_array_equal(camera.position, CAMERA["position"])


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
    make = page._subject.make
    motion = page.motion

    def raising(name, changes):
        raise changes["error"]

    with run(page) as playing:
        page._subject = page._subject._replace(make=raising)
        for kind in (ValueError, KeyError, RuntimeError, MemoryError, AttributeError, RecursionError):
            page._ask(page.name, {"error": kind("it went wrong")})
            until(lambda: "it went wrong" in page._over.content)
            page._say("")
        page._ask(page.name, {"error": RuntimeError()})
        until(lambda: "⚠ RuntimeError" in page._over.content)
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
            until(lambda: "⚠ division by zero" in page._over.content)
        page.play(True)
        assert page._over.content == ""
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
        camera_of(page, client)
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


@contextmanager
def failing(page, error):
    """Make changes of the page's motion fail, ask for one, and yield the client that is shown the failure."""
    make = page._subject.make

    def fails(name, changes):
        if changes:
            raise error
        return make(name, changes)

    page._subject = page._subject._replace(make=fails)
    with connected(page._server) as client, run(page):
        camera_of(page, client)
        page._ask(page.name, {("gravity",): 9.0})
        until(lambda: not page._shown)
        yield client


def test_what_diverges_leaves_the_stage(page):
    """It is said over the stage, and the old motion is neither seen nor played under the new sliders."""
    motion = page.motion
    with failing(page, ValueError("it <diverged>")) as client:
        assert "class='told wrong'>⚠ it &lt;diverged&gt;<" in page._over.content
        assert not page._stage._world.visible
        assert not page._plot.visible
        assert not page.playing
        stood = page.time
        send(client, value(page._button, True), value(page._moment, 0.05))
        page.play(True)
        assert not page.playing
        page._ask(page.name, {("gravity",): 8.0})  # until this has been tried, what was sent has come
        until(lambda: page._begun is None)
        assert not page.playing
        assert page.time == stood
        page._ask(page.name, {})
        until(lambda: page._shown)
        assert page.motion is not motion
        assert page._stage._world.visible
        assert page._plot.visible
        assert page._over.content == ""
        page.play(True)
        until(lambda: page.time != stood)


def test_who_tears_a_body_apart_is_told_what_to_do(page):
    with failing(page, SimulationDivergedError("strain 0.6")):
        assert "make them stiffer, or the motion slower. In numbers: strain 0.6<" in page._over.content


def test_the_old_motion_stands_while_another_is_made(page):
    make = page._subject.make
    go = threading.Event()

    def waiting(name, changes):
        go.wait(60)
        return make(name, changes)

    page._subject = page._subject._replace(make=waiting)
    with run(page):
        until(lambda: page.time > 0)
        page._ask(page.name, {("gravity",): 5.0})
        until(lambda: "simulating" in page._over.content)
        stood = page.time
        motion = page.motion
        assert page.playing
        until(lambda: page._due == {})
        assert page.time == stood
        go.set()
        until(lambda: page.motion is not motion and page._over.content == "")
        until(lambda: page.time != stood)


def test_clock_readings_and_picture_agree_after_a_seek(page):
    """Even with who sought while it played: the clock of the frame before is still on its way to him."""
    with connected(page._server) as client, run(page):
        camera_of(page, client)
        drawn = []
        draw = page._stage.draw
        page._stage.draw = lambda time: drawn.append(time) or draw(time)
        for sought in (0.0234, 0.0711):
            page.play(True)
            until(lambda: page.playing and len(drawn) > 9)
            send(client, value(page._moment, sought))
            until(lambda: not page.playing)
            until(lambda s=sought: page._moment.value == round(s, 3))
            assert page.time == drawn[-1] == sought
            queued = page._server._websock_server._broadcast_buffer.message_from_id.values()
            (told,) = (
                of
                for of in queued
                if getattr(of, "uuid", "") == page._moment._impl.uuid
                and "value" in getattr(of, "updates", ())
            )
            assert told.updates["value"] == round(sought, 3)
            assert told.excluded_self_client is None
            heights = page.motion.graphs["height [m]"]["height"].values
            expected = np.interp(sought, page.motion.times, heights)
            assert f"height {round(expected, 5):.3g} m" in page._readings.content


def test_clock_agrees_with_the_picture_when_it_stops(page):
    with run(page):
        until(lambda: page.time > 0)
        page.play(False)
        until(lambda: not page._due)
        assert page._moment.value == round(page.time, 3)


def test_the_key_says_what_is_seen(page):
    assert "pinned, no floor" in page._key.content
    assert "strain" in page._key.content
    page._turn_to("top", view.simulated("top", {}))
    told = re.sub("<[^>]*>", " ", page._key.content)
    for name in ("trace", "weight", "support", "ω, angular velocity", "L, angular momentum"):
        assert name in told
    assert "rigid twin" not in told
    page._ticks["forces"].value = False
    page._ticks["rigid twin"].value = True
    page._ticked()
    assert "weight" not in page._key.content
    assert "rigid twin" in page._key.content
    assert not page._stage._nodes["/world/arrows/weight"].visible
    page._turn_to("block-holds", view.simulated("block-holds", {}))
    assert "no floor" not in page._key.content
    assert "contact force" in page._key.content
    assert page._stage._nodes["/world/contacts/forces"].visible


@pytest.mark.slow
def test_the_key_has_the_marks_of_an_environment(page):
    from springgym.view.episodes import find_agent, played

    motion = played(find_agent("noop", "SpringTumble-v0"), 0)
    page._show(motion)
    assert "target place, and the corner to point up" in page._key.content
