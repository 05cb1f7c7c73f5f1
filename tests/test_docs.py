"""Documentation: its Python code runs; its commands, targets, links and ids exist."""

import ast
import contextlib
import dataclasses
import functools
import inspect
import io
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
RUNNING = ("README.md", "docs/index.md", "docs/vector.md", "baselines/spa/README.md")
"""Pages whose Python blocks each run alone; tests/test_tutorials.py runs those of other pages."""

PAGES = (
    *(ROOT / "README.md", ROOT / "CONTRIBUTING.md"),
    *(*ROOT.glob("[!.]*/README.md"), *ROOT.glob("[!.]*/*/README.md"), *DOCS.glob("**/*.md")),
)
TEXTS = {str(p.relative_to(ROOT)): p.read_text(encoding="utf-8") for p in sorted(PAGES)}
"""Page -> its text."""
README = TEXTS["README.md"]


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def commands(text: str) -> list[tuple[str, str, tuple[str, ...]]]:
    """(program, subcommand, options) of every hab-* command in shell blocks and in inline code."""
    shell = "\n".join(blocks(text, "bash")).replace("\\\n", " ").splitlines()
    inline = re.findall(r"`(hab-[^`\n]+)`", text)
    found = []
    for line in [*shell, *inline]:
        match = re.search(
            r"(?:^|[\s/])(hab-(?:tasks|eval|spa|planner|ppo))\s+([a-z]+)\b(.*)",
            line.partition("#")[0],
        )
        if match:
            options = tuple(sorted(set(re.findall(r"--[a-z][a-z-]*", match[3]))))
            found.append((match[1], match[2], options))
    return sorted(set(found))


@functools.cache
def help_of(*words: str) -> str:
    """What a program says of itself; called here, since a process for each would take a minute."""
    (program,) = metadata.entry_points(group="console_scripts", name=words[0])
    text = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(text):
        patch.setenv("COLUMNS", "160")
        patch.setattr(sys, "argv", [*words, "--help"])
        with pytest.raises(SystemExit) as end:
            sys.exit(program.load()())
    assert end.value.code in (None, 0), text.getvalue()
    return text.getvalue()


def test_commands_and_options_exist():
    missing = [
        f"{name}: {program} {subcommand} {option}"
        for name, text in TEXTS.items()
        for program, subcommand, options in commands(text)
        if subcommand != "help"
        for option in options
        if option != "--help" and option not in help_of(program, subcommand)
    ]
    assert not missing


def test_links_and_pictures_exist():
    missing = [
        f"{name}: {target}"
        for name, text in TEXTS.items()
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text)
        if "://" not in target and not target.startswith("mailto:")
        if not (ROOT / name).parent.joinpath(target).exists()
    ]
    assert not missing


def test_readme_lists_every_environment_with_task_and_horizon():
    import gymnasium

    from hab_tasks.envs import ENVS

    registered = {name for name in gymnasium.registry if re.fullmatch(r"Hab\w+-v\d+", name)}
    assert set(ENVS) == registered
    rows = re.findall(r"^\| `(Hab\w+-v\d+)` \| (.+) \| (\d+) steps \|$", README, flags=re.MULTILINE)
    told = {name: (task, int(steps)) for name, task, steps in rows}
    assert told == {e.id: (e.env.summary(), e.horizon_steps) for e in ENVS.values()}


def test_the_page_of_options_lists_each_with_its_default():
    from hab_tasks.engine.hab_env import HabEnv

    rows = re.findall(r"^\| `(\w+)` \| `(.+?)` \|", TEXTS["docs/options.md"], flags=re.MULTILINE)
    options = {
        name: parameter.default
        for name, parameter in inspect.signature(HabEnv.__init__).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY and name != "num_envs"
    }
    told = {name: ast.literal_eval(default) for name, default in rows}
    assert told.pop("camera_hfov_rad") == round(options.pop("camera_hfov_rad"), 3)
    assert told == options


def test_the_page_of_commands_lists_every_command():
    from hab_tasks.cli import COMMANDS

    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `hab-tasks (\w+)` \|", text, flags=re.MULTILINE)
    assert sorted(listed) == sorted(COMMANDS)


def test_the_tutorials_task_and_skill_are_those_that_are_tested():
    source = (ROOT / "tests" / "my_tasks" / "__init__.py").read_text(encoding="utf-8")
    code = source.split('"""\n\n', 1)[1]
    assert code in (DOCS / "tutorials" / "task.md").read_text(encoding="utf-8")
    assert len(code.splitlines()) <= 25
    skill = (DOCS / "tutorials" / "skill.md").read_text(encoding="utf-8")
    for name in ("__init__.py", "reach.py"):
        assert (ROOT / "tests" / "my_skills" / name).read_text(encoding="utf-8") in skill


def test_generated_pages_are_what_is_generated():
    from hab_authoring.commands import contract, docs

    for made in (docs, contract):
        text = (ROOT / "docs" / made.PAGE).read_text(encoding="utf-8")
        assert text == made.page(), "run: hab-tasks docs --out docs --force"


