"""Datagrams of other machines, which are network namespaces: a node that keeps to its machine hears none, another one hears all.

A claim of memory shows whether a node hears its sender, because the node drops it with a line in its log. The first such line names
the first sender that was heard. The rules of the firewall are those of launch_configs/SECURITY.md.
"""

import pathlib
import re
import shutil
import struct
import subprocess
import sys

import pytest

from support import network, rtps
from support.program import PROGRAM, ROOT

REASON = network.why_not()
pytestmark = pytest.mark.skipif(REASON is not None, reason=str(REASON))

NODE, FOREIGN, ALLOWED = 0, 1, 2
GROUP = "239.255.0.1"
# Sends each argument, `ADDRESS:PORT:DATAGRAM` in hexadecimal. An address `eth0` sends whole frames.
SEND = """
import socket, sys
for word in sys.argv[1:]:
    address, port, datagram = word.split(":")
    if address == "eth0":
        sender = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
        sender.bind((address, 0))
        sender.send(bytes.fromhex(datagram))
    else:
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sender.sendto(bytes.fromhex(datagram), (address, int(port)))
"""


def frame(source, target, port, datagram):
    """Ethernet frame to everyone with a UDP datagram whose source address is invented."""
    addresses = bytes(map(int, f"{source}.{target}".split(".")))
    udp = struct.pack(">HHHH", 9999, port, 8 + len(datagram), 0) + datagram
    header = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 1, 0, 64, 17, 0) + addresses
    total = sum(struct.unpack(">10H", header))
    total = (total & 0xFFFF) + (total >> 16)
    header = header[:10] + struct.pack(">H", 0xFFFF ^ ((total & 0xFFFF) + (total >> 16))) + header[12:]
    return bytes.fromhex("ffffffffffff 020000000001 0800") + header + udp


@pytest.fixture
def machines(session):
    """Three hosts; a session for the node on the first."""
    hosts = network.Hosts(3)
    try:
        yield session, hosts
    finally:
        session.end_children()
        hosts.close()


def start(session, hosts, discovery):
    """Starts a camera on its host; returns its four ports, those of multicast first."""
    session.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = discovery
    session.start_script(*hosts.on(NODE, PROGRAM, "node", "camera"), name="camera")
    bound = lambda pid: rtps.ports(pid, session.domain)
    session.wait_for(lambda: len(of_process(session, bound)) == 4, 20, "the camera's sockets")
    # Begun after the node has joined, so that its sockets are restricted if they are to be.
    threads = lambda pid: [path.read_text().strip() for path in pathlib.Path(f"/proc/{pid}/task").glob("*/comm")]
    session.wait_for(lambda: "diagnostics" in of_process(session, threads), 20, "its threads")
    return session.wait_for(lambda: len(found := of_process(session, bound)) == 4 and found, 20, "the camera's sockets once more")


def of_process(session, read):
    """What `read` finds of the camera's process; an empty list before it runs, or where a file of it closes on the way."""
    pid = session.pid_of("camera")
    try:
        return read(pid) if pid else []
    except (FileNotFoundError, ProcessLookupError):
        return []


def first_heard(session, hosts, senders):
    """Sends claims from hosts, one host after the other, and at last from the node's own; returns the host that is heard first.

    `senders`: for each host the words of `SEND`, without the datagram.
    """
    for host, targets in senders.items():
        datagram = rtps.claim((1 << 32) - 1, sender=b"\x01\x0ffrom_host" + bytes([host]))
        words = [target(datagram) if callable(target) else f"{target}:{datagram.hex()}" for target in targets]
        subprocess.run(hosts.on(host, sys.executable, "-c", SEND, *words), check=True)
    pattern = r"DDS participant 010f66726f6d5f686f7374(\d\d) was dropped"
    session.wait_for(lambda: re.search(pattern, session.text("camera.err")), 20, "a claim that is heard")
    heard = re.findall(pattern, session.text("camera.err"))
    return int(heard[0], 16)


