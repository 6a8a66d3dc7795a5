"""Builds the wheel: maturin's backend, with the program `omnilife` among the files of the wheel.

The program itself is shipped, not a Python script that calls into a library: it starts itself anew
(for every video, for every unit of a sweep), is told to end by signals and answers with exit codes.

Options of `pip install . --config-settings KEY=VALUE`:

profile  the profile of cargo, `release` unless said otherwise
program  a built program to ship as it is, instead of building one
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Optional

import maturin  # type: ignore[import-not-found,unused-ignore]

Settings = Optional[dict[str, Any]]

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "target/wheel/omnilife.data/scripts"


class UnsupportedOperation(Exception):
    """What a backend raises that makes no source distributions (PEP 517)."""


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    return []


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    return []


def get_requires_for_build_sdist(config_settings: Settings = None) -> list[str]:
    raise UnsupportedOperation("a wheel of omnilife is built from its repository (pip install .)")


def build_sdist(sdist_directory: str, config_settings: Settings = None) -> str:
    return get_requires_for_build_sdist(config_settings)[0]


def prepare_metadata_for_build_wheel(metadata: str, config_settings: Settings = None) -> str:
    SCRIPTS.mkdir(parents=True, exist_ok=True)
    return str(maturin.prepare_metadata_for_build_wheel(metadata, _of_maturin(config_settings)))


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def build_wheel(wheels: str, config_settings: Settings = None, metadata: Optional[str] = None) -> str:
    _place_program(config_settings or {})
    return str(maturin.build_wheel(wheels, _of_maturin(config_settings), metadata))


def build_editable(
    wheels: str, config_settings: Settings = None, metadata: Optional[str] = None
) -> str:
    _place_program(config_settings or {})
    return str(maturin.build_editable(wheels, _of_maturin(config_settings), metadata))


def _place_program(settings: dict[str, Any]) -> None:
    """Builds the program, unless one is given, and puts it among the scripts of the wheel."""
    program = settings.get("program")
    if program is None:
        program = _build(_profile(settings))
    SCRIPTS.mkdir(parents=True, exist_ok=True)
    # Renamed into its place: a wheel that is built at the same time finds it whole.
    temporary = SCRIPTS.parent / f"omnilife.{os.getpid()}.tmp"
    shutil.copy2(program, temporary)
    os.replace(temporary, SCRIPTS / Path(program).name)


def _build(profile: str) -> Path:
    command = ["cargo", "build", "--locked", "--bin", "omnilife", "--profile", profile]
    print("omnilife:", *command, file=sys.stderr, flush=True)
    try:
        subprocess.run(command, cwd=ROOT, check=True)
    except FileNotFoundError:
        raise SystemExit("omnilife: cargo is missing: install Rust from https://rustup.rs") from None
    except subprocess.CalledProcessError:
        raise SystemExit(
            "omnilife: the program cannot be built; scripts/setup installs what it needs (FFmpeg, OpenCV)"
        ) from None
    target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target")
    folder = "debug" if profile == "dev" else profile
    return ROOT / target / folder / ("omnilife.exe" if os.name == "nt" else "omnilife")


def _profile(settings: dict[str, Any]) -> str:
    return str(settings.get("profile", "release"))


def _of_maturin(settings: Settings) -> dict[str, Any]:
    return {"build-args": f"--profile {_profile(settings or {})}"}
