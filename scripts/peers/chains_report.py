"""A table of what scripts/peers/chains.py printed: usage: chains_report.py RESULTS, lines of JSON with seed and rate."""

import json
import sys
from collections import defaultdict


def main():
    found = defaultdict(list)
    for line in open(sys.argv[1]):
        one = json.loads(line)
        found[one["rate"], one["name"]].append(one)
    print("| Frames a second | Tracker | IDF1, mean | Least | Switches, mean | Frames per second of computing |")
    print("|---:|---|---:|---:|---:|---:|")

    def mean(values):
        values = list(values)
        return sum(values) / len(values)
    order = sorted(found, key=lambda key: (key[0], -mean(one["idf1"] for one in found[key])))
    for rate, name in order:
        draws = found[rate, name]
        speed = sum(one["frames"] for one in draws) / max(sum(one["seconds"] for one in draws), 1e-9)
        print(f"| {rate} | {name} | {mean(one['idf1'] for one in draws):.3f} | {min(one['idf1'] for one in draws):.3f} | "
              f"{mean(one['switches'] for one in draws):.1f} | {speed:.0f} |")


if __name__ == "__main__":
    main()
