"""Loads visual meshes into SAPIEN on the CPU and reports the memory growth of this process.

A stand-alone script, run by path, so that no other module of the package is in its memory.
With software Vulkan, GPU memory is part of the process. Standard input: a JSON list of mesh files,
the first of which is loaded before the first measurement, so that code is not counted. Standard
output: a JSON object with the growth in bytes, before and after returning free memory.
"""

from __future__ import annotations

import ctypes
import gc
import json
import sys
from pathlib import Path

import sapien

KIB = 1024


def proportional_set_bytes() -> int:
    """Returns the memory of this process; pages shared with others count in part (Linux)."""
    lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
    return next(KIB * int(line.split()[1]) for line in lines if line.startswith("Pss:"))


def sizes_bytes() -> tuple[int, int]:
    """Returns the size as it is, and after the allocator has returned what it keeps in stock."""
    gc.collect()
    as_it_is = proportional_set_bytes()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    return as_it_is, proportional_set_bytes()


def load(scene: sapien.Scene, file: str, number: int) -> None:
    """Adds a mesh to the scene, in front of a camera at the origin that looks along x."""
    builder = scene.create_actor_builder()
    builder.add_visual_from_file(file)
    row, column = divmod(number, 16)
    builder.initial_pose = sapien.Pose([16.0, 8.0 - column, 8.0 - row])
    builder.build_static(str(number))


def main() -> None:
    """Measures."""
    warm_up, *files = json.load(sys.stdin)
    renderer = sapien.render.RenderSystem(sapien.Device("cpu"))
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), renderer])
    camera = scene.add_camera("camera", 128, 128, 1.5, 0.1, 100.0)
    sizes = []
    for batch in ([warm_up], files):
        for number, file in enumerate(batch):
            load(scene, file, number)
        scene.update_render()
        camera.take_picture()
        camera.get_picture("Color")
        sizes.append(sizes_bytes())
    before, after = sizes
    growth = {"bytes": after[0] - before[0], "bytes_trimmed": after[1] - before[1]}
    sys.stdout.write(json.dumps(growth) + "\n")


if __name__ == "__main__":
    main()
