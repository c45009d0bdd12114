import numpy as np
import pytest

from deux.studies.judged_scene import JudgedFrame, JudgedScene, Judgement, Place
from deux.studies.uncertainty_study import UncertaintyStudy
from deux.studies.uncertainty_tables import agreement_table, causes_table


def judgement(delta: float, rank: float) -> Judgement:
    oracle = np.linspace(1.0, 0.05, 20)
    return Judgement(delta, 0.5, rank, (1.0 - rank) / 2.0, (rank * oracle + (1.0 - rank)).tolist(), oracle.tolist())


def scene(name: str, sign: float, rank: float) -> JudgedScene:
    """Ten frames whose l1 goes with the motion, and whose sparse_error goes with the error (or against it)."""
    rng = np.random.default_rng(0)
    frames = [
        JudgedFrame(
            step=step,
            moved=(moved := 0.5 * (step % 2)),
            turned=10.0,
            distance=2.0,
            texture=0.1,
            error=(error := 100.0 + 10.0 * step),
            judgements={
                "l1": judgement(moved + 0.01 * rng.random(), 0.1),
                "sparse_error": judgement(sign * error, rank),
                **({"parallax": judgement(error, 0.3)} if moved else {}),
                "chance": judgement(rng.random(), 0.0),
            },
        )
        for step in range(10)
    ]
    places = [Place(uncertainty=float(i), error=float(i * i)) for i in range(5)]
    return JudgedScene(name, frames, {"l1": places[::-1], "sparse_error": places})


@pytest.fixture
def study() -> UncertaintyStudy:
    return UncertaintyStudy([scene("a", 1.0, 0.6), scene("b", 1.0, 0.8)], ("l1", "sparse_error", "parallax", "flip"))


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
    assert column(table, "judged [%]")["parallax"] == ("25 ± 0", None)


def test_controls_stand_in_brackets_and_are_not_ranked(study):
    chance = {heading: column(agreement_table(study), heading)["(chance)"] for heading in ("ρ pixels", "AUSE")}
    assert chance == {"ρ pixels": ("0.00 ± 0.00", None), "AUSE": ("0.500 ± 0.000", None)}


def test_frames_that_moved_have_a_table_of_their_own(study):
    table = agreement_table(study, "moved")
    assert "the 10 frames whose camera moved" in table.caption
    assert "ρ places" not in table.headings
    assert column(table, "judged [%]")["parallax"] == ("50 ± 0", None)


def test_causes_are_the_columns(study):
    table = causes_table(study)
    assert table.headings == ("true error", "metres moved", "distance", "texture")
    assert column(table, "true error")["sparse_error"] == ("1.00 ± 0.00", None)
