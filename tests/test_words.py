"""Docstrings in plain English: a sentence names its nouns instead of pointing at them."""

import ast
import re
from pathlib import Path

import impactlab

PACKAGE = Path(impactlab.__file__).parent

POINTING = {"what", "that", "which", "those", "some", "such", "it", "them", "of"}
"""Words that stand for a noun, or hang one on another."""

MOST = 0.4
"""Share of these words in a sentence from which on a reader has to look for its nouns."""


def sentences(text):
    """Sentences of a docstring, and their parts at colons and semicolons."""
    for paragraph in re.split(r"\n\s*\n", text):
        yield from re.split(r"(?<=[.!?:;])\s+", " ".join(paragraph.split()))


def pointing(sentence):
    """Share of the pointing words in a sentence; 0 in fewer than three words."""
    words = re.findall(r"[^\W\d_]+", sentence.lower())
    return sum(word in POINTING for word in words) / len(words) if len(words) > 2 else 0.0


def docstrings(file):
    """Strings that stand as statements: docstrings of modules, classes and functions, and of attributes."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


def test_the_measure():
    assert pointing("Return those of some of the members.") > MOST
    assert pointing("Return the numbers of the chosen members.") < MOST
    assert list(sentences("One;\ntwo.\n\nThree")) == ["One;", "two.", "Three"]


def test_sentences_of_docstrings_name_their_nouns():
    found = [
        f"{file.relative_to(PACKAGE)}:{line}: {sentence}"
        for file in sorted(PACKAGE.rglob("*.py"))
        for line, text in docstrings(file)
        for sentence in sentences(text)
        if pointing(sentence) > MOST
    ]
    assert not found, "name the nouns:\n" + "\n".join(found)
