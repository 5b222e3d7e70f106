"""Posteriors of the paper's four bars, each hidden in a simulated cell: errors of the means and coverage of the regions.

    source .venv/ros.env; .venv/bin/python tests/bench/bars/bars.py --out DIR [--seeds 10] [--preset default|paper] [--json]

A cell is `catenary simulate --noise --fidelity reference`: finer than the simulator of the inference, with camera noise, and with
lag of the arm, friction and damping drawn at random. The inference gets soft_bar.yaml, which does not contain the bars. Results that
DIR holds are not computed again. Each folder holds a report.html with the heatmap and the twelve training domains.

Each of the 4 x 10 inferences of the default preset takes about half a minute on two cores.
"""

import argparse
import csv
import json
import pathlib
import shutil
import subprocess
import sys

import numpy
from catenary_inspect import posterior
from scipy.stats import multivariate_normal

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import motion
from support.program import MODELS, PROGRAM

BARS = range(4)


def program(*arguments):
    """Runs the program, which has to succeed, with a result that fits or not (3); returns its stdout."""
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        sys.exit(f"catenary {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def infer(folder, bar, seed, preset):
    """Measures and infers unless the folder holds the result; returns the document of `infer --json`."""
    found = folder / "inference.json"
    if not found.exists():
        folder.mkdir(parents=True, exist_ok=True)
        table, bag = folder / "actions.csv", folder / "bag"
        with table.open("w", newline="") as file:
            csv.writer(file).writerows([("dx_m", "dz_m"), *(map(repr, map(float, row)) for row in motion.actions(seed))])
        if not bag.exists():
            # Renamed when it is complete, so that an interrupted run leaves no half bag.
            measuring, half = ("--noise", "--seed", seed, "--fidelity", "reference"), folder / "half"
            shutil.rmtree(half, ignore_errors=True)
            program("simulate", "--model", MODELS / f"dlo_{bar}.yaml", "--actions", table, *measuring, "--out", half / "bag")
            (half / "bag").rename(bag)
            half.rmdir()
        asked = ("--model", MODELS / "soft_bar.yaml", "--preset", preset, "--seed", seed)
        program("infer", "--bag", bag, *asked, "--out", folder)
    return json.loads(found.read_text())


def nominal(bar):
    """Length in m and Young's modulus in Pa of dlo_N.yaml."""
    line = next(line for line in (MODELS / f"dlo_{bar}.yaml").read_text().splitlines() if line.startswith("nominal:"))
    return [float(part.split(":")[-1]) for part in line.removeprefix("nominal:").strip(" {}").split(",")]


def density(estimate, unit):
    """Density of a posterior's mixture at rows of unit coordinates (N x D)."""
    parts = zip(estimate.weights, estimate.means, estimate.covariances)
    return sum(weight * numpy.atleast_1d(multivariate_normal(mean, covariance).pdf(unit)) for weight, mean, covariance in parts)


def row_of(bar, seed, answer, path):
    """Errors of the mean, and the mass of the smallest region of highest density that contains the truth."""
    truth, estimate = nominal(bar), posterior.of_file(path)
    unit = [prior.share_below(value) for (_, prior), value in zip(estimate.parameters, truth)]
    at_truth = density(estimate, numpy.array([unit]))[0]
    length, modulus = answer["marginals"]
    return {
        "bar": bar,
        "seed": seed,
        "truth": truth,
        "mean": [length["mean"], modulus["mean"]],
        "sd": [length["sd"], modulus["sd"]],
        "inside": [m["q05"] <= t <= m["q95"] for m, t in zip(answer["marginals"], truth)],
        "error_mm": 1e3 * abs(length["mean"] - truth[0]),
        "error_log10": float(abs(numpy.log10(modulus["mean"] / truth[1]))),
        "mass": float(numpy.mean(density(estimate, estimate.unit) > at_truth)),
        "wall_s": answer["wall_s"],
    }


def summary(rows):
    mean = lambda key: float(numpy.mean([row[key] for row in rows]))
    inside = [float(numpy.mean([row["inside"][i] for row in rows])) for i in range(2)]
    return {
        "runs": len(rows),
        "error_mm": mean("error_mm"),
        "error_log10": mean("error_log10"),
        "sd_mm": 1e3 * float(numpy.mean([row["sd"][0] for row in rows])),
        "length_90": inside[0],
        "modulus_90": inside[1],
        "region_50": float(numpy.mean([row["mass"] <= 0.5 for row in rows])),
        "region_90": float(numpy.mean([row["mass"] <= 0.9 for row in rows])),
        "wall_s": mean("wall_s"),
    }


def text(found):
    columns = [("runs", "{:d}"), ("error_mm", "{:.2f}"), ("sd_mm", "{:.2f}"), ("error_log10", "{:.4f}")]
    columns += [(key, "{:.0%}") for key in ("length_90", "modulus_90", "region_50", "region_90")] + [("wall_s", "{:.1f}")]
    lines = [["bar", *(key for key, _ in columns)]]
    lines += [[name, *(form.format(row[key]) for key, form in columns)] for name, row in found.items()]
    return "\n".join("  ".join(f"{cell:>11}" for cell in line) for line in lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seeds", type=int, default=10, help="measurements of each bar")
    parser.add_argument("--preset", choices=["default", "paper"], default="default")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = []
    for seed in range(1, arguments.seeds + 1):
        for bar in BARS:
            folder = arguments.out / arguments.preset / f"bar_{bar}_{seed}"
            # Every bar of every seed gets another motion.
            answer = infer(folder, bar, len(BARS) * seed + bar, arguments.preset)
            rows.append(row_of(bar, seed, answer, folder / "posterior.json"))
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    found = {f"DLO-{bar}": summary([row for row in rows if row["bar"] == bar]) for bar in BARS} | {"all": summary(rows)}
    print(json.dumps({"rows": rows, "summary": found}) if arguments.json else text(found))


if __name__ == "__main__":
    main()
