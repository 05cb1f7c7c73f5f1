"""A hill climber over loops of actions: is any cycle rewarded that makes no progress?"""

import gymnasium as gym
import numpy as np
from cheating import World
from playing import ee_mode

LOOP_STEPS, LOOPS = 20, 2
RESTART_AFTER = 60
HANDLES = ("open_drawer", "close_drawer", "open_fridge", "close_fridge")


def skill_of(w):
    task = getattr(w.raw, "task", None)
    return w.raw.skill if task is None else task.parts[int(w.raw.rules.progress.part[0])].skill


def potential(w):
    """What the current skill has paid for the state as it is: a cycle ends where it began."""
    skill, m = skill_of(w), w.raw.measures
    weights, holds = skill.config.weights, bool(m.holding_target[0])
    if skill.name == "navigate":
        near = m.base_to_goal_m[0] < skill.config.heading_counts_within_m
        error_rad = m.heading_error_rad[0] if near else np.pi
        return -weights.distance * m.base_to_goal_m[0] - weights.heading * error_rad
    if skill.name in HANDLES:
        opened = weights.joint * m.joint[0] * (1 if skill.name.startswith("open") else -1)
        return opened - weights.handle * m.ee_to_handle_m[0]
    paid = {
        ("pick", False): m.ee_to_object_m,
        ("pick", True): m.ee_to_rest_m,
        ("place", False): m.ee_to_rest_m,
        ("place", True): m.object_to_goal_m,
    }
    return -weights.distance * paid[skill.name, holds][0]


def situation(w):
    """What has to be the same at the end of a cycle, beside the potential."""
    m, task = w.raw.measures, hasattr(w.raw, "task")
    flags = (m.holding_target, m.placed_before | m.placed, m.grabbed_before | m.grabbed_now)
    progress = (
        (int(w.raw.rules.progress.part[0]), bool(w.raw.rules.progress.done[0])) if task else ()
    )
    return (*(bool(flag[0]) for flag in flags), int(w.shot.held[0]), *progress)


def per_step(w, state, loop, *, grasps, loops=LOOPS, skipped=1):
    """Reward per step of the loops after the first, without the progress that they make.

    Minus infinity if the episode ends or goes on to other things or, with `grasps`, without any.
    """
    w.raw.set_state_dict(state)
    total, before, after_first, taken = 0.0, 0.0, None, 0
    for step in range((skipped + loops) * len(loop)):
        if step == skipped * len(loop):
            before, after_first = potential(w), situation(w)
        held = w.sim.grasp.holding
        _, reward, ended, *_ = w.env.step(loop[step % len(loop)])
        if ended:
            return -np.inf
        if after_first is not None:
            total += float(reward[0])
            taken += w.sim.grasp.holding and not held
    if situation(w) != after_first or (grasps and not taken):
        return -np.inf
    return (total - float(potential(w) - before)) / (loops * len(loop))


def mutated(loop, rng):
    """Changes a stretch of some entries, or shifts the loop."""
    loop, (steps, size) = loop.copy(), loop.shape
    first, length = rng.integers(steps), rng.integers(1, steps // 2)
    rows = np.arange(first, first + length) % steps
    column = rng.integers(size)
    change = rng.integers(4)
    if change == 0:
        return np.roll(loop, rng.integers(steps), axis=0)
    if change == 1:
        loop[rows, column] = rng.choice((-1.0, 0.0, 1.0))
    elif change == 2:
        loop[rows, column] = -loop[rows, column]
    else:
        loop[rows] += rng.normal(0, 0.4, (length, size))
    return np.clip(loop, -1, 1)


def new_loop(size, rng):
    """Waves; the gripper is open or closed, and the base, the last entries, moves less."""
    scale = np.array((0.5, 0.5, 2.0, 100.0, 0.2, 0.2)) if size > 3 else np.full(size, 2.0)
    phase = (
        rng.uniform(0, 2 * np.pi, size) + 2 * np.pi * np.arange(LOOP_STEPS)[:, None] / LOOP_STEPS
    )
    return np.clip(np.sin(phase) * rng.normal(0, 1, size) * scale[:size], -1, 1)


def climb(w, state, evaluations, rng, *, grasps=False):
    """Returns the best reward per step without progress, and its loop; maybe only with grasps."""
    size = w.raw.single_action_space.shape[0]
    best, stuck = (-np.inf, new_loop(size, rng)), 0
    now = best
    for _ in range(evaluations):
        loop = mutated(now[1], rng) if np.isfinite(now[0]) else new_loop(size, rng)
        loop = loop.astype(np.float32)
        value = per_step(w, state, loop, grasps=grasps)
        stuck = 0 if value > now[0] else stuck + 1
        now = max(now, (value, loop), key=lambda found: found[0])
        best = max(best, now, key=lambda found: found[0])
        if stuck > RESTART_AFTER:
            now, stuck = (-np.inf, loop), 0
    return best


# Where loops start ---------------------------------------------------------------------------


def starts(env_id, episode):
    """Yields a name and a world for each start: of the episode, and where grasps are close."""
    mode = "base" if env_id == "HabNavigate-v1" else ee_mode(env_id)
    env = gym.make(f"hab_tasks:{env_id}", control_mode=mode, obs_mode="state")
    env = env.unwrapped  # without a limit of steps
    names = ["start"]
    if hasattr(env, "task"):
        names += list(dict.fromkeys(p.skill.name for p in env.task.parts[1:]))
    elif env_id != "HabNavigate-v1":
        names.append("close")
    for name in names:
        env.reset(seed=episode, options={"episode": episode})
        w = World(env, episode)
        if name not in ("start", "close", "navigate"):
            number = next(p.object for p in env.task.parts if p.skill.name == name)
            w.stand(name, number)
        if name not in ("start", "navigate"):
            come_close(w)
        yield name, w
    env.close()


def come_close(w):
    """Brings the hand to the object or handle, or what it holds to its goal, from above."""
    skill = skill_of(w).name
    number = int(w.raw.rows.tracker.focus.object[0])
    if skill == "place" and not w.holds(number):
        w.take(number)
    for _ in range(50):
        if skill in HANDLES:
            aim = w.seen_from_base(np.asarray(w.shot.handles_m[0, 0], dtype=float))
        elif skill == "pick":
            aim = w.seen_from_base(w.object_m(number)) + np.array((0, 0, 0.2))
        else:
            gap = w.seen_from_base(w.goal_m(number)) - w.seen_from_base(w.object_m(number))
            aim = w.hand + 0.7 * gap + np.array((0, 0, 0.1))
        w.env.step(w.move(aim, 1.0 if skill == "place" else -1.0))
