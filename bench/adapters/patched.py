"""Runs a script of somebody else with texts in it replaced, for scripts that take no such option.

Each text must stand in the script exactly once: another version of it is refused. The file itself stays as it is.
Needs nothing but Python.
"""

import argparse
import sys
from pathlib import Path


def main():
    own, theirs = sys.argv[1:], []
    if "--" in own:
        place = own.index("--")
        own, theirs = own[:place], own[place + 1 :]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog="After --: arguments of the script.")
    parser.add_argument("script", type=Path)
    parser.add_argument("--replace", nargs=2, action="append", default=[], metavar=("OLD", "NEW"))
    arguments = parser.parse_args(own)
    text = arguments.script.read_text()
    for old, new in arguments.replace:
        if text.count(old) != 1:
            parser.error(f"{arguments.script} has {old!r} {text.count(old)} times, and once was expected")
        text = text.replace(old, new)
    sys.argv = [str(arguments.script), *theirs]
    sys.path[0] = str(arguments.script.resolve().parent)
    exec(compile(text, str(arguments.script), "exec"), {"__name__": "__main__"})


if __name__ == "__main__":
    main()
