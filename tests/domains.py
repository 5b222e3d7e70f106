"""DDS domains for tests: nobody else's, and on this machine only.

A claim is an abstract socket, as `catenary demo` makes one: each network namespace has its own, and it ends with the process.
"""

import os
import socket

# Every node that a test makes, in this process and in others, keeps to the loopback interface.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
# The older variable would count for more.
os.environ.pop("ROS_LOCALHOST_ONLY", None)

USERS = os.environ.get("ROS_DOMAIN_ID", "0").strip() or "0"
FIRST, LAST = 20, 70


def is_used(domain):
    """Whether a participant of this machine has a port of a domain (RTPS 2.5, section 9.6.2.3)."""
    rows = [row.split() for path in ("/proc/net/udp", "/proc/net/udp6") for row in open(path).readlines()[1:]]
    return any((int(row[1].rsplit(":", 1)[1], 16) - 7400) // 250 == domain for row in rows)


class Domain:
    """A domain that is nobody's, not the user's either, until it is given back."""

    def __init__(self):
        domains = range(FIRST, LAST + 1)
        start = os.getpid() % len(domains)
        for number in [*domains[start:], *domains[:start]]:
            if str(number) == USERS:
                continue
            self.claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                self.claim.bind(f"\0catenary/domain/{number}")
                if not is_used(number):
                    self.number = number
                    return
            except OSError:
                pass  # somebody else's claim
            self.claim.close()
        raise RuntimeError(f"expected a DDS domain of {FIRST} to {LAST} that nobody is in, found none")

    def give_back(self):
        self.claim.close()
