"""Training of the network of `hab_ppo.grounding`, on labeled first views of training episodes."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from hab_eval.records.provenance import device, git_commit
from hab_eval.records.results import RunRecord
from torch import Tensor

from hab_ppo.cards import NOT_EVALUATED, result
from hab_ppo.commands import GroundCommand
from hab_ppo.distributed import compute_threads
from hab_ppo.grounding import (
    CAMERAS,
    HAND,
    PICK_ID,
    PICK_LANGUAGE,
    SHIPPED,
    SIZE_PX,
    SPEC,
    STRIDE_PX,
    WEIGHTS,
    Grounder,
    Seen,
    base_from_cameras,
    find,
    load,
    save,
    seen_by,
    words_of,
)
from hab_ppo.progress import WriteLine
from hab_ppo.recipe import MOST_EPISODES, MOST_RANKS
from hab_tasks.agent_spaces import agent_spaces
from hab_tasks.constants import CAMERA_DEPTH_MAX_M
from hab_tasks.engine.skill_env import SkillEnv
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.episodes.schema import Rearrangement
from hab_tasks.instructions import FIXED, Words
from hab_tasks.io.console import GenerationLines, progress_bar, tell
from hab_tasks.io.files import check_folder
from hab_tasks.io.pool import WorkerPool, in_order
from hab_tasks.option_values import LARGEST_SEED, whole
from hab_tasks.rendering import resolve_backend

WORDINGS = 12
"""Varied instructions that are drawn for each object, besides the fixed one; many are equal."""

MOST_OBJECTS = 8
CHECKED = 200
"""Episodes of layouts that training has not seen, on which the network is measured."""

CHUNK = 50
"""Episodes of a worker's job."""

QUERIES = 6
"""Instructions of a view in a batch."""

BATCH = 16
LEARNING_RATE = 2e-3
FORGOTTEN = 0.1
"""Share of words that are left out, as some of the test's are not known."""

TINT = 0.15
"""Standard deviation of the gain of each color in a picture."""

CENTER_SCALE_M = 0.1
"""Mean error of a center that costs as much as one unit of cross-entropy."""


class Lessons(NamedTuple):
    """First views of E episodes by C cameras.

    Attributes:
        color: (E, C, H, W, 3) uint8.
        depth_mm: (E, C, H, W) int16, 0 without a return.
        objects: (E, C, h, w) uint8, number of the object at each feature from 1, 0 elsewhere.
        poses: (E, C, 4, 4) float32 poses of the cameras in the base frame.
        centers_m: (E, K, 3) float32 centers of mass of the objects in the base frame, zeros of
            those that an episode lacks.
        told: Of each episode: instruction -> the objects that it may mean, as bits.
    """

    color: Tensor
    depth_mm: Tensor
    objects: Tensor
    poses: Tensor
    centers_m: Tensor
    told: list[dict[str, int]]

    @classmethod
    def joined(cls, several: Iterable[Lessons]) -> Lessons:
        """Returns several together."""
        columns = zip(*several, strict=True)
        *tensors, told = columns
        return cls(*[torch.cat(one) for one in tensors], told=list(chain.from_iterable(told)))


class Batch(NamedTuple):
    """Lessons with Q instructions each.

    Attributes:
        seen: The images.
        told: (E, Q, words).
        meant: (E, Q, C, h, w) bool, where what an instruction may mean is seen.
        centers_m: (E, C, h, w, 3) true centers of the objects seen.
        on_object: (E, C, h, w) bool.
    """

    seen: Seen
    told: Tensor
    meant: Tensor
    centers_m: Tensor
    on_object: Tensor


# Views ---------------------------------------------------------------------------------------


def look(request: EpisodeRequest, episodes: Sequence[Episode]) -> Lessons:
    """Renders the first views of episodes; in a process of its own."""
    env: Any = gym.make(
        f"hab_tasks:{PICK_ID}",
        split=request.split,
        scene_dataset=request.scene_dataset,
        objects=request.objects,
        num_episodes=1,
        obs_mode="rgb+depth+segmentation",
        cameras=CAMERAS,
        camera_size_px=SIZE_PX,
        depth="mm",
        targets="language",
    )
    try:
        return Lessons.joined([_lesson(env, episode) for episode in episodes])
    finally:
        env.close()


def _lesson(env: Any, episode: Episode) -> Lessons:
    obs, _ = env.reset(options={"episode": episode})
    base = env.unwrapped
    images = [obs["sensor_data"][name] for name in CAMERAS]
    color, depth_mm, actors = (
        torch.stack([image[kind] for image in images], dim=1)
        for kind in ("rgb", "depth", "segmentation")
    )
    names = list(episode.objects)[:MOST_OBJECTS]
    objects = torch.zeros_like(actors)
    for number, actor in base.segmentation_id_map.items():
        if actor.name in names:
            objects[actors == int(np.uint32(number).astype(np.int16))] = names.index(actor.name) + 1
    (state,) = base.privileged()
    centers_m = torch.zeros(1, MOST_OBJECTS, 3)
    base_from_world = np.linalg.inv(state.world_from_base)
    for k, name in enumerate(names):
        center_m = base_from_world @ np.append(state.object_com_m[name], 1.0)
        centers_m[0, k] = torch.from_numpy(center_m[:3])
    return Lessons(
        color=color,
        depth_mm=depth_mm[..., 0],
        objects=objects[:, :, ::STRIDE_PX, ::STRIDE_PX, 0].to(torch.uint8),
        poses=base_from_cameras(agent_spaces(PICK_ID, SPEC).cameras, obs["agent"]),
        centers_m=centers_m,
        told=[instructions_of(type(base), episode)],
    )


