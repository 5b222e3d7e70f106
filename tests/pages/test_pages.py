"""The four report pages in headless Chromium at two widths: nothing is cut, texts are legible, the answer comes first."""

import json

import pytest
import yaml
from PIL import Image

from support import chromium
from support.program import BAG, MODEL

# CSS pixels of a desktop window and of a phone.
WIDTHS = (1400, 420)
LARGEST_BYTES = 3_000_000
PARAMETERS = ("length_m", "youngs_modulus_pa")


@pytest.fixture(scope="module")
def browser():
    path = chromium.program()
    if path is None:
        pytest.skip("needs Chromium: none of chromium, chromium-browser, google-chrome is on the PATH, and CHROME is not set")
    browser = chromium.Chromium(path)
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def infer(program, tmp_path_factory):
    """Page of an inference."""
    out = tmp_path_factory.mktemp("infer")
    program.text("infer", "--bag", BAG, "--model", MODEL, "--out", out, "--iterations", 2, "--simulations", 40)
    return out / "report.html"


@pytest.fixture(scope="module")
def find_effects(hidden_mass):
    """Page of a search that finds a hidden mass."""
    folder, done = hidden_mass
    assert done.returncode == 0, done.stderr
    return folder / "found/report/index.html"


@pytest.fixture(scope="module")
def calibration(program, tmp_path_factory):
    """Page of a calibration whose inferences are all in its journal, so that the program only writes the report."""
    out, count = tmp_path_factory.mktemp("calibration"), 40
    share = [(i + 0.5) / count for i in range(count)]
    # Ranks of a calibrated posterior: uniform, in another order for each figure.
    ranks = lambda i: [share[i], share[(7 * i) % count]]
    check = lambda i: {"ranks": ranks(i), "density": share[(11 * i) % count], "distance": share[(13 * i) % count]}
    figures = lambda i, width: {"check": check(i), "width": [width, width]}
    known = {"truth": [0.25, 5e3], "mean": [0.25, 5e3], "sd": [0.01, 1e3], "wall_s": 2.0}
    line = lambda i: known | {"narrow": figures(i, 0.1)} | figures(i, 0.11)
    (out / "checks.jsonl").write_text("".join(json.dumps(line(i)) + "\n" for i in range(count)))
    program.text("bench", "calibration", "--truths", count, "--out", out)
    return out / "report.html"


@pytest.fixture(scope="module")
def demo(program, infer, tmp_path_factory):
    """Page of a summary as a demo writes it, with briefly trained policies."""
    folder = tmp_path_factory.mktemp("demo")
    inferred = json.loads((infer.parent / "inference.json").read_text())
    kept = {key: inferred[key] for key in ("posterior", "marginals", "mass_outside", "warnings")}
    truth = [m["mean"] for m in inferred["marginals"]]
    inference = kept | {"domains": [truth, [0.25, 5e3]], "losses": [2.0, 1.0, 0.5], "effective_sample_size": 90.0, "simulations": 200}
    policies = [folder / f"pi{i}" for i in (0, 1)]
    for i, policy in enumerate(policies):
        program.text("train", "--model", MODEL, "--out", policy, "--steps", 512, "--seed", i)
    asked = [word for policy in policies for word in ("--policy", policy)]
    evaluated = program.json("evaluate", *asked, "--model", MODEL, "--episodes", 30, "--fidelity", "fast")["policies"]
    frames = []
    for step in range(3):
        Image.new("RGB", (640, 480), (200, 200, 60 * step)).save(folder / f"{step}.png")
        frames.append({"file": f"{step}.png", "step": step, "marks_px": [[100.0 + 60 * k, 200.0] for k in range(5)]})
    Image.new("RGB", (320, 120)).save(folder / "film.gif")
    episode = lambda name: {
        "policy": name, "end": "step_limit", "rewards": [0.3, 0.6], "episode_return": 0.9, "distance_m": 0.03, "bag": f"bags/{name}",
        "path_m": [[0.4, 0.42], [0.45, 0.40], [0.5, 0.36]], "frames": frames, "keypoint_latency_ms": [9.0, 20.0],
    }  # fmt: skip
    training = lambda name: {"policy": name, "curve": [[1000 * i, 0.1 * i] for i in range(30)], "steps_per_second": 1000.0}
    task = yaml.safe_load(MODEL.read_text())["task"]
    summary = {
        "seed": 1, "preset": "default", "parameters": list(PARAMETERS), "truth": truth, "target_m": [0.5, 0.15], "task": task,
        "success_distance_m": 0.02, "inference": inference, "training": [training("pi0"), training("pi1")],
        "episodes": [episode("pi0"), episode("pi1")], "film": "film.gif",
        "evaluation": {"episodes": 30, "fidelity": "fast", "seed": 1, "policies": evaluated},
        "stages": [{"name": "start the graph", "wall_s": 1.0, "cpu_s": 0.5}],
    }  # fmt: skip
    (folder / "summary.json").write_text(json.dumps(summary))
    program.text("report", "--dir", folder)
    return folder / "report/index.html"


