"""Recordings of a measured cable: posteriors by `catenary infer`, and predictions of the other recordings of the same state.

The model is launch_configs/models/measured_cable.yaml with the measured length, diameter and masses of the cable. With a load at the tip,
its mass, its centre beyond the tip and its radius of gyration are unknown, and the cable's own parameters have the posterior of the bare
swing as their prior: the load was weighed, which tells how far a posterior may be trusted. Where a recording has the wrench on the hand, a
second model with that prior compares it, too. Its biases are unknown in the bare recording, and have that posterior as their prior in the
loaded one.

Poses at rest (static_*.csv) are not read: the friction between the strands of a cable holds it at rest within a band of shapes, and the
motion that led to each pose was not recorded.
"""

import csv
import hashlib
import json
import math
import sys

import draw
import yaml

from support.program import MODELS

MODEL = MODELS / "measured_cable.yaml"
BARE, LOADED = "bare", "tip_mass"
STATES = (BARE, LOADED)
MOTIONS = ("swing", "moving_grip")
MARKERS, TIP = "tip_mass_kg", "tip_load_kg"
LOAD = {
    TIP: {"uniform": {"low": 0.0, "high": 0.5}},
    # The weight hangs on a hook or a thread of some centimetres.
    "tip_load_offset_m": {"uniform": {"low": 0.0, "high": 0.1}},
    "tip_load_gyration_radius_m": {"uniform": {"low": 0.0, "high": 0.05}},
}
# Noise of an arm's wrench: the force along the motion holds the arm's own inertia and friction.
WRENCH = {"force_sd_n": [1.0, 0.1], "torque_sd_n_m": 0.05}
BIASES = {
    "wrench_bias_x_n": {"normal": {"mean": 0.0, "sd": 1.0, "low": -3.0, "high": 3.0}},
    "wrench_bias_z_n": {"normal": {"mean": 0.0, "sd": 1.0, "low": -3.0, "high": 3.0}},
    "wrench_bias_y_n_m": {"normal": {"mean": 0.0, "sd": 0.2, "low": -1.0, "high": 1.0}},
}
# Standard deviation of the change of a bias from one recording to the next, in the units of the biases.
BIAS_DRIFT = {"wrench_bias_x_n": 0.15, "wrench_bias_z_n": 0.15, "wrench_bias_y_n_m": 0.03}
# Space about the measured points that a simulated cable may reach, as a share of their extent.
MARGIN = 0.1
# Side of the mask in pixels.
MASK_PX = 256
# What a row keeps of a prediction.
FIGURES = (
    *("rmse_mm", "spread_mm", "half_width_mm", "noise_half_width_mm", "coverage", "coverage_50", "coverage_p_value", "p_value"),
    *("effective_coordinates", "undetermined", "shares", "warnings", "unpredicted"),
)
HEAD = (
    "recording",
    "RMSE mm",
    "of noise",
    "tip mass kg",
    "untold",
    "prediction of",
    "RMSE mm",
    "90 % band",
    "50 % band",
    "+- mm",
    "p",
    "said",
    "s",
)
# Share of the prior's interval above which a recording tells nothing of a parameter, as in the program.
UNTOLD = 0.9
# 5 and 95 % quantiles of a normal distribution, in standard deviations.
NINETY = 1.645


