"""Checks by bytes: what no library sends, and what no library shows. Written from the table of the protocol, version 5."""

import math
import os
import signal
import socket
import struct
import subprocess
import sys
import time

from script import main, server, wait_until

CONNECT, MOVE, STOP, SET_LOAD, RECOVERY, LOAD_MODEL = 0, 1, 2, 10, 12, 13
STARTED, PREEMPTED, NOT_POSSIBLE, INVALID, REFLEX, INPUT_ERROR = 1, 2, 3, 5, 6, 8
IDLE_MODE, MOVE_MODE, REFLEX_MODE = 1, 2, 4
COMMUNICATION, TORQUE_DISCONTINUITY = 25, 32


class State:
    """Fields of a state that the checks read."""

    def __init__(self, datagram):
        self.datagram = datagram
        (self.id,) = struct.unpack_from("<Q", datagram)
        self.dq_d = struct.unpack_from("<7d", datagram, 1352)
        self.gravity = struct.unpack_from("<3d", datagram, 1872)
        self.generator, self.controller = datagram[2280], datagram[2281]
        self.reasons = [i for i, flag in enumerate(datagram[2323:2364]) if flag]
        self.mode = datagram[2364]
        (self.rate,) = struct.unpack_from("<d", datagram, 2365)


class Client:
    """Connection with both sockets."""

    def __init__(self, address):
        self.stream = socket.create_connection((address, 1337), timeout=10)
        self.datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.datagrams.bind(("0.0.0.0", 0))
        self.datagrams.settimeout(10)
        self.next_id, self.source = 0, None

    def send(self, command, payload=b""):
        """Sends a request; returns its identifier."""
        self.stream.sendall(struct.pack("<III", command, self.next_id, 12 + len(payload)) + payload)
        self.next_id += 1
        return self.next_id - 1

    def read(self, count):
        data = b""
        while len(data) < count:
            part = self.stream.recv(count - len(data))
            if not part:
                raise ConnectionError("closed")
            data += part
        return data

    def receive(self):
        """Next answer: command, identifier, payload."""
        command, number, size = struct.unpack("<III", self.read(12))
        return command, number, self.read(size - 12)

    def request(self, command, payload=b""):
        """Payload of the answer to a request."""
        sent = (command, self.send(command, payload))
        answer = self.receive()
        assert answer[:2] == sent, (sent, answer)
        return answer[2]

    def connect(self, version=5):
        answer = self.request(CONNECT, struct.pack("<HH", version, self.datagrams.getsockname()[1]))
        return struct.unpack("<BH", answer)

    def state(self):
        datagram, self.source = self.datagrams.recvfrom(4096)
        assert len(datagram) == 2373, len(datagram)
        return State(datagram)

    def command(self, number, torque=(0.0,) * 7, finished=False):
        """Sends a command with torques; speeds are 0."""
        data = struct.pack("<Q38d??7d", number, *[0.0] * 38, False, finished, *torque)
        assert len(data) == 370
        self.datagrams.sendto(data, self.source)

    def skip(self):
        """Sends no command, and has the lock step go on."""
        self.datagrams.sendto(b"", self.source)

    def start(self):
        """Starts a motion with torques; returns the identifier of the request and the first state of the motion."""
        motion = self.send(MOVE, struct.pack("<II6d", 2, 1, *[10, 3.12, 2 * math.pi] * 2))
        assert self.receive() == (MOVE, motion, bytes([STARTED]))
        while (state := self.state()).mode != MOVE_MODE:
            pass
        assert (state.generator, state.controller) == (2, 2)
        return motion, state

    def is_closed(self):
        try:
            return self.stream.recv(1) == b""
        except ConnectionError:
            return True


def connected(address):
    client = Client(address)
    assert client.connect() == (0, 5)
    return client


def finish(client, motion, state):
    """Ends a motion; returns its final status."""
    while state.generator:
        client.command(state.id, finished=True)
        state = client.state()
    assert state.controller == 3
    command, number, status = client.receive()
    assert (command, number) == (MOVE, motion)
    return status[0]


