"""Priors that catenary-inspect reads from a message and from a file."""

from types import SimpleNamespace

import numpy
import pytest
from catenary_inspect import posterior, prior
from catenary_inspect.message_log import InspectError
from catenary_msgs.msg import Mixture, Parameter, PriorPart

NORMAL = {"mean": 0.26, "sd": 0.02, "low": 0.2, "high": 0.3}
UNIFORM, LOG = {"low": 1.0, "high": 3.0}, {"low": 1.0, "high": 100.0}
CASES = {
    "uniform": (Parameter(prior=Parameter.PRIOR_UNIFORM, **UNIFORM), {"uniform": UNIFORM}, 2.0),
    "log-uniform": (Parameter(prior=Parameter.PRIOR_LOG_UNIFORM, **LOG), {"log_uniform": LOG}, 10.0),
    # Truncated 3 standard deviations below and 2 above the mean: the median lies 0.0268 standard deviations below the mean.
    "normal": (Parameter(prior=Parameter.PRIOR_NORMAL, **NORMAL), {"normal": NORMAL}, 0.26 - 0.02 * 0.02684),
    # 3/4 of the mass are log-uniform between 1 and 100, 1/4 uniform between 1 and 3. Half of it is below 100^(1/3) = 4.64.
    "mixture": (
        Parameter(
            prior=Parameter.PRIOR_MIXTURE, low=1.0, high=100.0,
            parts=[
                PriorPart(weight=3.0, prior=Parameter.PRIOR_LOG_UNIFORM, **LOG),
                PriorPart(weight=1.0, prior=Parameter.PRIOR_UNIFORM, **UNIFORM),
            ],
        ),
        {"mixture": [{"weight": 3.0, "prior": {"log_uniform": LOG}}, {"weight": 1.0, "prior": {"uniform": UNIFORM}}]},
        100 ** (1 / 3),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_message_and_file_give_one_prior(name):
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


def test_a_mixture_over_decades_is_resolved_at_its_lower_end():
    decades = {"low": 1.0, "high": 1e6}
    parts = [{"weight": 1.0, "prior": {kind: decades}} for kind in ("log_uniform", "uniform")]
    wide = prior.of_document({"mixture": parts})
    unit = numpy.linspace(0.001, 0.999, 50)
    assert wide.share_below(wide.value(unit)) == pytest.approx(unit, abs=1e-4)


def test_a_message_of_an_older_recording_has_bounds_alone():
    old = SimpleNamespace(prior=Parameter.PRIOR_LOG_UNIFORM, **LOG)
    assert prior.of_message(old).value(0.5) == pytest.approx(10.0)


IMPOSSIBLE = {
    "a prior: expected a kind of 0 to 3, found 9": Parameter(prior=9, **UNIFORM),
    "a uniform prior: expected numbers that make one, found 3.0 to 1.0": Parameter(prior=Parameter.PRIOR_UNIFORM, low=3.0, high=1.0),
    "a log-uniform prior: expected numbers that make one, found 0.0 to 1.0": Parameter(prior=Parameter.PRIOR_LOG_UNIFORM, high=1.0),
    "a normal prior: expected numbers that make one, found 0.0 to 1.0, mean 0.0, sd 0.0": Parameter(prior=Parameter.PRIOR_NORMAL, high=1.0),
    "a mixture prior: expected parts, found 0": Parameter(prior=Parameter.PRIOR_MIXTURE),
    "a uniform prior: expected no parts, found 1": Parameter(
        prior=Parameter.PRIOR_UNIFORM, **UNIFORM, parts=[PriorPart(weight=1.0, **UNIFORM)]
    ),
    "a mixture prior: expected weights of at least 0, not all of them 0, found [0.0]": Parameter(
        prior=Parameter.PRIOR_MIXTURE, parts=[PriorPart(prior=Parameter.PRIOR_UNIFORM, **UNIFORM)]
    ),
}


@pytest.mark.parametrize("words", IMPOSSIBLE)
def test_an_impossible_prior_in_a_message_is_named_with_the_topic(words):
    parameter = IMPOSSIBLE[words]
    parameter.name = "length_m"
    with pytest.raises(InspectError) as refusal:
        posterior.of_message("the bag, /bayes_sim/posterior", Mixture(parameters=[parameter]))
    assert str(refusal.value).startswith(f"the bag, /bayes_sim/posterior: length_m: {words}")
