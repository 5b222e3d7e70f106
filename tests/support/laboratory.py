"""Inference on host 0 of a network, and simulator pools on the other hosts."""

import json
import re
import time

from .network import Hosts
from .program import PROGRAM

LINE = re.compile(r"\[(?P<level>\w+)\] \[(?P<at>[\d.]+)\] \[bayes_sim\]: (?P<text>.*)")
SHARE = re.compile(r"(\S+) (\d+) \((\d+) %(?:, (\d+) lost)?\)")
MODEL = "launch_configs/models/soft_bar.yaml"


class Laboratory:
    """Pools on hosts 1, 2, ... in the namespaces /host1, /host2, ..., and an inference node that asks the pools it is given."""

    def __init__(self, session, count, multicast=True, tunnel=False):
        self.session = session
        self.hosts = Hosts(count + 1, multicast)
        if tunnel:
            self.hosts.tunnel()
        profile = session.root / "launch_configs/fastdds_network.xml"
        session.environment |= {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
            "RUST_BACKTRACE": "1",
        }
        self.node = None

    def start(self, host, node, *arguments, log):
        command = (PROGRAM, "node", node, "--ros-args", *arguments)
        return self.session.start_script(*self.hosts.on(host, *command), name=log)

    def pool(self, host, *arguments):
        return self.start(host, "simulator_pool", "-r", f"__ns:=/host{host}", *arguments, log=f"pool{host}")

    def bayes(self, pools="/*", patience_s=20.0):
        """Starts the inference node again with these pools, a pattern."""
        if self.node:
            self.session.stop(self.node)
        arguments = ("-p", f"pools:={pools}", "-p", f"pool_patience_s:={patience_s}", "--log-level", "bayes_sim:=debug")
        self.node = self.start(0, "bayes_sim", *arguments, log="bayes")

    def lines(self):
        """Log lines of the inference node: level, time and text."""
        found = map(LINE.fullmatch, self.session.text("bayes.err").splitlines())
        return [(line["level"], float(line["at"]), line["text"]) for line in found if line]

    def ask(self, iterations=1, simulations=200, seed=3, name="ask"):
        """Starts an inference; returns the process of the command."""
        root = self.session.root
        sizes = ("--preset", "networks", "--iterations", iterations, "--simulations", simulations, "--seed", seed)
        files = ("--bag", root / "bags/swing", "--model", root / MODEL, "--out", self.session.folder / name)
        command = (PROGRAM, "infer", "--node", "--wait-s", 30, *files, *sizes, "--json")
        return self.session.start_script(*self.hosts.on(0, *command), name=name)

    def answer(self, child, seconds=120, name="ask"):
        # Exit code 3: the bag is a made-up swing, which the soft bar does not fit. The result is written all the same.
        if child.wait(seconds) not in (0, 3):
            return {"success": False, "message": self.session.text(f"{name}.err")}
        return {"success": True, "message": ""} | json.loads(self.session.text(f"{name}.out"))

    def infer(self, **sizes):
        return self.answer(self.ask(**sizes))

    def asked(self, host, after_s=0.0):
        """Number of requests to a host's pool since a time."""
        pool = f"/host{host}/simulator_pool/simulate: episodes "
        return sum(text.startswith(pool) and at >= after_s for _, at, text in self.lines())

    def seconds_of_batches(self):
        """Episodes and seconds of every batch so far, without the training between batches."""
        found = (re.fullmatch(r"(\d+) episodes in ([\d.]+) s", text) for _, _, text in self.lines())
        return [(int(match[1]), float(match[2])) for match in found if match]

    def shares(self):
        """For each host the episodes of the newest inference that it did, and those that another host did in its place."""
        summary = next(text for _, _, text in reversed(self.lines()) if " episodes: " in text)
        return {int(re.search(r"host(\d+)", name)[1]): (int(n), int(lost or 0)) for name, n, _, lost in SHARE.findall(summary)}

    def cut_at_work(self, host, pause_s=1.5, after_s=0.0):
        """Cuts a host off while it does work that was asked for since a time; returns the time of the cut."""
        self.session.wait_for(lambda: self.asked(host, after_s) >= 3, 30, f"work on host {host}")
        time.sleep(pause_s)
        self.hosts.cut(host)
        return time.time()

    def notice(self, host, seconds=60, after_s=0.0):
        """Time at which the inference node noticed a host's silence, since a time."""

        def said():
            named = (at for _, at, text in self.lines() if f"/host{host}/" in text and "go to other pools" in text)
            return [at for at in named if at >= after_s]

        return self.session.wait_for(said, seconds, f"a word about host {host}")[0]

    def close(self):
        self.hosts.close()


def outcome(answer):
    """Parts of an answer that must not depend on the hosts, to the bit."""
    return answer["posterior"], answer["losses"]
