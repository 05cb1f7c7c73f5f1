"""Recipes: all that determines a training run, as frozen dataclasses.

A recipe names an environment, a preset of the learner and the length of the run. `PAPER` is the
learner of S App. C, `FAST` one tuned for the wall time on two CPU cores.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar, get_type_hints

from hab_tasks.errors import UnknownNameError

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class EnvConfig:
    """The environment of a policy; see the main README for the options.

    Attributes:
        env: Environment id, ``HabPick-v1``, or ``module:X-v1`` for one of your own.
        control_mode: Control mode of the robot.
        obs_mode: ``state_dict`` for a blind policy; ``depth``, ``rgb`` or ``rgb+depth``.
        target_frame: Frame of the observed target, ``base`` or ``ee``.
        handle_position: Whether the handle of a door or drawer is observed.
        scene_dataset: ``apartment``, or the path of a ReplicaCAD folder.
        objects: Path of a YCB folder; None for the embedded objects.
        split: Split of the training episodes.
        num_episodes: Number of training episodes.
        episode_seed: Seed of the training episodes.
    """

    env: str
    control_mode: str
    obs_mode: str = "state_dict"
    target_frame: str = "base"
    handle_position: bool = False
    scene_dataset: str = "apartment"
    objects: str | None = None
    split: str = "train"
    num_episodes: int = 500
    episode_seed: int = 0

    @property
    def reference(self) -> str:
        """The environment as `gymnasium.make_vec` takes it, ``module:X-v1``."""
        return self.env if ":" in self.env else f"hab_tasks:{self.env}"

    def options(self) -> dict[str, Any]:
        """Returns the options of `gymnasium.make_vec`."""
        options = {field.name: getattr(self, field.name) for field in fields(self)}
        del options["env"]
        options["render_backend"] = "none" if self.obs_mode.startswith("state") else "auto"
        return options


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Sizes of the network of S Figs. 9 and 24.

    Attributes:
        state_layers: Widths of the state encoder; empty for none.
        image_features: Width of the visual encoder's output; unused without images.
        lstm_size: Width of the LSTM; 0 for none.
        head_layers: Widths of the hidden layers of actor and critic each.
        log_std: Initial logarithm of the standard deviation of continuous actions.
    """

    state_layers: tuple[int, ...] = ()
    image_features: int = 256
    lstm_size: int = 0
    head_layers: tuple[int, ...] = (256, 256)
    log_std: float = 0.0


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
    network=NetworkConfig(log_std=-0.5),
    ppo=PPOConfig(
        learning_rate=3e-4,
        decays=False,
        value_weight=0.5,
        entropy_weight=1e-3,
        epochs=4,
        minibatches=4,
        scales_rewards=True,
    ),
    rows=8,
    rollout_steps=200,
)
"""A learner for few CPU cores: two networks of 2 x 256, many gradient steps on each rollout."""

PRESETS = {"paper": PAPER, "fast": FAST}


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
    """

    name: str
    about: str
    env: EnvConfig
    preset: Preset = FAST
    total_steps: int = 2_000_000
    evaluation_steps: int = 100_000
    evaluation_episodes: int = 50
    evaluation_split: str = "val"


def changed(config: T, **values: Any) -> T:
    """Returns a config with those of the values that are not None."""
    given = {name: value for name, value in values.items() if value is not None}
    return replace(config, **given)  # pyright: ignore[reportArgumentType, reportCallIssue]


def to_json(config: Any) -> dict[str, Any]:
    """Returns a config of this module as JSON-serialisable values."""
    return asdict(config)


def from_json(kind: type[T], values: Mapping[str, Any]) -> T:
    """Returns the config of a class from the values of `to_json`.

    Raises:
        UnknownNameError: An entry that the class does not have.
    """
    hints = get_type_hints(kind)
    arguments: dict[str, Any] = {}
    for name, value in values.items():
        if name not in hints:
            raise UnknownNameError(f"entry of {kind.__name__}", name, hints)
        if is_dataclass(hints[name]):
            arguments[name] = from_json(hints[name], value)  # pyright: ignore[reportArgumentType]
        else:
            arguments[name] = tuple(value) if isinstance(value, list) else value
    return kind(**arguments)
