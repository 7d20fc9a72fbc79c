"""The order of pages, and links between code and reference; the pages themselves stay plain Markdown."""

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

DOCS = Path(__file__).parent.parent
MAIN = ("tutorial", "gallery/index", "how_to/index", "theory", "api/index", "plots", "catalogue", "reference")
MORE = ("questions", "many_machines", "how_we_know", "campaigns", "corrections", "glossary", "architecture")
ALONE = ("index", *(page for page in (*MAIN, *MORE) if "/" not in page and page != "architecture"))
"""Pages without others below them, which need no column of contents at the left."""

OUTSIDE = ("CHANGELOG", "CONTRIBUTING", "CODE_OF_CONDUCT", "SECURITY")
"""Pages beside the folder of the documentation, which are copied into that of the public names."""


def listed(page: str) -> list[str]:
    """Return the pages below a page, in order."""
    if page == "index":
        own = [name for name in (*MAIN, *MORE) if name == "api/index" or (DOCS / f"{name}.md").exists()]
        return own + [f"api/{name}" for name in OUTSIDE]
    if page == "architecture":
        return sorted(f"decisions/{file.stem}" for file in (DOCS / "decisions").glob("*.md"))
    if page.endswith("/index") and (DOCS / f"{page}.md").exists():
        folder = page.removesuffix("/index")
        linked = re.findall(r"\]\((\w+)\.md", (DOCS / f"{page}.md").read_text(encoding="utf-8"))
        return [f"{folder}/{name}" for name in dict.fromkeys(linked)]
    return []


def copy_outside(app: Sphinx) -> None:
    """Copy pages beside the folder, with links as they are from where the copies stand."""
    for name in OUTSIDE:
        text = (DOCS.parent / f"{name}.md").read_text(encoding="utf-8")
        (DOCS / "api" / f"{name}.md").write_text(re.sub(r"\]\(docs/", "](../", text), encoding="utf-8")


def add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """Give a page the list of those below it, which the navigation shows, and lead its links to copies of pages."""
    source[0] = re.sub(rf"\]\([./]*({'|'.join(OUTSIDE)})\.md", r"](/api/\1.md", source[0])
    source[0] = re.sub(r"\]\([./]*README\.md[^)]*\)", "](/index.md)", source[0])
    if names := listed(page):
        entries = "\n".join(f"/{name}" for name in names)
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n\n{entries}\n```\n"


def link_names(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Link names such as ``il.simulate`` in a text to their page of the reference."""
    for literal in list(doctree.findall(nodes.literal)):
        found = re.match(r"il\.(plot\.\w+|\w+)", literal.astext())
        if found and not isinstance(literal.parent, nodes.reference) and f"api/{found[1]}" != page:
            target = f"api/impactlab.{found[1]}"
            if target in app.env.all_docs:
                uri = app.builder.get_relative_uri(page, target)
                link = nodes.reference("", "", internal=True, refuri=uri)
                literal.replace_self(link)
                link += literal


def resolve(app: Sphinx, env: Any, node: addnodes.pending_xref, content: nodes.Element) -> nodes.Element | None:
    """Find names that docstrings write as users do, ``il.simulate``."""
    name = node.get("reftarget", "")
    target = f"api/impactlab.{name.removeprefix('il.').partition('(')[0]}"
    if name.startswith("il.") and target in env.all_docs:
        uri = app.builder.get_relative_uri(node["refdoc"], target)
        return nodes.reference("", "", content, internal=True, refuri=uri)
    return None


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", copy_outside, priority=600)  # after the folder is made
    app.connect("source-read", add_contents)
    app.connect("doctree-resolved", link_names)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
