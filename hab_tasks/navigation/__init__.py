"""Where the base can go: maps of the free floor, geodesic distances, paths, poses that reach."""

from hab_tasks.navigation.layout_maps import LayoutMaps
from hab_tasks.navigation.navigation_map import NavigationMap
from hab_tasks.navigation.paths import path_between
from hab_tasks.navigation.reaching import poses_reaching
from hab_tasks.navigation.ways import Ways

__all__ = ["LayoutMaps", "NavigationMap", "Ways", "path_between", "poses_reaching"]