def recover(client):
    assert client.request(RECOVERY) == b"\0"
    while client.state().mode != IDLE_MODE:
        pass


def check_01(address):
    for version in (4, 10):
        client = Client(address)
        assert client.connect(version) == (1, 5), version
        assert client.is_closed()
    client = connected(address)
    other = Client(address)
    assert other.is_closed()
    client.state()
    for nonsense in (struct.pack("<III", 99, 1, 12), struct.pack("<III", 2, 1, 11), struct.pack("<III", 10, 1, 13) + b"x"):
        client.stream.sendall(nonsense)
        assert client.is_closed()
        client = connected(address)
    return "5 accepted; 4 and 10 told 5; a second client and malformed requests refused"


def check_02(address):
    client = connected(address)
    began = time.monotonic()
    states = [client.state() for _ in range(1000)]
    seconds = time.monotonic() - began
    assert client.source == (address, 1337)
    assert [s.id for s in states] == list(range(states[0].id, states[0].id + 1000))
    assert all(s.gravity == (0, 0, -9.81) and (s.generator, s.controller, s.rate) == (0, 3, 0) for s in states)
    assert 0.5 < seconds < 3, seconds
    return f"1000 states of 2373 bytes from port 1337 in {seconds:.2f} s, identifiers one apart"


def check_03(address):
    client = connected(address)
    # Size with header of each setter that libfranka sends, and of its answer.
    sizes = {3: (16, 166), 4: (428, 13), 5: (68, 13), 6: (60, 13), 7: (19, 13), 8: (140, 13), 9: (140, 13), 10: (116, 13), 11: (52, 13)}
    frame = struct.pack("<16d", 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)
    valid = {
        4: struct.pack("<52d", *[50] * 52),
        5: struct.pack("<7d", *[2000] * 7),
        6: struct.pack("<6d", *[100] * 6),
        8: frame,
        9: frame,
        11: struct.pack("<5d", *[100] * 5),
    }
    for command, (size, answer_size) in sizes.items():
        payload = valid.get(command, bytes(size - 12))
        answer = client.request(command, payload)
        assert len(answer) == answer_size - 12 and answer[0] == 0, (command, answer[:1])
    assert client.request(SET_LOAD, struct.pack("<13d", *[math.nan] * 13)) == b"\2"
    motion, state = client.start()
    assert client.request(SET_LOAD, bytes(104)) == b"\1", "setters are refused in a motion"
    assert finish(client, motion, state) == 0
    return "sizes of all answers; NaN gives status 2, a motion status 1"


def check_04(address):
    client = connected(address)
    motion, state = client.start()
    began = time.monotonic()
    rates = []
    for _ in range(1000):
        client.command(state.id)
        last, state = state, client.state()
        assert state.id == last.id + 1 and state.dq_d == (0,) * 7
        rates.append(state.rate)
    ratio = 1 / (time.monotonic() - began)
    assert rates[-1] == 1, rates[-1]
    assert finish(client, motion, state) == 0
    return f"1000 cycles, no state without its command, success rate 1, {ratio:.0f} times real time"


def in_motion(client, torque, cycles=50):
    """Motion with torques that must end by itself; returns its final status and the last state."""
    _, state = client.start()
    for n in range(cycles):
        client.command(state.id, torque(n))
        state = client.state()
        if state.generator == 0:
            break
    return client.receive()[2][0], state


def check_06(address):
    client = connected(address)
    for size, torque in ((1.01, lambda n: [1.01 * (n == 10), 0, 0, 0, 0, 0, 0]), (math.nan, lambda n: [math.nan if n == 10 else 0.0] * 7)):
        status, state = in_motion(client, torque)
        if math.isnan(size):
            assert status == INPUT_ERROR, status
        else:
            assert (status, state.mode, state.reasons) == (REFLEX, REFLEX_MODE, [TORQUE_DISCONTINUITY]), (status, state.reasons)
            assert client.request(STOP) == b"\0"
            assert client.request(MOVE, struct.pack("<II6d", 2, 1, *[1] * 6)) == bytes([NOT_POSSIBLE])
            recover(client)
    assert client.request(MOVE, struct.pack("<II6d", 7, 1, *[1] * 6)) == bytes([INVALID])
    return "1.01 N m gives error 32, NaN the status InputErrorAborted, controller 7 InvalidArgument"


