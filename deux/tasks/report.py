"""`task=report`: write a report of finished runs, with the tables and figures of the paper."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig

from deux.configuration import compose, config_folders, group_files, run_folder, sections_of, user_path
from deux.errors import DeuxError, counted, printable
from deux.figures.drawing import save_figure
from deux.io.atomic import make_folder, write_atomically
from deux.metrics.tables import markdown_text
from deux.registry import registry
from deux.report.conditions import FlatOptions, conditions
from deux.report.contents import Contents, read_contents
from deux.report.display_names import DisplayNames
from deux.report.page import html_page
from deux.report.report_figures import CaptionedFigure, draw_error_against_frames, draw_runs
from deux.report.run_archive import archive_runs
from deux.tasks.console import say

MOST_MISSING = 12
"""Maximal number of lines about missing runs that are printed for each table."""


@dataclass(frozen=True)
class ReportSettings:
    """Options of the report.

    Args:
        runs: a folder with runs and sweeps below it.
        keep: a folder to which the small files of the finished runs and sweeps are copied, such as docs/results/houses;
            a report of it equals the report of the runs. None copies nothing.
        first: the dataset of Table I; None for the one on which the most explorers were compared.
        transferred: explorers whose models, trained on the first dataset, are also shown in Table II.
        baseline: one or several explorers that the others of Table I are compared with, seed by seed; None for none.
        models: display names of the depth models, in the order of the columns.
        explorers: display names of the explorers, in the order of the rows, in groups separated by a line.
    """

    runs: str | None
    keep: str | None
    first: str | None
    transferred: tuple[str, ...]
    baseline: str | tuple[str, ...] | None
    models: Mapping[str, str]
    explorers: tuple[Mapping[str, str], ...]


def run(cfg: DictConfig) -> None:
    """Write a report of the runs and sweeps below `report.runs`, finished or not, overwriting an earlier one."""
    settings = sections_of(cfg).read("report", ReportSettings)
    if not settings.runs:
        raise DeuxError("task=report needs runs: set report.runs= to a folder with runs or sweeps, such as outputs.")
    runs = user_path(settings.runs)
    names = DisplayNames(settings.models, settings.explorers)
    contents = read_contents(runs, names, settings.first, settings.transferred, settings.baseline, explorer_presets())
    shown = {explorer.name for section in contents.sections for explorer in section.runs.explorers}
    baselines = (settings.baseline,) if isinstance(settings.baseline, str) else settings.baseline or ()
    for name in {*settings.transferred, *baselines} - shown:
        registry().find("explorers", name)  # raises an error that suggests similar names
    if settings.keep:
        target = user_path(settings.keep)
        count, size = archive_runs(runs, target)
        say(f"Copied the small files of {counted(count, 'run')} to {target}, {size / 1000:.1f} kB in the largest run")
    folder = run_folder()
    figures = draw(contents, names, folder / "figures")
    write(contents, figures, folder)
    _print_contents(contents, folder)


def _print_contents(contents: Contents, folder: Path) -> None:
    """Print the state of the report's sections and where its files are."""
    say(contents.state)
    for section in contents.sections:
        say(f"{section.title}: {section.state}")
        for line in section.missing[:MOST_MISSING]:
            say(f"  missing: {line}")
        if len(section.missing) > MOST_MISSING:
            say(f"  and {counted(len(section.missing) - MOST_MISSING, 'more line')} in the report")
    for table in (*contents.corrected, *contents.scorecards):
        say(f"{table.caption}: {folder / 'tables' / table.name}.md")
    for note in contents.notes:
        say(note)
    say(f"Report: {folder / 'report.html'}")


def explorer_presets() -> dict[str, FlatOptions]:
    """The options that each preset of the group `explore`, such as deux_paper, changes from the explorer's defaults."""
    presets = {}
    for name in sorted(group_files("explore", config_folders()) - {*registry().names("explorers")}):
        composed = compose([f"explore={name}"])
        explorer = f"explore={composed.explore.name}"
        # The seed model's checkpoint is the same, as its training options are not the preset's.
        seed_model = f"seed_model.checkpoint={composed.seed_model.checkpoint or 'null'}"
        options, defaults = (
            conditions(sections_of(cfg).identity).explorer_options
            for cfg in (composed, compose([explorer, seed_model]))
        )
        changed = tuple(option for option in options if option not in defaults)
        if changed:  # a preset without changes would match every run
            presets[name] = changed
    return presets


def draw(contents: Contents, names: DisplayNames, folder: Path) -> dict[str, list[CaptionedFigure]]:
    """Draw the figures into a folder; returns them by the name of their table."""
    figures: dict[str, list[CaptionedFigure]] = {}
    trained = [section for section in contents.sections if not section.runs.transferred]
    for section in trained:
        table = section.table.name
        figures[table] = draw_runs(section.runs, names, folder, table)
        series = [s for s in trained if s.runs.without_amount == section.runs.without_amount]
        if section is series[0] and len({s.runs.training for s in series}) > 1:
            figure = draw_error_against_frames([s.runs for s in series], names, section.dataset)
            file = save_figure(figure, folder / f"{table}_error_against_frames.png")
            figures[table].append(
                CaptionedFigure(file, "MAE against the number of training frames; bars: 95 % interval.")
            )
    return figures


def write(contents: Contents, figures: dict[str, list[CaptionedFigure]], folder: Path) -> None:
    """Write the report in HTML and Markdown, and each table in Markdown, LaTeX and CSV."""
    make_folder(folder / "tables")
    written = set()
    for table in contents.tables:
        for suffix, text in (("md", table.markdown()), ("tex", table.latex()), ("csv", table.csv())):
            path = folder / "tables" / f"{table.name}.{suffix}"
            write_atomically(path, text.encode())
            written.add(path)
    for path in {*(folder / "tables").iterdir()} - written:  # tables of an earlier report
        path.unlink()
    write_atomically(folder / "report.md", _markdown_report(contents, figures).encode())
    write_atomically(folder / "report.html", html_page(contents, figures).encode())


def _markdown_report(contents: Contents, figures: dict[str, list[CaptionedFigure]]) -> str:
    lines = ["# Report", "", f"{contents.state}.", *_list(contents.notes)]
    for section in contents.sections:
        lines += ["", f"## {markdown_text(section.title)}", "", section.table.markdown()]
        if section.missing:
            lines += [f"Missing: {counted(len(section.runs.missing), 'run')}.", *_list(section.missing)]
        for figure in figures.get(section.table.name, ()):
            lines += ["", f"![{markdown_text(figure.caption)}](figures/{figure.file.name})"]
        lines += ["", "Commands:", "", *(f"    {printable(command)}" for command in section.commands)]
    for title, tables in (("Corrected depth", contents.corrected), ("Scorecards", contents.scorecards)):
        if tables:
            lines += ["", f"## {title}", *(f"\n{table.markdown()}" for table in tables)]
    return "\n".join(lines) + "\n"


def _list(sentences: Sequence[str]) -> list[str]:
    return ["", *(f"- {markdown_text(sentence)}" for sentence in sentences)] if sentences else []
