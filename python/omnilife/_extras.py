"""Packages that only some functions need, as extras of this one."""

from __future__ import annotations

import importlib
from typing import Any


def extra(module: str, name: str) -> Any:
    """Returns a module of the extra `name`; raises `ImportError`, one line, without it."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        # A package that is there and broken tells its own error.
        if error.name != package:
            raise
        raise ImportError(
            f"{package} is not installed: install the extra omnilife[{name}]", name=package
        ) from None