def test_the_recorded_episode_of_the_contract_repeats():
    from hab_authoring.commands.contract import EPISODE_FILE, make_golden, play_golden

    with np.load(DOCS / EPISODE_FILE, allow_pickle=False) as file:
        recorded = {name: file[name] for name in file}
    env = make_golden()
    found = play_golden(env, recorded["actions"])
    env.close()
    assert found.keys() == recorded.keys()
    assert recorded["instruction"].tolist() == found["instruction"].tolist()
    for name in recorded.keys() - {"instruction"}:  # contacts amplify the last digits
        np.testing.assert_allclose(found[name], recorded[name], atol=2e-3, err_msg=name)
    assert recorded["rewards"][-1] > 5  # solved


def test_the_page_lists_every_mode_measure_and_observation_of_an_environment():
    from hab_authoring.commands.docs import measures_of, page

    from hab_tasks.envs import ENVS

    sections = dict(re.findall(r"^## (\w+.*)\n((?s:.*?))(?=^## |\Z)", page(), flags=re.MULTILINE))
    for env_id, entry in ENVS.items():
        names = [*entry.env.control_modes, *measures_of(entry.env)]
        names += [item.name for item in entry.env.observation]
        assert not [name for name in names if f"`{name}`" not in sections[env_id]], env_id
        # Each observation table of a docstring is the class's own list.
        row = r"^ *(\w+) +(agent|extra) +(\d+) "
        table = re.findall(row, entry.env.__doc__, flags=re.MULTILINE)
        assert table == [(e.name, e.group, str(*e.shape)) for e in entry.env.observation]


@pytest.mark.slow
def test_the_page_names_what_info_holds():
    import gymnasium
    from hab_authoring.commands.docs import measures_of

    from hab_tasks.envs import ENVS

    for env_id, entry in ENVS.items():
        env = gymnasium.make(env_id, obs_mode="state")
        _, info = env.reset(seed=0)
        env.close()
        assert list(info["measures"]) == list(measures_of(entry.env)), env_id
        weights = getattr(getattr(env.unwrapped, "skill", None), "config", None)
        if weights is not None:
            # Each term has a weight or shares that of the distance.
            names = {f.name for f in dataclasses.fields(weights.weights)} | {"approach", "retract"}
            terms = {term.partition("_object")[0] for term in info["reward_terms"]}
            assert terms <= names, env_id


def test_pages_name_files_and_fields_that_exist():
    from hab_tasks.engine.goals import Goals
    from hab_tasks.engine.measures import MEANINGS

    for name in ("docs/notation.md", "docs/deviations.md"):
        text = TEXTS[name]
        files = set(re.findall(r"`((?:\w+/)*\w*\.py|(?:\w+/)+)`", text))
        assert files, name
        roots = (ROOT / "hab_tasks", ROOT / "assets/authoring/hab_authoring")
        assert not [f for f in files if not any((root / f).exists() for root in roots)], name
        assert set(re.findall(r"Measures\.(\w+)", text)) <= set(MEANINGS)
        goals = {f.name for f in dataclasses.fields(Goals)}
        assert set(re.findall(r"Goals\.(\w+)", text)) <= goals
    rows = [line for line in TEXTS["docs/deviations.md"].splitlines() if line.startswith("| ")]
    assert not [row for row in rows if row.count(" | ") != 3]


def test_readme_is_short_and_links_to_every_page():
    assert len(README.splitlines()) <= 160
    linked = set(re.findall(r"\]\((docs/[\w/]+\.md)", README))
    pages = {str(p.relative_to(ROOT)) for p in DOCS.glob("**/*.md")}
    of_the_site = {"docs/index.md", "docs/tutorials/index.md"}  # lists of links themselves
    assert linked == {p for p in pages if not p.startswith("docs/api/")} - of_the_site


@pytest.mark.slow
def test_the_site_is_built_and_loads_nothing_from_a_network(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "-d", str(tmp_path)]  # -q hides warnings
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    loads = r"<(?:script|img|iframe|source)\b[^>]*\bsrc=\"?(https?:|//)"
    sheets = r"<link\b[^>]*\brel=\"?(?:stylesheet|icon|preconnect)[^>]*\bhref=\"?(https?:|//)"
    pages = list(tmp_path.glob("**/*.html"))
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not re.search(loads, text), page
        assert not re.search(sheets, text), page
        assert not re.search(r"github\.com/[\w./-]*\.md\b", text), f"{page}: a page of the site"


@pytest.mark.slow
def test_python_blocks_run(tmp_path):
    for name in RUNNING:
        for code in blocks(TEXTS[name], "python"):
            done = subprocess.run(
                [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
            )
            assert done.returncode == 0, f"{name}: {code}\n{done.stderr}"


GENERATED = re.compile(r"<!-- (?:status|bench): .*?<!-- end of (?:status|bench) -->", re.DOTALL)
PERCENTAGE = re.compile(
    r"\d[\d.]* ?%(?! (?:Wilson )?(?:confidence )?interval| of (?:its |the )?travel)"
)
"""A rate in percent; not the level of an interval, nor how far a drawer is open."""


def test_rates_are_generated():
    """Results stand in generated tables, which are regenerated when they change."""
    packages = ("README.md", "eval/README.md", "assets/README.md")
    found = [
        f"{name}: {rate}"
        for name, text in TEXTS.items()
        if name in packages or name.startswith(("docs/", "baselines/"))
        for rate in PERCENTAGE.findall(GENERATED.sub("", text))
    ]
    assert not found
