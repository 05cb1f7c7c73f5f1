"""One generator for each env: its start states, settled, stable and reachable."""

from hab_tasks.episodes.generators.base import Generator, Made
from hab_tasks.episodes.generators.drawer import CloseDrawer, OpenDrawer
from hab_tasks.episodes.generators.fridge import CloseFridge, OpenFridge
from hab_tasks.episodes.generators.navigate import Navigate
from hab_tasks.episodes.generators.pick import Pick
from hab_tasks.episodes.generators.place import Place
from hab_tasks.episodes.generators.prepare_groceries import PrepareGroceries
from hab_tasks.episodes.generators.set_table import SetTable
from hab_tasks.episodes.generators.tidy_house import TidyHouse

GENERATORS: dict[str, type[Generator]] = {
    "HabPick-v1": Pick,
    "HabPlace-v1": Place,
    "HabOpenFridge-v1": OpenFridge,
    "HabCloseFridge-v1": CloseFridge,
    "HabOpenDrawer-v1": OpenDrawer,
    "HabCloseDrawer-v1": CloseDrawer,
    "HabNavigate-v1": Navigate,
    "HabTidyHouse-v1": TidyHouse,
    "HabPrepareGroceries-v1": PrepareGroceries,
    "HabSetTable-v1": SetTable,
}
"""Env id -> what makes its episodes."""

__all__ = ["GENERATORS", "Generator", "Made"]
