"""Statistics of a dataset (S A.1), as Figures 6 and 7 draw them, and of an episode file (S G.1)."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from hab_authoring.inventory import macro_layouts, macro_of, micro_variations
from hab_tasks.episodes.schema import Episode, EpisodeSet, template_of
from hab_tasks.figure_style import BLUE, EDGE, bare, new_figure, save
from hab_tasks.geometry import Array
from hab_tasks.object_names import ALL_OBJECTS
from hab_tasks.world.scenes.fields import read_json
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import read_category

IN_GRASP = "In the grasp"

_PREFIX = re.compile(r"^(frl_)?apartment_")


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeStatistics:
    """Statistics of an episode file by layout: a macro layout, or a scene without one.

    Attributes:
        objects: Template -> number of targets.
        clutter: Template -> number of clutter objects.
        starts: Receptacle -> number of targets that start on it; `IN_GRASP` for held ones.
        goals: Receptacle -> number of targets with their goal on it.
        handles: Door or drawer -> number of its episodes.
        distances_m: (K,) straight-line distance from start to goal of every target with a goal.
        scenes: Layout -> its scenes, sorted.
        robot_m: Layout -> (K, 2) robot starts.
        start_m: Layout -> (K, 2) target starts.
        goal_m: Layout -> (K, 2) goals of targets, or of the robot in Navigate.
    """

    objects: dict[str, int]
    clutter: dict[str, int]
    starts: dict[str, int]
    goals: dict[str, int]
    handles: dict[str, int]
    distances_m: Array
    scenes: dict[str, list[str]]
    robot_m: dict[str, Array]
    start_m: dict[str, Array]
    goal_m: dict[str, Array]


def furniture_counts(dataset: SceneDataset) -> dict[str, int]:
    """Returns the count of each furniture type in the micro-variations (S Fig. 6).

    Counts the entries of the scene files, so pieces without meshes are included; loose objects are
    not. Most frequent first.
    """
    counts: Counter[str] = Counter()
    for scene_id in micro_variations(dataset):
        data = read_json(dataset.scene_file(scene_id))
        fixed = [
            entry
            for entry in data.get("object_instances", [])
            if entry.get("motion_type", "STATIC").upper() != "DYNAMIC"
        ]
        for entry in fixed + data.get("articulated_object_instances", []):
            name = Path(entry["template_name"]).name.removesuffix(".object_config.json")
            counts[readable(name)] += 1
    return _by_frequency(counts)


def category_counts(dataset: SceneDataset) -> dict[str, int]:
    """Returns the number of object templates per semantic category (S Fig. 7).

    The movable objects of the tasks are a separate data set and not counted. Most frequent first.
    """
    counts: Counter[str] = Counter()
    for name, file in dataset.object_files.items():
        if name not in ALL_OBJECTS:
            counts[readable(read_category(file)) or "No category"] += 1
    return _by_frequency(counts)


def episode_statistics(episodes: EpisodeSet) -> EpisodeStatistics:
    """Returns the statistics of a set of episodes."""
    targets = [(e, target) for e in episodes.episodes for target in e.targets]
    handles = [e.handle for e in episodes.episodes if e.handle is not None]
    return EpisodeStatistics(
        objects=_counted(template_of(target.object) for _, target in targets),
        clutter=_counted(
            template_of(name)
            for e in episodes.episodes
            for name in e.objects.keys() - {target.object for target in e.targets}
        ),
        starts=_by_frequency(
            Counter(receptacle_label(t.start[0]) if t.start else IN_GRASP for _, t in targets)
        ),
        goals=_by_frequency(Counter(receptacle_label(t.goal[0]) for _, t in targets if t.goal)),
        handles=_counted(f"{template_of(handle.furniture)}, {handle.joint}" for handle in handles),
        distances_m=np.array(
            [
                math.dist(e.objects[target.object][:3], target.world_from_goal[:3])
                for e, target in targets
                if target.world_from_goal is not None
            ]
        ),
        scenes={
            layout: sorted({e.scene_id for e in episodes.episodes if layout_of(e) == layout})
            for layout in sorted({layout_of(e) for e in episodes.episodes})
        },
        robot_m=_by_layout((e, e.robot.base[:2]) for e in episodes.episodes),
        start_m=_by_layout((e, e.objects[target.object][:2]) for e, target in targets),
        goal_m=_by_layout(
            [(e, t.world_from_goal[:2]) for e, t in targets if t.world_from_goal]
            + [(e, e.navigation.base[:2]) for e in episodes.episodes if e.navigation]
        ),
    )


def layout_of(episode: Episode) -> str:
    """Returns the macro layout of an episode, or its scene without one."""
    return macro_of(episode.scene_id) or episode.scene_id


def readable(name: str) -> str:
    """Returns a template's or category's name for a reader: ``frl_apartment_table_03``, Table 03.

    YCB's numbers go: ``024_bowl`` is Bowl.
    """
    words = re.sub(r"^\d{3}_", "", _PREFIX.sub("", name))
    words = re.sub(r"(?<=[a-z])(?=[A-Z0-9])", " ", words).replace("_", " ").replace("-", " ")
    words = re.sub(r"^tv ?", "TV ", words.lower())
    return words[:1].upper() + words[1:]


def receptacle_label(name: str) -> str:
    """Returns a receptacle's name for a reader.

    ``receptacle_aabb_middle_topfrl_apartment_refrigerator`` is Refrigerator, middle top; surfaces
    that are numbered keep their number, unless it is the first: Table 02, top 2.
    """
    words = name.removeprefix("receptacle_aabb_")
    split = re.fullmatch(r"(.*?)_?(?:frl_apartment_(.+)|(kitchen.+))", words)
    if split is None:
        return readable(words)
    part, owner = split[1].replace("_", " "), split[2] or split[3]
    numbered = re.fullmatch(r"\w+ Top(\d+)", part)
    if numbered:
        part = f"top {numbered[1]}" if numbered[1] != "1" else ""
    name = readable(owner)
    part = part.lower().removeprefix(name.lower().split()[-1]).strip()
    return f"{name}, {part}" if part else name


def _counted(names: Iterable[str]) -> dict[str, int]:
    return _by_frequency(Counter(readable(name) for name in names))


def _by_frequency(counts: Counter[str]) -> dict[str, int]:
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def _by_layout(points: Iterable[tuple[Episode, Sequence[float]]]) -> dict[str, Array]:
    found: dict[str, list[Sequence[float]]] = {}
    for episode, point in points:
        found.setdefault(layout_of(episode), []).append(point)
    return {layout: np.array(found[layout]) for layout in sorted(found)}


PALE = "#D8DCE0"
BAR_HEIGHT_IN = 0.22
COLUMN_IN = 5.0
MARGIN_IN = 1.0
LONGEST_COLUMN = 25


def draw_furniture(dataset: SceneDataset, file: Path) -> None:
    """Draws the count of each furniture type in the micro-variations (S Fig. 6)."""
    layouts, macros = len(micro_variations(dataset)), len(macro_layouts(dataset))
    title = f"{dataset.name}: furniture in {layouts} micro-variations of {macros} macro layouts"
    _draw(furniture_counts(dataset), title, "occurrences", file)


def draw_categories(dataset: SceneDataset, file: Path) -> None:
    """Draws the number of object templates per semantic category (S Fig. 7)."""
    counts = category_counts(dataset)
    title = f"{dataset.name}: {sum(counts.values())} objects in {len(counts)} semantic categories"
    _draw(counts, title, "object templates", file)


def bars(
    axes: Axes,
    counts: Mapping[str, int],
    *,
    extra: Mapping[str, int] | None = None,
    names: tuple[str, str] = ("", ""),
    rows: int | None = None,
) -> None:
    """Draws counts as horizontal bars with their numbers; the first is on top.

    Args:
        axes: The axes.
        counts: Label -> number.
        extra: Additional counts, stacked pale and hatched.
        names: Legend of the two kinds.
        rows: Number of bars to leave room for, so that neighbouring axes have equal bar heights.
    """
    more = extra or {}
    labels = sorted(counts.keys() | more.keys(), key=lambda x: (-counts.get(x, 0), x))
    at = range(len(labels))
    main, added = [counts.get(x, 0) for x in labels], [more.get(x, 0) for x in labels]
    ends = [a + b for a, b in zip(main, added, strict=True)]
    axes.barh(at, main, height=0.72, color=BLUE, label=names[0])
    if extra:
        pale = {"color": PALE, "edgecolor": EDGE, "linewidth": 0.5, "hatch": "////"}
        axes.barh(at, added, left=main, height=0.72, label=names[1], **pale)
        placement = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.99), "ncols": 2}
        axes.legend(fontsize=8, frameon=False, borderaxespad=0.1, **placement)
    for row, (a, b, end) in enumerate(zip(main, added, ends, strict=True)):
        words = f"{a} + {b}" if extra else str(a)
        axes.annotate(
            words, (end, row), xytext=(3, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.set_yticks(at, labels, fontsize=8.5)
    axes.set_ylim(max(rows or 0, len(labels)) - 0.4, -0.6)
    axes.set_xlim(0, 1.15 * max(ends, default=1))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    bare(axes)


def _draw(counts: dict[str, int], title: str, unit: str, file: Path) -> None:
    columns = max(1, math.ceil(len(counts) / LONGEST_COLUMN))
    rows = math.ceil(len(counts) / columns)
    figure = new_figure(COLUMN_IN * max(columns, 1.4), MARGIN_IN + BAR_HEIGHT_IN * max(rows, 3))
    parts = figure.subplots(1, columns, sharex=True, squeeze=False)[0]
    entries = list(counts.items())
    for index, axes in enumerate(parts):
        bars(axes, dict(entries[index * rows : (index + 1) * rows]), rows=rows)
        axes.set_xlabel(unit, fontsize=9)
    parts[0].set_xlim(0, 1.15 * max(counts.values(), default=1))
    figure.suptitle(title, fontsize=10.5)
    save(figure, file)
