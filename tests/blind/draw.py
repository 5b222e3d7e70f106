"""Draws worlds with a hidden effect, or without, and seals what was drawn.

    source .venv/ros.env; .venv/bin/python tests/blind/draw.py --out DIR [--nulls 100] [--each 20] [--effects NAMES] [--sizes 0.5,1,3] [--pairs 20] [--unlisted 20] [--seed 1]

The worlds of an effect are those of --each objects and motions, each with the effect at every size, measured anew.

Each world is a folder of DIR/worlds with the bags of some episodes, which hold topics and nothing else, and the model that a lab
would begin with. They are simulated at the finer `reference` fidelity, by another arm than the model's where the model follows the
measured path of the hand. What was drawn lies in DIR/sealed; DIR/seals.txt, written before any search, holds the SHA-256 of each.
DIR/left_out.jsonl says which worlds could not be drawn, and why. What is in DIR already is not drawn again.
"""

import argparse
import collections
import csv
import hashlib
import itertools
import json
import os
import pathlib
import secrets
import shutil
import subprocess
import sys
import tempfile

import numpy
from alone import alone

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary")
MODEL = ROOT / "launch_configs/models/soft_bar.yaml"
LAG = "law: {lag: {time_constant_s: 0.16, max_speed_m_s: 0.5}}"
IMPEDANCE = "law: {impedance: {}}"
GRIP, ACTIONS = "drive: grip ", "drive: actions "
PRIOR = "low: 1.0e+3, high: 5.0e+4"
# The model's prior of Young's modulus, and from what to what objects are drawn, Pa: silicone as the model has it, and a stiff rubber,
# which pulls at the grip enough to show what gives way there.
OBJECTS = [(PRIOR, 2e3, 4e4), ("low: 5.0e+4, high: 5.0e+6", 1e5, 2e6)]
# Two effects at once that are known to hide each other, beside pairs drawn at random. Camera scale and length are another such pair:
# every world has a length that the search does not know.
HARD_PAIR = ("arm_lag_s", "grip_compliance_rad_n_m")
# No fit can find what acts at random.
NEVER = {"dropped_frames", "keypoint_noise_px"}
UNLISTED = ["middle_mass_kg", "soft_joint", "gust_n_m", "tremor_rad"]
EPISODES = 2
# Bars and motions of each kind of object, among which some are looked for in which the effects show.
ATTEMPTS = 8
# Settings of one effect that are looked for in vain before no more are, where it showed in none.
IN_VAIN = 3
# Random streams: of an object and its motions, and of what a world is measured with.
SETTING, MEASURED = 1, 2
STEPS = 16
# The hand starts at (0.40, 0.42) m, and its targets stay in here: hanging bars of 0.3 m touch the table in the lower part.
LOW_M, HIGH_M, START_M, MOST_M = numpy.array([0.30, 0.20]), numpy.array([0.58, 0.48]), numpy.array([0.40, 0.42]), 0.06


