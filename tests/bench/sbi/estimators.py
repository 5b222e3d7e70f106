"""The estimators that are compared: each trains once on the simulations, then looks at every observation."""

import contextlib
import json
import subprocess
import sys
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tasks import Task


@dataclass
class Data:
    """Simulations (N x D, N x X), observations (O x X) and the parameters behind them (O x D)."""

    thetas: np.ndarray
    rows: np.ndarray
    observations: np.ndarray
    truths: np.ndarray


@dataclass
class Estimate:
    """What an estimator gave: draws (O x draws x D), log densities at the truths (O), and its times."""

    draws: np.ndarray
    log_probabilities: list[float]
    train_s: float
    draw_s: float


def catenary(program: Path, task: Task, data: Data, draws: int, seed: int, settings: dict) -> Estimate:
    """This project's networks."""
    problem = {
        "parameters": task.parameters(),
        "thetas": data.thetas.tolist(),
        "rows": data.rows.tolist(),
        "observations": data.observations.tolist(),
        "truths": data.truths.tolist(),
        "draws": draws,
        "seed": seed,
        "settings": settings,
    }
    run = subprocess.run([program], input=json.dumps(problem), capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise RuntimeError(f"{program}: {run.stderr.strip()}")
    answer = json.loads(run.stdout)
    return Estimate(np.array(answer["draws"]), answer["log_probabilities"], answer["train_s"], answer["draw_s"])


def sbi(model: str, task: Task, data: Data, draws: int, seed: int) -> Estimate:
    """`sbi`'s neural posterior estimation with its defaults, on one thread; `model` is mdn, maf or nsf."""
    import torch
    from sbi.inference import NPE
    from sbi.utils import BoxUniform

    warnings.filterwarnings("ignore")
    torch.manual_seed(seed)
    if task.bound is not None:
        prior = BoxUniform(-task.bound * torch.ones(task.dimension), task.bound * torch.ones(task.dimension))
    else:
        covariance = task.sd**2 * torch.eye(task.dimension)
        prior = torch.distributions.MultivariateNormal(torch.zeros(task.dimension), covariance)
    tensor = lambda a: torch.tensor(a, dtype=torch.float32)
    started = time.perf_counter()
    inference = NPE(prior, density_estimator=model, show_progress_bars=False)
    # It says on stdout when it has converged.
    with contextlib.redirect_stdout(sys.stderr):
        inference.append_simulations(tensor(data.thetas), tensor(data.rows)).train()
    train_s = time.perf_counter() - started
    posterior = inference.build_posterior()
    started = time.perf_counter()
    drawn, densities = [], []
    for observation, truth in zip(data.observations, data.truths):
        x = tensor(observation)[None]
        drawn.append(posterior.sample((draws,), x=x, show_progress_bars=False).numpy())
        densities.append(float(posterior.log_prob(tensor(truth)[None], x=x)))
    return Estimate(np.array(drawn), densities, train_s, time.perf_counter() - started)
