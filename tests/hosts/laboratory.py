"""An inference on host 0 of a network, and pools on the others."""

import json
import re
import time

from network import Hosts

LINE = re.compile(r"\[(?P<level>\w+)\] \[(?P<at>[\d.]+)\] \[bayes_sim\]: (?P<text>.*)")
SHARE = re.compile(r"(\S+) (\d+) \((\d+) %(?:, (\d+) lost)?\)")
MODEL = "launch_configs/models/soft_bar.yaml"


class Laboratory:
    """Pools on hosts 1, 2, ... under /host1, /host2, ..., and an inference that asks those that it may."""

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
        command = (*node_command(node), "--ros-args", *arguments)
        return self.session.start_script(*self.hosts.on(host, *command), name=log)

    def pool(self, host, *arguments):
        return self.start(host, "simulator_pool", "-r", f"__ns:=/host{host}", *arguments, log=f"pool{host}")

    def bayes(self, pools="/*", patience_s=20.0):
        """Starts the inference node anew."""
        if self.node:
            self.session.stop(self.node)
        arguments = ("-p", f"pools:={pools}", "-p", f"pool_patience_s:={patience_s}", "--log-level", "bayes_sim:=debug")
        self.node = self.start(0, "bayes_sim", *arguments, log="bayes")

    def lines(self):
        """What the inference node has said: level, time and text."""
        found = map(LINE.fullmatch, self.session.text("bayes.err").splitlines())
        return [(line["level"], float(line["at"]), line["text"]) for line in found if line]

    def ask(self, iterations=1, simulations=200, seed=3, name="ask"):
        """Begins an inference."""
        root = self.session.root
        sizes = ("--iterations", iterations, "--simulations", simulations, "--seed", seed)
        files = ("--bag", root / "bags/swing", "--model", root / MODEL, "--out", self.session.folder / name)
        command = (*program(), "infer", "--node", "--wait-s", 30, *files, *sizes, "--json")
        return self.session.start_script(*self.hosts.on(0, *command), name=name)

    def answer(self, child, seconds=120, name="ask"):
        # The bag is a made-up swing, which the soft bar does not fit: the result is written, with exit code 3.
        if child.wait(seconds) not in (0, 3):
            return {"success": False, "message": self.session.text(f"{name}.err")}
        return {"success": True, "message": ""} | json.loads(self.session.text(f"{name}.out"))

    def infer(self, **sizes):
        return self.answer(self.ask(**sizes))

    def asked(self, host, after_s=0.0):
        """How often a pool was asked for a part since then."""
        pool = f"/host{host}/simulator_pool/simulate: episodes "
        return sum(text.startswith(pool) and at >= after_s for _, at, text in self.lines())

    def seconds_of_batches(self):
        """Episodes and seconds of every batch so far: what training takes is not in it."""
        found = (re.fullmatch(r"(\d+) episodes in ([\d.]+) s", text) for _, _, text in self.lines())
        return [(int(match[1]), float(match[2])) for match in found if match]

    def shares(self):
        """Episodes of the newest inference by host, and those that were asked for and done by another."""
        summary = next(text for _, _, text in reversed(self.lines()) if " episodes: " in text)
        return {int(re.search(r"host(\d+)", name)[1]): (int(n), int(lost or 0)) for name, n, _, lost in SHARE.findall(summary)}

    def cut_at_work(self, host, pause_s=1.5):
        """Cuts a host off while it simulates; returns when."""
        self.session.wait_for(lambda: self.asked(host) >= 3, 30, f"work on host {host}")
        time.sleep(pause_s)
        self.hosts.cut(host)
        return time.time()

    def notice(self, host, seconds=60):
        """When a host's silence was noticed."""
        said = lambda: [at for _, at, text in self.lines() if f"/host{host}/" in text and "done by others" in text]
        return self.session.wait_for(said, seconds, f"a word about host {host}")[0]

    def close(self):
        self.hosts.close()


def program():
    from conftest import PROGRAM

    return (PROGRAM,)


def node_command(node):
    return (*program(), "node", node)


def outcome(answer):
    """What must be the same to the bit."""
    return answer["posterior"], answer["losses"]
