"""Navigation maps of layouts with the doors and drawers of episodes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping

from hab_tasks.world.navigation.navigation_map import NavigationMap
from hab_tasks.world.scenes.layout_geometry import Layout
from hab_tasks.world.scenes.spec import SceneSpec

KEPT_MAPS = 64


class LayoutMaps:
    """Creates the maps for Navigate's distances; the latest ones are cached."""

    def __init__(self, load: Callable[[str], SceneSpec]) -> None:
        """`load` reads a layout."""
        self._load = load
        self._layouts: dict[str, Layout] = {}
        self._maps: OrderedDict[str, NavigationMap] = OrderedDict()

    def of(self, scene_id: str, joints: Mapping[str, Mapping[str, float]]) -> NavigationMap:
        """Returns the map of a layout.

        Args:
            scene_id: The layout.
            joints: Furniture -> joint -> position [m or rad].
        """
        opened = {
            (furniture, joint): value
            for furniture, values in joints.items()
            for joint, value in values.items()
        }
        key = f"{scene_id} {sorted(opened.items())}"
        if key not in self._maps:
            self._maps[key] = NavigationMap.of_layout(self._layout(scene_id), opened)
            if len(self._maps) > KEPT_MAPS:
                self._maps.popitem(last=False)
        self._maps.move_to_end(key)
        return self._maps[key]

    def _layout(self, scene_id: str) -> Layout:
        if scene_id not in self._layouts:
            self._layouts[scene_id] = Layout.of(self._load(scene_id))
        return self._layouts[scene_id]
