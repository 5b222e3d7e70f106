"""The best plan of a task: a command, the start of a training, and a row beside the policies of trainings and evaluations."""

import pytest

from support.program import ROOT

MODEL = ROOT / "launch_configs/models/soft_bar_place.yaml"
# The demo's first bar.
TOLD = ("--theta", "length_m=0.26", "--theta", "youngs_modulus_pa=9670")
ASKED = ("--model", MODEL, *TOLD)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("plan")


@pytest.fixture(scope="module")
def plan(program, folder):
    """Scores of the best plan for a bar that is told, whose policy is in `plan.safetensors`."""
    return program.json("plan", *ASKED, "--out", "plan.safetensors", folder=folder)["plan"]


@pytest.fixture(scope="module")
def training(plan, program, folder):
    """Report of a training that begins with the plan."""
    begun = ("--plan", "plan.safetensors", "--out", "pi.safetensors", "--report", "page.html")
    return program.json("train", *ASKED, *begun, folder=folder)


def test_a_plan_reaches_what_physics_allows(plan):
    assert plan["success_rate"]["value"] >= 0.97, plan
    assert plan["left_workspace"] == 0.0 and len(plan["returns"]) == 100


def test_a_training_is_scored_beside_the_plan_it_began_with(plan, training, folder):
    scored = training["scored"]
    assert scored["policy"]["success_rate"]["value"] >= 0.97, scored["policy"]["success_rate"]
    # The same episodes in both commands.
    assert scored["best_plan"]["returns"] == plan["returns"]
    rate = 100 * scored["best_plan"]["success_rate"]["value"]
    assert f"plan.safetensors: {rate:.0f}" in (folder / "page.html").read_text()


def test_a_training_ends_when_its_return_is_flat_and_goes_on_when_asked(training, program, folder):
    # It begins where the return is nearly as high as it can be.
    assert training["flat_at"] < 30_000 and training["steps"] <= 2 * training["flat_at"] < 122_880, training["steps"]
    assert (folder / training["state"]).exists()
    more = program.json("train", *ASKED, "--plan", "plan.safetensors", "--out", "pi.safetensors", "--resume", folder=folder)
    assert more["steps"] > training["steps"] and more["curve"][: len(training["curve"])] == training["curve"]
    assert more["scored"]["policy"]["success_rate"]["value"] >= 0.97


def test_an_evaluation_has_a_row_of_the_best_plan(plan, program, folder):
    evaluation = ("evaluate", *ASKED, "--policy", "plan.safetensors", "--fidelity", "fast", "--episodes", 30)
    report = program.json(*evaluation, folder=folder)
    # The file has the same plan: with the same seed the search finds it again.
    assert report["best_plan"]["returns"] == report["policies"][0]["returns"]
    words = program.text(*evaluation, folder=folder)
    assert "best plan found: return " in words and "plan.safetensors: no difference from the best plan was found" in words, words


def test_no_plan_is_searched_for_a_task_of_many_steps(program, folder):
    many = folder / "many.yaml"
    many.write_text(MODEL.read_text().replace("  steps: 6\n", "  steps: 400\n"))
    done = program("plan", "--model", many, folder=folder)
    assert done.returncode == 2 and "`steps`: expected at most 32" in done.stderr, done.stderr
    done = program("train", "--model", many, "--steps", 1, "--out", "short.safetensors", folder=folder)
    assert done.returncode == 0 and "no best plan: the task has 400 steps" in done.stderr, done.stderr


def test_a_policy_that_acts_by_more_than_a_plan_is_no_start(training, program, folder):
    done = program("train", *ASKED, "--plan", "pi.safetensors", "--out", "other.safetensors", folder=folder)
    assert done.returncode == 2 and "--plan pi.safetensors" in done.stderr and "the policy of a plan" in done.stderr, done.stderr
