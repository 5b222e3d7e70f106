"""Estimators of the comparison: each trains once on the simulations and then gives a posterior for every observation."""

import contextlib
import functools
import json
import resource
import subprocess
import sys
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
    """Draws (O x draws x D), log densities at the truths (O), and processor time of the training (s).

    Processor time, unlike wall time, does not depend on other work of the machine.
    """

    draws: np.ndarray
    log_probabilities: list[float]
    train_s: float


def processor_s(who: int) -> float:
    """Seconds of processor time so far, of this process or of its ended children (`who`)."""
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def catenary(program: Path, task: Task, data: Data, draws: int, seed: int, settings: dict) -> Estimate:
    """Estimate of our networks. The time includes reading the simulations and drawing, which is short."""
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
    started = processor_s(resource.RUSAGE_CHILDREN)
    run = subprocess.run([program], input=json.dumps(problem), capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise RuntimeError(f"{program}: {run.stderr.strip()}")
    train_s = processor_s(resource.RUSAGE_CHILDREN) - started
    answer = json.loads(run.stdout)
    return Estimate(np.array(answer["draws"]), answer["log_probabilities"], train_s)


@functools.cache
def warm_up(model: str) -> None:
    """Runs a short training once, so that the time of a training does not include loading libraries."""
    import torch
    from sbi.inference import NPE

    few = torch.rand((200, 2), generator=torch.Generator().manual_seed(0))
    with contextlib.redirect_stdout(sys.stderr):
        NPE(density_estimator=model, show_progress_bars=False).append_simulations(few, few).train(max_num_epochs=2)


def sbi(model: str, task: Task, data: Data, draws: int, seed: int) -> Estimate:
    """Estimate of neural posterior estimation in `sbi` with its defaults, on one thread; `model` is mdn, maf or nsf."""
    import torch
    from sbi.inference import NPE
    from sbi.utils import BoxUniform

    warnings.filterwarnings("ignore")
    if task.bound is not None:
        prior = BoxUniform(-task.bound * torch.ones(task.dimension), task.bound * torch.ones(task.dimension))
    else:
        covariance = torch.diag(torch.tensor(task.sd) ** 2)
        prior = torch.distributions.MultivariateNormal(torch.tensor(task.mean), covariance)
    tensor = lambda a: torch.tensor(a, dtype=torch.float32)
    warm_up(model)
    torch.manual_seed(seed)
    started = processor_s(resource.RUSAGE_SELF)
    inference = NPE(prior, density_estimator=model, show_progress_bars=False)
    # sbi prints its convergence on stdout, which is for the table.
    with contextlib.redirect_stdout(sys.stderr):
        inference.append_simulations(tensor(data.thetas), tensor(data.rows)).train()
    train_s = processor_s(resource.RUSAGE_SELF) - started
    posterior = inference.build_posterior()
    drawn, densities = [], []
    for observation, truth in zip(data.observations, data.truths):
        x = tensor(observation)[None]
        drawn.append(posterior.sample((draws,), x=x, show_progress_bars=False).numpy())
        densities.append(float(posterior.log_prob(tensor(truth)[None], x=x)))
    return Estimate(np.array(drawn), densities, train_s)
