"""What `catenary infer` and `catenary find-effects` make of all recordings of a measured cable.

    source .venv/ros.env; .venv/bin/python tests/bench/repair/cable.py --data DIR --out DIR [--length-m 0.4] [--diameter-m 0.02]
        [--mass-kg 0.42] [--tip-mass-kg 0.23] [--marker-mass-kg 0.03] [--null-sets 199] [--part all] [--json]

Posteriors (recordings.py has the models). Each recording, bare or with a load at the tip, a free swing or a moving grip, gives
a posterior, which predicts the other recording of the same state. Where the wrench was recorded, a second posterior compares it, too. A
table ends this part.

Searches, from a model without tip mass, damping and rest curvature:

1. The two motions of the bare cable are searched, each with the other held out. The model is launch_configs/models/measured_cable.yaml
   without rest curvature, without damping (in bending, between strands, in the air) and without the mass of the markers.
2. The motions with a mass at the tip are searched with the model that the repair of the bare swing gave, or its nearest effects, each
   with the other held out.
3. The same searches run with the bending stiffness of that model free again: mass and stiffness trade off, which the search has to say.

Each search is compared with the posterior of the same recording, where they have a parameter in common.

--data names the folder of measured tracks; the defaults of the cable's lengths and masses are those of the shipped model's. The tip's mass
is the weighed one, markers included, with which the posterior's is compared. A motion that the folder lacks is told and skipped, and a
search without another motion has nothing to verify its result.

Results that --out holds with the same model, predictions and number of null sets are not made again, and an interrupted run goes on. The
time of each is printed.
"""

import argparse
import hashlib
import json
import pathlib
import shutil
import sys

import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
sys.path.insert(0, f"{sys.path[0]}/blind")
import draw
import rows

import recordings
from support import findings
from support.program import MODELS

MODEL = MODELS / "measured_cable.yaml"
LACKING = {
    *("kelvin_voigt_time_s", "rest_curvature_per_m", "rest_curvature_gradient_per_m2", "linear_drag_n_s_m2"),
    *("sticking_stiffness_n_m2", "slip_moment_n_m", "slip_spread_ratio"),
}
SWING, MOVING = "swing", "moving_grip"
MOTIONS = [(SWING, MOVING), (MOVING, SWING)]
STIFFNESS = "bending_stiffness_n_m2"


def straight_model(path, arguments):
    """Writes the model of a straight elastic rod, with which a lab would begin."""
    model = yaml.safe_load(MODEL.read_text())
    model["name"] = "straight_cable"
    model["object"]["section"] = {"round": {"diameter_m": arguments.diameter_m}}
    known = {"length_m": arguments.length_m, "density_kg_m3": recordings.density_kg_m3(arguments)}
    model["parameters"] |= known
    del model["parameters"]["tip_mass_kg"]
    for part in ("theta", "effects"):
        model[part] = [entry for entry in model[part] if entry["name"] not in LACKING]
    path.write_text(yaml.safe_dump(model, sort_keys=False))


def loosened(path, repaired):
    """Writes the repaired model with the first prior of the stiffness."""
    model, first = (yaml.safe_load(p.read_text()) for p in (repaired, MODEL))
    (free,) = (entry for entry in first["theta"] if entry["name"] == STIFFNESS)
    model["theta"] = [free if entry["name"] == STIFFNESS else entry for entry in model["theta"]]
    path.write_text(yaml.safe_dump(model, sort_keys=False))


def imported(arguments, model, state, motion):
    """Bag of a measured track."""
    return recordings.imported(arguments, model, motion, state) if recordings.track(arguments, motion, state).exists() else None


