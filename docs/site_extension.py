"""What the site needs of Sphinx beyond its extensions: formulas as pictures, scenes and films as directives.

Formulas are drawn as SVG when the site is built, by ziamath, in pure Python: no TeX is needed to build a
page, and no script, font or other host to read it. (MathML needs a mathematical font that many machines
lack, MathJax a script of megabytes.)
"""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import ziamath
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

MEDIA = Path(__file__).parent / "_media"


# --- Formulas -----------------------------------------------------------------------------------------

SIZE = 100
"""Formulas are drawn at this size, and scaled to that of the text around them."""

ziamath.config.svg2 = False  # outlines in place: no names that two formulas of a page could share


def picture(latex: str, inline: bool) -> str:
    """A formula as SVG in the colour of the text, of its size, and on its line."""
    drawn = ziamath.Latex(latex, size=SIZE, color="currentColor", inline=inline)
    svg = drawn.svgxml()
    for side in ("width", "height"):
        svg.set(side, f"{float(svg.attrib[side]) / SIZE:.3f}em")
    svg.set("role", "img")
    svg.set("aria-label", latex)
    svg.set("style", f"vertical-align: {drawn.getyofst() / SIZE:.3f}em")
    return NUMBER.sub(lambda n: f"{float(n[0]):.4g}", ElementTree.tostring(svg, encoding="unicode"))


NUMBER = re.compile(r"(?<=[ \"])-?\d+\.\d+(?=[ \"])")


def inline_formula(translator: Any, node: nodes.math) -> None:
    translator.body.append(picture(node.astext(), inline=True))
    raise nodes.SkipNode


def display_formula(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="formula">{picture(node.astext(), inline=False)}</div>\n')
    raise nodes.SkipNode


# --- Films, figures and checks ------------------------------------------------------------------------


class Media(SphinxDirective):
    """What shows files that `media.py` has made."""

    required_arguments = 1
    final_argument_whitespace = False
    has_content = True

    def url(self, name: str) -> str:
        return "../" * self.env.docname.count("/") + "_static/" + name

    def film(self, name: str, caption: str) -> str:
        if not (MEDIA / f"{name}.mp4").exists():
            return ""  # a site built without films
        return (
            f'<figure class="film"><video src="{self.url(name)}.mp4" poster="{self.url(name)}.jpg" '
            f'controls loop muted playsinline preload="metadata" aria-label="{html.escape(caption)}"></video>'
            f"<figcaption>{html.escape(caption)}</figcaption></figure>\n"
        )


class Film(Media):
    """A film of an environment; the content is its caption."""

    def run(self) -> list[nodes.Node]:
        caption = " ".join(self.content)
        return [nodes.raw("", self.film(self.arguments[0], caption), format="html")]


class Scene(Media):
    """A shipped scene: its film, its figure, the command that makes them, and theory beside measurement."""

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        told = MEDIA / f"{name}.json"
        if not told.exists():
            return [nodes.literal_block("", f"springgym simulate {name} --check")]
        scene = json.loads(told.read_text(encoding="utf-8"))
        title = scene["title"][0].upper() + scene["title"][1:] + "."
        figure = (
            f'<figure class="plot"><a href="{self.url(name)}.png"><img src="{self.url(name)}.png" '
            f'alt="{html.escape(title)}" loading="lazy"></a></figure>\n'
        )
        command = f"<code>springgym simulate {html.escape(name)} --check</code>"
        page = f"{self.url('view')}.html?playbackPath={html.escape(name)}.viser"
        turn = f'<a href="{page}" target="_blank">Turn it with the mouse</a>'
        measured = f'<div class="measured">{command}{table(scene["checks"])}{turn}</div>'
        row = f'<div class="scene">{self.film(name, title)}{measured}</div>\n'
        return [nodes.raw("", row + figure, format="html")]


def table(checks: list[list[str]]) -> str:
    """The rows of `media.rows` as a table."""
    head, *rows = checks
    cells = "".join(f"<th>{html.escape(text)}</th>" for text in head)
    lines = [f'<table class="checks"><thead><tr>{cells}</tr></thead><tbody>']
    for row in rows:
        lines.append("<tr>" + "".join(f"<td>{html.escape(text)}</td>" for text in row) + "</tr>")
    return "\n".join([*lines, "</tbody></table>\n"])


# --- Docstrings ---------------------------------------------------------------------------------------

LINKED = re.compile(r"(?<![`:])`(springgym[\w.]*|[A-Z]\w*(?:\.\w+)*)`(?!`)")
"""Names in backticks that are links in the reference: full ones, and those of classes."""


def process_docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Environments are described in Markdown, on pages of their own; |x| means an absolute value."""
    if any(line.endswith("## Description") for line in lines):
        lines[:] = ["An environment: see its page."]
    if lines and lines[0].startswith("Alias for field number"):  # a named tuple's, without words of its own
        lines.clear()
    lines[:] = [LINKED.sub(r":py:obj:`\1`", line).replace("|", r"\|") for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer("svg", (inline_formula, None), (display_formula, None))
    app.add_directive("film", Film)
    app.add_directive("scene", Scene)
    app.connect("autodoc-process-docstring", process_docstring)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
