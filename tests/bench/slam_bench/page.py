"""The table: on the terminal, and between the markers of README.md."""
import dataclasses
import math
import re
import statistics

HEAD = ("row", "figure", "median", "worst (seed)", "must", "goal", "", "runs")


@dataclasses.dataclass
class Line:
    """One figure of one row. Text throughout."""
    row: str
    cells: tuple


def text(value, digits):
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if math.isfinite(value) else "none"


def limit(value, figure):
    return "" if value is None else ("≥ " if figure.at_least else "≤ ") + f"{value:g}"


def verdict(figure, worst, complete):
    def holds(bound):
        return worst >= bound if figure.at_least else worst <= bound
    if worst is None or figure.must is None:
        return ""
    if not holds(figure.must):
        return "MISSED"
    words = "goal" if figure.goal is not None and holds(figure.goal) else "met"
    return words if complete else words + " so far"


def lines_of(row, by_seed, problem):
    """Lines of a row. by_seed: {seed: {run name: Outcome}} of complete seeds; problem: why others are not."""
    if not by_seed:
        return [Line(row.name, (row.name, row.what, "", "", "", "", problem or "not run", ""))]
    lines = []
    for figure in row.figures:
        if figure.over_all:
            values = {0: figure.value(list(by_seed.values()))}
        else:
            values = {seed: figure.value(outcomes) for seed, outcomes in by_seed.items()}
        known = {seed: v for seed, v in values.items() if v is not None}
        runs = len(by_seed) if figure.over_all and known else len(known)
        count = f"{runs} of {row.seeds}" + (f"; {problem}" if problem not in ("", "not run") else "")
        if not known:
            lines.append(Line(row.name, (row.name, figure.name, "-", "-", limit(figure.must, figure),
                                         limit(figure.goal, figure), "", count)))
            continue
        pick = min if figure.at_least else max
        seed = pick(known, key=known.get)
        worst = text(known[seed], figure.digits) + (f" ({seed})" if len(known) > 1 else "")
        median = text(statistics.median(known.values()), figure.digits)
        judged = verdict(figure, known[seed], runs == row.seeds)
        lines.append(Line(row.name, (row.name, figure.name, median, worst, limit(figure.must, figure),
                                     limit(figure.goal, figure), judged, count)))
    return lines


def print_lines(lines):
    rows = [HEAD] + [line.cells for line in lines]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    last = None
    for cells in rows:
        shown = list(cells)
        if cells[0] == last:
            shown[0] = ""
        last = cells[0]
        print("  ".join(cell.ljust(width) for cell, width in zip(shown, widths)).rstrip())


def markdown(lines, kinds, commit):
    """{row name: its markdown lines}."""
    result = {}
    for line in lines:
        name, figure, *rest = (cell.replace("|", "/") for cell in line.cells)
        first = name not in result
        cells = [f"`{name}`" if first else "", kinds[name] if first else "", figure, *rest, commit if first else ""]
        result.setdefault(name, []).append("| " + " | ".join(cells) + " |")
    return result


def rewrite(path, name, fresh, order, head, otherwise=None):
    """Replaces rows of the table between the markers of `name`; those that are not in `fresh` stay as they are, or, if
    there are none, are those of `otherwise`."""
    page = path.read_text(encoding="utf-8")
    begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->\n"
    if begin not in page or end not in page:
        raise ValueError(f"{path}: has no markers {begin.strip()} and {end.strip()}")
    before, rest = page.split(begin, 1)
    old, after = rest.split(end, 1)
    kept, current = {}, None
    for line in old.splitlines():
        found = re.match(r"\| `([^`]+)` ", line)
        if found:
            current = found.group(1)
        if current and line.startswith("|"):
            kept.setdefault(current, []).append(line)
    kept = {**(otherwise or {}), **kept, **fresh}
    body = "".join(line + "\n" for row in order for line in kept.get(row, []))
    columns = head.count("|") - 1
    path.write_text(before + begin + head + "\n" + "|" + "---|" * columns + "\n" + body + end + after, encoding="utf-8")
