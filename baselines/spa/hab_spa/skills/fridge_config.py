"""The numbers of opening and closing the fridge, and what the hand is to do with its door."""

from __future__ import annotations

from dataclasses import dataclass, field

from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.skills.fridge_arc import Pull
from hab_spa.skills.fridge_door import Door
from hab_spa.skills.fridge_place import PlaceConfig
from hab_spa.skills.fridge_shunt import ShuntConfig
from hab_tasks.privileged import FrontState


@dataclass(frozen=True, kw_only=True)
class FridgeConfig:
    """The numbers of opening and closing.

    Attributes:
        open_to, opened: The hand takes a door so far, which is open from here [rad]: just beyond
            what counts as open, so that it can be closed again and meets no wall.
        let_go: The hand lets go of a door that is so far open; friction stops it [rad].
        open_need: A way of the hand will do that opens a closed door so far, ...
        open_more: ... or one by so much more.
        close_to, closed: The hand closes a door so far, which is closed from here [rad].
        close_need: A way will do that closes it by so much.
        go_on, go_on_steps: The arm that has led the door leads it on from there by at least so
            much [rad], if that costs fewer steps.
        takes: How often the handle is taken.
        grasps_m: (along, out) of the handle at which the hand may take it ...
        around_m: ... and where it may hold the door by its edge, before, beside and behind it, for
            the snap grasp reaches through; from there it follows the door all the way round.
        leads: So many ways of leading the door are handed to the motion planner ...
        as_good_steps: ... if they take at most so many steps more than the best.
        reach_share: Reaching for the handle takes this share of the time left, if limits of speed
            allow.
        pace: Of the motion along the arc.
        rest_pace: Of the motion to rest ...
        back_rad: ... which must not take the door back by more than this.
        brake_steps: A door that it cannot close all the way it lets go of so many steps before its
            motion ends, so that it swings on.
        hold_steps: Any other it holds until that is slow, for at most so many steps.
        slow_rad: A door that moves less than this in a step is soon stopped by its friction.
        release_steps: A hand that has let go stays so long.
        at_handle_rad: The handle is taken when every joint is this near to the end of the reach.
        patience_steps: A door that stands still for so long does not swing on.
        still_rad: A door that moves less than this in a step stands still.
        wait_steps: A swinging door is waited for so long.
        spare_steps: So many steps are to spare where time suffices.
        as_is_tries: So many places are looked at for a hand that has led the door and cannot go
            on, before the arm rests.
        plan: Numbers of the motion planner: short motions are worth some more computing, and a
            door that is touched moves.
        places: So many base poses are offered to those who come from elsewhere.
        quick_steps: A way of that many steps is as good as any; one of so many the worst.
        place: Numbers of the search for a place.
        shunt: Numbers of driving there.
    """

    open_to: float = 1.8
    opened: float = 1.62
    let_go: float = 1.7
    open_need: float = 0.7
    open_more: float = 0.25
    close_to: float = 0.03
    closed: float = 0.1
    close_need: float = 0.45
    go_on: float = 0.2
    go_on_steps: float = 120.0
    takes: int = 6
    grasps_m: tuple[tuple[float, float], ...] = (
        (0.0, 0.02), (0.0, 0.06), (0.04, 0.06), (0.08, 0.03), (0.1, 0.05), (0.0, 0.1)
    )  # fmt: skip
    around_m: tuple[tuple[float, float], ...] = (
        (0.11, 0.0), (0.12, -0.05), (0.1, -0.09), (0.06, -0.12), (0.0, -0.13)
    )  # fmt: skip
    leads: int = 6
    as_good_steps: float = 25.0
    reach_share: float = 0.08
    pace: float = 1.6
    rest_pace: float = 1.6
    back_rad: float = 0.04
    brake_steps: int = 5
    hold_steps: int = 12
    slow_rad: float = 0.005
    release_steps: int = 1
    at_handle_rad: float = 0.05
    patience_steps: int = 4
    still_rad: float = 0.002
    wait_steps: int = 60
    spare_steps: float = 25.0
    as_is_tries: int = 8
    plan: PlanConfig = field(
        default_factory=lambda: PlanConfig(
            margins_m=(0.04, 0.02, 0.01, 0.003), good_rad=1.2, improve_checks=8_000
        )
    )
    places: int = 64
    quick_steps: tuple[float, float] = (80.0, 200.0)
    place: PlaceConfig = field(default_factory=PlaceConfig)
    shunt: ShuntConfig = field(default_factory=ShuntConfig)


def pull_of(front: FrontState, out: bool, config: FridgeConfig) -> Pull:
    """Returns what the hand is to do with a door as it is."""
    door = Door(front)
    handle = door.handle_m
    offsets = (*config.grasps_m, *config.around_m)
    if out:
        end, whole = config.open_to, config.opened
        need = min(whole, max(config.open_need, door.joint + config.open_more))
    else:
        end, whole = config.close_to, config.closed
        need = max(whole, door.joint - config.close_need)
    return Pull(
        end=end,
        need=need,
        whole=whole,
        swept=(min(door.joint, end), max(door.joint, end)),
        grasps_m=tuple((handle[0] + a, handle[1] + o) for a, o in offsets),
        way_out=out,
    )
