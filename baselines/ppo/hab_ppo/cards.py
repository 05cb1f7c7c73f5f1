"""Model cards of the weights that ship: one Markdown file and one learning curve each.

A card is made from the description in the file of weights and from evaluations (`run.json`) of the
policy under its name, so that it states nothing that is not in a file.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from hab_eval.records.leaderboard import default_submissions, read_submissions
from hab_eval.records.plain_text import markdown
from hab_eval.records.results import RunRecord

from hab_ppo import checkpoint
from hab_ppo.agent import WEIGHTS, recipe_of
from hab_ppo.commands import CardsCommand
from hab_ppo.curves import draw_success
from hab_ppo.extensions import extensions
from hab_ppo.recipe import Recipe
from hab_ppo.recipes import RECIPE_FILES
from hab_tasks.io.console import tell
from hab_tasks.io.files import written_aside

NOT_EVALUATED = "No evaluation yet."


def run(options: CardsCommand) -> int:
    """Writes or compares the cards."""
    records = evaluations(options.submissions)
    texts = cards(records)
    curves = set(texts)
    for found in extensions("shipping").values():
        texts |= found.load().cards(records)
    stale = []
    for path, text in texts.items():
        picture = path.with_suffix(".png")
        there = path.is_file() and (path not in curves or picture.is_file())
        if there and path.read_text(encoding="utf-8") == text:
            continue
        stale.append(path.stem)
        if not options.check:
            with written_aside(path) as scratch:
                scratch.write_text(text, encoding="utf-8")
            if path in curves:
                draw_card_curve(path.stem, picture)
    state = "out of date" if options.check else "written"
    tell(f"{state}: {', '.join(stale)}" if stale else "all cards are up to date")
    return int(options.check and bool(stale))


def shipped_names() -> list[str]:
    """Returns the names of the policies whose weights ship."""
    return sorted(path.stem for path in WEIGHTS.glob("*.safetensors"))


def evaluations(submissions: Path | None) -> list[RunRecord]:
    """Returns the records in a folder; None for that of the leaderboard."""
    return list(read_submissions(submissions or default_submissions()).values())


def cards(records: Iterable[RunRecord]) -> dict[Path, str]:
    """Returns the file and the text of each policy's card."""
    return {WEIGHTS / f"{name}.md": card(name, records) for name in shipped_names()}


def card(name: str, records: Iterable[RunRecord]) -> str:
    """Returns the text of a policy's card.

    Args:
        name: The policy.
        records: Evaluations; those of other agents, or with options, are left out.
    """
    path = WEIGHTS / f"{name}.safetensors"
    _, about = checkpoint.load(path)
    recipe = recipe_of(about, path)
    own = [r for r in records if r.agent == f"hab_ppo:{name}" and not r.options]
    lines = [f"# {name}", "", recipe.about, "", *_facts(recipe, path)]
    lines += ["", f"![Learning curve]({name}.png)", "", *_training(about)]
    actions = "sampled" if recipe.draws_actions else "most likely"
    lines += ["", f"Success % [95 % interval] with {actions} actions, failures:", ""]
    lines += [result(record) for record in own] or [NOT_EVALUATED]
    return "\n".join(lines) + "\n"


def draw_card_curve(name: str, out: Path) -> None:
    """Draws the learning curve in a file of weights."""
    points = checkpoint.load(WEIGHTS / f"{name}.safetensors")[1]["training"]["curve"]
    training, evaluated = (
        [(point[0], point[entry]) for point in points if point[entry] is not None]
        for entry in (1, 2)
    )
    draw_success(training, evaluated, out)


def _facts(recipe: Recipe, path: Path) -> list[str]:
    env = recipe.env
    options = [f"`{env.obs_mode}`", f"`target_frame={env.target_frame}`"]
    options += ["`handle_position=True`"] if env.handle_position else []
    robot = f" --env-option robot={env.robot}" if env.robot else ""
    size = path.stat().st_size / 1e6
    file = Path(str(RECIPE_FILES[recipe.name].__file__)).name
    return [
        f"- Run: `hab-eval run --agent hab_ppo:{recipe.name} --env {env.env}{robot} --out DIR`",
        f"- Observes {', '.join(options)}; acts in `{env.control_mode}`",
        f"- Recipe: [`{recipe.name}`](../recipes/{file}); weights: {size:.1f} MB",
    ]


def _training(about: dict[str, Any]) -> list[str]:
    origin, position, training = about["origin"], about["position"], about["training"]
    best = position["best_steps"]
    hours = f"{training['seconds'] / 3600:.2f} h"
    machine = f"{origin['device']}, {about['ranks']} ranks"
    lines = [
        f"- Trained: `{origin['command']}` (commit {str(origin['git'])[:8]})",
        f"- Data: {_data(about['recipe']['env'])}",
        f"- Steps: {training['steps']:,} in {hours} ({machine}); best at {best:,}",
    ]
    start = training["start"]
    if start is not None:
        made = _listed(start["made_from"])
        cloned = f"cloned in {start['seconds'] / 60:.1f} min: " if start["seconds"] else ""
        lines.insert(2, f"- Start: {cloned}{markdown(made)}")
    return lines


def _listed(facts: dict[str, Any]) -> str:
    """Returns the facts of a start; of counts, only the totals."""
    totals = {k: v for k, v in facts.get("counts", {}).items() if not isinstance(v, dict)}
    said = {key: value for key, value in facts.items() if key != "counts"} | totals
    return ", ".join(f"{key} {value}" for key, value in said.items())


def _data(env: dict[str, Any]) -> str:
    episodes = f"{env['num_episodes']:,} episodes"
    return f"{episodes}, {env['split']} layouts of {markdown(env['scene_dataset'])}"


def result(record: RunRecord) -> str:
    """Returns the line of an evaluation."""
    summary = record.summary
    low, high = summary.success.ci95
    failures = ", ".join(f"{name} {count}" for name, count in summary.failures.items()) or "none"
    success = f"{100 * summary.success.mean:.1f} [{100 * low:.1f}, {100 * high:.1f}]"
    run = f"{record.scene_dataset}, {record.split}, seed {record.seed}"
    run += ", varied instructions" if record.instructions == "varied" else ""
    version = f"{record.versions['hab-tasks']}, {str(record.git)[:8]}"
    return f"- {run}: {success} of {len(record.episodes)}; {markdown(failures)} ({version})"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Returns the lines of a Markdown table."""
    cells = [columns, ["---"] * len(columns), *rows]
    return [f"| {' | '.join(row)} |" for row in cells]
