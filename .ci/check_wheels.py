"""Checks names, metadata, licences and contents of the wheels of the repository, all given."""

import gzip
import re
import sys
import zipfile
from email import message_from_bytes
from pathlib import Path, PurePosixPath

import tomllib

ROOT = Path(__file__).resolve().parents[1]
CODE = {".py", ".typed", ".toml", ".yaml", ".html", ".md", ".txt", ".pddl", ""}
"""Suffixes of what the licence of a package covers; all other files are assets."""

MACHINE = re.compile(
    rb"|".join(
        [re.escape(str(folder).encode()) + rb"/" for folder in (ROOT, Path.home())]
        + [rb"/(?:home|Users)/\w+/", rb"file:///"]
    )
)
LICENSED = {"LICENSE", "LICENSES.md"}


def projects() -> dict[str, dict]:
    """Returns the metadata of every package of the repository, by the name of its wheel."""
    files = [
        ROOT / "pyproject.toml",
        *ROOT.glob("*/pyproject.toml"),
        *ROOT.glob("*/*/pyproject.toml"),
    ]
    found = [tomllib.loads(file.read_text(encoding="utf-8"))["project"] for file in files]
    return {f"{p['name'].replace('-', '_')}-{p['version']}-py3-none-any.whl": p for p in found}


def faults_of(wheel: Path, project: dict) -> list[str]:
    """Returns what is wrong with a wheel."""
    faults = []
    with zipfile.ZipFile(wheel) as archive:
        names = [PurePosixPath(name) for name in archive.namelist()]
        (info,) = {name.parts[0] for name in names if name.parts[0].endswith(".dist-info")}
        told = message_from_bytes(archive.read(f"{info}/METADATA"))
        for field, key in (("Name", "name"), ("Version", "version"), ("Summary", "description")):
            if told[field] != project[key]:
                faults.append(f"{field} is {told[field]!r}, not {project[key]!r}")
        if told["License"] != "Apache-2.0" or not told.get_all("License-File"):
            faults.append("no licence in the metadata")
        licensed = {name.parent for name in names if name.name in LICENSED}
        for name in names:
            data = archive.read(str(name))
            data = gzip.decompress(data) if name.suffix == ".gz" else data
            if path := MACHINE.search(data):
                faults.append(f"{name} has the path {path[0].decode()!r} of a machine")
            is_foreign = "vendor" in name.parts and name.suffix not in CODE
            own = "assets" in name.parts and name.suffix not in CODE
            if (is_foreign or own) and not licensed & set(name.parents):
                faults.append(f"{name} has no licence beside or above it")
            if name.suffix == ".glb" and b'"copyright"' in data[:4096]:
                faults.append(f"{name} states a copyright of its own")
    return faults


def main() -> int:
    """Returns the exit status."""
    wheels, known = {Path(name).name: Path(name) for name in sys.argv[1:]}, projects()
    faults = [f"{name}: no such wheel" for name in known.keys() - wheels.keys()]
    faults += [f"{name}: not a wheel of this repository" for name in wheels.keys() - known.keys()]
    for name in sorted(known.keys() & wheels.keys()):
        faults += [f"{name}: {fault}" for fault in faults_of(wheels[name], known[name])]
    (version,) = {project["version"] for project in known.values()}
    heads = {"CHANGELOG.md": f"## {version}", "CITATION.cff": f"version: {version}\n"}
    faults += [
        f"{file}: {h!r} is missing"
        for file, h in heads.items()
        if h not in (ROOT / file).read_text()
    ]
    sys.stdout.write(
        "\n".join(faults or [f"{len(wheels)} wheels of {version} are in order."]) + "\n"
    )
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
