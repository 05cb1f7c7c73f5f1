"""What the READMEs say is so: their Python runs; their commands, targets, links and ids exist."""

import functools
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = sorted(
    p
    for p in (
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        *ROOT.glob("*/README.md"),
        *ROOT.glob("*/*/README.md"),
    )
    if p.is_file()
)


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def commands(text: str) -> list[tuple[str, str, tuple[str, ...]]]:
    """(program, subcommand, options) of every hab-* command in shell blocks and in inline code."""
    shell = "\n".join(blocks(text, "bash")).replace("\\\n", " ").splitlines()
    inline = re.findall(r"`(hab-[^`\n]+)`", text)
    found = []
    for line in [*shell, *inline]:
        match = re.search(
            r"(?:^|[\s/])(hab-(?:tasks|eval|spa))\s+([a-z]+)\b(.*)", line.partition("#")[0]
        )
        if match:
            options = tuple(sorted(set(re.findall(r"--[a-z][a-z-]*", match[3]))))
            found.append((match[1], match[2], options))
    return sorted(set(found))


@functools.cache
def help_of(*words: str) -> str:
    program = Path(sys.executable).parent / words[0]
    if not program.exists():
        pytest.skip(f"{words[0]} is not installed")
    done = subprocess.run(
        [program, *words[1:], "--help"],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"COLUMNS": "160"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_and_options_exist(page):
    for program, subcommand, options in commands(page.read_text(encoding="utf-8")):
        if subcommand == "help":
            continue
        text = help_of(program, subcommand)
        missing = [option for option in options if option not in text and option != "--help"]
        assert not missing, f"{program} {subcommand} has no {missing}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_and_pictures_exist(page):
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8"))
    local = [t for t in targets if "://" not in t and not t.startswith("mailto:")]
    assert not [t for t in local if not (page.parent / t).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_make_targets_exist(page):
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    named = set(
        re.findall(r"(?:^|`)make ([a-z]+)", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    )
    assert named <= targets


def test_readme_lists_every_environment():
    import gymnasium

    import hab_tasks  # noqa: F401  # registers

    registered = {name for name in gymnasium.registry if re.fullmatch(r"Hab\w+-v\d+", name)}
    listed = set(re.findall(r"^\| `(Hab\w+-v\d+)`", README, flags=re.MULTILINE))
    assert listed == registered


@pytest.mark.slow
@pytest.mark.parametrize(
    "code", [pytest.param(c, id=str(n)) for n, c in enumerate(blocks(README, "python"))]
)
def test_readme_python_runs(code, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
