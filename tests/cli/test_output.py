"""Output of the program without mistakes: help with a line for each command, and JSON alone on stdout with --json."""

import json
import os
import re

import pytest

from support.program import BAG, MODEL, ROOT

COMMANDS = {
    "demo", "launch", "status", "node", "infer", "train", "evaluate", "deploy", "record", "replay", "import-track", "simulate",
    "report", "bench", "doctor",
}  # fmt: skip
TRACK = "t_s,grip_x_m,grip_z_m,grip_pitch_rad,p1_x_m,p1_z_m,p2_x_m,p2_z_m,p3_x_m,p3_z_m,p4_x_m,p4_z_m\n"


@pytest.fixture
def run(program, tmp_path):
    """Runs the program in the test's folder, which has to succeed; returns its stdout."""
    return lambda *arguments: program.text(*arguments, folder=tmp_path)


def test_help_lists_every_command_with_a_line(run):
    text = run("--help")
    rows = text.split("Commands:\n")[1].split("\n\n")[0].splitlines()
    found = {row.split()[0]: row.split(maxsplit=1)[1] for row in rows}
    assert COMMANDS | {"help"} <= set(found)
    for name, words in found.items():
        assert len(words) > 10 and words[0].isupper(), name
        assert name == "help" or "Usage: catenary" in run(name, "--help")


def pages(run, *command):
    """Help pages of a command and of all its subcommands, each with the command's words."""
    text = run(*command, "--help")
    yield command, text
    if "Commands:\n" in text:
        for row in text.split("Commands:\n")[1].split("\n\n")[0].splitlines():
            if row.startswith("  ") and row[2] not in " " and row.split()[0] != "help":
                yield from pages(run, *command, row.split()[0])


def test_help_fits_80_columns_and_says_what_exit_codes_mean(run):
    found = dict(pages(run))
    assert len(found) >= len(COMMANDS) + 8
    for command, text in found.items():
        # A usage line has no place to be broken at.
        long = [line for line in text.splitlines() if len(line) > 80 and not line.startswith("Usage:")]
        assert not long, (command, long)
    codes = found[()].split("Exit codes")[1]
    assert all(f"\n  {code:<4} " in codes for code in (0, 1, 2, 3, 130))


def test_the_version_names_the_commit(run):
    version = run("--version").strip()
    assert re.fullmatch(r"catenary \d+\.\d+\.\d+( \([0-9a-f]{10}(-dirty)?\))?", version), version
    if (ROOT / ".git").exists() and "CATENARY_PROGRAM" not in os.environ:
        assert "(" in version, version


def test_a_shipped_model_is_found_by_its_name(run, tmp_path):
    (tmp_path / "soft_bar").write_text(MODEL.read_text().replace("name: soft_bar", "name: another_bar"))
    (tmp_path / "actions.csv").write_text("dx_m,dz_m\n0.01,0.0\n")
    wanted = ("simulate", "--actions", "actions.csv", "--fidelity", "fine_mesh", "--json", "--model")
    name = lambda model: json.loads(run(*wanted, model))["episodes"][0]["model"]
    assert name("dlo_1") == "dlo_1"
    assert name("soft_bar") == "another_bar", "a path comes before the name of a shipped model"


def test_every_node_is_listed_with_a_line(run):
    rows = run("node").splitlines()
    assert {"simulated_cell", "camera", "keypoint_tracker", "policy_runner"} <= {row.split()[0] for row in rows}
    assert all(len(row.split()) > 1 for row in rows)


def test_a_node_lists_its_parameters(run):
    text = run("node", "policy_runner", "--help")
    assert "max_age_s = 0.15" in text and "Usage: policy_runner" in text


