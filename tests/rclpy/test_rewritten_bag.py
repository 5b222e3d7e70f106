"""A bag that rosbags wrote gives the posterior of the bag that it was written from."""

import json
import pathlib
import subprocess

from rosbags.rosbag2 import Reader, StoragePlugin, Writer

ROOT = pathlib.Path(__file__).resolve().parents[2]
BAG, MODEL = ROOT / "bags/swing", ROOT / "launch_configs/models/soft_bar.yaml"
SIZES = ["--iterations", "3", "--simulations", "40", "--seed", "7"]


def posterior(bag, out):
    command = [ROOT / "target/release/catenary", "infer", "--bag", bag, "--model", MODEL, "--out", out, "--json", *SIZES]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["posterior"]


def rewrite(bag, out):
    with Reader(bag) as reader, Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            c.id: writer.add_connection(
                c.topic,
                c.msgtype,
                msgdef=c.msgdef.data,
                rihs01=c.digest,
                offered_qos_profiles=c.ext.offered_qos_profiles,
            )
            for c in reader.connections
        }
        for connection, time, data in reader.messages():
            writer.write(connections[connection.id], time, data)


def test_a_bag_written_by_rosbags_gives_the_same_posterior(tmp_path):
    rewrite(BAG, tmp_path / "rewritten")
    assert (tmp_path / "rewritten/metadata.yaml").read_text() != (BAG / "metadata.yaml").read_text()
    original = posterior(BAG, tmp_path / "original")
    assert len(original["mixture"]["weights"]) >= 4
    assert posterior(tmp_path / "rewritten", tmp_path / "again") == original
