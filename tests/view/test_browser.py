"""The page in a real browser: Chromium without a window, drawing in software.

Needs Chromium and its driver (Debian: chromium, chromium-driver) and selenium.
"""

import io
import json
import os
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

import numpy as np
import pytest

pytest.importorskip("viser")
pytest.importorskip("selenium")

from PIL import Image
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from springgym import view
from springgym.rendering.look import BLUE, IVORY
from springgym.scenes.film import BALLS
from tests.test_docs import page_writer

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1000,760"),
)
PATIENCE = 120
"""Seconds: a busy machine draws slowly in software."""


@pytest.fixture
def browser(tmp_path):
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if not (chromium and driver):
        refuse = pytest.fail if os.environ.get("CI") else pytest.skip  # a night without a test is no success
        refuse("chromium and chromedriver are not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"--user-data-dir={tmp_path / 'profile'}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driven = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    driven.set_page_load_timeout(PATIENCE)
    driven.command_executor.client_config.timeout = PATIENCE
    yield driven
    driven.quit()


@pytest.fixture
def page() -> Iterator[view.Page]:
    """The page of the top, paused."""
    server = view._server(8460)
    page = view.Page(server, view.scenes("top"))
    page.play(False)
    thread = threading.Thread(target=page.run)
    thread.start()
    yield page
    page.stop()
    thread.join()
    view._end(server)


def opened(browser, page):
    browser.get(f"http://127.0.0.1:{page._server.get_port()}/")
    until(lambda: "spin [rad/s]" in text(browser))
    until(lambda: page._server.get_clients())
    return browser


def until(true):
    """Wait until something is true, of a page that may replace its parts meanwhile."""
    end = time.monotonic() + PATIENCE
    while True:
        with suppress(StaleElementReferenceException):
            if true():
                return
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.1)


def text(browser):
    return browser.find_element(By.TAG_NAME, "body").text


def texts(browser, kind):
    return " ".join(element.text for element in browser.find_elements(By.CSS_SELECTOR, kind))


def click(browser, kind, name):
    def clicked(driven):
        for element in driven.find_elements(By.CSS_SELECTOR, kind):
            if element.text.strip() == name:
                element.click()
                return True
        return False

    WebDriverWait(browser, PATIENCE, ignored_exceptions=[StaleElementReferenceException]).until(clicked)


def labelled(browser, label):
    """The inputs in the row of a label."""
    (found,) = (e for e in browser.find_elements(By.CSS_SELECTOR, "label") if e.text.strip() == label)
    row = found.find_element(By.XPATH, "./ancestor::*[.//input][1]")
    return row.find_elements(By.CSS_SELECTOR, "input:not([type=hidden])")


def picture(browser):
    """Return what the canvas shows, as numbers."""
    image = Image.open(io.BytesIO(browser.find_element(By.CSS_SELECTOR, "canvas").screenshot_as_png))
    return np.asarray(image.convert("RGB"), float)


def changes(browser, before):
    """Tell whether the canvas comes to show something else."""
    until(lambda: np.abs(picture(browser) - before).mean() > 0.2)


def drawn(browser, least=100):
    """Wait until the canvas shows something: a busy machine draws long after the panel is there."""
    until(lambda: browser.find_elements(By.CSS_SELECTOR, "canvas"))
    until(lambda: np.ptp(picture(browser), axis=(0, 1)).min() > least)


def settled(browser):
    """Return what the canvas shows when nothing moves any more."""
    drawn(browser, 20)
    before = picture(browser)
    for _ in range(60):
        time.sleep(0.5)
        after = picture(browser)
        if np.abs(after - before).mean() < 0.01:
            return after
        before = after
    raise AssertionError("the picture does not come to rest")


def requested(browser):
    """Hosts that pages asked for; pages and data that the browser holds itself have none."""
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
    urls += [e["params"]["url"] for e in events if e["method"] == "Network.webSocketCreated"]
    return {urlsplit(url).hostname for url in urls if urlsplit(url).scheme in ("http", "https", "ws", "wss")}


