import numpy as np
import pytest
from PIL import Image

from deux.report.comparable_runs import group_comparable
from deux.report.report_figures import draw_error_against_frames, draw_runs
from deux.report.runs import find_runs


def picture(path, color, size=(60, 30)):
    path.parent.mkdir(exist_ok=True)
    Image.new("RGB", size, color).save(path)


@pytest.fixture
def drawn(write_run, outputs):
    """Runs of three explorers; the novelty explorer's pictures are damaged or gone."""
    colors = {"random": "red", "deux": "blue"}
    for explorer in ("random", "novelty", "deux"):
        for seed in range(2):
            figures = write_run(explorer, "kbnet", seed, 20.0) / "figures"
            figures.mkdir()
            if explorer == "novelty":
                (figures / "test_frames.png").write_bytes(b"no picture")
            elif seed == 0:
                picture(figures / "test_frames.png", colors[explorer], (2000, 100))
                picture(figures / "trajectory_flat-00.png", colors[explorer])
                picture(figures / "trajectory_annex-00.png" if explorer == "deux" else figures / "training.png", "lime")
    (runs,) = group_comparable(find_runs(outputs), [])
    return runs


def test_the_runs_pictures_are_shown_in_order(drawn, names, tmp_path):
    pictures = draw_runs(drawn, names, tmp_path / "figures", "table1")
    assert [one.file.name for one in pictures] == [
        "table1_frames_random.jpg",
        "table1_frames_deux.jpg",
        "table1_trajectories.png",
    ]
    assert "trained on Random frames (seed 0)" in pictures[0].caption
    with Image.open(pictures[1].file) as image:
        assert image.size == (1400, 70)
        assert np.abs(np.asarray(image).reshape(-1, 3).mean(axis=0) - (0, 0, 255)).max() < 3
    with Image.open(pictures[2].file) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).tolist()
    assert [255, 0, 0] in pixels
    assert [0, 0, 255] in pixels
    assert [0, 255, 0] not in pixels  # the scene that only one of them drew


def test_an_explorers_name_leads_to_no_other_folder(write_run, outputs, names, tmp_path):
    picture(write_run("../../out", "kbnet", 0, 20.0) / "figures" / "test_frames.png", "red")
    (runs,) = group_comparable(find_runs(outputs), [])
    (drawn,) = draw_runs(runs, names, tmp_path / "figures", "table1")
    assert drawn.file == tmp_path / "figures" / "table1_frames_______out.jpg"
    assert drawn.file.is_file()


def test_runs_without_pictures_have_no_figures(write_run, outputs, names, tmp_path):
    write_run("random", "kbnet", 0, 20.0)
    (runs,) = group_comparable(find_runs(outputs), [])
    assert draw_runs(runs, names, tmp_path, "table1") == []


def test_error_is_drawn_against_the_mean_number_of_frames(write_run, outputs, names):
    for flats, frames, mae in ((2, 40, 30.0), (4, 80, 20.0), (8, 160, 15.0)):
        place = {"scenes": {"name": "apartments", "train": flats, "test": 2}}
        for seed in range(2):
            write_run("deux", "kbnet", seed, mae + seed, place=place, frames=frames + 2 * seed, folder=str(flats))
    groups = group_comparable(find_runs(outputs), [])
    assert len({group.without_amount for group in groups}) == 1
    figure = draw_error_against_frames(groups, names, "apartments")
    (panel,) = figure.axes
    (container,) = panel.containers
    line, _, (bars,) = container.lines
    np.testing.assert_allclose(line.get_xydata(), [[41, 30.5], [81, 20.5], [161, 15.5]])
    heights = [np.ptp(segment[:, 1]) / 2 for segment in bars.get_segments()]
    np.testing.assert_allclose(heights, 12.7062 * 0.5, rtol=1e-4)  # t(0.975, 1) times s / sqrt(2)
    assert panel.lines[-1].get_ydata()[0] == 80.0  # interpolation
    assert panel.get_title() == "KBNet"


def test_the_legend_names_the_explorers_of_all_panels(write_run, outputs, names):
    """The last model was run with one of the explorers alone."""
    for flats in (2, 4):
        place = {"scenes": {"name": "apartments", "train": flats, "test": 2}}
        for explorer, model in (("random", "voiced"), ("deux", "voiced"), ("deux", "kbnet")):
            write_run(explorer, model, 0, 20.0, place=place, frames=20 * flats, folder=str(flats))
    figure = draw_error_against_frames(group_comparable(find_runs(outputs), []), names, "apartments")
    assert [panel.get_title() for panel in figure.axes] == ["VOICED", "KBNet"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["Interpolation", "Random", "DEUX"]
