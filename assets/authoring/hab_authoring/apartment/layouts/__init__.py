"""All layouts of the dataset, as data."""

from hab_authoring.apartment.layouts import apt, sc0, sc1, sc2, sc3, sc4
from hab_authoring.apartment.layouts.places import feet_m

MACROS = (sc0.LAYOUT, sc1.LAYOUT, sc2.LAYOUT, sc3.LAYOUT, sc4.LAYOUT)
APARTMENTS = apt.LAYOUTS
__all__ = ["APARTMENTS", "LAYOUTS", "MACROS", "feet_m"]
LAYOUTS = (*MACROS, *APARTMENTS)
