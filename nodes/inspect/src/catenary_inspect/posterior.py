"""Report of the posterior over the object's parameters."""

import json
import pathlib

import numpy

from . import prior
from .message_log import InspectError
from .table import table
from .topics import POSTERIOR

NAMES, NEEDED = [POSTERIOR[0]], [POSTERIOR[0]]
# Draws for the quantiles, whose error is then 1 to 2 % of the standard deviation.
DRAWS = 20_000
LEVELS = (0.05, 0.5, 0.95)


class Posterior:
    """Mixture of K Gaussians over D parameters in the unit coordinates of their priors, truncated to [0, 1]^D.

    `parameters` (D): pairs of name and prior. `weights` (K), `means` (K, D), `covariances` (K, D, D).
    """

    def __init__(self, origin, parameters, weights, means, covariances):
        self.origin, self.parameters = origin, parameters
        self.weights = numpy.asarray(weights, float)
        size, dimension = len(self.weights), len(parameters)
        self.means = self.shaped("means", means, (size, dimension))
        self.covariances = self.shaped("covariances", covariances, (size, dimension, dimension))
        if not (size and dimension and abs(self.weights.sum() - 1) < 1e-6 and (self.weights >= 0).all()):
            raise InspectError(f"{origin}: weights: expected numbers of at least 0 with the sum 1, found {self.weights.tolist()}")
        self.unit, self.mass_inside = self.draw(numpy.random.default_rng(1))
        self.values = numpy.column_stack([before.value(self.unit[:, i]) for i, (_, before) in enumerate(parameters)])

    def shaped(self, name, values, shape):
        values = numpy.asarray(values, float)
        if values.size != numpy.prod(shape):
            raise InspectError(f"{self.origin}: {name}: expected {' x '.join(map(str, shape))} numbers, found {values.size}")
        return values.reshape(shape)

    def draw(self, rng):
        """Draws of the truncated mixture (N x D, unit coordinates), and the mass of the untruncated one inside [0, 1]^D."""
        kept, tried = [], 0
        while sum(map(len, kept)) < DRAWS and tried < 50 * DRAWS:
            of = rng.choice(len(self.weights), DRAWS, p=self.weights / self.weights.sum())
            roots = numpy.linalg.cholesky(self.covariances)[of]
            drawn = self.means[of] + numpy.einsum("nij,nj->ni", roots, rng.standard_normal((DRAWS, len(self.parameters))))
            kept.append(drawn[((drawn >= 0) & (drawn <= 1)).all(axis=1)])
            tried += DRAWS
        inside = numpy.concatenate(kept)
        if len(inside) < 100:
            raise InspectError(f"{self.origin}: expected a mixture over the priors' support, found {len(inside)} of {tried} draws inside")
        return inside[:DRAWS], len(inside) / tried

    def marginals(self):
        """Figures of each parameter's marginal."""
        rows = []
        for i, (name, before) in enumerate(self.parameters):
            quantiles = numpy.quantile(self.values[:, i], LEVELS).tolist()
            low_share, high_share = (self.unit[:, i] < 0.02).mean(), (self.unit[:, i] > 0.98).mean()
            edge = " ".join(word for word, share in (("low", low_share), ("high", high_share)) if share > 0.1)
            rows.append(
                {
                    "name": name, "prior": before.name, "low": before.low, "high": before.high,
                    "q05": quantiles[0], "median": quantiles[1], "q95": quantiles[2], "mean": self.values[:, i].mean().item(),
                    "narrowing": 1 / (12 ** 0.5 * self.unit[:, i].std().item()), "presses_on": edge,
                }
            )  # fmt: skip
        return rows

    def data(self):
        return {"components": len(self.weights), "mass_outside": 1 - self.mass_inside, "marginals": self.marginals()}

    def text(self):
        heads = ("parameter", "prior", "low", "high", "5 %", "median", "95 %", "mean", "narrower", "presses on")
        rows = [
            (m["name"], m["prior"], m["low"], m["high"], m["q05"], m["median"], m["q95"], m["mean"], m["narrowing"], m["presses_on"] or "-")
            for m in self.marginals()
        ]
        about = f"{self.origin}: {len(self.weights)} components, {100 * (1 - self.mass_inside):.2g} % of the mixture outside the prior"
        return about + "\n" + table(heads, rows)

    def draw_picture(self, figure):
        """Draws marginals on the diagonal with lines at 5 %, 50 % and 95 %, and pairs below it."""
        count = len(self.parameters)
        axes = figure.subplots(count, count, squeeze=False)
        edges = [edges_of(before) for _, before in self.parameters]
        for i, (name, before) in enumerate(self.parameters):
            for j in range(count):
                axis = axes[i][j]
                if j > i:
                    axis.axis("off")
                    continue
                other, across = self.parameters[j]
                axis.set_xscale("log" if across.is_log else "linear")
                axis.set_xlim(across.low, across.high)
                if i == j:
                    axis.hist(self.values[:, i], bins=edges[i], color="#4477aa", density=False)
                    for quantile, style in zip(numpy.quantile(self.values[:, i], LEVELS), (":", "-", ":")):
                        axis.axvline(quantile, color="black", linestyle=style, linewidth=1)
                    axis.set_yticks([])
                else:
                    axis.hist2d(self.values[:, j], self.values[:, i], bins=[edges[j], edges[i]], cmap="Blues")
                    axis.set_yscale("log" if before.is_log else "linear")
                    axis.set_ylim(before.low, before.high)
                    if j == 0:
                        axis.set_ylabel(name)
                if i == count - 1:
                    axis.set_xlabel(other)
        figure.suptitle("Posterior over the prior's range; lines: 5 %, 50 %, 95 %")


def edges_of(before):
    """Edges of 60 bins along the axis of a prior."""
    return (numpy.geomspace if before.is_log else numpy.linspace)(before.low, before.high, 61)


def of_message(origin, message):
    """Posterior of a catenary_msgs/msg/Mixture."""
    parameters = []
    for parameter in message.parameters:
        try:
            parameters.append((parameter.name, prior.of_message(parameter)))
        except ValueError as error:
            raise InspectError(f"{origin}: {parameter.name}: {error}") from error
    return Posterior(origin, parameters, message.weights, message.means, message.covariances)


def report(log, _options):
    """Posterior of the newest message."""
    _, message = log.need(*POSTERIOR, "the posterior")[-1]
    return of_message(f"{log.origin}, {POSTERIOR[0]}", message)


def of_file(path):
    """Posterior of a posterior.json that `catenary infer` wrote."""
    try:
        document = json.loads(pathlib.Path(path).read_text())
        parameters = [(p["name"], prior.of_document(p["prior"])) for p in document["parameters"]]
        mixture = document["mixture"]
        return Posterior(str(path), parameters, mixture["weights"], mixture["means"], mixture["covariances"])
    except OSError as error:
        raise InspectError(f"--file {path}: expected a posterior.json of `catenary infer`: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InspectError(f"--file {path}: expected a posterior.json of `catenary infer`, found another: {error!r}") from error
