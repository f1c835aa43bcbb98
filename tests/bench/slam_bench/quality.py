"""Do report.json's figures, which know no truth, tell good runs from bad ones? Rank correlation with the true error."""
import statistics

from . import metrics

FIGURES = {
    "walls, median sigma": lambda r: r["walls"]["sigma_p50_m"],
    "walls, 95 % sigma": lambda r: r["walls"]["sigma_p95_m"],
    "undecided share": lambda r: r["map"]["undecided_share"],
    "bend": lambda r: r["bend_m"],
    "bound of sigma": lambda r: r["sigma_bound_m"],
    "degenerate share": lambda r: r["degenerate_share"],
    "breaks": lambda r: r["breaks"],
    "loop residual, median m": lambda r: residual(r, "distance_m"),
    "loop residual, median sigmas": lambda r: residual(r, "sigmas"),
    "loop contradiction, largest": lambda r: max((x["contradiction"] for x in r["loops"]["residuals"]), default=None),
    "loops confirmed a sub-map": lambda r: r["loops"]["confirmed"] / max(1, len(r["submaps"])),
}


def residual(report, key):
    values = [loop[key] for loop in report["loops"]["residuals"]]
    return statistics.median(values) if values else None


def correlations(outcomes):
    """[(figure, rank correlation with the RMSE or None, runs that have both)]"""
    found = []
    for name, value in FIGURES.items():
        pairs = [(value(o.report), o.score["rmse_m"]) for o in outcomes if o.score.get("rmse_m") is not None]
        pairs = [pair for pair in pairs if pair[0] is not None]
        found.append((name, metrics.spearman([x for x, _ in pairs], [y for _, y in pairs]), len(pairs)))
    return found
