"""Opens the sealed answers, checks their seals, and scores the findings: tables and pictures.

    source .venv/ros.env; .venv/bin/python tests/blind/score.py --out DIR [--measured ROWS.jsonl] [--json | --rows]

Writes DIR/score.json, and DIR/score.png with the confusion matrix, the power, the null worlds' p-values and the calibration of the
probabilities. --rows prints the score of each world and the worlds that could not be drawn, a line each. --measured adds the worlds of
such a file, so that a test of days can run in parts, each with its own seed.
"""

import argparse
import collections
import hashlib
import json
import pathlib
import sys

import numpy
from picture import draw
from rows import NEAR, NINETY, RULED, RULES, is_additional, row_of, together
from shares import calibration, each, instead, kolmogorov_p, share, spread
from table import text


def opened(folder):
    """(answer, finding) of each searched world; exits at a broken seal."""
    seals = folder / "seals.txt"
    seals = dict(line.split()[::-1] for line in seals.read_text().splitlines()) if seals.exists() else {}
    pairs = []
    for name, seal in sorted(seals.items()):
        text = (folder / "sealed" / name).read_bytes()
        if hashlib.sha256(text).hexdigest() != seal:
            sys.exit(f"{folder / 'sealed' / name}: does not match its seal")
        verdict = folder / "found" / pathlib.Path(name).stem / "verdict.json"
        if verdict.exists():
            pairs.append((json.loads(text), json.loads(verdict.read_text())))
    if len(pairs) < len(seals):
        print(f"{folder}: {len(seals) - len(pairs)} of {len(seals)} worlds have no finding; run find.py", file=sys.stderr)
    return pairs


def left_out(folder):
    """Rows of worlds that could not be drawn."""
    path = folder / "left_out.jsonl"
    return [json.loads(line) | {"rules": RULES} for line in path.read_text().splitlines()] if path.exists() else []


def summary(all_rows):
    rows, missing = [[row for row in all_rows if (row["kind"] == "left_out") == out] for out in (False, True)]
    of = lambda **wanted: [row for row in rows if all(row[k] == v for k, v in wanted.items())]
    nulls, effects, pairs, structured = (of(kind=kind) for kind in ("none", "effect", "pair", "structured"))
    sizes = sorted({row["size"] for row in effects})
    error, bins = calibration(rows)
    closed = lambda some: [row["closed"] for row in some if row["closed"] is not None]
    median = lambda values: float(numpy.median(values)) if values else None
    of_size = lambda size: [row for row in effects if row["size"] == size]
    return {
        "rules": max((row["rules"] for row in all_rows), default=RULES),
        "worlds": len(rows),
        "left_out": dict(collections.Counter(" + ".join(row["hidden"]) for row in missing)),
        "false_alarms": share(row["detected"] for row in nulls),
        "false_alarms_by_object": {name: share(row["detected"] for row in of(kind="none", object=name)) for name in objects(nulls)},
        "p_uniform": kolmogorov_p(spread(nulls)) if nulls else None,
        "false_names": of_kinds(rows, lambda row: row["false"]),
        "additional_names": of_kinds(rows, is_additional),
        "coverage": coverage(rows),
        "sizes": {str(s): shares(of_size(s), ("detected", "top_1", "top_3", "group")) for s in sizes},
        "effects": {name: of_effect(name, effects, missing, sizes) for name in sorted({row["hidden"][0] for row in effects})},
        "held": {str(s): shares_held([r for r in of_size(s) if r["top_1"]]) for s in sizes},
        "pairs": shares(pairs, ("detected", "top_1", "group")),
        "each_pair": each(pairs, lambda row: " + ".join(row["hidden"]), lambda row: row["top_1"]),
        "structured": of_structured(structured),
        "templates": of_templates([row for row in structured if row["detected"]]),
        "calibration_error": error,
        "bins": bins,
        "gap_closed": {str(s): median(closed(of_size(s))) for s in sizes},
        "wall_s": float(numpy.mean([row["wall_s"] for row in rows])) if rows else None,
    }


def shares(rows, keys):
    return {key: share(row[key] for row in rows) for key in keys}


def objects(rows):
    return sorted({row["object"] for row in rows} - {None})


def of_kinds(rows, is_hit):
    """Shares of hits among all rows, and among those of each kind."""
    kinds = sorted({row["kind"] for row in rows})
    return {"all": share(map(is_hit, rows))} | {kind: share(is_hit(row) for row in rows if row["kind"] == kind) for kind in kinds}


