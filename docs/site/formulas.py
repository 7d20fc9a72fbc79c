"""Formulas as MathML, which browsers typeset without scripts."""

import re
from html import escape
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)


def mathml(node: nodes.Element, display: str) -> str:
    """Return a formula as MathML; one that cannot be read is a warning, which ends the build."""
    text = node.astext()
    try:
        found: str = convert(text, display=display)
    except Exception as error:
        LOGGER.warning("formula %s: %r", text, error, location=node)
        return escape(text)
    braces = re.findall(r"(?<!\\)[{}]", text)
    if braces.count("{") != braces.count("}"):
        LOGGER.warning("formula with a brace that is not closed: %s", text, location=node)
    if "\\" in found.partition("<annotation")[0]:  # a command that is not known stays as it is
        LOGGER.warning("formula with an unknown command: %s", text, location=node)
    return found


def inline(self: Any, node: nodes.Element) -> None:
    self.body.append(mathml(node, "inline"))
    raise nodes.SkipNode


def block(self: Any, node: nodes.Element) -> None:
    """Write a formula with its number, by which others link to it."""
    anchor = f' id="{node["ids"][0]}"' if node["ids"] else ""
    number = f'<a class="number" href="#{node["ids"][0]}">({node["number"]})</a>' if node["number"] else ""
    self.body.append(f'<div class="formula"{anchor}>{mathml(node, "block")}{number}</div>')
    raise nodes.SkipNode


def check_rest(app: Sphinx, doctree: nodes.document) -> None:
    """Warn of formulas that stay as they are written, within code or since their dollars were not read."""
    for text in doctree.findall(nodes.Text):
        shown = isinstance(text.parent, nodes.literal_block | nodes.math | nodes.math_block)
        if not shown and re.search(r"\$[^$]*\\[a-z]|\\[a-z]+\{", text):
            LOGGER.warning("formula that is not typeset: %s", text, location=text.parent)


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.config.html_math_renderer = "mathml"
    app.connect("doctree-read", check_rest)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
