"""Prints measurements of the same work as a Markdown table, with ratios to the first."""

import json
import sys
from pathlib import Path


def main():
    rows = [json.loads(Path(path).read_text()) for path in sys.argv[1:]]
    ours = rows[0]
    print("| | wall s | processor s | ratio (wall) | ratio (processor) | loss | peak MB | threads |")
    print("|---|---|---|---|---|---|---|---|")
    for row in rows:
        print(
            f"| {row['name']} | {row['wall_seconds']:.4f} | {row['processor_seconds']:.4f} "
            f"| {row['wall_seconds'] / ours['wall_seconds']:.1f} "
            f"| {row['processor_seconds'] / ours['processor_seconds']:.1f} "
            f"| {row['loss']:.5f} | {row['peak_bytes'] / 1e6:.0f} | {row['threads']} |"
        )
    disagreement = max(abs(row["loss"] / ours["loss"] - 1) for row in rows)
    if disagreement > 0.01:
        sys.exit(f"report: the losses differ by {disagreement:.1%}: not the same work")


if __name__ == "__main__":
    main()