def program(*arguments):
    done = subprocess.run([PROGRAM, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(f"catenary {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def actions(rng):
    """Deltas that are held for one to four steps, so that the object swings, comes to rest, and lies on the table at times."""
    at, rows = START_M, []
    while len(rows) < STEPS:
        delta = rng.uniform(-MOST_M, MOST_M, 2)
        for _ in range(min(rng.integers(1, 5), STEPS - len(rows))):
            to = numpy.clip(at + delta, LOW_M, HIGH_M)
            rows.append(to - at)
            at = to
    return rows


def write_actions(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("dx_m", "dz_m"), *(map(repr, map(float, row)) for row in rows)])


def plan(arguments, effects):
    """What each world hides: a list of (kind, size, names, stream). Worlds of one stream have object and motions in common."""
    offered = [e["name"] for e in effects if e["name"] not in NEVER]
    if arguments.effects:
        offered = [name for name in offered if name in arguments.effects.split(",")]
    rng = numpy.random.default_rng(arguments.seed)
    every = list(itertools.combinations(offered, 2))
    drawn = [HARD_PAIR if i < arguments.pairs // 2 else every[rng.integers(len(every))] for i in range(arguments.pairs)]
    settings = [("none", [0.0], [])] * arguments.nulls
    settings += [("effect", sizes(arguments), [name]) for name in offered for _ in range(arguments.each)]
    settings += [("pair", [3.0], list(pair)) for pair in drawn]
    settings += [("unlisted", [3.0], [name]) for name in UNLISTED for _ in range(arguments.unlisted)]
    kinds = [(kind, size, names, stream) for stream, (kind, some, names) in enumerate(settings) for size in some]
    return [kinds[i] for i in rng.permutation(len(kinds))]


def sizes(arguments):
    return [float(s) for s in arguments.sizes.split(",")]


def is_of_the_arm(names, effects):
    return any(e["name"] in names and e["hook"] == "actuation" for e in effects)


def drawn_setting(rng, names, effects, kind, folder):
    """An object of the kind and motions, with the sizes from which the effects show, signed, and how many times as large all of them may be by
    their priors; none where one does not show."""
    acts = is_of_the_arm(names, effects) or rng.uniform() < 0.25
    model = folder / "model.yaml"
    model.write_text(model_of(kind, acts))
    _, softest, stiffest = OBJECTS[kind]
    theta = {"length_m": rng.uniform(0.2, 0.3), "youngs_modulus_pa": float(numpy.exp(rng.uniform(numpy.log(softest), numpy.log(stiffest))))}
    motions = [actions(rng) for _ in range(EPISODES)]
    unit, reach = {}, []
    if names:
        write_actions(folder / "actions.csv", motions[0])
        values = [a for item in theta.items() for a in ("--value", "{}={}".format(*item))]
        asked = [a for name in names for a in ("--name", name)]
        sized = json.loads(program("effects", "--model", model, "--actions", folder / "actions.csv", *asked, *values, "--json"))
        for name in names:
            about = next(e for e in sized if e["name"] == name)
            shows = about.get("detectable")
            ((_, bounds),) = about["prior"].items()
            (low, high), most = about["range"], bounds["high"]
            # Where next to nothing shows, the object folds this way or that by chance.
            least = max(bounds["low"], 1e-3 * most)
            sign = rng.choice([-1.0, 1.0]) if about["sign"] == "signed" else 1.0
            if shows is None or shows < least:
                return None
            unit[name] = float(sign * shows)
            reach.append(min(most, high if sign > 0 else -low) / shows)
    return {"object": kind, "acts": bool(acts), "theta": theta, "motions": motions, "unit": unit, "reach": min(reach, default=0.0)}


def model_of(kind, acts):
    """The text of the model that a lab would begin with."""
    text = changed(MODEL.read_text(), PRIOR, OBJECTS[kind][0])
    return changed(text, GRIP, ACTIONS) if acts else text


def changed(model, part, other):
    if part not in model:
        sys.exit(f"{MODEL}: expected {part!r} in it, for {other!r} in its place")
    return model.replace(part, other)


def setting_of(stream, greatest, names, effects, arguments, folder):
    """The first object and motions in which the effects can be `greatest` times as large as they must be to show, or where none is
    such, those in which they can be largest; none where they never show. Without effects the kinds of objects take turns."""
    best, first = None, 0 if names else stream
    for attempt in range(ATTEMPTS * len(OBJECTS)):
        rng = numpy.random.default_rng([arguments.seed, SETTING, stream, attempt])
        try:
            setting = drawn_setting(rng, names, effects, (first + attempt) % len(OBJECTS), folder)
        except RuntimeError as refused:
            print(f"{names}: {refused}", file=sys.stderr)
            continue
        if setting and (best is None or setting["reach"] > best["reach"]):
            best = setting
        if best and best["reach"] >= greatest:
            break
    return best


def measured_world(number, size, setting, arguments, folder):
    """Writes the bags and the model; returns what is hidden in them."""
    rng = numpy.random.default_rng([arguments.seed, MEASURED, number])
    model = model_of(setting["object"], setting["acts"])
    (folder / "model.yaml").write_text(model)
    world = folder / "world.yaml"
    world.write_text(model if setting["acts"] else changed(model, LAG, IMPEDANCE))
    hidden = {name: size * value for name, value in setting["unit"].items()}
    given = [a for item in setting["theta"].items() for a in ("--theta", "{}={}".format(*item))]
    given += [a for item in hidden.items() for a in ("--effect", "{}={}".format(*item))]
    for episode, rows in enumerate(setting["motions"]):
        write_actions(folder / "actions.csv", rows)
        seed = int(rng.integers(2**31))
        program("simulate", "--model", world, "--actions", folder / "actions.csv", *given, "--noise", "--seed", seed, "--fidelity", "reference", "--out", folder / f"bag_{episode}")
    for left in ("world.yaml", "actions.csv"):
        (folder / left).unlink()
    return hidden


def draw(number, kind, size, names, setting, arguments):
    """Draws the world, and seals what it hides."""
    folder, sealed = arguments.out / "worlds" / f"{number:05}", arguments.out / "sealed" / f"{number:05}.json"
    half = folder.with_suffix(".half")
    shutil.rmtree(half, ignore_errors=True)
    half.mkdir(parents=True)
    try:
        hidden = measured_world(number, size, setting, arguments, half)
    except RuntimeError:
        shutil.rmtree(half)
        raise
    answer = {"seed": arguments.seed, "number": number, "kind": kind, "size": size, "hidden": hidden, "theta": setting["theta"]}
    answer |= {"drive": "actions" if setting["acts"] else "grip", "salt": secrets.token_hex(16)}
    shutil.rmtree(folder, ignore_errors=True)
    half.rename(folder)
    sealed.parent.mkdir(parents=True, exist_ok=True)
    sealed.write_text(json.dumps(answer, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--nulls", type=int, default=100, help="worlds without an effect")
    parser.add_argument("--each", type=int, default=20, help="worlds of each effect and size")
    parser.add_argument("--effects", default="", help="names of effects, separated by commas; none: all")
    parser.add_argument("--sizes", default="0.5,1,3", help="in detectable sizes")
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--unlisted", type=int, default=20, help="worlds of each effect that no search offers")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    arguments.lock = alone(arguments.out)
    effects = json.loads(program("effects", "--json"))
    worlds = plan(arguments, effects)
    seals, settings, left_out, in_vain, shown = {}, {}, [], collections.Counter(), set()
    for number, (kind, size, names, stream) in enumerate(worlds):
        print(f"world {number + 1} of {len(worlds)}", file=sys.stderr)
        sealed = arguments.out / "sealed" / f"{number:05}.json"
        if not sealed.exists():
            if stream not in settings:
                greatest, key = max(sizes(arguments)) if kind == "effect" else size, tuple(names)
                with tempfile.TemporaryDirectory() as folder:
                    is_tried = key in shown or in_vain[key] < IN_VAIN
                    settings[stream] = setting_of(stream, greatest, names, effects, arguments, pathlib.Path(folder)) if is_tried else None
                if settings[stream]:
                    shown.add(key)
                else:
                    in_vain[key] += 1
            try:
                if settings[stream] is None:
                    raise RuntimeError(f"shows in none of {ATTEMPTS * len(OBJECTS)} objects and motions, or in none of {IN_VAIN} times as many before")
                if size > settings[stream]["reach"]:
                    raise RuntimeError("is more than the prior says, in all objects and motions that were tried")
                draw(number, kind, size, names, settings[stream], arguments)
            except RuntimeError as refused:
                left_out.append({"seed": arguments.seed, "number": number, "kind": "left_out", "size": size, "hidden": sorted(names), "why": str(refused)})
                print(f"left out: {left_out[-1]}", file=sys.stderr)
                continue
        seals[number] = hashlib.sha256(sealed.read_bytes()).hexdigest()
    (arguments.out / "left_out.jsonl").write_text("".join(json.dumps(one) + "\n" for one in left_out))
    (arguments.out / "seals.txt").write_text("".join(f"{seal}  {number:05}.json\n" for number, seal in seals.items()))


if __name__ == "__main__":
    main()
