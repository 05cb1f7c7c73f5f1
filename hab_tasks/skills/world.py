"""The simulated world of a skill: layouts, episodes, grasp, and one snapshot for each action."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np
import torch
from mani_skill.envs.scene import ManiSkillScene
from torch import Tensor

from hab_tasks.episodes.apply import apply_episode
from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import EpisodeSource
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.measures import Tracker
from hab_tasks.privileged import CollisionBody, PrivilegedState
from hab_tasks.robots.dormant import DormantObjects
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.grasp import Handle, make_grasp
from hab_tasks.scenes.handles import SceneHandles
from hab_tasks.scenes.lights import LayoutLights
from hab_tasks.scenes.markers import HANDLE_MARKERS
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.scenes.shapes import components, matrix, read_body
from hab_tasks.sensors import Goals
from hab_tasks.snapshot import ContactForce, Snapshot, SnapshotReader

_shows = count()


class World:
    """Shows layouts, applies episodes and steps physics; holds the latest `Snapshot`.

    Attributes:
        episodes: The episode of each row.
        handles: What is shown; all rows of a batch play in the same layout.
        tracker: Advances the measures.
        goals: What the episodes ask for.
        snapshot: The simulator as read after the latest action or reset.
    """

    tracker: Tracker
    goals: Goals
    handles: SceneHandles
    snapshot: Snapshot
    _scene: ManiSkillScene
    _agent: HabFetch
    _pool: BodyPool
    _dormant: DormantObjects | None

    def __init__(
        self, source: EpisodeSource, num_episodes: int, num_envs: int, *, prefetch: bool = False
    ) -> None:
        """Plays episodes of `source`; with `prefetch`, builds all its layouts at the start."""
        self.source, self._prefetch = source, prefetch
        self._num_episodes = min(num_episodes, source.available)
        self._order = np.random.default_rng(source.seed)
        self.episodes: list[Episode] = []
        self._built = False
        self._layout, self._objects = "", ()
        self._loose: dict[str, Pose7] = {}
        self._num_envs = num_envs
        self._key = ""
        self._bodies: tuple[CollisionBody, ...] = ()

    # Choosing and building -------------------------------------------------------------------

    def choose(self, rows: list[int], seed: int | list[int] | None, wanted: Any) -> bool:
        """Picks the next episode of each row; returns whether the simulation has to be rebuilt."""
        seeds = [seed] * len(rows) if seed is None or isinstance(seed, int) else list(seed)
        wishes = wanted if isinstance(wanted, (list, tuple)) else [wanted] * len(rows)
        # A batch shares one layout; a partial reset goes on in the one there is.
        partial = len(rows) < self._num_envs
        layout = self._layout if partial else None
        chosen: list[Episode | None] = [*self.episodes] or [None] * self._num_envs
        for row, row_seed, wish in zip(rows, seeds, wishes, strict=True):
            # Rows of one batch share a seed argument but not an episode.
            rng = self._order if row_seed is None else np.random.default_rng([row_seed, row])
            episode = self._pick(rng, wish, layout, partial)
            if layout not in (None, episode.scene_id):
                raise EpisodeError(f"{episode.id}: in {episode.scene_id}, the batch in {layout}.")
            chosen[row], layout = episode, episode.scene_id
        self.episodes = [episode for episode in chosen if episode is not None]
        # One row, on the CPU, shows any layout in a running simulation.
        return not self._built or (self._num_envs > 1 and not self._fits_all())

    def _pick(
        self, rng: np.random.Generator, wish: Any, scene_id: str | None, partial: bool
    ) -> Episode:
        if isinstance(wish, Episode):
            return wish
        if wish is not None:
            return self.source.get(int(wish))
        for _ in range(1000):
            episode = self.source.get(int(rng.integers(self._num_episodes)))
            if scene_id in (None, episode.scene_id) and (not partial or self._fits(episode)):
                return episode
        raise AssertionError(f"no episode in {scene_id}, though one was played there")

    def _fits(self, episode: Episode) -> bool:
        """Whether an episode can start with the bodies that are shown."""
        return episode.scene_id == self._layout and set(episode.objects) <= set(self._objects)

    def _fits_all(self) -> bool:
        return all(self._fits(episode) for episode in self.episodes)

    def build(self, scene: ManiSkillScene, agent: HabFetch, lit: bool) -> None:
        """Starts a new simulation in the layout of the chosen episodes, with lamps if `lit`."""
        self._scene, self._agent = scene, agent
        self._pool = BodyPool(scene, self.source.objects)
        self._lights = LayoutLights(scene) if lit else None
        self._layout, self._dormant = "", None
        self._built = True
        self.tracker = Tracker(self._num_envs, scene.device)
        zeros = torch.zeros(self._num_envs, 3, device=scene.device)
        self.goals = Goals(object_start_m=zeros)
        if self._prefetch and not scene.gpu_sim_enabled:
            for scene_id in self.source.scene_ids():
                self._pool.show(self.source.scene(scene_id), ())
        self._show()

    def _show(self) -> None:
        """Shows layout and objects of the chosen episodes, where they are not shown already."""
        layout = self.episodes[0].scene_id
        objects = tuple(sorted({name for episode in self.episodes for name in episode.objects}))
        if (layout, objects) == (self._layout, self._objects):
            return
        if self._dormant is not None:
            self._grasp.reset(torch.zeros(1, dtype=torch.long))
        self._layout, self._objects, self._loose = layout, objects, {}
        spec = self.source.scene(layout)
        self.handles = self._pool.show(spec, objects)
        if self._lights is not None:
            self._lights.show(spec.lights)
        self._watch()

    def _watch(self) -> None:
        """Makes everything that reads or holds the bodies that are shown."""
        scene, agent, movable = self._scene, self._agent, self.handles.movable
        self._names = list(movable)
        self._grasp = make_grasp(scene, agent.ee_link, list(movable.values()), self._handles())
        self._force = ContactForce(agent, self._grasp)
        self._reader = SnapshotReader(agent, self._grasp)
        self._dormant = None
        if not scene.gpu_sim_enabled:
            links = dict(agent.robot.links_map)
            mobile = agent.controller.config.base
            self._dormant = DormantObjects(list(movable.values()), links, mobile)
        self._key, self._bodies = f"{self._layout}#{next(_shows)}", ()

    def _handles(self) -> list[Handle]:
        found = []
        for name, furniture in self.handles.articulations.items():
            scale = {a.name: a.scale for a in self.handles.spec.articulations}[name]
            for marker in HANDLE_MARKERS:
                if marker.template == name.rsplit("_:", 1)[0]:
                    offset = tuple(scale * x for x in marker.offset_m)
                    link = furniture.links_map[marker.link]
                    found.append(
                        Handle(name=marker.name, furniture=furniture, link=link, offset_m=offset)  # type: ignore[arg-type]
                    )
        return found

    # Running ---------------------------------------------------------------------------------

    def thaw(self) -> None:
        """Makes frozen bodies dynamic, before their state is written."""
        if self._dormant is not None:
            self._dormant.thaw_all()

    def apply(self, rows: Tensor) -> None:
        """Writes the episodes of `rows` (R,) into the simulator and starts their measures."""
        if not self._scene.gpu_sim_enabled:
            self._show()
        self._grasp.reset(rows)
        in_place = self._in_place()
        for row in rows.tolist():
            episode = self.episodes[row]
            apply_episode(episode, row, self.handles, self._agent, in_place)
            if episode.targets:
                self.tracker.target[row] = self._names.index(episode.target)
        if self._scene.gpu_sim_enabled:
            self._scene._gpu_apply_all()
            px: Any = self._scene.px
            px.gpu_update_articulation_kinematics()
            self._scene._gpu_fetch_all()
        self._freeze(in_place)
        self._hold(rows)
        self._force.clear()
        self.snapshot = self._reader.read(self.tracker.target, self._force.newton())
        starts = self.goals.object_start_m.clone()
        starts[rows] = self.snapshot.object_m[rows]
        self.goals = Goals(object_start_m=starts)
        self.tracker.begin(self.snapshot, rows)

    def step(self, gripper: Tensor, physics_steps: int) -> None:
        """Grasps or releases, runs the physics of one action, and advances the measures."""
        grasp, force, dormant = self._grasp, self._force, self._dormant
        if dormant is not None:
            dormant.before_step(int(grasp.held[0]))
        grasp.command(gripper)
        force.clear()
        for _ in range(physics_steps):
            grasp.before_simulation_step()
            self._scene.px.step()
            force.add_physics_step()
        if self._scene.gpu_sim_enabled:
            self._scene._gpu_fetch_all()
        grasp.after_control_step()
        if dormant is not None:
            dormant.refresh()
        self.snapshot = self._reader.read(self.tracker.target, force.newton())
        self.tracker.advance(self.snapshot)

    def _hold(self, rows: Tensor) -> None:
        """Puts what an episode starts with in the hand into the grasp."""
        for row in rows.tolist():
            held = self.episodes[row].held
            if held is not None:
                index = self._names.index(held)
                if self._dormant is not None:
                    self._dormant.wake(index)
                self._grasp.attach(row, index)

    def _in_place(self) -> frozenset[str]:
        """Loose objects that no earlier episode in this layout has touched."""
        loose = self.handles.loose
        known, self._loose = self._loose, self.episodes[0].loose
        if self._dormant is None or known != self._loose:
            return frozenset()
        names = (self._names[index] for index in self._dormant.undisturbed())
        return frozenset(name for name in names if name in loose)

    def _freeze(self, in_place: frozenset[str] = frozenset()) -> None:
        if self._dormant is None:
            return
        playing = self.episodes[0].objects
        loose = self.handles.loose
        present = np.array([name in playing or name in loose for name in self._names], dtype=bool)
        placed = [i for i, name in enumerate(self._names) if name not in in_place]
        self._dormant.freeze_all(present, placed)

    # State -----------------------------------------------------------------------------------

    def get_state(self) -> dict[str, Any]:
        """Returns tracker, grasp, goals and commanded arm, by name."""
        return {
            "tracker": self.tracker.get_state(),
            "grasp": self._grasp.get_state(),
            "goals": {"object_start_m": self.goals.object_start_m.clone()},
            "controller": self._agent.controller.get_state(),
        }

    def set_state(self, state: dict[str, Any], rows: Tensor) -> None:
        """Restores what `get_state` returned, for `rows`, after the simulator's state was set.

        Recorded states come as numpy arrays, and without the batch dimension when there is one row.
        """
        state = _like(state, self.get_state(), self._scene.device)
        self._loose = {}  # a restored state may have moved any of them
        self._freeze()
        held = int(state["grasp"]["held"][0])
        if self._dormant is not None and held >= 0:
            self._dormant.wake(held)
        self._grasp.set_state(state["grasp"], rows)
        self.tracker.set_state(state["tracker"], rows)
        starts = self.goals.object_start_m.clone()
        starts[rows] = state["goals"]["object_start_m"]
        self.goals = Goals(object_start_m=starts)
        self._agent.controller.set_state(state["controller"], rows)
        self.snapshot = self._reader.read(self.tracker.target, self.tracker.measures.force_n)

    # Privileged ------------------------------------------------------------------------------

    def privileged(self) -> list[PrivilegedState]:
        """Returns the true state of each row; CPU simulation, which has one row."""
        if self._scene.gpu_sim_enabled:
            raise NotImplementedError("privileged observations need the CPU simulation")
        handles, agent, episode = self.handles, self._agent, self.episodes[0]
        parts = list(components(handles))
        robot = [(f"hab_fetch/{link.name}", link._objs[0]) for link in agent.robot.links]
        if not self._bodies:
            links = (read_body(name, "robot", body) for name, body in robot)
            self._bodies = (*self._pool.bodies(), *links)
        present = set(episode.objects) | set(handles.loose)
        poses = {
            name: matrix(body.entity_pose)
            for name, group, body in parts
            if group != "object" or name in present
        }
        poses.update({name: matrix(body.entity_pose) for name, body in robot})
        qpos = agent.robot._objs[0].get_qpos()
        held = int(self._grasp.held[0])
        arm = agent.arm_index.tolist()
        return [
            PrivilegedState(
                scene_key=self._key,
                bodies=self._bodies,
                world_from_body=poses,
                world_from_base=matrix(agent.base_link._objs[0].entity_pose),
                arm_qpos=np.asarray(qpos[arm], dtype=float),
                locked_qpos={
                    n: float(qpos[i]) for n, i in agent.joint_index.items() if i not in arm
                },
                target=episode.target,
                held=self._names[held] if held >= 0 else None,
                object_com_m=self._object_coms(present),
            )
        ]

    def _object_coms(self, present: set[str]) -> dict[str, np.ndarray]:
        points = self._grasp.objects_com_m()[0].numpy().astype(float)
        return {name: points[i] for i, name in enumerate(self._names) if name in present}


def _like(state: dict[str, Any], example: dict[str, Any], device: Any) -> dict[str, Any]:
    """Returns nested arrays as tensors with as many dimensions as those of `example`."""
    result = {}
    for name, present in example.items():
        if isinstance(present, dict):
            result[name] = _like(state[name], present, device)
            continue
        value = torch.as_tensor(state[name], device=device)
        result[name] = value[None] if value.dim() == present.dim() - 1 else value
    return result