def coverage(rows):
    """Shares of named magnitudes whose interval of 90 % holds the hidden one: of all, and of worlds with and without a residual."""
    is_held = lambda z: z is not None and abs(z) <= NINETY
    of = lambda some: share(is_held(z) for row in some for z in row["z"].values())
    structured = [row for row in rows if row["kind"] == "structured"]
    return {"all": of(rows), "structured": of(structured), "others": of([row for row in rows if row["kind"] != "structured"])}


def of_effect(name, effects, missing, sizes):
    """Figures of one effect at each size."""
    own, none = [[row for row in some if row["hidden"] == [name]] for some in (effects, missing)]
    at = {size: [row for row in own if row["size"] == size] for size in sizes}
    return {
        str(size): shares(some, ("detected", "top_1", "top_3", "group"))
        | {
            "left_out": sum(row["size"] == size for row in none),
            "held": shares_held([row for row in some if row["top_1"]]),
            "instead": instead([row for row in some if not row["top_1"]]),
        }
        for size, some in at.items()
    }


def of_structured(rows):
    """Figures of worlds with a residual that no effect is: alone, and beside effects of the library."""
    is_none = lambda row: row["verdict"] == "none_of_these"
    # Beside effects, just these are named or nearest, and a residual is reported.
    nearest = lambda row: sorted(alike[0] for alike in row.get("nearest", []))
    is_in_part = lambda row: row["left"] and (row["top_1"] or (bool(row["hidden"]) and nearest(row) == row["hidden"]))
    alone, beside = [[row for row in rows if bool(row["hidden"]) == with_effects] for with_effects in (False, True)]
    kind_of = lambda row: row["unlisted"]["name"]
    ruled = lambda some: [row for row in some if kind_of(row) in RULED]
    fresh = lambda some: [row for row in some if kind_of(row) not in RULED]
    return {
        "none_of_these": {"ruled": share(map(is_none, ruled(alone))), "fresh": share(map(is_none, fresh(alone)))},
        "left": {"ruled": share(row["left"] for row in ruled(alone)), "fresh": share(row["left"] for row in fresh(alone))},
        "each": each(alone, kind_of, is_none),
        "beside": {
            str(count): {
                "in_part": share(is_in_part(row) for row in beside if len(row["hidden"]) == count),
                "left": share(row["left"] for row in beside if len(row["hidden"]) == count),
                "false": share(bool(row["false"]) for row in beside if len(row["hidden"]) == count),
            }
            for count in sorted({len(row["hidden"]) for row in beside})
        },
        "each_beside": each(beside, kind_of, is_in_part),
    }


def of_templates(rows):
    """Figures of the templates that findings tell, in worlds whose residual was detected."""
    told = [row for row in rows if row["missing"]]
    placed = [row for row in told if row["unlisted"]["place"] is not None]
    is_near = lambda row: row["missing"]["place"] is not None and abs(row["missing"]["place"] - row["unlisted"]["place"]) <= NEAR
    is_hook = lambda row: bool(row["missing"]) and row["missing"]["hook"] == row["unlisted"]["hook"]
    return {
        "told": share(bool(row["missing"]) for row in rows),
        "hook": share(map(is_hook, told)),
        "place": share(map(is_near, placed)),
        "each": {
            name: {"hook": share(is_hook(row) for row in told if row["unlisted"]["name"] == name)}
            for name in sorted({row["unlisted"]["name"] for row in told})
        },
    }


def shares_held(rows):
    """Shares of worlds whose object lies between the 5 and 95 % quantiles of the present and of the repaired model."""
    return [share(row["held"][i] for row in rows if row["held"][1] is not None) for i in (0, 1)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--measured", type=pathlib.Path, help="scores of other worlds, as --rows prints them; may end in .gz")
    printed = parser.add_mutually_exclusive_group()
    printed.add_argument("--json", action="store_true", help="print the table as JSON")
    printed.add_argument("--rows", action="store_true", help="print the score of each world, a line each")
    arguments = parser.parse_args()
    if not arguments.measured and not (arguments.out / "seals.txt").exists():
        sys.exit(f"{arguments.out / 'seals.txt'}: expected the seals of drawn worlds, or --measured ROWS.jsonl")
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = together([row_of(*pair) for pair in opened(arguments.out)] + left_out(arguments.out), arguments.measured)
    if all(row["kind"] == "left_out" for row in rows):
        sys.exit(f"{arguments.measured or arguments.out}: expected the score of at least one world")
    if arguments.rows:
        print("\n".join(json.dumps(row, separators=(",", ":")) for row in rows))
        return
    found = summary(rows)
    (arguments.out / "score.json").write_text(json.dumps({"summary": found, "rows": rows}))
    draw(rows, found, arguments.out / "score.png")
    print(json.dumps(found) if arguments.json else text(found))


if __name__ == "__main__":
    main()
