"""A skill that HAB lacks, for use in tasks: its registration and its PDDL action."""

import hab_plans

import hab_tasks
from hab_tasks.receptacles import CABINET, COUNTER

ACTION = """  (:action open-cabinet
    :parameters (?z - container)
    :precondition (and (at-robot ?z) (articulated ?z) (not (is-open ?z)) (hand-empty))
    :effect (and (is-open ?z) (not (is-closed ?z))))"""
ENV = "my_kitchen.open_cabinet:OpenCabinetEnv"

hab_tasks.register_skill("OpenCabinet-v1", ENV, 200, in_tasks="open_cabinet", behind=CABINET)
hab_plans.register_action(ACTION, "open_cabinet")
hab_plans.register_provider("open_cabinet", "my_kitchen.provider:open_cabinet")
CLEAR = hab_tasks.TaskSpec(
    id="ClearCabinet-v1",
    instruction="Open the cabinet, and put the can on the counter.",
    targets=(hab_tasks.Target(name="can", start=CABINET, goal=COUNTER),),
    horizon_steps=700,
    clutter=0,
)
hab_tasks.register_task(CLEAR, __name__)
