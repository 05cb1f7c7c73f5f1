"""Episode simulation: layouts, episodes, grasp, and one snapshot per action."""

from __future__ import annotations

from itertools import count
from typing import Any, NamedTuple

import numpy as np
import torch
from mani_skill.envs.scene import ManiSkillScene
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.arrays import BatchArray, put_rows
from hab_tasks.engine.containers import Containers
from hab_tasks.engine.episode_checks import check_entries, check_in_layout
from hab_tasks.engine.episode_rows import EpisodeRows
from hab_tasks.engine.episode_sampler import ActiveLayout, EpisodeSampler
from hab_tasks.engine.goal_setting import GoalSetting, handles_of
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.ground_truth import GroundTruth
from hab_tasks.engine.measures import Tracker
from hab_tasks.engine.recorded_state import START_ITS_EPISODE
from hab_tasks.engine.requirements import Requirements
from hab_tasks.engine.snapshot import ContactForce, SnapshotReader
from hab_tasks.episodes.apply import apply_episode
from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import UNLIMITED, EpisodeSource
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.navigation import GeodesicDistances, LayoutMaps
from hab_tasks.option_values import flag, whole
from hab_tasks.privileged import ArticulationState, PrivilegedState
from hab_tasks.robots.arm_commands import ee_step_m
from hab_tasks.robots.follow_grasp import make_grasp
from hab_tasks.robots.joint_setter import BLOCKED_DEPTH_M
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.sleeping import SleepingObjects
from hab_tasks.scenes.lights import LayoutLights
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.scenes.scene_bodies import SceneBodies
from hab_tasks.simulator import pull_from_gpu, push_to_gpu

_shows = count()


class RowReading(NamedTuple):
    """What `Snapshot` has of one row beside the table.

    Attributes:
        held: Index of the held object, -1 where none.
        held_handle: Index of the held handle, -1 where none.
        lost: Whether what was held was pulled out of the hand.
        force_n: Contact force on the robot [N].
    """

    held: int
    held_handle: int
    lost: bool
    force_n: float


