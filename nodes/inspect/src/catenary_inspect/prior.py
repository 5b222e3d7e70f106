"""Prior distributions of one parameter; the distribution function gives the parameter's unit coordinate."""

import math
import statistics

import numpy

# Names in the model file, in the order of the numbers in catenary_msgs/msg/Parameter.
KINDS = ("uniform", "log_uniform", "normal", "mixture")
# Points of the table that inverts a distribution function without a closed inverse.
GRID = 4001


def is_possible(kind, low, high, mean, sd):
    """Tells whether a prior with these numbers exists."""
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        return False
    if kind == "normal":
        return math.isfinite(mean) and 0.0 < sd < math.inf
    return low > 0.0 if kind == "log_uniform" else True


class Prior:
    """Prior with the support `low` to `high`, in the parameter's unit. A mixture has `parts`, pairs of weight and prior."""

    def __init__(self, kind, low=None, high=None, mean=None, sd=None, parts=()):
        if kind not in KINDS:
            raise ValueError(f"a prior: expected one of {', '.join(KINDS)}, found {kind}")
        if bool(parts) != (kind == "mixture"):
            wanted = "parts" if kind == "mixture" else "no parts"
            raise ValueError(f"a {kind.replace('_', '-')} prior: expected {wanted}, found {len(parts)}")
        self.kind, self.mean, self.sd, self.parts = kind, mean, sd, parts
        self.low = min(part.low for _, part in parts) if parts else float(low)
        self.high = max(part.high for _, part in parts) if parts else float(high)
        if not parts and not is_possible(kind, self.low, self.high, mean, sd):
            raise ValueError(f"a {self.name} prior: expected numbers that make one, found {low} to {high}, mean {mean}, sd {sd}")
        if parts and not (all(weight >= 0.0 for weight, _ in parts) and 0.0 < sum(weight for weight, _ in parts) < math.inf):
            raise ValueError(f"a mixture prior: expected weights of at least 0, not all of them 0, found {[weight for weight, _ in parts]}")

    @property
    def is_log(self):
        """Tells whether an axis of the parameter should be logarithmic."""
        return self.kind == "log_uniform" or (bool(self.parts) and all(part.is_log for _, part in self.parts))

    @property
    def name(self):
        return self.kind.replace("_", "-")

    def share_below(self, values):
        """Distribution function at values, between 0 and 1."""
        inside = numpy.clip(values, self.low, self.high)
        if self.kind == "uniform":
            return (inside - self.low) / (self.high - self.low)
        if self.kind == "log_uniform":
            return numpy.log(inside / self.low) / numpy.log(self.high / self.low)
        if self.kind == "normal":
            below = numpy.vectorize(statistics.NormalDist(self.mean, self.sd).cdf)
            return (below(inside) - below(self.low)) / (below(self.high) - below(self.low))
        total = sum(weight for weight, _ in self.parts)
        return sum(weight * part.share_below(values) for weight, part in self.parts) / total

    def value(self, unit):
        """Values with these unit coordinates."""
        if self.kind == "uniform":
            return self.low + (self.high - self.low) * unit
        if self.kind == "log_uniform":
            return self.low * (self.high / self.low) ** unit
        grid = self.grid()
        return numpy.interp(unit, self.share_below(grid), grid)

    def grid(self):
        """Values over the support: evenly spaced, evenly in the logarithm for log-uniform, the union of all parts for a mixture."""
        if self.parts:
            return numpy.unique(numpy.concatenate([part.grid() for _, part in self.parts]))
        return (numpy.geomspace if self.kind == "log_uniform" else numpy.linspace)(self.low, self.high, GRID)


def of_message(message):
    """Prior of a catenary_msgs/msg/Parameter or PriorPart; in older recordings they have no mean, sd and parts."""
    parts = [(part.weight, of_message(part)) for part in getattr(message, "parts", ())]
    if not 0 <= message.prior < len(KINDS):
        raise ValueError(f"a prior: expected a kind of 0 to {len(KINDS) - 1}, found {message.prior}")
    numbers = (getattr(message, name, None) for name in ("mean", "sd"))
    return Prior(KINDS[message.prior], message.low, message.high, *numbers, parts)


def of_document(document):
    """Prior of its document in posterior.json: its kind and the fields of that kind."""
    ((kind, fields),) = document.items()
    if kind == "mixture":
        return Prior(kind, parts=[(part["weight"], of_document(part["prior"])) for part in fields])
    return Prior(kind, **fields)
