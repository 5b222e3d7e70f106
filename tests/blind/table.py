"""Tables of a score, as text."""


def percent(share):
    """Share with its interval: "80 % of 516 (76 % to 83 %)"."""
    if share["share"] is None:
        return "-"
    low, high = share["interval"]
    return f"{share['share']:.0%} of {share['of']} ({low:.0%} to {high:.0%})"


def counted(instead):
    """Other answers with their numbers, the most frequent first."""
    return "".join(f", {what} {n}" for what, n in instead.items())


def text(found):
    lines = [f"scored by the rules {found['rules']}"]
    lines.append(f"false alarms  {percent(found['false_alarms'])}, p-values uniform: p = {found['p_uniform']}")
    lines += [f"  {name} objects  {percent(share)}" for name, share in found["false_alarms_by_object"].items()]
    for what, key in (("false names", "false_names"), ("additional names", "additional_names")):
        lines.append(f"{what}  {percent(found[key]['all'])}")
        lines += [f"  {kind}  {percent(share)}" for kind, share in found[key].items() if kind != "all"]
    beside, others = (percent(found["coverage"][key]) for key in ("structured", "others"))
    lines.append(f"named magnitudes within their 90 % interval  {others}, beside a residual {beside}")
    for size, row in found["sizes"].items():
        detected, top_1, top_3, group = (percent(row[key]) for key in ("detected", "top_1", "top_3", "group"))
        closed = found["gap_closed"][size]
        lines.append(f"{size} x  detected {detected}, top-1 {top_1}, top-3 {top_3}, group {group}, gap closed {closed}")
        present, repaired = map(percent, found["held"][size])
        lines.append(f"{size} x, named  object held by the present model {present}, by the repaired one {repaired}")
    detected, top_1, group = (percent(found["pairs"][key]) for key in ("detected", "top_1", "group"))
    lines.append(f"pairs  detected {detected}, both named {top_1}, in groups {group}")
    lines += [f"  {name}  {percent(row)}{counted(row['instead'])}" for name, row in found["each_pair"].items()]
    lines += text_of_structured(found["structured"], found["templates"])
    lines.append(f"calibration error  {found['calibration_error']}")
    lines += [f"  said {said:.2f}: present {true:.2f} of {n}" for said, true, n in found["bins"]]
    lines += ["", *table_of_effects(found["effects"]), ""]
    lines.append("could not be drawn: " + (", ".join(f"{name} {n}" for name, n in found["left_out"].items()) or "none"))
    lines.append(f"{found['worlds']} worlds, {found['wall_s']:.0f} s each")
    return "\n".join(lines)


def text_of_structured(structured, templates):
    """Lines on the worlds with a residual that no effect is."""
    lines = []
    for which, words in (("ruled", "kinds that rules were made on"), ("fresh", "fresh kinds")):
        none, left = percent(structured["none_of_these"][which]), percent(structured["left"][which])
        lines.append(f"none of these, {words}  {none}, or a residual left {left}")
    lines += [f"  {name}  {percent(row)}{counted(row['instead'])}" for name, row in structured["each"].items()]
    for count, row in structured["beside"].items():
        in_part, left, false = (percent(row[key]) for key in ("in_part", "left", "false"))
        lines.append(f"a residual beside {count} effects  named or nearest {in_part}, residual left {left}, false names {false}")
    lines += [f"  {name}  {percent(row)}{counted(row['instead'])}" for name, row in structured["each_beside"].items()]
    told, hook, place = (percent(templates[key]) for key in ("told", "hook", "place"))
    lines.append(f"templates  told {told}, right part of the simulator {hook}, place within a tenth of the length {place}")
    return lines + [f"  {name}  {percent(row['hook'])}" for name, row in templates["each"].items()]


def table_of_effects(effects):
    """Markdown table with a row for each effect.

    A cell has the shares of worlds in which the effect was detected, named, and in a named group, the wrong answers, and the number of
    worlds that could not be drawn.
    """
    sizes = list(next(iter(effects.values()), {}))
    shares = lambda row: " / ".join(f"{row[key]['share']:.0%}" for key in ("detected", "top_1", "group")) + f" of {row['top_1']['of']}"
    left_out = lambda row: {"left out": row["left_out"]} if row["left_out"] else {}
    cell = lambda row: (shares(row) if row["top_1"]["of"] else "-") + counted(row["instead"] | left_out(row))
    lines = ["| effect | " + " | ".join(f"{size} x" for size in sizes) + " |", "|---" * (1 + len(sizes)) + "|"]
    return lines + [f"| {name} | " + " | ".join(map(cell, of.values())) + " |" for name, of in effects.items()]
