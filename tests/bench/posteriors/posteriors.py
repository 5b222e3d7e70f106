"""Posteriors and best fits of `catenary infer` against an independent sampler and an independent optimiser on the same simulator.

    tests/bench/posteriors/run [--data DIR] [--worlds 10] [--bars 4] [--only NAME] [--steps 1200] [--fits] [--json]

A case is a recording with its model: the bare swings of measured cables (--data, a folder that holds the folders of the cables), the
paper's bars in a simulated cell, and worlds: a cable with hysteresis and random parameters that swings as the first measured one did.
For each case

1. `catenary infer` gives the refined posterior and its best fit, and with `--preset networks` the posterior of the networks alone,
2. CMA-ES (pycma), from four starts, gives the least cost; `catenary find-effects`, whose effects are all vetoed, the error of its fit,
3. emcee, whose walkers start at the cheapest of random points and at the end of CMA-ES, gives draws of the posterior,
4. scikit-learn's classifier tells draws of a posterior from those of emcee in the parameters: C2ST, .5 if it cannot.

With --fits the networks, 3 and 4 are left out: best fits alone, in two minutes a case.

The simulator of 2 and 3 is `catenary bench costs`: points in, costs out. Results are kept in .build/posteriors/results, and an
interrupted run goes on from there.
"""

import argparse
import hashlib
import json
import math
import os
import pathlib
import subprocess
import sys

import cma
import emcee
import numpy
import yaml
from sklearn.model_selection import KFold, cross_val_score
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bars"))
import motion