def check_08(address):
    client = connected(address)
    for lost in (19, 20):
        motion, state = client.start()
        rate = 1
        for n in range(400):
            if 150 <= n < 150 + lost:
                client.skip()
            else:
                client.command(state.id)
            state = client.state()
            if n > 150:
                rate = min(rate, state.rate)
            if state.generator == 0:
                break
        if lost == 19:
            assert abs(rate - 0.81) < 0.015, rate
            assert finish(client, motion, state) == 0
            low = rate
        else:
            assert (n, state.mode, state.reasons) == (150 + 19, REFLEX_MODE, [COMMUNICATION]), (n, state.mode, state.reasons)
            assert client.receive()[2][0] == REFLEX
            recover(client)
    return f"19 lost: success rate {low:.2f}; the 20th gives error 25"


def check_12(address):
    client = connected(address)
    motion, state = client.start()
    for n in range(300):
        if n == 150:
            # Commands for older states count for nothing.
            client.command(state.id - 5, (5.0,) + (0.0,) * 6)
        client.command(state.id)
        client.command(state.id)
        state = client.state()
    assert state.rate == 1 and state.mode == MOVE_MODE
    assert finish(client, motion, state) == 0
    return "old and repeated commands change nothing"


def silent(address):
    """Client that is killed with a motion running."""
    client = connected(address)
    _, state = client.start()
    for _ in range(50):
        client.command(state.id)
        state = client.state()
    os.kill(os.getpid(), signal.SIGKILL)


def check_13(address):
    subprocess.run([sys.executable, __file__, "silent", address], check=False, timeout=20)
    client = connected(address)
    state = client.state()
    assert (state.mode, state.reasons) == (REFLEX_MODE, [COMMUNICATION]), (state.mode, state.reasons)
    assert client.request(MOVE, struct.pack("<II6d", 2, 1, *[10] * 6)) == bytes([NOT_POSSIBLE])
    recover(client)
    _, state = client.start()
    for _ in range(50):
        client.command(state.id)
        state = client.state()
    # Silent: the server waits for half a second, then its clock runs.
    began = time.monotonic()
    while (state := client.state()).generator:
        pass
    seconds = time.monotonic() - began
    assert state.reasons == [COMMUNICATION] and seconds < 2, (state.reasons, seconds)
    return f"killed in a motion: reflex, the next client recovers; silent in a motion: error 25 after {seconds:.1f} s"


def check_16(address):
    client = connected(address)
    statuses = []
    for n in range(30):
        motion, state = client.start()
        client.command(state.id)
        state = client.state()
        if n % 3 == 0:
            stop = client.send(STOP)
            answers = sorted(client.receive() for _ in range(2))
            assert answers == [(MOVE, motion, bytes([PREEMPTED])), (STOP, stop, b"\0")], answers
            statuses.append(PREEMPTED)
            while client.state().mode != IDLE_MODE:
                pass
        else:
            statuses.append(finish(client, motion, state))
    client.stream.settimeout(0.2)
    try:
        raise AssertionError(f"another answer: {client.receive()}")
    except TimeoutError:
        pass
    wait_until("30 ends", lambda: server("count motion ended") == "30")
    return f"30 motions, {statuses.count(0)} finished, {statuses.count(PREEMPTED)} stopped: one final status each"


def check_17_library(address):
    client = connected(address)
    library = client.request(LOAD_MODEL, b"\0\0")
    assert library[:5] == b"\0\x7fELF"
    for machine in (b"\3\0", b"\0\1"):
        assert client.request(LOAD_MODEL, machine) == b"\1"
    return f"{len(library) - 1} bytes for x86-64 Linux; status 1 for others"


if __name__ == "__main__":
    main(globals())
