"""Priors as the inspection reads them from a message and from a file."""

import numpy
import pytest
from catenary_inspect import prior
from catenary_msgs.msg import Parameter, PriorPart

NORMAL = dict(mean=0.26, sd=0.02, low=0.2, high=0.3)
UNIFORM, LOG = dict(low=1.0, high=3.0), dict(low=1.0, high=100.0)
CASES = {
    "uniform": (Parameter(prior=Parameter.PRIOR_UNIFORM, **UNIFORM), {"uniform": UNIFORM}, 2.0),
    "log-uniform": (Parameter(prior=Parameter.PRIOR_LOG_UNIFORM, **LOG), {"log_uniform": LOG}, 10.0),
    # Bounds 3 below and 2 standard deviations above the mean: the median of the rest lies 0.0267 standard deviations below it.
    "normal": (Parameter(prior=Parameter.PRIOR_NORMAL, **NORMAL), {"normal": NORMAL}, 0.26 - 0.02 * 0.02684),
    # Of the mass, 3/4 lie evenly in the logarithm between 1 and 100, and 1/4 evenly between 1 and 3: half of it below 4.64.
    "mixture": (
        Parameter(
            prior=Parameter.PRIOR_MIXTURE, low=1.0, high=100.0,
            parts=[PriorPart(weight=3.0, prior=Parameter.PRIOR_LOG_UNIFORM, **LOG), PriorPart(weight=1.0, prior=Parameter.PRIOR_UNIFORM, **UNIFORM)],
        ),
        {"mixture": [{"weight": 3.0, "prior": {"log_uniform": LOG}}, {"weight": 1.0, "prior": {"uniform": UNIFORM}}]},
        100 ** (1 / 3),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_prior_of_a_message_is_that_of_a_file(name):
    message, document, median = CASES[name]
    told, written = prior.of_message(message), prior.of_document(document)
    unit = numpy.linspace(0.001, 0.999, 50)
    assert told.name == written.name == name
    assert numpy.array_equal(told.value(unit), written.value(unit))
    assert told.share_below(told.value(unit)) == pytest.approx(unit, abs=2e-3)
    assert float(told.value(0.5)) == pytest.approx(median, rel=1e-3)


def test_a_prior_of_an_unknown_kind_is_named():
    with pytest.raises(ValueError, match="expected one of uniform, log_uniform, normal, mixture, found cauchy"):
        prior.of_document({"cauchy": UNIFORM})
