"""Options of the agent: who executes each skill, navigation, recovery, knowledge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hab_navigator.network import NAVIGATOR, shipped_navigator
from hab_navigator.network import WEIGHTS as NAVIGATOR_FILE
from hab_plans.problem import PROVIDERS
from hab_ppo.agent import shipped_weights, weights_file
from hab_ppo.recipes import recipe_names

from hab_tasks.agent import AgentSetup, check_options
from hab_tasks.errors import OptionError, UnknownNameError

PLANNED = "spa_priv"
"""Value of a skill's option: sense-plan-act with ground truth instead of a policy."""

SEEING = "spa"
"""Value of a skill's option: sense-plan-act from depth images."""

SPA = "hab_spa:spa"

IN_TURN = "+"
"""Between the executors of a skill's attempts, as in ``pick=spa+pick_depth``."""

NAVIGATION = ("oracle", "perfect", "learned")
KNOWLEDGE = ("observed", "true")
AIMS = ("hand", "object")
RESETS = ("on", "off")
ACTIONS = ("likely", "drawn")
KINDS = ("blind", "depth", SEEING, PLANNED)
"""Values of the option ``skills``: policies by the suffix of their recipes, or planning."""

NAVIGATE_DEFAULT = NAVIGATOR
SKILLS = ("pick", "place", "open_drawer", "close_drawer", "open_fridge", "close_fridge")


@dataclass(frozen=True, kw_only=True)
class TeamOptions:
    """Options of TP+SRL.

    Attributes:
        skills: Skill -> who executes it, and who its further attempts in turn: file of weights,
            ``module:factory`` of an agent or provider, or None for planning; the skills of the
            task only.
        navigation: ``oracle``, ``perfect`` or ``learned``.
        navigate: File of weights for learned navigation; None otherwise.
        retries: Maximum further attempts of a stage that was not achieved.
        replans: Maximum number of plans after the first.
        true_knowledge: Whether learned skills know the object's true position and their true end.
        aims_object: Whether Place brings the held object to the goal, instead of the hand.
        resets_arm: Whether the arm returns to its resting configuration between skills.
        draws_actions: Whether the actions of policies are drawn, as in their training, instead of
            the most likely ones.
    """

    skills: Mapping[str, Sequence[Path | str | None]]
    navigation: str
    navigate: Path | None
    retries: int
    replans: int
    true_knowledge: bool
    aims_object: bool
    resets_arm: bool
    draws_actions: bool

    @property
    def recovers(self) -> bool:
        """Whether anything is tried again."""
        return self.retries > 0 or self.replans > 0

    @property
    def feels(self) -> bool:
        """Whether the agent plans again from what its hand has felt."""
        return self.replans > 0 and not self.privileged

    @property
    def knows_effects(self) -> bool:
        """Whether the agent notices, by ground truth or by its sensors, what a skill has left."""
        return self.replans > 0 or self.true_knowledge

    @property
    def privileged(self) -> bool:
        """Whether the agent needs ground truth; agents of skills have to do without."""
        planned = {None, *PROVIDERS.values()} & {
            one for ones in self.skills.values() for one in ones
        }
        return self.navigation != "learned" or self.true_knowledge or bool(planned)


def read_options(setup: AgentSetup, needed: tuple[str, ...]) -> TeamOptions:
    """Returns the agent's options.

    Args:
        setup: Setup of the agent.
        needed: Skills of the task.

    Raises:
        HabError: An option is unknown or has an invalid value, or no weights ship for a skill.
    """
    options = setup.options
    known = {
        "navigation": NAVIGATION,
        "knowledge": KNOWLEDGE,
        "skills": KINDS,
        "aim": AIMS,
        "reset_arm": RESETS,
        "actions": ACTIONS,
    }
    free = (*SKILLS, *PROVIDERS, "navigate", "retries", "replan")
    check_options(setup, {**known, **dict.fromkeys(free)})
    navigation = options.get("navigation", "oracle")
    if "navigate" in options and navigation != "learned":
        raise OptionError.of_value(
            "option navigation of the agent", navigation, "learned, with the option navigate"
        )
    kind = options.get("skills", "blind")
    found = TeamOptions(
        skills={skill: _executors(options, skill, kind) for skill in needed},
        navigation=navigation,
        navigate=_navigate(options) if navigation == "learned" else None,
        retries=_count(options, "retries"),
        replans=_count(options, "replan"),
        true_knowledge=options.get("knowledge") == "true",
        aims_object=options.get("aim") == "object",
        resets_arm=options.get("reset_arm", "on") == "on",
        draws_actions=options.get("actions") == "drawn",
    )
    return found


def _executors(options: Mapping[str, str], skill: str, kind: str) -> list[Path | str | None]:
    """Returns who executes a skill, in turn."""
    default = PROVIDERS.get(skill, kind if kind in (PLANNED, SEEING) else f"{skill}_{kind}")
    value = options.get(skill, default)
    values = [value] if Path(value).exists() else value.split(IN_TURN)
    return [_executed_by(skill, one) for one in values]


def _executed_by(skill: str, value: str) -> Path | str | None:
    """Returns the weights of a skill or ``module:factory``; None if it is planned."""
    if value == SEEING and skill in SKILLS:
        return SPA
    if ":" in value and not Path(value).exists():
        return value
    return None if value == PLANNED else _weights(skill, value)


def _navigate(options: Mapping[str, str]) -> Path:
    return _weights("navigate", options.get("navigate", NAVIGATE_DEFAULT))


def _weights(skill: str, value: str) -> Path:
    """Returns the file of weights: those that ship for a recipe, or those at a path."""
    for path in (weights_file(Path(value)), Path(value) / NAVIGATOR_FILE):
        if path.exists():
            return path
    if (skill, value) == ("navigate", NAVIGATOR):
        return shipped_navigator()
    default = NAVIGATE_DEFAULT if skill == "navigate" else f"{skill}_blind"
    names = {*recipe_names(), default, default.replace("blind", "depth")} - {NAVIGATOR}
    if value in names:
        return shipped_weights(value, option=skill)
    own = sorted(name for name in names if name.startswith(skill))
    planned = [NAVIGATOR] if skill == "navigate" else [PLANNED]
    planned += [SEEING] * (skill in SKILLS)
    raise UnknownNameError(f"value of the agent's option {skill}", value, [*own, *planned])


def _count(options: Mapping[str, str], name: str) -> int:
    text = options.get(name, "0")
    if not text.isdecimal():
        raise OptionError.of_value(f"option {name} of the agent", text, "an integer >= 0")
    return int(text)
