"""What the site needs of Sphinx beyond its extensions: formulas as MathML, scenes and films as directives.

Formulas are turned into MathML when the site is built. Browsers draw it themselves: no script, no font and
no other host is needed to read a page.
"""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

MEDIA = Path(__file__).parent / "_media"


# --- Formulas -----------------------------------------------------------------------------------------


FUNCTION = re.compile(r"\\(sin|cos|tan|det)\s*(?=\\(?!left|!|,)[a-z]|[a-zA-Z])")


def mathml(latex: str, display: str) -> str:
    """A formula; what follows the name of a function gets the thin space that TeX puts there."""
    return convert(FUNCTION.sub(r"\\\1\\,", latex), display=display)


def inline_formula(translator: Any, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def display_formula(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="formula">{mathml(node.astext(), "block")}</div>\n')
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
            f'<figure class="film"><video src="{self.url(name)}.mp4" controls loop muted playsinline '
            f'preload="metadata" aria-label="{html.escape(caption)}"></video>'
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
        measured = f'<div class="measured">{command}{table(scene["checks"])}</div>'
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
    app.add_html_math_renderer("mathml", (inline_formula, None), (display_formula, None))
    app.add_directive("film", Film)
    app.add_directive("scene", Scene)
    app.connect("autodoc-process-docstring", process_docstring)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
