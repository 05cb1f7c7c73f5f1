"""Recipes: all that determines a training run, as frozen dataclasses.

A recipe names an environment, a preset of the learner and the length of the run. `PAPER` is the
learner of S App. C, `FAST` one tuned for the wall time on two CPU cores.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

from hab_tasks.errors import HabError
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.spec import robot_of, robot_reference

T = TypeVar("T")

MOST_RANKS = 256
MOST_ROWS = 4096
MOST_EPISODES = 1_000_000
MOST_STEPS = 10**12
"""Largest values of the commands' options."""


class RecipeError(HabError):
    """A recipe that cannot be trained as asked."""


@dataclass(frozen=True, kw_only=True)
class EnvConfig:
    """The environment of a policy; docs/options.md describes the options.

    Attributes:
        env: Environment id, ``HabPick-v1``, or ``module:X-v1`` for one of your own.
        trained_in: Environment of the training, if it is another one: the same skill from other
            start states, such as those of `hab_ppo.fridge_starts`. Evaluations are in `env`.
        control_mode: Control mode of the robot.
        robot: Name of the robot, or ``module:uid`` of one of your own; None for Fetch.
        obs_mode: ``state_dict`` for a blind policy; ``depth``, ``rgb`` or ``rgb+depth``.
        target_frame: Frame of the observed target, ``base`` or ``ee``.
        handle_position: Whether the handle of a door or drawer is observed.
        proprioception: Whether proprioception is observed.
        cameras: Names of the observed cameras; None for the environment's.
        invisible_arm: Whether the cameras do not show the arm.
        skill_config: Reward weights and thresholds of the training, name -> number.
        action_delay_steps: Delay of the actions in training.
        action_repeat: Number of environment steps for which each action of the policy is executed;
            the policy observes the last of them. Steps of a run are actions of the policy.
        scene_dataset: ``apartment``, or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder; None for the embedded objects.
        split: Split of the training episodes.
        num_episodes: Number of training episodes.
        episode_seed: Seed of the training episodes.
    """

    env: str
    control_mode: str
    robot: str | None = None
    trained_in: str | None = None
    obs_mode: str = "state_dict"
    target_frame: str = "base"
    handle_position: bool = False
    proprioception: bool = True
    cameras: tuple[str, ...] | None = None
    invisible_arm: bool = False
    skill_config: dict[str, float] = field(default_factory=dict)
    action_delay_steps: int = 0
    action_repeat: int = 1
    scene_dataset: str = "apartment"
    objects: str | None = None
    split: str = "train"
    num_episodes: int = 500
    episode_seed: int = 0

    @property
    def reference(self) -> str:
        """The environment as `gymnasium.make_vec` takes it, ``module:X-v1``."""
        return self.env if ":" in self.env else f"hab_tasks:{self.env}"

    @property
    def training_reference(self) -> str:
        """The environment of the training, likewise."""
        return self.trained_in or self.reference

    @property
    def robot_reference(self) -> str:
        """The robot's `robot_reference`."""
        return robot_reference(robot_of(self.robot or DEFAULT_ROBOT.uid))

    def options(self) -> dict[str, Any]:
        """Returns the options of the single environment."""
        options = {field.name: getattr(self, field.name) for field in fields(self)}
        for name in ("env", "trained_in", "action_repeat"):
            del options[name]
        options["render_backend"] = "none" if self.obs_mode.startswith("state") else "auto"
        return options


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Sizes of the network of S Figs. 9 and 24.

    Attributes:
        state_layers: Widths of the state encoder; empty for none.
        image_features: Width of the visual encoder's output; unused without images.
        image_block_px: Side of the square blocks of pixels that are averaged before the encoder.
        lstm_size: Width of the LSTM; 0 for none.
        head_layers: Widths of the hidden layers of actor and critic each.
        log_std: Initial logarithm of the standard deviation of continuous actions.
        gripper_persistence: Logit at the start of training with which the gripper stays closed
            while it holds something, and open while it does not. Its action is then drawn as open
            or closed; with None, it is from a Gaussian of which the environment reads the sign.
    """

    state_layers: tuple[int, ...] = ()
    image_features: int = 256
    image_block_px: int = 1
    lstm_size: int = 0
    head_layers: tuple[int, ...] = (256, 256)
    log_std: float = 0.0
    gripper_persistence: float | None = None


@dataclass(frozen=True, kw_only=True)
class PPOConfig:
    """Parameters of the update; defaults are those of S App. C.2.

    Attributes:
        learning_rate: Of Adam.
        decays: Whether the learning rate falls linearly to 0 over the run.
        discount: Gamma.
        gae: Lambda of generalised advantage estimation.
        clip: Largest change of the probability ratio that is rewarded.
        value_weight: Weight of the value loss.
        entropy_weight: Weight of the entropy bonus.
        epochs: Passes over the data of an update.
        minibatches: Gradient steps in each pass.
        max_gradient_norm: Gradients are scaled down to this norm.
        scales_rewards: Whether rewards are divided by the running standard deviation of the
            discounted return.
        final_log_std: Logarithm of the standard deviation of continuous actions at the end of the
            run, to which it falls linearly from `NetworkConfig.log_std` (after a warm start, from
            `FineTuning.log_std`); None to learn it.
        noise_correlation: Correlation of the noise of successive steps (`ActionNoise`).
    """

    learning_rate: float = 1e-4
    decays: bool = True
    discount: float = 0.99  # the paper does not say; Habitat's
    gae: float = 0.95  # likewise
    clip: float = 0.2
    value_weight: float = 0.1
    entropy_weight: float = 1e-4
    epochs: int = 2
    minibatches: int = 2
    max_gradient_norm: float = 0.5
    scales_rewards: bool = False
    final_log_std: float | None = None
    noise_correlation: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Preset:
    """A learner: network, update, and the data that an update takes.

    Attributes:
        network: Sizes of the network.
        ppo: Parameters of the update.
        rows: Number of simulations of each rank.
        rollout_steps: Steps of each row in an update.
    """

    network: NetworkConfig
    ppo: PPOConfig
    rows: int
    rollout_steps: int


PAPER = Preset(
    network=NetworkConfig(
        state_layers=(512,), image_features=512, lstm_size=512, head_layers=(), log_std=0.0
    ),
    ppo=PPOConfig(),
    rows=16,
    rollout_steps=128,
)
"""The learner of S App. C; what the paper leaves open (widths, rollouts) is Habitat's."""