def search(arguments, model, state, motion, other):
    """Searches one recording with the other motion held out; returns the folder of the result; none without the recording."""
    asked_for = hashlib.sha256(model.read_bytes() + str(arguments.null_sets).encode()).hexdigest()
    found = arguments.out / f"{model.stem}_{motion}_{state}_{asked_for[:8]}"
    if not found.exists():
        print(found.name, file=sys.stderr)
        half = found.with_name("half_" + found.name)
        bags = [imported(arguments, model, state, m) for m in (motion, other)]
        if bags[0] is None:
            return None
        unseen = ("--verify", bags[1]) if bags[1] else ()
        draw.program("find-effects", "--model", model, "--bag", bags[0], *unseen, "--null-sets", arguments.null_sets, "--out", half)
        half.rename(found)
    return found


def posteriors(arguments):
    """Posteriors and predictions of all recordings; returns their rows."""
    found = []
    for row in recordings.rows(arguments):
        found.append(row)
        print(json.dumps({"part": "posterior"} | row) if arguments.json else recordings.text(row), flush=True)
    if found and not arguments.json:
        print("\n" + recordings.table(found) + "\n", flush=True)
    return found


def tell_agreement(arguments, labels, posterior, verdict):
    """Prints where the finder's repaired model and the posterior of the same recording have a parameter in common."""
    common = recordings.agreement(posterior, verdict)
    if arguments.json:
        print(json.dumps({"part": "agreement"} | labels | {"common": common}), flush=True)
        return
    for name, c in common.items():
        own, (value, sd) = c["posterior"], c["finder"]
        apart = f"{c['deviations']:+.1f} standard deviations apart"
        print(f"  {name}: posterior {own[0]:.3g} ({own[1]:.3g} to {own[2]:.3g}), finder {value:.3g} +- {sd:.2g}: {apart}", flush=True)


def searches(arguments, known):
    """Searches of all recordings. `known` are the rows of the posteriors."""
    straight, repaired, free = (arguments.out / f"{name}.yaml" for name in ("straight", "repaired", "free"))
    straight_model(straight, arguments)
    for model, state in ((straight, "bare"), (repaired, "tip_mass"), (free, "tip_mass")):
        for motion, other in MOTIONS:
            found = search(arguments, model, state, motion, other)
            if found is None:
                continue
            labels = {"model": model.stem, "motion": motion, "state": state}
            verdict = json.loads((found / "verdict.json").read_text())
            row = labels | findings.row_of(verdict)
            told = {"part": "search"} | row
            print(json.dumps(told) if arguments.json else findings.text(row, ", ".join(labels.values())), flush=True)
            for posterior in (p for p in known if (p["motion"], p["state"], p["compared"]) == (motion, state, "keypoints")):
                tell_agreement(arguments, labels, posterior, verdict)
            if (model, motion) == (straight, SWING):
                # Where a residual is left, the nearest effects are all that is known.
                added = found / ("nearest.yaml" if row["nearest"] else "model.yaml")
                if row["verdict"] not in rows.NAMED and not row["nearest"]:
                    sys.exit(f"{found}: the verdict is {row['verdict']}, so there is no repaired model to search with")
                shutil.copy(added, repaired)
                loosened(free, repaired)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, required=True, help="folder of the cable's measured tracks")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--length-m", type=float, default=0.400)
    parser.add_argument("--diameter-m", type=float, default=0.020)
    parser.add_argument("--mass-kg", type=float, default=0.42)
    parser.add_argument("--tip-mass-kg", type=float, default=0.23, help="weighed mass at the tip, markers included")
    parser.add_argument("--marker-mass-kg", type=float, default=0.03, help="mass of the markers at the tip of the bare cable")
    parser.add_argument("--null-sets", type=int, default=199)
    parser.add_argument("--part", choices=("all", "posteriors", "searches"), default="all")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if not any(recordings.track(arguments, motion, state).exists() for motion in recordings.MOTIONS for state in recordings.STATES):
        sys.exit(f"{arguments.data}: expected measured tracks there, swing_bare.csv and its like")
    known = posteriors(arguments) if arguments.part != "searches" else []
    if arguments.part != "posteriors":
        searches(arguments, known)


if __name__ == "__main__":
    main()
