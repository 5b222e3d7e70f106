"""`catenary infer` on several episodes of one object gives one posterior that is sharper than the posterior of each."""

import pytest

from support.program import MODEL

# The gain varies from seed to seed; tests in nodes/method/bayes_sim measure it over many.
SIZES = ("--preset", "networks", "--iterations", 6, "--simulations", 100, "--seed", 2)


@pytest.fixture(scope="module")
def bags(program, tmp_path_factory):
    """Bags of two episodes of one bar, with different motions and noise."""
    folder = tmp_path_factory.mktemp("pooled")
    written = []
    for number, actions in enumerate(["0.06,0.02", "-0.03,0.05"]):
        motion = folder / f"motion_{number}.csv"
        motion.write_text("dx_m,dz_m\n" + f"{actions}\n0,0\n" * 3)
        bag = folder / f"bag_{number}"
        truth = ("--theta", "length_m=0.25", "--theta", "youngs_modulus_pa=8000")
        program.text("simulate", "--model", MODEL, "--actions", motion, *truth, "--noise", "--seed", number, "--out", bag)
        written.append(bag)
    return written


@pytest.fixture
def infer(program):
    """Runs an inference into a folder; returns the document that it prints, and its marginals by name."""

    def run(out, *arguments):
        said = program.json("infer", *arguments, "--model", MODEL, "--out", out, *SIZES, seconds=300)
        return said, {m["name"]: m for m in said["marginals"]}

    return run


def test_two_recordings_give_one_sharper_posterior(infer, bags, tmp_path):
    alone = [infer(tmp_path / f"alone_{i}", "--bag", bag) for i, bag in enumerate(bags)]
    said, pooled = infer(tmp_path / "both", "--bag", bags[0], "--bag", bags[1])
    assert said["bags"] == [str(b) for b in bags] and said["episodes"] == 2
    assert said["frames"] == sum(one["frames"] for one, _ in alone)
    assert said["duration_s"] == pytest.approx(sum(one["duration_s"] for one, _ in alone))
    spread = lambda marginals: marginals["length_m"]["sd"] * marginals["youngs_modulus_pa"]["sd"]
    assert spread(pooled) < min(spread(marginals) for _, marginals in alone)
    page = (tmp_path / "both/report.html").read_text()
    assert "2 episodes" in page and bags[1].name in page
