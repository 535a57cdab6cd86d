"""Extend Sphinx for the site: draw formulas as pictures, show films instead of posters, describe each page.

Formulas are drawn as SVG when the site is built, by ziamath, in pure Python: no TeX is needed to build a
page, and no script, font or other host to read it. (MathML needs a mathematical font that many machines
lack, MathJax a script of megabytes.)
"""

from __future__ import annotations

import html
import json
import re
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import ziamath
from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

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

POSTER = re.compile(r"(?:^|/)posters/([\w-]+)\.webp$")
"""The picture that pages show on GitHub of a scene, or of an environment."""


LINKS = (nodes.reference, addnodes.pending_xref)


def show_films(app: Sphinx, doctree: nodes.document) -> None:
    """Put films where pages show posters. What has no film yet keeps its poster.

    A poster with a link becomes a film with that link. A poster of its own becomes a film with a caption;
    of a scene, theory beside measurement, its figure and the page that turns it are added.
    """
    static = "../" * app.env.docname.count("/") + "_static/"
    for paragraph in list(doctree.findall(nodes.paragraph)):
        links = list(paragraph.findall(lambda node: isinstance(node, LINKS)))
        for image in list(paragraph.findall(nodes.image)):
            name = POSTER.search(image["uri"])
            if name is None:
                continue
            filmed = (MEDIA / f"{name[1]}.mp4").exists()
            caption = image["alt"]
            if links:
                paragraph["classes"] = ["films"]
                image["alt"] = ""  # the caption beside it says the same
                image.parent.append(nodes.inline("", caption))
                if (MEDIA / f"{name[1]}-small.mp4").exists():
                    image.replace_self(nodes.raw("", film(f"{static}{name[1]}-small"), format="html"))
            elif filmed:
                checks = MEDIA / f"{name[1]}.json"
                shown = (
                    scene(name[1], static, caption) if checks.exists() else figure(static + name[1], caption)
                )
                paragraph.replace_self(nodes.raw("", shown, format="html"))


def film(path: str, attributes: str = 'preload="none" aria-hidden="true"') -> str:
    """Return a film as HTML; the script of the site plays it while it is in view."""
    return f'<video src="{path}.mp4" poster="{path}.jpg" loop muted playsinline {attributes}></video>'


def figure(path: str, caption: str) -> str:
    """Return a film with its caption as HTML."""
    shown = film(path, f'controls preload="metadata" aria-label="{html.escape(caption)}"')
    return f'<figure class="film">{shown}<figcaption>{html.escape(caption)}</figcaption></figure>\n'


def scene(name: str, static: str, title: str) -> str:
    """Return a scene as HTML: its film, theory beside measurement, the page that turns it, its figure."""
    path = static + name
    checks = json.loads((MEDIA / f"{name}.json").read_text(encoding="utf-8"))["checks"]
    command = f"<code>springgym view {html.escape(name)}</code>"
    turn = f'<a href="{static}view.html?{html.escape(name)}" target="_blank">Open in 3D</a>'
    told = f'<div class="measured">{table(checks)}<p>{turn}, or change it: {command}</p></div>'
    plot = f'<a href="{path}.png"><img src="{path}.png" alt="{html.escape(title)}" loading="lazy"></a>'
    row = f'<div class="scene">{figure(path, title)}{told}</div>'
    return f'{row}\n<figure class="plot">{plot}</figure>\n'


def table(checks: list[list[str]]) -> str:
    """Return the rows of `media.rows` as a table."""
    head, *rows = checks
    cells = "".join(f"<th>{html.escape(text)}</th>" for text in head)
    rows = [[text.replace(" %", "\N{NO-BREAK SPACE}%") for text in row] for row in rows]
    lines = [f'<table class="checks"><thead><tr>{cells}</tr></thead><tbody>']
    for row in rows:
        lines.append("<tr>" + "".join(f"<td>{html.escape(text)}</td>" for text in row) + "</tr>")
    return "\n".join([*lines, "</tbody></table>\n"])


