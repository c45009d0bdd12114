from rich.console import Console

from deux.report.sheet import Cell, Sheet

SHEET = Sheet("Areas", ("who", "area [m²]"), ((Cell("a"), Cell("1.0")), (Cell("b"), Cell("2.0", bold=True))))


def test_markdown_marks_what_stands_out():
    assert SHEET.markdown().splitlines() == [
        "Areas:", "", "| who | area [m²] |", "| --- | ---: |", "| a | 1.0 |", "| b | **2.0** |",
    ]  # fmt: skip


def test_the_console_shows_brackets_and_bold():
    console = Console(width=60, color_system="standard", force_terminal=True)
    with console.capture() as capture:
        console.print(SHEET.rich())
    assert "area [m²]" in capture.get()
    assert "\x1b[1m2.0\x1b[0m" in capture.get()
    assert "\x1b[1m1.0\x1b[0m" not in capture.get()
