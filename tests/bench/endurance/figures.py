"""Slopes, gaps and tables: numbers from numbers."""

import numpy

# A slope is taken over medians of this long, whose errors are nearly independent.
BIN_S = 10


def binned(times_s, values, width_s=BIN_S):
    """The middle of each bin and the median of its values."""
    bins = numpy.floor((numpy.asarray(times_s) - times_s[0]) / width_s).astype(int)
    kept = [number for number in numpy.unique(bins) if numpy.count_nonzero(bins == number) > 1]
    middles = [times_s[0] + (number + 0.5) * width_s for number in kept]
    return numpy.array(middles), numpy.array([numpy.median(numpy.asarray(values)[bins == number]) for number in kept])


def slope(times, values):
    """Theil-Sen slope and its 95 % interval by Kendall's variance (Sen 1968, without the correction for ties)."""
    assert len(times) > 1, f"a slope needs {2 * BIN_S} s after the warm-up"
    i, j = numpy.triu_indices(len(times), 1)
    slopes = numpy.sort((values[j] - values[i]) / (times[j] - times[i]))
    n = len(times)
    reach = 1.96 * numpy.sqrt(n * (n - 1) * (2 * n + 5) / 18)
    low = int(max((len(slopes) - reach) / 2, 0))
    high = int(min((len(slopes) + reach) / 2, len(slopes) - 1))
    return float(numpy.median(slopes)), float(slopes[low]), float(slopes[high])


def memory(times_s, rss_kb, warm_up_s):
    """Start, end and slope in kB/min of what came after the warm-up."""
    times_s, rss_kb = numpy.asarray(times_s), numpy.asarray(rss_kb)
    warm = times_s - times_s[0] >= warm_up_s
    times, medians = binned(times_s[warm], rss_kb[warm])
    per_min, low, high = slope(times / 60, medians)
    found = {"start_kb": int(rss_kb[0]), "warm_kb": int(medians[0]), "end_kb": int(rss_kb[-1]), "most_kb": int(rss_kb.max())}
    return found | {"kb_per_min": per_min, "low": low, "high": high}


def gaps(sent_ns, numbers):
    """p99 and longest time in ms between messages that follow one another in the sender's count."""
    order = numpy.argsort(numbers)
    between = 1e-6 * numpy.diff(numpy.asarray(sent_ns)[order])
    between = between[numpy.diff(numpy.asarray(numbers)[order]) == 1]
    return (float(numpy.percentile(between, 99)), float(between.max())) if len(between) else (None, None)


def table(title, columns, rows):
    """Lines of a table: a dictionary of name to cells, each a text, a number or none."""
    texts = [[name, *("-" if cell is None else f"{cell:.5g}" if isinstance(cell, float) else str(cell) for cell in cells)] for name, cells in rows.items()]
    lines = [[title, *columns], *texts]
    widths = [max(len(line[column]) for line in lines) for column in range(len(columns) + 1)]
    return "\n".join(f"{line[0]:<{widths[0]}}" + "".join(f"  {cell:>{width}}" for cell, width in zip(line[1:], widths[1:])) for line in lines)
