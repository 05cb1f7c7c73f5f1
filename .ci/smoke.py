"""Steps an environment and finds the site's files, with all packages from the folder given."""

import sys
from importlib import resources
from pathlib import Path

import gymnasium
import hab_authoring
import hab_eval
import hab_experts
import hab_navigator
import hab_plans
import hab_ppo
import hab_spa
import hab_tp_srl

import hab_tasks

(folder,) = map(Path, sys.argv[1:])
for module in (
    hab_authoring,
    hab_eval,
    hab_experts,
    hab_navigator,
    hab_plans,
    hab_ppo,
    hab_spa,
    hab_tasks,
    hab_tp_srl,
):
    assert Path(str(module.__file__)).is_relative_to(folder), module.__file__
env = gymnasium.make("hab_tasks:HabPick-v1")
env.reset(seed=0)
env.step(env.action_space.sample())
for name in ("templates/base.html", "static/site.css", "vendor/list.js/list.min.js"):
    assert resources.files("hab_eval.site").joinpath(name).is_file(), name
sys.stdout.write("The wheels alone make, reset and step HabPick-v1.\n")