def everywhere(ports, address):
    """Each socket of a participant, as a word of `SEND`: the two of multicast, and the two of its own."""
    return [f"{GROUP}:{port}" for port in ports[:2]] + [f"{address}:{port}" for port in ports]


def test_a_node_on_a_network_hears_another_machine(machines):
    session, hosts = machines
    ports = start(session, hosts, "SUBNET")
    senders = {FOREIGN: everywhere(ports, hosts.address(NODE)), NODE: [f"127.0.0.1:{ports[2]}"]}
    assert first_heard(session, hosts, senders) == FOREIGN


@pytest.mark.parametrize("source", [network.Hosts.address(NODE), "127.0.0.1"])
@pytest.mark.parametrize("discovery", ["SUBNET", "LOCALHOST"])
def test_a_node_that_keeps_to_its_machine_hears_no_other_whatever_address_it_invents(machines, discovery, source):
    session, hosts = machines
    # The kernel drops such addresses by itself; these settings, which container networks use, let them pass.
    for setting in ("route_localnet=1", "accept_local=1", "rp_filter=0"):
        for interface in ("all", "eth0"):
            subprocess.run(hosts.on(NODE, "sysctl", "-q", "-w", f"net.ipv4.conf.{interface}.{setting}"), check=True)
    ports = start(session, hosts, discovery)
    forged = lambda port: lambda datagram: f"eth0:0:{frame(source, hosts.address(NODE), port, datagram).hex()}"
    honest = everywhere(ports, hosts.address(NODE)) if discovery == "LOCALHOST" else []
    senders = {FOREIGN: [*map(forged, ports[2:]), *honest], NODE: [f"127.0.0.1:{ports[2]}"]}
    assert first_heard(session, hosts, senders) == (FOREIGN if discovery == "SUBNET" else NODE)


def rules():
    """Rules of the firewall in the document."""
    text = (ROOT / "launch_configs/SECURITY.md").read_text()
    return re.search(r"```nft\n(.*?)```", text, re.DOTALL)[1]


@pytest.mark.skipif(not shutil.which("nft"), reason="the firewall needs the program nft (nftables)")
def test_the_firewall_of_the_document_lets_in_the_machines_of_the_laboratory_alone(machines):
    session, hosts = machines
    # The document's laboratory has two computers; here their addresses are those of the node and of one other host.
    text = rules()
    given = re.search(r"define lab = \{ (.*?) \}", text)[1]
    file = session.folder / "rules.nft"
    # The third host stands for the robot: it is heard at a port that the system chose, and at no port of DDS.
    robot = re.search(r"define robot = (\S+)", text)[1]
    text = text.replace(given, f"{hosts.address(NODE)}, {hosts.address(ALLOWED)}").replace(robot, hosts.address(FOREIGN))
    file.write_text(text)
    ports = start(session, hosts, "SUBNET")
    subprocess.run(hosts.on(NODE, "nft", "-f", file), check=True)
    targets = everywhere(ports, hosts.address(NODE))
    assert first_heard(session, hosts, {FOREIGN: targets, ALLOWED: targets}) == ALLOWED
    refused = re.search(r"counter packets (\d+)", subprocess.run(
        hosts.on(NODE, "nft", "list", "table", "inet", "ros"), check=True, capture_output=True, text=True
    ).stdout)  # fmt: skip
    assert int(refused[1]) >= len(targets)
    assert state_heard(hosts) == "state\n"


def state_heard(hosts):
    """A datagram of the third host as the client of a robot hears it: at a port of the system, before it has sent any itself."""
    receive = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.settimeout(30); s.bind(('', 0));"
        "print(s.getsockname()[1], flush=True); print(s.recv(99).decode(), flush=True)"
    )
    with subprocess.Popen(hosts.on(NODE, sys.executable, "-c", receive), stdout=subprocess.PIPE, text=True) as client:
        address = (hosts.address(NODE), int(client.stdout.readline()))
        send = f"import socket; socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b'state', {address})"
        subprocess.run(hosts.on(FOREIGN, sys.executable, "-c", send), check=True)
        return client.stdout.readline()
