"""Natural-language instructions of episodes, for humans and language-conditioned policies.

The words are fixed, or drawn per episode among paraphrases and synonyms. Of both, some are held out
for the split ``test``. No two objects and no two receptacles share a name.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hab_tasks.episodes.schema import Episode, Rearrangement, ReceptacleRef, template_of
from hab_tasks.errors import UnknownNameError
from hab_tasks.receptacles import PHRASES
from hab_tasks.task_spec import TaskSpec, interactions

WORDINGS = ("fixed", "varied")
"""Valid values of the option `instructions`."""

Choices = tuple[tuple[str, ...], tuple[str, ...]]
"""Words of ``train`` and ``val``, the fixed ones first, and words held out for ``test``."""

MOVE, CLOSE = "put the {object} {start} {goal}", "close the {closed}"
"""Clauses of a task's instruction."""

TEMPLATES: dict[str, Choices] = {
    "Pick up the {object} {start}.": (
        ("Pick up the {object} {start}.", "Grab the {object} {start}."),
        ("Fetch the {object} {start}.", "Get hold of the {object} {start}."),
    ),
    "Put the {object} {goal}.": (
        ("Put the {object} {goal}.", "Place the {object} {goal}."),
        ("Deposit the {object} {goal}.", "Lay the {object} {goal}."),
    ),
    "Open the fridge.": (
        ("Open the fridge.", "Open the refrigerator."),
        ("Open the door of the fridge.", "Pull the fridge open."),
    ),
    "Close the fridge.": (
        ("Close the fridge.", "Shut the refrigerator."),
        ("Close the door of the fridge.", "Push the fridge shut."),
    ),
    "Open the drawer.": (("Open the drawer.", "Pull the drawer open."), ("Pull the drawer out.",)),
    "Close the drawer.": (("Close the drawer.", "Shut the drawer."), ("Push the drawer in.",)),
    "Drive to the {object} {at}.": (
        ("Drive to the {object} {at}.", "Go to the {object} {at}."),
        ("Move over to the {object} {at}.",),
    ),
    "Drive to where the {object} is to be put {goal}.": (
        (
            "Drive to where the {object} is to be put {goal}.",
            "Go to where the {object} is to be placed {goal}.",
        ),
        ("Move over to where the {object} belongs {goal}.",),
    ),
    "Drive to the fridge.": (
        ("Drive to the fridge.", "Go to the refrigerator."),
        ("Move over to the fridge.",),
    ),
    "Drive to the drawer.": (
        ("Drive to the drawer.", "Go to the drawer."),
        ("Move over to the drawer.",),
    ),
    MOVE: (
        (MOVE, "take the {object} {start} and place it {goal}"),
        ("bring the {object} {start} over and put it {goal}",),
    ),
    CLOSE: ((CLOSE, "shut the {closed}"), ("push the {closed} shut",)),
}
"""Fixed template -> its paraphrases; a template that is absent has none."""

OBJECTS: dict[str, Choices] = {
    "master chef can": (("master chef can", "coffee can"), ("coffee tin",)),
    "cracker box": (("cracker box", "box of crackers"), ("packet of crackers",)),
    "sugar box": (("sugar box", "box of sugar"), ("packet of sugar",)),
    "tomato soup can": (("tomato soup can", "can of tomato soup"), ("soup tin",)),
    "tuna fish can": (("tuna fish can", "can of tuna"), ("tuna tin",)),
    "pudding box": (("pudding box", "box of pudding"), ("pudding mix",)),
    "gelatin box": (("gelatin box", "box of gelatin"), ("packet of gelatin",)),
    "potted meat can": (("potted meat can", "can of potted meat"), ("meat tin",)),
    "mug": (("mug", "cup"), ("coffee mug",)),
    "sponge": (("sponge",), ("kitchen sponge",)),
}
"""Fixed name of an object -> its synonyms."""

PLACES: dict[str, Choices] = {
    "sofa": (("sofa", "couch"), ("settee",)),
    "fridge": (("fridge", "refrigerator"), ("kitchen fridge",)),
    "left counter": (("left counter", "left kitchen counter"), ("left worktop",)),
    "right counter": (("right counter", "right kitchen counter"), ("right worktop",)),
    "sink": (("sink", "kitchen sink"), ("basin",)),
    "light table": (("light table", "light wooden table"), ("pale table",)),
    "dark table": (("dark table", "dark wooden table"), ("table of dark wood",)),
    "chair": (("chair",), ("seat",)),
    "TV stand": (("TV stand", "television stand"), ("TV bench",)),
    "drawer": (("drawer",), ("kitchen drawer",)),
    "wall cabinet": (("wall cabinet",), ("cabinet on the wall",)),
    "shelves": (("shelves",), ("rack",)),
}
"""Fixed name of a receptacle -> its synonyms."""

TWIN_M = 2.5
"""Objects of one kind within this distance may be on one receptacle: the sofa's length."""


