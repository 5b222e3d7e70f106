"""Random motion of the hand in the benches of bars."""

import numpy

STEPS = 16
# Start of the hand, the box of its targets (hanging bars of 0.3 m touch the table in its lower part), and the largest action.
LOW_M, HIGH_M, START_M, MOST_M = numpy.array([0.32, 0.22]), numpy.array([0.55, 0.47]), numpy.array([0.40, 0.42]), 0.06


def actions(seed):
    """Random walk of the target within the box, as rows of dx and dz in m."""
    rng, at, rows = numpy.random.default_rng(seed), START_M, []
    for _ in range(STEPS):
        to = numpy.clip(at + rng.uniform(-MOST_M, MOST_M, 2), LOW_M, HIGH_M)
        rows.append(to - at)
        at = to
    return rows
