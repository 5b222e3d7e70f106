"""The checks of the Franka Control Interface, each with every client that can express it. `tests/conformance_fci/table` prints the
results as a table."""

import pytest
from rig import CHECKS, CLIENTS, MODEL_LIBRARY, SERVER, Server, cells, run, why_missing


@pytest.fixture
def serve():
    """Starts servers that end with the test."""
    assert SERVER.exists(), f"{SERVER} is missing: cargo build --release -p panda_emulator --example serve"
    servers = []

    def start(*arguments, **pace):
        servers.append(Server(*arguments, **pace))
        return servers[-1]

    yield start
    for server in servers:
        server.close()


# Checks of what the server does about a silent client, within its usual patience.
SILENT = ("check_13",)

# Checks of a motion's whole life, with the pace for clients that look at a clock. Lost commands are told by instruction, so that the
# pace waits for none of them.
ELASTIC = ("check_04", "check_05_limited", "check_06", "check_08", "check_11", "check_13")


@pytest.mark.parametrize(("number", "client", "function"), [pytest.param(*c, id=f"{c[2]}-{c[1]}") for c in cells()])
def test_fci(number, client, function, serve, record_property):
    if reason := why_missing(client):
        pytest.skip(reason)
    arguments = [f"generation={CLIENTS[client][2]}"]
    if "lab" in function:
        arguments += ["network=lab", "seed=3"]
    if "library" in function:
        assert MODEL_LIBRARY.exists(), f"{MODEL_LIBRARY} is missing: cargo build --release -p panda_model_library"
        arguments.append(f"model_library={MODEL_LIBRARY}")
    row = run(client, function, serve(*arguments, is_patient=function not in SILENT))
    record_property("row", row)
    print(f"check {number:2} {CHECKS[number]:<22} {client}: {row}")


@pytest.mark.parametrize(("client", "function"), [pytest.param(c, f, id=f"{f}-{c}") for _, c, f in cells() if f in ELASTIC])
def test_fci_in_the_elastic_pace(client, function, serve):
    if reason := why_missing(client):
        pytest.skip(reason)
    row = run(client, function, serve(f"generation={CLIENTS[client][2]}", pace="elastic", is_patient=function not in SILENT))
    print(f"elastic pace, {client}: {row}")
