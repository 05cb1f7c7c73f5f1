"""Grad-CAM of the depth policy of Pick (S F.4; arXiv 1610.02391), with a sanity check.

The network stacks the images of all cameras on channels, so one map belongs to all of them. The map
of one camera is computed with the images of the others at their mean.

A map that the weights do not matter for shows edges of the image, not what was learned. So the maps
are compared with those of the same network with random weights (arXiv 1810.03292).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
import torch
from hab_eval.records.config import EvalConfig
from hab_eval.records.results import write_record
from hab_eval.records.stats import wilson_interval
from hab_eval.run.run_folder import locked
from matplotlib import colormaps
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import interpolate

from hab_ppo.agent import WEIGHTS, LoadedPolicy, load_policy, spec_of
from hab_ppo.commands import StudyCommand
from hab_ppo.network import Policy, new_policy
from hab_ppo.observation import IMAGES, Observation, averaged
from hab_ppo.plan import BEST
from hab_ppo.recipes.pick import PICK_DEPTH
from hab_ppo.rows import Student, VectorRows, binary_entries, policy_rows
from hab_ppo.studies.engine import (
    REFERENCES,
    SEED,
    SPLIT,
    WORK,
    Training,
    kept_evaluation,
    open_study,
    train_all,
)
from hab_ppo.studies.report import write_readme
from hab_ppo.studies.study import FULL, Arm, Budget
from hab_tasks.agent_spaces import agent_setup
from hab_tasks.engine.rollout import Job, play
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.figure_style import new_figure, save
from hab_tasks.io.console import tell
from hab_tasks.io.files import written_aside
from hab_tasks.io.threads import use_one_thread
from hab_tasks.robots.cameras import hidden_links
from hab_tasks.simulator import sapien_object

NAME, AGENT = "f4", "pick_depth"
OTHER = Arm(
    name="another seed",
    recipe=PICK_DEPTH,
    budgets={
        "quick": Budget(steps=0, labelled=(1, 160), training_episodes=8, validation_episodes=1),
        "full": Budget(steps=60_000, labelled=(5, 10_000), evaluations=4),
    },
)
OTHER_SEED, ENV = 1, OTHER.recipe.env.env
SCENES = 3
EPISODES = {"quick": 6, "full": 100}
RANDOM_SEEDS = 3
DISPLACEMENTS = 3
FRAME_PX, FRAMES_PER_S = 160, 10
READING = (
    "Reading: the maps are not those of random weights, but a second seed of the same recipe gives "
    "others in the head camera, and their share on the arm is that of random weights. So this "
    "policy gives no evidence that it tracks its arm, which the paper infers from pictures, with "
    "the caveat that maps are a starting point."
)
"""Of the result at full scale."""

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Frames:
    """What a policy saw in an episode of T steps.

    Attributes:
        scene: The layout.
        seen: Observations of the T steps.
        arm: (T, C, H, W) share of the arm in each pixel of each image.
        held_from: First step with an object in the hand; T if there is none.
    """

    scene: str
    seen: Observation
    arm: Tensor
    held_from: int


def run_grad_cam(options: StudyCommand) -> None:
    """Writes maps, table and README."""
    use_one_thread()
    with locked(options.out):
        open_study(options.out, NAME, options.scale)
        loaded = _loaded(WEIGHTS / f"{AGENT}.safetensors")
        other = _loaded(_another(options) / BEST)
        frames = [_watched(loaded, one) for one in _episodes(options.workers)]
        table = "\n".join(_table(loaded, other, frames))
        maps = [_shown(loaded.policy, one) for one in frames]
        _draw(frames, maps, options.out / f"{NAME}.png")
        _film(frames, maps, options.out / f"{NAME}.mp4")
        solved = _solved(options)
        _write(options, table, solved)
        tell(f"{table}\n{solved}")


# Frames --------------------------------------------------------------------------------------


def _loaded(weights: Path) -> LoadedPolicy:
    return load_policy(agent_setup(ENV), weights)


def _another(options: StudyCommand) -> Path:
    """Trains the recipe with another seed; returns the folder."""
    training = Training(
        name=OTHER.slug,
        recipe=OTHER.recipe_at(options.scale, NAME),
        seed=OTHER_SEED,
        out=options.out / WORK / OTHER.slug,
        command=options.command(),
    )
    train_all([training], options.workers)
    return training.out


def _episodes(workers: int) -> list[Episode]:
    """Returns episodes in different layouts."""
    request = EpisodeRequest(env_id=ENV, split=SPLIT, seed=SEED)
    found: dict[str, Episode] = {}
    for one in load_episodes(request, 4 * SCENES, None, workers).episodes:
        found.setdefault(one.scene_id, one)
    return list(found.values())[:SCENES]


def arm_ids(env: Any) -> list[int]:
    """Returns the entries of the arm's links in segmentation images."""
    links = (sapien_object(env.agent.link(name)) for name in hidden_links(env.agent.spec))
    return [int(np.uint32(link.entity.per_scene_id).astype(np.int16)) for link in links]


