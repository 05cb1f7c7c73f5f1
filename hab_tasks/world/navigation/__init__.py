"""Navigation: maps of the free floor, geodesic distances, paths, base poses for reaching."""

from hab_tasks.world.navigation.navigation_map import GeodesicDistances, LayoutMaps, NavigationMap
from hab_tasks.world.navigation.paths import path_between, poses_reaching

__all__ = [
    "GeodesicDistances",
    "LayoutMaps",
    "NavigationMap",
    "path_between",
    "poses_reaching",
]
