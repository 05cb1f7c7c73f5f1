"""The console script `hab-spa`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from hab_eval.episode_options import EpisodeOptions

from hab_tasks.errors import HabError
from hab_tasks.options import one_line, parse_only_command

EXIT_BAD_INPUT = 2
EXIT_STOPPED = 1
EXIT_INTERRUPTED = 130

MOST_FOR_EACH = 10
"""Give up, unless told otherwise, after so many episodes for each demonstration wanted."""

RECORD_HELP = """Records episodes that an agent solves, as a ManiSkill trajectory.

Example:
  hab-spa record --agent hab_spa:spa_priv --env HabPick-v1 --count 10 --out runs/demonstrations
  python -m mani_skill.trajectory.replay_trajectory --traj-path runs/demonstrations/trajectory.h5

Any agent will do, also one of your own. Episodes are played in order until enough are solved."""


@dataclass(frozen=True, kw_only=True)
class RecordCommand(EpisodeOptions):
    """Options of `hab-spa record`."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder for trajectory.h5 and trajectory.json."""
    split: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = "train"
    """Episode split; the others are for evaluation."""
    count: Annotated[int, tyro.conf.arg(metavar="N")] = 10
    """Number of demonstrations."""
    most: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Give up after so many episodes, instead of ten for each demonstration."""
    lerobot: bool = False
    """Write LeRobot's dataset format (v3.0) as well, into DIR/lerobot; needs pyarrow."""
    force: bool = False
    """Replace the recording in DIR."""

    def run(self) -> int:
        """Records, and shows how each episode went."""
        # Loading the simulator takes seconds, which --help and a mistyped option should not.
        from hab_eval.results import EpisodeResult

        from hab_spa.recording.record import RecordPlan, record

        most = MOST_FOR_EACH * self.count if self.most is None else self.most
        plan = RecordPlan(
            config=self.config_of(self.count),
            out=self.out,
            most=most,
            lerobot=self.lerobot,
            force=self.force,
        )

        def tell(result: EpisodeResult) -> None:
            ended = "solved" if result.success else f"failed: {result.failure}"
            print(f"{result.id}: {ended}, {result.steps} steps", flush=True)

        recorded = record(plan, tell)
        for failure, number in sorted(recorded.failures.items()):
            print(f"{number} of {recorded.episodes} episodes failed: {failure}")
        for file in recorded.files:
            print(f"wrote {file}")
        print(f"{recorded.demonstrations} of {self.count} demonstrations")
        return 0 if recorded.demonstrations == self.count else EXIT_STOPPED


COMMANDS = {"record": RecordCommand}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-spa`; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    from hab_eval.errors import RunStoppedError

    try:
        if not arguments or arguments[0].startswith("-"):  # --help, or nothing
            print(f"usage: hab-spa record --agent M:F --env ID --out DIR\n\n{RECORD_HELP}")
            return 0 if arguments else EXIT_BAD_INPUT
        command = parse_only_command("hab-spa", COMMANDS, arguments, RECORD_HELP)
        return command.run()
    except RunStoppedError as error:
        print(f"{error.details}hab-spa: {error} Nothing was written.", file=sys.stderr)
        return EXIT_STOPPED
    except HabError as error:
        print(f"hab-spa: {one_line(error)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("hab-spa: interrupted; nothing was written.", file=sys.stderr)
        return EXIT_INTERRUPTED
