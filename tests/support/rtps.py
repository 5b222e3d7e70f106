"""RTPS datagrams that no honest program sends, and the ports of a process that hears them (RTPS 2.5, sections 9.4.5 and 9.6.2.3)."""

import pathlib
import socket
import struct

# A reader of discovery, which every participant has, and its writer.
DISCOVERY = (bytes.fromhex("000003c7"), bytes.fromhex("000003c2"))
GIB = 1 << 30
PAD, INFO_TS, DATA_FRAG = 0x01, 0x09, 0x16


def of_users():
    """Identifiers of the readers that a node may have, each with a writer: readers without and with keys."""
    return [(bytes((0, 0, number, kind)), bytes((0, 0, 1, 0x03))) for number in range(40) for kind in (0x04, 0x07)]


def submessage(kind, body, little=True, to_the_end=False):
    """One submessage; `to_the_end` leaves its length out, as the last one may."""
    length = struct.pack("<H" if little else ">H", 0 if to_the_end else len(body))
    return bytes((kind, int(little))) + length + body


def claim(sample_bytes, number=1, entities=DISCOVERY, sender=b"\x01\x0fclaims4gib", before=b"", little=True, to_the_end=False):
    """Datagram with the first fragment of a sample of `sample_bytes`, behind the submessages `before`."""
    order = "<" if little else ">"
    fragment = 1024
    body = struct.pack(order + "HH", 0, 28) + b"".join(entities) + struct.pack(order + "iI", 0, number)
    body += struct.pack(order + "IHHI", 1, 1, fragment, sample_bytes) + b"\x00\x03\x00\x00" + bytes(fragment - 4)
    return b"RTPS\x02\x04\x01\x0f" + sender + before + submessage(DATA_FRAG, body, little, to_the_end)


def claims(sample_bytes=4 * GIB - 1):
    """One claim in every form in which a datagram may hold it."""
    many = submessage(INFO_TS, b"") * 3 + submessage(PAD, b"") * 5000 + submessage(0x80, bytes(3000))
    yield claim(sample_bytes)
    yield claim(sample_bytes, little=False)
    yield claim(sample_bytes, to_the_end=True)
    yield claim(sample_bytes, before=many)
    # A reader of a user, and no reader in particular.
    yield claim(sample_bytes, entities=(bytes.fromhex("00000004"), bytes.fromhex("00000003")))
    yield claim(sample_bytes, entities=(bytes(4), DISCOVERY[1]))


def send(datagrams, port, address="127.0.0.1"):
    """Sends datagrams to a port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in datagrams:
            sender.sendto(datagram, (address, port))


def ports(pid, domain):
    """UDP ports of a domain at which a process of this network namespace listens."""
    links = [link.readlink().name for link in pathlib.Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()]
    rows = [row.split() for row in pathlib.Path(f"/proc/{pid}/net/udp").read_text().splitlines()[1:]]
    bound = {int(row[1].rsplit(":", 1)[1], 16) for row in rows if f"socket:[{row[9]}]" in links}
    return sorted(port for port in bound if (port - 7400) // 250 == domain)


def discovery_port(pid, domain):
    """Port at which a process receives discovery that is sent to it alone."""
    return next(port for port in ports(pid, domain) if (port - 7400) % 250 >= 10 and port % 2 == 0)


def resident_mb(pid):
    """Resident memory of a process, MB, and its greatest so far."""
    status = dict(line.split(":", 1) for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines())
    return tuple(int(status[key].split()[0]) / 1000 for key in ("VmRSS", "VmHWM"))
