"""Entries of BibTeX."""

from __future__ import annotations

import re

import impactlab


def article(author: str, title: str, journal: str, volume: int, year: int, pages: str, doi: str = "") -> str:
    """Return an entry of BibTeX, with authors as in ``Hertz, H.`` joined by ``and``."""
    key = re.sub(r"\W", "", author.split(",")[0]).lower() + str(year)
    fields = {"author": author, "title": title, "journal": journal, "volume": volume, "pages": pages, "year": year}
    lines = [f"  {name} = {{{value}}}," for name, value in (fields | ({"doi": doi} if doi else {})).items()]
    return "\n".join([f"@article{{{key},", *lines, "}"])


def software() -> str:
    """Return the entry of impactlab."""
    version = impactlab.__version__
    return f"@software{{impactlab,\n  title = {{impactlab}},\n  version = {{{version}}},\n}}"


def in_one_line(found: list[str]) -> str:
    """Return entries of BibTeX as text for an attribute of a dataset."""
    return "; ".join(map(_short, found))


def _short(entry: str) -> str:
    fields = dict(re.findall(r"^\s*(\w+)\s*=\s*[{\"](.*)[}\"],?\s*$", entry, re.MULTILINE))
    if "version" in fields:
        return f"{fields['title']} {fields['version']}"
    place = " ".join(fields[name] for name in ("journal", "volume") if name in fields)
    parts = [fields.get("author", "").replace(" and ", "; "), fields.get("title", ""), place]
    text = ", ".join(part for part in parts if part)
    return f"{text} ({fields['year']}) {fields.get('pages', '')}".strip() if "year" in fields else text or entry
