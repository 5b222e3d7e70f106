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
from scipy import stats

# Least probability that enters the calibration: thousands of effects near 0 would hide the others.
IMPOSSIBLE = 0.01
BINS = 10
NAMED = ("named", "named_in_part", "cannot_tell_apart")


def wilson(successes, trials):
    """Wilson's interval of 95 % of a share (1927)."""
    if trials == 0:
        return [0.0, 1.0]
    return [float(end) for end in stats.binomtest(successes, trials).proportion_ci(0.95, "wilson")]


def kolmogorov_p(values):
    """p-value of uniformity on 0 to 1 after Kolmogorov and Smirnov."""
    return float(stats.kstest(values, "uniform").pvalue) if len(values) else 1.0


def spread(rows):
    """p-values spread evenly over their steps of 1 / (1 + B): those of a test by simulation are then uniform on 0 to 1."""
    rng = numpy.random.default_rng(0)
    return [row["p"] - rng.uniform() / (1 + row["null_sets"]) for row in rows]


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
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


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
        "seed": answer["seed"],
        "number": answer["number"],
        "kind": answer["kind"],
        "size": answer["size"],
        "hidden": sorted(hidden),
        "drive": answer["drive"],
        "verdict": finding["verdict"],
        "found": found,
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
        "held": [held(finding[fit], answer["theta"]) for fit in ("present", "repaired")],
        # The best model leaves a residual that no effect explains.
        "left": finding["verdict"] == "none_of_these" or finding["discrepancy"] is not None,
        "closed": check["gap_closed"] and round(check["gap_closed"], 4) if check else None,
        "wall_s": round(finding["wall_s"], 1),
        "probabilities": [(round(p["probability"], 4), p["name"] in hidden) for p in finding["presence"] if p["probability"] > IMPOSSIBLE],
    }


def held(fit, theta):
    """Returns whether a fit holds all true values of the object between its 5 and 95 % quantiles; none without a fit."""
    said = {e["name"]: e for e in fit["estimates"]} if fit else {}
    return all(said[name]["q05"] <= value <= said[name]["q95"] for name, value in theta.items()) if fit else None


def together(rows, measured):
    """Rows, with those of other worlds from a file."""
    lines = measured.read_text().splitlines() if measured else []
    of = lambda row: (row["seed"], row["number"])
    all_rows = {of(row): row for row in [*map(json.loads, lines), *rows]}
    return [all_rows[key] for key in sorted(all_rows)]


def calibration(rows):
    """Expected calibration error of the probabilities of presence, weighted by the size of the bins, and the bins."""
    pairs = [pair for row in rows if row["kind"] != "none" for pair in row["probabilities"]]
    if not pairs:
        return None, []
    said, true = numpy.array([p for p, _ in pairs]), numpy.array([float(t) for _, t in pairs])
    place = numpy.minimum((said * BINS).astype(int), BINS - 1)
    bins = [(said[place == b].mean(), true[place == b].mean(), int((place == b).sum())) for b in range(BINS) if (place == b).any()]
    return float(sum(n * abs(s - t) for s, t, n in bins) / len(pairs)), bins


def share(rows, key):
    """Share of rows with its interval, and their number."""
    hits = sum(bool(row[key]) for row in rows)
    return {"share": hits / len(rows) if rows else None, "interval": wilson(hits, len(rows)), "of": len(rows)}


