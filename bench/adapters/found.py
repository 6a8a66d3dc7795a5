"""Gives a file or folder that a program left under a dated or numbered name a name of its own.

The last written one called NAME below ROOT becomes OUT. Needs nothing but Python.
"""

import argparse
from pathlib import Path


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("root", type=Path)
    parser.add_argument("name")
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    found = sorted(arguments.root.rglob(arguments.name), key=lambda path: path.stat().st_mtime_ns)
    if not found:
        parser.error(f"nothing below {arguments.root} is called {arguments.name}")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.symlink_to(found[-1].resolve())


if __name__ == "__main__":
    main()
