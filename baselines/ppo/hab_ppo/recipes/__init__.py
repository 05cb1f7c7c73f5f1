"""The recipes: one file each, named after its policy, holding `RECIPE`."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from hab_ppo.recipe import Recipe
from hab_tasks.errors import HabError, UnknownNameError


def recipe_names() -> list[str]:
    """Returns the names of all recipes."""
    return sorted(module.name for module in iter_modules(__path__))


def find_recipe(name: str) -> Recipe:
    """Returns a recipe by name, or one of your own given as ``module:NAME``.

    Raises:
        UnknownNameError: No recipe has this name.
        HabError: The module cannot be imported.
    """
    module, separator, attribute = name.partition(":")
    if not separator:
        if name not in recipe_names():
            raise UnknownNameError("recipe", name, recipe_names())
        return import_module(f"{__name__}.{name}").RECIPE
    try:
        loaded = import_module(module)
    except (ImportError, ValueError) as error:
        raise HabError(f"Recipe {name!r}: the module cannot be imported ({error}).") from error
    found = {key: value for key, value in vars(loaded).items() if isinstance(value, Recipe)}
    if attribute not in found:
        raise UnknownNameError(f"recipe of {module}", attribute, found)
    return found[attribute]
