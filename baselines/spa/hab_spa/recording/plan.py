"""Options of a recording."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import get_args

from hab_eval.records.config import EvalConfig

from hab_tasks.agent import AgentSpec, Targets
from hab_tasks.constants import CAMERA_SIZE_PX
from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.io.executors import ExecutorChoice
from hab_tasks.option_values import MOST_WORKERS, whole

NAME = "trajectory"
LEROBOT = "lerobot"

IMAGES = ("rgb", "depth", "rgb+depth")


@dataclass(frozen=True, kw_only=True)
class Views:
    """Images that a recording adds to what its agent observes.

    Attributes:
        obs_mode: One of `IMAGES`.
        cameras: Names of the cameras; None for the environment's.
        size_px: Width and height.
    """

    obs_mode: str
    cameras: tuple[str, ...] | None = None
    size_px: int = CAMERA_SIZE_PX

    def __post_init__(self) -> None:
        if self.obs_mode not in IMAGES:
            raise UnknownNameError("--obs-mode of a recording", self.obs_mode, IMAGES)

    def added_to(self, spec: AgentSpec) -> AgentSpec:
        """Returns the spec of an environment that can also render these images.

        Raises:
            OptionError: The agent's observation is not `state_dict`.
        """
        if spec.obs_mode != "state_dict":
            raise OptionError(
                f"--obs-mode {self.obs_mode} needs an agent that observes state_dict; {spec.name} "
                f"observes {spec.obs_mode}. Without --obs-mode, its own images are recorded."
            )
        return replace(
            spec,
            obs_mode=self.obs_mode,
            cameras=self.cameras,
            camera_size_px=self.size_px,
            looks="on demand",
        )


@dataclass(frozen=True, kw_only=True)
class RecordPlan:
    """Options of a recording.

    Attributes:
        config: Agent, environment and episode set; `config.episodes` is the number of
            demonstrations.
        out: Output folder.
        most: Maximum number of episodes.
        lerobot: Also write a LeRobot dataset, to the folder `lerobot`.
        targets: Whether the LeRobot dataset has ``positions`` of targets, or ``language`` only.
        views: Images of the LeRobot dataset; None for those that the agent observes.
        force: Overwrite files in `out`.
        workers: Number of workers.
        executor: Where the episodes are played.
    """

    config: EvalConfig
    out: Path
    most: int
    lerobot: bool = False
    targets: str = "positions"
    views: Views | None = None
    force: bool = False
    workers: int = 1
    executor: ExecutorChoice = field(default_factory=ExecutorChoice)

    def __post_init__(self) -> None:
        self.executor.check_executor()
        whole("workers", self.workers, 1, MOST_WORKERS)
        if self.targets not in get_args(Targets):
            raise UnknownNameError("--targets", self.targets, get_args(Targets))
        if self.views is not None and not self.lerobot:
            raise OptionError(
                "--obs-mode needs --lerobot. ManiSkill's trajectories hold states, of which "
                "mani_skill.trajectory.replay_trajectory --obs-mode rgb renders images."
            )
        if self.most < self.config.episodes:
            raise OptionError(
                f"most must be at least count, {self.config.episodes}, got {self.most}."
            )