@pytest.fixture(params=["infer", "find_effects", "calibration", "demo"])
def page(request):
    return request.param, request.getfixturevalue(request.param)


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_is_cut_and_every_text_is_legible(page, width, browser):
    name, path = page
    seen = browser.faults_of(path, width)
    assert not seen["faults"], f"{name} at {width} px:\n" + "\n".join(seen["faults"][:20])
    assert seen["texts"] > 10, "the pictures have no axes"
    assert path.stat().st_size < LARGEST_BYTES
    fields = [name for name in (*PARAMETERS, "tip_mass_kg") if name in seen["text"]]
    assert not fields, f"names of fields in the text: {fields}"


# Least contrast of a text in a picture with the ground of the page (WCAG 2.1), for the ground as it is computed now.
CONTRAST = """(() => {
  const numbers = c => c.match(/[\\d.]+/g).slice(0, 3).map(Number);
  const light = c => {
    const [r, g, b] = numbers(c).map(v => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ground = getComputedStyle(document.body).backgroundColor, paper = light(ground);
  const of = e => light(getComputedStyle(e)[e.closest('svg') ? 'fill' : 'color']);
  const all = [...document.querySelectorAll('svg text, p, td, th, li, h1, h2, figcaption')];
  const contrast = all.map(of).map(v => (Math.max(v, paper) + 0.05) / (Math.min(v, paper) + 0.05));
  return {ground: numbers(ground), least: Math.min(...contrast), texts: all.length};
})()"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_are_legible_in_both_schemes(page, scheme, browser):
    name, path = page
    try:
        browser.prefer(scheme)
        browser.open(path)
        seen = browser.evaluate(CONTRAST)
    finally:
        browser.prefer("light")
    assert all(part > 200 for part in seen["ground"]) if scheme == "light" else all(part < 60 for part in seen["ground"]), seen
    assert seen["texts"] > 20 and seen["least"] >= 4.5, f"{name}: {seen}"


SHOWN = (
    "[...document.querySelectorAll('.replay g[data-t]')]"
    ".filter(g => getComputedStyle(g).display != 'none' && getComputedStyle(g).opacity == 1)"
)


@pytest.mark.parametrize("name", ["infer", "find_effects"])
def test_a_slider_chooses_the_moment_and_the_page_is_whole_without_scripts(name, browser, request):
    path = request.getfixturevalue(name)
    browser.open(path)
    replays = browser.evaluate("document.querySelectorAll('.replay.live').length")
    assert replays > 0 and browser.evaluate(f"{SHOWN}.length") == replays
    slide = "(() => {const r = document.querySelector('.replay'), s = r.querySelector('input'); s.value = %d; s.oninput();"
    told = "return [r.querySelector('g.now').dataset.t, r.querySelector('output').textContent]})()"
    first, last = (browser.evaluate(slide % k + told) for k in (0, 999))
    assert first == ["0.00", "0.00 s"] and float(last[0]) > 1 and last[1] == f"{last[0]} s"
    assert not browser.complaints()
    browser.open(path, scripts=False)
    try:
        # Several moments over one another, and nothing to press.
        assert browser.evaluate(f"{SHOWN}.length") > 2 * replays
        assert browser.evaluate("[...document.querySelectorAll('.controls')].every(c => getComputedStyle(c).display == 'none')")
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)


def test_a_page_has_at_most_one_box_of_doubts(page, browser):
    name, path = page
    browser.open(path)
    assert browser.evaluate("document.querySelectorAll('.warning').length") <= 1, name


def test_every_pair_of_parameters_stands_in_one_picture(infer, browser):
    browser.open(infer)
    pictures = browser.evaluate("[...document.querySelectorAll('figure.fixed svg[role=img]')].map(s => s.querySelectorAll('image').length)")
    assert pictures == [1], "two parameters have one pair"
    assert "whole prior" not in browser.evaluate("document.body.innerText")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("infer", "The object is"),
        ("find_effects", "missing from the model"),
        ("calibration", "No check refutes the intervals"),
    ],
)
def test_the_answer_comes_first(name, words, browser, request):
    lines = [line for line in browser.faults_of(request.getfixturevalue(name), 420)["text"].splitlines() if line.strip()]
    assert words in " ".join(lines[1:3]), lines[:4]


def test_the_search_tells_the_gain_of_the_repair_and_the_detectable_sizes(find_effects, browser):
    text = " ".join(browser.faults_of(find_effects, 1400)["text"].split())
    repair = ("Tip mass of", "With it the error falls from", "not fitted, but chose between the models", "noise floor")
    test = ("times the noise", "<= 0.05 (19 null data sets)")
    for words in (*repair, *test, "Detectable sizes", "not at any size"):
        assert words in text, words


def test_the_checks_find_faults(tmp_path, browser):
    """Opens a page that is too wide, has cut and small texts, writes an error to the console and asks for another page."""
    page = tmp_path / "page.html"
    page.write_text(
        "<!doctype html><meta charset=utf-8><p style='width:2000px'>wide</p>"
        "<svg viewBox='0 0 700 40' width=350><text x=10 y=20 font-size=12>small</text><text x=690 y=20 font-size=30>cut off</text></svg>"
        "<script>console.error('complaint'); fetch('http://localhost:9/');</script>"
    )
    faults = "\n".join(browser.faults_of(page, 420)["faults"])
    for words in ("the page is 20", "text of 6.0 px: small", "cut: cut off", "complaint", "asks for http://localhost"):
        assert words in faults, faults