def instructions_of(env: type[SkillEnv], episode: Episode) -> dict[str, int]:
    """Returns instructions for each object, and the objects that each may mean, as bits.

    In the fixed wording, objects of one kind have the same.
    """
    found: dict[str, int] = {}
    for k, name in enumerate(list(episode.objects)[:MOST_OBJECTS]):
        asked = Rearrangement(object=name, start=episode.targets[0].start)
        drawn = (Words(seed=episode.seed + n) for n in range(WORDINGS))
        for said in {env.instruct(replace(episode, targets=(asked,)), w) for w in (FIXED, *drawn)}:
            found[said] = found.get(said, 0) | 1 << k
    return found


def lessons_of(request: EpisodeRequest, count: int, workers: int) -> Lessons:
    """Returns the first views of `count` episodes, layout by layout."""
    with progress_bar(" episodes", GenerationLines(tell).show) as show:
        made = load_episodes(request, count, show, workers)
    episodes = sorted(made.episodes, key=lambda one: one.scene_id)
    jobs = [episodes[first : first + CHUNK] for first in range(0, count, CHUNK)]
    with WorkerPool(workers, partial, (look, request)) as pool:
        return Lessons.joined(in_order(pool.run(jobs)))


# Learning ------------------------------------------------------------------------------------


def batch_of(
    network: Grounder, lessons: Lessons, chosen: Sequence[int], rng: np.random.Generator
) -> Batch:
    """Returns lessons with instructions that are drawn."""
    objects = lessons.objects[chosen].long()
    known = [sorted(lessons.told[number].items()) for number in chosen]
    drawn = [[told[n] for n in rng.integers(len(told), size=QUERIES)] for told in known]
    told = torch.stack([network.bag(said for said, _ in queries) for queries in drawn])
    bits = torch.tensor([[bits for _, bits in queries] for queries in drawn])[
        :, :, None, None, None
    ]
    meant = (bits << 1 >> objects[:, None]) & 1  # bit 0 is of no object
    rows = torch.arange(len(chosen))[:, None, None, None]
    return Batch(
        seen=seen_of(lessons, chosen),
        told=told,
        meant=meant.bool(),
        centers_m=lessons.centers_m[chosen][rows, (objects - 1).clamp(min=0)],
        on_object=objects > 0,
    )


def seen_of(lessons: Lessons, chosen: Sequence[int]) -> Seen:
    """Returns what the network sees of the lessons with these numbers."""
    depth_mm = lessons.depth_mm[chosen].float()
    depth_m = torch.where(depth_mm > 0, depth_mm / 1000.0, CAMERA_DEPTH_MAX_M)
    depth_m = depth_m.clamp(max=CAMERA_DEPTH_MAX_M)
    camera = agent_spaces(PICK_ID, SPEC).cameras["head"]
    return seen_by(camera, lessons.color[chosen], depth_m, lessons.poses[chosen])


def loss_of(network: Grounder, batch: Batch) -> Tensor:
    """Returns the loss of a batch: of where objects are found, and of their centers.

    Of the cells in which what is meant is seen, any may be chosen.
    """
    logits, centers_m = network(batch.seen, batch.told)
    visible = batch.meant.flatten(2).any(dim=2)
    others = logits.masked_fill(~batch.meant, -torch.inf)
    missed = logits.flatten(2).logsumexp(dim=2) - others.flatten(2).logsumexp(dim=2)
    away_m = (centers_m - batch.centers_m)[batch.on_object].abs().mean()
    return missed[visible].mean() + away_m / CENTER_SCALE_M


def fit(network: Grounder, lessons: Lessons, epochs: int, seed: int, write_line: WriteLine) -> None:
    """Fits a network to lessons."""
    rng, torch_rng = np.random.default_rng(seed), torch.Generator().manual_seed(seed)
    optimizer = torch.optim.AdamW(network.parameters(), LEARNING_RATE)
    steps = len(lessons.told) // BATCH
    plan = torch.optim.lr_scheduler.OneCycleLR(optimizer, LEARNING_RATE, epochs * steps)
    for epoch in range(epochs):
        order, losses = rng.permutation(len(lessons.told)), []
        for chosen in order[: steps * BATCH].reshape(steps, BATCH).tolist():
            loss = loss_of(network, _varied(batch_of(network, lessons, chosen, rng), torch_rng))
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            plan.step()
            losses.append(loss.item())
        write_line(f"epoch {epoch + 1} of {epochs}: loss {np.mean(losses):.3f}")


