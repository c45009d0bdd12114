from deux.figures.drawing import save_figure
from deux.figures.round_curve import draw_rounds
from deux.training.rounds import Round


def logs(folder):
    (folder / "version_0").mkdir()
    (folder / "version_0" / "metrics.csv").write_text(
        "epoch,step,rounds/mae,validation/mae\n0,9,,300\n,10,310,\n1,19,,200\n"
    )
    return folder


def test_each_panel_shows_one_quantity_against_steps(tmp_path):
    rounds = [Round(1, 10, 24, 8.5, 0.02, 310.0, []), Round(2, 30, 20, 6.5, 0.03, 250.0, [])]
    frames, area, uncertainty, error = draw_rounds(rounds, logs(tmp_path)).axes
    assert frames.lines[0].get_xydata().tolist() == [[10, 24], [30, 20]]
    assert area.lines[0].get_xydata().tolist() == [[10, 8.5], [30, 6.5]]
    assert uncertainty.lines[0].get_xydata().tolist() == [[10, 0.02], [30, 0.03]]
    assert error.lines[0].get_xydata().tolist() == [[9, 300], [19, 200]]
    assert error.lines[1].get_xydata().tolist() == [[10, 310], [30, 250]]


def test_what_is_not_known_is_not_drawn(tmp_path):
    figure = draw_rounds([Round(1, 10, 24, 8.5, None, None, [])], tmp_path)
    assert [len(axes.lines[-1].get_xydata()) for axes in figure.axes] == [1, 1, 0, 0]
    save_figure(figure, tmp_path / "rounds.png")
