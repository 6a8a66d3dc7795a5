"""Tests that need a package which only some functions of omnilife need."""

from __future__ import annotations

import importlib.util
import os
import unittest
from typing import Any, Callable, TypeVar

Test = TypeVar("Test", bound=Callable[..., Any])


def is_there(package: str) -> bool:
    """Returns True where a package is installed; otherwise says that its tests are skipped."""
    if importlib.util.find_spec(package) is not None:
        return True
    reason = f"{package} is not installed"
    print(f"skipped in part: {reason}", flush=True)
    # Where scripts/test counts it too.
    if counted := os.environ.get("OMNILIFE_SKIPPED_TESTS"):
        with open(counted, "a") as file:
            file.write(f"scripts/test-python: {reason}\n")
    return False


def needs(package: str) -> Callable[[Test], Test]:
    """Skips a test or a class of tests where a package is not installed."""
    return unittest.skipUnless(is_there(package), f"{package} is not installed")
