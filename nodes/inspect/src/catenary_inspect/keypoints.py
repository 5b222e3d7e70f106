"""Report of the keypoints of object and target: rate, scores and noise."""

import numpy

from .message_log import stamp_ns
from .table import table
from .topics import KEYPOINTS

NAMES, NEEDED = [KEYPOINTS[0]], [KEYPOINTS[0]]
COLOURS = ("#4477aa", "#66ccee", "#228833", "#ccbb44", "#ee6677")
POINTS = ("keypoint 0", "keypoint 1", "keypoint 2", "keypoint 3", "target")


def noise_px(values):
    """Standard deviation of the noise on a smooth motion, from second differences; None for fewer than five values."""
    seen = values[numpy.isfinite(values)]
    if len(seen) < 5:
        return None
    # 1.4826 turns the median absolute deviation of a Gaussian into its standard deviation, which is robust against jumps. The
    # second difference of white noise has 6 times its variance.
    return float(1.4826 * numpy.median(numpy.abs(numpy.diff(seen, 2))) / 6**0.5)


class Report:
    """Report of F frames: `time_s` (F), `points` (F, 5, 2) in pixels, NaN if a point was not seen, `scores` (F, 5)."""

    def __init__(self, log):
        messages = [message for _, message in log.need(*KEYPOINTS, "the keypoints")]
        self.origin = log.origin
        stamps = numpy.array([stamp_ns(m.header.stamp) for m in messages])
        self.time_s = 1e-9 * (stamps - stamps[0])
        self.size_px = (messages[-1].image_width, messages[-1].image_height)
        u = [[*m.dlo_u, m.target_u] for m in messages]
        v = [[*m.dlo_v, m.target_v] for m in messages]
        self.points = numpy.stack([numpy.array(u, float), numpy.array(v, float)], axis=2)
        self.scores = numpy.array([[*m.dlo_scores, m.target_score] for m in messages], float)
        self.scores[:, 4] *= [bool(m.target_seen) for m in messages]
        self.points[self.scores == 0] = numpy.nan

    def flips(self):
        """Number of frames whose four points are nearer to the previous frame in reverse order."""
        now, before = self.points[1:, :4], self.points[:-1, :4]
        same = numpy.linalg.norm(now - before, axis=2).sum(axis=1)
        turned = numpy.linalg.norm(now[:, ::-1] - before, axis=2).sum(axis=1)
        return int((turned < same).sum())

    def data(self):
        periods = numpy.diff(self.time_s)
        span = self.time_s[-1]
        points = []
        for i, name in enumerate(POINTS):
            seen = self.scores[:, i] > 0
            coordinates = self.points[seen, i]
            points.append(
                {
                    "name": name, "seen": float(seen.mean()), "score": float(self.scores[seen, i].mean()) if seen.any() else None,
                    "u": [float(c) for c in (coordinates[:, 0].min(), coordinates[:, 0].max())] if seen.any() else None,
                    "v": [float(c) for c in (coordinates[:, 1].min(), coordinates[:, 1].max())] if seen.any() else None,
                    "noise_u_px": noise_px(self.points[:, i, 0]), "noise_v_px": noise_px(self.points[:, i, 1]),
                }
            )  # fmt: skip
        return {
            "frames": len(self.time_s), "span_s": float(span), "rate_hz": (len(self.time_s) - 1) / float(span) if span else None,
            "longest_gap_s": float(periods.max()) if len(periods) else None, "order_flips": self.flips(), "points": points,
        }  # fmt: skip

    def text(self):
        d = self.data()
        rate = "-" if d["rate_hz"] is None else f"{d['rate_hz']:.1f}"
        gap = "-" if d["longest_gap_s"] is None else f"{1e3 * d['longest_gap_s']:.0f}"
        width, height = self.size_px
        about = (
            f"{self.origin}, {KEYPOINTS[0]}: {d['frames']} frames in {d['span_s']:.2f} s, {rate} Hz, longest gap {gap} ms, "
            f"{d['order_flips']} flips of the order, image {width}x{height}"
        )
        between = lambda pair: "-" if pair is None else f"{pair[0]:.1f} to {pair[1]:.1f}"
        rows = [
            (p["name"], 100 * p["seen"], p["score"], between(p["u"]), between(p["v"]), p["noise_u_px"], p["noise_v_px"])
            for p in d["points"]
        ]
        return about + "\n" + table(("point", "seen %", "score", "u px", "v px", "noise u px", "noise v px"), rows)

    def draw_picture(self, figure):
        """Draws the paths in the image, and both coordinates over time."""
        left, right = figure.subfigures(1, 2)
        image = left.subplots()
        over_time = right.subplots(2, 1, sharex=True)
        for i, (name, colour) in enumerate(zip(POINTS, COLOURS)):
            u, v = self.points[:, i].T
            style = {"color": colour, "label": name, "marker": ".", "linewidth": 0.8, "markersize": 2}
            image.plot(u, v, **(style | ({"marker": "*", "markersize": 10} if name == "target" else {})))
            for axis, values in zip(over_time, (u, v)):
                axis.plot(self.time_s, values, **style)
        width, height = self.size_px
        image.set(xlim=(0, width), ylim=(height, 0), aspect="equal", xlabel="u, px", ylabel="v, px", title="in the image")
        image.legend(fontsize="small")
        over_time[0].set(ylabel="u, px", title="over time")
        over_time[1].set(ylabel="v, px", xlabel="time, s")
        over_time[1].invert_yaxis()


def report(log, _options):
    return Report(log)
