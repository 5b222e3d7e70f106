"""Five tasks of the benchmark of simulation-based inference (Lueckmann et al. 2021).

Each has a simulator and a prior. Observations and draws from their exact posteriors come from the wheel of `sbibm` 1.1.0.
"""

import bz2
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

Simulator = Callable[[np.ndarray, np.random.Generator], np.ndarray]


@dataclass(frozen=True)
class Task:
    """A simulator and its prior: uniform from -bound to bound, or Gaussian with a mean and a standard deviation for each parameter.

    `logarithms`: the prior and the estimate are of the logarithms of the benchmark's parameters.
    """

    name: str
    dimension: int
    simulator: Simulator
    bound: float | None = None
    mean: tuple[float, ...] = ()
    sd: tuple[float, ...] = ()
    logarithms: bool = False

    def prior(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draws of the estimated parameters, count x dimension."""
        if self.bound is not None:
            return rng.uniform(-self.bound, self.bound, (count, self.dimension))
        return rng.normal(self.mean, self.sd, (count, self.dimension))

    def parameters(self) -> list[dict]:
        """Prior in the form of catenary's files; a Gaussian ends at seven standard deviations, beyond which no draw lies."""
        if self.bound is not None:
            priors = [{"uniform": {"low": -self.bound, "high": self.bound}}] * self.dimension
        else:
            ends = [{"mean": m, "sd": s, "low": m - 7.0 * s, "high": m + 7.0 * s} for m, s in zip(self.mean, self.sd)]
            priors = [{"normal": fields} for fields in ends]
        return [{"name": f"theta_{i}", "prior": prior} for i, prior in enumerate(priors)]

    def simulate(self, estimated: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Data for each row of estimated parameters."""
        return self.simulator(self.published(estimated), rng)

    def published(self, estimated: np.ndarray) -> np.ndarray:
        """Parameters of the benchmark for estimated ones."""
        return np.exp(estimated) if self.logarithms else estimated

    def estimated(self, published: np.ndarray) -> np.ndarray:
        """Estimated parameters for those of the benchmark."""
        return np.log(published) if self.logarithms else published

    def log_volume(self, estimated: np.ndarray) -> float:
        """Log of the Jacobian determinant of the benchmark's parameters by the estimated ones."""
        return float(np.sum(estimated)) if self.logarithms else 0.0


def two_moons(theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(-np.pi / 2, np.pi / 2, len(theta))
    radius = rng.normal(0.1, 0.01, len(theta))
    moon = np.stack([radius * np.cos(angle) + 0.25, radius * np.sin(angle)], axis=1)
    apart = np.abs(theta[:, 0] + theta[:, 1]) / np.sqrt(2.0)
    along = (theta[:, 1] - theta[:, 0]) / np.sqrt(2.0)
    return moon + np.stack([-apart, along], axis=1)


def gaussian_mixture(theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    sd = rng.choice([1.0, 0.1], (len(theta), 1))
    return theta + sd * rng.standard_normal(theta.shape)


def slcp(theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    first, second = theta[:, 2] ** 2, theta[:, 3] ** 2
    rho = np.tanh(theta[:, 4])
    noise = rng.standard_normal((len(theta), 4, 2))
    x = theta[:, None, 0] + first[:, None] * noise[..., 0]
    mixed = rho[:, None] * noise[..., 0] + np.sqrt(1.0 - rho[:, None] ** 2) * noise[..., 1]
    y = theta[:, None, 1] + second[:, None] * mixed
    return np.stack([x, y], axis=2).reshape(len(theta), 8)


def linear(theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return theta + np.sqrt(0.1) * rng.standard_normal(theta.shape)


def sir(theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Infected among 1,000 tested every 17th day of an epidemic with a contact and a recovery rate (one of a million ill at first).

    Runge-Kutta of the fourth order with eight steps a day is exact to 2e-5 of the people for all rates of the prior.
    """
    contact, recovery = theta.T
    steps, step = 8, 1.0 / 8.0

    def slope(state: np.ndarray) -> np.ndarray:
        susceptible, infected = state
        caught = contact * susceptible * infected
        return np.array([-caught, caught - recovery * infected])

    state = np.tile([[1.0 - 1e-6], [1e-6]], len(theta))
    days = []
    for day in range(154):
        if day % 17 == 0:
            days.append(state[1])
        for _ in range(steps):
            first = slope(state)
            second = slope(state + 0.5 * step * first)
            third = slope(state + 0.5 * step * second)
            fourth = slope(state + step * third)
            state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    return rng.binomial(1000, np.clip(np.stack(days, axis=1), 0.0, 1.0)).astype(float)


TASKS = {
    task.name: task
    for task in [
        Task("two_moons", 2, two_moons, bound=1.0),
        Task("gaussian_mixture", 2, gaussian_mixture, bound=10.0),
        Task("slcp", 5, slcp, bound=3.0),
        Task("gaussian_linear_uniform", 10, linear, bound=1.0),
        Task("sir", 2, sir, mean=(float(np.log(0.4)), float(np.log(0.125))), sd=(0.5, 0.2), logarithms=True),
    ]
}


class References:
    """Published observations of every task, numbered from 1 to 10."""

    def __init__(self, wheel: Path):
        self.archive = zipfile.ZipFile(wheel)

    def _table(self, task: str, number: int, name: str) -> np.ndarray:
        data = self.archive.read(f"sbibm/tasks/{task}/files/num_observation_{number}/{name}")
        text = (bz2.decompress(data) if name.endswith(".bz2") else data).decode()
        return np.array([[float(v) for v in line.split(",")] for line in text.splitlines()[1:]])

    def observation(self, task: str, number: int) -> np.ndarray:
        """Observed data."""
        return self._table(task, number, "observation.csv")[0]

    def truth(self, task: str, number: int) -> np.ndarray:
        """Parameters of the observation."""
        return self._table(task, number, "true_parameters.csv")[0]

    def posterior(self, task: str, number: int) -> np.ndarray:
        """10,000 draws from the exact posterior."""
        return self._table(task, number, "reference_posterior_samples.csv.bz2")
