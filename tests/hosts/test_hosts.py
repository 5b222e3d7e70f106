"""Batches of simulations over several hosts, which are network namespaces on a bridge with the MTU of Ethernet.

The posterior is equal to the posterior of one host, to the bit, although hosts join, fall silent and come back.
"""

import sys
import time

import pytest

from support import network
from support.laboratory import Laboratory, outcome

REASON = network.why_not()
pytestmark = pytest.mark.skipif(REASON is not None, reason=str(REASON))

# Batches that take long enough to cut a host off while they are simulated.
LONG = {"iterations": 2, "simulations": 600}


@pytest.fixture(scope="module")
def laboratory(session_of_module):
    """Three hosts with pools, beside the host of the inference."""
    laboratory = Laboratory(session_of_module, 3)
    try:
        for host in (1, 2, 3):
            laboratory.pool(host)
        yield laboratory
    finally:
        laboratory.close()


@pytest.fixture(scope="module")
def one_host(laboratory):
    """Outcomes of a short and of a long inference with a single pool on another host."""
    laboratory.bayes("/host1")
    before = laboratory.hosts.received(0)
    short = laboratory.infer()
    assert short["success"] and short["simulations"] == 200, short["message"]
    # 399 episodes: 200 simulations and 199 predictions of the posterior, each a track of more than 17 x 17 numbers of 8 bytes.
    assert laboratory.hosts.received(0) - before > 399 * 17 * 17 * 8, "the tracks did not come over the network"
    assert laboratory.shares() == {1: (399, 0)}
    return outcome(short), outcome(laboratory.infer(**LONG))


@pytest.mark.parametrize("pools", ["/host1,/host2", "/host*"])
def test_more_hosts_give_the_bits_of_one_and_share_the_work(laboratory, one_host, pools):
    laboratory.bayes(pools)
    assert outcome(laboratory.infer()) == one_host[0]
    shares = laboratory.shares()
    assert set(shares) == ({1, 2, 3} if "*" in pools else {1, 2})
    assert sum(episodes for episodes, _ in shares.values()) == 399
    assert all(episodes > 399 / 3 / len(shares) for episodes, _ in shares.values()), shares


def test_the_work_of_a_host_that_is_cut_off_is_done_elsewhere_and_the_host_may_come_back(laboratory, one_host):
    laboratory.bayes("/host1,/host2")
    # A cut between two batches loses nothing, so that it says nothing: then another inference is cut.
    for _ in range(4):
        child = laboratory.ask(**LONG)
        cut_s = laboratory.cut_at_work(2, after_s=time.time())
        try:
            noticed_s = laboratory.notice(2, after_s=cut_s)
        finally:
            laboratory.hosts.mend(2)
        mended_s = time.time()
        assert outcome(laboratory.answer(child)) == one_host[1]
        assert noticed_s - cut_s < 15
        shares = laboratory.shares()
        assert sum(episodes for episodes, _ in shares.values()) == 1399, "an episode was lost or counted twice"
        if shares[2][1] > 0:
            break
    assert shares[2][1] > 0, "no episode was done again"
    # A fast machine may end this batch before the pool that was silent gets work again; then the next batches show it.
    for _ in range(5):
        if laboratory.asked(2, after_s=mended_s) > 0:
            return
        assert outcome(laboratory.infer()) == one_host[0]
    raise AssertionError("the host came back and got no work")


def test_a_host_that_joins_during_a_batch_gets_work_at_once(laboratory, one_host):
    laboratory.hosts.cut(3)
    laboratory.bayes("/host1,/host3")
    child = laboratory.ask(**LONG)
    laboratory.session.wait_for(lambda: laboratory.asked(1) >= 4, 30, "work on host 1")
    laboratory.hosts.mend(3)
    mended_s = time.time()
    for _ in range(5):
        assert outcome(laboratory.answer(child)) == one_host[1]
        if laboratory.asked(3, after_s=mended_s) > 0:
            break
        # A fast machine may end the inference before it discovers the host; then the next one shows it.
        child = laboratory.ask(**LONG)
    assert laboratory.asked(3, after_s=mended_s) > 0 and laboratory.shares()[3][0] > 0
    assert laboratory.asked(2) == 0, "a pool that no pattern names was asked"


def test_a_pool_of_another_version_is_left_out_with_an_error(laboratory, one_host):
    session = laboratory.session
    script = session.root / "tests/support/other_pool.py"
    command = (sys.executable, script, session.environment["ROS_DOMAIN_ID"], "/host2/other_pool/simulate", "0.0.0")
    other = session.start_script(*laboratory.hosts.on(2, *command), name="other_pool")
    try:
        laboratory.bayes("/host1,/host2/other_pool")
        session.wait_for(lambda: outcome(laboratory.infer()) == one_host[0] and 2 in laboratory.shares(), 30, "two pools")
        assert laboratory.shares()[2][0] == 0
        (said,) = {text for level, _, text in laboratory.lines() if level == "ERROR"}
        assert said.startswith("/host2/other_pool/simulate is left out: expected a pool of version ") and '"0.0.0"' in said
    finally:
        other.kill()


def test_an_inference_that_finds_no_pool_says_so(laboratory):
    laboratory.bayes("/nowhere", patience_s=2.0)
    answer = laboratory.infer()
    assert not answer["success"]
    assert "no pool has been at work for 2 s, 0 in the graph" in answer["message"]


def test_without_multicast_hosts_meet_in_a_tunnel(session, one_host):
    laboratory = Laboratory(session, 1, multicast=False, tunnel=True)
    try:
        laboratory.pool(1)
        laboratory.bayes()
        assert outcome(laboratory.infer()) == one_host[0]
    finally:
        laboratory.close()
