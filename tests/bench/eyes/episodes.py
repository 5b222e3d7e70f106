"""How well each pair of segmenter and tracker sees simulated episodes in laboratories of random looks, and what that does to inference.

    .venv/bin/python tests/bench/eyes/episodes.py [--looks 6] [--infer] [--pair colour+geometric ...] [--transporter-fractions A B C D]

Each of the four shipped bars swings in `--looks` laboratories: textures, lamp, shadows, clutter, exposure and white balance by seed. The
colours are those of a click on the first picture. A frame fails if the object is not found, or if a keypoint is more than 5 % of the length
off; it fails silently with scores of 0.5 and more. With --infer, `catenary infer` finds length and stiffness from the keypoints of each
first look; `exact` are keypoints without pictures. Transporter puts its keypoints where it likes: give the fractions of the length that
`catenary train-tracker` printed, and inference compares them there.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy
import yaml
from rosbags.highlevel import AnyReader

ROOT = pathlib.Path(__file__).resolve().parents[3]
PROGRAM = os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary")
MODELS = ROOT / "launch_configs/models"
BARS = ("dlo_0", "dlo_1", "dlo_2", "dlo_3")
PAIRS = ("colour+geometric", "learned+geometric", "learned+ordered", "learned+transporter")


def actions(seed):
    """Steps of the hand along x and z in m, which keep it near its start."""
    rng, place, rows = numpy.random.default_rng(seed), numpy.zeros(2), ["dx_m,dz_m"]
    for _ in range(16):
        aim = rng.uniform([-0.06, -0.06], [0.1, 0.02])
        step = numpy.clip(aim - place, -0.06, 0.06)
        place = place + step
        rows.append(f"{step[0]:.4f},{step[1]:.4f}")
    return "\n".join(rows) + "\n"


def catenary(*arguments):
    done = subprocess.run([PROGRAM, *map(str, arguments), "--json"], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"catenary {' '.join(map(str, arguments))}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout)


def clicks(bag):
    """Pixels of the bar and of the target in the first picture, where a user would click, as U,V of pictures of 640 x 480."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic.endswith("keypoints")]
        connection, _, raw = next(reader.messages(connections=connections))
        seen = reader.deserialize(raw, connection.msgtype)
    # The mask of 256 x 256 is the square in the middle.
    image = [(80 + 480 / 256 * u, 480 / 256 * v) for u, v in ((seen.dlo_u[1], seen.dlo_v[1]), (seen.target_u, seen.target_v))]
    return [f"{int(u)},{int(v)}" for u, v in image]