def complaints(browser):
    return [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def test_page_plays_turns_and_changes(browser, page, tmp_path):
    opened(browser, page)
    drawn(browser)  # the body, on its ground
    still = settled(browser)

    # it is turned by dragging
    client = next(iter(page._server.get_clients().values()))
    eye = client.camera.position.copy()
    canvas = browser.find_element(By.CSS_SELECTOR, "canvas")
    hand = ActionChains(browser).move_to_element_with_offset(canvas, 100, -120)
    hand.click_and_hold().move_by_offset(120, -40).release().perform()
    until(lambda: np.linalg.norm(client.camera.position - eye) > 0.3)
    changes(browser, still)

    # it plays
    assert page.time == 0.0
    click(browser, "button", "Play")
    until(lambda: page.time > 0.1)
    click(browser, "button", "Pause")
    until(lambda: not page.playing)

    # a slider of the scene is moved by keys, as a mouse would
    spun = page.motion
    slider = browser.find_elements(By.CSS_SELECTOR, "[role=slider]")[1]
    assert slider.get_attribute("aria-valuenow") == "49.8"
    slider.send_keys(Keys.ARROW_LEFT * 20)
    until(lambda: page.motion is not spun and abs(page.motion.fastest - 39.8) < 2)
    number = labelled(browser, "tilt [rad]")[-1]
    number.send_keys(Keys.CONTROL, "a")
    number.send_keys("0.8", Keys.ENTER)
    until(lambda: page.motion.graphs["tilt [°]"]["tilt"].values[0] > 45)
    shown = f"{page.motion.graphs['tilt [°]']['tilt'].at(*page.motion.at(page.time)):.3g}°"
    until(lambda: f"tilt {shown}" in text(browser))

    # a number that makes no sense is told over an empty stage, on which nothing plays
    kept = page.motion
    full = settled(browser)
    page._ask("top", {("body", "mass"): -1.0})
    until(lambda: "positive" in texts(browser, ".told.wrong"))
    changes(browser, full)
    assert not browser.find_element(By.XPATH, "//button[normalize-space()='Play']").is_enabled()
    assert "spin [rad/s] " not in text(browser)
    assert page.motion is kept

    # back to the file
    click(browser, "button", "Reset")
    until(lambda: abs(page.motion.fastest - spun.fastest) < 1e-6)

    # springs by strain, forces and rotation are there at first; so is a key to them over the stage
    named = ("strain", "weight", "support", "ω, angular velocity", "L, angular momentum")
    until(lambda: all(n in texts(browser, ".over") for n in named))
    key = browser.find_element(By.CSS_SELECTOR, ".over")
    assert key.rect["x"] + key.rect["width"] < browser.find_element(By.CSS_SELECTOR, "canvas").rect["width"]
    before = settled(browser)
    click(browser, "[role=tab]", "Show")
    for tick in ("springs", "forces", "rotation", "rigid twin"):
        box = labelled(browser, tick)[0]
        browser.execute_script("arguments[0].click()", box)
    changes(browser, before)
    until(lambda: "angular momentum" not in text(browser))

    # another scene
    page._ask("rope-swing", {})
    until(lambda: "a rope with 70 kg" in text(browser))
    assert "end mass [kg]" not in text(browser)  # on the other tab

    # a scene of several bodies has sliders for each, under its name
    page._ask("side-by-side", {})
    until(lambda: "tops of one shape" in text(browser))
    click(browser, "[role=tab]", "Parameters")
    until(lambda: all(name in text(browser).split("\n") for name in ("steel", "beech", "nylon", "rubber")))
    assert text(browser).count("tilt [rad]") == 4
    assert requested(browser) == {"127.0.0.1"}
    assert not complaints(browser)


def test_on_a_phone(browser, page):
    """The panel is as broad as the page, and leaves the upper half to the body."""
    size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    opened(browser, page)
    drawn(browser)
    still = settled(browser)
    assert still.shape[1] == 390
    button = browser.find_element(By.XPATH, "//button[normalize-space()='Play']")
    sheet = button.find_element(By.XPATH, "./ancestor::*[contains(@style, 'max-height: 60%')][1]")
    assert sheet.rect["width"] == 390
    assert sheet.rect["y"] >= 0.49 * 844
    assert button.rect["width"] > 300
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    key = browser.find_element(By.CSS_SELECTOR, ".over").rect
    body = still[int(key["y"] + key["height"]) : int(sheet.rect["y"])]
    assert np.ptp(body, axis=(0, 1)).min() > 100
    button.click()
    until(lambda: page.time > 0)
    # another scene is seen there, too; and what goes wrong is told there
    page._ask("tippe-top", {})
    until(lambda: "tippe-top" in text(browser))
    client = next(iter(page._server.get_clients().values()))
    until(
        lambda: np.allclose(client.camera.position, page._stage.camera(page.motion, 390 / 844).eye, atol=1e-3)
    )
    page._ask("top", {("body", "mass"): -1.0})
    until(lambda: browser.find_elements(By.CSS_SELECTOR, ".told.wrong"))
    told = browser.find_element(By.CSS_SELECTOR, ".told.wrong").rect
    assert told["x"] >= 0
    assert told["x"] + told["width"] <= 390
    assert told["y"] >= 0
    assert told["y"] + told["height"] <= sheet.rect["y"]


def test_colors_are_those_of_the_films(browser, page):
    """Of meshes, balls and lines: some pixels have nearly the colour that is asked for."""
    opened(browser, page)

    def shows(color):
        return np.abs(picture(browser) - color).max(axis=2).min() < 30

    for name, colors in {"newtons-cradle": BALLS, "ball-rolls": (BLUE, IVORY)}.items():
        before = settled(browser)
        page._ask(name, {})
        until(lambda n=name: page.name == n)  # what is told meanwhile changes the picture, too
        changes(browser, before)
        for color in colors:
            until(partial(shows, color))


def test_a_class_needs_the_token(browser):
    server, url = view._served(0, "127.0.0.1")
    page = view.Page(server, view.scenes("top"))
    thread = threading.Thread(target=page.run)
    thread.start()
    try:
        browser.get(url[:-3])
        assert "The token is missing or wrong" in text(browser)
        browser.get(url)
        until(lambda: "spin [rad/s]" in text(browser))
        until(server.get_clients)
        browser.refresh()
        until(lambda: "spin [rad/s]" in text(browser))
        click(browser, "button", "Pause")
        until(lambda: not page.playing)
    finally:
        page.stop()
        thread.join()
        view._end(server)


def hostile(where: str) -> str:
    """Return a text of somebody else's file that runs code, if it is taken as Markdown or HTML.

    A plain ``<script>`` would not run anyway: browsers ignore those that are inserted into a page.
    """
    code = f"parent&#46;ran=&quot;{where}&quot;"
    ways = (
        f"<img src=x onerror='{code}'>",
        f"<script async src='data:text/javascript,{code}'></script>",
        f"<iframe srcdoc='<script>{code}</script>'></iframe>",
    )
    return " ".join(ways)


def test_no_code_of_a_scene_file_runs(browser, tmp_path):
    """Neither from its title, its bodies' names, its folder's name nor a message about it."""
    scene = tmp_path / hostile("folder").replace("/", "&#47;") / "scene.yaml"
    scene.parent.mkdir()
    bodies = {
        f"{name} {hostile('body')}": {
            "body": {"kind": "top"},
            "pinned": ["tip"],
            "start": {"spin": 40, "position": [3 * n, 0, 0]},
        }
        for n, name in enumerate("ab")
    }
    title = f"a top {hostile('title')}"
    scene.write_text(json.dumps({"title": title, "bodies": bodies, "duration": 0.1, "collisions": "none"}))
    server = view._server(8460)
    page = view.Page(server, view.scenes(str(scene)))
    page.play(False)
    thread = threading.Thread(target=page.run)
    thread.start()

    def ran():
        return browser.execute_script("return window.ran")

    try:
        browser.get(f"http://127.0.0.1:{server.get_port()}/")
        until(lambda: ran() or "a top <img" in text(browser))
        assert ran() is None
        for graph in page.motion.graphs:
            page._graphed.value = graph
            page._replot()
            time.sleep(0.5)
        page._say(title, wrong=True)
        until(lambda: ran() or "a top <img" in texts(browser, ".told.wrong"))
        time.sleep(2.0)  # for whatever the browser still loads
        assert ran() is None
    finally:
        page.stop()
        thread.join()
        view._end(server)
    view.save_page(page.motion, tmp_path / "saved.html")
    browser.get((tmp_path / "saved.html").as_uri())
    drawn(browser)
    assert ran() is None


def test_saved_page_plays_by_itself(browser, tmp_path):
    path = tmp_path / "top.html"
    view.save_page(view.simulated("top", {("start", "spin"): 30.0}), path)
    assert path.stat().st_size < 2e6
    browser.get(path.as_uri())
    drawn(browser)
    changes(browser, picture(browser))
    assert "L, angular momentum" in browser.find_element(By.CSS_SELECTOR, ".over").text
    assert requested(browser) == set()
    assert not complaints(browser)


def test_saved_viewer_plays_recordings_beside_it(browser, tmp_path):
    """What a site of static files embeds."""
    view.save_viewer(tmp_path / "view.html")
    view.save_page(view.simulated("bowl-ball", {}), tmp_path / "ball.viser")
    assert (tmp_path / "ball.viser").stat().st_size < 5e5
    serve = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), serve) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            browser.get(f"http://127.0.0.1:{server.server_port}/view.html?playbackPath=ball.viser")
            drawn(browser, 60)
            changes(browser, picture(browser))
            assert requested(browser) == {"127.0.0.1"}
        finally:
            server.shutdown()
            thread.join()


def test_viewer_of_the_site_plays_scenes_from_a_folder(browser, tmp_path):
    """Without a server, as ``docs/build.py`` says to open the site."""
    pytest.importorskip("imageio_ffmpeg")
    media = page_writer("media")
    media.viewer(tmp_path)
    view.save_page(view.simulated("bowl-ball", {}), tmp_path / "ball.viser")
    script = media.embedded(tmp_path / "ball.viser")
    (tmp_path / "bowl-ball.js").write_text(script, encoding="utf-8")
    (tmp_path / "ball.viser").unlink()
    browser.get(f"{(tmp_path / 'view.html').as_uri()}?bowl-ball")
    drawn(browser, 60)
    changes(browser, picture(browser))
    assert requested(browser) == set()
    assert not complaints(browser)