def summary(all_rows):
    rows, missing = [[row for row in all_rows if (row["kind"] == "left_out") == out] for out in (False, True)]
    nulls = [row for row in rows if row["kind"] == "none"]
    effects = [row for row in rows if row["kind"] == "effect"]
    of = lambda **wanted: [row for row in rows if all(row[k] == v for k, v in wanted.items())]
    sizes = sorted({row["size"] for row in effects})
    error, bins = calibration(rows)
    closed = lambda some: [row["closed"] for row in some if row["closed"] is not None]
    median = lambda values: float(numpy.median(values)) if values else None
    unlisted = of(kind="unlisted")
    for row in unlisted:
        row["none_of_these"] = row["verdict"] == "none_of_these"
        row["left"] = row.get("left", row["verdict"] in ("none_of_these", "named_in_part"))
    by_effect = {}
    for name in sorted({row["hidden"][0] for row in effects}):
        own, none = [[row for row in some if row["hidden"] == [name]] for some in (effects, missing)]
        by_effect[name] = {}
        for size in sizes:
            some = [row for row in own if row["size"] == size]
            by_effect[name][str(size)] = {key: share(some, key) for key in ("detected", "top_1", "top_3", "group")} | {
                "left_out": sum(row["size"] == size for row in none),
                "held": shares_held([row for row in some if row["top_1"]]),
                "instead": instead([row for row in some if not row["top_1"]]),
            }
    of_size = lambda size: [row for row in effects if row["size"] == size]
    return {
        "worlds": len(rows),
        "left_out": dict(collections.Counter(" + ".join(row["hidden"]) for row in missing)),
        "false_alarms": share(nulls, "detected"),
        "p_uniform": kolmogorov_p(spread(nulls)) if nulls else None,
        "sizes": {str(s): {key: share(of_size(s), key) for key in ("detected", "top_1", "top_3", "group")} for s in sizes},
        "effects": by_effect,
        "held": {str(s): shares_held([r for r in of_size(s) if r["top_1"]]) for s in sizes},
        "pairs": {key: share(of(kind="pair"), key) for key in ("detected", "top_1", "group")},
        "each_pair": each(of(kind="pair"), "top_1"),
        "none_of_these": share(unlisted, "none_of_these"),
        "left_of_unlisted": share(unlisted, "left"),
        "each_unlisted": each(unlisted, "none_of_these"),
        "calibration_error": error,
        "bins": bins,
        "gap_closed": {str(s): median(closed([r for r in effects if r["size"] == s])) for s in sizes},
        "wall_s": float(numpy.mean([row["wall_s"] for row in rows])) if rows else None,
    }


def each(rows, key):
    """Share of rows of each effect, or combination of effects."""
    of = collections.defaultdict(list)
    for row in rows:
        of[" + ".join(row["hidden"])].append(row)
    return {name: share(of[name], key) | {"instead": instead([row for row in of[name] if not row[key]])} for name in sorted(of)}


def instead(rows):
    """Answers given for the rows, with their numbers."""
    return dict(collections.Counter(map(what_of, rows)).most_common())


def text(found):
    percent = lambda s: "-" if s["share"] is None else f"{s['share']:.0%} of {s['of']} ({s['interval'][0]:.0%} to {s['interval'][1]:.0%})"
    lines = [f"false alarms  {percent(found['false_alarms'])}, p-values uniform: p = {found['p_uniform']}"]
    for size, row in found["sizes"].items():
        detected, top_1, top_3, group = (percent(row[key]) for key in ("detected", "top_1", "top_3", "group"))
        closed = found["gap_closed"][size]
        lines.append(f"{size} x  detected {detected}, top-1 {top_1}, top-3 {top_3}, group {group}, gap closed {closed}")
        present, repaired = map(percent, found["held"][size])
        lines.append(f"{size} x, named  object held by the present model {present}, by the repaired one {repaired}")
    detected, top_1, group = (percent(found["pairs"][key]) for key in ("detected", "top_1", "group"))
    lines.append(f"pairs  detected {detected}, both named {top_1}, in groups {group}")
    lines += [f"  {name}  {percent(row)}{counted(row['instead'])}" for name, row in found["each_pair"].items()]
    lines.append(f"none of these  {percent(found['none_of_these'])}, or a residual left {percent(found['left_of_unlisted'])}")
    lines += [f"  {name}  {percent(row)}{counted(row['instead'])}" for name, row in found["each_unlisted"].items()]
    lines.append(f"calibration error  {found['calibration_error']}")
    lines += [f"  said {said:.2f}: present {true:.2f} of {n}" for said, true, n in found["bins"]]
    lines += ["", *table_of_effects(found["effects"]), ""]
    lines.append("could not be drawn: " + (", ".join(f"{name} {n}" for name, n in found["left_out"].items()) or "none"))
    lines.append(f"{found['worlds']} worlds, {found['wall_s']:.0f} s each")
    return "\n".join(lines)


def counted(instead):
    """Wrong answers with their numbers, the most frequent first."""
    return "".join(f", {what} {n}" for what, n in instead.items())


