"""The simulated world of a skill: layouts, episodes, grasp, and one snapshot for each action."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np
import torch
from mani_skill.envs.scene import ManiSkillScene
from torch import Tensor

from hab_tasks.arrays import put_rows
from hab_tasks.episodes.apply import apply_episode
from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import UNLIMITED, EpisodeSource
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.goals import Goals
from hab_tasks.measures import Tracker
from hab_tasks.navigation import LayoutMaps, Ways
from hab_tasks.option_values import flag, whole
from hab_tasks.privileged import PrivilegedState
from hab_tasks.robots.dormant import DormantObjects
from hab_tasks.robots.fetch import HabFetch
from hab_tasks.robots.follow_grasp import make_grasp
from hab_tasks.scenes.handles import SceneHandles
from hab_tasks.scenes.lights import LayoutLights
from hab_tasks.scenes.pool import BodyPool
from hab_tasks.skills.choice import EpisodeChoice, Shown
from hab_tasks.skills.containers import Containers
from hab_tasks.skills.episode_checks import check_entries, check_in_layout
from hab_tasks.skills.goal_setting import GoalSetting, handles_of
from hab_tasks.skills.ground_truth import GroundTruth
from hab_tasks.skills.needs import Needs
from hab_tasks.skills.recorded_state import shaped_like
from hab_tasks.snapshot import ContactForce, Snapshot, SnapshotReader

_shows = count()


class World:
    """Shows layouts, applies episodes and steps physics; holds the latest `Snapshot`.

    Attributes:
        needs: What of the episodes is asked about.
        source: Where episodes come from.
        handles: What is shown; all rows of a batch play in the same layout.
        tracker: Advances the measures; holds the goals.
        maps: Navigation maps of the layouts.
        snapshot: The simulator as read after the latest action or reset.
    """

    tracker: Tracker
    handles: SceneHandles
    snapshot: Snapshot
    _scene: ManiSkillScene
    _agent: HabFetch
    _pool: BodyPool
    _setting: GoalSetting
    _truth: GroundTruth
    _dormant: DormantObjects | None

    def __init__(
        self,
        needs: Needs,
        source: EpisodeSource,
        num_episodes: int,
        num_envs: int,
        *,
        prefetch: bool = False,
    ) -> None:
        """Plays episodes of `source`; with `prefetch`, builds all its layouts at the start."""
        self.needs, self.source, self._prefetch = needs, source, prefetch
        whole("num_episodes", num_episodes, 1, UNLIMITED)
        flag("prefetch", prefetch)
        for episode in source.given:
            check_entries(episode, needs, source.file)
        self.maps = LayoutMaps(source.scene)
        self._choice = EpisodeChoice(source, num_episodes, num_envs)
        self._num_envs = num_envs
        self._built = False
        self._shown = Shown()
        self._loose: dict[str, Pose7] = {}

    @property
    def episodes(self) -> list[Episode]:
        """The episode of each row."""
        return self._choice.episodes

    @property
    def seeds(self) -> list[int]:
        """What each row's episode was drawn with: as a seed of that row, it draws it again."""
        return self._choice.seeds

    @property
    def shown(self) -> Shown:
        """Layout and objects in the simulation; another object after every change of them."""
        return self._shown

    @property
    def goals(self) -> Goals:
        """What the episodes ask for."""
        return self.tracker.goals

    # Choosing and building -------------------------------------------------------------------

    def choose(self, rows: list[int], seed: int | list[int] | None, wanted: Any) -> bool:
        """Picks the next episode of each row; returns whether the simulation has to be rebuilt."""
        for wish in wanted if isinstance(wanted, (list, tuple)) else [wanted]:
            if isinstance(wish, Episode):
                check_entries(wish, self.needs)
        self._choice.choose(rows, seed, wanted, self._shown)
        # One row, on the CPU, shows any layout in a running simulation.
        fits = all(self._shown.fits(episode) for episode in self.episodes)
        return not self._built or (self._num_envs > 1 and not fits)

    def build(self, scene: ManiSkillScene, agent: HabFetch, lit: bool) -> None:
        """Starts a new simulation in the layout of the chosen episodes, with lamps if `lit`."""
        self._scene, self._agent = scene, agent
        self._pool = BodyPool(scene, self.source.objects)
        self._lights = LayoutLights(scene) if lit else None
        self._shown, self._dormant = Shown(), None
        self._built = True
        needs, device = self.needs, scene.device
        # The one row of the CPU simulation is kept in numpy arrays, see hab_tasks.arrays.
        kept_on = device if scene.gpu_sim_enabled else None
        goals = Goals.empty(self._num_envs, needs.objects, len(needs.fronts), kept_on)
        self.tracker = Tracker(goals, Ways(self._num_envs) if needs.navigates else None)
        if self._prefetch and not scene.gpu_sim_enabled:
            for scene_id in self.source.scene_ids():
                self._pool.show(self.source.scene(scene_id), ())
        self._show()

    def _show(self) -> None:
        """Shows layout and objects of the chosen episodes, where they are not shown already."""
        layout = self.episodes[0].scene_id
        objects = tuple(sorted({name for episode in self.episodes for name in episode.objects}))
        if (layout, objects) == (self._shown.layout, self._shown.objects):
            return
        if self._dormant is not None:
            self._grasp.reset(torch.zeros(1, dtype=torch.long))
        self._shown, self._loose = Shown(layout, objects), {}
        spec = self.source.scene(layout)
        self.handles = self._pool.show(spec, objects)
        if self._lights is not None:
            self._lights.show(spec.lights)
        self._watch()

    def _watch(self) -> None:
        """Makes everything that reads or holds the bodies that are shown."""
        scene, agent, handles = self._scene, self._agent, self.handles
        movable = list(handles.movable.values())
        self._names = list(handles.movable)
        self._grasp = make_grasp(
            scene,
            agent.ee_link,
            movable,
            handles_of(handles),
            self.needs.takes,
            arm_is_set=agent.controller.config.arm == "joint_state",
        )
        self._force = ContactForce(agent, self._grasp)
        self._reader = SnapshotReader(agent, self._grasp)
        self._setting = GoalSetting(self.needs, handles, self._grasp)
        self._dormant = None
        if not scene.gpu_sim_enabled:
            links = dict(agent.robot.links_map)
            mobile = agent.controller.config.base != "still"
            furniture = list(handles.articulations.values())
            self._dormant = DormantObjects(movable, links, furniture, mobile)
            self._grasp.known_com_m = self._dormant.com_m
        if self.needs.takes == "any":
            self._grasp.shut_in = Containers(self.needs.fronts, self._grasp).shut_in
        key = f"{self._shown.layout}#{next(_shows)}"
        self._truth = GroundTruth(key, self._pool, handles, agent, self._grasp)

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
        tracker = self.tracker
        for row in rows.tolist():
            episode = self.episodes[row]
            check_in_layout(episode, self.handles)
            apply_episode(episode, row, self.handles, self._agent, in_place)
            targets, handles = self._setting.targets(episode), self._setting.handles(episode)
            tracker.targets = put_rows(tracker.targets, [row], [targets])
            tracker.handles = put_rows(tracker.handles, [row], [handles])
        if self._scene.gpu_sim_enabled:
            self._scene._gpu_apply_all()
            px: Any = self._scene.px
            px.gpu_update_articulation_kinematics()
            self._scene._gpu_fetch_all()
        self._freeze(in_place)
        self._hold(rows)
        self._force.clear()
        self.snapshot = self._reader.read(tracker.targets, tracker.handles, self._force.newton())
        self._set_goals(rows)
        tracker.begin(self.snapshot, rows)

    def _set_goals(self, rows: Tensor) -> None:
        """Writes what the episodes of `rows` ask for into the tracker."""
        tracker = self.tracker
        for row in rows.tolist():
            starts_m = np.array(self.snapshot.objects_m[row].tolist()).reshape(-1, 3)
            values = self._setting.values(self.episodes[row], starts_m)
            tracker.goals = tracker.goals.changed([row], {n: [v] for n, v in values.items()})
            if self.episodes[row].navigation is not None:
                self.lead(row)

    def lead(self, row: int) -> None:
        """Measures the way of a row to the base pose among its goals from now on."""
        ways = self.tracker.ways
        if ways is not None:
            goal = np.array(self.tracker.goals.base[row, :2].tolist())
            episode = self.episodes[row]
            ways.lead(row, self.maps.of(episode.scene_id, episode.joints), goal)

    def step(self, gripper: Tensor, physics_steps: int) -> None:
        """Grasps or releases, runs the physics of one action, and advances the measures."""
        grasp, force, dormant = self._grasp, self._force, self._dormant
        if self._agent.controller.config.sets_joints:
            self._carry(physics_steps)
        if dormant is not None:
            before = self.snapshot
            touching = bool(before.force_n[0] > 0) or bool(before.held_handle[0] >= 0)
            dormant.before_step(int(before.held[0]), touching or bool(before.held[0] >= 0))
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
        tracker = self.tracker
        self.snapshot = self._reader.read(tracker.targets, tracker.handles, force.newton())
        tracker.advance(self.snapshot, self._agent.controller.stopped)

    def _carry(self, physics_steps: int) -> None:
        """Takes along what is held, after an action has set joints of the robot."""
        self._grasp.carry(physics_steps)
        if self._dormant is not None:
            self._dormant.refresh()

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
            "goals": self.goals.state(),
            "controller": self._agent.controller.get_state(),
        }

    def refuse_other_bodies(self, simulator: dict[str, Any]) -> None:
        """Raises EpisodeError when a state of the simulator has bodies that are not in it."""
        present = self._scene.state_dict_registry
        for kind in ("actors", "articulations"):
            others = sorted(set(simulator.get(kind, ())) - set(getattr(present, kind)))
            if others:
                raise EpisodeError(
                    f"The state holds {others[0]!r}, which is not in episode "
                    f"{self.episodes[0].id!r}. Start the episode that it comes from first: "
                    "env.reset(seed=...) or env.reset(options={'episode': ...})."
                )

    def set_state(self, state: dict[str, Any], rows: Tensor) -> None:
        """Restores what `get_state` returned, for `rows`, after the simulator's state was set.

        Recorded states come as numpy arrays, and without the batch dimension when there is one row.
        """
        state = shaped_like(state, self.get_state(), len(rows), self._scene.device)
        self._loose = {}  # a restored state may have moved any of them
        self._freeze()
        if self._dormant is not None:
            held, leaving_m = int(state["grasp"]["held"][0]), state["grasp"]["leaving_m"][0]
            for index in [held] * (held >= 0) + torch.nonzero(leaving_m).flatten().tolist():
                self._dormant.wake(index)
        self._grasp.set_state(state["grasp"], rows)
        tracker = self.tracker
        tracker.set_state(state["tracker"], rows)
        tracker.goals = tracker.goals.changed(rows, state["goals"])
        for row in rows.tolist():
            self.lead(row)
        self._agent.controller.set_state(state["controller"], rows)
        self.snapshot = self._reader.read(
            tracker.targets, tracker.handles, tracker.measures.force_n
        )

    def held_name(self) -> str | None:
        """Returns the name of the body in the hand of the first row, None if there is none."""
        held = int(self.snapshot.held[0])
        return self._names[held] if held >= 0 else None

    def privileged(self) -> list[PrivilegedState]:
        """Returns the true state of each row; CPU simulation, which has one row."""
        if self._scene.gpu_sim_enabled:
            raise NotImplementedError("privileged observations need the CPU simulation")
        (episode,) = self.episodes
        handles = [int(index) for index in self.tracker.handles[0]]
        return [self._truth.read(episode, self.goals, self.needs.fronts, handles)]