FAST = Preset(
    network=NetworkConfig(log_std=-0.5, gripper_persistence=4.0),
    ppo=PPOConfig(
        learning_rate=3e-4,
        value_weight=0.5,
        entropy_weight=1e-3,
        epochs=4,
        minibatches=4,
        scales_rewards=True,
        final_log_std=-2.0,
        noise_correlation=0.8,
    ),
    rows=8,
    rollout_steps=200,
)
"""A learner for few CPU cores: two networks of 2 x 256, many gradient steps on each rollout."""

RECURRENT = replace(
    FAST, network=replace(FAST.network, state_layers=(256,), lstm_size=128, head_layers=())
)
"""`FAST` with an LSTM, for policies whose observation does not tell in which phase they are: a
drawer that does not move any more is closed."""

VISUAL = Preset(
    network=replace(
        FAST.network, state_layers=(256,), image_block_px=2, lstm_size=256, head_layers=()
    ),
    ppo=replace(FAST.ppo, epochs=2, minibatches=2),
    rows=8,
    rollout_steps=100,
)
"""A learner for images on few CPU cores, with one network for actor and critic: two visual encoders
would take twice the time, and images of 128 x 128 pixels four times that of 64 x 64."""

PRESETS = {"paper": PAPER, "fast": FAST, "recurrent": RECURRENT, "visual": VISUAL}


@dataclass(frozen=True, kw_only=True)
class Cloning:
    """How a network is fitted to actions.

    Attributes:
        epochs: Most passes over the data.
        learning_rate: Of Adam.
        batch_steps: Steps in a gradient step; a network with an LSTM takes whole episodes until
            they have this many.
        held_out: Share of the episodes that is not fitted but decides when to stop.
        patience: Epochs without improvement on these after which the fit ends.
        bfloat16: Whether layers are computed in bfloat16 where PyTorch thinks that it is enough
            and the hardware has instructions for it.
    """

    epochs: int = 40
    learning_rate: float = 1e-3
    batch_steps: int = 1000
    held_out: float = 0.1
    patience: int = 15
    bfloat16: bool = False


@dataclass(frozen=True, kw_only=True)
class FineTuning:
    """How PPO continues from a policy that can do something, without losing it.

    Attributes:
        log_std: Logarithm of the standard deviation of continuous actions at the start.
        critic_updates: Number of updates at the start in which only the value head learns.
        kl_weight: Weight of KL(start || policy) at the start.
        kl_steps: Environment steps in which this weight falls linearly to 0.
    """

    log_std: float = -1.2
    critic_updates: int = 10
    kl_weight: float = 0.5
    kl_steps: int = 500_000


