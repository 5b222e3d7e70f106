"""Figures and words of a verdict of the effect finder."""


def row_of(verdict):
    """Figures of one search, from verdict.json."""
    unseen, first = verdict["verification"], verdict["explanations"][:1]
    return {
        "verdict": verdict["verdict"],
        "found": verdict["found"],
        "nearest": verdict.get("nearest", []),
        "values": [{key: e[key] for key in ("name", "value", "sd")} for one in first for e in one["effects"]],
        "p_value": verdict["present"]["test"]["p_value"],
        "null_sets": len(verdict["present"]["test"]["null"]),
        "rmse_mm": [verdict[fit]["rmse_mm"] if verdict[fit] else None for fit in ("present", "repaired")],
        "unseen_mm": [unseen[side]["rmse_mm"] for side in ("before", "after")] if unseen else None,
        "floor_mm": unseen["floor_mm"] if unseen else None,
        "share_explained": unseen["share_explained"] if unseen else None,
        "stand_ins": {effect["name"]: effect["value"] for effect in verdict["stand_ins"]},
        "missing": verdict["missing"],
        "trade_offs": verdict["trade_offs"],
        "wall_s": verdict["wall_s"],
    }


def text(row, title):
    """Lines for a person."""
    listed = lambda groups: ", ".join(" or ".join(alike) for alike in groups)
    names = listed(row["found"]) or (f"nearest {listed(row['nearest'])}" if row["nearest"] else "nothing")
    values = ", ".join(f"{v['name']} {v['value']:.3g} +- {v['sd']:.2g}" for v in row["values"])
    arrow = lambda pair: "-" if pair is None else " -> ".join("-" if v is None else f"{v:.1f}" for v in pair) + " mm"
    # The least p-value is a bound.
    sign = "=" if row["p_value"] > 1.000001 / (1 + row["null_sets"]) else "<="
    p = f"p {sign} {row['p_value']:.3g} ({row['null_sets']} null data sets)"
    lines = [f"{title}: {row['verdict']}, {names} ({values}), {p}"]
    lines.append(f"  there {arrow(row['rmse_mm'])}, unseen {arrow(row['unseen_mm'])}, {row['wall_s']:.0f} s")
    lines += [f"  {name} is not named: it would have to be {value:.3g}" for name, value in row["stand_ins"].items()]
    if missing := row["missing"]:
        where = ", ".join(f"{key} {missing[key]:.2f}" for key in ("place", "frequency_hz") if missing[key] is not None)
        lines.append(f"  missing: {missing['hook']} ({missing['probability']:.2f}), like a {missing['title']} {where}".rstrip())
    lines += [f"  {' and '.join(t['between'])} trade off, correlation {t['correlation']:.2f}" for t in row["trade_offs"]]
    return "\n".join(lines)