def points_of(path):
    """(x, z) in m of the grip and of all keypoints in a measured track."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = ("grip", *(f"p{i}" for i in range(1, 5)))
    return [(float(row[f"{name}_x_m"]), float(row[f"{name}_z_m"])) for row in rows for name in names]


def density_kg_m3(arguments):
    """Density of the cable over its round section."""
    return arguments.mass_kg / (arguments.length_m * math.pi / 4 * arguments.diameter_m**2)


def place_view(model, tracks):
    """Moves and widens the view until it holds all points of the tracks, at the same noise in mm."""
    camera = model["camera"]
    view = camera["view"]["plane"]
    points = [point for path in tracks for point in points_of(path)]
    ends = [(min(axis), max(axis)) for axis in zip(*points, strict=True)]
    margin_m = MARGIN * max(high - low for low, high in ends)
    inside = lambda at, low, high: at - view["side_m"] / 2 <= low - margin_m and high + margin_m <= at + view["side_m"] / 2
    if all(inside(at, *end) for at, end in zip(view["centre_m"], ends, strict=True)):
        return
    side_m = max(view["side_m"], max(high - low for low, high in ends) + 2 * margin_m)
    camera["keypoint_noise_px"] *= view["side_m"] / side_m
    view |= {"centre_m": [(low + high) / 2 for low, high in ends], "side_m": side_m}


def model_of(arguments, state, known):
    """Model of the cable in a state from measured lengths and masses. `known` are marginals of the bare cable: name to median and 5 and
    95 % quantiles."""
    model = yaml.safe_load(MODEL.read_text())
    model["name"] = f"cable_{state}"
    model["object"]["section"] = {"round": {"diameter_m": arguments.diameter_m}}
    measured = {"length_m": arguments.length_m, "density_kg_m3": density_kg_m3(arguments), MARKERS: arguments.marker_mass_kg}
    model["parameters"] |= measured
    for entry in model["theta"]:
        entry["prior"] = informed(entry["name"], entry["prior"], known)
    if state == LOADED:
        del model["parameters"][MARKERS]
        model["theta"] += [{"name": name, "prior": prior} for name, prior in LOAD.items()]
    place_view(model, [path for path in (track(arguments, motion, state) for motion in MOTIONS) if path.exists()])
    return model


def sd_of(q05, q95):
    """Standard deviation of a normal distribution with these 5 and 95 % quantiles."""
    return (q95 - q05) / (2 * NINETY)


def informed(name, prior, known):
    """Normal prior of a known marginal within the bounds of `prior`; `prior` itself for a name that is not known."""
    if name not in known:
        return prior
    ((_, bounds),) = prior.items()
    median, q05, q95 = known[name]
    sd = math.hypot(sd_of(q05, q95), BIAS_DRIFT.get(name, 0.0))
    low, high = max(bounds["low"], median - 6 * sd), min(bounds["high"], median + 6 * sd)
    return {"normal": {"mean": median, "sd": sd, "low": low, "high": high}}


def with_wrench(model, known):
    """The same model, which observes the wrench, too, with unknown biases."""
    biases = [{"name": name, "prior": informed(name, prior, known)} for name, prior in BIASES.items()]
    observation = model["observation"] | {"wrench": WRENCH}
    return model | {"name": f"{model['name']}_wrench", "theta": [*model["theta"], *biases], "observation": observation}


def has_wrench(path):
    """Whether a measured track has the wrench on the hand."""
    with path.open(newline="") as file:
        return "grip_fz_n" in next(csv.reader(file))


def track(arguments, motion, state):
    """Path of a measured track; the folder may lack it."""
    return arguments.data / f"{motion}_{state}.csv"


def noise_mm(model_path):
    """Distance in mm that the stated noise moves a keypoint by, root mean square."""
    camera = yaml.safe_load(model_path.read_text())["camera"]
    return 1e3 * math.sqrt(2) * camera["keypoint_noise_px"] * camera["view"]["plane"]["side_m"] / MASK_PX


def imported(arguments, model, motion, state):
    """Bag of a measured track."""
    bag = arguments.out / f"bag_{motion}_{state}"
    if not bag.exists():
        draw.program("import-track", track(arguments, motion, state), "--model", model, "--out", bag)
    return bag


def inferred(arguments, model, state, motion, others):
    """Result of `infer` from one recording, with predictions of the other motions of the same state."""
    asked_for = hashlib.sha256(model.read_bytes() + ",".join(others).encode()).hexdigest()
    folder = arguments.out / f"infer_{motion}_{state}_{asked_for[:8]}"
    if not folder.exists():
        print(folder.name, file=sys.stderr)
        half = folder.with_name("half_" + folder.name)
        bags = {m: imported(arguments, model, m, state) for m in (motion, *others)}
        asked = [word for other in others for word in ("--predict", bags[other])]
        # A result that does not fit the recording is a result of the bench, too.
        draw.program("infer", bags[motion], "--model", model, "--out", half, *asked, accepts=(0, 3))
        half.rename(folder)
    return json.loads((folder / "inference.json").read_text())


def row_of(arguments, labels, others, result, noise):
    """Figures of one recording."""
    check, refinement = result["predictive"], result["refinement"]
    predictions = [{"motion": m} | {key: p.get(key) for key in FIGURES} for m, p in zip(others, result["predictions"], strict=True)]
    return labels | {
        "marginals": {m["name"]: [m["median"], m["q05"], m["q95"]] for m in result["marginals"]},
        "priors": {p["name"]: p["prior"] for p in result["posterior"]["parameters"]},
        "rmse_mm": check and check["rmse_mm"],
        "noise_mm": noise,
        "coverage": check and check["coverage"],
        "p_value": check and check["p_value"],
        "best_fit_rmse_mm": refinement and refinement["best_fit_rmse_mm"],
        "noise_inflation": refinement and refinement["noise_inflation"],
        "modes": refinement and refinement["modes"],
        "tip_mass_known_kg": arguments.tip_mass_kg if labels["state"] == LOADED else None,
        "predictions": predictions,
        "misfit": result["misfit"],
        "warnings": result["warnings"],
        "wall_s": result["wall_s"],
    }


def rows(arguments):
    """Rows of all recordings that the folder holds; each is told as soon as it is there. Motions that it lacks are named."""
    known = {}
    for state in STATES:
        present = [motion for motion in MOTIONS if track(arguments, motion, state).exists()]
        for motion in MOTIONS:
            if motion not in present:
                print(f"{track(arguments, motion, state)}: absent, skipped", file=sys.stderr)
        for motion in present:
            others = [other for other in present if other != motion]
            # Each recording of the bare cable is judged alone.
            model = model_of(arguments, state, known if state == LOADED else {})
            keypoints = row(arguments, state, motion, model, others, "keypoints")
            yield keypoints
            # The swing alone determines the cable, so that a moving grip informs no prior of the loaded cable but the wrench's.
            if (state, motion) == (BARE, "swing"):
                known |= keypoints["marginals"]
            if has_wrench(track(arguments, motion, state)):
                model = with_wrench(model_of(arguments, state, known), known)
                both = row(arguments, state, motion, model, [], "keypoints and wrench")
                yield both
                if state == BARE:
                    known |= {name: both["marginals"][name] for name in BIASES}


def row(arguments, state, motion, model, others, compared):
    """Row of one recording by one model, of which `compared` names the compared channels."""
    path = arguments.out / f"{model['name']}_{motion}.yaml"
    path.write_text(yaml.safe_dump(model, sort_keys=False))
    labels = {"state": state, "motion": motion, "compared": compared}
    return row_of(arguments, labels, others, inferred(arguments, path, state, motion, others), noise_mm(path))


def share_of_prior(prior, low, high):
    """Width of an interval as a share of the prior's 90 %."""
    ((kind, bounds),) = prior.items()
    if kind == "normal":
        return sd_of(low, high) / bounds["sd"]
    scale = math.log if kind == "log_uniform" else float
    return (scale(high) - scale(low)) / (0.9 * (scale(bounds["high"]) - scale(bounds["low"])))