@dataclass(frozen=True, kw_only=True)
class WarmStart:
    """Cloning of an agent's demonstrations before PPO.

    Attributes:
        agent: ``module:factory`` of the agent, as in ``hab-eval run``.
        demonstrations: Number of demonstrations.
        noise: Standard deviation of the noise on the actions of the demonstrations, as a share of
            the largest action.
        cloning: The fit.
        rounds: Rounds of practice: the clone plays demonstrated episodes, the states that it visits
            are labelled by their paths, and it is fitted again to all data.
        lessons: Number of episodes of a round.
        refitting: The fit of each round.
        tuning: PPO afterwards.
    """

    agent: str = "hab_spa:spa_priv"
    demonstrations: int = 200
    noise: float = 0.5
    cloning: Cloning = field(default_factory=Cloning)
    rounds: int = 4
    lessons: int = 100
    refitting: Cloning = field(default_factory=lambda: Cloning(epochs=20, patience=5))
    tuning: FineTuning = field(default_factory=FineTuning)


@dataclass(frozen=True, kw_only=True)
class Distillation:
    """DAgger (arXiv 1011.0686) before PPO: a teacher labels the states that the student visits.

    Attributes:
        teacher: Name of a recipe whose weights ship, or the path of weights or of a run's folder;
            None for an expert.
        expert: Name of an expert in `hab_experts`, such as ``shortest_path_action``.
        rounds: Number of rounds; after each, the student is fitted to the data of all rounds.
        round_steps: Environment steps of a round.
        beta: Share of the first round's steps in which the teacher acts; in later rounds the
            student acts alone.
        most_mb: Most memory of the data [MB]; beyond it, the oldest episodes are dropped.
        cloning: The fit of each round.
        tuning: PPO afterwards.
    """

    teacher: str | None = None
    expert: str | None = None
    rounds: int = 5
    round_steps: int = 10_000
    beta: float = 1.0
    most_mb: int = 4000
    cloning: Cloning = field(default_factory=lambda: Cloning(epochs=10, patience=10))
    tuning: FineTuning = field(default_factory=FineTuning)


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """A training run.

    Attributes:
        name: Name of the policy.
        about: What is trained, in a sentence.
        env: The environment.
        preset: The learner.
        total_steps: Environment steps of the run, all ranks together.
        evaluation_steps: Steps between evaluations; after each, all rows start anew and an exact
            checkpoint is kept.
        evaluation_episodes: Number of episodes in an evaluation.
        evaluation_split: Their split.
        draws_actions: Whether a policy's actions are drawn also where it is evaluated and used, as
            in Habitat; else they are the most likely ones, of which a policy with discrete actions
            may repeat the same forever.
        warm_start: Cloning before PPO; None to start from random weights.
        distill: Distillation before PPO; likewise.
    """

    name: str
    about: str
    env: EnvConfig
    preset: Preset = FAST
    total_steps: int = 2_000_000
    evaluation_steps: int = 100_000
    evaluation_episodes: int = 50
    evaluation_split: str = "val"
    draws_actions: bool = False
    warm_start: WarmStart | None = None
    distill: Distillation | None = None

    def __post_init__(self) -> None:
        if self.warm_start is not None and self.distill is not None:
            raise RecipeError(f"Recipe {self.name} has both warm_start and distill; give one.")
        if self.warm_start is not None and self.env.action_repeat > 1:
            raise RecipeError(
                f"Recipe {self.name} has action_repeat {self.env.action_repeat}; demonstrations of "
                "warm_start need 1."
            )

    def log_std(self, progress: float) -> float | None:
        """Returns the fixed spread of continuous actions at a share of the run; None if learned."""
        last = self.preset.ppo.final_log_std
        if last is None:
            return None
        first = self.preset.network.log_std if self.tuning is None else self.tuning.log_std
        return first + min(1.0, progress) * (last - first)

    @property
    def tuning(self) -> FineTuning | None:
        """How PPO continues from a clone; None if it starts from random weights."""
        start = self.warm_start or self.distill
        return None if start is None else start.tuning


def changed(config: T, **values: Any) -> T:
    """Returns a config with those of the values that are not None."""
    given = {name: value for name, value in values.items() if value is not None}
    return replace(config, **given)  # pyright: ignore[reportArgumentType, reportCallIssue]
