"""Style rules that ruff does not check: sizes, names, randomness, printing, packaging lists."""

import ast
import re
import subprocess
from pathlib import Path

import pytest
import tomllib

ROOT = Path(__file__).parents[1]
MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 40
TOP_FOLDERS = {"hab_tasks", "assets", "baselines", "eval", "tests", "docs"}
VAGUE_NAMES = {"utils.py", "common.py", "helpers.py", "misc.py"}
UNFINISHED = ("TO" + "DO", "Add a task " + "description")  # the second is a template's docstring

# What does not touch the global random state of numpy, of Python and of torch.
NUMPY_OWN_STATE = {"default_rng", "Generator", "SeedSequence", "BitGenerator", "PCG64"}
PYTHON_OWN_STATE = {"Random", "SystemRandom"}
TORCH_DRAWS = {"rand", "randn", "randint", "randperm", "normal", "multinomial", "bernoulli"}


def tracked(pattern: str) -> list[Path]:
    """Files under version control, except those just deleted."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--", pattern], cwd=ROOT, capture_output=True, text=True
    )
    if listing.returncode != 0:
        pytest.skip("not a git checkout", allow_module_level=True)
    return [p for name in listing.stdout.split("\0") if name and (p := ROOT / name).is_file()]


FILES = tracked("*.py")
SHIPPED = [p for p in FILES if p.relative_to(ROOT).parts[0] != "tests"]

# Forked processes, and their test: numpy seeds its global state when it is imported, before a fork.
FORKED = {
    "hab_tasks/io/worker_server.py": "np.random.seed",
    "tests/worker_jobs.py": "np.random.random",
}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.fixture(scope="module")
def trees():
    """Syntax tree of each file."""
    return {path: ast.parse(path.read_text(encoding="utf-8"), str(path)) for path in FILES}


def statement_lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines from ``def`` to the last statement, the docstring's left out."""
    lines = function.end_lineno - function.lineno + 1
    if ast.get_docstring(function, clean=False) is not None:
        docstring = function.body[0]
        lines -= docstring.end_lineno - docstring.lineno + 1
    return lines


def test_files_are_short_and_finished():
    texts = {name_of(path): path.read_text(encoding="utf-8") for path in FILES}
    assert not [name for name, text in texts.items() if len(text.splitlines()) > MAX_FILE_LINES]
    assert not [name for name, text in texts.items() if any(word in text for word in UNFINISHED)]


def test_functions_are_short(trees):
    long = [
        f"{name_of(path)}: {node.name} has {statement_lines(node)} lines"
        for path in SHIPPED
        for node in ast.walk(trees[path])
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and statement_lines(node) > MAX_FUNCTION_LINES
    ]
    assert not long


def test_only_command_lines_print(trees):
    prints = [
        f"{name_of(path)}:{node.lineno}"
        for path in SHIPPED
        if path.name != "cli.py" and path.parent.name != "commands"
        for node in ast.walk(trees[path])
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "print"
    ]
    assert not prints, "use logging"


def global_draws(tree: ast.Module, *, torch_too: bool) -> list[str]:
    """Uses of a global random state, as ``line: expression``."""
    imported = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            owner = ast.unparse(node.value)
            if owner in ("np.random", "numpy.random") and node.attr not in NUMPY_OWN_STATE:
                found.append(f"{node.lineno}: {ast.unparse(node)}")
            if owner == "random" and "random" in imported and node.attr not in PYTHON_OWN_STATE:
                found.append(f"{node.lineno}: {ast.unparse(node)}")
        if torch_too and isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            is_draw = ast.unparse(node.func.value) == "torch" and node.func.attr in TORCH_DRAWS
            if is_draw and not any(k.arg == "generator" for k in node.keywords):
                found.append(f"{node.lineno}: {ast.unparse(node)}")
    return found


def test_randomness_comes_from_generators(trees):
    shipped = set(SHIPPED)
    found = [
        f"{name_of(path)}:{draw}"
        for path in FILES
        for draw in global_draws(trees[path], torch_too=path in shipped)
        if draw.split(": ")[1] != FORKED.get(name_of(path))
    ]
    assert not found


def test_global_draws_are_found():
    source = "import random\nrandom.seed(0)\nnp.random.rand(3)\nx = torch.rand(3)\n"
    assert len(global_draws(ast.parse(source), torch_too=True)) == 3
    source = "rng = np.random.default_rng(0)\nx = torch.rand(3, generator=g)\n"
    assert not global_draws(ast.parse(source), torch_too=True)


def test_file_names_say_what_the_files_hold():
    assert not [name_of(p) for p in FILES if p.name in VAGUE_NAMES]
    for folder in ("eval", "baselines", "tests"):
        assert not (ROOT / folder / "__init__.py").exists(), f"{folder}/ is a folder, not a package"


def test_top_level_folders_are_the_agreed_ones():
    parts = {p.relative_to(ROOT).parts for p in tracked("*")}
    folders = {p[0] for p in parts if len(p) > 1 and not p[0].startswith(".")}
    assert folders <= TOP_FOLDERS


def test_packaging_lists_every_package():
    folders = [p.parent for p in FILES if p.name == "__init__.py"]
    for project in tracked("*pyproject.toml"):
        listed = set(tomllib.loads(project.read_text())["tool"]["setuptools"]["packages"])
        listed -= {"hab_tasks.assets"}
        if listed == {"find"}:
            continue
        present = {
            ".".join(p.relative_to(project.parent).parts)
            for p in folders
            if p.is_relative_to(project.parent / min(listed))
        }
        assert listed == present, project


def test_dev_tools_are_pinned_and_listed_alike():
    def names(lines: list[str]) -> set[str]:
        bare = (re.match(r"[A-Za-z0-9._-]+", line) for line in lines)
        return {m.group().lower().replace("_", "-") for m in bare if m}

    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    tools = names((ROOT / "requirements-dev.txt").read_text().splitlines())
    assert tools == names(settings["dependency-groups"]["dev"])
    assert tools <= names((ROOT / "constraints.txt").read_text().splitlines())
