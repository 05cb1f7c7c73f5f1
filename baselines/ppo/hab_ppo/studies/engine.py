"""Runs a study: trains its arms, evaluates them and the references, and writes the report.

All work is kept in the study's folder. A killed study continues: an unfinished training goes on
after its last evaluation, bit for bit, and an unfinished distillation begins again; finished
episodes of an evaluation are not played again. The report only depends on what is kept.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

from hab_eval.records.config import EvalConfig
from hab_eval.records.results import RunRecord, read_record, write_record
from hab_eval.run.evaluate import RunOptions, evaluate
from hab_eval.run.run_folder import locked

from hab_ppo.commands import StudyCommand
from hab_ppo.distributed import Ranks
from hab_ppo.plan import BEST, CLONED, EXACT, TrainPlan
from hab_ppo.progress import FILE, read_progress
from hab_ppo.recipe import Recipe
from hab_ppo.studies.report import Result, write_report
from hab_ppo.studies.study import Arm, Condition, Study, slug
from hab_ppo.trainer import train_rank
from hab_tasks.errors import FileError, OptionError
from hab_tasks.io.console import tell
from hab_tasks.io.executors import LocalExecutor, Task
from hab_tasks.io.files import check_folder, written_aside
from hab_tasks.typed_values import to_json

WORK = "work"
"""Folder with trainings and evaluations, inside the study's."""

MARK = f"{WORK}/study.json"
"""File of a study's folder with its name and scale."""

FINISHED = "finished.json"
"""File of a training's folder that has ended."""

SPLIT, SEED = "test", 40
"""Split and seed of the episodes of the evaluations."""

REFERENCES = {"do nothing": "hab_eval:do_nothing", "random actions": "hab_eval:random_agent"}
REFERENCE_EPISODES = 100


@dataclass(frozen=True, kw_only=True)
class Training:
    """A training of a study."""

    name: str
    recipe: Recipe
    seed: int
    out: Path
    command: str


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """An evaluation of a study: a row of its table, or a seed of it."""

    name: str
    row: str
    config: EvalConfig
    measure: str
    arm: Arm | None = None
    condition: Condition = field(default_factory=Condition)
    training: Path | None = None


def open_study(out: Path, name: str, scale: str) -> None:
    """Marks a new folder, or checks that an old one belongs to the same study.

    Raises:
        OptionError: It belongs to another study or scale.
        FileError: It cannot be written, or was not made by this command.
    """
    mark, wanted = out / MARK, {"study": name, "scale": scale}
    if mark.is_file():
        try:
            found = json.loads(mark.read_text(encoding="utf-8"))
        except ValueError as error:
            raise FileError(mark, "is not valid JSON; give another folder") from error
        if found != wanted:
            is_of = " at scale ".join(str(found.get(key)) for key in wanted)
            raise OptionError(
                f"--out {out} holds the study {is_of}, not {name} at scale {scale}; give another "
                "folder."
            )
        return
    if not (out.is_dir() and all(path.name[0] == "." for path in out.iterdir())):
        check_folder(out, force=False, mark=MARK)
    with written_aside(mark) as scratch:
        scratch.write_text(json.dumps(wanted) + "\n", encoding="utf-8")


def run_study(study: Study, options: StudyCommand) -> None:
    """Trains, evaluates and reports."""
    study.check()
    with locked(options.out):
        open_study(options.out, study.name, options.scale)
        work = options.out / WORK
        trainings = trainings_of(study, options.scale, work, options.command())
        train_all(trainings, options.workers)
        found = []
        for one in evaluations_of(study, options.scale, trainings):
            out = work / "evaluations" / one.name
            record = kept_evaluation(one.config, out, options.workers)
            write_record(options.out / f"{one.name}.json", record)
            entries = read_progress(one.training) if one.training else []
            found.append(
                Result(
                    row=one.row,
                    arm=one.arm,
                    condition=one.condition,
                    measure=one.measure,
                    record=record,
                    entries=entries,
                )
            )
        tell(write_report(study, options, found))


# Training ------------------------------------------------------------------------------------


def trainings_of(study: Study, scale: str, work: Path, command: str) -> list[Training]:
    """Returns the trainings of a study; those of one seed run beside each other."""
    most = max(arm.budgets[scale].seeds for arm in study.arms)
    return [
        Training(
            name=f"{arm.slug}_seed{seed}",
            recipe=arm.recipe_at(scale, study.name),
            seed=seed,
            out=work / f"{arm.slug}_seed{seed}",
            command=command,
        )
        for seed in range(most)
        for arm in study.arms
        if seed < arm.budgets[scale].seeds
    ]