class _Watcher(Student):
    """Acts, and keeps what was seen."""

    def __init__(self, policy: Policy, rows: VectorRows, env: Any) -> None:
        super().__init__(policy, rows, None)
        self.seen: list[Observation] = []
        self.arm: list[Tensor] = []
        self.held: list[bool] = []
        self._env, self._ids = env, np.empty(0)

    def act(self, obs: Any) -> NDArray[Any]:
        """See `Student.act`."""
        if not self.seen:
            self._ids = np.array(self._env.call("ask", f"{__name__}:arm_ids")[0])
        layout = self.policy.layout
        seen = layout.read(obs)
        cameras = [path[1] for path in layout.images]
        masks = [np.isin(obs[IMAGES][name]["segmentation"], self._ids) for name in cameras]
        stacked = torch.from_numpy(np.concatenate(masks, axis=-1)).permute(0, 3, 1, 2).float()
        self.arm.append(averaged(stacked, layout.image_block_px))
        self.seen.append(Observation(*(part.clone() for part in seen if part is not None)))
        self.held.append(bool(np.asarray(obs["agent"]["is_holding"]).item()))
        return self.choose(seen)


def _watched(loaded: LoadedPolicy, episode: Episode) -> Frames:
    """Plays an episode."""
    config = loaded.recipe.env
    options = config.options() | {"obs_mode": "depth+segmentation", "split": SPLIT}
    env = policy_rows(config, num_envs=1, num_workers=1, autoreset_mode="Disabled", **options)
    try:
        rows = VectorRows(env)
        watcher = _Watcher(loaded.policy, rows, env)
        list(play(rows, watcher, iter([Job(0, episode)])))
    finally:
        env.close()
    images = [one.images for one in watcher.seen if one.images is not None]
    seen = Observation(torch.cat([one.state for one in watcher.seen]), torch.cat(images))
    held = itertools.compress(itertools.count(), watcher.held)
    return Frames(
        scene=episode.scene_id,
        seen=seen,
        arm=torch.cat(watcher.arm),
        held_from=next(held, len(images)),
    )


# Maps ----------------------------------------------------------------------------------------


def grad_cam(policy: Policy, seen: Observation, camera: int | None = None) -> Tensor:
    """Returns the maps (T, 2, h, w) of displacement and grasp, each at most 1.

    Args:
        policy: A policy with images.
        seen: Observations of T successive steps from the start of an episode.
        camera: Channel of the camera; None for all together.
    """
    memory, starts = _memories(policy, seen)
    shown = seen
    if camera is not None:
        assert policy.image_normalizer is not None
        assert seen.images is not None
        mean = policy.image_normalizer.mean.float().view(1, -1, 1, 1)
        images = mean.expand_as(seen.images).clone()
        images[:, camera] = seen.images[:, camera]
        shown = Observation(seen.state, images)
    found: list[Tensor] = []
    encoder: Any = policy.image_encoder
    last = max(n for n, layer in enumerate(encoder) if isinstance(layer, nn.Conv2d)) + 1
    hook = encoder[last].register_forward_hook(lambda layer, args, out: found.append(out))
    try:
        features, _ = policy.features(shown, starts[None], memory)
        outputs = policy.outputs(features, shown)
    finally:
        hook.remove()
    (active,) = found
    maps = []
    for entry in range(DISPLACEMENTS + 1):
        slope = torch.autograd.grad(outputs[:, entry].sum(), active, retain_graph=True)[0]
        weights = slope.mean(dim=(2, 3), keepdim=True)
        one = (weights * active).sum(dim=1).relu()
        maps.append(one / one.amax(dim=(1, 2), keepdim=True).clamp(min=1e-12))
    moves = torch.stack(maps[:DISPLACEMENTS]).mean(dim=0)
    return torch.stack((moves, maps[DISPLACEMENTS]), dim=1).detach()


