"""`task=report`: finished runs as the paper's tables and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig

from deux.configuration import compose, config_folders, group_files, run_folder, sections_of, user_path
from deux.errors import DeuxError, counted, plural, printable
from deux.figures.drawing import save_figure
from deux.io.atomic import make_folder, write_atomically
from deux.metrics.tables import markdown_text
from deux.registry import registry
from deux.report.conditions import FlatOptions, conditions
from deux.report.contents import Contents, read_contents
from deux.report.display_names import DisplayNames
from deux.report.kept_runs import keep_runs
from deux.report.page import html_page
from deux.report.report_figures import CaptionedFigure, draw_error_against_frames, draw_runs
from deux.tasks.console import say

MOST_MISSING = 12
"""Lines about what is missing that the console shows for each table."""


@dataclass(frozen=True)
class ReportSettings:
    """What `task=report` shows.

    Args:
        runs: a folder with runs and sweeps below it.
        keep: a folder that takes a copy of the small files of the finished runs and of the sweeps' grids, such as
            docs/results/houses; a report of it is the report of the runs. None copies nothing.
        first: the dataset of Table I; None for the one on which the most explorers were compared.
        transferred: explorers of which Table II also shows the models that were trained on the first dataset.
        baseline: the explorer, or several, that the others of Table I are compared with, seed by seed; None for none.
        models: what each depth model is called, in order of the columns.
        explorers: what each explorer is called, in order of the rows, in parts with a line between them.
    """

    runs: str | None
    keep: str | None
    first: str | None
    transferred: tuple[str, ...]
    baseline: str | tuple[str, ...] | None
    models: Mapping[str, str]
    explorers: tuple[Mapping[str, str], ...]


def run(cfg: DictConfig) -> None:
    """Report on the runs and sweeps below `report.runs`, finished or not. A repeated command overwrites its files."""
    settings = sections_of(cfg).read("report", ReportSettings)
    if not settings.runs:
        raise DeuxError(
            "task=report needs runs: name a folder with runs or sweeps below it, such as report.runs=outputs."
        )
    names = DisplayNames(settings.models, settings.explorers)
    contents = read_contents(
        user_path(settings.runs), names, settings.first, settings.transferred, settings.baseline, explorer_presets()
    )
    shown = {explorer.name for section in contents.sections for explorer in section.runs.explorers}
    compared = settings.baseline or ()
    for name in {*settings.transferred, *((compared,) if isinstance(compared, str) else compared)} - shown:
        registry().find("explorers", name)  # which tells the name that was meant
    if settings.keep:
        count, size = keep_runs(user_path(settings.runs), user_path(settings.keep))
        kept = f"{counted(count, 'run')} {plural('is', count)} kept in {user_path(settings.keep)}"
        say(f"{kept}, the largest with {size / 1000:.1f} kB")
    folder = run_folder()
    figures = draw(contents, names, folder / "figures")
    write(contents, figures, folder)
    say(contents.state)
    for section in contents.sections:
        say(f"{section.title}: {section.state}")
        for line in section.missing[:MOST_MISSING]:
            say(f"  missing: {line}")
        if len(section.missing) > MOST_MISSING:
            say(f"  and {counted(len(section.missing) - MOST_MISSING, 'more line')}, which the report has")
    for table in contents.scorecards:
        say(f"{table.caption}: {folder / 'tables' / table.name}.md")
    for note in contents.notes:
        say(note)
    say(f"Report: {folder / 'report.html'}")


def explorer_presets() -> dict[str, FlatOptions]:
    """What each YAML file of the group `explore`, such as deux_paper, sets otherwise than its explorer's defaults."""
    presets = {}
    for name in sorted(group_files("explore", config_folders()) - {*registry().names("explorers")}):
        composed = compose([f"explore={name}"])
        plain = f"explore={composed.explore.name}"
        seed_model = f"seed_model.checkpoint={composed.seed_model.checkpoint or 'null'}"  # its training is no preset's
        options, defaults = (
            conditions(sections_of(cfg).identity).explorer_options for cfg in (composed, compose([plain, seed_model]))
        )
        changed = tuple(option for option in options if option not in defaults)
        if changed:  # otherwise any explorer's options would hold it
            presets[name] = changed
    return presets


def draw(contents: Contents, names: DisplayNames, folder: Path) -> dict[str, list[CaptionedFigure]]:
    """Draw the figures into a folder; the result has them by the name of the table that they belong to."""
    figures: dict[str, list[CaptionedFigure]] = {}
    trained = [section for section in contents.sections if not section.runs.transferred]
    for section in trained:
        table = section.table.name
        figures[table] = draw_runs(section.runs, names, folder, table)
        alike = [s for s in trained if s.runs.without_amount == section.runs.without_amount]
        if section is alike[0] and len({s.runs.training for s in alike}) > 1:
            figure = draw_error_against_frames([s.runs for s in alike], names, section.dataset)
            file = save_figure(figure, folder / f"{table}_error_against_frames.png")
            figures[table].append(
                CaptionedFigure(file, "MAE against the number of training frames; bars: 95 % interval.")
            )
    return figures


def write(contents: Contents, figures: dict[str, list[CaptionedFigure]], folder: Path) -> None:
    """Write the report: a page, the same in Markdown, and each table in Markdown, LaTeX and CSV."""
    make_folder(folder / "tables")
    written = set()
    for table in contents.tables:
        for suffix, text in (("md", table.markdown()), ("tex", table.latex()), ("csv", table.csv())):
            path = folder / "tables" / f"{table.name}.{suffix}"
            write_atomically(path, text.encode())
            written.add(path)
    for path in {*(folder / "tables").iterdir()} - written:  # of an earlier report, over other runs
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
    if contents.scorecards:
        lines += ["", "## Scorecards", *(f"\n{table.markdown()}" for table in contents.scorecards)]
    return "\n".join(lines) + "\n"


def _list(sentences: Sequence[str]) -> list[str]:
    return ["", *(f"- {markdown_text(sentence)}" for sentence in sentences)] if sentences else []
