"""Aids of runs that stand in one table: components that help any method, as run.json lists them."""

import sys
from itertools import combinations


def differing(one, other):
    """The aids that both methods can have and one of two runs used."""
    one, other = one.get("aids") or {}, other.get("aids") or {}
    return sorted(aid for aid in one.keys() & other.keys() if one[aid] != other[aid])


def lines(rows):
    """Lines of Markdown below a table: the aids that its rows used, and the methods that no two of its rows compare
    with equal aids, which the terminal shows too.

    rows: pairs of a title and the record of a run.
    """
    by_aids, by_method = {}, {}
    for title, run in rows:
        if run.get("aids") is None:
            continue
        used = ", ".join(f"`{aid}`" for aid, is_used in sorted(run["aids"].items()) if is_used)
        titles = by_aids.setdefault(used or "no aid", [])
        if title not in titles:
            titles.append(title)
        by_method.setdefault(run["method"], []).append(run)
    if not by_aids:
        return []
    text = ["", "Aids: " + "; ".join(f"{used} ({', '.join(titles)})" for used, titles in by_aids.items()) + "."]
    unequal = []
    for (method, runs), (other, others) in combinations(sorted(by_method.items()), 2):
        aids = min((differing(one, another) for one in runs for another in others), key=len)
        if aids:
            unequal.append(f"`{method}` and `{other}` ({', '.join(aids)})")
    if unequal:
        warning = f"Not compared with equal aids: {'; '.join(unequal)}."
        print(warning, file=sys.stderr)
        text += ["", warning]
    return text
