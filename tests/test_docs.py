"""The documentation: its code runs and prints what is shown, its links and commands exist."""

import ast
import inspect
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import impactlab as il
from impactlab.command_line.main import parser
from impactlab.errors import KINDS
from impactlab.results.schema import OF_STATES, STATISTICS

ROOT = Path(__file__).parent.parent
PAGES = sorted(page for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")] if page.parent.name != "api")
"""All pages but the copies that the site makes."""

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    return blocks_of(text_of(page), language)


def blocks_of(text: str, language: str) -> list[str]:
    return [block for kind, block in BLOCK.findall(text) if kind == language]


def script(page: Path) -> str:
    """The Python blocks of a page, each on the lines where it stands."""
    lines, inside = [], False
    for line in text_of(page).splitlines():
        inside = inside and line != "```"
        lines.append(line if inside else "")
        inside = inside or line == "```python"
    return "\n".join(lines) + "\n"


def python(*arguments: str, folder: Path) -> str:
    """Run the interpreter; every warning is an error. Return what it printed."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-X", "utf8", *arguments],
        cwd=folder, capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def readme_command(name: str) -> str:
    found = re.findall(rf"^<!-- command: {name} -->\n```sh\n(.*)\n```$", text_of(ROOT / "README.md"), re.MULTILINE)
    assert len(found) == 1
    return found[0]


QUICK = {"extending.md", "files.md", "index.md", "laws.md"}
"""Pages of questions that take a few seconds."""

LONG = {"campaigns.md", "plots.md", "tutorial.md"} | {
    page.name
    for page in PAGES
    if page.parent in (ROOT / "docs" / "gallery", ROOT / "docs" / "how_to") and page.name not in QUICK
}
"""Pages of many runs, whose functions have tests of their own."""

WITH_CODE = [
    pytest.param(page, id=page.name, marks=[pytest.mark.campaign] if page.name in LONG else [])
    for page in PAGES
    if blocks(page, "python")
]


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.name)
def test_python_blocks_name_what_is_there(page: Path) -> None:
    """Public names, and arguments of public functions and classes, of pages that are too long to be run each time."""
    for node in ast.walk(ast.parse(script(page), page.name)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "il":
            assert hasattr(il, node.attr), f"{page.name}:{node.lineno}: il.{node.attr}"
        if isinstance(node, ast.Call) and re.fullmatch(r"il\.\w+", ast.unparse(node.func)):
            taken = arguments_of(getattr(il, ast.unparse(node.func).removeprefix("il.")))
            for item in node.keywords:
                known = taken is None or item.arg is None or item.arg in taken
                assert known, f"{page.name}:{node.lineno}: {ast.unparse(node.func)}({item.arg}=…)"


def arguments_of(named: Any) -> set[str] | None:
    """Names of the arguments of a function or a component; None where any may be given."""
    if isinstance(named, type) and issubclass(named, il.Component):
        return set(named.field_names())
    parameters = inspect.signature(named).parameters
    any_name = any(item.kind is item.VAR_KEYWORD for item in parameters.values())
    return None if any_name else set(parameters)


@pytest.mark.full
@pytest.mark.parametrize("page", WITH_CODE)
def test_python_blocks_run_and_print_what_is_shown(page: Path, tmp_path: Path) -> None:
    (tmp_path / "page.py").write_text(script(page), encoding="utf-8")
    printed = python("page.py", folder=tmp_path)
    for shown in blocks(page, "text"):
        assert shown in printed, f"{page.name} shows\n{shown}\nbut its code prints\n{printed}"
    if page in GALLERY:
        assert (tmp_path / f"{page.stem}.png").stat().st_size < LARGEST_FIGURE


GALLERY = [page for page in PAGES if page.parent == ROOT / "docs" / "gallery" and page.name != "index.md"]
LARGEST_FIGURE = 120_000
"""Bytes of a figure of the gallery, so that the index loads at once."""

ROW = re.compile(r"^(.+): (-?[\d.e-]+) ± ([\d.e-]+)( .+)?, source (-?[\d.e-]+)$", re.MULTILINE)
"""A number of a page of the gallery: quantity, value, error, unit and the value of the source."""


def disagreements(text: str) -> list[str]:
    """Rows of a page whose value and source are more than three errors apart, with both numbers."""
    return [
        f"{name}: {value} ± {error}{unit} here, {source} by its source"
        for name, value, error, unit, source in ROW.findall(text)
        if not abs(float(value) - float(source)) <= 3.0 * float(error)
    ]


@pytest.mark.parametrize("page", GALLERY, ids=lambda page: page.stem)
def test_numbers_of_the_gallery_are_those_of_their_sources(page: Path) -> None:
    """The numbers that pages show; that they are those that their code prints is tested with the code."""
    shown = "".join(blocks(page, "text"))
    assert len(ROW.findall(shown)) >= 2
    assert disagreements(shown) == []
    assert f"](figures/{page.stem}.png)" in text_of(page).partition("```")[0]
    assert 20 <= sum(bool(line.strip()) for line in script(page).splitlines()) <= 60


def test_a_number_of_the_gallery_that_drifts_is_told_with_both() -> None:
    right = "closing velocity: 1.6957 ± 1e-4 m/s, source 1.695732938\nratio: -0.5 ± 0.01, source -0.52"
    assert disagreements(right) == []
    assert disagreements(right.replace("1.6957 ", "1.6961 ")) == [
        "closing velocity: 1.6961 ± 1e-4 m/s here, 1.695732938 by its source"
    ]


def test_the_gallery_lists_its_pages() -> None:
    index = text_of(ROOT / "docs" / "gallery" / "index.md")
    assert set(re.findall(r"\]\((\w+\.md)\)", index)) == {page.name for page in GALLERY}


def test_each_page_of_the_gallery_has_its_figure() -> None:
    """The page draws it, and the script of figures runs the page."""
    kept = sorted((ROOT / "docs" / "gallery" / "figures").iterdir())
    assert [file.stem for file in kept] == sorted(page.stem for page in GALLERY)
    assert [file.name for file in kept if file.stat().st_size > LARGEST_FIGURE] == []


@pytest.mark.full
def test_the_script_of_the_gallery_draws_a_page(tmp_path: Path) -> None:
    script = str(ROOT / "docs" / "gallery" / "make_figures.py")
    python(script, str(tmp_path / "figures"), "bouncing_ball", folder=tmp_path)
    assert [file.name for file in (tmp_path / "figures").iterdir()] == ["bouncing_ball.png"]


@pytest.mark.campaign
def test_figures_are_made_by_their_script(tmp_path: Path) -> None:
    folder = tmp_path / "figures"
    folder.mkdir()
    for script in ("make_figures.py", "catalogue.py"):
        python(str(ROOT / "docs" / "figures" / script), str(folder), folder=tmp_path)
    kept = [file for kind in ("*.png", "*.gif") for file in (ROOT / "docs" / "figures").glob(kind)]
    assert {file.name for file in folder.iterdir()} == {file.name for file in kept}


def test_all_figures_are_on_one_page(tmp_path: Path) -> None:
    (tmp_path / "more").mkdir()
    for name in ("figure_1.svg", "film.html"):
        (tmp_path / "more" / name).touch()
    script = ROOT / "docs" / "figures" / "page.py"
    python(str(script), "page.html", "more", folder=tmp_path)
    shown = re.findall(r'<(?:img|iframe) src="file://([^"]+)"', text_of(tmp_path / "page.html"))
    own = [file for kind in ("*.png", "*.gif") for file in script.parent.rglob(kind)]
    assert sorted(shown) == sorted(map(str, [*own, *(tmp_path / "more").iterdir()]))


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        prose = BLOCK.sub("", text_of(page))
        for target in re.findall(r"\]\(([^)\s]+)\)", prose):
            if not target.startswith("https://"):
                path, _, anchor = target.partition("#")
                file = page.parent / path if path else page
                assert file.exists(), f"{page.name} links to {target}"
                assert not anchor or anchor in anchors(file), f"{page.name} links to {target}"


def anchors(page: Path) -> set[str]:
    """Names of the headings of a page in links, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.*)$", BLOCK.sub("", text_of(page)), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_questions_are_all_listed() -> None:
    listed = text_of(ROOT / "docs" / "how_to" / "index.md")
    for page in (ROOT / "docs" / "how_to").glob("[!i]*.md"):
        for heading in re.findall(r"^## (.*)$", BLOCK.sub("", text_of(page)), re.MULTILINE):
            assert f"- [{heading}]({page.name}#" in listed, f"{page.name}: {heading}"


