"""Draws worlds, most with a hidden effect, and seals the answers.

    source .venv/ros.env; .venv/bin/python tests/blind/draw.py --out DIR [--nulls 100] [--each 20] [--effects NAMES]
        [--sizes 0.5,1,3] [--pairs 20] [--unlisted 5] [--structured 40] [--seed 1]

Each effect is hidden in --each objects with motions, at every size, and measured anew at each size. A world of the kind "structured" has
a residual that no effect of the library is: an unlisted effect, alone (--unlisted of each) or beside one or two effects (--structured).

A world is a folder of DIR/worlds. It holds the bags of three episodes, with topics alone, and the model with which a lab would begin:
bag_0 to be fitted, bag_1 to choose between models, bag_2 to verify the choice.
Worlds are simulated at the finer `reference` fidelity. If the model follows the measured path of the hand, another arm moves it.
DIR/sealed holds the answers; DIR/seals.txt, written before any search, holds their SHA-256. DIR/left_out.jsonl lists the worlds that
could not be drawn, with the reason. Worlds that DIR holds already are not drawn again.
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
# Prior of Young's modulus in the model file, and range of the drawn objects, Pa: silicone, and a stiff rubber whose pull shows a
# compliant grip.
OBJECTS = [(PRIOR, 2e3, 4e4), ("low: 5.0e+4, high: 5.0e+6", 1e5, 2e6)]
OBJECT_NAMES = ["soft", "stiff"]
# Two effects that hide each other, beside pairs drawn at random. Camera scale and length hide each other, too, in every world: the
# search does not know the length.
HARD_PAIR = ("arm_lag_s", "grip_compliance_rad_n_m")
# Effects that act at random, which no fit can find, and one that a search tries only where its model file expects it.
NEVER = {"dropped_frames", "keypoint_noise_px", "rest_bend_rad"}
# Unlisted effects of the simulator.
UNLISTED = [
    "middle_mass_kg",
    "soft_joint",
    "gust_n_m",
    "tremor_rad",
    "curvature_wave_per_m",
    "kink_rad",
    "sleeve",
    "dahl_friction_n_m",
    "clump_kg",
    "varying_wind_n_m",
    "periodic_push_n_m",
    "start_pull_n_m",
    "loosening_grip_rad",
    "undershoot",
    "camera_bump",
]
# Companions that set where and how fast unlisted effects act, and their drawn values: away from the ends of the object, and between a
# slow swing and two frames.
PLACE, FREQUENCY = "unlisted_place", "unlisted_frequency_hz"
COMPANIONS = {
    PLACE: lambda rng: rng.uniform(0.15, 0.85),
    FREQUENCY: lambda rng: log_uniform(rng, 0.3, 2.0),
    "strand_slip_turn_rad": lambda rng: log_uniform(rng, 0.03, 1.0),
    "strand_slip_spread": lambda rng: log_uniform(rng, 1.0, 30.0),
    "tip_load_offset_m": lambda rng: rng.uniform(0.0, 0.06),
    "tip_load_gyration_radius_m": lambda rng: log_uniform(rng, 0.005, 0.03),
}
# Unlisted effects that act on the arm alone.
OF_THE_ARM = {"undershoot"}
# Places of the unlisted effects that have one of their own.
MIDDLE = {"middle_mass_kg": 0.5, "soft_joint": 0.5}
# Size of all effects in a structured world, in detectable sizes.
STRUCTURED_SIZE = 3.0
EPISODES = 3
# Objects and motions of each kind that are tried until the effects are detectable.
ATTEMPTS = 8
# Failed settings after which an effect that was never detectable is given up.
IN_VAIN = 3
# Random streams of an object with its motions, and of a world's measurement.
SETTING, MEASURED = 1, 2
STEPS = 16
# Bounds of the hand's targets, start, and largest step. In the lower part a hanging bar of 0.3 m touches the table.
LOW_M, HIGH_M, START_M, MOST_M = numpy.array([0.30, 0.20]), numpy.array([0.58, 0.48]), numpy.array([0.40, 0.42]), 0.06


def program(*arguments, accepts=(0,)):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode not in accepts:
        raise RuntimeError(f"catenary {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def actions(rng):
    """Random deltas, each held for one to four steps: the object swings, comes to rest, and sometimes lies on the table."""
    at, rows = START_M, []
    while len(rows) < STEPS:
        delta = rng.uniform(-MOST_M, MOST_M, 2)
        for _ in range(min(rng.integers(1, 5), STEPS - len(rows))):
            to = numpy.clip(at + delta, LOW_M, HIGH_M)
            rows.append(to - at)
            at = to
    return rows


def log_uniform(rng, low, high):
    return numpy.exp(rng.uniform(numpy.log(low), numpy.log(high)))


def write_actions(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("dx_m", "dz_m"), *(map(repr, map(float, row)) for row in rows)])


def plan(arguments, effects):
    """Hidden effects of each world: a list of (kind, size, names, stream). Worlds of one stream share object and motions."""
    offered = [e["name"] for e in effects if e["name"] not in NEVER]
    if arguments.effects:
        offered = [name for name in offered if name in arguments.effects.split(",")]
    rng = numpy.random.default_rng(arguments.seed)
    every = list(itertools.combinations(offered, 2))
    drawn = [HARD_PAIR if i < arguments.pairs // 2 else every[rng.integers(len(every))] for i in range(arguments.pairs)]
    settings = [("none", [0.0], [])] * arguments.nulls
    settings += [("effect", sizes(arguments), [name]) for name in offered for _ in range(arguments.each)]
    settings += [("pair", [3.0], list(pair)) for pair in drawn]
    settings += [("structured", [STRUCTURED_SIZE], [name]) for name in UNLISTED for _ in range(arguments.unlisted)]
    for number in range(arguments.structured):
        # Each unlisted effect stands beside one effect, then beside two.
        beside = rng.choice(offered, size=1 + number // len(UNLISTED) % 2, replace=False)
        settings.append(("structured", [STRUCTURED_SIZE], [*map(str, beside), UNLISTED[number % len(UNLISTED)]]))
    kinds = [(kind, size, names, stream) for stream, (kind, some, names) in enumerate(settings) for size in some]
    return [kinds[i] for i in rng.permutation(len(kinds))]


def sizes(arguments):
    return [float(s) for s in arguments.sizes.split(",")]


def is_of_the_arm(names, effects):
    return not OF_THE_ARM.isdisjoint(names) or any(e["name"] in names and e["hook"] == "actuation" for e in effects)


def drawn_setting(rng, names, effects, kind, folder):
    """Object of the kind with motions, the signed detectable size of each effect, the values of the companions, and the largest multiple
    of the sizes within all priors; none if an effect is not detectable."""
    acts = is_of_the_arm(names, effects) or rng.uniform() < 0.25
    model = folder / "model.yaml"
    model.write_text(model_of(kind, acts))
    _, softest, stiffest = OBJECTS[kind]
    theta = {"length_m": rng.uniform(0.2, 0.3), "youngs_modulus_pa": float(numpy.exp(rng.uniform(numpy.log(softest), numpy.log(stiffest))))}
    motions = [actions(rng) for _ in range(EPISODES)]
    unit, reach, hooks, companions = {}, [], {}, {}
    if names:
        write_actions(folder / "actions.csv", motions[0])
        # All companions are drawn, so that a stream of random numbers does not depend on the effect.
        drawn = {name: float(draw_one(rng)) for name, draw_one in COMPANIONS.items()}
        values = [a for item in (theta | drawn).items() for a in ("--value", "{}={}".format(*item))]
        asked = [a for name in names for a in ("--name", name)]
        sized = json.loads(program("effects", "--model", model, "--actions", folder / "actions.csv", *asked, *values, "--json"))
        for name in names:
            about = next(e for e in sized if e["name"] == name)
            shows, hooks[name] = about.get("detectable"), about["hook"]
            companions |= {companion: drawn[companion] for companion in about.get("companions", [])}
            ((_, bounds),) = about["prior"].items()
            (low, high), most = about["range"], bounds["high"]
            # An effect detectable below this size folds the object another way by chance.
            least = max(bounds["low"], 1e-3 * most)
            sign = rng.choice([-1.0, 1.0]) if about["sign"] == "signed" else 1.0
            if shows is None or shows < least:
                return None
            unit[name] = float(sign * shows)
            reach.append(min(most, high if sign > 0 else -low) / shows)
    setting = {"object": kind, "acts": bool(acts), "theta": theta, "motions": motions, "unit": unit, "hooks": hooks}
    return setting | {"companions": companions, "reach": min(reach, default=0.0)}


def model_of(kind, acts):
    """Text of the model with which a lab would begin."""
    text = changed(MODEL.read_text(), PRIOR, OBJECTS[kind][0])
    return changed(text, GRIP, ACTIONS) if acts else text


def changed(model, part, other):
    if part not in model:
        sys.exit(f"{MODEL}: expected {part!r} in it, for {other!r} in its place")
    return model.replace(part, other)


def setting_of(stream, greatest, names, effects, arguments, folder):
    """First object and motions that allow the effects at `greatest` detectable sizes, otherwise those that allow the largest multiple;
    none if they are never detectable. Without effects the kinds of objects take turns."""
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
    """Writes the bags and the model; returns the hidden effects, unlisted ones included."""
    rng = numpy.random.default_rng([arguments.seed, MEASURED, number])
    model = model_of(setting["object"], setting["acts"])
    (folder / "model.yaml").write_text(model)
    world = folder / "world.yaml"
    world.write_text(model if setting["acts"] else changed(model, LAG, IMPEDANCE))
    hidden = {name: size * value for name, value in setting["unit"].items()}
    given = [a for item in setting["theta"].items() for a in ("--theta", "{}={}".format(*item))]
    given += [a for item in (hidden | setting["companions"]).items() for a in ("--effect", "{}={}".format(*item))]
    for episode, rows in enumerate(setting["motions"]):
        write_actions(folder / "actions.csv", rows)
        seed = int(rng.integers(2**31))
        files = ("--model", world, "--actions", folder / "actions.csv", "--out", folder / f"bag_{episode}")
        program("simulate", *files, *given, "--noise", "--seed", seed, "--fidelity", "reference")
    for left in ("world.yaml", "actions.csv"):
        (folder / left).unlink()
    return hidden


def draw(number, kind, size, names, setting, arguments):
    """Draws the world, and writes its answer."""
    folder, sealed = arguments.out / "worlds" / f"{number:05}", arguments.out / "sealed" / f"{number:05}.json"
    half = folder.with_suffix(".half")
    shutil.rmtree(half, ignore_errors=True)
    half.mkdir(parents=True)
    try:
        hidden = measured_world(number, size, setting, arguments, half)
    except RuntimeError:
        shutil.rmtree(half)
        raise
    listed = {name: value for name, value in hidden.items() if name not in UNLISTED}
    answer = {"seed": arguments.seed, "number": number, "kind": kind, "size": size, "hidden": listed, "theta": setting["theta"]}
    answer |= {"unlisted": unlisted_of(hidden, setting), "object": OBJECT_NAMES[setting["object"]]}
    answer |= {"drive": "actions" if setting["acts"] else "grip", "salt": secrets.token_hex(16)}
    shutil.rmtree(folder, ignore_errors=True)
    half.rename(folder)
    sealed.parent.mkdir(parents=True, exist_ok=True)
    sealed.write_text(json.dumps(answer, indent=1))


def unlisted_of(hidden, setting):
    """Unlisted effect of a world, with the part of the simulator, the place and the frequency that it has; none without one."""
    for name in hidden:
        if name in UNLISTED:
            told = setting["companions"]
            place, frequency_hz = told.get(PLACE, MIDDLE.get(name)), told.get(FREQUENCY)
            return {"name": name, "magnitude": hidden[name], "hook": setting["hooks"][name], "place": place, "frequency_hz": frequency_hz}
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--nulls", type=int, default=100, help="worlds without an effect")
    parser.add_argument("--each", type=int, default=20, help="worlds of each effect and size")
    parser.add_argument("--effects", default="", help="names of effects, separated by commas; empty: all")
    parser.add_argument("--sizes", default="0.5,1,3", help="in detectable sizes")
    parser.add_argument("--pairs", type=int, default=20, help="worlds with two effects")
    parser.add_argument("--unlisted", type=int, default=5, help="worlds of each effect that is no candidate, alone")
    parser.add_argument("--structured", type=int, default=40, help="worlds of an effect that is no candidate beside others")
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
                    tried = ATTEMPTS * len(OBJECTS)
                    raise RuntimeError(f"not detectable in {tried} objects and motions, or in {IN_VAIN} times as many before")
                if size > settings[stream]["reach"]:
                    raise RuntimeError("larger than the prior allows, in all objects and motions that were tried")
                draw(number, kind, size, names, settings[stream], arguments)
            except RuntimeError as refused:
                row = {"seed": arguments.seed, "number": number, "kind": "left_out", "size": size}
                left_out.append(row | {"hidden": sorted(names), "why": str(refused)})
                print(f"left out: {left_out[-1]}", file=sys.stderr)
                continue
        seals[number] = hashlib.sha256(sealed.read_bytes()).hexdigest()
    (arguments.out / "left_out.jsonl").write_text("".join(json.dumps(one) + "\n" for one in left_out))
    (arguments.out / "seals.txt").write_text("".join(f"{seal}  {number:05}.json\n" for number, seal in seals.items()))


if __name__ == "__main__":
    main()
