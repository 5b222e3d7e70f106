"""Figures of a share, a test of uniformity, and a calibration, with closed forms in the tests."""

import collections

import numpy
from rows import NAMED
from scipy import stats

BINS = 10


def wilson(successes, trials):
    """Wilson's interval of 95 % of a share (1927)."""
    if trials == 0:
        return [0.0, 1.0]
    return [float(end) for end in stats.binomtest(successes, trials).proportion_ci(0.95, "wilson")]


def kolmogorov_p(values):
    """p-value of uniformity on 0 to 1 after Kolmogorov and Smirnov."""
    return float(stats.kstest(values, "uniform").pvalue) if len(values) else 1.0


def spread(rows):
    """p-values spread evenly over their steps of 1 / (1 + B): those of a test by simulation are then uniform on 0 to 1."""
    rng = numpy.random.default_rng(0)
    return [row["p"] - rng.uniform() / (1 + row["null_sets"]) for row in rows]


def calibration(rows):
    """Expected calibration error of the probabilities of presence, weighted by the size of the bins, and the bins."""
    pairs = [pair for row in rows if row["kind"] != "none" for pair in row["probabilities"]]
    if not pairs:
        return None, []
    said, true = numpy.array([p for p, _ in pairs]), numpy.array([float(t) for _, t in pairs])
    place = numpy.minimum((said * BINS).astype(int), BINS - 1)
    bins = [(said[place == b].mean(), true[place == b].mean(), int((place == b).sum())) for b in range(BINS) if (place == b).any()]
    return float(sum(n * abs(s - t) for s, t, n in bins) / len(pairs)), bins


def share(hits):
    """Share of true ones with its interval, and their number."""
    hits = [bool(hit) for hit in hits]
    return {"share": sum(hits) / len(hits) if hits else None, "interval": wilson(sum(hits), len(hits)), "of": len(hits)}


def each(rows, name_of, hit_of):
    """Share of hits among the rows of each name, and the other answers."""
    of = collections.defaultdict(list)
    for row in rows:
        of[name_of(row)].append(row)
    return {n: share(map(hit_of, of[n])) | {"instead": instead([r for r in of[n] if not hit_of(r)])} for n in sorted(of)}


def instead(rows):
    """Answers given for the rows, with their numbers."""
    return dict(collections.Counter(map(what_of, rows)).most_common())


def what_of(row):
    """Answer of a row: the named effects, or the verdict."""
    return " + ".join(alike[0] for alike in row["found"]) if row["verdict"] in NAMED else row["verdict"]