def test_site_without_its_packages_says_what_to_install(tmp_path: Path) -> None:
    command = [sys.executable, "-S", "-X", "utf8", str(ROOT / "docs" / "site" / "build.py")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "The site needs sphinx, myst_parser, numpydoc, sphinx_copybutton, pydata_sphinx_theme, latex2mathml: "
        'python -m pip install -e ".[docs]"'
    ]


def test_commands_that_are_shown_exist() -> None:
    shown = [line for page in PAGES for block in blocks(page, "sh") for line in block.splitlines()]
    commands = [line for line in shown if line.startswith("impactlab ")]
    assert commands
    for command in commands:
        parser().parse_args(shlex.split(command, comments=True)[1:])


@pytest.mark.full
def test_readme_command_of_the_study_runs_it(tmp_path: Path) -> None:
    make, install, run = readme_command("study").split(" && ")
    assert make == "python3 -m venv .venv"
    assert install.startswith(".venv/bin/python -m pip install")
    program, *arguments = shlex.split(run)
    assert program == ".venv/bin/impactlab"
    assert "realizations" in python("-m", "impactlab", *arguments, "--dry-run", folder=tmp_path)


def test_readme_command_of_the_tests_is_what_ci_runs() -> None:
    extraction = next(line for line in text_of(ROOT / ".ci" / "run").splitlines() if line.startswith("command="))
    lines = "\n".join([extraction, 'echo "$command"'])
    done = subprocess.run(["bash", "-c", lines], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == readme_command("test")
    assert done.stdout.strip().endswith(".venv/bin/python -m pytest -n auto --dist loadfile")


def test_reference_lists_the_public_names_and_the_statistics() -> None:
    page = text_of(ROOT / "docs" / "reference.md")
    assert sorted(re.findall(r"^\| `il\.(\w+)", page, re.MULTILINE)) == sorted(il.__all__)
    variables = page.partition("## Variables of a result")[2].partition("Records add")[0]
    assert re.findall(r"^\| `(\w+)`", variables, re.MULTILINE) == [*STATISTICS, *OF_STATES]


def test_architecture_lists_every_module() -> None:
    """Each in its folder, by the indentation of the list."""
    page = text_of(ROOT / "docs" / "architecture.md").partition("## Modules")[2]
    listed, folders = [], [Path()]
    for line in blocks_of(page, "")[0].splitlines():
        name, depth = line.split()[0], (len(line) - len(line.lstrip())) // 2
        folders[depth + 1 :] = [folders[depth] / name]
        if not name.endswith("/"):
            listed.append(folders[-1].as_posix())
    package = ROOT / "impactlab"
    modules = [file.relative_to(package).with_suffix("").as_posix() for file in package.rglob("*.py")]
    assert sorted(listed) == sorted(name for name in modules if not name.endswith("__init__"))


def test_modules_in_the_text_of_architecture_exist() -> None:
    page = text_of(ROOT / "docs" / "architecture.md").partition("## Modules")[0]
    folders = "|".join(folder.name for folder in (ROOT / "impactlab").iterdir() if folder.is_dir())
    named = set(re.findall(rf"`((?:{folders})(?:/\w+)+)", page))
    assert len(named) > 50
    assert [name for name in sorted(named) if not (ROOT / "impactlab" / f"{name}.py").exists()] == []


@pytest.mark.full
def test_planted_bugs_are_drawn_from_what_the_tests_print(tmp_path: Path) -> None:
    shown = "half | pair | balance[two] | 195\nwrong | pair | refused: no\nstart | start | overlap | inf\nnone of these"
    script = ROOT / "docs" / "figures" / "planted_bugs.py"
    done = subprocess.run(
        [sys.executable, "-X", "utf8", str(script), str(tmp_path)],
        input=shown, capture_output=True, encoding="utf-8", check=True,
    )  # fmt: skip
    assert [line.split(" | ")[-1] for line in done.stdout.splitlines()[2:]] == ["195 |", "∞ |", "∞ |"]
    assert (tmp_path / "planted_bugs.png").stat().st_size > 1000


def test_the_latest_version_in_the_list_of_changes_is_this_one() -> None:
    unreleased, latest = re.findall(r"^## (\S+)", text_of(ROOT / "CHANGELOG.md"), re.MULTILINE)[:2]
    assert (unreleased, latest) == ("Unreleased", il.__version__)


def test_kinds_of_warnings_are_listed():
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", text_of(ROOT / "docs" / "reference.md"), re.MULTILINE)
    assert set(KINDS.items()) <= set(rows)