def undetermined(row):
    """Names of the parameters whose posterior is as wide as the prior."""
    return [name for name, (_, low, high) in row["marginals"].items() if share_of_prior(row["priors"][name], low, high) > UNTOLD]


def text(row):
    """Lines for a person."""
    named = lambda value, form: "-" if value is None else form.format(value)
    ratio = row["rmse_mm"] and row["rmse_mm"] / row["noise_mm"]
    fitted = [f"RMSE {named(row['rmse_mm'], '{:.1f} mm')}, {named(ratio, '{:.2f}')} of the stated noise"]
    fitted += [f"{named(row['coverage'], '{:.0%}')} in the 90 % band", f"p = {named(row['p_value'], '{:.3f}')}"]
    fitted += [f"{named(row['modes'], '{}')} modes", f"{row['wall_s']:.0f} s"]
    lines = [f"{row['motion']} {row['state']}, {row['compared']}: {', '.join(fitted)}"]
    for name, (median, low, high) in row["marginals"].items():
        share = share_of_prior(row["priors"][name], low, high)
        lines.append(f"  {name} {median:.3g} ({low:.3g} to {high:.3g}), {share:.0%} of the prior's interval")
        if name == TIP:
            known = row["tip_mass_known_kg"]
            holds = "holds" if low <= known <= high else "misses"
            off = deviations(median, low, high, known)
            lines.append(f"    the interval {holds} the weighed {known:g} kg: off by {off:+.1f} standard deviations")
    if untold := undetermined(row):
        lines.append(f"  alone it cannot tell {', '.join(untold)}: as wide as the prior")
    if (row["modes"] or 0) > 1:
        lines.append(f"  {row['modes']} minima of the cost share the posterior: shares of modes scatter between seeds")
    lines += [line for p in row["predictions"] for line in prediction_text(p)]
    lines += [f"  warning: {warning}" for warning in [*([row["misfit"]] if row["misfit"] else []), *row["warnings"]]]
    return "\n".join(lines)


