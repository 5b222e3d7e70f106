"""Adds rows of MuJoCo to our rows (JSON on stdin) and prints the table, or all figures with --json.

The script tests/bench/peers/run calls it; see its README.md.
"""

import json
import math
import sys

import mujoco_bars

COLUMNS = (
    ("simulator", "{:<32}"),
    ("episodes_per_core_second", "{:>8.2f}"),
    ("times_slower_than_standard", "{:>8.1f}"),
    ("hanging_ratio_1e3_pa", "{:>8.3f}"),
    ("hanging_ratio_5e4_pa", "{:>8.3f}"),
    ("cantilever_ratio_1e7_pa", "{:>8.3f}"),
    ("track_rms_mm", "{:>8.1f}"),
    ("settings", "  {}"),
)
HEADS = ("simulator", "ep/core-s", "slower", "hang 1e3", "hang 5e4", "sag 1e7", "rms mm", "  settings")


def main():
    ours = json.load(sys.stdin)
    episode, rows = ours["episode"], ours["rows"]
    for setting in mujoco_bars.SETTINGS:
        print(f"measuring {setting.name}", file=sys.stderr)
        mujoco_bars.warnings.clear()
        rows.append(mujoco_bars.measure(setting, episode))
        for text, count in mujoco_bars.warnings.items():
            print(f"  warned {count} times: {text} ...", file=sys.stderr)
    standard = next(r for r in rows if r["simulator"] == "catenary, standard")["episodes_per_core_second"]
    for row in rows:
        row["times_slower_than_standard"] = standard / row["episodes_per_core_second"]
    if "--json" in sys.argv[1:]:
        plain = [{k: None if isinstance(v, float) and math.isnan(v) else v for k, v in r.items()} for r in rows]
        print(json.dumps({"rows": plain, "episode": episode}))
        return
    print("{:<32} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {}".format(*HEADS))
    for row in rows:
        print(" ".join(form.format(row[name]) for name, form in COLUMNS))


if __name__ == "__main__":
    main()