def parameters(folder, common, pair):
    """Parameter file of a pair, with the colours of a click on the first picture; None if nothing is fitted there."""
    segmenter, tracker = pair.split("+")
    still, bag, out = folder / "still.csv", folder / "still", folder / "fit"
    still.write_text("dx_m,dz_m\n0,0\n")
    catenary("simulate", *common, "--actions", still, "--out", bag, "--images")
    words = [PROGRAM, "mask", "--bag", bag, "--frames", "1", "--segmenter", segmenter, "--tracker", tracker]
    bar, target = clicks(bag)
    done = subprocess.run([*words, "--click", bar, "--click-target", target, "--out", out], capture_output=True, text=True, check=False)
    # A look that is doubted, code 3, is a result.
    if done.returncode not in (0, 3):
        print(f"{pair}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
        return None
    return out / "params.yaml"


def seen(folder, bar, look, pair, model):
    """Sight of a pair in a laboratory, and the bag of its keypoints."""
    motion = folder / "motion.csv"
    motion.write_text(actions(look))
    common = ["--model", model, "--noise", "--seed", look]
    bag = folder / f"{bar}_{look}_{pair}"
    if pair == "exact":
        catenary("simulate", *common, "--actions", motion, "--out", bag)
        return None, bag
    common += ["--laboratory", look]
    file = parameters(folder, common, pair)
    if file is None:
        return {"failures": 1.0, "silent": 0.0, "median_error_lengths": numpy.nan, "ms": [numpy.nan] * 2}, None
    episode = catenary("simulate", *common, "--actions", motion, "--out", bag, "--eyes", file)["episodes"][0]
    sight = episode["sight"]
    # A pair that never found the object has no error.
    return sight | {"median_error_lengths": sight["median_error_lengths"] or numpy.nan}, bag


def inferred(folder, bag, model, truth):
    """Relative errors of the medians of length and stiffness, and whether the 90 % intervals hold the truth; None if it is refused."""
    out = folder / f"posterior_{bag.name}"
    words = [PROGRAM, "infer", bag, "--model", model, "--out", out, "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        print(done.stderr.strip().splitlines()[-1], file=sys.stderr)
        return None
    answer = json.loads(done.stdout)
    rows = {p["name"]: p for p in answer["marginals"]}
    found = []
    for name, true in truth.items():
        row = rows[name]
        found.append([row["median"] / true - 1.0, row["q05"] <= true <= row["q95"]])
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--looks", type=int, default=6)
    parser.add_argument("--pair", nargs="+", default=PAIRS)
    parser.add_argument("--infer", action="store_true")
    parser.add_argument("--transporter-fractions", type=float, nargs=4, default=[0.125, 0.375, 0.625, 0.875])
    arguments = parser.parse_args()
    pairs = [*(["exact"] if arguments.infer else []), *arguments.pair]
    sights, posteriors = {pair: [] for pair in pairs}, {pair: [] for pair in pairs}
    for bar in BARS:
        text = (MODELS / f"{bar}.yaml").read_text()
        truth = yaml.safe_load(text)["nominal"]
        for look in range(1, arguments.looks + 1):
            for pair in pairs:
                print(f"{bar}, laboratory {look}, {pair}", file=sys.stderr)
                with tempfile.TemporaryDirectory() as name:
                    folder = pathlib.Path(name)
                    fractions = "[0.125, 0.375, 0.625, 0.875]"
                    if pair.endswith("+transporter"):
                        fractions = str(sorted(arguments.transporter_fractions))
                    models = []
                    for source in (bar, "soft_bar"):
                        models.append(folder / f"{source}.yaml")
                        own = (MODELS / f"{source}.yaml").read_text()
                        assert "keypoint_fractions: [0.125, 0.375, 0.625, 0.875]" in own
                        models[-1].write_text(own.replace("[0.125, 0.375, 0.625, 0.875]", fractions))
                    sight, bag = seen(folder, bar, look, pair, models[0])
                    if sight:
                        sights[pair].append(sight)
                    if arguments.infer and look == 1 and bag is not None:
                        found = inferred(folder, bag, models[1], truth)
                        posteriors[pair] += [] if found is None else [found]
    print("| segmenter and tracker | failures | silent | median error, lengths | ms to segment | ms to track |\n|---|---|---|---|---|---|")
    for pair, rows in sights.items():
        if rows:
            mean = {key: numpy.nanmean([row[key] for row in rows]) for key in ("failures", "silent", "median_error_lengths")}
            ms = numpy.nanmean([row["ms"] for row in rows], axis=0)
            print(
                f"| {pair} | {mean['failures']:.3f} | {mean['silent']:.3f} | {mean['median_error_lengths']:.4f}"
                f" | {ms[0]:.1f} | {ms[1]:.2f} |"
            )
    if not arguments.infer:
        return
    print("\n| keypoints by | error of the length, % | error of the stiffness, % | truths in 90 % intervals | bars not seen |")
    print("|---|---|---|---|---|")
    for pair, rows in posteriors.items():
        if rows:
            values = numpy.array(rows, float)
            length, stiffness = 100 * numpy.abs(values[:, :, 0]).mean(axis=0)
            held = f"{int(values[:, :, 1].sum())} of {values[:, :, 1].size}"
            print(f"| {pair} | {length:.1f} | {stiffness:.0f} | {held} | {len(BARS) - len(rows)} |")


if __name__ == "__main__":
    main()
