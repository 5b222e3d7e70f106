"""Report of latencies: ages and periods of messages, and ages of the inputs of a policy step."""

import numpy

from .message_log import InspectError, stamp_ns
from .table import table
from .topics import ACCEPTED, ACTION, ARM_STATE, JOINTS, KEYPOINTS, MASK, OBSERVATION, POSE, TARGET

# Without images, whose decoding in Python takes longer than their transport.
STAMPED = (MASK, KEYPOINTS, POSE, JOINTS, ARM_STATE, TARGET, ACCEPTED, ACTION, OBSERVATION)
NAMES, NEEDED = [name for name, _ in STAMPED], []


def percentiles_ms(values_s):
    """Median, 99th percentile and maximum in ms; None for no values."""
    if not len(values_s):
        return {"p50_ms": None, "p99_ms": None, "max_ms": None}
    p50, p99, greatest = (1e3 * numpy.quantile(values_s, [0.5, 0.99, 1])).tolist()
    return {"p50_ms": p50, "p99_ms": p99, "max_ms": greatest}


class Report:
    """Report with `ages_s`, ages of messages at their arrival by topic, and `spans_s`, derived times by name."""

    def __init__(self, log):
        self.origin, self.rows, self.ages_s, self.spans_s = log.origin, [], {}, {}
        for name, _ in STAMPED:
            since_ns = log.channels[name].since_ns if name in log.channels else 0
            # Latched messages from before the begin of listening are left out: their age says nothing about the transport.
            messages = [pair for pair in log.get(name) if stamp_ns(pair[1].header.stamp) >= since_ns]
            if messages:
                self.add(name, messages)
        if not self.rows:
            names = ", ".join(NAMES)
            raise InspectError(f"{log.origin}: expected messages with stamps on some of {names} for the latency, found {log.describe()}")
        self.add_spans(log)

    def add(self, name, messages):
        """Adds the row of a topic."""
        came = numpy.array([time_ns for time_ns, _ in messages])
        stamps = numpy.array([stamp_ns(message.header.stamp) for _, message in messages])
        self.ages_s[name] = 1e-9 * (came - stamps)
        # Periods are those of the stamps, because a recorder or Python may take several messages at once.
        periods = 1e-9 * numpy.diff(stamps)
        span = periods.sum()
        self.rows.append(
            {
                "topic": name, "count": len(messages), "rate_hz": float(len(periods) / span) if span > 0 else None,
                "period": percentiles_ms(periods), "age": percentiles_ms(self.ages_s[name]),
            }
        )  # fmt: skip

    def add_spans(self, log):
        """Adds the ages of the inputs of observations, and the times from targets to their answers."""
        for what, field in (("keypoints used by a step", "keypoints_stamp"), ("pose used by a step", "pose_stamp")):
            of = [1e-9 * (stamp_ns(m.header.stamp) - stamp_ns(getattr(m, field))) for _, m in log.get(OBSERVATION[0])]
            if of:
                self.spans_s[what] = numpy.array(of)
        sent = {stamp_ns(m.header.stamp): time_ns for time_ns, m in log.get(TARGET[0])}
        answered = [1e-9 * (time_ns - sent[stamp]) for time_ns, m in log.get(ACCEPTED[0]) if (stamp := stamp_ns(m.header.stamp)) in sent]
        if answered:
            self.spans_s["target to its answer"] = numpy.array(answered)

    def data(self):
        spans = [{"what": what, "count": len(values), **percentiles_ms(values)} for what, values in self.spans_s.items()]
        return {"topics": self.rows, "spans": spans}

    def text(self):
        rows = [
            (
                r["topic"], r["count"], r["rate_hz"], r["period"]["p50_ms"], r["period"]["p99_ms"], r["period"]["max_ms"],
                r["age"]["p50_ms"], r["age"]["p99_ms"], r["age"]["max_ms"],
            )
            for r in self.rows
        ]  # fmt: skip
        heads = ("topic", "count", "Hz", "period p50 ms", "p99", "max", "age p50 ms", "p99", "max")
        lines = [f"{self.origin}: age is from the stamp, the measurement, to the arrival here or in the bag", table(heads, rows)]
        if self.spans_s:
            spans = [(s["what"], s["count"], s["p50_ms"], s["p99_ms"], s["max_ms"]) for s in self.data()["spans"]]
            lines += ["", table(("time", "count", "p50 ms", "p99", "max"), spans)]
        return "\n".join(lines)

    def draw_picture(self, figure):
        """Draws the cumulative distribution of the ages."""
        axis = figure.subplots()
        for what, values in (self.ages_s | self.spans_s).items():
            style = "--" if what in self.spans_s else "-"
            axis.step(1e3 * numpy.sort(values), numpy.linspace(0, 100, len(values)), where="post", label=what, linestyle=style)
        # The axis ends near the 99th percentile, because a few late messages would hide the others.
        most = max(float(numpy.quantile(values, 0.99)) for values in (self.ages_s | self.spans_s).values())
        axis.set(xlabel="age when it came, ms (dashed: the time named)", ylabel="messages, %", xlim=(0, max(1.1e3 * most, 1)))
        axis.set_title("up to the latest 1 %")
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small")


def report(log, _options):
    return Report(log)
