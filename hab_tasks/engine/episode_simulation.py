"""Simulation of one row: layouts, episodes, control and grasp."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np
from mani_skill.envs.scene import ManiSkillScene

from hab_tasks.arrays import Batch, Floats, of_row
from hab_tasks.constants import PHYSICS_STEPS
from hab_tasks.engine.episode_sampler import ActiveLayout, EpisodeSampler
from hab_tasks.engine.episode_start import apply_episode, check_entries, check_in_layout
from hab_tasks.engine.goals import Goals, GoalSetting, Requirements, handles_of
from hab_tasks.engine.ground_truth import GroundTruth
from hab_tasks.engine.noise import NoiseSource, SensorNoise
from hab_tasks.engine.perturbation import Perturbation
from hab_tasks.engine.recorded_state import START_ITS_EPISODE
from hab_tasks.engine.snapshot import ContactForce, Snapshot, SnapshotReader
from hab_tasks.episodes.schema import Episode
from hab_tasks.episodes.source import UNLIMITED, EpisodeSource
from hab_tasks.errors import EpisodeError
from hab_tasks.geometry import Pose7
from hab_tasks.option_values import whole
from hab_tasks.privileged import ArticulationState, PrivilegedState
from hab_tasks.robots.control import LONGEST_STEPS, ActionDelay, ee_step_m
from hab_tasks.robots.grasp import NOTHING, Grasp
from hab_tasks.robots.hand import hand_of
from hab_tasks.robots.hidden_objects import Containers
from hab_tasks.robots.joint_setter import BLOCKED_DEPTH_M
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.sleeping import SleepingObjects
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.navigation import LayoutMaps
from hab_tasks.world.scenes.build import LayoutLights
from hab_tasks.world.scenes.pool import BodyPool, SceneBodies

if TYPE_CHECKING:
    from hab_tasks.engine.rows import Rows

_shows = count()


class EpisodeSimulation:
    """Loads layouts, applies episodes and steps the physics of one row of `Rows`.

    Attributes:
        robot: The robot.
        requirements: Requirements of the skill or task.
        source: Source of the episodes.
        sampler: Samples the episodes.
        maps: Navigation maps of the layouts.
        shown: Layout and objects in the simulation; a new instance after every change.
        scene_bodies: Bodies of the active layout.
        truth: Reads the privileged state of the active layout.
        grasp: What the robot holds.
        delay: Delays the actions; None without delay.
        noise: Noise of the sensors; None without noise.
        perturbation: Perturbation of cameras, friction, light and clutter.
        rows: The rows that this simulation belongs to.
        row: Its number among them.
        targets: (K,) grasp index of each object to rearrange.
        handles: (J,) grasp index of each handle.
    """

    scene_bodies: SceneBodies
    truth: GroundTruth
    grasp: Grasp
    rows: Rows
    row: int
    targets: list[int]
    handles: list[int]
    _scene: ManiSkillScene
    _agent: MobileManipulator
    _pool: BodyPool
    _setting: GoalSetting
    _sleeping: SleepingObjects
    _names: list[str]
    _touched: bool

    def __init__(
        self,
        robot: RobotSpec,
        requirements: Requirements,
        source: EpisodeSource,
        num_episodes: int,
        delay_steps: int,
        noise: SensorNoise | Mapping[str, float] | None,
        perturbation: Perturbation,
    ) -> None:
        """Runs episodes of `source`."""
        self.robot, self.requirements, self.source = robot, requirements, source
        self.perturbation = perturbation
        whole("num_episodes", num_episodes, 1, UNLIMITED)
        # A bad file is refused before anything is built.
        for episode in source.given:
            check_entries(episode, robot, requirements, source.file)
        self.maps = LayoutMaps(source.scene)
        self.sampler = EpisodeSampler(source, num_episodes)
        self._delay_steps = whole("action_delay_steps", delay_steps, 0, LONGEST_STEPS, "steps")
        self.delay: ActionDelay | None = None
        known = SensorNoise.of(noise)
        self.noise = None if known is None else NoiseSource(known)
        self.shown: ActiveLayout | None = None
        self._loose: dict[str, Pose7] = {}

    @property
    def episode(self) -> Episode:
        """The current episode."""
        return self.sampler.episode

    @property
    def snapshot(self) -> Snapshot:
        """The latest snapshot, a batch of one."""
        return of_row(self.rows.snapshot, self.row)

    @property
    def goals(self) -> Goals:
        """The goals of the episode, a batch of one."""
        return of_row(self.rows.goals, self.row)

    @property
    def ee_step_m(self) -> float:
        """Maximum displacement of the end-effector per action."""
        return ee_step_m(self.robot, self._agent.controller.config.arm)

    # Choosing and building -------------------------------------------------------------------

    def choose(self, seed: int | None, wanted: Any) -> bool:
        """Chooses the next episode; returns whether nothing has been built yet."""
        if isinstance(wanted, Episode):
            check_entries(wanted, self.robot, self.requirements)
        self.sampler.choose(seed, wanted)
        return self.shown is None

    def build(self, scene: ManiSkillScene, agent: MobileManipulator, lit: bool) -> None:
        """Builds a new simulation in the layout of the chosen episode, with lamps if `lit`."""
        self._scene, self._agent = scene, agent
        perturbed = self.perturbation
        self._pool = BodyPool(scene, self.source.objects, friction=perturbed.friction)
        self._lights = LayoutLights(scene, perturbed.light) if lit else None
        self.delay = ActionDelay(self._delay_steps, agent.controller) if self._delay_steps else None
        self.shown = None
        self._show()

    def _show(self) -> None:
        """Activates layout and objects of the chosen episode, unless already active."""
        layout, objects = self.episode.scene_id, tuple(sorted(self.episode.objects))
        wanted = ActiveLayout(layout, objects)
        if self.shown == wanted:
            return
        if self.shown is not None:
            # A grasp is a constraint with a body, which leaves the scene with its layout.
            self.grasp.reset()
        self.shown, self._loose = wanted, {}
        spec = self.source.scene(layout)
        self.scene_bodies = self._pool.show(spec, objects)
        if self._lights is not None:
            self._lights.show(spec.lights)
        self._watch(layout)

    def _watch(self, layout: str) -> None:
        """Creates the readers and the grasp of the active bodies."""
        agent, scene_bodies = self._agent, self.scene_bodies
        movable = list(scene_bodies.movable.values())
        self._names = list(scene_bodies.movable)
        handles = handles_of(scene_bodies)
        self.grasp = hand_of(agent, movable, handles, self.requirements.takes)
        self._force = ContactForce(agent)
        self._reader = SnapshotReader(agent, self.grasp)
        self._setting = GoalSetting(self.requirements, scene_bodies, self.grasp)
        furniture = list(scene_bodies.articulations.values())
        self._sleeping = SleepingObjects(movable, agent, furniture)
        # The same array, which `refresh` updates in place: the grasp reads no body again.
        self.grasp.known_com_m = self._sleeping.com_m
        if self.requirements.takes == "any":
            kinds, com_m = self.requirements.articulations, self.grasp.objects_com_m
            containers = Containers(kinds, handles, com_m)
            self.grasp.is_enclosed = containers.is_enclosed
        # Never the same twice in a process, as planners keep what they made of the bodies of a key.
        key = f"{layout}#{next(_shows)}"
        self.truth = GroundTruth(key, self._pool, scene_bodies, agent, self.grasp)

    # Running ---------------------------------------------------------------------------------

    def thaw(self) -> None:
        """Wakes sleeping bodies before their state is written."""
        self._sleeping.thaw_all()

    def apply(self) -> None:
        """Writes the chosen episode into the simulator."""
        self._show()
        self.grasp.reset()
        episode, in_place = self.episode, self._in_place()
        check_in_layout(episode, self.scene_bodies)
        apply_episode(episode, self.scene_bodies, self._agent, in_place)
        self.targets = self._setting.targets(episode)
        self.handles = self._setting.handles(episode)
        # Objects are put to sleep where they were just placed.
        self._freeze(in_place)
        if episode.held is not None:
            held = self._names.index(episode.held)
            # Tied to a kinematic body, the hand would be fixed in the world.
            self._sleeping.wake(held)
            self.grasp.attach(held)
        self._force.clear()
        self._touched = False
        if self.delay is not None:
            self.delay.begin()
        if self.noise is not None:
            self.noise.begin(episode.seed)

    def goal_values(self, starts_m: Floats) -> dict[str, Any]:
        """Returns the episode's entries of `Goals`, with objects starting at (K, 3)."""
        values = self._setting.values(self.episode, starts_m.astype(float))
        return {**values, "rest_m": self.robot.rest_position_m}

    def act(self, action: Batch) -> None:
        """Sets the drive targets of a valid action (A,), or cell (1,), without stepping."""
        if self.delay is not None:
            action = self.delay.exchange(action, self.grasp.holding)
        self._agent.controller.set_entries(action)

    @property
    def gripper(self) -> float:
        """The commanded gripper entry."""
        return self._agent.controller.gripper

    @property
    def stopped(self) -> bool:
        """Whether the last action was the stop action."""
        return self._agent.controller.stopped

    def step(self, gripper: float) -> None:
        """Grasps or releases, and steps the physics of one action."""
        grasp, force, sleeping = self.grasp, self._force, self._sleeping
        # First, so that whatever the hand may take or touch in this step is dynamic.
        sleeping.before_step(grasp.held, self._touched or grasp.holding)
        grasp.command(gripper)
        force.clear()
        moving = self._agent.controller.config.sets_joints
        for number in range(PHYSICS_STEPS):
            if moving:
                self._move_joints((number + 1) / PHYSICS_STEPS)
            grasp.before_physics_step()
            self._scene.px.step()
            force.add_physics_step()
            if moving and force.deepest_m() > BLOCKED_DEPTH_M:
                # Back by a share, to where it was not so deep inside; the rest of the action is
                # dropped.
                self._move_joints(number / PHYSICS_STEPS)
                moving = False
        grasp.after_control_step()
        sleeping.refresh()
        self._touched = force.newton() > 0.0

    def read(self, table_row: Floats) -> float:
        """Reads into a row of a table (see `Snapshot.of_table`); returns the contact force [N]."""
        self._reader.read(self.targets, self.handles, table_row)
        return self._force.newton()

    def contact_points_m(self) -> Floats:
        """Returns where the robot touches other bodies, (C, 3) in the world."""
        return self._force.points_m()

    def _move_joints(self, share: float) -> None:
        """Sets joints after a share of an action, and moves what is held with the hand."""
        self._agent.controller.move_joints(share)
        self.grasp.carry()

    def _in_place(self) -> frozenset[str]:
        """Loose objects that no earlier episode in this layout has moved."""
        loose = self.scene_bodies.loose
        known, self._loose = self._loose, self.episode.loose
        if known != self._loose:
            return frozenset()
        # Neither placed nor measured again, as they are where the episode has them.
        names = (self._names[index] for index in self._sleeping.undisturbed())
        return frozenset(name for name in names if name in loose)

    def _freeze(self, in_place: frozenset[str] = frozenset()) -> None:
        playing, loose = self.episode.objects, self.scene_bodies.loose
        present = np.array([name in playing or name in loose for name in self._names], dtype=bool)
        placed = [i for i, name in enumerate(self._names) if name not in in_place]
        self._sleeping.freeze_all(present, placed)

    # State -----------------------------------------------------------------------------------

    def get_state(self) -> dict[str, Any]:
        """Returns the state of grasp, commanded arm, delay and noise, by name."""
        state = {"grasp": self.grasp.get_state(), "controller": self._agent.controller.get_state()}
        options = {"delay": self.delay, "noise": self.noise}
        active = {name: option.get_state() for name, option in options.items() if option}
        return {**state, **active}

    def refuse_other_bodies(self, simulator: Mapping[str, Any]) -> None:
        """Raises EpisodeError if a simulator state has bodies that the simulation lacks."""
        present = self._scene.state_dict_registry
        for kind in ("actors", "articulations"):
            others = sorted(set(simulator.get(kind, ())) - set(getattr(present, kind)))
            if others:
                raise EpisodeError(
                    f"The state contains {others[0]!r}, which is not in episode "
                    f"{self.episode.id!r}. {START_ITS_EPISODE}"
                )

    def set_state(self, state: Mapping[str, Any], touched: bool) -> None:
        """Restores the state of `get_state`, after the simulator's state was set.

        `touched`: whether the robot touches anything in it.
        """
        self._loose = {}  # a restored state may have moved any of them
        self._freeze()
        # What is held, or still leaving the hand, may be at rest in the state.
        for index in self.grasp.awake_in(state["grasp"]):
            self._sleeping.wake(index)
        self.grasp.set_state(state["grasp"])
        self._agent.controller.set_state(state["controller"])
        for name, option in (("delay", self.delay), ("noise", self.noise)):
            if option is not None:
                option.set_state(state[name])
        self._touched = touched

    def held_name(self) -> str | None:
        """Returns the name of the held body, or None."""
        held = self.grasp.held
        return self._names[held] if held != NOTHING else None

    def privileged(self) -> PrivilegedState:
        """Returns the true state."""
        kinds = self.requirements.articulations
        return self.truth.read(self.episode, self.goals, kinds, self.handles)

    def articulations(self) -> tuple[ArticulationState, ...]:
        """Returns the true state of the episode's doors and drawers."""
        return self.truth.articulations(self.requirements.articulations, self.handles)
