"""Formulas as MathML, which browsers typeset without scripts; one that cannot be read ends the build."""

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.errors import SphinxError


class Unreadable(SphinxError):
    category = "Formula"


def mathml(node: nodes.Element, display: str) -> str:
    """Return a formula as MathML."""
    text = node.astext()
    try:
        found: str = convert(text, display=display)
    except Exception as error:
        raise Unreadable(f"{node.source}:{node.line}: {text}: {error!r}") from error
    if "\\" in found.partition("<annotation")[0]:  # a command that is not known stays as it is
        raise Unreadable(f"{node.source}:{node.line}: {text}: {found}")
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


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
