"""The example `serve` as a process: its end, its arguments, and what happens when its server dies."""

import os
import signal
import socket
import subprocess
import time

import pytest
from rig import SERVER, Server, next_address

SOON = 20


@pytest.fixture
def start():
    """Starts servers with what Popen takes; they end with the test."""
    assert SERVER.exists(), f"{SERVER} is missing: cargo build --release -p panda_emulator --example serve"
    processes = []

    def start(*arguments, address=None, **how):
        address = address or f"{next_address()}:1337"
        pipe = subprocess.PIPE
        processes.append(subprocess.Popen([SERVER, address, *arguments], stdout=pipe, stderr=pipe, text=True, bufsize=1, **how))
        return processes[-1], address

    yield start
    for process in processes:
        process.kill()
        process.wait()


def connect(address):
    host, port = address.split(":")
    return socket.create_connection((host, int(port)), timeout=SOON)


def closed_stdin():
    os.close(0)


@pytest.mark.parametrize("stdin", ["null", "closed", "pipe that ends"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_without_a_stdin_until_a_signal_ends_it(stdin, number, start):
    how = {"null": {"stdin": subprocess.DEVNULL}, "closed": {"preexec_fn": closed_stdin}, "pipe that ends": {"stdin": subprocess.PIPE}}
    process, address = start(**how[stdin])
    assert process.stdout.readline().startswith("listening")
    if process.stdin:
        process.stdin.write("user_stop on\n")
        process.stdin.close()
    # Its end would come within this time, after its first look at stdin.
    time.sleep(0.3)
    connect(address).close()
    assert process.poll() is None
    process.send_signal(number)
    assert process.wait(SOON) == 0
    if process.stdin:
        assert any(line.startswith("done") for line in process.stdout)


def test_it_goes_on_when_nobody_reads_its_events(start):
    process, address = start(stdin=subprocess.DEVNULL)
    assert process.stdout.readline().startswith("listening")
    process.stdout.close()
    for _ in range(3):
        # Not a word of the FCI; each refused one would be an event.
        connect(address).close()
    process.send_signal(signal.SIGTERM)
    assert process.wait(SOON) == 0


def test_a_server_that_dies_ends_the_process_with_a_message_and_frees_its_port(start):
    process, address = start(stdin=subprocess.PIPE)
    assert process.stdout.readline().startswith("listening")
    process.stdin.write("crash\n")
    assert process.wait(SOON) == 1
    assert "the server's thread has ended: Handle::crash asked for this panic" in process.stderr.read()
    again, _ = start(address=address, stdin=subprocess.DEVNULL)
    assert again.stdout.readline().startswith("listening")
    connect(address).close()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--pace", "rubber"], "unknown argument --pace rubber"),
        (["--pace"], "--pace: expected a value"),
        (["--patience", "-1"], "patience -1: expected seconds"),
        (["model_library=/nowhere.so"], "model_library /nowhere.so: No such file"),
        (["lab"], "lab: expected --NAME VALUE"),
    ],
)
def test_wrong_arguments_are_named(arguments, told, start):
    process, _ = start(*arguments, stdin=subprocess.DEVNULL)
    assert process.wait(SOON) == 1
    assert told in process.stderr.read()


@pytest.mark.parametrize("arguments", [["--pace", "elastic"], ["--pace=elastic"], ["pace=elastic"]])
def test_arguments_may_be_written_in_three_ways(arguments, start):
    process, _ = start(*arguments, stdin=subprocess.DEVNULL)
    assert process.stdout.readline().startswith("listening")


def test_a_push_that_is_no_number_is_refused():
    server = Server()
    try:
        for numbers in ("nan 0 0 0 0 0", "0 inf 0 0 0 0"):
            with pytest.raises(AssertionError, match="expected finite numbers"):
                server.instruct(f"push {numbers}")
    finally:
        server.close()
