"""Figures of two sets of scores by our comparison and by rliable.

Estimates have to agree to rounding. The ends of a bootstrap interval are estimates themselves: they have to agree within 4.5 standard
deviations of --repeats intervals of rliable with other draws, or within the step of a share.
"""

import argparse
import json
import subprocess
import sys
import warnings

import numpy
from rliable import library, metrics

THRESHOLDS = [0.2, 0.4, 0.6, 0.8]
# Scores of a unit test of `catenary_core::comparison`.
REFERENCE = (
    [[0.9, 0.7, 0.8, 0.6, 0.95], [0.5, 0.4, 0.45, 0.55, 0.3]],
    [[0.6, 0.65, 0.7, 0.5, 0.55], [0.5, 0.35, 0.2, 0.4, 0.25]],
)


def ours(program, first, second, resamples):
    given = {"first": first, "second": second, "thresholds": THRESHOLDS, "resamples": resamples}
    done = subprocess.run([program], input=json.dumps(given), capture_output=True, text=True, check=True)
    figures = json.loads(done.stdout)
    rows = {name: figures[name] for name in ("interquartile_mean", "probability_of_improvement")}
    rows |= {f"share above {t}": row for t, row in zip(THRESHOLDS, figures["performance_profile"], strict=True)}
    return {name: [row["value"], row["low"], row["high"]] for name, row in rows.items()}


def theirs(first, second, resamples, seed):
    """Rows of rliable are runs, and its columns are tasks."""
    x, y = numpy.array(first).T, numpy.array(second).T
    state = numpy.random.RandomState(seed)
    mean, mean_ends = library.get_interval_estimates(
        {"x": x}, lambda s: numpy.array([metrics.aggregate_iqm(s)]), reps=resamples, random_state=state
    )
    better, better_ends = library.get_interval_estimates(
        {"xy": (x, y)}, metrics.probability_of_improvement, reps=resamples, random_state=state
    )
    rows = {
        "interquartile_mean": [mean["x"][0], *mean_ends["x"][:, 0]],
        "probability_of_improvement": [float(better["xy"]), *better_ends["xy"].ravel()],
    }
    profiles, ends = library.create_performance_profile({"x": x}, THRESHOLDS, reps=resamples)
    for k, threshold in enumerate(THRESHOLDS):
        rows[f"share above {threshold}"] = [profiles["x"][k], *ends["x"][:, k]]
    return {name: [float(v) for v in row] for name, row in rows.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", required=True)
    parser.add_argument("--sets", type=int, default=4, help="random sets of scores beside the reference")
    parser.add_argument("--resamples", type=int, default=2000)
    parser.add_argument("--repeats", type=int, default=8)
    arguments = parser.parse_args()
    # rliable 1.2 passes its random state to arch in a way that arch calls old.
    warnings.simplefilter("ignore", FutureWarning)
    rng = numpy.random.default_rng(7)
    sets = [REFERENCE]
    for _ in range(arguments.sets):
        middle = rng.uniform(0.3, 0.8, (4, 1))
        sets.append(tuple((middle + rng.normal(shift, 0.12, (4, 10))).clip(-1, 1).tolist() for shift in (0.05, 0.0)))
    wrong = 0
    print("| set | figure | ours | rliable |\n|---|---|---|---|")
    for number, (first, second) in enumerate(sets):
        own = ours(arguments.program, first, second, arguments.resamples)
        drawn = [theirs(first, second, arguments.resamples, seed) for seed in range(arguments.repeats)]
        for name, row in own.items():
            others = numpy.array([d[name] for d in drawn])
            spread = others.std(axis=0, ddof=1)
            mean = others.mean(axis=0)
            # Ends of a share are multiples of one over the number of scores.
            least = 0.5 / numpy.size(first) if name.startswith("share") else 1e-3
            same = abs(row[0] - mean[0]) < 1e-9 and (abs(row - mean)[1:] < numpy.maximum(4.5 * spread[1:], 2 * least)).all()
            wrong += not same
            words = [f"{v[0]:.4f} ({v[1]:.3f} to {v[2]:.3f})" for v in (row, mean)]
            print(f"| {number} | {name} | {words[0]} | {words[1]} |{'' if same else ' DIFFERS'}")
    sys.exit(f"{wrong} figures differ" if wrong else None)


if __name__ == "__main__":
    main()
