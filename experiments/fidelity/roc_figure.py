"""The ROC curves of rules of gap acceptance, as a picture."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

COLORS = ("#1f6fb4", "#6fa8d6", "#16456e", "#e08a1e", "#c0504d", "#5b8c3a", "#9dc37f", "#222222")


def write_roc_figure(rows: list[dict[str, Any]], path: Path) -> None:
    """Write the curves of `lane_change_table`; a dot marks each rule with the parameters that its source states."""
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "jaxcalib", "font.size": 9.0}):
        figure = Figure(figsize=(5.6, 5.2), layout="constrained")
        axes = figure.add_subplot(aspect="equal")
        axes.plot([0, 1], [0, 1], color="#999999", lw=0.8, ls=":")
        for row, color in zip(rows[1:], COLORS, strict=False):
            low, high = row["roc_area_interval"]
            label = f"{row['rule']}: {row['roc_area']:.2f} ({low:.2f} to {high:.2f})"
            is_rule = row.get("parameter") is not None
            axes.plot(row["roc"]["false_rate"], row["roc"]["true_rate"], color=color, lw=1.3, label=label,
                      ls="-" if is_rule else "--")  # fmt: skip
            if is_rule:
                axes.plot(row["false_rate"], row["true_rate"], "o", color=color, ms=5)
        axes.set(xlabel="share of the gaps let pass that the rule accepts", xlim=(0, 1), ylim=(0, 1),
                 ylabel="share of the gaps taken that the rule accepts")  # fmt: skip
        axes.set_title(f"{rows[0]['num_decisions']} lane-change decisions, NGSIM I-80 and US-101")
        axes.legend(frameon=False, fontsize=7.5, loc="lower right", title="area under the curve (95 %)")
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
