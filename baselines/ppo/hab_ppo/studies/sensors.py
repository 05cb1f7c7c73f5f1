"""Studies of what Pick observes: sensors (S F.1) and cameras (S F.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hab_ppo.recipe import FAST, VISUAL, Cloning, Distillation, EnvConfig, Recipe
from hab_ppo.studies.study import Arm, Axis, Budget, Study

PICK = Recipe(
    name="pick",
    about="Pick, distilled from an expert.",
    env=EnvConfig(env="HabPick-v1", control_mode="ee", obs_mode="depth"),
    preset=VISUAL,
    distill=Distillation(
        expert="pick_action", cloning=Cloning(epochs=10, patience=10, bfloat16=True)
    ),
)

QUICK = Budget(steps=0, labelled=(2, 500), training_episodes=60, validation_episodes=4, episodes=8)
FULL = Budget(steps=0, labelled=(5, 8_000), training_episodes=2000)
COLOR = {
    "quick": replace(QUICK, labelled=(1, 160), validation_episodes=1, episodes=2),
    "full": replace(FULL, labelled=(5, 1_600), validation_episodes=10, episodes=100),
}
"""A step with colour is rendered, so there are fewer."""


def _arm(name: str, budgets: dict[str, Budget] | None = None, **env: Any) -> Arm:
    recipe = replace(PICK, env=replace(PICK.env, **env))
    if env.get("obs_mode") == "state_dict":
        recipe = replace(recipe, preset=FAST)
    return Arm(name=name, recipe=recipe, budgets=budgets or {"quick": QUICK, "full": FULL})


SENSORS = Study(
    name="f1",
    title="Sensors of Pick",
    question="Which of depth (D), color (RGB) and proprioception (ps) does Pick need (S F.1, "
    "Fig. 13)?",
    protocol="Policies are distilled from a scripted expert that knows all objects (DAgger). "
    "Rows with RGB have fewer frames and test episodes, since color is rendered in software.",
    differs="70 million steps of PPO and three seeds are out of reach of two cores, so an expert "
    "teaches; rows with and without RGB do not compare at equal frames, and curves are left out.",
    arms=(
        _arm("D+ps"),
        _arm("D", proprioception=False),
        _arm("blind (ps)", obs_mode="state_dict"),
        _arm("RGBD+ps", COLOR, obs_mode="rgb+depth"),
        _arm("RGBD", COLOR, obs_mode="rgb+depth", proprioception=False),
        _arm("RGB+ps", COLOR, obs_mode="rgb"),
        _arm("RGB", COLOR, obs_mode="rgb", proprioception=False),
    ),
    figure=Axis(kind="bars"),
)

CAMERAS = Study(
    name="f3",
    title="Cameras of Pick",
    question="Which camera does Pick need, and does it help to see the arm (S F.3, Fig. 15)?",
    protocol="Policies with depth images and proprioception are distilled from a scripted expert "
    "that knows all objects (DAgger), all with the same budget.",
    differs="70 million steps of PPO and three seeds are out of reach of two cores, so an expert "
    "teaches, and curves are left out.",
    reading="cameras help, and all placements do nearly as well, as in the paper (80 to 90 %, head "
    "and arm 92 %, arm 85 %); their order is within chance. A blind policy comes close, as the "
    "target's position is observed.",
    arms=(
        _arm("head and arm"),
        _arm("arm", cameras=("arm",)),
        _arm("head", cameras=("head",)),
        _arm("third person", cameras=("third_person",)),
        _arm("invisible arm", invisible_arm=True),
        _arm("no camera", obs_mode="state_dict"),
    ),
    figure=Axis(kind="bars"),
)
