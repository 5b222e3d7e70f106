"""Each value of a file that a command reads is removed, or replaced by one of another kind, sign or size: the command refuses the file
by its name, with the exit code of a wrong input, or takes a value that makes sense. It never panics, and never fails later without
the name.
"""

import concurrent.futures
import json
import pathlib
import re
import tempfile

import pytest
import yaml

from support.damage import damaged, long_lists, of_safetensors, safetensors
from support.program import BAG, MODEL, MODELS, ROOT

USAGE = 2
ACTIONS = MODELS / "gallery.csv"
FAST = ("--fidelity", "fast", "--json")
TRACK = ("t_s", "grip_x_m", "grip_z_m", "grip_pitch_rad", *(f"p{k}_{axis}_m" for k in range(1, 5) for axis in "xz"))


@pytest.fixture(scope="module")
def originals(program, tmp_path_factory):
    """Folder with a policy that corrects a plan, and a posterior whose support moved."""
    folder = tmp_path_factory.mktemp("originals")
    program.text("train", "--model", MODEL, "--task", "place_tip", "--out", "policy", "--steps", 768, folder=folder)
    sizes = ("--preset", "networks", "--iterations", 2, "--simulations", 150, "--prior-support", "adaptive")
    done = program("infer", BAG, "--model", MODEL, "--out", "out", *sizes, folder=folder)
    assert done.returncode in (0, 3), done.stderr
    return folder


@pytest.fixture
def outcomes(program, tmp_path):
    """Runs a command on each damaged copy, as the file `damaged`; returns those that it accepted, as pairs of path and damage."""

    def run(copies, *arguments):
        def one(copy):
            path, damage, text = copy
            folder = pathlib.Path(tempfile.mkdtemp(dir=tmp_path))
            (folder / "damaged").write_bytes(text if isinstance(text, bytes) else text.encode())
            done = program(*arguments, folder=folder)
            what = f"{path}, {damage}: exit code {done.returncode}, {done.stderr}"
            assert done.returncode in (0, USAGE) and "panicked" not in done.stderr, what
            if done.returncode == USAGE:
                (line,) = done.stderr.splitlines()
                assert line.startswith("catenary: ") and "damaged" in line and len(line) < 2000, what
            else:
                # A quoted word is a name.
                assert not re.search(r'(?<!")\b(NaN|Infinity)\b', done.stdout), what
            return (path, damage) if done.returncode == 0 else None

        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            found = list(pool.map(one, copies))
        assert len(found) > 20
        return [kept for kept in found if kept]

    return run


def test_a_damaged_posterior_is_refused_by_its_name(originals, outcomes):
    tree = json.loads((originals / "out/posterior.json").read_text())
    mixture = tree["mixture"]
    # Two components show what more would.
    tree["mixture"] = {name: mixture[name][:2] for name in ("weights", "means", "covariances")}
    copies = [(path, what, json.dumps(copy)) for path, what, copy in [*damaged(tree), *long_lists(tree)]]
    text = json.dumps(tree)
    low = '"low": 1000.0'
    assert low in text
    copies += [(("log_uniform",), value, text.replace(low, f'"low": {value}')) for value in ("0", "-1", "1e-320", "1e999", "NaN")]
    one, three = (
        {"weights": [1], "means": [[0.5] * d], "covariances": [[[float(i == k) for i in range(d)] for k in range(d)]]} for d in (1, 3)
    )
    far = {"weights": [1], "means": [[50, 50]], "covariances": [[[1, 0], [0, 1]]]}
    copies += [(("mixture",), "another size", json.dumps(tree | {"mixture": other})) for other in (one, three, far)]
    copies += [((), "cut", text[:200]), ((), "empty", "")]
    accepted = outcomes(copies, "train", "--model", MODEL, "--posterior", "damaged", "--out", "p", "--steps", 1, "--no-plan", "--json")
    # Another mixture is one that may have been found, the number and the reason of a move are not used, and a move may be absent.
    harmless = lambda path: (
        path[0] == "mixture" or (path[:1] == ("support_moves",) and (len(path) < 3 or path[2] in ("iteration", "because")))
    )
    bounds = lambda path: path[0] == "support_moves" and path[2:3] in (("from",), ("to",))
    assert [kept for kept in accepted if not (harmless(kept[0]) or bounds(kept[0]))] == []