def _ended(training: Training) -> bool:
    """Whether a training has ended; rejects one of another version of the study."""
    file = training.out / FINISHED
    if not file.is_file():
        return False
    if json.loads(file.read_text(encoding="utf-8")) != _about(training):
        raise OptionError(
            f"{training.out} is a training of another version of the study; give another --out."
        )
    return True


def _about(training: Training) -> dict[str, object]:
    return {"seed": training.seed, "recipe": json.loads(json.dumps(to_json(training.recipe)))}


def train_all(trainings: Iterable[Training], workers: int) -> None:
    """Trains what has not ended, several at a time."""
    left = [one for one in trainings if not _ended(one)]
    task = Task(start=_trainer, name=lambda one: f"Training {one.name}")
    tell(f"{len(left)} trainings to go")
    with closing(LocalExecutor(workers).run(task, left)) as ended:
        for number, _ in ended:
            tell(f"trained {left[number].name}")


def _trainer() -> Callable[[Training], None]:
    return _train


def _train(training: Training) -> None:
    """Trains to the end, from the last state that is reached again exactly."""
    out = training.out
    resume = EXACT if (out / EXACT).is_file() else None
    if resume is None and (out / CLONED).is_file():
        (out / FILE).unlink(missing_ok=True)
    elif resume is None:  # the data of a distillation that had not ended are lost
        shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    plan = TrainPlan(
        recipe=training.recipe,
        out=out,
        seed=training.seed,
        resume=resume,
        command=training.command,
    )
    train_rank(plan, Ranks(), lambda line: tell(f"{training.name}: {line}"))
    with written_aside(out / FINISHED) as scratch:
        scratch.write_text(json.dumps(_about(training)) + "\n", encoding="utf-8")


# Evaluation ----------------------------------------------------------------------------------


def evaluations_of(study: Study, scale: str, trainings: list[Training]) -> list[Evaluation]:
    """Returns the evaluations of a study, those of the references last."""
    by_name = {one.name: one for one in trainings}
    found: list[Evaluation] = []
    references: dict[str, Evaluation] = {}
    for arm in study.arms:
        for condition in arm.conditions:
            base = _configured(arm, condition, arm.budgets[scale].episodes)
            for seed in range(arm.budgets[scale].seeds):
                training = by_name[f"{arm.slug}_seed{seed}"].out
                found.append(
                    Evaluation(
                        name="_".join(filter(None, (training.name, slug(condition.name)))),
                        row=", ".join(filter(None, (arm.name, condition.name))),
                        config=replace(base, options={"weights": str(training / BEST)}),
                        measure=arm.measure,
                        arm=arm,
                        condition=condition,
                        training=training,
                    )
                )
            for name, agent in REFERENCES.items():
                references.setdefault(base.env + name, _reference(name, agent, base, arm, study))
    return [*found, *references.values()]


def _configured(arm: Arm, condition: Condition, episodes: int) -> EvalConfig:
    """Returns the evaluation of an arm's policies, without weights."""
    env, delay = arm.recipe.env, condition.delay_steps
    return EvalConfig(
        agent="hab_ppo:policy",
        env=env.env,
        split=SPLIT,
        seed=SEED,
        episodes=episodes,
        skill_config={**env.skill_config, **condition.skill_config},
        env_options={"action_delay_steps": str(delay)} if delay else {},
    )


def _reference(name: str, agent: str, base: EvalConfig, arm: Arm, study: Study) -> Evaluation:
    """Returns the evaluation of a reference, in the skill's own conditions."""
    several = len({arm.recipe.env.env for arm in study.arms}) > 1
    env = base.env.rpartition(":")[2]
    row = f"{env}: {name}" if several else name
    config = replace(
        base,
        agent=agent,
        episodes=min(base.episodes, REFERENCE_EPISODES),
        skill_config={},
        env_options={},
    )
    file = f"{env}_{name}" if several else name
    return Evaluation(name=file.replace(" ", "_"), row=row, config=config, measure=arm.measure)


def kept_evaluation(config: EvalConfig, out: Path, workers: int) -> RunRecord:
    """Returns the record of an evaluation in a folder, played as far as it is missing.

    Raises:
        OptionError: The folder has another evaluation.
    """
    file = out / "run.json"
    if not file.is_file():
        tell(f"evaluating {out.name}")
        begun = (out / "config.json").is_file()
        options = RunOptions(out=out, workers=workers, resume=begun, force=not begun)
        return evaluate(config, options, _Quiet())
    record = read_record(file)
    if (record.env, len(record.episodes)) != (config.env, config.episodes):
        raise OptionError(f"{out} is of another version of the study; give another --out.")
    return record


class _Quiet:
    """Reports no episodes: a study has thousands."""

    def generating(self, done: int, total: int) -> None:
        """See `Reporter`."""

    def running(self, done: int, total: int) -> None:
        """See `Reporter`."""

    def finished(self, finished: object) -> None:
        """See `Reporter`."""
