"""The estimators that are compared: each trains once on the simulations, then looks at every observation."""

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
    """What an estimator gave: draws (O x draws x D), log densities at the truths (O), and the processor's time that training took;
    that of a machine whose cores others use, too, is the same."""

    draws: np.ndarray
    log_probabilities: list[float]
    train_s: float


def processor_s(who: int) -> float:
    """Seconds of processor time so far, of this process or of its children that have ended."""
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def catenary(program: Path, task: Task, data: Data, draws: int, seed: int, settings: dict) -> Estimate:
    """This project's networks. Their time holds that of reading the simulations and of drawing, which is short."""
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
    """What is loaded at first use counts for no training: a short one that nobody looks at."""
    import torch
    from sbi.inference import NPE

    few = torch.rand((200, 2), generator=torch.Generator().manual_seed(0))
    with contextlib.redirect_stdout(sys.stderr):
        NPE(density_estimator=model, show_progress_bars=False).append_simulations(few, few).train(max_num_epochs=2)


def sbi(model: str, task: Task, data: Data, draws: int, seed: int) -> Estimate:
    """`sbi`'s neural posterior estimation with its defaults, on one thread; `model` is mdn, maf or nsf."""
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
    # It says on stdout when it has converged.
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
