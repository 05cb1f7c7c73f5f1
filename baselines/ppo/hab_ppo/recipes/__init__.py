"""The recipes, one file a skill or a pair of them."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from hab_ppo.recipe import Recipe
from hab_ppo.recipes import doors, navigate, pick, place
from hab_tasks.errors import HabError, UnknownNameError


def _recipes(module: ModuleType) -> dict[str, Recipe]:
    """Returns the recipes of a module by the names of its constants."""
    return {key: value for key, value in vars(module).items() if isinstance(value, Recipe)}


RECIPE_FILES = {
    recipe.name: module
    for module in (pick, place, doors, navigate)
    for recipe in _recipes(module).values()
}
"""The module of each recipe, which holds it under its name in capitals."""


def recipe_names() -> list[str]:
    """Returns the names of all recipes."""
    return sorted(RECIPE_FILES)


def find_recipe(name: str) -> Recipe:
    """Returns a recipe by name, or one of your own given as ``module:NAME``.

    Raises:
        UnknownNameError: No recipe has this name.
        HabError: The module cannot be imported.
    """
    module, separator, attribute = name.partition(":")
    if not separator:
        if name not in RECIPE_FILES:
            raise UnknownNameError("recipe", name, recipe_names())
        return getattr(RECIPE_FILES[name], name.upper())
    try:
        found = _recipes(import_module(module))
    except (ImportError, ValueError) as error:
        raise HabError(f"Recipe {name!r}: the module cannot be imported ({error}).") from error
    if attribute not in found:
        raise UnknownNameError(f"recipe of {module}", attribute, found)
    return found[attribute]
