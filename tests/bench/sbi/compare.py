"""Trains our networks and those of `sbi` on the same simulations of public tasks and compares with the published posteriors.

The script tests/bench/sbi/run calls it; see its README.md. Results are kept in --out, and an interrupted run goes on from there.
"""

import argparse
import hashlib
import json
import os
import sys
from collections import defaultdict
from pathlib import Path

# One thread for each estimator; numpy and torch read the variables when they are imported.
for threads in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"]:
    os.environ.setdefault(threads, "1")

import numpy as np  # noqa: E402
import torch  # noqa: E402

import estimators  # noqa: E402
from c2st import side_by_side  # noqa: E402
from tasks import TASKS, References  # noqa: E402

# Larger than the defaults, which are for a hundred tracks at a time whose posteriors are nearly Gaussian.
SETTINGS = {
    "components": 8,
    "hidden": [64, 64, 64],
    "schedule": {"weight_decay": 0.3, "max_epochs": 1000, "patience_epochs": 30},
}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", type=Path, required=True, help="the built example `estimate`")
    parser.add_argument("--wheel", type=Path, required=True, help="the wheel of sbibm 1.1.0, for its data files")
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--tasks", nargs="+", default=list(TASKS), choices=list(TASKS))
    parser.add_argument("--sizes", nargs="+", type=int, default=[1000, 10000], help="simulations")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--observations", type=int, default=10, help="of each task, up to 10")
    parser.add_argument("--estimators", nargs="+", default=["catenary", "mdn", "maf"])
    parser.add_argument("--settings", type=json.loads, default={}, help="catenary's settings in place of SETTINGS below, JSON")
    parser.add_argument("--measured", type=Path, help="results that are taken as they are, as --json prints them")
    parser.add_argument("--json", action="store_true", help="print every result, a line each, instead of the table")
    return parser.parse_args()


def measure(args: argparse.Namespace, references: References, name: str, size: int, seed: int, estimator: str) -> dict:
    task = TASKS[name]
    rng = np.random.default_rng([seed, size, *name.encode()])
    thetas = task.prior(size, rng)
    numbers = range(1, args.observations + 1)
    data = estimators.Data(
        thetas,
        task.simulate(thetas, rng),
        np.array([references.observation(name, i) for i in numbers]),
        np.array([task.estimated(references.truth(name, i)) for i in numbers]),
    )
    if estimator == "catenary":
        estimate = estimators.catenary(args.program, task, data, 10_000, seed, args.settings)
    else:
        estimate = estimators.sbi(estimator, task, data, 10_000, seed)
    pairs = [(references.posterior(name, i), task.published(draws)) for i, draws in zip(numbers, estimate.draws)]
    volumes = [task.log_volume(truth) for truth in data.truths]
    return {
        "task": name,
        "simulations": size,
        "seed": seed,
        "estimator": estimator,
        "c2st": side_by_side(pairs),
        "log_probability": [log - volume for log, volume in zip(estimate.log_probabilities, volumes)],
        "train_s": estimate.train_s,
    }


def known(path: Path | None) -> dict[tuple, dict]:
    """Results of a file by seed, simulations, task and estimator."""
    lines = path.read_text().splitlines() if path else []
    results = [json.loads(line) for line in lines]
    return {(r["seed"], r["simulations"], r["task"], r["estimator"]): r for r in results}


def variant(args: argparse.Namespace, estimator: str) -> str:
    """Part of a result's file name: hash of the number of observations and, for our networks, of settings and program."""
    told = [args.observations, "processor's seconds"]
    if estimator == "catenary":
        told += [args.settings, hashlib.sha256(args.program.read_bytes()).hexdigest()]
    return "_" + hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:8]


def table(results: list[dict]) -> str:
    """Table with a line for each task and size: means over seeds and observations."""
    cells = defaultdict(list)
    for result in results:
        cells[result["task"], result["simulations"], result["estimator"]].append(result)
    names = list(dict.fromkeys(r["estimator"] for r in results))
    lines = ["| task | simulations | " + " | ".join(f"{n} C2ST | {n} log p | {n} s" for n in names) + " |"]
    lines.append("|---" * (2 + 3 * len(names)) + "|")
    for task, size in dict.fromkeys((r["task"], r["simulations"]) for r in results):
        row = f"| {task} | {size} |"
        for name in names:
            found = cells.get((task, size, name), [])
            if not found:
                row += " - | - | - |"
                continue
            mean = lambda key, found=found: np.mean([np.mean(r[key]) for r in found])
            # Standard deviation between seeds, which needs two of them.
            spread = np.std([np.mean(r["c2st"]) for r in found], ddof=1) if len(found) > 1 else np.nan
            row += f" {mean('c2st'):.3f} +- {spread:.3f} | {mean('log_probability'):.2f} | {mean('train_s'):.1f} |"
        lines.append(row)
    return "\n".join(lines)


def main() -> None:
    args = arguments()
    if args.measured and (args.settings or args.observations != 10):
        sys.exit("--measured: such a file holds results of the usual settings and of all 10 observations")
    torch.set_num_threads(1)
    args.out.mkdir(parents=True, exist_ok=True)
    for name in set(SETTINGS) - set(args.settings):
        args.settings[name] = SETTINGS[name]
    args.program, args.wheel, args.out = (path.resolve() for path in (args.program, args.wheel, args.out))
    args.measured = args.measured and args.measured.resolve()
    # sbi writes its logs into the working directory.
    os.chdir(args.out)
    references = References(args.wheel)
    results = []
    wanted = [
        (seed, size, name, estimator) for seed in args.seeds for size in args.sizes for name in args.tasks for estimator in args.estimators
    ]
    measured = known(args.measured)
    for done, (seed, size, name, estimator) in enumerate(wanted, 1):
        if result := measured.get((seed, size, name, estimator)):
            results.append(result)
            continue
        path = args.out / f"{name}_{size}_{seed}_{estimator}{variant(args, estimator)}.json"
        if not path.exists():
            print(f"{done}/{len(wanted)}: {name}, {size} simulations, seed {seed}, {estimator}", file=sys.stderr)
            result = measure(args, references, name, size, seed, estimator)
            part = path.with_suffix(".part")
            part.write_text(json.dumps(result))
            part.rename(path)
            shown = f"C2ST {np.mean(result['c2st']):.3f}, {result['train_s']:.1f} s"
            print(f"  {shown}", file=sys.stderr)
        results.append(json.loads(path.read_text()))
    print("\n".join(json.dumps(r) for r in results) if args.json else table(results))


if __name__ == "__main__":
    main()
