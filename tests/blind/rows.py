"""Rows: the score of each world, a line of JSON each.

`rules` numbers the rules by which a row was scored. Rows without it have the rules 1: two episodes a world, and no residual beside an
effect. They are read by the old rules, and tables of different rules are never mixed.
"""

import gzip
import json
import sys

RULES = 2
# Least probability that enters the calibration: thousands of effects near 0 would hide the others.
IMPOSSIBLE = 0.01
NAMED = ("named", "named_in_part", "cannot_tell_apart")
# 5 and 95 % quantiles of a normal distribution, in standard deviations.
NINETY = 1.645
# Distance within which a place is right, as a fraction of the length.
NEAR = 0.1
# Unlisted kinds that the rules of naming were made on; all others are fresh.
RULED = ("middle_mass_kg", "soft_joint", "gust_n_m", "tremor_rad")


def ranks_of(finding):
    """Names of the candidates, the most probable first."""
    return [p["name"] for p in finding["presence"]]


def row_of(answer, finding):
    """Score of a finding against the hidden effects."""
    hidden, found = set(answer["hidden"]), finding["found"]
    first = {alike[0] for alike in found}
    groups = [{part for one in alike for part in one.split(" + ")} for alike in found]
    named = finding["verdict"] in NAMED
    check = finding["verification"]
    return {
        "rules": RULES,
        "seed": answer["seed"],
        "number": answer["number"],
        "kind": answer["kind"],
        "object": answer["object"],
        "size": answer["size"],
        "hidden": sorted(hidden),
        "unlisted": answer["unlisted"] and {key: short(value) for key, value in answer["unlisted"].items()},
        "drive": answer["drive"],
        "verdict": finding["verdict"],
        "found": found,
        "nearest": finding.get("nearest", []),
        "p": finding["present"]["test"]["p_value"],
        "null_sets": len(finding["present"]["test"]["null"]),
        "detected": finding["verdict"] != "no_gap",
        "top_1": named and first == hidden,
        "top_3": bool(hidden) and hidden <= set(ranks_of(finding)[: 2 + len(hidden)]),
        # Each hidden effect is in a named group, or in one of the alternatives to a narrow prior, and no group is left over.
        "group": (
            (named or finding["verdict"] == "prior_too_narrow")
            and len(found) == len(hidden)
            and all(any(h in g for g in groups) for h in hidden)
        ),
        "false": false_names(finding["verdict"], found, hidden),
        "z": {name: z(finding, name, value) for name, value in answer["hidden"].items() if named and name in first},
        "held": [held(finding[fit], answer["theta"]) for fit in ("present", "repaired")],
        # The best model leaves a residual that no effect explains.
        "left": finding["verdict"] == "none_of_these" or finding["discrepancy"] is not None,
        "missing": missing(finding),
        "closed": check["gap_closed"] and round(check["gap_closed"], 4) if check else None,
        "wall_s": round(finding["wall_s"], 1),
        "probabilities": [(round(p["probability"], 4), p["name"] in hidden) for p in finding["presence"] if p["probability"] > IMPOSSIBLE],
    }


def short(value):
    """Number with four significant figures; anything else stays."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def false_names(verdict, found, hidden):
    """Named effects of which nothing is hidden: the most probable of each group without a hidden effect. A model that replaces several
    effects together stands in a group as a whole."""
    if verdict not in NAMED:
        return []
    parts = lambda alike: {part for one in alike for part in one.split(" + ")}
    return [alike[0] for alike in found if not parts(alike) & set(hidden)]


def z(finding, name, value):
    """Named magnitude less the hidden one, in standard deviations; none without a standard deviation."""
    wanted = {alike[0] for alike in finding["found"]}
    for explanation in finding["explanations"]:
        effects = {e["name"]: e for e in explanation["effects"]}
        if effects.keys() == wanted:
            sd = effects[name]["sd"]
            return round((effects[name]["value"] - value) / sd, 3) if sd else None
    return None


def held(fit, theta):
    """Returns whether a fit holds all true values of the object between its 5 and 95 % quantiles; none without a fit."""
    said = {e["name"]: e for e in fit["estimates"]} if fit else {}
    return all(said[name]["q05"] <= value <= said[name]["q95"] for name, value in theta.items()) if fit else None


def missing(finding):
    """Template that stands for what is missing, with the figures that are scored; none if the finding has none."""
    told = finding.get("missing")
    return told and {key: short(told[key]) for key in ("hook", "template", "place", "frequency_hz", "probability")}


def is_additional(row):
    """Returns whether the row names more effects than are hidden, one of them falsely."""
    return bool(row["false"]) and len(row["found"]) > len(row["hidden"])


def of_rules_1(row):
    """Row of the old rules with the fields of the new ones that it determines."""
    is_unlisted = row["kind"] == "unlisted"
    hidden = [] if is_unlisted else row["hidden"]
    unlisted = {"name": row["hidden"][0], "hook": None, "place": None, "frequency_hz": None} if is_unlisted else None
    kind = "structured" if is_unlisted else row["kind"]
    more = {"rules": 1, "kind": kind, "hidden": hidden, "unlisted": unlisted, "object": None, "z": {}, "missing": None}
    if kind != "left_out":
        more["false"] = false_names(row["verdict"], row["found"], hidden)
        # Some old rows were written before this field.
        more["left"] = row.get("left", row["verdict"] in ("none_of_these", "named_in_part"))
    return row | more


def read(path):
    """Rows of a file, which may be compressed."""
    opened = gzip.open if path.suffix == ".gz" else open
    with opened(path, "rt") as file:
        rows = [json.loads(line) for line in file]
    return [row if "rules" in row else of_rules_1(row) for row in rows]


def together(rows, measured):
    """Rows, with those of other worlds from a file; exits if they were scored by different rules."""
    others = read(measured) if measured else []
    rules = {row["rules"] for row in [*others, *rows]}
    if len(rules) > 1:
        sys.exit(f"{measured}: expected rows of one set of rules, got rows of the rules {sorted(rules)}")
    of = lambda row: (row["seed"], row["number"])
    all_rows = {of(row): row for row in [*others, *rows]}
    return [all_rows[key] for key in sorted(all_rows)]
