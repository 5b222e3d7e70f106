"""Slopes, gaps and tables of measured series."""

import numpy
from scipy.stats import theilslopes

# Length of the bins whose medians a slope is fitted to; errors of successive medians are nearly independent.
BIN_S = 10


def binned(times_s, values, width_s=BIN_S):
    """Middle of each bin and median of its values."""
    bins = numpy.floor((numpy.asarray(times_s) - times_s[0]) / width_s).astype(int)
    kept = [number for number in numpy.unique(bins) if numpy.count_nonzero(bins == number) > 1]
    middles = [times_s[0] + (number + 0.5) * width_s for number in kept]
    return numpy.array(middles), numpy.array([numpy.median(numpy.asarray(values)[bins == number]) for number in kept])


def slope(times, values):
    """Theil-Sen slope with its 95 % interval (Sen 1968)."""
    assert len(times) > 1, f"a slope needs {2 * BIN_S} s after the warm-up"
    found = theilslopes(values, times, alpha=0.95)
    return float(found.slope), float(found.low_slope), float(found.high_slope)


def memory(times_s, rss_kb, warm_up_s):
    """Memory (kB) at the start, after the warm-up, at the end and at most, and its slope (kB/min) after the warm-up."""
    times_s, rss_kb = numpy.asarray(times_s), numpy.asarray(rss_kb)
    warm = times_s - times_s[0] >= warm_up_s
    times, medians = binned(times_s[warm], rss_kb[warm])
    per_min, low, high = slope(times / 60, medians)
    found = {"start_kb": int(rss_kb[0]), "warm_kb": int(medians[0]), "end_kb": int(rss_kb[-1]), "most_kb": int(rss_kb.max())}
    return found | {"kb_per_min": per_min, "low": low, "high": high}


def gaps(sent_ns, numbers):
    """99th percentile and maximum of the time (ms) between messages with successive sequence numbers."""
    order = numpy.argsort(numbers)
    between = 1e-6 * numpy.diff(numpy.asarray(sent_ns)[order])
    between = between[numpy.diff(numpy.asarray(numbers)[order]) == 1]
    return (float(numpy.percentile(between, 99)), float(between.max())) if len(between) else (None, None)


def table(title, columns, rows):
    """Text of a table; `rows` maps names to cells, each a text, a number or None."""
    word = lambda cell: "-" if cell is None else f"{cell:.5g}" if isinstance(cell, float) else str(cell)
    lines = [[title, *columns], *([name, *map(word, cells)] for name, cells in rows.items())]
    widths = [max(len(line[column]) for line in lines) for column in range(len(columns) + 1)]
    right = lambda line: "".join(f"  {cell:>{width}}" for cell, width in zip(line[1:], widths[1:]))
    return "\n".join(f"{line[0]:<{widths[0]}}" + right(line) for line in lines)
