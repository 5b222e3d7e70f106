"""Trains estimators of `sbi` on tracks of `catenary bench networks --export FILE` and prints their mean log density at the truths.

The script `tests/bench/sbi/run tracks FILE` calls it. Tracks, truths, coordinates and units are those of our networks in that bench.
"""

import argparse
import contextlib
import json
import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

FIELDS = ("thetas", "rows", "truths", "observations")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, help="what `catenary bench networks --export` wrote")
    parser.add_argument("--estimators", nargs="+", default=["mdn", "maf", "nsf"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    try:
        document = json.loads(args.file.read_text())
        thetas, rows, truths, observations = (np.array(document[name], dtype=np.float32) for name in FIELDS)
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"{args.file}: expected what `catenary bench networks --export` writes: {error!r}")
    import torch
    from sbi.inference import NPE
    from sbi.utils import BoxUniform

    warnings.filterwarnings("ignore")
    torch.set_num_threads(args.threads)
    # sbi writes its logs into the working directory.
    logs = tempfile.TemporaryDirectory()
    os.chdir(logs.name)
    # Columns that never vary are left out: they carry no information, and cannot be scaled.
    varies = rows.std(axis=0) > 1e-6
    dimension = thetas.shape[1]
    print("| estimator | seed | log density at the truth, nat | seconds of training |\n|---|---|---|---|")
    for estimator in args.estimators:
        found = []
        for seed in args.seeds:
            torch.manual_seed(seed)
            prior = BoxUniform(torch.zeros(dimension), torch.ones(dimension))
            inference = NPE(prior, density_estimator=estimator, show_progress_bars=False)
            started = time.perf_counter()
            simulations = inference.append_simulations(torch.tensor(thetas), torch.tensor(rows[:, varies]))
            with contextlib.redirect_stdout(sys.stderr):
                density = simulations.train()
            took_s = time.perf_counter() - started
            with torch.no_grad():
                at_truth = density.log_prob(torch.tensor(truths)[None], condition=torch.tensor(observations[:, varies]))
            found.append(at_truth.mean().item())
            print(f"| {estimator} | {seed} | {at_truth.mean().item():.2f} | {took_s:.1f} |", flush=True)
        print(f"| {estimator} | all | {np.mean(found):.2f} | |", flush=True)


if __name__ == "__main__":
    main()
