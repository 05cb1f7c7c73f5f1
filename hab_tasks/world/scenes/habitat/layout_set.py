"""A folder of layouts of another dataset: scene files, and ``layouts.json``, which names it.

Nothing of the dataset is copied. Such a folder is accepted wherever a dataset is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hab_tasks.errors import DatasetError
from hab_tasks.world.scenes.fields import read_json

FILE = "layouts.json"
FORMAT = 1


@dataclass(frozen=True, kw_only=True)
class LayoutSet:
    """Content of ``layouts.json``.

    Attributes:
        name: Name of the set, used as a dataset name.
        dataset: Name or absolute path of the dataset of its furniture, stages and navmeshes.
        templates: `SceneDataset.templates` of that dataset when the layouts were generated.
        split: Split of the layouts in `macros`.
        wild: Whether they were generated with ``--wild``, which requires less clearance.
        macros: Scene id of each layout -> its macro layout.
        extends: Whether the other layouts of `dataset` also belong to the set, in their splits.
    """

    name: str
    dataset: str
    templates: int
    split: str
    wild: bool
    macros: Mapping[str, str]
    extends: bool = False


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
        kinds = (str, str, int, str, bool, dict, bool)
        fields = vars(found).items()
        wrong = [n for (n, v), kind in zip(fields, kinds, strict=True) if not isinstance(v, kind)]
        if wrong:
            raise TypeError(f"{', '.join(wrong)}")
        if not all(isinstance(m, str) and s == Path(s).name for s, m in found.macros.items()):
            raise TypeError("macros")
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(
            f"{file}: damaged ({error}). Generate the layouts again with `hab-tasks vary --force`."
        ) from error
    return found
