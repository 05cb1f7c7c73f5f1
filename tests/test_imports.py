"""Import directions; ``import hab_tasks`` has no side effect but registration."""

import ast
import importlib
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
import tomllib

ROOT = Path(__file__).parents[1]

# A module of hab_tasks may import from its own row and the rows above. A new one needs a row.
ORDER = [
    {
        "constants",
        "receptacles",
        "object_names",
        "errors",
        "agent",
        "privileged",
        "assets",
        "arrays",
        "simulator",
    },
    {"io"},
    {"task_spec", "typed_values"},
    {"articulations", "registration"},
    {"geometry", "rendering", "option_values", "captions", "figure_style"},
    {"world", "robots"},
    {"episodes"},
    {"instructions"},
    {"engine"},
    {"skills"},
    {"tasks"},
    {"envs"},
    {"vector"},
    {"agent_spaces", "web_scene"},
    {"__init__"},
    {"commands"},
    {"cli"},
    {"__main__"},
]
RANK = {name: rank for rank, row in enumerate(ORDER) for name in row}

# A package may import from the rows above; agents of others are loaded by module:factory.
PACKAGES = [
    {"hab_tasks"},
    {"hab_eval", "hab_authoring"},
    {"hab_plans", "hab_experts"},
    {"hab_spa", "hab_ppo"},
    {"hab_navigator"},
    {"hab_tp_srl"},
]

FOUND = (p.parent for p in ROOT.glob("[!.]*/**/hab_*/__init__.py") if "build" not in p.parts)
FOLDERS = {folder.name: folder for folder in FOUND}
FOLDERS["hab_tasks"] = ROOT / "hab_tasks"

# The same for hab_spa.
SPA_ORDER = [
    {"shapes"},
    {"planning"},
    {"sensing"},
    {"scenes"},
    {"motion"},
    {"skills"},
    {"tasks"},
    {"agents"},
    {"__init__"},
    {"cli", "recording", "bench_plan", "bench_episode"},
]
SPA = ROOT / "baselines" / "spa" / "hab_spa"

# The same for hab_eval.
EVAL_ORDER = [
    *(
        {"errors"},
        {"records"},
        {"run"},
        {"integrations", "view"},
        {"__init__"},
        {"bench"},
        {"site"},
        {"commands"},
    ),
    *({"cli"}, {"__main__"}),
]
EVAL = ROOT / "eval" / "hab_eval"

# The same for hab_authoring.
AUTHORING_ORDER = [
    {"__init__", "apartment", "inventory", "showroom"},
    {"habitat", "layouts"},
    {"figures", "pipeline"},
    {"commands"},
]
AUTHORING = ROOT / "assets" / "authoring" / "hab_authoring"

# Run by a new Python: whatever the import prints, asks, downloads or writes shows.
IMPORT_ALONE = """
import importlib, os, socket, sys
def refuse(*args, **kwargs): raise AssertionError("the import opened a connection")
socket.socket.connect = socket.create_connection = refuse
sys.stdin = None
before = dict(os.environ)
import hab_tasks
heavy = {"torch", "sapien", "mani_skill"} & set(sys.modules)
assert not heavy, f"the import loads {heavy}"
import gymnasium, torch
changed = {k for k in before.keys() | os.environ.keys() if before.get(k) != os.environ.get(k)}
assert not {k for k in changed if k.startswith(("MS_", "HAB_"))}, changed
assert not torch.cuda.is_initialized()
ours = [name for name in gymnasium.registry if name.startswith("Hab")]
assert ours, "no environment was registered"
assert ours == list(hab_tasks.ENVS), "the table of names is not that of the classes"
for entry in hab_tasks.ENVS.values():
    known = gymnasium.spec(entry.id)
    module, name = known.entry_point.split(":")
    assert getattr(importlib.import_module(module), name) is entry.env, entry.id
    assert known.max_episode_steps == entry.horizon_steps, entry.id
tops = {m.split(".")[0] for m in sys.modules}
assert not {m for m in tops if m == "ompl" or (m.startswith("hab_") and m != "hab_tasks")}
"""

SCRIPTS = {
    script: target
    for file in (
        ROOT / "pyproject.toml",
        *sorted(ROOT.glob("*/pyproject.toml")),
        *sorted(ROOT.glob("*/*/pyproject.toml")),
    )
    for script, target in tomllib.loads(file.read_text())["project"].get("scripts", {}).items()
}
"""Console script -> its function."""

HEAVY = {
    *("torch", "sapien", "mani_skill", "pinocchio", "coal", "ompl", "trimesh", "matplotlib"),
    *("scipy", "imageio", "unified_planning", "pyarrow", "numba", "tensorboard"),
}
"""Modules that together take seconds to load."""

# Run by a new Python: asks for each help, and writes the subcommand and what was loaded by then.
HELP = """
import sys
from {module} import COMMANDS, {main}
for command in ("", *COMMANDS):
    try: status = {main}([*filter(None, [command]), "--help"])
    except SystemExit as end: status = end.code
    assert not status, (command, status)
    loaded = sorted({heavy} & set(sys.modules))
    print(command or "-", *loaded, file=sys.stderr)
"""