def _memories(policy: Policy, seen: Observation) -> tuple[Tensor, Tensor]:
    """Returns the LSTM's state (2, T, H) before each of T steps, and starts (T,) bool."""
    count = len(seen.state)
    starts = torch.zeros(count, dtype=torch.bool)
    starts[0] = True
    memory, found = policy.no_memory(1), []
    for step in range(count):
        found.append(memory)
        one = Observation(*(part[step : step + 1] for part in seen if part is not None))
        memory = policy.choose(one, memory, starts[step : step + 1]).memory
    return torch.cat(found, dim=1), starts


def randomized(loaded: LoadedPolicy, seed: int) -> Policy:
    """Returns the policy's network with random weights and its own normalisers."""
    policy, recipe = loaded.policy, loaded.recipe
    space = agent_setup(recipe.env.env).spaces(spec_of(recipe)).action
    fresh = new_policy(policy.layout, space, policy.config, seed, binary_entries(recipe))
    kept = {k: v for k, v in policy.state_dict().items() if "normalizer" in k}
    fresh.load_state_dict(fresh.state_dict() | kept)
    fresh.state_normalizer.refresh()
    assert fresh.image_normalizer is not None
    fresh.image_normalizer.refresh()
    return fresh


def correlation(a: Tensor, b: Tensor) -> float:
    """Returns the mean rank correlation of maps (T, h, w), without those that are constant."""
    found = []
    for one, other in zip(a.flatten(1).numpy(), b.flatten(1).numpy(), strict=True):
        if np.ptp(one) > 0 and np.ptp(other) > 0:
            ranks = [np.argsort(np.argsort(values, kind="stable")) for values in (one, other)]
            found.append(np.asarray(np.corrcoef(np.stack(ranks)))[0, 1])
    return float(np.mean(found)) if found else 0.0


def on_arm(maps: Tensor, arm: Tensor) -> float:
    """Returns the share of maps (T, h, w) on the arm (T, H, W)."""
    large = interpolate(maps[:, None], arm.shape[-2:], mode="bilinear")[:, 0]
    return float((large * arm).sum() / large.sum().clamp(min=1e-12))


# Report --------------------------------------------------------------------------------------


def _cameras(policy: Policy) -> list[str]:
    return [path[1] for path in policy.layout.images]


def _table(loaded: LoadedPolicy, other: LoadedPolicy, frames: list[Frames]) -> list[str]:
    """Returns the lines of the table, means over all frames."""
    randoms = [randomized(loaded, seed) for seed in range(RANDOM_SEEDS)]
    head = ["camera", "map", "on the arm %", "arm's area %", "random weights, on the arm %"]
    head += ["correlation: random weights", OTHER.name, "among random weights"]
    lines = [head, ["---"] * len(head)]
    for camera, name in enumerate(_cameras(loaded.policy)):
        arm = torch.cat([one.arm[:, camera] for one in frames])
        ours, theirs, *drawn = (
            torch.cat([grad_cam(policy, one.seen, camera) for one in frames])
            for policy in (loaded.policy, other.policy, *randoms)
        )
        for entry, what in enumerate(("displacement", "grasp")):
            own = ours[:, entry]
            pairs = itertools.combinations(drawn, 2)
            random = np.mean([correlation(own, one[:, entry]) for one in drawn])
            among = np.mean([correlation(a[:, entry], b[:, entry]) for a, b in pairs])
            shares = on_arm(own, arm), float(arm.mean())
            fresh = np.mean([on_arm(one[:, entry], arm) for one in drawn])
            line = [name, what, *(f"{100 * share:.0f}" for share in (*shares, fresh))]
            values = (random, correlation(own, theirs[:, entry]), among)
            lines.append(line + [f"{value:.2f}" for value in values])
    return [f"| {' | '.join(line)} |" for line in lines]


