"""Tables for a terminal."""


def number(value, digits=3):
    """Figure with `digits` significant digits; `-` for None."""
    if value is None:
        return "-"
    return str(value) if isinstance(value, int | str) else f"{value:.{digits}g}"


def table(heads, rows):
    """Text of a table; columns of figures are flush right, all others flush left."""
    cells = [list(map(str, heads)), *([number(cell) for cell in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(heads))]
    figures = [all(not isinstance(row[i], str) for row in rows) and bool(rows) for i in range(len(heads))]
    line = lambda row: "  ".join(c.rjust(w) if f else c.ljust(w) for c, w, f in zip(row, widths, figures)).rstrip()
    return "\n".join(map(line, cells))
