"""Prior distributions of one parameter, whose distribution function gives its unit coordinate."""

import statistics

import numpy

# What the message and the model file call them, in the order of the message's numbers.
KINDS = ("uniform", "log_uniform", "normal", "mixture")
GRID = 4001


class Prior:
    """`low` and `high` bound the support, in the parameter's unit. A mixture has `parts`: pairs of weight and prior."""

    def __init__(self, kind, low=None, high=None, mean=None, sd=None, parts=()):
        if kind not in KINDS or bool(parts) != (kind == "mixture"):
            raise ValueError(f"a prior: expected one of {', '.join(KINDS)}, found {kind}")
        self.kind, self.mean, self.sd, self.parts = kind, mean, sd, parts
        self.low = min(part.low for _, part in parts) if parts else float(low)
        self.high = max(part.high for _, part in parts) if parts else float(high)

    @property
    def is_log(self):
        """Whether an axis of it is best logarithmic."""
        return self.kind == "log_uniform" or bool(self.parts) and all(part.is_log for _, part in self.parts)

    @property
    def name(self):
        return self.kind.replace("_", "-")

    def share_below(self, values):
        """Its distribution function, between 0 and 1."""
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
        grid = numpy.linspace(self.low, self.high, GRID)
        return numpy.interp(unit, self.share_below(grid), grid)


def of_message(message):
    """Of a catenary_msgs/msg/Parameter or PriorPart."""
    parts = [(part.weight, of_message(part)) for part in getattr(message, "parts", ())]
    return Prior(KINDS[message.prior], message.low, message.high, message.mean, message.sd, parts)


def of_document(document):
    """Of a prior in posterior.json: its kind and the fields of that."""
    ((kind, fields),) = document.items()
    if kind == "mixture":
        return Prior(kind, parts=[(part["weight"], of_document(part["prior"])) for part in fields])
    return Prior(kind, **fields)
