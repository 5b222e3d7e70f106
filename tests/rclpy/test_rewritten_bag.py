"""A bag that rosbags copied gives the posterior of its source."""

from support.bags import copied
from support.program import BAG, MODEL

SIZES = ("--preset", "networks", "--iterations", 3, "--simulations", 40, "--seed", 7)


def test_a_bag_written_by_rosbags_gives_the_same_posterior(program, tmp_path):
    posterior = lambda bag, out: program.json("infer", "--bag", bag, "--model", MODEL, "--out", tmp_path / out, *SIZES)["posterior"]
    copy = copied(tmp_path / "copy")
    assert (copy / "metadata.yaml").read_text() != (BAG / "metadata.yaml").read_text()
    original = posterior(BAG, "original")
    assert len(original["mixture"]["weights"]) >= 4
    assert posterior(copy, "again") == original