@dataclass(frozen=True, kw_only=True)
class Words:
    """Choice of words.

    Attributes:
        seed: The episode's seed; None for the fixed words.
        held_out: Whether to use the words held out for ``test``.
    """

    seed: int | None = None
    held_out: bool = False

    def template(self, fixed: str) -> str:
        """Returns a paraphrase of a template."""
        return self._drawn(TEMPLATES, fixed)

    def object(self, name: str, episode: Episode) -> str:
        """Returns the words for an object; among its twins, it is told by its place."""
        words = self._drawn(OBJECTS, object_words(name))
        return words if self.seed is None else _told_apart(words, name, episode)

    def place(self, ref: ReceptacleRef | None) -> str:
        """Returns ``on the sofa``; empty for a receptacle without a name in words."""
        preposition, the, noun = ("" if ref is None else PHRASES.get(ref[0], "")).partition(" the ")
        return f"{preposition}{the}{self._drawn(PLACES, noun)}"

    def source(self, ref: ReceptacleRef | None) -> str:
        """Returns ``from the sofa``."""
        phrase = self.place(ref)
        return f"from {phrase.partition(' ')[2]}" if phrase else ""

    def _drawn(self, choices: Mapping[str, Choices], fixed: str) -> str:
        if self.seed is None or fixed not in choices:
            return fixed
        pool = choices[fixed][self.held_out]
        # Drawn by name, so that an object keeps its name within an episode.
        return pool[zlib.crc32(f"{self.seed} {fixed}".encode()) % len(pool)]


FIXED = Words()


def check_wording(instructions: str) -> str:
    """Returns a value of the option `instructions`; raises UnknownNameError for others."""
    if instructions not in WORDINGS:
        raise UnknownNameError("instructions", instructions, WORDINGS)
    return instructions


def object_words(handle: str) -> str:
    """Returns an object's name in words: ``002_master_chef_can_:0000`` -> master chef can."""
    return re.sub(r"^\d{3}[_-]", "", template_of(handle)).replace("_", " ")


def skill_instruction(template: str, episode: Episode, words: Words = FIXED) -> str:
    """Returns the instruction of a skill's episode.

    The template has ``{object}``, ``{start}`` (from the sofa), ``{at}`` or ``{goal}`` (on the
    sofa).
    """
    template = words.template(template)
    if not episode.targets:
        return template
    return _filled(template, episode.targets[0], episode, words)


def task_instruction(spec: TaskSpec, episode: Episode, words: Words = FIXED) -> str:
    """Returns the instruction of a task's episode, in the order of its interactions."""
    done = [_moving(spec, number, episode, words) for number in range(len(episode.targets))]
    if spec.ends_closed:
        done.append(words.template(CLOSE).format(closed=" and the ".join(spec.ends_closed)))
    sentence = ", then ".join(done)
    return f"{sentence[:1].upper()}{sentence[1:]}."


def stage_instruction(spec: TaskSpec, reached: int, episode: Episode, words: Words = FIXED) -> str:
    """Returns the instruction of a task's next stage, of which `reached` are done."""
    order = interactions(spec)
    item = order[min(reached, len(order) - 1)]
    if item.kind in ("open", "close"):
        return words.template(f"{item.kind.capitalize()} the {item.articulation}.")
    picks = item.kind == "pick"
    template = words.template(
        "Pick up the {object} {start}." if picks else "Put the {object} {goal}."
    )
    target = episode.targets[item.target]
    return _filled(template, target, episode, words, _inside(spec, item.target, episode, words))


def navigation_template(episode: Episode) -> str:
    """Returns the template of a Navigate episode: the object to be reached at the goal."""
    if episode.handle is not None:
        name = "fridge" if episode.handle.furniture.startswith("fridge") else "drawer"
        return f"Drive to the {name}."
    if episode.held is not None:
        return "Drive to where the {object} is to be put {goal}."
    return "Drive to the {object} {at}."


def _moving(spec: TaskSpec, number: int, episode: Episode, words: Words) -> str:
    target, inside = episode.targets[number], _inside(spec, number, episode, words)
    return _filled(words.template(MOVE), target, episode, words, inside)


def _inside(spec: TaskSpec, number: int, episode: Episode, words: Words) -> str:
    """Returns ``into the bowl`` for a target that is put into another one, else ""."""
    name = spec.targets[number].inside
    if name is None:
        return ""
    return f"into the {words.object(episode.targets[spec.number(name)].object, episode)}"


def _filled(
    template: str, target: Rearrangement, episode: Episode, words: Words, goal: str = ""
) -> str:
    """Returns a template with its words, without the blanks of those that are empty."""
    text = template.format(
        object=words.object(target.object, episode),
        start=words.source(target.start),
        at=words.place(target.start),
        goal=goal or words.place(target.goal),
    )
    return re.sub(r" +([.,])", r"\1", " ".join(text.split()))


def _told_apart(words: str, name: str, episode: Episode) -> str:
    """Returns ``left bowl`` of two bowls close to one another, as seen from the robot's start."""
    twins = _twins(name, episode)
    if name == episode.held or len(twins) < 2:
        return words
    place = twins.index(name)
    ends = {0: "left", len(twins) - 1: "right"}
    if len(twins) == 3:
        ends[1] = "middle"
    if place in ends:
        return f"{ends[place]} {words}"
    return f"{words} number {place + 1} from the left"


def _twins(name: str, episode: Episode) -> Sequence[str]:
    """Returns the objects of one kind near an object and itself, from left to right."""
    x_m, y_m = episode.objects[name][:2]
    base_x_m, base_y_m, _ = episode.robot.base
    forward_rad = math.atan2(y_m - base_y_m, x_m - base_x_m)
    found = []
    for other, (other_x_m, other_y_m, *_) in episode.objects.items():
        same = template_of(other) == template_of(name) and other != episode.held
        if same and math.hypot(other_x_m - x_m, other_y_m - y_m) <= TWIN_M:
            bearing_rad = math.atan2(other_y_m - base_y_m, other_x_m - base_x_m) - forward_rad
            found.append((-math.remainder(bearing_rad, math.tau), other))
    return [other for _, other in sorted(found)]
