"""Prints fusions of the same views as a Markdown table, with ratios to the first."""

import json
import sys
from pathlib import Path

rows = [json.loads(Path(path).read_text()) for path in sys.argv[1:]]
ours = rows[0]
print("| | views | wall s | CPU s | ratio (wall) | field MB | peak MB |")
print("|---|---:|---:|---:|---:|---:|---:|")
for row in rows:
    print(f"| {row['name']} | {row['views']} of {row['size'][0]}x{row['size'][1]} | {row['wall_seconds']:.2f} "
          f"| {row['cpu_seconds']:.2f} | {row['wall_seconds'] / ours['wall_seconds']:.2f} "
          f"| {row['field_bytes'] / 1e6:.0f} | {row['peak_bytes'] / 1e6:.0f} |")
if len({row["views"] for row in rows}) > 1:
    sys.exit("fusion_report: not the same views")
surface = ours.get("surface")
if surface:
    print(f"\nOf {surface['points']:,} points of the other surface {surface['known'] / max(surface['points'], 1):.1%} are "
          f"where the first field is known: {surface['median_voxels']:.2f} voxels from its surface (median), "
          f"{surface['p99_voxels']:.2f} (99 %).")
