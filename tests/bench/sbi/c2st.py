"""Classifier two-sample test (C2ST) as the benchmark defines it, for many pairs of samples at once.

The benchmark uses scikit-learn's MLPClassifier with two layers of ten units a dimension, data scaled by the reference, and the mean
accuracy over five folds. scikit-learn trains one small network after another, which takes most of a minute for a pair. Here all folds
of all pairs are trained at once as batched matrix products. `by_scikit_learn` is the original, for a comparison.
"""

import itertools

import numpy as np
import torch

# Settings of the benchmark, and defaults of MLPClassifier.
FOLDS = 5
BATCH = 200
RATE = 1e-3
DECAY = 1e-4
TOLERANCE = 1e-4
PATIENCE = 10
MOST_EPOCHS = 10_000


def scaled(reference: np.ndarray, draws: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Table of both samples in standard deviations of the reference, and labels: 0 for the reference, 1 for the draws."""
    centre, scale = reference.mean(axis=0), reference.std(axis=0, ddof=1)
    data = np.concatenate([(reference - centre) / scale, (draws - centre) / scale])
    return data, np.concatenate([np.zeros(len(reference)), np.ones(len(draws))])


def by_scikit_learn(reference: np.ndarray, draws: np.ndarray, seed: int = 1) -> float:
    """Accuracy for one pair by scikit-learn."""
    from sklearn.model_selection import KFold, cross_val_score
    from sklearn.neural_network import MLPClassifier

    data, target = scaled(reference, draws)
    units = 10 * reference.shape[1]
    classifier = MLPClassifier(hidden_layer_sizes=(units, units), activation="relu", solver="adam", max_iter=MOST_EPOCHS, random_state=seed)
    folds = KFold(n_splits=FOLDS, shuffle=True, random_state=seed)
    return float(np.mean(cross_val_score(classifier, data, target, cv=folds, scoring="accuracy")))


def side_by_side(pairs: list[tuple[np.ndarray, np.ndarray]], seed: int = 1) -> list[float]:
    """Accuracy for each pair of (reference, draws); all samples have one size."""
    generator = torch.Generator().manual_seed(seed)
    tables = [scaled(reference, draws) for reference, draws in pairs]
    count, dimension = tables[0][0].shape
    order = torch.randperm(count, generator=generator)
    tested = order.reshape(FOLDS, -1)
    used = torch.stack([order[~torch.isin(order, fold)] for fold in tested])
    data = torch.stack([torch.tensor(table, dtype=torch.float32) for table, _ in tables])
    target = torch.tensor(tables[0][1], dtype=torch.float32)
    # Index of a model: pair * FOLDS + fold.
    train_x = data[:, used].flatten(0, 1)
    train_y = target[used].repeat(len(pairs), 1)
    networks = train(train_x, train_y, 10 * dimension, generator)
    test_x = data[:, tested].flatten(0, 1)
    test_y = target[tested].repeat(len(pairs), 1)
    right = ((logits(networks, test_x) > 0.0) == (test_y > 0.5)).float().mean(dim=1)
    return right.reshape(len(pairs), FOLDS).mean(dim=1).tolist()


def logits(networks: list[torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    """Logits of M models for their rows, M x rows."""
    for weight, bias in zip(networks[0:4:2], networks[1:4:2]):
        x = torch.relu(torch.baddbmm(bias, x, weight))
    return torch.baddbmm(networks[5], x, networks[4])[..., 0]


def train(x: torch.Tensor, y: torch.Tensor, units: int, generator: torch.Generator) -> list[torch.Tensor]:
    """Trains a network for each of M tables (M x rows x D) with labels; each keeps the weights at its own stop."""
    models, rows, dimension = x.shape
    sizes = [dimension, units, units, 1]
    networks = []
    for inputs, outputs in itertools.pairwise(sizes):
        # Initial weights of scikit-learn: uniform after Glorot and Bengio (2010), with a factor of 2 for a logistic output.
        bound = ((2.0 if outputs == 1 else 6.0) / (inputs + outputs)) ** 0.5
        for shape in [(models, inputs, outputs), (models, 1, outputs)]:
            networks.append(bound * (2.0 * torch.rand(shape, generator=generator) - 1.0))
    kept = [n.clone() for n in networks]
    moments = [[torch.zeros_like(n) for n in kept] for _ in range(2)]
    best = torch.full((models,), torch.inf)
    waited = torch.zeros(models)
    running = torch.arange(models)
    step = 0
    for _ in range(MOST_EPOCHS):
        order = torch.rand((len(running), rows), generator=generator).argsort(dim=1)
        total = torch.zeros(len(running))
        for start in range(0, rows, BATCH):
            picked = order[:, start : start + BATCH]
            size = picked.shape[1]
            batch = torch.gather(x, 1, picked[..., None].expand(-1, -1, dimension))
            labels = torch.gather(y, 1, picked)
            losses, gradients = losses_and_gradients(networks, batch, labels)
            squares = sum(w.square().sum(dim=(1, 2)) for w in networks[::2])
            for weight, gradient in zip(networks[::2], gradients[::2]):
                gradient.add_(weight, alpha=DECAY / size)
            step += 1
            adam(networks, moments, gradients, step)
            total += (losses + 0.5 * DECAY * squares / size) * size
        mean = total / rows
        better = mean <= best - TOLERANCE
        waited = torch.where(better, 0.0, waited + 1.0)
        best = torch.minimum(best, mean)
        going = waited <= PATIENCE
        for slot, network in zip(kept, networks):
            slot[running] = network
        if not going.any():
            break
        if not going.all():
            running, x, y, best, waited = running[going], x[going], y[going], best[going], waited[going]
            networks = [n[going] for n in networks]
            moments = [[m[going] for m in each] for each in moments]
    return kept


def losses_and_gradients(networks: list[torch.Tensor], x: torch.Tensor, y: torch.Tensor) -> tuple[torch.Tensor, list[torch.Tensor]]:
    """Mean loss of each model for a batch, and its gradients; written out because autograd costs a third of the time."""
    first_weight, first_bias, second_weight, second_bias, last_weight, last_bias = networks
    first = torch.baddbmm(first_bias, x, first_weight).relu_()
    second = torch.baddbmm(second_bias, first, second_weight).relu_()
    out = torch.baddbmm(last_bias, second, last_weight)
    losses = torch.nn.functional.binary_cross_entropy_with_logits(out[..., 0], y, reduction="none").mean(dim=1)
    by_out = (out.sigmoid_() - y[..., None]) / x.shape[1]
    # The sign of a unit's output is the derivative of the ReLU: 1 if the unit is on, else 0.
    by_last = second.transpose(1, 2) @ by_out
    by_second = (by_out * last_weight.transpose(1, 2)).mul_(second.sign_())
    by_first = torch.bmm(by_second, second_weight.transpose(1, 2))
    of_second = first.transpose(1, 2) @ by_second
    by_first.mul_(first.sign_())
    of_first = x.transpose(1, 2) @ by_first
    sums = [g.sum(dim=1, keepdim=True) for g in (by_first, by_second, by_out)]
    return losses, [of_first, sums[0], of_second, sums[1], by_last, sums[2]]


def adam(networks: list[torch.Tensor], moments: list[list[torch.Tensor]], gradients: list[torch.Tensor], step: int) -> None:
    """One step of Adam (Kingma and Ba 2015) with its usual constants."""
    rate = RATE * (1.0 - 0.999**step) ** 0.5 / (1.0 - 0.9**step)
    for network, first, second, gradient in zip(networks, *moments, gradients):
        first.mul_(0.9).add_(gradient, alpha=0.1)
        second.mul_(0.999).addcmul_(gradient, gradient, value=0.001)
        network.addcdiv_(first, second.sqrt().add_(1e-8), value=-rate)