def test_a_damaged_policy_is_refused_by_its_name(originals, outcomes):
    whole = (originals / "policy").read_bytes()
    header, data = safetensors(whole)
    assert any(name.startswith("plan") for name in header)
    copies = [(path, what, of_safetensors(copy, data)) for path, what, copy in damaged(header)]
    for name in header.keys() - {"__metadata__"}:
        first = header[name]["data_offsets"][0]
        for what, number in [("NaN", b"\0\0\xc0\x7f"), ("infinity", b"\0\0\x80\x7f"), ("1e38", b"\x99\x76\x96\x7e")]:
            copies.append(((name,), what, of_safetensors(header, data[:first] + number + data[first + 4 :])))
    fields = {"step_period_s": ["1e300", "0", "nan"], "steps": ["0", "-1", "99999999999999"], "name": ["x" * 1000, "a\nb"]}
    fields["goal"] = ['{"place_tip":{"reward_range_m":-1}}', '{"place_tip":{"reward_range_m":1e300}}', '"x"']
    for field, values in fields.items():
        for value in values:
            copy = header | {"__metadata__": header["__metadata__"] | {field: value}}
            copies.append((("__metadata__", field), value[:20], of_safetensors(copy, data)))
    copies += [((), "cut", whole[:1000]), ((), "empty", b"")]
    asked = ("--model", MODEL, "--task", "place_tip", "--no-plan", "--episodes", 30, *FAST)
    accepted = outcomes(copies, "evaluate", "--policy", "damaged", *asked)
    # Any word is a name, and earlier files have no goal and no law of the arm.
    allowed = {(("__metadata__", "name"), "word"), (("__metadata__", "name"), "not a number")}
    allowed |= {(("__metadata__", field), "removed") for field in ("goal", "arm")}
    # The tensors follow one another: the first begins at 0.
    assert [kept for kept in accepted if kept not in allowed and kept[0][1:] != ("data_offsets", 0)] == []


def test_a_damaged_model_and_task_are_refused_by_their_names(outcomes):
    tree = yaml.safe_load(MODEL.read_text())
    copies = [(path, what, yaml.safe_dump(copy, sort_keys=False)) for path, what, copy in damaged(tree)]
    copies += [(path, what, json.dumps(copy)) for path, what, copy in long_lists(tree)]
    accepted = outcomes(copies, "simulate", "--model", "damaged", "--actions", ACTIONS, *FAST)
    # Values that another laboratory may have: none of them is huge, or of another kind.
    assert [kept for kept in accepted if kept[0] != ("name",) and kept[1] in ("huge", "word", "not a number", "object", "many")] == []
    tree = yaml.safe_load((ROOT / "launch_configs/tasks/settle.yaml").read_text())
    copies = [(path, what, yaml.safe_dump(copy, sort_keys=False)) for path, what, copy in damaged(tree)]
    accepted = outcomes(copies, "train", "--model", MODEL, "--task", "damaged", "--out", "p", "--steps", 1, "--no-plan", "--json")
    assert [kept for kept in accepted if kept[1] in ("huge", "word", "not a number", "object", "many")] == []


def cells(text):
    """Damaged copies of a table: each cell of its header, its first and its last row."""
    rows = [row.split(",") for row in text.split()]
    for line in (0, 1, len(rows) - 1):
        for column in range(len(rows[line])):
            for value in ("", "nan", "inf", "-1e9", "1e300", "x", None):
                row = [cell if at != column else value for at, cell in enumerate(rows[line])]
                copy = [*rows[:line], [cell for cell in row if cell is not None], *rows[line + 1 :]]
                yield (line, column), value, "\n".join(map(",".join, copy)) + "\n"
    yield (), "empty", ""
    yield (), "zeros", "\0" * 100


def test_a_damaged_table_is_refused_by_its_name(outcomes):
    text = ACTIONS.read_text()
    many = "\n".join([text.split()[0], *["0,0"] * 200_000])
    assert outcomes([*cells(text), ((), "many", many)], "simulate", "--model", MODEL, "--actions", "damaged", *FAST) == []
    rows = [[0.05 * i, 0.4 + 0.02 * (i % 7) / 7, 0.42, 0.0, 0.4, 0.4, 0.4, 0.35, 0.4, 0.3, 0.4, 0.25] for i in range(40)]
    text = "\n".join([",".join(TRACK), *(",".join(f"{v:.4f}" for v in row) for row in rows)])
    assert outcomes(cells(text), "import-track", "damaged", "--model", MODEL, "--out", "bag", "--json") == []