def _shown(policy: Policy, frames: Frames) -> Array:
    """Returns pictures (T, H, W, 3) of all cameras side by side, each beside its maps."""
    parts = []
    assert frames.seen.images is not None
    for camera, _ in enumerate(_cameras(policy)):
        gray = 1 - frames.seen.images[:, camera].clamp(0, 0.3) / 0.3  # 3 m
        plain = gray[..., None].repeat(1, 1, 1, 3).numpy()
        maps = interpolate(grad_cam(policy, frames.seen, camera), gray.shape[-2:], mode="bilinear")
        heat = [colormaps["inferno"](maps[:, entry].numpy())[..., :3] for entry in range(2)]
        parts += [plain, *(0.45 * plain + 0.55 * one for one in heat)]
    return np.concatenate(parts, axis=2)


def _draw(frames: list[Frames], pictures: list[Array], out: Path) -> None:
    """Draws a row for each scene, halfway to the grasp."""
    figure = new_figure(6.0, 3.4)
    axes = figure.subplots(len(frames), 1, squeeze=False)[:, 0]
    for axis, one, shown in zip(axes, frames, pictures, strict=True):
        axis.imshow(shown[one.held_from // 2])
        axis.set_ylabel(one.scene.removeprefix("v3_"), fontsize=6)
        axis.set_yticks([])
        axis.set_xticks([])
    side = pictures[0].shape[2] / 6
    names = ("arm camera", "displacement", "grasp", "head camera", "displacement", "grasp")
    axes[0].xaxis.tick_top()
    axes[0].set_xticks([side * (n + 0.5) for n in range(6)], names, fontsize=7)
    axes[0].tick_params(length=0)
    save(figure, out)


def _film(frames: list[Frames], pictures: list[Array], out: Path) -> None:
    """Writes the episodes one after another."""
    with written_aside(out) as scratch:
        writer = imageio.get_writer(
            scratch,
            format="FFMPEG",  # pyright: ignore[reportArgumentType]  # the stub knows no plugin names
            fps=FRAMES_PER_S,
            macro_block_size=2,
        )
        for picture in np.concatenate(pictures):
            large = picture.repeat(2, axis=0).repeat(2, axis=1)
            writer.append_data((255 * large).astype(np.uint8))
        writer.close()


def _solved(options: StudyCommand) -> str:
    """Returns the success of the policy and of the references."""
    config = EvalConfig(
        agent=f"hab_ppo:{AGENT}",
        env=ENV,
        split=SPLIT,
        seed=SEED,
        episodes=EPISODES[options.scale],
    )
    parts = []
    agents = {AGENT: config.agent, **REFERENCES}
    for name, agent in agents.items():
        out = options.out / WORK / name.replace(" ", "_")
        record = kept_evaluation(replace(config, agent=agent), out, options.workers)
        write_record(options.out / f"{out.name}.json", record)
        solved = sum(one.success for one in record.episodes)
        low, high = (100 * end for end in wilson_interval(solved, len(record.episodes)))
        parts.append(f"{name} {solved} of {len(record.episodes)} [{low:.0f}, {high:.0f}]")
    return f"Solved test episodes: {', '.join(parts)}."


def _write(options: StudyCommand, table: str, solved: str) -> None:
    write_readme(
        options.out,
        "# What the depth policy of Pick looks at",
        f"Does Grad-CAM highlight the robot's own arm (S F.4, Fig. 16)? `{options.command()}`",
        f"Maps of the last convolution of `{AGENT}`, for each step of {SCENES} test episodes in "
        "different layouts; those of the three displacements are averaged. The images of the "
        "cameras share one network, so the map of a camera is computed with the other's image at "
        "its mean. Random weights: the same network before training, three seeds; a correlation "
        "(of ranks, mean over steps) near 1 would mean that the weights do not matter. Another "
        f"seed: the recipe of `{AGENT}`, trained again with seed {OTHER_SEED}. {solved}",
        table,
        f"![Depth images with the maps of displacement and grasp]({NAME}.png)",
        f"Video: [{NAME}.mp4]({NAME}.mp4).",
        *[READING] * (options.scale == FULL),
        "Differs from the paper: the policy is distilled from an expert; the paper shows pictures "
        "only, without shares, and without a sanity check. Maps have 4 x 4 cells.",
    )
