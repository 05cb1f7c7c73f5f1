"""The code of the tutorials and of the first pages runs, in order, as a reader would run it.

A block with a title is a file; the other Python blocks of a page run in one namespace. A shell
block runs if the line before it is ``<!-- run -->``; pages that have such blocks are slow tests.
Console scripts are called in this process, as loading the simulator for each takes seconds.
"""

import ast
import importlib
import re
import shlex
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import gymnasium
import pytest

from hab_tasks import registration

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("tutorials/*.md"), DOCS / "start.md", DOCS / "concepts.md"])
SEEN = "index.md"  # a list of the others

BLOCK = re.compile(
    r"(?P<mark>^<!-- run -->\n)?"
    r'^```(?P<language>python|bash)(?: title="(?P<file>[\w./]+)")?\n(?P<code>.*?)^```$',
    re.MULTILINE | re.DOTALL,
)
SCRIPT = re.compile(r"hab-[a-z-]+")


def name_of(page):
    return str(page.relative_to(DOCS))


def steps_of(page):
    """(line, kind, file or None, code) of what is to be done on a page, in order."""
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        line = text.count("\n", 0, block.start("code")) + 1
        if block["language"] == "python":
            yield line, "python", block["file"], block["code"]
        elif block["mark"]:
            yield line, "bash", None, block["code"]


@pytest.fixture
def working_directory(tmp_path, monkeypatch):
    """A folder as the working directory, whose modules and environments are forgotten later."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    tables = (
        registration.ENTRY_POINTS,
        registration.TASKS,
        registration._modules,
        gymnasium.registry,
    )
    kept = [dict(table) for table in tables]
    yield tmp_path
    for table, old in zip(tables, kept, strict=True):
        table.clear()
        table.update(old)
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def forget(file):
    """Lets a module of the page replace one of the tests with the same name."""
    name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    for known in [m for m in sys.modules if m == name or m.startswith(f"{name}.")]:
        del sys.modules[known]
    importlib.invalidate_caches()


def run_command(command, where):
    words = shlex.split(command, comments=True)
    if SCRIPT.fullmatch(words[0]):
        (script,) = metadata.entry_points(group="console_scripts", name=words[0])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", words)
            try:
                status = script.load()()
            except SystemExit as end:
                status = end.code
        assert status in (0, None), f"{where}: {command} ended with {status}"
        return
    assert words[0] == "python", f"{where}: run hab-* or python"
    done = subprocess.run([sys.executable, *words[1:]], capture_output=True, text=True)
    assert done.returncode == 0, f"{where}: {done.stderr[-2000:]}"


def play(page):
    space = {"__name__": "__main__"}
    for line, kind, file, code in steps_of(page):
        where = f"{name_of(page)}, line {line}"
        if file is not None:
            path = Path(file)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(code, encoding="utf-8")
            forget(file)
        elif kind == "python":
            exec(compile("\n" * (line - 1) + code, str(page), "exec"), space)
        else:
            for command in code.replace("\\\n", " ").splitlines():
                run_command(command, where)


def case_of(page):
    """A page with code; slow where it runs commands."""
    slow = [pytest.mark.slow] if "<!-- run -->" in page.read_text("utf-8") else []
    return pytest.param(page, id=name_of(page), marks=slow)


@pytest.mark.parametrize("page", [case_of(page) for page in PAGES if page.name != SEEN])
def test_the_code_of_a_page_runs(page, working_directory):
    assert list(steps_of(page)), "no code on the page"
    play(page)


def test_tutorials_import_public_names():
    public = {p: importlib.import_module(p).__all__ for p in ("hab_tasks", "hab_eval", "hab_ppo")}
    codes = [code for page in PAGES for _, kind, _, code in steps_of(page) if kind == "python"]
    nodes = [node for code in codes for node in ast.walk(ast.parse(code))]
    names = {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
    assert not [n for n in names if n.startswith("hab_") and n not in public]
    taken = {(n.module, a.name) for n in nodes if isinstance(n, ast.ImportFrom) for a in n.names}
    hidden = [f for f in taken if f[0].startswith("hab_") and f[1] not in public.get(f[0], ())]
    assert not hidden, "export them from the package, or use what it exports"


def test_every_tutorial_is_listed():
    index = (DOCS / "tutorials" / SEEN).read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\((\w+\.md)\)", index))
    assert listed == {p.name for p in DOCS.glob("tutorials/*.md")} - {SEEN}


def test_marks_and_titles_are_understood():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert text.count("<!-- run") == len([b for b in BLOCK.finditer(text) if b["mark"]])
        fences = re.findall(r"^```(?:python|bash)", text, flags=re.MULTILINE)
        assert len(fences) == len(list(BLOCK.finditer(text))), page