ROOT = pathlib.Path(__file__).resolve().parents[3]
MODELS = ROOT / "launch_configs/models"
PROGRAM = pathlib.Path(os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary"))
# Lengths in m, diameters in m and masses in kg of the measured cables.
CABLES = {"measured_cable": (0.4, 0.020, 0.42), "measured_cable_2": (0.45, 0.015, 0.25)}
DRAWS = 1000
WALKERS = 48
# Evaluations of each run of CMA-ES, and its starts.
EVALUATIONS, STARTS = 1600, 4
# A step of emcee is in two halves, each a batch of the simulator.
MOVES = [(emcee.moves.DEMove(), 0.7), (emcee.moves.DESnookerMove(), 0.1), (emcee.moves.StretchMove(), 0.2)]


def program(*arguments):
    """Runs the program, which has to succeed, with a result that fits or not (3); returns its stdout."""
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        sys.exit(f"catenary {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


class Simulator:
    """Costs of points by `catenary bench costs`."""

    def __init__(self, bag, model, corrected_at):
        command = [PROGRAM, "bench", "costs", "--bag", bag, "--model", model, "--corrected-at", corrected_at]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen([*map(str, command)], text=True, **pipes)
        self.head = json.loads(self.process.stdout.readline())
        self.columns, self.count = len(self.head["names"]), 0

    def ask(self, points):
        self.process.stdin.write(json.dumps([list(map(float, p)) for p in points]) + "\n")
        self.process.stdin.flush()
        self.count += len(points)
        return json.loads(self.process.stdout.readline())

    def costs(self, points):
        """Costs of points in the unit cube; infinite outside of it, and where nothing can be simulated."""
        points = numpy.atleast_2d(points)
        inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
        found = numpy.full(len(points), numpy.inf)
        if inside.any():
            answer = self.ask(points[inside])["costs"]
            found[inside] = [math.inf if cost is None else cost for cost in answer]
        return found

    def rmse_mm(self, point):
        return self.ask([point])["rmse_mm"][0]

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def optimum(simulator, seed):
    """Least cost by CMA-ES from several starts, with its point."""
    best, where = math.inf, None
    for start in range(STARTS):
        rng = numpy.random.default_rng([seed, start])
        draws = rng.random((64, simulator.columns))
        cheap = draws[numpy.argmin(simulator.costs(draws))]
        options = {"bounds": [0, 1], "seed": 1 + seed + start, "verbose": -9, "maxfevals": EVALUATIONS}
        search = cma.CMAEvolutionStrategy(cheap, 0.15, options)
        while not search.stop():
            points = search.ask()
            # CMA-ES ranks costs, so that any large number serves where nothing can be simulated.
            search.tell(points, numpy.minimum(simulator.costs(points), 1e12))
        if search.result.fbest < best:
            best, where = search.result.fbest, search.result.xbest
    return best, numpy.clip(where, 0.0, 1.0)


def chains(simulator, at, inflation, steps, seed):
    """Draws of the posterior by emcee, and the longest autocorrelation time in steps."""
    rng = numpy.random.default_rng([seed, 7])
    wide = rng.random((20 * WALKERS, simulator.columns))
    wide = wide[numpy.argsort(simulator.costs(wide))[: WALKERS // 2]]
    near = numpy.clip(at + 0.02 * rng.standard_normal((WALKERS - len(wide), simulator.columns)), 1e-6, 1 - 1e-6)
    walkers = numpy.concatenate([wide, near])
    density = lambda points: -0.5 * simulator.costs(points) / inflation
    sampler = emcee.EnsembleSampler(WALKERS, simulator.columns, density, moves=MOVES, vectorize=True)
    sampler.random_state = numpy.random.RandomState(seed).get_state()
    burn = steps // 4
    state = sampler.run_mcmc(walkers, burn)
    # Walkers that are left in a minimum far above the others have no part in the posterior, and would need very long to leave it.
    lost = state.log_prob < state.log_prob.max() - 15 - simulator.columns
    if lost.any():
        state.coords[lost] = state.coords[~lost][rng.integers((~lost).sum(), size=lost.sum())]
        state.log_prob = None
    sampler.reset()
    state = sampler.run_mcmc(state.coords, burn)
    sampler.reset()
    sampler.run_mcmc(state.coords, steps - 2 * burn)
    flat = sampler.get_chain(flat=True)
    time = float(numpy.max(sampler.get_autocorr_time(quiet=True)))
    return flat[rng.choice(len(flat), DRAWS, replace=False)], time


def unit_draws(path, seed):
    """Draws of a posterior file in unit coordinates."""
    mixture = json.loads(path.read_text())["mixture"]
    rng, kept = numpy.random.default_rng([seed, 11]), []
    weights = numpy.array(mixture["weights"])
    while len(kept) < DRAWS:
        parts = rng.choice(len(weights), size=4 * DRAWS, p=weights / weights.sum())
        for part in parts:
            u = rng.multivariate_normal(mixture["means"][part], mixture["covariances"][part])
            if ((u >= 0) & (u <= 1)).all():
                kept.append(u)
    return numpy.array(kept[:DRAWS])


def c2st(reference, draws, seed=1):
    """Share of draws that a classifier assigns to the right sample, the mean over five folds (Lopez-Paz and Oquab 2017)."""
    data = numpy.concatenate([reference, draws])
    target = numpy.repeat([0, 1], [len(reference), len(draws)])
    units = 10 * reference.shape[1]
    network = MLPClassifier(hidden_layer_sizes=(units, units), max_iter=1000, random_state=seed)
    folds = KFold(n_splits=5, shuffle=True, random_state=seed)
    return float(numpy.mean(cross_val_score(make_pipeline(StandardScaler(), network), data, target, cv=folds)))


def cable_model(path, length_m, diameter_m, mass_kg):
    """Model file of a measured cable."""
    model = yaml.safe_load((MODELS / "measured_cable.yaml").read_text())
    model["object"]["section"] = {"round": {"diameter_m": diameter_m}}
    area_m2 = math.pi / 4 * diameter_m**2
    model["parameters"] |= {"length_m": length_m, "density_kg_m3": mass_kg / (length_m * area_m2)}
    path.write_text(yaml.safe_dump(model, sort_keys=False))
    return path


def quantile(prior, u):
    """Value of a prior at the share u."""
    ((kind, bounds),) = prior.items()
    low, high = bounds["low"], bounds["high"]
    return low * (high / low) ** u if kind == "log_uniform" else low + u * (high - low)


def cases(arguments, out):
    """Yields the name of each case, its bag and its model."""
    if arguments.data:
        for name, sizes in CABLES.items():
            track = arguments.data / name / "swing_bare.csv"
            if track.exists():
                model, bag = cable_model(out / f"{name}.yaml", *sizes), out / f"{name}_bag"
                if not bag.exists():
                    program("import-track", track, "--model", model, "--out", bag)
                yield name, bag, model
    for bar in range(arguments.bars):
        bag, table = out / f"bar_{bar}_bag", out / f"bar_{bar}.csv"
        if not bag.exists():
            rows = motion.actions(1)
            table.write_text("dx_m,dz_m\n" + "".join(f"{x!r},{z!r}\n" for x, z in (map(float, row) for row in rows)))
            measuring = ("--noise", "--seed", 1, "--fidelity", "reference")
            program("simulate", "--model", MODELS / f"dlo_{bar}.yaml", "--actions", table, *measuring, "--out", bag)
        yield f"bar_{bar}", bag, MODELS / "soft_bar.yaml"
    if arguments.data:
        track, name = arguments.data / "measured_cable/swing_bare.csv", "measured_cable"
        for world in range(arguments.worlds):
            model, bag = cable_model(out / f"{name}.yaml", *CABLES[name]), out / f"world_{world}_bag"
            if not bag.exists():
                rng = numpy.random.default_rng([5, world])
                theta = yaml.safe_load(model.read_text())["theta"]
                # The edges of the prior are left out: worlds there would swing as no cable does.
                values = [f"--theta={p['name']}={quantile(p['prior'], rng.uniform(0.2, 0.8))}" for p in theta]
                measuring = ("--noise", "--seed", world, "--fidelity", "reference")
                program("simulate", "--model", model, "--track", track, *values, *measuring, "--out", bag)
            yield f"world_{world}", bag, model


def finder_fit(name, bag, model, out):
    """Error in mm of the fit of `catenary find-effects`, which may add nothing to the model, and its cost with the noise that it used."""
    alone, found = out / f"{name}_alone.yaml", out / f"{name}_finder"
    if not (found / "verdict.json").exists():
        effects = [effect["name"] for effect in json.loads(program("effects", "--json"))]
        content = yaml.safe_load(model.read_text())
        taken = {p["name"] for p in content["theta"]} | {e["name"] for e in content["effects"]} | set(content["parameters"])
        content["lacking"] = {"vetoes": [effect for effect in effects if effect not in taken]}
        alone.write_text(yaml.safe_dump(content, sort_keys=False))
        program("find-effects", bag, "--model", alone, "--null-sets", 19, "--out", found)
    verdict = json.loads((found / "verdict.json").read_text())
    return verdict["present"]["rmse_mm"], verdict["present"]["test"]["statistic"], verdict["noise"]["used_px"]


def row_of(name, bag, model, out, steps, fits, seed=1):
    """Figures of a case; those of its best fits alone with `fits`."""
    refined, alone = out / f"{name}_refined", out / f"{name}_networks"
    for folder, preset in ((refined, "default"), *([] if fits else [(alone, "networks")])):
        if not (folder / "inference.json").exists():
            program("infer", "--bag", bag, "--model", model, "--preset", preset, "--out", folder)
    answer = json.loads((refined / "inference.json").read_text())
    simulator = Simulator(bag, model, refined / "inference.json")
    least, at = optimum(simulator, seed)
    draws = None if fits else chains(simulator, at, answer["refinement"]["noise_inflation"], steps, seed)
    rmse_mm = simulator.rmse_mm(at)
    simulator.close()
    own = answer["refinement"]
    finder_mm, cost, used_px = finder_fit(name, bag, model, out)
    sampled = {} if draws is None else compared(simulator, *draws, refined, alone, seed)
    return (
        {"case": name}
        | sampled
        | {
            "cost": own["best_fit_residual"] * simulator.head["measured"],
            "cost_cma": float(least),
            # In variances of the same noise; priors of what is drawn for each episode count little.
            "cost_finder": cost * (used_px / own["noise"]["used_px"]) ** 2,
            "rmse_mm": own["best_fit_rmse_mm"],
            "rmse_cma_mm": rmse_mm,
            "rmse_finder_mm": finder_mm,
            "predictive_mm": (answer["predictive"] or {}).get("rmse_mm"),
            "networks_mm": own["networks_rmse_mm"],
            "wall_s": answer["wall_s"],
            "inflation": own["noise_inflation"],
            "modes": own["modes"],
            "steps": own["steps"],
            "drift": own["drift"],
            "points": simulator.count,
        }
    )


def compared(simulator, draws, time, refined, alone, seed):
    """C2ST of the posteriors against draws of emcee, with their autocorrelation time."""
    thetas = draws[:, : simulator.head["parameters"]]
    return {
        "c2st": c2st(thetas, unit_draws(refined / "posterior.json", seed)),
        "c2st_networks": c2st(thetas, unit_draws(alone / "posterior.json", seed)),
        "autocorrelation": time,
    }


def text(rows):
    forms = {"case": "{}", "wall_s": "{:.0f}", "modes": "{}", "steps": "{}", "points": "{}", "autocorrelation": "{:.0f}"}
    cell = lambda key, value: "-" if value is None else forms.get(key, "{:.2f}").format(value)
    lines = [list(rows[0])] + [[cell(key, value) for key, value in row.items()] for row in rows]
    return "\n".join("  ".join(f"{cell:>15}" for cell in line) for line in lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=pathlib.Path, help="folder that holds the folders of the measured cables")
    parser.add_argument("--worlds", type=int, default=10)
    parser.add_argument("--bars", type=int, default=4)
    parser.add_argument("--only", help="name of the one case to run")
    parser.add_argument("--steps", type=int, default=1200, help="steps of emcee, half of them to settle")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / ".build/posteriors/results")
    parser.add_argument("--fits", action="store_true", help="best fits alone")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    # Another program, or another number of steps, has other results.
    key = hashlib.sha256(PROGRAM.read_bytes() + str(arguments.steps).encode()).hexdigest()[:8]
    arguments.out = arguments.out / key
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name, bag, model in cases(arguments, arguments.out):
        if arguments.only not in (None, name):
            continue
        kept = arguments.out / f"{name}{'_fits' if arguments.fits else ''}.json"
        if not kept.exists():
            print(name, file=sys.stderr)
            kept.write_text(json.dumps(row_of(name, bag, model, arguments.out, arguments.steps, arguments.fits)))
        rows.append(json.loads(kept.read_text()))
    print(json.dumps(rows) if arguments.json else text(rows) if rows else "no case")


if __name__ == "__main__":
    main()