def test_an_inference_is_json(run, tmp_path):
    arguments = ("--bag", BAG, "--model", MODEL, "--out", "out", "--preset", "networks", "--iterations", 1, "--simulations", 40, "--json")
    report = json.loads(run("infer", *arguments))
    assert [m["name"] for m in report["marginals"]] == ["length_m", "youngs_modulus_pa"]
    for marginal, (low, high) in zip(report["marginals"], ((0.195, 0.305), (1e3, 5e4))):
        assert low <= marginal["q05"] <= marginal["median"] <= marginal["q95"] <= high
    assert json.loads((tmp_path / "out/posterior.json").read_text()) == report["posterior"]
    assert 0 < report["simulation_s"] < report["wall_s"]
    *_, words, page = run("infer", *arguments[:-1]).splitlines()
    assert page == "report: out/report.html" and (tmp_path / "out/report.html").exists()
    assert re.fullmatch(r"40 simulations; [\d.]+ s: simulation [\d.]+ s, training and the rest [\d.]+ s", words), words


def test_an_inference_tells_its_refinement(run, tmp_path):
    arguments = ("--bag", BAG, "--model", MODEL, "--out", "out", "--iterations", 1, "--simulations", 40)
    words = run("infer", *arguments)
    report = json.loads((tmp_path / "out/inference.json").read_text())
    found = report["refinement"]
    assert [(value["name"], value["episode"]) for value in found["best_fit"]][:3] == [
        ("length_m", None),
        ("youngs_modulus_pa", None),
        ("kelvin_voigt_time_s", 1),
    ]
    (line,) = (line for line in words.splitlines() if line.startswith("refined with the simulator: "))
    off = [f"the best fit is {found['best_fit_rmse_mm']:.1f} mm off", f"the networks' posterior is {found['networks_rmse_mm']:.1f} mm off"]
    assert all(part in line for part in off), line
    # The swing of the sample is a rigid pendulum's, which no soft bar makes.
    assert found["best_fit_rmse_mm"] < found["networks_rmse_mm"] and found["noise_inflation"] > 1
    assert any("times the noise that the model file states" in warning for warning in report["warnings"])
    assert f"{40 + found['simulations']} simulations; " in words
    assert "The posterior was refined with the simulator itself" in (tmp_path / "out/report.html").read_text()


def test_networks_of_sets_do_not_see_the_order_of_keypoints(run):
    sizes = ("--tracks", 300, "--truths", 50)
    report = json.loads(run("bench", "networks", *sizes, "--json"))
    # The text is one row of scores for each corruption, whatever the sizes.
    assert run("bench", "networks", "--tracks", 100, "--truths", 10).count("shuffled") > 4
    score = lambda network, corruption: next(s["log_density"] for s in network["scores"] if s["corruption"] == corruption)
    sets, (in_order, shuffled) = report["networks"][:2], report["networks"][2:]
    loss = lambda network, corruption: score(network, "none") - score(network, corruption)
    for network in sets:
        assert score(network, "shuffled") == pytest.approx(score(network, "none"), abs=1e-6)
        # Rare corruption costs less than frequent corruption, and less than it costs a network of lists.
        for kind, steps in (("dropped", (0.05, 0.4)), ("duplicated", (0.05, 0.4)), ("noise_px", (1.0, 8.0))):
            little, much = (loss(network, {kind: step}) for step in steps)
            assert 0 < little < much, (network["name"], kind)
            assert little < loss(in_order, {kind: steps[0]}), (network["name"], kind)
    assert loss(in_order, "shuffled") > 5
    assert score(shuffled, "shuffled") < score(sets[0], "shuffled") - 1


def test_a_training_is_json_and_the_same_seed_gives_the_same_policy(run, tmp_path):
    reports = []
    for name in ("a", "b"):
        arguments = ("--model", MODEL, "--out", name, "--steps", 512, "--seed", 5, "--no-plan", "--json", "--report", f"{name}.html")
        reports.append(json.loads(run("train", *arguments)))
    assert reports[0]["steps"] >= 512 and reports[0]["interrupted"] is False and reports[0]["curve"] == reports[1]["curve"]
    last = reports[0]["curve"][-1]
    assert last["value_loss"] > 0 and last["entropy"] < reports[0]["curve"][0]["entropy"] + 0.1
    returns, share = reports[0]["mean_return"], reports[0]["success_rate"]
    assert returns["low"] < returns["value"] < returns["high"] and returns["value"] == pytest.approx(last["mean_return"])
    assert share["low"] <= share["value"] <= share["high"] and share["value"] == pytest.approx(last["success_rate"])
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    page = (tmp_path / "a.html").read_text()
    assert page.count("<figure") == 4 and f"return {returns['value']:.2f}" in page and "NaN" not in page


