from deux.studies.uncertainty_tables import agreement_table, causes_table


def column(table, heading: str) -> dict[str, tuple[str, str | None]]:
    """The texts and marks of a column by the rows' labels."""
    index = table.headings.index(heading)
    return {
        row.labels[0]: ("".join(table.cell_text(index, row.cells[index])), row.cells[index].mark) for row in table.rows
    }


def test_the_measure_that_follows_the_error_best_stands_out(study):
    table = agreement_table(study)
    assert "all 20 frames" in table.caption
    pixels = column(table, "ρ pixels")
    assert pixels["sparse_error"] == ("0.70 ± 1.27", "best")
    assert pixels["l1"] == ("0.10 ± 0.00", None)
    assert pixels["flip"] == ("–", None)
    assert column(table, "AUSE")["sparse_error"][1] == "best"  # the lowest
    assert column(table, "covered [%]")["parallax"] == ("25 ± 0", None)


def test_controls_stand_in_brackets_and_are_not_ranked(study):
    chance = {heading: column(agreement_table(study), heading)["(chance)"] for heading in ("ρ pixels", "AUSE")}
    assert chance == {"ρ pixels": ("0.00 ± 0.00", None), "AUSE": ("0.500 ± 0.000", None)}


def test_frames_that_moved_have_a_table_of_their_own(study):
    table = agreement_table(study, "moved")
    assert "the 10 frames whose camera moved" in table.caption
    assert "ρ places" not in table.headings
    assert column(table, "covered [%]")["parallax"] == ("50 ± 0", None)


def test_one_frame_is_no_plural(study, monkeypatch):
    monkeypatch.setattr(type(study), "count", lambda *_: 1)
    assert "the 1 frame whose camera moved" in agreement_table(study, "moved").caption


def test_causes_are_the_columns(study):
    table = causes_table(study)
    assert table.headings == ("true error", "metres moved", "distance", "texture")
    assert column(table, "true error")["sparse_error"] == ("1.00 ± 0.00", None)
