"""The figures, PNG and SVG: mean and 95 % interval over seeds, told apart by marker and line, not by colour alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gameopt_sumo.compare.computation import Computation
from gameopt_sumo.compare.results import Entry, Figure, figure
from gameopt_sumo.compare.views import Metric, View, ablations, in_order, views

FOLDER = "plots"
_MARKERS = "osD^vPX<>*hd"
_LINES = ("-", "--", "-.", ":")
_SHADES = ("#000000", "#0098c8", "#8c2d04", "#9a6a15", "#08306b", "#5cb87a", "#606060")
"""Dark enough for white paper; of different lightness, so that they stay apart where there is no colour."""


def draw(out: Path, entries: Sequence[Entry], computation: Computation | None) -> list[str]:
    """Draw every figure there are runs for; the names, without .png and .svg, in the order of the page."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "gameopt"  # the same data, the same file
    folder = out / FOLDER
    folder.mkdir(exist_ok=True)
    names = []
    for view in views(entries):
        styles = _styles(list(view.series))
        for metric in view.metrics:
            names += _save(folder, f"{view.name}-{metric.name}", _series_figure(view, metric, styles))
    for flow, group in ablations(entries).items():
        names += _save(folder, f"ablation-{flow:g}", _ablation_figure(group))
    if computation is not None and computation.decisions:
        names += _save(folder, "computation", _computation_figure(computation))
    return names


def _styles(methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    return {method: _style(k) for k, method in enumerate(in_order(methods))}


def _style(k: int) -> dict[str, Any]:
    """The k-th look: no two of a dozen share marker and line."""
    shade = _SHADES[k % len(_SHADES)]
    return {
        "marker": _MARKERS[k % len(_MARKERS)],
        "linestyle": _LINES[k % len(_LINES)],
        "color": shade,
        "markerfacecolor": shade if k % 2 == 0 else "white",
    }


def _series_figure(view: View, metric: Metric, styles: dict[str, dict[str, Any]]) -> Any:
    """A line a method; None if no run has the figure."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(6.4, 4.4), layout="constrained")
    axes = canvas.add_subplot()
    for method, runs in view.series.items():
        points = [(x, found) for x, group in runs.items() if (found := figure(group, metric.path)) is not None]
        if points:
            xs, figures = zip(*points, strict=True)
            _error_bars(axes, xs, figures, label=method, **styles[method])
    if not axes.has_data():
        return None
    axes.set_xlabel(view.axis)
    axes.set_ylabel(metric.title)
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    return canvas


def _error_bars(axes: Any, xs: Sequence[float], figures: Sequence[Figure], **style: Any) -> None:
    halves = [found.half or 0.0 for found in figures]
    axes.errorbar(
        xs, [found.mean for found in figures], yerr=halves if any(halves) else None, capsize=3, markersize=5, **style
    )


def _ablation_figure(group: dict[str, list[Entry]]) -> Any:
    """Throughput and mean time-to-goal, one line an ablation, best read from the top."""
    from matplotlib.figure import Figure as Canvas

    names = [name for name, runs in group.items() if runs]
    canvas = Canvas(figsize=(8.0, 1.2 + 0.28 * len(names)), layout="constrained")
    axes = canvas.subplots(1, 2, sharey=True)
    shown = ("throughput_veh_min", "throughput, veh/min"), ("time_to_goal_s.mean", "mean time-to-goal, s")
    for place, (path, title) in zip(axes, shown, strict=True):
        for row, name in enumerate(names):
            if (found := figure(group[name], path)) is not None:
                marker = "s" if name.endswith("@box") else "o"
                place.errorbar(found.mean, row, xerr=found.half, fmt=marker, color="black", capsize=3)
        place.set_xlabel(title)
        place.grid(alpha=0.3)
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    return canvas


def _computation_figure(computation: Computation) -> Any:
    """Decision time against vehicles on logarithmic axes, with the growth that fits it best."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(6.4, 4.4), layout="constrained")
    axes = canvas.add_subplot()
    for k, (label, points) in enumerate(computation.lines().items()):
        style: dict[str, Any] = {
            "marker": _MARKERS[k],
            "linestyle": _LINES[k % len(_LINES)],
            "color": _SHADES[k % len(_SHADES)],
        }
        axes.plot([n for n, _ in points], [ms for _, ms in points], label=label, **style)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("vehicles")
    axes.set_ylabel("time of a decision, ms")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize="small")
    return canvas


def _save(folder: Path, name: str, canvas: Any) -> list[str]:
    if canvas is None:
        return []
    canvas.savefig(folder / f"{name}.png", dpi=150)
    canvas.savefig(folder / f"{name}.svg", metadata={"Date": None})
    return [name]
