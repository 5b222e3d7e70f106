"""Report of episodes: actions of the policy, motion of the arm, and the end."""

import numpy
from matplotlib import colormaps

from .message_log import InspectError, stamp_ns
from .table import table
from .topics import ACCEPTED, ACTION, EVENT, KEYPOINTS, POSE, TARGET

NAMES, NEEDED = [name for name, _ in (EVENT, ACTION, TARGET, ACCEPTED, POSE, KEYPOINTS)], [EVENT[0]]
STARTED, ENDED = 0, 1


class Episode:
    """Messages between the start and the end of one episode, whose end may be missing."""

    def __init__(self, log, number, start, end):
        self.number, self.start, self.end = number, start, end
        self.from_ns = stamp_ns(start.header.stamp)
        self.to_ns = stamp_ns(end.header.stamp) if end else None
        of = lambda topic: [m for _, m in log.get(topic[0])]
        self.actions = [m for m in of(ACTION) if m.episode == number]
        self.targets, self.answers, self.poses, self.keypoints = (self.within(of(topic)) for topic in (TARGET, ACCEPTED, POSE, KEYPOINTS))

    def within(self, messages):
        """Messages stamped during the episode."""
        last_ns = float("inf") if self.to_ns is None else self.to_ns
        return [m for m in messages if self.from_ns <= stamp_ns(m.header.stamp) <= last_ns]

    def seconds(self, message):
        """Seconds from the start to a message's stamp."""
        return 1e-9 * (stamp_ns(message.header.stamp) - self.from_ns)

    def data(self):
        """Figures for JSON."""
        rejected = [a for a in self.answers if not a.accepted]
        clipped = [a for a in self.answers if a.clipped_x or a.clipped_y or a.clipped_z]
        return {
            "episode": self.number, "policy": self.start.policy, "seed": int(self.start.seed),
            "step_period_s": float(self.start.step_period), "actions": len(self.actions),
            "duration_s": None if self.to_ns is None else 1e-9 * (self.to_ns - self.from_ns),
            "end": self.end.reason if self.end else "none was seen", "return": float(self.end.episode_return) if self.end else None,
            "rejected": len(rejected), "clipped": len(clipped), "poses": len(self.poses), "keypoints": len(self.keypoints),
            "rejections": sorted({a.reason for a in rejected}),
        }  # fmt: skip

    def steps(self):
        """Row for each action: step, time (s), dx and dz (mm), x and z of the target, and x and z reached a step later (m)."""
        times = numpy.array([self.seconds(p) for p in self.poses])
        rows = []
        for action in self.actions:
            at = self.seconds(action)
            target = next((t for t in self.targets if self.seconds(t) >= at - 1e-6), None)
            later = int(numpy.searchsorted(times, at + self.start.step_period)) if len(times) else 0
            reached = self.poses[min(later, len(times) - 1)].pose.position if len(times) else None
            place = lambda p: (None, None) if p is None else (float(p.x), float(p.z))
            rows.append((int(action.step), at, 1e3 * action.dx, 1e3 * action.dz, *place(target and target.pose.position), *place(reached)))
        return rows


