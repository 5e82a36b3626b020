"""`cableway evaluate`: how far deformation models can look ahead on data sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Group
from rich.markup import escape
from rich.text import Text

from cableway.cli.options import REPORT, PictureOptions, option
from cableway.cli.terminal import Terminal, columns

if TYPE_CHECKING:
    from rich.table import Table

    from cableway.figures.style import Figure
    from cableway.tang2025.models.base import DeformationModel
    from cableway.tang2025.models.evaluation import Curve

SHOWN = (1, 5, 10, 20, 30, 50)
"""Horizons [steps] in the table; the JSON file has all."""

FIGURES = ("median", "mean", "p95")
"""Columns of the table."""

CAPTION = (
    "Stacked error in mm after so many steps of open-loop prediction, with 95% intervals by resampling episodes. "
    "Windows of episodes: {counts} steps."
)

BASELINES = ("linear",)
"""Shipped models that stand in every comparison, beside those that learn nothing."""


@dataclass(frozen=True, kw_only=True)
class Evaluate(PictureOptions):
    """Open-loop error of models on data sets against the horizon; models that differ in their seed are one."""

    models: Annotated[tyro.conf.Positional[tuple[str, ...]], option(metavar="[MODEL ...]")] = ()
    """Shipped models (bilstm, conv, hybrid, linear, mlp, rod, transformer, tang2025-bdm, tang2025-cdm, tang2025-tdm),
    or files; by default, all shipped ones."""

    data: tuple[Path, ...] = (Path("runs/collect"),)
    """Data sets from `cableway collect`, or recordings (CSV, NPZ, YAML), that the models were not trained on."""

    horizon: int = 50
    """Longest horizon in control steps."""

    def execute(self) -> int:
        """Carry the command out and return its exit status."""
        from cableway.core.files import only_writer, write_json
        from cableway.core.provenance import commit, versions
        from cableway.datasets.reading import load_transitions
        from cableway.datasets.recordings import in_words, is_recording
        from cableway.tang2025.models.compilation import enable_compilation_cache
        from cableway.tang2025.models.dataset import fingerprint
        from cableway.tang2025.models.evaluation import compare

        terminal, folder = Terminal(self), self.folder("evaluate")
        sets = {str(path): load_transitions(path) for path in self.data}
        recordings = {name: data.metadata["config"] for name, data in sets.items() if is_recording(name)}
        for made in recordings.values():
            terminal.note(in_words(made))
        models, digests = self._models(), {name: fingerprint(data) for name, data in sets.items()}
        trained_on = self._trained_on(digests)
        for name, learned in trained_on.items():
            terminal.note(f"{', '.join(learned)}: trained on {name}; errors on it say little about other motions.")
        enable_compilation_cache()
        results: dict[str, dict[str, Curve]] = {}
        with only_writer(folder), terminal.progress() as progress:
            for place, (name, data) in enumerate(sets.items()):
                results[name] = {}
                for count, (model, trained) in enumerate(models.items()):
                    progress("evaluate", (place + count / len(models)) / len(sets))
                    results[name] |= compare({model: trained}, data, self.horizon)
            progress("evaluate", 1.0)
            report = {
                "horizon": self.horizon,
                "models": {name: len(trained) for name, trained in models.items()},
                "data": {
                    name: {
                        "sha256": digests[name],
                        "trained_on_it": trained_on.get(name, []),
                        "transitions": len(data),
                        **({"recording": recordings[name]} if name in recordings else {}),
                        "errors_mm": {model: asdict(curve) for model, curve in results[name].items()},
                    }
                    for name, data in sets.items()
                },
                "commit": commit(),
                "versions": versions(),
            }
            write_json(folder / REPORT, report)
            for place, curves in enumerate(results.values(), start=1):
                self.draw(_figure(curves), folder / ("errors.png" if len(results) == 1 else f"errors-{place}.png"))
        terminal.result(report, _tables(results))
        return 0

    def _trained_on(self, digests: Mapping[str, str]) -> dict[str, list[str]]:
        """Which of the models were trained on a data set, for each on which some were."""
        from cableway.tang2025.models.checkpoint import model_names, read_card

        trained = {name: read_card(name).get("data", {}).get("sha256") for name in self.models or model_names()}
        learned = {name: [m for m, made_of in trained.items() if made_of == digest] for name, digest in digests.items()}
        return {name: models for name, models in learned.items() if models}

    def _models(self) -> dict[str, list[DeformationModel]]:
        """Models by name, those that learn nothing last; trainings with other seeds under one name."""
        from cableway.tang2025.models.checkpoint import load_model, model_names, read_card
        from cableway.tang2025.models.evaluation import baselines, training_groups

        wanted = list(dict.fromkeys([*(self.models or model_names()), *BASELINES]))
        loaded = {name: load_model(name) for name in wanted}
        groups = training_groups({name: read_card(name) for name in loaded})
        return {
            **{name: [loaded[one] for one in trained] for name, trained in groups.items()},
            **{name: [model] for name, model in baselines().items()},
        }


def _figure(curves: Mapping[str, Curve]) -> Figure:
    from cableway.figures.learning import horizon_figure

    horizons = next(iter(curves.values())).horizons
    means = {name: curve.mean for name, curve in curves.items()}
    bands = {name: curve.quartiles for name, curve in curves.items()}
    return horizon_figure(horizons, means, bands)


def _tables(results: Mapping[str, Mapping[str, Curve]]) -> Group:
    return Group(*(_table(name, curves) for name, curves in results.items()))


def _table(data: str, curves: Mapping[str, Curve]) -> Table:
    first = next(iter(curves.values()))
    shown = [h for h in SHOWN if h in first.horizons]
    counts = [f"{first.windows[h - 1]} of {first.episodes[h - 1]} at {h}" for h in shown]
    table = columns("model", "steps", *FIGURES, caption=CAPTION.format(counts=", ".join(counts)))
    table.title, table.title_justify = escape(data), "left"
    for name, curve in curves.items():
        label = f"{name} ({curve.trainings} seeds)" if curve.trainings > 1 else name
        for place, horizon in enumerate(shown):
            cells = [_cell(curve, figure, horizon) for figure in FIGURES]
            table.add_row(Text("" if place else label), f"{horizon}", *cells, end_section=horizon == shown[-1])
    return table


def _cell(curve: Curve, figure: str, horizon: int) -> str:
    low, high = curve.interval(figure, horizon)
    between = "" if low is None or high is None else f" ({_short(low)}-{_short(high)})"
    return f"{_short(curve.at(horizon)[figure])}{between}"


def _short(value: float) -> str:
    """Three digits, of small values two decimals."""
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}"