def test_an_evaluation_compares_policies_with_the_first_on_the_same_episodes(run, tmp_path):
    for name, steps in (("a", 512), ("b", 2048)):
        run("train", "--model", MODEL, "--out", name, "--steps", steps, "--no-plan")
    wanted = ("--policy", "a", "--policy", "a", "--policy", "b", "--episodes", 30, "--fidelity", "fast")
    evaluate = lambda *more: json.loads(run("evaluate", "--model", MODEL, *wanted, "--no-plan", "--json", *more))["policies"]
    first, again, other = evaluate()
    assert len(first["returns"]) == 30 and first["mean_return_gained"] is None
    assert again["returns"] == first["returns"] and again["mean_return_gained"] == {"value": 0.0, "low": 0.0, "high": 0.0}
    pairs = zip(other["returns"], first["returns"])
    assert other["mean_return_gained"]["value"] == pytest.approx(sum(own - base for own, base in pairs) / 30)
    assert other["mean_return"]["low"] < other["mean_return"]["value"] < other["mean_return"]["high"]
    assert 0 <= other["success_rate"]["low"] <= other["success_rate"]["value"] <= 1
    # A mass at the tip lowers the reward of every policy; a longer bar changes the returns.
    heavy, long = evaluate("--effect", "tip_mass_kg=0.2")[2], evaluate("--theta", "length_m=0.3")[2]
    assert heavy["mean_best_reward"]["value"] < other["mean_best_reward"]["value"] and long["returns"] != other["returns"]
    assert run("evaluate", "--model", MODEL, *wanted, "--no-plan", "--report", "page.html").count("more than the first") == 2
    page = (tmp_path / "page.html").read_text()
    assert page.count("<figure") == 4 and f"return {first['mean_return']['value']:.2f}" in page and "NaN" not in page


def test_an_import_is_json(run, tmp_path):
    rows = [[0.05 * i, 0.4, 0.42, 0.0, *(c for p in range(4) for c in (0.4, 0.4 - 0.05 * p))] for i in range(40)]
    (tmp_path / "track.csv").write_text(TRACK + "".join(",".join(f"{v:.4f}" for v in row) + "\n" for row in rows))
    report = json.loads(run("import-track", "track.csv", "--model", MODEL, "--out", "bag", "--json"))
    assert report["messages"] > 80 and report["duration_s"] == pytest.approx(39 * 0.05, abs=0.01)


def test_a_launch_files_contents_are_json(run):
    arguments = ("--show", "--json", "seed:=7", "cell_theta:=[0.25, 1000.0]")
    report = json.loads(run("launch", ROOT / "launch_configs/sim.launch.xml", *arguments))
    commands = {process["name"]: process["command"] for process in report["processes"]}
    assert "keypoint_tracker" in commands and "seed:=7" in commands["simulated_cell"]
    assert "theta:=[0.25, 1000.0]" in commands["simulated_cell"]
    assert "seed" in [argument["name"] for argument in report["arguments"]]


def test_a_check_up_is_json(run):
    report = json.loads(run("doctor", "--model", MODEL, "--json"))
    assert {"cores", "domain", "loopback", "model"} <= {check["name"] for check in report}
    assert {check["verdict"] for check in report} <= {"good", "warning"}


def test_a_replay_is_json(run):
    report = json.loads(run("replay", BAG, "--rate", 20, "--json"))
    assert report["published"] == 535 and report["failed"] == 0
    assert [line.split(":")[0] for line in report["left_out"]] == ["/panda/target_pose"]
