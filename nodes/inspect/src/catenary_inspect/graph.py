"""Report of the graph: nodes, topics, rates, and QoS profiles that do not fit."""

from .message_log import InspectError
from .table import table

NAMES, NEEDED = None, []
# Time after the begin of listening in which latched messages come at once.
BURST_NS = 500_000_000


class Report:
    """Report with a row for each topic."""

    def __init__(self, log):
        self.origin, self.nodes = log.origin, log.nodes
        if not log.channels:
            raise InspectError(f"{log.origin}: expected topics, found none")
        self.rows = [row_of(name, channel) for name, channel in sorted(log.channels.items())]

    def data(self):
        return {"nodes": self.nodes, "topics": self.rows}

    def text(self):
        lines = [f"{self.origin}: {len(self.rows)} topics" + (f", {len(self.nodes)} nodes" if self.nodes else "")]
        short = lambda names: ", ".join(name.lstrip("/") for name in names) or "-"
        rows = [
            (r["name"], r["type"], r["count"], r["rate_hz"], r["kb_per_s"], r["profile"], short(r["publishers"]), short(r["subscriptions"]))
            for r in self.rows
        ]
        heads = ["topic", "type", "count", "Hz", "kB/s", "profile", "published by", "subscribed by"]
        if not self.nodes:
            heads, rows = heads[:6], [row[:6] for row in rows]
        lines.append(table(heads, rows))
        lines += [f"problem: {problem}" for row in self.rows for problem in row["problems"]]
        return "\n".join(lines)

    def draw_picture(self, figure):
        """Draws publishers, topics and subscribers from left to right; for a bag, bars of its topics' messages."""
        axis = figure.subplots()
        if not self.nodes:
            rows = [r for r in self.rows if r["count"]][::-1]
            axis.barh([r["name"] for r in rows], [r["count"] for r in rows], color="#4477aa")
            for i, r in enumerate(rows):
                axis.text(r["count"], i, f" {r['rate_hz']:.1f} Hz" if r["rate_hz"] else "", va="center", fontsize="small")
            axis.set(xlabel="messages", xscale="log", title=self.origin)
            axis.margins(x=0.15)
            return
        axis.axis("off")
        rows = [r for r in self.rows if r["name"] not in ("/rosout", "/diagnostics") and (r["publishers"] or r["subscriptions"])]
        nodes = sorted({n for r in rows for n in (*r["publishers"], *r["subscriptions"])})
        height = lambda names, i: 1 - (i + 0.5) / len(names)
        at = {node: height(nodes, i) for i, node in enumerate(nodes)}
        box = {"boxstyle": "round", "facecolor": "#eeeeee", "edgecolor": "#888888"}
        for node in nodes:
            for x, key in ((0.0, "publishers"), (1.0, "subscriptions")):
                if any(node in r[key] for r in rows):
                    axis.text(x, at[node], node.lstrip("/"), ha="right" if x == 0 else "left", va="center", bbox=box)
        for i, r in enumerate(rows):
            y = height(rows, i)
            colour = "#cc3311" if r["problems"] else "#4477aa"
            rate = f"  {r['rate_hz']:.0f} Hz" if r["rate_hz"] else ""
            axis.text(0.5, y, r["name"] + rate, ha="center", va="center", fontsize="small", color=colour)
            for node in r["publishers"]:
                arrow(axis, (0.02, at[node]), (0.28, y), "#4477aa")
            for node in r["subscriptions"]:
                arrow(axis, (0.72, y), (0.98, at[node]), "#cc3311" if node in r["deaf"] else "#4477aa")
        axis.set(xlim=(-0.2, 1.2), ylim=(0, 1))
        figure.suptitle(f"{self.origin}, without /rosout and /diagnostics; red: hears nothing, as the profiles do not fit")


def arrow(axis, start, end, colour):
    axis.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "alpha": 0.7})


def row_of(name, channel):
    """Figures of a topic."""
    # Latched messages at the begin would raise the rate.
    flowing = [pair for pair in channel.messages if not channel.since_ns or pair[0] > channel.since_ns + BURST_NS]
    times = [time_ns for time_ns, _ in flowing]
    span_s = 1e-9 * (times[-1] - times[0]) if len(times) > 1 else 0
    profiles = sorted({f"{p.reliability}, {p.durability}" for p in channel.publishers})
    return {
        "name": name, "type": channel.type_name, "count": len(channel.messages),
        "rate_hz": (len(times) - 1) / span_s if span_s > 0 else None,
        "kb_per_s": 1e-3 * sum(size for _, size in flowing) / span_s if span_s > 0 else None,
        "profile": " | ".join(profiles).replace("_", " ") or "-", "publishers": sorted({p.node for p in channel.publishers if p.node}),
        "subscriptions": sorted({s.node for s in channel.subscriptions if s.node}), "deaf": sorted({s.node for s, _, _ in deaf(channel)}),
        "problems": list(problems(name, channel)),
    }  # fmt: skip


def problems(name, channel):
    """Sentences on subscriptions that hear nothing of a publisher, and on topics with several types."""
    if "," in channel.type_name:
        yield f"{name} has several types: {channel.type_name}"
    elif channel.unheard:
        yield channel.unheard
    for s, p, policy in deaf(channel):
        asked, offered = (getattr(end, policy).replace("_", " ") for end in (s, p))
        yield f"{name}: {s.node or 'a node'} asks for {asked} and hears nothing of {p.node}, which offers {offered}"


def deaf(channel):
    """Triples of a subscription, a publisher that offers less than it asks for, and the policy."""
    for s in channel.subscriptions:
        for p in channel.publishers:
            if s.reliability == "reliable" and p.reliability == "best_effort":
                yield s, p, "reliability"
            if s.durability == "transient_local" and p.durability == "volatile":
                yield s, p, "durability"


def report(log, _options):
    return Report(log)
