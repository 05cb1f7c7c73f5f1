"""A folder of layouts of another dataset: scene files, and one file that names that dataset.

Nothing of the dataset is copied. ``layouts.json`` names it, and such a folder can be given wherever
a dataset can.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from hab_tasks.errors import DatasetError
from hab_tasks.files import written_aside
from hab_tasks.scenes.fields import read_json

FILE = "layouts.json"
FORMAT = 1


@dataclass(frozen=True, kw_only=True)
class LayoutSet:
    """What ``layouts.json`` says.

    Attributes:
        name: The set's name, as that of a dataset.
        dataset: Name or absolute path of the dataset whose furniture, stages and navmeshes it uses.
        templates: `SceneDataset.templates` of that dataset when the layouts were made.
        split: The split that all its layouts belong to.
        wild: Whether they were made with ``--wild``, so that less room counts as enough.
        macros: Scene id of each layout -> the macro layout that it was made from.
    """

    name: str
    dataset: str
    templates: int
    split: str
    wild: bool
    macros: Mapping[str, str]


def read_layout_set(file: Path) -> LayoutSet:
    """Reads ``layouts.json``.

    Raises:
        DatasetError: It is damaged, or of another version.
    """
    try:
        data = read_json(file)
        version = data.pop("format")
        if version != FORMAT:
            raise DatasetError(f"{file}: format {version}, and {FORMAT} is what can be read.")
        found = LayoutSet(**data)
        kinds = (str, str, int, str, bool, dict)
        fields = vars(found).items()
        wrong = [n for (n, v), kind in zip(fields, kinds, strict=True) if not isinstance(v, kind)]
        if wrong:
            raise TypeError(f"{', '.join(wrong)}")
        if not all(isinstance(m, str) and s == Path(s).name for s, m in found.macros.items()):
            raise TypeError("macros")
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(
            f"{file}: damaged ({error}). Make the layouts anew with `hab-tasks vary --force`."
        ) from error
    return found


def write_layout_set(layouts: LayoutSet, folder: Path) -> None:
    """Writes ``layouts.json``, by which the folder becomes a dataset."""
    with written_aside(folder / FILE) as scratch:
        text = json.dumps({"format": FORMAT} | asdict(layouts), indent=2)
        scratch.write_text(text + "\n", encoding="utf-8")