class Report:
    """Report of all `episodes`, with the steps of the one `shown`."""

    def __init__(self, log, wanted):
        events = [m for _, m in log.need(*EVENT, "episodes")]
        self.origin = log.origin
        starts = {m.episode: m for m in events if m.event == STARTED}
        ends = {m.episode: m for m in events if m.event == ENDED}
        if not starts:
            raise InspectError(f"{log.origin}: {EVENT[0]}: expected the start of an episode, found {len(ends)} ends and no start")
        self.episodes = [Episode(log, number, start, ends.get(number)) for number, start in starts.items()]
        numbers = list(starts)
        if wanted is not None and wanted not in starts:
            raise InspectError(f"--episode {wanted}: expected an episode of {log.origin}, which has {', '.join(map(str, numbers))}")
        # Episodes from before the begin of listening have latched events, but no actions.
        told = [e for e in self.episodes if e.actions] or self.episodes
        self.shown = next(e for e in self.episodes if e.number == wanted) if wanted is not None else told[-1]

    def data(self):
        heads = ("step", "time_s", "dx_mm", "dz_mm", "target_x_m", "target_z_m", "reached_x_m", "reached_z_m")
        steps = [dict(zip(heads, row)) for row in self.shown.steps()]
        return {"episodes": [e.data() for e in self.episodes], "shown": self.shown.number, "steps": steps}

    def text(self):
        rows = []
        for d in (e.data() for e in self.episodes):
            answers = f"{d['rejected']} rejected, {d['clipped']} clipped"
            rows.append((d["episode"], d["policy"], d["seed"], d["duration_s"], d["actions"], d["return"], answers, d["end"]))
        heads = ("episode", "policy", "seed", "s", "steps", "return", "targets", "end")
        lines = [f"{self.origin}: {len(rows)} episodes", table(heads, rows), "", f"steps of episode {self.shown.number}"]
        steps = ("step", "s", "dx mm", "dz mm", "target x m", "z m", "reached x m", "z m")
        rounded = [(s, round(t, 2), round(dx, 1), round(dz, 1), *places) for s, t, dx, dz, *places in self.shown.steps()]
        lines.append(table(steps, rounded) if rounded else f"no message on {ACTION[0]}")
        lines += [f"rejected: {reason}" for reason in self.shown.data()["rejections"]]
        return "\n".join(lines)

    def draw_picture(self, figure):
        """Draws the path in the arm's plane, its coordinates over time, the actions, and the keypoints in the image."""
        (plane, over_time), (acted, image) = figure.subplots(2, 2)
        self.draw_arm(plane, over_time)
        e = self.shown
        steps = [a.step for a in e.actions]
        for offset, name, colour in ((-0.2, "dx", "#4477aa"), (0.2, "dz", "#ee6677")):
            acted.bar([s + offset for s in steps], [1e3 * getattr(a, name) for a in e.actions], 0.4, color=colour, label=name)
        acted.axhline(0, color="black", linewidth=0.5)
        acted.set(xlabel="step", ylabel="action, mm", title="actions")
        acted.locator_params(axis="x", integer=True)
        if steps:
            acted.legend(fontsize="small")
        self.draw_image(image)
        d = e.data()
        earned = "" if d["return"] is None else f", return {d['return']:.3f}"
        figure.suptitle(f"Episode {e.number}, policy {d['policy']}: {d['end']}{earned}")

    def draw_arm(self, plane, over_time):
        e = self.shown
        x, z = ([getattr(p.pose.position, axis) for p in e.poses] for axis in "xz")
        times = [e.seconds(p) for p in e.poses]
        plane.plot(x, z, color="#bbbbbb")
        if times:
            dots = plane.scatter(x, z, c=times, s=4, cmap="viridis")
            plane.figure.colorbar(dots, ax=plane, label="time, s")
        plane.plot([t.pose.position.x for t in e.targets], [t.pose.position.z for t in e.targets], "x", color="#ee6677", label="targets")
        plane.set(xlabel="x, m", ylabel="z, m", title="end effector in panda_link0", aspect="equal")
        plane.margins(0.1)
        plane.locator_params(axis="x", nbins=5)
        if e.targets:
            plane.legend(fontsize="small")
        # The last target holds to the end.
        target_times = [e.seconds(t) for t in e.targets] + times[-1:] if e.targets else []
        for axis, values, colour in (("x", x, "#4477aa"), ("z", z, "#ee6677")):
            over_time.plot(times, values, color=colour, label=axis)
            wanted = [getattr(t.pose.position, axis) for t in (e.targets + e.targets[-1:] if times else e.targets)]
            over_time.step(target_times, wanted, where="post", color=colour, linestyle=":", label=f"target {axis}")
        over_time.set(xlabel="time, s", ylabel="m", title="measured and commanded")
        over_time.legend(fontsize="small")

    def draw_image(self, image):
        e = self.shown
        image.set(xlabel="u, px", ylabel="v, px", title="object in the image")
        if not e.keypoints:
            image.text(0.5, 0.5, f"no message on {KEYPOINTS[0]}", ha="center", transform=image.transAxes)
            return
        shown = e.keypoints[:: max(1, len(e.keypoints) // 25)]
        last = max(e.seconds(e.keypoints[-1]), 1e-9)
        for k in shown:
            image.plot(k.dlo_u, k.dlo_v, marker=".", linewidth=0.8, color=colormaps["viridis"](e.seconds(k) / last))
        image.plot([e.keypoints[-1].target_u], [e.keypoints[-1].target_v], "*", color="#ee6677", markersize=12, label="target")
        image.set(xlim=(0, e.keypoints[-1].image_width), ylim=(e.keypoints[-1].image_height, 0), aspect="equal")
        image.legend(fontsize="small")


def is_complete(log):
    """Tells whether an episode ended of which an action was heard."""
    events = [m for _, m in log.get(EVENT[0])]
    acted = {m.episode for _, m in log.get(ACTION[0])}
    return any(m.event == ENDED and m.episode in acted for m in events)


def report(log, options):
    return Report(log, options.episode)
