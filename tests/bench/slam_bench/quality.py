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
    "loop contradiction, largest": lambda r: max((x["contradiction"] for x in r["loops"]["residuals"]), default=0.0),
    "loops pending of all": lambda r: r["loops"]["pending"] / max(1, r["loops"]["pending"] + r["loops"]["confirmed"]),
}


def residual(report, key):
    values = [loop[key] for loop in report["loops"]["residuals"]]
    return statistics.median(values) if values else 0.0


def correlations(outcomes):
    """(number of Outcomes with a true error, [(figure, rank correlation with the RMSE)])"""
    known = [o for o in outcomes if o.score.get("rmse_m") is not None]
    errors = [o.score["rmse_m"] for o in known]
    return len(known), [(name, metrics.spearman([value(o.report) for o in known], errors))
                        for name, value in FIGURES.items()]