def imports_of(path: Path, package: str) -> set[str]:
    """Full names of what a file imports; ``package`` is the one it is in."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = (
                package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            )
            module = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{module}.{alias.name}" for alias in node.names}
    return found


def part_of_hab_tasks(name: str) -> str | None:
    """The first-level module of ``hab_tasks`` that an imported name belongs to."""
    head, _, rest = name.partition(".")
    if head != "hab_tasks":
        return None
    first = rest.partition(".")[0]
    is_module = (ROOT / "hab_tasks" / f"{first}.py").is_file() or (
        ROOT / "hab_tasks" / first
    ).is_dir()
    return first if first == "assets" or (first and is_module) else "__init__"


def modules(folder: Path) -> list[tuple[Path, str]]:
    """Files of an import package, each with the name of the package that it is in."""
    return [
        (path, ".".join(path.parent.relative_to(folder.parent).parts))
        for path in sorted(folder.rglob("*.py"))
    ]


def test_imports_inside_hab_tasks_go_one_way():
    wrong = []
    for path, package in modules(ROOT / "hab_tasks"):
        own = Path(path.relative_to(ROOT / "hab_tasks").parts[0]).stem
        assert own in RANK, f"give hab_tasks.{own} a row in ORDER"
        for name in imports_of(path, package):
            other = part_of_hab_tasks(name)
            if other is not None and RANK.get(other, 99) > RANK[own]:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong


@pytest.mark.parametrize(
    ("folder", "order"), [(SPA, SPA_ORDER), (EVAL, EVAL_ORDER), (AUTHORING, AUTHORING_ORDER)]
)
def test_imports_inside_a_package_go_one_way(folder, order):
    ranks = {name: rank for rank, row in enumerate(order) for name in row}
    wrong = []
    for path, _ in modules(folder):
        own = Path(path.relative_to(folder).parts[0]).stem
        assert own in ranks, f"give {folder.name}.{own} a row"
        for name in imports_of(path, folder.name):
            head, _, rest = name.partition(".")
            # A name that is no module is one that the package itself exports.
            rank = ranks.get(rest.partition(".")[0], ranks["__init__"])
            if head == folder.name and rank > ranks[own]:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong


def test_imports_between_packages_go_one_way():
    assert set().union(*PACKAGES) == set(FOLDERS)
    for rank, row in enumerate(PACKAGES):
        later = {name for other in PACKAGES[rank + 1 :] for name in other} | set(row)
        for name in row:
            for path, package in modules(FOLDERS[name]):
                heads = {found.partition(".")[0] for found in imports_of(path, package)}
                assert not heads & (later - {name}), path


def test_functions_of_maniskill_are_called_in_one_module():
    """So that one module knows its versions; classes and the names here are its interface."""
    interface = {"register", "register_agent", "look_at", "ASSET_DIR", "mani_skill"}
    wrong = []
    for path, package in modules(ROOT / "hab_tasks"):
        for found in imports_of(path, package):
            name = found.rpartition(".")[2]
            is_class = not (name.isupper() or name.islower())
            if found.startswith("mani_skill") and not is_class and name not in interface:
                wrong.append(f"{path.relative_to(ROOT)} imports {found}")
    assert {entry.partition(" ")[0] for entry in wrong} == {"hab_tasks/simulator.py"}, wrong


def test_a_package_tells_its_version():
    for package, folder in (("hab_tasks", "."), ("hab_eval", "eval")):
        project = tomllib.loads((ROOT / folder / "pyproject.toml").read_text())["project"]
        assert importlib.import_module(package).__version__ == project["version"], package


@pytest.mark.slow
def test_import_is_silent_and_changes_nothing(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k not in ("MS_ASSET_DIR", "PYTHONPATH")}
    home, fonts = tmp_path / "home", tmp_path / "fonts"
    home.mkdir()
    # ManiSkill imports matplotlib, which keeps a list of fonts, and may say that it makes one.
    environment |= {"HOME": str(home), "XDG_CACHE_HOME": str(home), "MPLCONFIGDIR": str(fonts)}
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALONE],
        env=environment,
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert not [line for line in done.stderr.splitlines() if "Matplotlib" not in line]
    assert not list(home.rglob("*")), "the import wrote files"


@pytest.mark.parametrize("script", SCRIPTS)
def test_help_of_a_script_loads_no_simulator(script):
    module, _, function = SCRIPTS[script].partition(":")
    if importlib.util.find_spec(module.partition(".")[0]) is None:
        pytest.skip(f"{script} is not installed")
    code = HELP.format(module=module, main=function, heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    told = [line.split() for line in done.stderr.splitlines()]
    assert len(told) >= 2, "neither the script's help nor a subcommand's was asked for"
    for command, *loaded in told:
        assert not loaded, f"{script} {command} --help loads {loaded}"
