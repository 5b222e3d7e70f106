"""Effects that `catenary find-effects` names for a measured cable, from a model without tip mass, damping and rest curvature.

    source .venv/ros.env; .venv/bin/python tests/bench/repair/cable.py --data DIR --out DIR [--length-m 0.4] [--diameter-m 0.02]
        [--mass-kg 0.42] [--null-sets 199] [--json]

1. The two motions of the bare cable are searched, each with the other held out. The model is launch_configs/models/measured_cable.yaml
   without rest curvature, without damping (in bending, between strands, in the air) and without the mass of the markers.
2. The motions with a mass at the tip are searched with the model that the repair of the bare swing gave, each with the other held out.
3. The same searches run with the bending stiffness of that model free again: mass and stiffness trade off, which the search has to say.

--data names the folder of measured tracks; the defaults of the cable's length, diameter and mass are those of the shipped model. A motion
that the folder lacks is not searched, and a search without another motion has nothing to verify its result.

--data names the folder of measured tracks. Searches that --out holds with the same model and number of null sets are not made again,
and an interrupted search goes on. The time of each search is printed.
"""

import argparse
import hashlib
import json
import math
import pathlib
import shutil
import sys

import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
sys.path.insert(0, f"{sys.path[0]}/blind")
import draw
import rows

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
    area_m2 = math.pi / 4 * arguments.diameter_m**2
    model["object"]["section"] = {"round": {"diameter_m": arguments.diameter_m}}
    known = {"length_m": arguments.length_m, "density_kg_m3": arguments.mass_kg / (arguments.length_m * area_m2)}
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
    path, bag = arguments.data / f"{motion}_{state}.csv", arguments.out / f"bag_{motion}_{state}"
    if not path.exists():
        return None
    if not bag.exists():
        draw.program("import-track", path, "--model", model, "--out", bag)
    return bag


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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, required=True, help="folder of the cable's measured tracks")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--length-m", type=float, default=0.400)
    parser.add_argument("--diameter-m", type=float, default=0.020)
    parser.add_argument("--mass-kg", type=float, default=0.42)
    parser.add_argument("--null-sets", type=int, default=199)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    straight, repaired, free = (arguments.out / f"{name}.yaml" for name in ("straight", "repaired", "free"))
    straight_model(straight, arguments)
    if not any((arguments.data / f"{motion}_bare.csv").exists() for motion, _ in MOTIONS):
        sys.exit(f"{arguments.data}: expected measured tracks there, swing_bare.csv and its like")
    for model, state in ((straight, "bare"), (repaired, "tip_mass"), (free, "tip_mass")):
        for motion, other in MOTIONS:
            found = search(arguments, model, state, motion, other)
            if found is None:
                continue
            labels = {"model": model.stem, "motion": motion, "state": state}
            row = labels | findings.row_of(json.loads((found / "verdict.json").read_text()))
            print(json.dumps(row) if arguments.json else findings.text(row, ", ".join(labels.values())), flush=True)
            if (model, motion) == (straight, SWING):
                if row["verdict"] not in rows.NAMED:
                    sys.exit(f"{found}: the verdict is {row['verdict']}, so there is no repaired model to search with")
                shutil.copy(found / "model.yaml", repaired)
                loosened(free, repaired)


if __name__ == "__main__":
    main()