def table_of_effects(effects):
    """Markdown table with a row for each effect.

    A cell has the shares of worlds in which the effect was detected, named, and in a named group, the wrong answers, and the number of
    worlds that could not be drawn.
    """
    sizes = list(next(iter(effects.values()), {}))
    percent = lambda row: " / ".join(f"{row[key]['share']:.0%}" for key in ("detected", "top_1", "group")) + f" of {row['top_1']['of']}"
    left_out = lambda row: {"left out": row["left_out"]} if row["left_out"] else {}
    cell = lambda row: (percent(row) if row["top_1"]["of"] else "-") + counted(row["instead"] | left_out(row))
    lines = ["| effect | " + " | ".join(f"{size} x" for size in sizes) + " |", "|---" * (1 + len(sizes)) + "|"]
    return lines + [f"| {name} | " + " | ".join(map(cell, of.values())) + " |" for name, of in effects.items()]


def shares_held(rows):
    """Shares of worlds whose object lies between the 5 and 95 % quantiles of the present and of the repaired model."""
    return [share([{"held": row["held"][i]} for row in rows if row["held"][1] is not None], "held") for i in (0, 1)]


def draw(rows, found, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plot

    figure, axes = plot.subplots(2, 2, figsize=(16, 14), layout="constrained")
    confusion(axes[0][0], rows)
    for sizes in found["effects"].values():
        points = [(float(s), row["detected"]["share"]) for s, row in sizes.items() if row["detected"]["of"]]
        axes[0][1].plot(*zip(*points), color="0.8", lw=1)
    shares = [(float(s), row["detected"]["share"], row["group"]["share"]) for s, row in found["sizes"].items()]
    if shares:
        x, power, named = zip(*shares)
        axes[0][1].plot(x, power, "o-", label="detected")
        axes[0][1].plot(x, named, "s-", label="named, groups counting as theirs")
        axes[0][1].legend()
    axes[0][1].set(xlabel="magnitude, detectable sizes", ylabel="share of worlds", ylim=(-0.02, 1.02), title="power")
    p = numpy.sort([row["p"] for row in rows if row["kind"] == "none"])
    axes[1][0].plot((numpy.arange(len(p)) + 0.5) / max(len(p), 1), p, ".")
    axes[1][0].plot([0, 1], [0, 1], color="0.6")
    axes[1][0].set(xlabel="quantile of the uniform distribution", ylabel="p-value", title="worlds without an effect")
    if found["bins"]:
        said, true, n = zip(*found["bins"])
        axes[1][1].scatter(said, true, s=[10 + 4 * k for k in n])
    axes[1][1].plot([0, 1], [0, 1], color="0.6")
    axes[1][1].set(xlabel="probability said", ylabel="share that is present", title="calibration")
    figure.savefig(path, dpi=80)


def confusion(axes, rows):
    """Confusion matrix of hidden and named effects at the largest size."""
    effects = [row for row in rows if row["kind"] in ("effect", "unlisted", "none")]
    most = max((row["size"] for row in effects), default=0)
    effects = [row for row in effects if row["size"] in (0.0, most)]
    hidden = sorted({" ".join(row["hidden"]) or "nothing" for row in effects})
    said = sorted({what_of(row) for row in effects})
    table = numpy.zeros((len(hidden), len(said)))
    for row in effects:
        table[hidden.index(" ".join(row["hidden"]) or "nothing"), said.index(what_of(row))] += 1
    axes.imshow(table / numpy.maximum(table.sum(axis=1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=1)
    axes.set_xticks(range(len(said)), said, rotation=90, fontsize=7)
    axes.set_yticks(range(len(hidden)), hidden, fontsize=7)
    axes.set_title(f"hidden (rows) and named (columns), {most:g} x")


def what_of(row):
    return " + ".join(alike[0] for alike in row["found"]) if row["verdict"] in NAMED else row["verdict"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--measured", type=pathlib.Path, help="scores of other worlds, as --rows prints them")
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
        print("\n".join(map(json.dumps, rows)))
        return
    found = summary(rows)
    (arguments.out / "score.json").write_text(json.dumps({"summary": found, "rows": rows}))
    draw(rows, found, arguments.out / "score.png")
    print(json.dumps(found) if arguments.json else text(found))


if __name__ == "__main__":
    main()
