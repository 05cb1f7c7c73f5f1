"""States in the middle of a task, set directly; and the episode of a skill that starts in one."""

from dataclasses import replace

import numpy as np
import sapien

from hab_tasks.articulations import ARTICULATION_KINDS
from hab_tasks.episodes.schema import HandleRef, NavigationGoal, Rearrangement, RobotStart
from hab_tasks.simulator import sapien_object


def observe(env, action=None, steps=1):
    """Steps a task's env, by default with the arm and base kept; returns what an agent sees."""
    base = env.unwrapped
    if action is None:
        action = np.array([*base.privileged()[0].arm_qpos, -1.0, 0.0, 0.0], dtype=np.float32)
    for _ in range(steps):
        obs, *_ = env.step(action)
    return {**obs, "privileged": base.privileged()}


def stand(env, base):
    """Sets the base pose (3,)."""
    agent = env.unwrapped.agent
    robot = sapien_object(agent.robot)
    qpos = robot.get_qpos()
    qpos[agent.base_index.tolist()] = base
    robot.set_qpos(qpos)
    robot.set_qvel(np.zeros_like(qpos))


def move_joint(env, number, share):
    """Sets a door or drawer to a share of its travel; what lies in a drawer goes with it."""
    state = env.unwrapped.privileged()[0]
    articulation = state.articulations[number]
    lower, upper = articulation.limits
    goal = lower + share * (upper - lower)
    furniture, link = articulation.body.rsplit("/", 1)
    moved = env.unwrapped.simulation.scene_bodies.articulations[furniture]
    names = [joint.name for joint in moved.active_joints]
    body = sapien_object(moved)
    qpos = body.get_qpos()
    qpos[names.index(moved.links_map[link].joint.name)] = goal
    body.set_qpos(qpos)
    if articulation.slides:
        shift_m = articulation.moved(goal)[:3, 3]
        for name in contents(state, articulation):
            move_object(env, name, state.object_com_m[name] + shift_m)


def contents(state, articulation):
    """Returns the names of the objects in a drawer: near its middle, above its floor."""
    middle_m = state.world_from_body[articulation.body][:3, 3]
    return [
        name for name, com_m in state.object_com_m.items() if np.linalg.norm(com_m - middle_m) < 0.3
    ]


def move_object(env, name, com_m):
    """Moves an object's centre of mass to a point (3,); keeps its orientation."""
    env.unwrapped.simulation.thaw()  # sleeping objects are read once only
    actor = sapien_object(env.unwrapped.simulation.scene_bodies.movable[name])
    now_m = env.unwrapped.privileged()[0].object_com_m[name]
    actor.set_pose(sapien.Pose(actor.pose.p + (np.asarray(com_m) - now_m), actor.pose.q))
    body = actor.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    body.set_linear_velocity(np.zeros(3))
    body.set_angular_velocity(np.zeros(3))


def skill_episode(env, env_id, stage):
    """Returns an episode of a skill that starts in the present state of a task's env.

    Args:
        env: The task's env.
        env_id: The skill's env.
        stage: Stage of the task (`hab_plans.stage`) whose skill it is.
    """
    base = env.unwrapped
    episode, state, bodies = base.episode[0], base.privileged()[0], base.simulation.scene_bodies
    poses = {n: sapien_object(bodies.movable[n]).pose for n in episode.objects}
    robot = state.world_from_base
    here = float(robot[0, 3]), float(robot[1, 3]), float(np.arctan2(robot[1, 0], robot[0, 0]))
    start = RobotStart.of(base.robot, here, state.arm_qpos)
    target = episode.targets[stage.object]
    if stage.at == "start":
        target = Rearrangement(object=target.object, start=target.start)
    return replace(
        episode,
        id=f"{env_id}/here",
        objects={n: (*pose.p.tolist(), *pose.q.tolist()) for n, pose in poses.items()},
        joints={name: _joints(found) for name, found in bodies.articulations.items()},
        robot=start,
        targets=(target,),
        held=state.held,
        handle=_handle(env, state, stage),
        navigation=NavigationGoal(skill="HabPick-v1", base=start.base),
    )


def _joints(articulation):
    qpos = sapien_object(articulation).get_qpos().tolist()
    return dict(zip([joint.name for joint in articulation.active_joints], qpos, strict=True))


def _handle(env, state, stage):
    if stage.articulation is None:
        return None
    articulation = state.articulations[stage.articulation]
    furniture, link = articulation.body.rsplit("/", 1)
    joint = env.unwrapped.simulation.scene_bodies.articulations[furniture].links_map[link].joint
    marker = ARTICULATION_KINDS[articulation.kind].marker
    return HandleRef(furniture=furniture, joint=joint.name, marker=marker)
