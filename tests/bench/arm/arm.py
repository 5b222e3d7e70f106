"""What the effect finder makes of an emulated arm that differs from the model's simple one.

    source .venv/ros.env; .venv/bin/python tests/bench/arm/arm.py --policy demo/policies/pi0.safetensors --out DIR [--cases NAMES]

Each case drives the emulated arm over FCI through three episodes of a policy, records them, and asks `find-effects` what the model lacks.
The model moves the hand by the policy's actions (drive: actions), so that the arm's own dynamics count. Prints the verdict of each case.
"""

import argparse
import json
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))

import yaml  # noqa: E402

from support import findings  # noqa: E402
from support.program import PROGRAM, ROOT  # noqa: E402
from support.session import given, session_in  # noqa: E402

MODEL = ROOT / "launch_configs/models/soft_bar_place.yaml"
# Length (m) and Young's modulus (Pa) of the bar.
THETA = [0.25, 1.0e4]
# Stiffness whose standing error under stiction is 8 to 15 mm, and its damping at about the same ratio as the default.
SOFT = ["fci.stiffness:=[150.0, 150.0, 150.0, 30.0, 30.0, 30.0]", "fci.damping:=[25.0, 25.0, 25.0, 4.0, 4.0, 4.0]"]
# Parameters of the bridge, and of the emulated arm.
# 2000 N/m times 0.03 m: 60 N and 0.67 m/s, which thresholds and speed limit have to allow.
THRESHOLDS = [
    "fci.collision_wrench:=[90.0, 90.0, 90.0, 30.0, 30.0, 30.0]",
    "fci.collision_torque:=[70.0, 70.0, 70.0, 70.0, 24.0, 24.0, 18.0]",
]
FAST = ["fci.error_clip_m:=0.03", "gate.max_jump_m:=0.3", "follow_speed_m_s:=1.0", *THRESHOLDS]
CASES = {
    "default gains": (FAST, []),
    "soft gains with stiction": (
        [*SOFT, "fci.error_clip_m:=0.1", "gate.max_jump_m:=0.3"],
        ["stiction_n_m:=[0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]"],
    ),
    "unknown load of 0.5 kg": ([*SOFT, "fci.error_clip_m:=0.1", "gate.max_jump_m:=0.3"], ["load.mass_kg:=0.5"]),
    "error clip of 3 mm": (["fci.error_clip_m:=0.003", "gate.max_jump_m:=0.3"], []),
}
ROLES = ("--bag", "--validate", "--verify")


def model_with_actions(folder):
    """Model file whose hand is moved by the actions of the policy."""
    text = yaml.safe_load(MODEL.read_text())
    text["observation"]["drive"] = "actions"
    path = folder / "model.yaml"
    path.write_text(yaml.safe_dump(text, sort_keys=False))
    return path


def record(folder, policy, model, bridge, emulator):
    """Records three episodes, each in a bag of its own."""
    folder.mkdir(parents=True)
    with session_in(folder.resolve()) as session:
        address = f"127.45.{session.domain}.1"
        session.node("panda_emulator", *given(f"address:={address}", *emulator))
        common = ["transport:=fci", f"fci.host:={address}", "is_real:=false", f"model_file:={model}", "start_tolerance_m:=0.1"]
        session.node("panda_bridge", *given(*common, *bridge))
        session.node("simulated_cell", *given(f"model_file:={model}", f"theta:={THETA}", "hand:=elsewhere", "fidelity:=reference"))
        parameters = session.root / "launch_configs/params/emulated.yaml"
        for node in ("camera", "keypoint_tracker"):
            session.node(node, "--params-file", parameters)
        session.node("policy_runner", "--params-file", parameters, *given(f"model_file:={model}", "still_patience_s:=300.0"))
        session.meet("panda_emulator", "panda_bridge", "simulated_cell", "camera", "keypoint_tracker", "policy_runner").close()
        bags = []
        for number in range(3):
            bag = folder.resolve() / f"bag_{number}"
            recorder = session.node("recorder", "-p", f"output:={bag}", log=f"recorder_{number}")
            session.wait_for(bag.exists, 20, "the bag")
            done = session.run("deploy", "--policy", policy.resolve(), "--run-all-steps")
            assert done.returncode == 0, done.stderr
            session.stop(recorder)
            bags.append(bag)
        return bags


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", type=pathlib.Path, required=True, help="policy file, trained for soft_bar_place.yaml")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--null-sets", type=int, default=99)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    model = model_with_actions(arguments.out.resolve())
    for case in arguments.cases.split(","):
        folder = arguments.out / case.replace(" ", "_").replace(",", "")
        bags = record(folder, arguments.policy, model, *CASES[case])
        with session_in(folder.resolve()) as session:
            roles = [word for pair in zip(ROLES, bags, strict=True) for word in pair]
            found = folder.resolve() / "found"
            done = session.run(
                "find-effects", "--model", model, *roles, "--out", found, "--null-sets", arguments.null_sets, "--json", seconds=1200
            )
        (folder / "find-effects.err").write_text(done.stderr)
        if not (found / "verdict.json").exists():
            sys.exit(f"{case}: the search failed: {done.stderr.splitlines()[-1:]}")
        print(findings.text(findings.row_of(json.loads((found / "verdict.json").read_text())), case), flush=True)


if __name__ == "__main__":
    assert PROGRAM.exists()
    main()
