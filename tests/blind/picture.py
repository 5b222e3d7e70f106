"""Picture of a score: confusion, power, p-values, calibration."""

import numpy
from shares import what_of


def draw(rows, found, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plot

    figure, axes = plot.subplots(2, 2, figsize=(16, 14), layout="constrained")
    confusion(axes[0][0], rows)
    for sizes in found["effects"].values():
        points = [(float(s), row["detected"]["share"]) for s, row in sizes.items() if row["detected"]["of"]]
        axes[0][1].plot(*zip(*points), color="0.8", lw=1)
    shares = [(float(s), row["detected"]["share"], row["group"]["share"]) for s, row in found["sizes"].items()]
    if shares:
        x, power, named = zip(*shares)
        axes[0][1].plot(x, power, "o-", label="detected")
        axes[0][1].plot(x, named, "s-", label="named, groups counting as theirs")
        axes[0][1].legend()
    axes[0][1].set(xlabel="magnitude, detectable sizes", ylabel="share of worlds", ylim=(-0.02, 1.02), title="power")
    p = numpy.sort([row["p"] for row in rows if row["kind"] == "none"])
    axes[1][0].plot((numpy.arange(len(p)) + 0.5) / max(len(p), 1), p, ".")
    axes[1][0].plot([0, 1], [0, 1], color="0.6")
    axes[1][0].set(xlabel="quantile of the uniform distribution", ylabel="p-value", title="worlds without an effect")
    if found["bins"]:
        said, true, n = zip(*found["bins"])
        axes[1][1].scatter(said, true, s=[10 + 4 * k for k in n])
    axes[1][1].plot([0, 1], [0, 1], color="0.6")
    axes[1][1].set(xlabel="probability said", ylabel="share that is present", title="calibration")
    figure.savefig(path, dpi=80)


def confusion(axes, rows):
    """Confusion matrix of hidden and named effects at the largest size."""
    shown = [row for row in rows if row["kind"] in ("effect", "none") or (row["kind"] == "structured" and not row["hidden"])]
    most = max((row["size"] for row in shown), default=0)
    shown = [row for row in shown if row["size"] in (0.0, most)]
    hidden_in = lambda row: row["unlisted"]["name"] if row["unlisted"] else " ".join(row["hidden"]) or "nothing"
    hidden, said = (sorted({of(row) for row in shown}) for of in (hidden_in, what_of))
    table = numpy.zeros((len(hidden), len(said)))
    for row in shown:
        table[hidden.index(hidden_in(row)), said.index(what_of(row))] += 1
    axes.imshow(table / numpy.maximum(table.sum(axis=1, keepdims=True), 1), cmap="Blues", vmin=0, vmax=1)
    axes.set_xticks(range(len(said)), said, rotation=90, fontsize=7)
    axes.set_yticks(range(len(hidden)), hidden, fontsize=7)
    axes.set_title(f"hidden (rows) and named (columns), {most:g} x")