def _varied(batch: Batch, rng: torch.Generator) -> Batch:
    """Returns a batch with words left out and colors changed."""
    kept = torch.rand(batch.told.shape, generator=rng) >= FORGOTTEN
    gain = 1.0 + TINT * torch.randn(len(batch.seen.color), 1, 1, 3, generator=rng)
    color = (batch.seen.color * gain).clamp(0.0, 255.0)
    return batch._replace(seen=batch.seen._replace(color=color), told=batch.told * kept)


def measure(network: Grounder, lessons: Lessons) -> Tensor:
    """Returns of each instruction whether the place found is on what is meant, if that is seen."""
    right = []
    for number, told in enumerate(lessons.told):
        bits = torch.tensor([bits for _, bits in sorted(told.items())])[:, None]
        found = find(network, seen_of(lessons, [number]), network.bag(sorted(told))[None])
        objects = lessons.objects[number].flatten().long()
        meant = bits << 1 >> objects & 1
        hit = meant.gather(1, found.cells[0][:, None])[:, 0]
        right.append(hit[meant.any(dim=1)])
    return torch.cat(right).bool()


# The command ---------------------------------------------------------------------------------


def run(options: GroundCommand) -> int:
    """Trains."""
    whole("--episodes", options.episodes, BATCH, MOST_EPISODES)
    whole("--epochs", options.epochs, 1, MOST_EPISODES)
    whole("--workers", options.workers, 1, MOST_RANKS)
    whole("--seed", options.seed, 0, LARGEST_SEED)
    check_folder(options.out, force=options.force, mark=WEIGHTS)
    resolve_backend("auto", wants_images=True)  # no renderer: said before episodes are made
    command = shlex.join(["hab-ppo", *sys.argv[1:]])
    origin = {"command": command, "device": device(), "git": git_commit()}
    began_s = time.perf_counter()
    request = EpisodeRequest(
        env_id=PICK_ID,
        split="train",
        scene_dataset=options.scene_dataset,
        objects=options.objects,
    )
    lessons = lessons_of(request, options.episodes, options.workers)
    tell(f"rendered {len(lessons.told)} episodes; {(time.perf_counter() - began_s) / 60:.1f} min")
    network = new_network(lessons, options.seed)
    with compute_threads(options.workers):
        fit(network, lessons, options.epochs, options.seed, tell)
    unseen = lessons_of(replace(request, split="val"), CHECKED, options.workers)
    right = measure(network, unseen)
    about = {
        "origin": origin,
        "seconds": time.perf_counter() - began_s,
        "episodes": options.episodes,
        "scene_dataset": options.scene_dataset,
        "right": [int(right.sum()), len(right)],
    }
    save(options.out / WEIGHTS, network, about)
    tell(f"wrote {options.out / WEIGHTS}: {_told(about)}")
    return 0


def new_network(lessons: Lessons, seed: int) -> Grounder:
    """Returns a network that knows the words of lessons; the global random state is kept."""
    words = {word for told in lessons.told for said in told for word in words_of(said)}
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return Grounder(sorted(words))


def _told(about: dict[str, Any]) -> str:
    right, count = about["right"]
    return (
        f"right object in {right:,} of {count:,} instructions, "
        f"{CHECKED} episodes of val layouts; {about['seconds'] / 60:.0f} min"
    )


# Shipping, for `hab-ppo ship` and `hab-ppo cards` --------------------------------------------


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a run of `hab-ppo ground`."""
    return (folder / WEIGHTS).is_file()


def ship(folder: Path) -> Path:
    """Copies the weights of a run to the package; returns the file.

    Raises:
        PolicyFileError: The file cannot be used.
    """
    save(SHIPPED, *load(folder / WEIGHTS))
    return SHIPPED


def cards(records: Iterable[RunRecord]) -> dict[Path, str]:
    """Returns the file and the text of the model card; nothing if no weights ship."""
    if not SHIPPED.is_file():
        return {}
    _, about = load(SHIPPED)
    origin = about["origin"]
    commit, dash, dirty = str(origin["git"]).partition("-")
    own = [r for r in records if r.agent == f"hab_ppo:{PICK_LANGUAGE}" and not r.options]
    lines = [
        f"# {PICK_LANGUAGE}",
        "",
        f"Pick what the instruction names, from color and depth images; the hand is `{HAND}`'s.",
        "",
        f"- Run: `hab-eval run --agent hab_ppo:{PICK_LANGUAGE} --env {PICK_ID} --out DIR`",
        f"- Weights: {SHIPPED.stat().st_size / 1e6:.1f} MB, {len(about['words'])} words",
        f"- Trained: `{origin['command']}` (commit {commit[:8]}{dash}{dirty}, {origin['device']})",
        f"- Data: {about['episodes']:,} episodes, train layouts of {about['scene_dataset']}",
        f"- Found: {_told(about)}",
        "",
        "Success % [95 % interval], failures:",
        "",
    ]
    lines += [result(record) for record in own] or [NOT_EVALUATED]
    return {SHIPPED.with_suffix(".md"): "\n".join(lines) + "\n"}