class EpisodeSimulation(EpisodeRows):
    """Loads layouts, applies episodes and steps physics; holds the latest `Snapshot`.

    Attributes:
        requirements: Requirements of the skill or task.
        source: Source of the episodes.
        scene_bodies: Bodies of the active layout, shared by all rows of a batch.
        truth: Reads the privileged state of the active layout; CPU simulation only.
    """

    scene_bodies: SceneBodies
    truth: GroundTruth
    _scene: ManiSkillScene
    _agent: MobileManipulator
    _pool: BodyPool
    _setting: GoalSetting
    _sleeping: SleepingObjects | None
    _touched: bool
    _read_indices: tuple[list[int], list[int]]

    def __init__(
        self,
        requirements: Requirements,
        source: EpisodeSource,
        num_episodes: int,
        num_envs: int,
        *,
        prefetch: bool = False,
    ) -> None:
        """Runs episodes of `source`; with `prefetch`, preloads all its layouts."""
        self.requirements, self.source, self._prefetch = requirements, source, prefetch
        whole("num_episodes", num_episodes, 1, UNLIMITED)
        flag("prefetch", prefetch)
        for episode in source.given:
            check_entries(episode, requirements, source.file)
        self.maps = LayoutMaps(source.scene)
        self._sampler = EpisodeSampler(source, num_episodes, num_envs)
        self._num_envs = num_envs
        self._built = False
        self._shown = ActiveLayout()
        self._loose: dict[str, Pose7] = {}

    @property
    def episodes(self) -> list[Episode]:
        """The episode of each row."""
        return self._sampler.episodes

    @property
    def seeds(self) -> list[int]:
        """Seed of each row's episode; resetting the row with it reproduces the episode."""
        return self._sampler.seeds

    @property
    def shown(self) -> ActiveLayout:
        """Layout and objects in the simulation; a new instance after every change."""
        return self._shown

    # Choosing and building -------------------------------------------------------------------

    def choose(self, rows: list[int], seed: int | list[int] | None, wanted: Any) -> bool:
        """Chooses the next episode of each row; returns whether a rebuild is required."""
        for wish in wanted if isinstance(wanted, (list, tuple)) else [wanted]:
            if isinstance(wish, Episode):
                check_entries(wish, self.requirements)
        self._sampler.choose(rows, seed, wanted, self._shown)
        # On the CPU (one row), layouts can be exchanged in a running simulation.
        fits = all(self._shown.fits(episode) for episode in self.episodes)
        return not self._built or (self._num_envs > 1 and not fits)

    def build(self, scene: ManiSkillScene, agent: MobileManipulator, lit: bool) -> None:
        """Builds a new simulation in the layout of the chosen episodes, with lamps if `lit`."""
        self._scene, self._agent = scene, agent
        self._pool = BodyPool(scene, self.source.objects)
        self._lights = LayoutLights(scene) if lit else None
        self._shown, self._sleeping = ActiveLayout(), None
        self._built = True
        requirements, device = self.requirements, scene.device
        # The CPU simulation has one row, held in numpy arrays; see hab_tasks.arrays.
        kept_on = device if scene.gpu_sim_enabled else None
        goals = Goals.empty(
            self._num_envs, requirements.objects, len(requirements.articulations), kept_on
        )
        self.tracker = Tracker(
            goals, GeodesicDistances(self._num_envs) if requirements.navigates else None
        )
        if self._prefetch and not scene.gpu_sim_enabled:
            for scene_id in self.source.scene_ids():
                self._pool.show(self.source.scene(scene_id), ())
        self._show()

    def _show(self) -> None:
        """Activates layout and objects of the chosen episodes, unless already active."""
        layout = self.episodes[0].scene_id
        objects = tuple(sorted({name for episode in self.episodes for name in episode.objects}))
        if (layout, objects) == (self._shown.layout, self._shown.objects):
            return
        if self._sleeping is not None:
            self._grasp.reset(torch.zeros(1, dtype=torch.long))
        self._shown, self._loose = ActiveLayout(layout, objects), {}
        spec = self.source.scene(layout)
        self.scene_bodies = self._pool.show(spec, objects)
        if self._lights is not None:
            self._lights.show(spec.lights)
        self._watch()

    def _watch(self) -> None:
        """Creates the readers, grasp and tracker of the active bodies."""
        scene, agent, scene_bodies = self._scene, self._agent, self.scene_bodies
        movable = list(scene_bodies.movable.values())
        self._names = list(scene_bodies.movable)
        self._grasp = make_grasp(
            scene,
            agent.ee_link,
            movable,
            handles_of(scene_bodies),
            self.requirements.takes,
            arm_is_set=agent.controller.config.arm == "joint_state",
        )
        self.ee_step_m = ee_step_m(agent.controller.config.arm)
        self._force = ContactForce(agent, self._grasp)
        self._reader = SnapshotReader(agent, self._grasp)
        self._setting = GoalSetting(self.requirements, scene_bodies, self._grasp)
        self._sleeping = None
        if not scene.gpu_sim_enabled:
            links = dict(agent.robot.links_map)
            mobile = agent.controller.config.base != "still"
            furniture = list(scene_bodies.articulations.values())
            self._sleeping = SleepingObjects(movable, links, furniture, mobile)
            self._grasp.known_com_m = self._sleeping.com_m
        if self.requirements.takes == "any":
            self._grasp.is_enclosed = Containers(
                self.requirements.articulations, self._grasp
            ).is_enclosed
        key = f"{self._shown.layout}#{next(_shows)}"
        self.truth = GroundTruth(key, self._pool, scene_bodies, agent, self._grasp)

    # Running ---------------------------------------------------------------------------------

    def thaw(self) -> None:
        """Wakes sleeping bodies before their state is written."""
        if self._sleeping is not None:
            self._sleeping.thaw_all()

    def apply(self, rows: Tensor) -> None:
        """Writes the episodes of `rows` (R,) into the simulator and resets their measures."""
        if not self._scene.gpu_sim_enabled:
            self._show()
        self._grasp.reset(rows)
        in_place = self._in_place()
        tracker = self.tracker
        for row in rows.tolist():
            episode = self.episodes[row]
            check_in_layout(episode, self.scene_bodies)
            apply_episode(episode, row, self.scene_bodies, self._agent, in_place)
            targets, handles = self._setting.targets(episode), self._setting.handles(episode)
            tracker.targets = put_rows(tracker.targets, [row], [targets])
            tracker.handles = put_rows(tracker.handles, [row], [handles])
        if self._scene.gpu_sim_enabled:
            push_to_gpu(self._scene)
            px: Any = self._scene.px
            px.gpu_update_articulation_kinematics()
            pull_from_gpu(self._scene)
        self._freeze(in_place)
        self._hold(rows)
        self._force.clear()
        self._touched = False
        self._note_indices()
        self.snapshot = self._reader.read(tracker.targets, tracker.handles, self._force.newton())
        self._set_goals(rows)
        tracker.begin(self.snapshot, rows)

    def _set_goals(self, rows: Tensor) -> None:
        """Writes the goals of the episodes of `rows` to the tracker."""
        tracker = self.tracker
        for row in rows.tolist():
            starts_m = np.array(self.snapshot.objects_m[row].tolist()).reshape(-1, 3)
            values = self._setting.values(self.episodes[row], starts_m)
            tracker.goals = tracker.goals.changed([row], {n: [v] for n, v in values.items()})
            if self.episodes[row].navigation is not None:
                self.set_navigation_goal(row)

    def step(self, gripper: BatchArray, physics_steps: int) -> None:
        """Executes one action, and updates snapshot and measures."""
        self.simulate(gripper, physics_steps)
        tracker = self.tracker
        self.snapshot = self._reader.read(tracker.targets, tracker.handles, self._force.newton())
        tracker.advance(self.snapshot, self._agent.controller.stopped)

    def simulate(self, gripper: BatchArray, physics_steps: int) -> None:
        """Grasps or releases, and steps the physics of one action."""
        grasp, force, sleeping = self._grasp, self._force, self._sleeping
        if sleeping is not None:
            held, handle = int(grasp.held.item()), int(grasp.held_handle.item())
            sleeping.before_step(held, self._touched or held >= 0 or handle >= 0)
        grasp.command(gripper)
        force.clear()
        moving = self._agent.controller.config.sets_joints
        for number in range(physics_steps):
            if moving:
                self._move_joints((number + 1) / physics_steps)
            grasp.before_simulation_step()
            self._scene.px.step()
            force.add_physics_step()
            if moving and force.deepest_m() > BLOCKED_DEPTH_M:
                self._move_joints(number / physics_steps)
                moving = False
        if self._scene.gpu_sim_enabled:
            pull_from_gpu(self._scene)
        grasp.after_control_step()
        if sleeping is not None:
            sleeping.refresh()
            self._touched = force.row_newton() > 0.0

    def read_row(self, table_row: NDArray[np.float32]) -> RowReading:
        """Reads the CPU simulation into one row of a table (see `Snapshot.of_table`)."""
        grasp = self._grasp
        self._reader.read_row(*self._read_indices, table_row)
        return RowReading(
            held=int(grasp.held.item()),
            held_handle=int(grasp.held_handle.item()),
            lost=bool(grasp.lost.item()),
            force_n=self._force.row_newton(),
        )

    def _note_indices(self) -> None:
        """Keeps the grasp indices of the first row as numbers, for `read_row`."""
        tracker = self.tracker
        self._read_indices = tracker.targets[0].tolist(), tracker.handles[0].tolist()

    def read_snapshot(self, force_n: NDArray[np.float32]) -> None:
        """Reads the simulator again, for `read_row`; `force_n` (1,) is the force of the step."""
        tracker = self.tracker
        self.snapshot = self._reader.read(tracker.targets, tracker.handles, force_n)

    def holding(self) -> Tensor:
        """Returns whether each robot holds an object or a handle, (N,)."""
        return self._grasp.holding

    def _move_joints(self, share: float) -> None:
        """Sets joints after a share of an action, and moves what is held with the hand."""
        self._agent.controller.move_joints(share)
        self._grasp.carry()

    def _hold(self, rows: Tensor) -> None:
        """Grasps the object that an episode starts with in the hand."""
        for row in rows.tolist():
            held = self.episodes[row].held
            if held is not None:
                index = self._names.index(held)
                if self._sleeping is not None:
                    self._sleeping.wake(index)
                self._grasp.attach(row, index)

    def _in_place(self) -> frozenset[str]:
        """Loose objects that no earlier episode in this layout has moved."""
        loose = self.scene_bodies.loose
        known, self._loose = self._loose, self.episodes[0].loose
        if self._sleeping is None or known != self._loose:
            return frozenset()
        names = (self._names[index] for index in self._sleeping.undisturbed())
        return frozenset(name for name in names if name in loose)

    def _freeze(self, in_place: frozenset[str] = frozenset()) -> None:
        if self._sleeping is None:
            return
        playing = self.episodes[0].objects
        loose = self.scene_bodies.loose
        present = np.array([name in playing or name in loose for name in self._names], dtype=bool)
        placed = [i for i, name in enumerate(self._names) if name not in in_place]
        self._sleeping.freeze_all(present, placed)

    # State -----------------------------------------------------------------------------------

    def get_state(self) -> dict[str, Any]:
        """Returns the state of tracker, grasp, goals and commanded arm, by name."""
        return {
            "tracker": self.tracker.get_state(),
            "grasp": self._grasp.get_state(),
            "goals": self.goals.state(),
            "controller": self._agent.controller.get_state(),
        }

    def refuse_other_bodies(self, simulator: dict[str, Any]) -> None:
        """Raises EpisodeError if a simulator state has bodies that the simulation lacks."""
        present = self._scene.state_dict_registry
        for kind in ("actors", "articulations"):
            others = sorted(set(simulator.get(kind, ())) - set(getattr(present, kind)))
            if others:
                raise EpisodeError(
                    f"The state contains {others[0]!r}, which is not in episode "
                    f"{self.episodes[0].id!r}. {START_ITS_EPISODE}"
                )

    def set_state(self, state: dict[str, Any], rows: Tensor) -> None:
        """Restores the state of `get_state` for `rows`, after the simulator's state was set."""
        self._loose = {}  # a restored state may have moved any of them
        self._freeze()
        if self._sleeping is not None:
            held, leaving_m = int(state["grasp"]["held"][0]), state["grasp"]["leaving_m"][0]
            for index in [held] * (held >= 0) + torch.nonzero(leaving_m).flatten().tolist():
                self._sleeping.wake(index)
        self._grasp.set_state(state["grasp"], rows)
        tracker = self.tracker
        tracker.set_state(state["tracker"], rows)
        tracker.goals = tracker.goals.changed(rows, state["goals"])
        for row in rows.tolist():
            self.set_navigation_goal(row)
        self._agent.controller.set_state(state["controller"], rows)
        self._note_indices()
        force_n = tracker.measures.force_n
        self._touched = bool(force_n[0] > 0)
        self.snapshot = self._reader.read(tracker.targets, tracker.handles, force_n)

    def held_name(self) -> str | None:
        """Returns the name of the body held in the first row, or None."""
        held = int(self.snapshot.held[0])
        return self._names[held] if held >= 0 else None

    def privileged(self) -> list[PrivilegedState]:
        """Returns the true state of each row; CPU simulation only, which has one row."""
        if self._scene.gpu_sim_enabled:
            raise NotImplementedError("privileged observations need the CPU simulation")
        (episode,) = self.episodes
        kinds = self.requirements.articulations
        return [self.truth.read(episode, self.goals, kinds, self._handles)]

    def articulations(self) -> tuple[ArticulationState, ...]:
        """Returns the true state of the episode's doors and drawers; CPU simulation only."""
        return self.truth.articulations(self.requirements.articulations, self._handles)

    @property
    def _handles(self) -> list[int]:
        return [int(index) for index in self.tracker.handles[0]]