def prediction_text(p):
    """Lines on a prediction."""
    if p["rmse_mm"] is None:
        return [f"  prediction of {p['motion']}: {p['unpredicted']}"]
    figures = [
        f"RMSE {p['rmse_mm']:.1f} mm (keypoints' own spread {p['spread_mm']:.0f} mm)",
        f"{p['coverage']:.0%} in the 90 % band of +- {p['half_width_mm']:.1f} mm (noise alone: {p['noise_half_width_mm']:.1f} mm)",
        f"{p['coverage_50']:.0%} in the 50 % band",
        f"p = {p['p_value']:.3f}, of the coverage {p['coverage_p_value']:.3f}",
        f"{p['shares']['parameters']:.0%} of the variance from the parameters",
    ]
    return [f"  prediction of {p['motion']}: {', '.join(figures)}", *(f"    warning: {warning}" for warning in p["warnings"])]


def deviations(median, low, high, value, sd=0.0):
    """Distance of a posterior from a value with a standard deviation of its own, in standard deviations of both."""
    return (median - value) / math.hypot(sd_of(low, high), sd)


def agreement(row, verdict):
    """Common parameters of a posterior and of the finder's repaired model: difference in standard deviations of both."""
    estimates = verdict["repaired"]["estimates"] if verdict["repaired"] else []
    common = {}
    for e in estimates:
        if e["name"] in row["marginals"]:
            sd = sd_of(e["q05"], e["q95"])
            own = row["marginals"][e["name"]]
            common[e["name"]] = {"posterior": own, "finder": [e["value"], sd], "deviations": deviations(*own, e["value"], sd)}
    return common


def table(all_rows):
    """Table of all recordings, a line for each prediction."""
    cells = [HEAD, ["---"] * len(HEAD)]
    for row in all_rows:
        rmse_mm, tip = row["rmse_mm"], row["marginals"].get(TIP)
        first = [
            f"{row['motion']} {row['state']}, {row['compared']}",
            *(["-", "-"] if rmse_mm is None else [f"{rmse_mm:.1f}", f"{rmse_mm / row['noise_mm']:.2f}"]),
        ]
        first += ["{:.3f} ({:.3f} to {:.3f})".format(*tip) if tip else "known", str(len(undetermined(row)))]
        for p in row["predictions"] or [{"motion": "none", "rmse_mm": None}]:
            figures = ["-"] * 6
            if p["rmse_mm"] is not None:
                shares = [f"{p['coverage']:.0%}", f"{p['coverage_50']:.0%}"]
                figures = [f"{p['rmse_mm']:.1f}", *shares, f"{p['half_width_mm']:.1f}", f"{p['p_value']:.3f}", said(p)]
            cells.append([*first, p["motion"], *figures, f"{row['wall_s']:.0f}"])
    return "\n".join("| " + " | ".join(line) + " |" for line in cells)


def said(prediction):
    """Warnings of a prediction in a word each."""
    words = {"do not trust its certainty": "too certain", "does not determine this motion": "open", "lacks a part of it": "far off"}
    found = [word for part, word in words.items() if any(part in warning for warning in prediction["warnings"])]
    return ", ".join(found) or "-"