# --- Numbers ------------------------------------------------------------------------------------------

UNIT = (
    r"(?:%|°|× C\+\+|(?:thousand|million)\b|(?:[munµkM]?(?:rad|mol|min|Hz|Pa|m|s|g|N|J|W)|GB|MB|kB|h)"
    r"(?![\w'’]|[.-]\w))"
)
BROKEN = re.compile(rf"(?<=\d) (?={UNIT})")
BEGINS_WITH_A_UNIT = re.compile(rf"^ (?={UNIT})")


def keep_units(app: Sphinx, doctree: nodes.document) -> None:
    """Put a space that does not break between each number and its unit."""
    for text in list(doctree.findall(nodes.Text)):
        parent = text.parent
        if isinstance(parent, (nodes.FixedTextElement, nodes.literal, nodes.raw, nodes.math)):
            continue
        place = parent.index(text)
        before = parent[place - 1] if place else None
        told = str(text)
        if isinstance(before, nodes.raw) and before.astext() == "<!--/n-->":  # of a measured number
            told = BEGINS_WITH_A_UNIT.sub("\N{NO-BREAK SPACE}", told)
        told = BROKEN.sub("\N{NO-BREAK SPACE}", told)
        if told != text:
            parent.replace(text, nodes.Text(told))


# --- Pages ------------------------------------------------------------------------------------------------

LONGEST = 160
"""Characters of a description, as search engines show it."""


def describe(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.Node | None) -> None:
    """Describe a page by its first paragraph, for search engines; give the menu's headings their level."""
    menu = context.get("furo_navigation_tree", "")
    context["furo_navigation_tree"] = menu.replace('role="heading"', 'role="heading" aria-level="2"')
    paragraphs = tree.findall(nodes.paragraph) if tree else ()
    texts = (" ".join(paragraph.astext().split()) for paragraph in paragraphs)
    first = next((text for text in texts if len(text) > 40), "")
    if len(first) > LONGEST:
        first = first[: LONGEST - 1].rsplit(" ", 1)[0] + "…"
    if first:
        context["metatags"] += f'<meta name="description" content="{html.escape(first)}" />'


# --- Docstrings ---------------------------------------------------------------------------------------

LINKED = re.compile(r"(?<![`:])`(springgym[\w.]*|[A-Z]\w*(?:\.\w+)*)`(?!`)")
"""Names in backticks that are links in the reference: full ones, and those of classes."""
REFERENCE = "api/"
"""Folder of the pages of modules."""


def process_docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Environments are described in Markdown, on pages of their own; |x| means an absolute value."""
    if any(line.endswith("## Description") for line in lines):
        lines[:] = ["An environment: see its page."]
    if lines and lines[0].startswith("Alias for field number"):  # a named tuple's, without words of its own
        lines.clear()
    lines[:] = [LINKED.sub(r":py:obj:`\1`", line).replace("|", r"\|") for line in lines]


def keep_first_line(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from reading "what it is: more of it" as a type and its description.

    It does so in docstrings of constants, attributes and properties. None of them begins with a type.
    """
    if what in ("data", "attribute", "property") and lines:
        lines[0] = f": {lines[0]}"


def put_last(app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """Leave constants out where a module's members are listed: the template lists them at the end."""
    if not app.env.docname.startswith(REFERENCE):  # while the template's lists are made, no page is read
        return None
    module = import_module(app.env.docname.removeprefix(REFERENCE))
    return True if name.isupper() and name in vars(module) else None


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer("svg", (inline_formula, None), (display_formula, None))
    app.connect("doctree-read", show_films, priority=100)  # before Sphinx collects the pictures
    app.connect("doctree-read", keep_units)
    app.connect("html-page-context", describe, priority=900)  # after the theme
    app.connect("autodoc-process-docstring", keep_first_line, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-skip-member", put_last)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
