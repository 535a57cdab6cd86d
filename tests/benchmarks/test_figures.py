"""Figures: names beside curves do not lie on each other, and are all within the picture."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.params import slow_but

pytest.importorskip("matplotlib")
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text

from benchmarks import figures
from benchmarks.figures import Bar, End, draw_bars, draw_curves, name_ends, plain

DOCS = Path(__file__).parents[2] / "docs"
REPORT = json.loads((DOCS / "figures" / "accuracy.json").read_text(encoding="utf-8"))


def boxes(figure):
    """Of the names beside curves, in pixels."""
    figure.draw_without_rendering()
    names = [text for axes in figure.axes for text in axes.texts if text.arrow_patch is not None]
    return names, [Text.get_window_extent(text) for text in names]


def check(figure):
    names, found = boxes(figure)
    assert names
    for n, box in enumerate(found):
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1 + 1
        assert box.y1 <= figure.bbox.y1 + 1
        for m, other in enumerate(found[:n]):
            overlap = min(box.y1, other.y1) - max(box.y0, other.y0)
            beside = box.x0 >= other.x1 or other.x0 >= box.x1
            assert beside or overlap < 0.25 * box.height, (names[n].get_text(), names[m].get_text())


@pytest.mark.parametrize("heights", [np.zeros(9), np.ones(9), np.linspace(0, 1, 9), [0.5] * 9, [1, 0, 1, 0]])
def test_names_do_not_lie_on_each_other(heights):
    figure = Figure(figsize=(7.6, 4.8))
    FigureCanvasAgg(figure)
    axes = plain(figure, 0.1, 0.12, 0.63, 0.78, xlim=(0, 1), ylim=(0, 1))
    name_ends(axes, [End(1.0, y, f"curve {n}", "k") for n, y in enumerate(heights)])
    check(figure)


@pytest.mark.parametrize("name", slow_but(REPORT, "cube-swing", "bounce", "crossover"))
def test_figures_of_the_repository(name, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    figures.draw_accuracy(name, REPORT[name], tmp_path / "figure.svg")
    check(drawn[0])


def test_curves_of_environments_can_be_read(tmp_path, monkeypatch):
    """A panel each, which holds all of its points; no text is smaller than the others'."""
    numbers = json.loads((DOCS / "numbers.json").read_text(encoding="utf-8"))
    rows = numbers["curves"]["rows"]
    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    draw_curves(rows, tmp_path / "figure.svg")
    (figure,) = drawn
    figure.draw_without_rendering()
    panels = figure.axes
    (names,) = figure.legends
    assert len(panels) == len({row["environment"] for row in rows})
    for axes in panels:
        left, right = axes.get_xlim()
        low, high = axes.get_ylim()
        points = np.concatenate([np.transpose(line.get_data()) for line in axes.get_lines()])
        assert np.all((points > (left, low)) & (points < (right, high)))
        assert [line.get_marker() for line in axes.get_lines()].count("*") == 1
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert {"rk4", "verlet", "default"} <= {text.get_text() for text in names.get_texts()}
    assert min(text.get_fontsize() for text in texts) >= figures.SMALL


LABEL = "interquartile mean of scores, % (dashes: the reference)"


@pytest.mark.parametrize("low", [0.0, -30.0])
def test_text_of_bars_is_within_the_picture(low, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    bars = [Bar("ppo", 97.0, 90.0, 99.0, "C1"), Bar("zero", 0.5 * low, low, 0.0, "0.6")]
    draw_bars({"after a while": bars, "later": bars[:1]}, LABEL, tmp_path / "figure.svg")
    (figure,) = drawn
    figure.draw_without_rendering()
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert {"ppo", "zero", "97 %", "later", LABEL} <= {text.get_text() for text in texts}
    for text in texts:
        box = text.get_window_extent()
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1, text
        assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1, text


def test_what_fails_is_cut_and_named():
    figure = Figure()
    FigureCanvasAgg(figure)
    figures._spin_down(figure, REPORT["spin-down"])
    names, _ = boxes(figure)
    assert "implicit midpoint (fails)" in [text.get_text() for text in names]
    for axes in figure.axes:
        assert axes.get_ylim() == (0, 1.06)
        for line in axes.get_lines():
            assert np.max(line.get_ydata()) <= 1.06


def test_peers_are_grey_and_a_method_has_one_colour():
    figure = Figure()
    FigureCanvasAgg(figure)
    figures._work_precision(figure, REPORT["cusp-top"])
    names, _ = boxes(figure)
    colors = {text.get_text(): text.get_color() for text in names}
    assert {color for name, color in colors.items() if name.startswith(figures.PEERS)} == {
        figures.readable(figures.PEER)
    }
    own = [color for name, color in colors.items() if not name.startswith(figures.PEERS)]
    assert len(own) == len(set(own)) > 6


@pytest.mark.parametrize("color", [*figures.COLORS.values(), figures.PEER, figures.INK])
def test_names_can_be_read_on_white_and_in_the_dark(color):
    """The contrast of WCAG 2: 4.5 on white, and nearly as much where the site turns figures about."""

    def luminance(rgb):
        rgb = np.asarray(rgb)
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        return linear @ (0.2126, 0.7152, 0.0722)

    name = np.array(figures.readable(color))
    assert 1.05 / (luminance(name) + 0.05) >= 4.5
    inverted = 0.92 - 0.84 * name  # invert(0.92), then hue-rotate(180deg), as docs/_static/site.css has it
    weights = np.array([0.213, 0.715, 0.072])
    turned = 2 * (weights @ inverted) - inverted
    ground = luminance(3 * [0.92 - 0.84])
    assert (luminance(np.clip(turned, 0, 1)) + 0.05) / (ground + 0.05) >= 4.0
    assert np.argsort(name, kind="stable").tolist() == np.argsort(to_rgb(color), kind="stable").tolist()


@pytest.mark.slow
def test_one_command_makes_figures_anew(tmp_path):
    command = [sys.executable, str(DOCS / "figures.py"), "speed", "--out", str(tmp_path)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    for name in ("speed.svg", "curves.svg"):
        assert (tmp_path / name).stat().st_size > 20_000
    command = [sys.executable, str(DOCS / "figures.py"), "sped"]
    wrong = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert wrong.returncode == 2
    assert "'sped' is none of accuracy, speed, scenes, environments, agent" in wrong.stderr
