# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables and plots in Markdown, written between markers so that the text around them stays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL import Image

Curve = tuple[Sequence[float], Sequence[float]]

_COLORS = ["#1f5fa8", "#c2571a", "#2a8a57", "#8a4fa3", "#7a7a7a"]


def table(head: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> str:
    """Return a Markdown table; columns after the first `words` are aligned to the right."""
    rule = [*["---"] * words, *["---:"] * (len(head) - words)]
    return "\n".join("| " + " | ".join(line) + " |" for line in [head, rule, *rows])


@dataclass(frozen=True)
class Target:
    """A number that is to stay below (or, with `at_least`, above) a bound."""

    what: str
    measured: float
    bound: float
    form: str = "{:.2f}"
    at_least: bool = False

    def row(self) -> list[str]:
        """Return the target's line in a table."""
        met = self.measured >= self.bound if self.at_least else self.measured <= self.bound
        bound = ("at least " if self.at_least else "at most ") + self.form.format(self.bound)
        return [self.what, bound, self.form.format(self.measured), "yes" if met else "**no**"]


def targets(rows: Iterable[Target]) -> str:
    """Return a table of targets and whether each one is met."""
    return table(["", "target", "measured", "met"], [target.row() for target in rows])


class Page:
    """A Markdown page with generated sections and plots; without a path it only prints.

    A section stands between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``; plots and pictures
    go into the folder ``images/PICTURES`` beside the page.
    """

    def __init__(self, path: Path | None, pictures: str = "benchmarks") -> None:
        self._path = path
        self._pictures = pictures

    def write(self, section: str, text: str) -> None:
        """Print a section and put it into its place in the page."""
        print(f"\n== {section} ==\n\n{text}\n", flush=True)
        if not self._path:
            return
        begin, end = f"<!-- begin {section} -->", f"<!-- end {section} -->"
        old = self._path.read_text(encoding="utf-8")
        pattern = re.escape(begin) + ".*?" + re.escape(end)
        new, found = re.subn(pattern, lambda _: f"{begin}\n\n{text}\n\n{end}", old, flags=re.DOTALL)
        if found != 1:
            raise SystemExit(f"{self._path} has no place for {section}: add {begin} and {end}.")
        self._path.write_text(new, encoding="utf-8")

    def plot(
        self,
        name: str,
        curves: dict[str, Curve],
        x_label: str,
        y_label: str,
        guide: str = "",
        x_scale: str = "log",
        y_scale: str = "log",
    ) -> str:
        """Draw curves; return the Markdown that shows the picture.

        `guide` names a dashed line of slope 1 through the first curve's first point.
        """
        if not self._path:
            return ""
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
        from matplotlib.ticker import LogLocator, NullFormatter

        figure, axes = pyplot.subplots(figsize=(6.4, 4.0), dpi=100, layout="constrained")
        for color, (label, (x, y)) in zip(_COLORS, curves.items(), strict=False):
            axes.plot(x, y, "o-", color=color, label=label, markersize=4, linewidth=1.8)
        if guide:
            x, y = next(iter(curves.values()))
            line = [y[0] * value / x[0] for value in x]
            axes.plot(x, line, "--", color="#999999", linewidth=1.2, label=guide, zorder=0)
        axes.set_xscale(x_scale)
        axes.set_yscale(y_scale)
        axes.xaxis.set_major_formatter("{x:,.12g}")
        if y_scale == "log":
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.grid(True, which="major", color="#e3e3e3", linewidth=0.8)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False)
        figure.savefig(self._file(name), metadata={"Software": None})
        pyplot.close(figure)
        from PIL import Image

        with Image.open(self._file(name)) as drawn:
            few = drawn.convert("RGB").quantize(48)  # a third of the bytes
        few.save(self._file(name), optimize=True)
        return self._shown(name, f"{y_label} against {x_label}")

    def picture(self, name: str, image: Image.Image, about: str) -> str:
        """Store a picture; return the Markdown that shows it."""
        if not self._path:
            return ""
        image.save(self._file(name), optimize=True)
        return self._shown(name, about)

    def _file(self, name: str) -> Path:
        folder = self._path.parent / "images" / self._pictures
        folder.mkdir(parents=True, exist_ok=True)
        return folder / f"{name}.png"

    def _shown(self, name: str, about: str) -> str:
        return f"\n\n![{about}](images/{self._pictures}/{name}.png)"
