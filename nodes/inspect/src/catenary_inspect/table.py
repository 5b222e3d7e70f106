"""Tables for a terminal."""


def number(value, digits=3):
    """A figure in as many significant digits; `-` where there is none."""
    if value is None:
        return "-"
    return str(value) if isinstance(value, int | str) else f"{value:.{digits}g}"


def table(heads, rows):
    """Columns as wide as they need be; the first is flush left, the others flush right where they are figures."""
    cells = [list(map(str, heads)), *([number(cell) for cell in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(heads))]
    figures = [all(not isinstance(row[i], str) for row in rows) and bool(rows) for i in range(len(heads))]
    line = lambda row: "  ".join(c.rjust(w) if f else c.ljust(w) for c, w, f in zip(row, widths, figures)).rstrip()  # noqa: E731
    return "\n".join(map(line, cells))
