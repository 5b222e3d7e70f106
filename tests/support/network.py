"""Hosts on one machine: network namespaces on a bridge, with the MTU of Ethernet and links that can be cut."""

import itertools
import os
import shutil
import subprocess

MTU = 1500
numbers = itertools.count()


def ip(*words, check=True):
    return subprocess.run(["ip", *map(str, words)], check=check, capture_output=True, text=True)


def why_not():
    """Reason why this machine cannot have hosts; None if it can."""
    if not shutil.which("ip"):
        return "network namespaces need the program ip (iproute2)"
    if os.geteuid() != 0:
        return "network namespaces need root"
    name = f"catenary{os.getpid()}"
    made = ip("netns", "add", name, check=False)
    if made.returncode:
        return f"no network namespaces here: {made.stderr.strip()}"
    linked = ip("-n", name, "link", "add", "name", "one", "type", "veth", "peer", "name", "two", check=False)
    ip("netns", "del", name)
    return f"no virtual Ethernet here: {linked.stderr.strip()}" if linked.returncode else None


class Hosts:
    """`count` hosts, numbered from 0, with the addresses 10.77.0.1 and so on. Without `multicast` the network drops it."""

    def __init__(self, count, multicast=True):
        self.tag = f"c{os.getpid()}n{next(numbers)}"
        self.bridge = f"{self.tag}b"
        self.count = 0
        ip("link", "add", self.bridge, "type", "bridge", "mcast_snooping", 0)
        try:
            ip("link", "set", self.bridge, "up")
            for host in range(count):
                self.add(host, multicast)
        except BaseException:
            self.close()
            raise

    def add(self, host, multicast):
        name, link = self.name(host), self.link(host)
        ip("netns", "add", name)
        self.count = host + 1
        ip("link", "add", link, "mtu", MTU, "type", "veth", "peer", "name", "eth0", "mtu", MTU, "netns", name)
        ip("link", "set", link, "master", self.bridge, "up")
        if not multicast:
            # The bridge forwards no multicast to this host.
            ip("link", "set", link, "type", "bridge_slave", "mcast_flood", "off")
        ip("-n", name, "link", "set", "lo", "up")
        ip("-n", name, "addr", "add", f"{self.address(host)}/24", "dev", "eth0")
        ip("-n", name, "link", "set", "eth0", "up")
        ip("-n", name, "route", "add", "default", "dev", "eth0")

    def name(self, host):
        return f"{self.tag}h{host}"

    def link(self, host):
        """Name of the bridge's end of a host's link."""
        return f"{self.tag}v{host}"

    @staticmethod
    def address(host):
        return f"10.77.0.{host + 1}"

    def on(self, host, *command):
        """Command line that runs a command on a host."""
        return ("ip", "netns", "exec", self.name(host), *map(str, command))

    def cut(self, host):
        """Takes a host's link down without any notice to the others, as a pulled cable does."""
        ip("link", "set", self.link(host), "down")

    def mend(self, host):
        ip("link", "set", self.link(host), "up")

    def tunnel(self):
        """Adds a VXLAN over unicast that copies multicast packets to every host."""
        for host in range(self.count):
            inside = ("-n", self.name(host))
            ip(*inside, "link", "add", "ros", "type", "vxlan", "id", 42, "dstport", 4789, "local", self.address(host), "dev", "eth0")
            for other in range(self.count):
                if other != host:
                    command = ("bridge", "fdb", "append", "00:00:00:00:00:00", "dev", "ros", "dst")
                    subprocess.run(self.on(host, *command, self.address(other)), check=True)
            ip(*inside, "addr", "add", f"10.78.0.{host + 1}/24", "dev", "ros")
            ip(*inside, "link", "set", "ros", "up")
            ip(*inside, "route", "replace", "default", "dev", "ros")

    def received(self, host):
        """Bytes that a host has received."""
        path = "/sys/class/net/eth0/statistics/rx_bytes"
        return int(subprocess.run(self.on(host, "cat", path), check=True, capture_output=True, text=True).stdout)

    def close(self):
        for host in range(self.count):
            ip("netns", "del", self.name(host), check=False)
        ip("link", "del", self.bridge, check=False)
