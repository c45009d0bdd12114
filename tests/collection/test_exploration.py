"""The collector: what explorers are given, what is stored, and that nothing is collected twice."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from toy_world import (
    CAMERA,
    ROBOT,
    GuessingModel,
    ToyScene,
    ToySimulator,
    Wanderer,
    convolving_predictor,
    tree,
)

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.perception import MODEL_NEEDS
from deux.collection.sparse import SparseSettings, sample_sparse
from deux.contracts import COLOR, Action, Channel, Need
from deux.errors import DeuxError
from deux.geometry.poses import source_from_target
from deux.geometry.reprojection import reproject
from deux.inference.precision import FastPredictor
from deux.io.calibration import read_intrinsics, read_pose
from deux.io.images import quantise_depth, read_depth, read_image, read_labels
from deux.registry import registry
from deux_plugins.uncertainties.photometric import L1Residual

STEPS = 6
L1 = L1Residual()
ALL_NEEDS = [frozenset()] + [frozenset({need}) for need in Need] + [frozenset(Need)]


class Crew:
    """Makes simulators and explorers and remembers them."""

    def __init__(self, needs: frozenset[Need] = frozenset(), stops: tuple[int | None, ...] = ()) -> None:
        self.needs, self.stops = needs, list(stops)
        self.simulators: list[ToySimulator] = []
        self.explorers: list[Wanderer] = []

    def make_simulator(self, scene: ToyScene) -> ToySimulator:
        self.simulators.append(ToySimulator(scene))
        return self.simulators[-1]

    def make_explorer(self) -> Wanderer:
        self.explorers.append(Wanderer(self.needs, self.stops.pop(0) if self.stops else None))
        return self.explorers[-1]

    def at_work(self) -> list[Wanderer]:
        return [explorer for explorer in self.explorers if explorer.seen]


def plans(folder: Path, count: int = 3, steps: int = STEPS) -> list[EpisodePlan]:
    return [EpisodePlan(folder / f"room-{i}", ToyScene(f"room{i}", "x" * i), seed=i, steps=steps) for i in range(count)]


def test_frames_hold_what_the_simulator_showed(tmp_path: Path) -> None:
    crew = Crew(frozenset({Need.LABELS}))
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer)
    folder = tmp_path / "room-0"
    names = sorted(path.name for path in (folder / "image").iterdir())
    assert names == [f"{i:06d}.png" for i in range(STEPS)]
    np.testing.assert_array_equal(read_intrinsics(folder / "K.txt"), CAMERA.intrinsics)
    replay = ToySimulator(ToyScene("room0", ""))
    for i, seen in enumerate(crew.at_work()[0].seen):
        pose = read_pose(folder / f"absolute_pose/{i:06d}.txt")
        np.testing.assert_array_equal(pose, seen.pose)
        replay.reset(pose[0, 3], pose[2, 3], np.arctan2(-pose[0, 2], -pose[2, 2]))
        frame = replay.observe(COLOR | {Channel.LABELS})
        np.testing.assert_allclose(read_image(folder / f"image/{i:06d}.png").astype(int), frame.rgb, atol=1)
        np.testing.assert_allclose(read_depth(folder / f"ground_truth/{i:06d}.png"), frame.depth, atol=1 / 256)
        assert np.mean(read_labels(folder / f"labels/{i:06d}.png") == frame.labels) > 0.99


def test_the_first_action_follows_the_first_frame_and_the_budget_is_the_number_of_frames(
    tmp_path: Path,
) -> None:
    crew = Crew()
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer)
    assert [seen.step for seen in crew.at_work()[0].seen] == list(range(STEPS))
    assert crew.simulators[0].rendered == STEPS


@pytest.mark.parametrize("needs", ALL_NEEDS, ids=lambda needs: "+".join(sorted(needs)) or "nothing")
def test_an_explorer_is_given_what_it_declares_and_nothing_else(tmp_path: Path, needs: frozenset[Need]) -> None:
    crew = Crew(needs)
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer, GuessingModel(), uncertainty=L1)
    explorer = crew.at_work()[0]
    assert (explorer.episode.free_space is not None) == (Need.FREE_SPACE in needs)
    for seen in explorer.seen:
        assert (seen.sensor_depth is not None) == (Need.SENSOR_DEPTH in needs)
        assert (seen.predicted_depth is not None) == (Need.PREDICTED_DEPTH in needs)
        assert (seen.residual is not None) == (Need.RESIDUAL in needs)
        assert (seen.uncertainty is not None) == (Need.RESIDUAL in needs)
        assert (seen.labels is not None) == (Need.LABELS in needs)
    assert (tmp_path / "room-0/labels").exists() == (Need.LABELS in needs)
    assert (tmp_path / "room-0/uncertainty.csv").exists() == bool(MODEL_NEEDS & needs)


def test_depth_is_given_as_the_files_hold_it(tmp_path: Path) -> None:
    crew = Crew(frozenset({Need.SENSOR_DEPTH}))
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer)
    for i, seen in enumerate(crew.at_work()[0].seen):
        assert seen.sensor_depth is not None
        np.testing.assert_array_equal(seen.sensor_depth, quantise_depth(seen.sensor_depth))
        np.testing.assert_array_equal(seen.sensor_depth, read_depth(tmp_path / f"room-0/ground_truth/{i:06d}.png"))


def test_the_model_is_called_once_a_step_for_all_robots_that_are_still_going(tmp_path: Path) -> None:
    model, crew = GuessingModel(), Crew(frozenset({Need.PREDICTED_DEPTH}), stops=(None, None, 2, None))
    explore(plans(tmp_path, 3), crew.make_simulator, crew.make_explorer, model, batch_size=3)
    assert model.batch_sizes == [3, 3, 3, 2, 2, 2]


def test_robots_go_in_groups(tmp_path: Path) -> None:
    model, crew = GuessingModel(), Crew(frozenset({Need.RESIDUAL}))
    explore(plans(tmp_path, 5), crew.make_simulator, crew.make_explorer, model, uncertainty=L1, batch_size=2)
    assert model.batch_sizes == [2] * STEPS + [2] * STEPS + [1] * STEPS


def test_no_model_is_called_for_explorers_that_need_none(tmp_path: Path) -> None:
    model, crew = GuessingModel(), Crew(frozenset({Need.SENSOR_DEPTH, Need.LABELS, Need.FREE_SPACE}))
    explore(plans(tmp_path), crew.make_simulator, crew.make_explorer, model, uncertainty=L1)
    assert model.batch_sizes == []


def test_an_explorer_that_needs_a_model_without_one_is_an_error(tmp_path: Path) -> None:
    crew = Crew(frozenset({Need.RESIDUAL}))
    with pytest.raises(DeuxError, match="needs residual but there is no depth model"):
        explore(plans(tmp_path), crew.make_simulator, crew.make_explorer)
    with pytest.raises(DeuxError, match="needs residual but there is no measure of uncertainty"):
        explore(plans(tmp_path), crew.make_simulator, crew.make_explorer, GuessingModel())
    assert list(tmp_path.iterdir()) == []


def test_an_explorer_that_asks_for_depth_alone_needs_no_measure(tmp_path: Path) -> None:
    crew = Crew(frozenset({Need.PREDICTED_DEPTH}))
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer, GuessingModel())
    assert all(seen.predicted_depth is not None for seen in crew.at_work()[0].seen)
    assert not (tmp_path / "room-0/uncertainty.csv").exists()


def test_an_episode_takes_place_on_its_floor(tmp_path: Path) -> None:
    crew = Crew()
    (plan,) = plans(tmp_path, 1)
    explore([replace(plan, floor=1)], crew.make_simulator, crew.make_explorer)
    (explorer,) = crew.at_work()
    assert explorer.episode.floor == 1
    assert all(seen.pose[1, 3] == 3.0 + ROBOT.camera_height for seen in explorer.seen)
    assert json.loads(plan.record.read_bytes())["floor"] == 1


def test_prediction_and_residual_are_those_of_the_frame(tmp_path: Path) -> None:
    crew, model = Crew(frozenset({Need.SENSOR_DEPTH, Need.PREDICTED_DEPTH, Need.RESIDUAL})), GuessingModel()
    explore(plans(tmp_path), crew.make_simulator, crew.make_explorer, model, SparseSettings(0.02), L1)
    seen = crew.at_work()[1].seen
    assert all(np.isnan(one.residual).all() and np.isnan(one.uncertainty) for one in seen[:2])
    for two, one, now in zip(seen, seen[1:], seen[2:], strict=False):
        image = torch.from_numpy(now.rgb).permute(2, 0, 1).float() / 255
        sparse = torch.from_numpy(sample_sparse(now.rgb, now.sensor_depth, SparseSettings(0.02)))
        depth = GuessingModel()(image[None], sparse[None, None], torch.eye(3)[None])
        np.testing.assert_allclose(now.predicted_depth, depth[0, 0].numpy(), rtol=1e-5)
        # One source frame after the other, the errors summed by hand.
        total, count = torch.zeros(depth.shape[-2:]), torch.zeros(depth.shape[-2:])
        for source in (one, two):
            motion = torch.from_numpy(source_from_target(now.pose, source.pose)).float()[None, None]
            pixels = torch.from_numpy(source.rgb).permute(2, 0, 1).float()[None, None] / 255
            rebuilt, visible = reproject(pixels, depth, torch.from_numpy(CAMERA.intrinsics).float()[None], motion)
            total += torch.where(visible[0, 0, 0], (rebuilt[0, 0] - image).abs().mean(dim=0), 0.0)
            count += visible[0, 0, 0]
        expected = (total / count).numpy()
        np.testing.assert_allclose(now.residual, expected, atol=1e-4)
        assert now.uncertainty == pytest.approx(1 - np.exp(-np.nanmean(expected)), abs=1e-5)


def test_the_uncertainty_of_each_pose_and_the_final_map_are_kept(tmp_path: Path) -> None:
    crew = Crew(frozenset({Need.RESIDUAL}))
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer, GuessingModel(), uncertainty=L1)
    table = np.genfromtxt(tmp_path / "room-0/uncertainty.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["step"], np.arange(STEPS))
    np.testing.assert_array_equal(table["uncertainty"], [seen.uncertainty for seen in crew.at_work()[0].seen])
    with np.load(tmp_path / "room-0/map.npz", allow_pickle=False) as known:
        assert (known["occupancy"] == STEPS).all()
        assert known["resolution"] == 0.05
        assert "uncertainty" not in known


def test_stop_ends_an_episode_and_only_that_one(tmp_path: Path) -> None:
    crew = Crew(stops=(None, 2, None))
    explore(plans(tmp_path, 2), crew.make_simulator, crew.make_explorer)
    assert [len(list((tmp_path / f"room-{i}/image").iterdir())) for i in range(2)] == [3, STEPS]
    assert crew.at_work()[0].seen[-1].step == 2


def test_collisions_reach_the_explorer(tmp_path: Path) -> None:
    class Forward(Wanderer):
        def act(self, observation):  # type: ignore[no-untyped-def]
            super().act(observation)
            return Action.FORWARD

    made: list[Forward] = []
    explore(plans(tmp_path, 1, steps=40), ToySimulator, lambda: made.append(Forward()) or made[-1])
    collided = [seen.collided for seen in made[-1].seen]
    assert not collided[0]
    assert collided[-1]


def test_every_explorer_starts_at_the_same_pose(tmp_path: Path) -> None:
    first, second = Crew(), Crew(frozenset({Need.RESIDUAL, Need.LABELS}))
    explore(plans(tmp_path / "a"), first.make_simulator, first.make_explorer)
    explore(plans(tmp_path / "b"), second.make_simulator, second.make_explorer, GuessingModel(), uncertainty=L1)
    starts = [[explorer.seen[0].pose for explorer in crew.at_work()] for crew in (first, second)]
    np.testing.assert_array_equal(*starts)
    assert not np.allclose(starts[0][0], starts[0][1])


def test_finished_episodes_are_not_run_again(tmp_path: Path) -> None:
    crew, again = Crew(), Crew()
    explore(plans(tmp_path), crew.make_simulator, crew.make_explorer)
    before = tree(tmp_path)
    explore(plans(tmp_path), again.make_simulator, again.make_explorer)
    assert again.simulators == []
    assert tree(tmp_path) == before


@pytest.mark.parametrize("needs", [frozenset(), frozenset(Need)], ids=["alone", "guided"])
def test_finished_frames_are_read_instead_of_rendered(tmp_path: Path, needs: frozenset[Need]) -> None:
    whole, crew = Crew(needs), Crew(needs)
    model = GuessingModel()
    explore(plans(tmp_path / "whole"), whole.make_simulator, whole.make_explorer, model, uncertainty=L1)
    explore(plans(tmp_path / "cut"), crew.make_simulator, crew.make_explorer, model, uncertainty=L1)
    # As if the run had been killed: one episode done, one at its fourth frame, one not begun.
    (tmp_path / "cut/room-1/episode.json").unlink()
    for i in range(4, STEPS):
        (tmp_path / f"cut/room-1/absolute_pose/{i:06d}.txt").unlink()
    (tmp_path / "cut/room-1/image/000004.png").write_bytes(b"half a fi")
    for path in sorted((tmp_path / "cut/room-2").rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    finished = {p: p.stat().st_mtime_ns for p in (tmp_path / "cut").rglob("00000[0123].*") if "room-2" not in str(p)}
    again = Crew(needs)
    explore(plans(tmp_path / "cut"), again.make_simulator, again.make_explorer, model, uncertainty=L1)
    assert tree(tmp_path / "cut") == tree(tmp_path / "whole")
    assert {path: path.stat().st_mtime_ns for path in finished} == finished
    rendered = {simulator.scene.name: simulator.rendered for simulator in again.simulators}
    assert rendered.pop("room0", 0) == 0
    assert rendered == {"room1": STEPS - 4, "room2": STEPS}


def test_a_frame_that_became_unreadable_is_rendered_again(tmp_path: Path) -> None:
    crew, again = Crew(), Crew()
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer)
    before = tree(tmp_path)
    (tmp_path / "room-0/episode.json").unlink()
    (tmp_path / "room-0/image/000002.png").write_bytes(b"")
    explore(plans(tmp_path, 1), again.make_simulator, again.make_explorer)
    assert tree(tmp_path) == before
    assert again.simulators[0].rendered == 1


def test_frames_of_another_simulator_are_not_continued(tmp_path: Path) -> None:
    crew = Crew()
    explore(plans(tmp_path, 1), crew.make_simulator, crew.make_explorer)
    (tmp_path / "room-0/episode.json").unlink()
    other = EpisodePlan(tmp_path / "room-0", ToyScene(), seed=99, steps=STEPS)
    with pytest.raises(DeuxError, match=r"room-0 cannot be continued: .* step 0"):
        explore([other], crew.make_simulator, crew.make_explorer)


def guess_of(name: str) -> FastPredictor:
    if name == "tiny":
        return convolving_predictor()
    torch.manual_seed(0)
    return FastPredictor(registry().create("depth_models", name, {}), "cpu")


@pytest.mark.parametrize(
    ("model", "measure"),
    [("tiny", name) for name in ("l1", "ssim", "parallax", "flip", "hidden_points", "sparse_error")]
    + [("kbnet", "l1")],
)
def test_on_a_cpu_robots_walk_the_same_in_groups_of_any_size(tmp_path: Path, model: str, measure: str) -> None:
    predict, uncertainty = guess_of(model), registry().create("uncertainties", measure, {})
    for size in (4, 2, 1):
        explore(
            plans(tmp_path / str(size), 4),
            ToySimulator,
            lambda: registry().create("explorers", "deux", {}),
            predict,
            uncertainty=uncertainty,
            batch_size=size,
        )
    whole = tree(tmp_path / "4")
    assert sum(name.endswith("uncertainty.csv") for name in whole) == 4
    assert tree(tmp_path / "2") == tree(tmp_path / "1") == whole


def test_on_a_cpu_guided_episodes_that_are_finished_are_not_run_again(tmp_path: Path) -> None:
    needs = frozenset({Need.RESIDUAL, Need.PREDICTED_DEPTH})
    whole, again = Crew(needs), Crew(needs)
    predict = convolving_predictor()
    for folder in ("whole", "cut"):
        explore(plans(tmp_path / folder, 4), whole.make_simulator, whole.make_explorer, predict, uncertainty=L1)
    for number, left in ((1, 2), (3, 0)):
        (tmp_path / f"cut/room-{number}/episode.json").unlink()
        for path in sorted((tmp_path / f"cut/room-{number}/absolute_pose").iterdir())[left:]:
            path.unlink()
    told: list[int] = []
    explore(
        plans(tmp_path / "cut", 4),
        again.make_simulator,
        again.make_explorer,
        predict,
        uncertainty=L1,
        batch_size=3,
        progress=lambda stage, done, total: told.append(done),
    )
    assert tree(tmp_path / "cut") == tree(tmp_path / "whole")
    assert {simulator.scene.name: simulator.rendered for simulator in again.simulators} == {"room1": 4, "room3": 6}
    assert told == sorted(told)
    assert told[-1] == 4 * STEPS


def test_progress_reaches_the_number_of_frames(tmp_path: Path) -> None:
    crew = Crew(stops=(None, None, 2))
    told: list[tuple[int, int]] = []
    explore(
        plans(tmp_path, 2),
        crew.make_simulator,
        crew.make_explorer,
        progress=lambda stage, done, total: told.append((done, total)),
    )
    assert told[-1] == (2 * STEPS, 2 * STEPS)
    assert sorted(told) == told
