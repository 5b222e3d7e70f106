"""Command line of catenary-inspect."""

import argparse
import json
import pathlib
import sys

from . import bag, episode, graph, keypoints, latency, posterior
from .message_log import InspectError

# For a command: module, description, seconds to listen, width and height of the picture in inches, condition to stop listening.
COMMANDS = {
    "graph": (graph, "nodes, topics, rates, and profiles that do not fit", 3.0, (12, 7), None),
    "episode": (episode, "what a policy did, and what the arm made of it", 120.0, (11, 9), episode.is_complete),
    "posterior": (posterior, "the posterior over the object's parameters", 3.0, (8, 7), lambda log: bool(log.get(posterior.NAMES[0]))),
    "keypoints": (keypoints, "rate, scores, noise and paths of the keypoints", 5.0, (12, 6), None),
    "latency": (latency, "ages and evenness of messages, and of what a step used", 5.0, (9, 6), None),
}


def parser():
    top = argparse.ArgumentParser(
        prog="catenary-inspect", description="Tables and pictures of a catenary graph: of its live topics, or of a bag with --bag."
    )
    commands = top.add_subparsers(dest="command", required=True)
    for name, (_, what, seconds, _, done) in COMMANDS.items():
        p = commands.add_parser(name, help=what, description=what[0].upper() + what[1:] + ".")
        p.add_argument("--bag", metavar="BAG", help="a bag folder, or an .mcap or .db3 file, in place of live topics")
        p.add_argument("--out", metavar="PICTURE", help="picture to make: .png, .pdf or .svg")
        p.add_argument("--json", action="store_true", help="print the figures as JSON")
        longest = "at most, " if done else ""
        p.add_argument("--seconds", type=float, default=seconds, help=f"how long to listen to live topics, {longest}default {seconds:g}")
        if name == "episode":
            p.add_argument("--episode", type=int, metavar="NUMBER", help="the one to show; the last by default")
        if name == "posterior":
            p.add_argument("--file", metavar="POSTERIOR.json", help="a file of `catenary infer` in place of topics")
    return top


def make_report(options):
    """Report of a command, and notes on missing parts of a bag, which are also printed on stderr."""
    module, _, _, _, done = COMMANDS[options.command]
    if not options.seconds > 0:
        raise InspectError(f"--seconds: expected a number above 0, got {options.seconds:g}")
    if getattr(options, "file", None):
        return posterior.of_file(options.file), []
    if options.bag:
        log = bag.read(options.bag, module.NAMES)
        for note in log.notes:
            print(f"catenary-inspect: {note}", file=sys.stderr)
        return module.report(log, options), log.notes
    from . import live

    return module.report(live.listen(module.NAMES, module.NEEDED, options.seconds, done or (lambda log: False)), options), []


def save(report, path, size):
    """Draws the picture of a report into a file."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot

    path = pathlib.Path(path)
    if path.suffix not in (".png", ".pdf", ".svg"):
        raise InspectError(f"--out {path}: expected a name that ends in .png, .pdf or .svg")
    figure = matplotlib.pyplot.figure(figsize=size, layout="constrained")
    report.draw_picture(figure)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=120)
    except OSError as error:
        raise InspectError(f"--out {path}: cannot write it: {error.strerror}") from error
    finally:
        matplotlib.pyplot.close(figure)
    print(f"catenary-inspect: {path}", file=sys.stderr)


def main(arguments=None):
    options = parser().parse_args(arguments)
    try:
        report, notes = make_report(options)
        print(json.dumps({**report.data(), "notes": notes}, indent=2) if options.json else report.text())
        if options.out:
            save(report, options.out, COMMANDS[options.command][3])
    except InspectError as error:
        print(f"catenary-inspect: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
