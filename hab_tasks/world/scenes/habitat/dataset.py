"""Habitat's scene dataset format: ReplicaCAD as published or as renamed by ManiSkill.

A dataset folder contains ``*.scene_dataset_config.json``,
``configs/{scenes,objects,stages,lighting}`` and ``urdf/*/``. Templates are identified by file stem,
so both folder layouts are supported. A folder of layouts only (see `LayoutSet`) uses the other
files of the dataset it names.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Annotated

from mani_skill import ASSET_DIR

from hab_tasks.errors import DatasetError, EpisodeError, UnknownNameError
from hab_tasks.typed_values import read_value
from hab_tasks.world.scenes.fields import Fields, read_bytes, read_fields, read_json

SPLIT_MACROS = {"train": ("sc0", "sc1", "sc2"), "val": ("sc3",), "test": ("sc4",)}
"""Macro layouts of each split (S E.1 and ReplicaCAD's own splits)."""

SPLIT_PREFERENCE = ("val", "test", "train")
"""Default split: the first of these that the dataset has scenes for."""

REPLICA_CAD_NAMES = ("replica_cad", "ReplicaCAD", "replicaCAD")
"""Names of the real dataset as ManiSkill downloads it."""

MANISKILL_ASSETS = {
    "ReplicaCAD": ("scene_datasets/replica_cad_dataset", "configs"),
    "ycb": ("assets/mani_skill2_ycb", "models"),
}
"""ManiSkill asset id -> download folder, and a subfolder that it contains."""

SECTIONS = ("stages", "objects", "articulated_objects", "light_setups", "scene_instances")
"""Parts of a scene_dataset_config that name folders."""

_DYNAMICS = re.compile(rb"<dynamics\b[^>]*>")
"""Joint friction and damping, which do not affect the placement of furniture."""

_MACRO = re.compile(r"^v3_(sc\d)_staging_\d\d$")


LAYOUTS_FILE = "layouts.json"
"""File of a folder of layouts of another dataset, which it names; nothing of that is copied."""

LAYOUTS_FORMAT = 1


def _are_names(macros: dict[str, str]) -> str:
    return "" if all(name == Path(name).name for name in macros) else "names of layouts"


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
    macros: Annotated[dict[str, str], _are_names]
    extends: bool = False


def read_layout_set(file: Path) -> LayoutSet:
    """Reads ``layouts.json``.

    Raises:
        DatasetError: It is damaged, or of another version.
    """
    data = read_json(file)
    version = data.pop("format", None)
    if version != LAYOUTS_FORMAT:
        raise DatasetError(f"{file}: format {version}, and {LAYOUTS_FORMAT} is what can be read.")
    where = f"{file}: damaged; generate the layouts again with `hab-tasks vary --force`"
    return read_value(LayoutSet, data, where, DatasetError)


def embedded_dataset() -> Path:
    """Returns the folder of the embedded dataset ``apartment``."""
    # Imported by name: packaging maps the folder assets/ there, which type checkers miss.
    assets = import_module("hab_tasks.assets")
    return Path(next(iter(assets.__path__))) / "apartment"


def resolve_dataset(name_or_path: str | Path) -> SceneDataset:
    """Returns the dataset for ``apartment``, ``replica_cad`` or the path of a dataset folder.

    ``replica_cad`` is ManiSkill's download, unless there is a folder of that name.

    Raises:
        UnknownNameError: Neither a known name nor an existing folder.
        DatasetError: The folder holds no scene dataset, or ManiSkill has not downloaded it.
    """
    name = str(name_or_path)
    if name == "apartment":
        return SceneDataset(embedded_dataset())
    root = Path(name_or_path).expanduser()
    if not root.is_dir() and name in REPLICA_CAD_NAMES:
        root = maniskill_folder("ReplicaCAD")
    if not root.is_dir():
        raise UnknownNameError(
            "scene dataset", name, ["apartment", "replica_cad", "PATH of a ReplicaCAD folder"]
        )
    return SceneDataset(root)


def maniskill_folder(asset: str) -> Path:
    """Returns the folder of one of `MANISKILL_ASSETS`; downloads nothing.

    Raises:
        DatasetError: It is not there; the message names ManiSkill's command.
    """
    subfolder, part = MANISKILL_ASSETS[asset]
    folder = ASSET_DIR / subfolder
    if not (folder / part).is_dir():
        command = f"python -m mani_skill.utils.download_asset {asset}"
        raise DatasetError(f"{folder}: {asset} is not there. ManiSkill downloads it: {command}")
    return folder


class SceneDataset:
    """Index of one dataset folder; files are loaded on first access.

    Attributes:
        root: The folder of the layouts.
        name: The dataset's name.
        layouts: Content of ``layouts.json``; None for a complete dataset.
        source: The dataset with the furniture, stage meshes and navmeshes; itself if complete.
    """

    def __init__(self, root: Path) -> None:
        """Opens a folder.

        Raises:
            DatasetError: It is not a dataset, or the dataset of its layouts is absent or changed.
        """
        self.root = root.resolve()
        self.layouts, self.source = None, self
        if (self.root / LAYOUTS_FILE).exists():
            self._open_layouts(self.root / LAYOUTS_FILE)
            return
        configs = sorted(self.root.glob("*.scene_dataset_config.json"))
        if not configs:
            raise DatasetError(
                f"{self.root}: no *.scene_dataset_config.json in it, so not a scene dataset. Give "
                "the folder that holds configs/ and urdf/, for example replica_cad."
            )
        _check_config(read_fields(configs[0]))
        self.name = configs[0].name.removesuffix(".scene_dataset_config.json")
        if not self.scene_files:
            raise DatasetError(f"{self.root}: configs/scenes holds no *.scene_instance.json.")

    def _open_layouts(self, file: Path) -> None:
        layouts = read_layout_set(file)
        if layouts.split not in SPLIT_MACROS:
            raise DatasetError(f"{file}: unknown split {layouts.split!r}.")
        try:
            if (Path(layouts.dataset).expanduser() / LAYOUTS_FILE).exists():
                raise DatasetError("it holds layouts only")
            source = resolve_dataset(layouts.dataset)
        except (UnknownNameError, DatasetError) as error:
            raise DatasetError(
                f"{file}: the dataset of these layouts, {layouts.dataset}, cannot be read "
                f"({error}). Put it back, or write its new path into that file."
            ) from error
        if source.templates != layouts.templates:
            raise DatasetError(
                f"{file}: {layouts.dataset} has changed since these layouts were made, so that "
                "furniture may not fit. Generate them again with `hab-tasks vary --force`."
            )
        self.layouts, self.source, self.name = layouts, source, layouts.name
        unknown = [m for m in layouts.macros.values() if m not in source.scene_files]
        if unknown:
            raise DatasetError(
                f"{file}: {UnknownNameError('scene', unknown[0], source.scene_files)}"
            )
        absent = [s for s in layouts.macros if not self.scene_files[s].exists()]
        if absent or not layouts.macros:
            raise DatasetError(f"{self.root}: no {', '.join(absent[:3]) or 'layouts'} in it.")

    @cached_property
    def scene_files(self) -> dict[str, Path]:
        """Scene id -> scene_instance file."""
        if self.layouts is not None:
            own = {s: self.root / f"{s}.scene_instance.json" for s in sorted(self.layouts.macros)}
            return own | (self.source.scene_files if self.layouts.extends else {})
        return self._index("configs/scenes", ".scene_instance.json")

    @cached_property
    def object_files(self) -> dict[str, Path]:
        """Template name -> object_config file."""
        return self._index("configs/objects", ".object_config.json")

    @cached_property
    def stage_files(self) -> dict[str, Path]:
        """Stage name -> stage_config file."""
        return self._index("configs/stages", ".stage_config.json")

    @cached_property
    def lighting_files(self) -> dict[str, Path]:
        """Lighting name -> lighting_config file."""
        return self._index("configs/lighting", ".lighting_config.json")

    @cached_property
    def urdf_files(self) -> dict[str, Path]:
        """Articulated template name -> URDF; a file in a folder of its own name comes first."""
        found: dict[str, Path] = {}
        for file in sorted((self.source.root / "urdf").glob("*/*.urdf")):
            if file.stem not in found or file.parent.name == file.stem:
                found[file.stem] = file
        return found

    @cached_property
    def fingerprint(self) -> int:
        """Hash of all configurations and URDFs."""
        if self.layouts is not None:
            return _checksum(self.scene_files.values(), self.source.fingerprint)
        configs = sorted((self.root / "configs").rglob("*.json"))
        return _checksum([*configs, *sorted((self.root / "urdf").rglob("*.urdf"))])

    @cached_property
    def templates(self) -> int:
        """Hash of furniture and stage meshes, without joint friction."""
        kinds = (self.object_files, self.stage_files, self.urdf_files)
        files = [file for kind in kinds for _, file in sorted(kind.items())]
        return _checksum(files, strip=_DYNAMICS)

    def navmesh_file(self, scene_id: str) -> Path | None:
        """Returns the published navmesh of a scene, None when the dataset has none.

        Layouts of another dataset have that of their macro layout: stage and bounds are the same.
        """
        if self.layouts is not None:
            return self.source.navmesh_file(self.layouts.macros.get(scene_id, scene_id))
        for folder in ("navmeshes", "navmeshes_default"):
            file = self.root / folder / f"{scene_id}.navmesh"
            if file.exists():
                return file
        return None

    def scenes_of_split(self, split: str) -> list[str]:
        """Returns the scene ids of a split; empty when the dataset has none of them.

        They are sorted; layouts that extend another dataset come before those of that dataset.

        Raises:
            UnknownNameError: There is no such split.
        """
        if split not in SPLIT_MACROS:
            raise UnknownNameError("split", split, SPLIT_MACROS)
        if self.layouts is not None:
            own = sorted(self.layouts.macros) if split == self.layouts.split else []
            return own + (self.source.scenes_of_split(split) if self.layouts.extends else [])
        wanted = SPLIT_MACROS[split]
        return [s for s in sorted(self.scene_files) if (m := _MACRO.match(s)) and m[1] in wanted]

    def split_of(self, scene_id: str) -> str | None:
        """Returns the split that a scene belongs to, None for one that belongs to none."""
        found = (name for name in SPLIT_MACROS if scene_id in self.scenes_of_split(name))
        return next(found, None)

    def resolve_split(self, split: str | None, scene_id: str | None = None) -> str:
        """Returns `split`; None picks the split of a scene, or the least-seen split available.

        A scene that belongs to no split has ``none``.

        Raises:
            UnknownNameError: No such scene, no such split, or none of its scenes are in this
                dataset.
        """
        if scene_id is not None:
            self.scene_file(scene_id)
            if split is None:
                return self.split_of(scene_id) or "none"
        present = [name for name in SPLIT_PREFERENCE if self.scenes_of_split(name)]
        if split is None and present:
            return present[0]
        if split not in present:
            known = (
                "split" if split not in SPLIT_MACROS else f"split (no scene of it in {self.root})"
            )
            raise UnknownNameError(known, split, present)
        return split

    def check_made_for(self, name: str, where: str) -> None:
        """Rejects episodes, from `where`, of the scene dataset `name` if it is another one.

        Raises:
            EpisodeError: It is.
        """
        if name != self.name:
            raise EpisodeError(
                f"{where}: made for the scene dataset {name}, and this one is {self.name}. Give "
                f"the folder of {name} as scene dataset (--scene-dataset, scene_dataset=)."
            )

    def scene_file(self, scene_id: str) -> Path:
        """Returns the file of a scene.

        Raises:
            UnknownNameError: The dataset has no such scene.
        """
        if scene_id not in self.scene_files:
            raise UnknownNameError(f"scene in {self.root}", scene_id, self.scene_files)
        return self.scene_files[scene_id]

    def _index(self, folder: str, suffix: str) -> dict[str, Path]:
        files = sorted((self.source.root / folder).rglob(f"*{suffix}"))
        return {file.name.removesuffix(suffix): file for file in files}


def _check_config(config: Fields) -> None:
    """Raises DatasetError for a dataset configuration of another form; folders have fixed names."""
    for kind in (name for name in SECTIONS if name in config):
        paths = config.part(kind).part("paths", optional=True)
        for suffix, folders in paths.values.items():
            if not isinstance(folders, list) or not all(isinstance(f, str) and f for f in folders):
                raise paths.refused(suffix, "a list of folders")


def _checksum(files: Iterable[Path], start: int = 0, strip: re.Pattern[bytes] | None = None) -> int:
    """Returns a hash of files' names and bytes, without matches of `strip`."""
    crc = start
    for file in files:
        data = read_bytes(file)
        data = data if strip is None else strip.sub(b"", data)
        crc = zlib.crc32(data, zlib.crc32(file.name.encode(), crc))
    return crc
