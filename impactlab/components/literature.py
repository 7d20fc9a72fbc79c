"""Entries of BibTeX."""

from __future__ import annotations

import re

_BETWEEN = "\n\n"


def article(author: str, title: str, journal: str, volume: int, year: int, pages: str, doi: str = "") -> str:
    """Return an entry of an article, with authors as in ``Hertz, H.`` joined by ``and``; the title may be empty."""
    return entry("article", author, year, title=title, journal=journal, volume=volume, pages=pages, doi=doi)


def entry(kind: str, author: str, year: int, **fields: str | int) -> str:
    """Return an entry of some kind, such as "book", without the fields that are empty."""
    key = re.sub(r"\W", "", author.split(",")[0]).lower() + str(year)
    given = {"author": author, **{name: value for name, value in fields.items() if value}, "year": year}
    lines = [f"  {name} = {{{value}}}," for name, value in given.items()]
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])


def joined_entries(*found: str) -> str:
    """Return several entries as the citation of one class."""
    return _BETWEEN.join(found)


def parts(citation: str) -> list[str]:
    """Return the entries of a citation."""
    return citation.split(_BETWEEN) if citation else []


def in_one_line(found: list[str]) -> str:
    """Return entries of BibTeX as text for an attribute of a dataset."""
    return "; ".join(map(_short, found))


def _short(entry: str) -> str:
    fields = dict(re.findall(r"^\s*(\w+)\s*=\s*[{\"](.*)[}\"],?\s*$", entry, re.MULTILINE))
    if "version" in fields:
        return f"{fields['title']} {fields['version']}"
    place = " ".join(fields[name] for name in ("journal", "booktitle", "number", "volume") if name in fields)
    parts = [fields.get("author", "").replace(" and ", "; "), fields.get("title", ""), place]
    text = ", ".join(part for part in parts if part)
    return f"{text} ({fields['year']}) {fields.get('pages', '')}".strip() if "year" in fields else text or entry
