"""Gain of a repaired model: policies trained on it and on the unrepaired one, evaluated on a cell with the hidden effect.

    source .venv/ros.env; .venv/bin/python tests/bench/repair/policies.py --out DIR [--hide tip_mass_kg=0.05 ...] [--task NAME]
        [--seeds 5] [--json]

For each hidden effect, three episodes are measured in a cell at `reference` fidelity. `catenary find-effects` searches two of them and
holds out the third. All policies are trained over posteriors of `catenary infer` that use the three episodes: the posterior of the
unrepaired model is inferred from all of them; the repaired model's priors come from two, and its posterior from the third. `catenary
evaluate` runs all policies on the same episodes of the cell. --task takes another task than the model's for training and evaluation; the
episodes are measured in the model's own. An effect without a repair
has no gain, and neither has one whose posterior cannot be inferred. Results that DIR holds are not computed again.
"""

import argparse
import json
import pathlib
import shutil
import sys

import numpy
from scipy.stats import t

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "blind"))
import draw

HIDDEN = ["tip_mass_kg=0.05", "arm_standing_error_m=0.02", "camera_offset_z_m=0.03"]
OBJECT = ["length_m=0.25", "youngs_modulus_pa=8000"]
EPISODES = 3


def once(path, work):
    """Has `work` make the file or folder at `path` unless it exists; it gets this name when it is complete."""
    if not path.exists():
        half = path.with_name("half_" + path.name)
        shutil.rmtree(half, ignore_errors=True)
        work(half)
        half.rename(path)
    return path


def measured(folder, model, hidden):
    """Bags of episodes of the cell with a hidden effect."""

    def episode(number):
        rows, table = draw.actions(numpy.random.default_rng(number)), folder / "actions.csv"
        draw.write_actions(table, rows)
        truth = [a for value in OBJECT for a in ("--theta", value)] + ["--effect", hidden]
        asked = ("--model", model, "--actions", table, *truth, "--noise", "--seed", number, "--fidelity", "reference")
        return once(folder / f"bag_{number}", lambda half: draw.program("simulate", *asked, "--out", half))

    return [episode(number) for number in range(EPISODES)]


def interval(values):
    """Mean over seeds with its 95 % interval by Student's t."""
    mean, n = float(numpy.mean(values)), len(values)
    half = float(t.ppf(0.975, n - 1) * numpy.std(values, ddof=1)) / n**0.5
    return {"mean": mean, "low": mean - half, "high": mean + half}


def study(folder, hidden, seeds, episodes, steps, task):
    """Row of one hidden effect: search, inference, training and evaluation."""
    folder.mkdir(parents=True, exist_ok=True)
    model = folder / "model.yaml"
    model.write_text(draw.MODEL.read_text().replace(draw.GRIP, draw.ACTIONS))
    bags = measured(folder, model, hidden)
    asked = ("--bag", bags[0], "--bag", bags[1], "--verify", bags[2])
    found = once(folder / "found", lambda half: draw.program("find-effects", "--model", model, *asked, "--out", half))
    verdict = json.loads((found / "verdict.json").read_text())
    row = {"hidden": hidden, "verdict": verdict["verdict"], "found": verdict["found"]}
    if not verdict["found"]:
        return row
    posteriors, over = {}, {}
    for side, known, own in (("unrepaired", model, bags), ("repaired", found / "model.yaml", bags[2:])):
        given = [a for bag in own for a in ("--bag", bag)]
        infer = lambda half, known=known, given=given: draw.program("infer", "--model", known, *given, "--out", half)
        try:
            posteriors[side] = once(folder / f"inferred_{side}", infer)
        except RuntimeError as error:
            if "posterior at the measured track is unusable" not in str(error):
                raise
            return {**row, "failed": f"no posterior of the {side} model: {error}"}
        over[side] = ("--model", known, "--posterior", posteriors[side] / "posterior.json")
    aim = ("--task", task) if task else ()
    wanted = ("--steps", steps) if steps else ()
    train = lambda side, seed: once(
        folder / f"{side}_{task or 'own'}_{steps or 'preset'}_{seed}.safetensors",
        lambda half: draw.program("train", *over[side], *aim, *wanted, "--seed", seed, "--out", half),
    )
    policies = [(side, train(side, seed)) for side in over for seed in range(1, seeds + 1)]
    given = [a for _, path in policies for a in ("--policy", path)]
    given += [a for value in OBJECT for a in ("--theta", value)] + ["--effect", hidden, *aim]
    fared = json.loads(draw.program("evaluate", "--model", model, *given, "--episodes", episodes, "--json"))["policies"]
    read = lambda folder: json.loads((folder / "inference.json").read_text())["marginals"]
    row["marginals"] = {side: read(posterior) for side, posterior in posteriors.items()}
    values = lambda side, key: numpy.array([e[key]["value"] for (s, _), e in zip(policies, fared) if s == side])
    for key in ("mean_return", "success_rate"):
        row[key] = {side: interval(values(side, key)) for side in over}
        row[key]["gained"] = interval(values("repaired", key) - values("unrepaired", key))
    return row


def text(rows):
    show = lambda e, scale, digits: f"{scale * e['mean']:.{digits}f} ({scale * e['low']:.{digits}f} to {scale * e['high']:.{digits}f})"
    lines = []
    for row in rows:
        named = ", ".join(" or ".join(alike) for alike in row["found"]) or "nothing"
        lines.append(f"{row['hidden']}: {row['verdict']}, {named}")
        if "failed" in row:
            lines.append(f"  {row['failed']}")
        if "marginals" not in row:
            continue
        for key, scale, digits in (("mean_return", 1, 2), ("success_rate", 100, 0)):
            parts = (f"{side} {show(row[key][side], scale, digits)}" for side in ("unrepaired", "repaired", "gained"))
            lines.append(f"  {key.replace('_', ' ')}{' in %' if scale == 100 else ''}: " + ", ".join(parts))
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--hide", action="append", help="an effect's value, as NAME=VALUE; none: " + " ".join(HIDDEN))
    parser.add_argument("--seeds", type=int, default=5, choices=range(2, 11), metavar="2..10", help="trainings of each side")
    parser.add_argument("--episodes", type=int, default=100, help="of each policy")
    parser.add_argument("--steps", type=int, help="of each training; none: the preset's")
    parser.add_argument("--task", help="file or name; none: the model's")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = []
    for hidden in arguments.hide or HIDDEN:
        print(hidden, file=sys.stderr)
        rows.append(study(arguments.out / hidden, hidden, arguments.seeds, arguments.episodes, arguments.steps, arguments.task))
    print(json.dumps(rows) if arguments.json else text(rows))


if __name__ == "__main__":
    main()
