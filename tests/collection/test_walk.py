import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from toy_world import GuessingModel, ToyScene, ToySimulator, Wanderer, guided_explorer

from deux.collection.episodes import EpisodePlan
from deux.collection.exploration import explore
from deux.collection.perception import Perception
from deux.collection.viewpoints import collect_viewpoints, plan_viewpoints
from deux.collection.walk import Step, Walk, run_walks
from deux.contracts import Action, Frame, Need
from deux.errors import DeuxError
from deux.io.frames import read_frame
from deux.io.images import quantise_depth
from deux_plugins.uncertainties.photometric import L1Residual


def steps_of(explorer: Wanderer, seed: int = 5, steps: int = 12, perception: Perception | None = None) -> list[Step]:
    return [step for (step,) in run_walks([Walk(ToySimulator(), explorer, seed, steps)], perception)]


def test_it_goes_where_the_collector_goes(tmp_path):
    plan = EpisodePlan(tmp_path / "room-00", ToyScene(), seed=5, steps=12)
    explore([plan], ToySimulator, Wanderer)
    steps = steps_of(Wanderer())
    assert [step.number for step in steps] == list(range(12))
    for step in steps:
        stored = read_frame(plan.paths, step.number, labels=False)
        np.testing.assert_array_equal(stored.pose, step.frame.pose)
        np.testing.assert_array_equal(stored.depth, step.frame.depth)


def test_an_explorer_is_shown_what_it_declared_and_no_more():
    bare, guided = Wanderer(), guided_explorer()
    perception = Perception(GuessingModel(), uncertainty=L1Residual())
    steps_of(bare, perception=perception)
    assert bare.episode.free_space is None
    assert (bare.seen[3].sensor_depth, bare.seen[3].labels, bare.episode.label_names) == (None, None, ())
    assert (bare.seen[3].predicted_depth, bare.seen[3].residual, bare.seen[3].uncertainty) == (None, None, None)
    steps = steps_of(guided, perception=perception)
    seen, percept = guided.seen[3], steps[3].percept
    assert guided.episode.label_names == ("x", "y", "z")
    assert seen.labels.shape == seen.sensor_depth.shape == (40, 48)
    np.testing.assert_array_equal(seen.predicted_depth, percept.predicted_depth.numpy())
    np.testing.assert_array_equal(seen.residual, percept.residual.numpy())
    assert seen.uncertainty == percept.uncertainty.item()
    privileged = Wanderer(frozenset({Need.FREE_SPACE}))
    steps_of(privileged)
    assert privileged.episode.free_space.area == pytest.approx(5.4 * 3.4)


def test_what_an_explorer_writes_into_its_arrays_changes_no_step():
    class Scribbler(Wanderer):
        def act(self, observation):
            action = super().act(observation)
            for array in vars(observation).values():
                if isinstance(array, np.ndarray):
                    array.fill(0)
            return action

    needs = frozenset(Need)
    perception = Perception(GuessingModel(), uncertainty=L1Residual())
    clean, scribbled = (steps_of(explorer(needs), perception=perception) for explorer in (Wanderer, Scribbler))
    for ours, theirs in zip(clean, scribbled, strict=True):
        assert ours.action == theirs.action
        for name in ("rgb", "depth", "pose", "labels"):
            np.testing.assert_array_equal(getattr(ours.frame, name), getattr(theirs.frame, name))
        np.testing.assert_array_equal(ours.percept.predicted_depth, theirs.percept.predicted_depth)
        np.testing.assert_array_equal(ours.percept.residual, theirs.percept.residual)


def test_it_ends_when_the_explorer_stops_or_the_steps_are_used_up():
    assert len(steps_of(Wanderer(stop_after=3))) == 4
    walk = Walk(ToySimulator(), Wanderer(), seed=5, steps=1)
    before = walk.simulator.state
    assert len(list(run_walks([walk]))) == 1
    assert (walk.over, len(walk.actions), walk.simulator.state) == (True, 1, before)


def test_collisions_reach_the_explorer(monkeypatch):
    monkeypatch.setattr(Wanderer, "act", lambda self, observation: self.seen.append(observation) or Action.FORWARD)
    explorer = Wanderer()
    steps = steps_of(explorer, steps=40)  # ten metres ahead, in a room of six
    moved = np.linalg.norm(np.diff([step.frame.pose[:3, 3] for step in steps], axis=0), axis=1)
    assert [seen.collided for seen in explorer.seen[1:]] == [bool(distance < 0.249) for distance in moved]
    assert [step.collided for step in steps] == [seen.collided for seen in explorer.seen]
    assert steps[-1].collided


def test_walks_in_lock_step_are_what_each_is_alone():
    """Also where one of them ends before the others."""
    makers: list[Callable[[], Wanderer]] = [Wanderer, lambda: Wanderer(stop_after=4), Wanderer]
    walks = [Walk(ToySimulator(), make(), seed, 9) for seed, make in enumerate(makers)]
    rounds = list(run_walks(walks))
    assert [len(steps) for steps in rounds] == [3] * 5 + [2] * 4
    for seed, make in enumerate(makers):
        alone = steps_of(make(), seed, 9)
        mine = [step for steps in rounds for step in steps if step.walk is walks[seed]]
        assert [step.action for step in mine] == [step.action for step in alone]
        np.testing.assert_array_equal([step.frame.rgb for step in mine], [step.frame.rgb for step in alone])


def test_a_step_carries_the_frames_before_it():
    steps = steps_of(Wanderer(), steps=5)
    assert [len(step.frames) for step in steps] == [1, 2, 3, 3, 3]
    assert steps[4].frames == (steps[4].frame, steps[3].frame, steps[2].frame)


def test_stored_frames_are_not_rendered_again():
    whole = steps_of(Wanderer(), steps=6)
    asked: list[np.ndarray] = []

    def stored(number: int, pose: np.ndarray) -> Frame | None:
        asked.append(pose)
        return whole[number].frame if number in (0, 1, 4) else None

    simulator = ToySimulator()
    again = [step for (step,) in run_walks([Walk(simulator, Wanderer(), 5, 6, stored=stored)])]
    assert [step.rendered for step in again] == [False, False, True, True, False, True]
    assert simulator.rendered == 3
    for ours, theirs, pose in zip(again, whole, asked, strict=True):
        assert ours.action == theirs.action
        np.testing.assert_array_equal(ours.frame.depth, theirs.frame.depth)
        np.testing.assert_array_equal(pose, theirs.frame.pose)


def test_depth_is_what_files_can_hold():
    for step in steps_of(Wanderer(), steps=3):
        np.testing.assert_array_equal(step.frame.depth, quantise_depth(step.frame.depth))


def test_a_walk_takes_place_on_its_floor():
    explorer = Wanderer(frozenset({Need.FREE_SPACE}))
    walk = Walk(ToySimulator(), explorer, seed=5, steps=3, floor=1)
    heights = {step.frame.pose[1, 3] for (step,) in run_walks([walk])}
    assert heights == {3.0 + walk.simulator.robot.camera_height}
    assert explorer.episode.floor == 1
    assert explorer.episode.free_space.floor_height == 3.0


def test_what_an_explorer_needs_has_to_be_there():
    with pytest.raises(DeuxError, match="needs predicted_depth and residual but there is no depth model"):
        steps_of(guided_explorer())
    with pytest.raises(DeuxError, match=r"there is no measure of uncertainty: choose one with collect\.uncertainty"):
        steps_of(guided_explorer(), perception=Perception(GuessingModel()))


@pytest.mark.parametrize("chosen", [None, "forward", 7, -1, True, 1.0, torch.tensor(1), np.float64(1.0)])
def test_what_is_no_action_is_reported_at_the_step(monkeypatch, chosen):
    explorer = Wanderer()
    script = [Action.LEFT, chosen]
    monkeypatch.setattr(explorer, "act", lambda observation: script[observation.step])
    with pytest.raises(
        DeuxError, match=r"^the explorer Wanderer chose .* at step 1: `act` returns a deux\.contracts\.A"
    ):
        steps_of(explorer)


def test_the_number_of_an_action_is_taken_for_it(monkeypatch):
    explorer = Wanderer()
    script = [np.int64(1), 2, 3]
    monkeypatch.setattr(explorer, "act", lambda observation: script[observation.step])
    assert [step.action for step in steps_of(explorer)] == [Action.LEFT, Action.RIGHT, Action.STOP]
    assert all(type(action) is Action for action in (step.action for step in steps_of(explorer)))


WRONG_FRAMES = {
    "rgb is ndarray of 20 x 24 x 3, uint8: it must be an ndarray of 40 x 48 x 3, uint8, for its "
    "camera of 48 x 40 pixels.": lambda frame: replace(frame, rgb=frame.rgb[::2, ::2]),
    "rgb is ndarray of 40 x 48 x 3, float64": lambda frame: replace(frame, rgb=frame.rgb / 255.0),
    "depth is ndarray of 40 x 48, float64": lambda frame: replace(frame, depth=frame.depth.astype(np.float64)),
    "depth is ndarray of 40 x 48 x 1, float32": lambda frame: replace(frame, depth=frame.depth[..., None]),
    "rgb is None": lambda frame: replace(frame, rgb=None),
    "pose is ndarray of 3 x 4, float64": lambda frame: replace(frame, pose=frame.pose[:3]),
}

WRONG_VALUES = {
    "a frame with depth from nan to nan m: it must be 0.1 to 10 m, the camera's range, or 0 for no surface.": (
        lambda frame: replace(frame, depth=frame.depth * np.float32(np.nan))
    ),
    "a frame with depth from -": lambda frame: replace(frame, depth=-frame.depth),
    "a frame with depth from ": lambda frame: replace(frame, depth=frame.depth * 1000.0),
    "a frame of another pose: it must be one of the pose that it was called with.": (
        lambda frame: replace(frame, pose=frame.pose + 0.01)
    ),
}


@pytest.mark.parametrize("told", WRONG_VALUES)
def test_the_simulator_is_named_for_a_frame_with_impossible_values(monkeypatch, told):
    whole = ToySimulator._frame
    monkeypatch.setattr(ToySimulator, "_frame", lambda *arguments: WRONG_VALUES[told](whole(*arguments)))
    with pytest.raises(DeuxError, match=re.escape(f"the `render` of the simulator ToySimulator gives {told}")):
        steps_of(Wanderer())


@pytest.mark.parametrize("wrong", [lambda pose: pose * 2.0, lambda pose: pose.tolist(), lambda pose: pose * np.nan])
def test_the_simulator_is_named_for_a_pose_that_is_not_rigid(monkeypatch, wrong):
    right = ToySimulator.pose.fget
    monkeypatch.setattr(ToySimulator, "pose", property(lambda simulator: wrong(right(simulator))))
    with pytest.raises(DeuxError, match=r"^the `pose` of the simulator ToySimulator gives .*a rigid camera-to-world"):
        steps_of(Wanderer())


@pytest.mark.parametrize("told", WRONG_FRAMES)
def test_the_simulator_is_named_for_a_frame_that_is_not_of_its_camera(monkeypatch, told):
    whole = ToySimulator._frame
    monkeypatch.setattr(ToySimulator, "_frame", lambda *arguments: WRONG_FRAMES[told](whole(*arguments)))
    sentence = re.escape(f"the `render` of the simulator ToySimulator gives a frame whose {told}")
    with pytest.raises(DeuxError, match=sentence):
        steps_of(Wanderer())
    plans = plan_viewpoints(Path("nowhere"), ToyScene(), 0, 1)
    with pytest.raises(DeuxError, match=sentence):
        collect_viewpoints([plans], ToySimulator)


@pytest.mark.parametrize(
    ("rendered", "told"),
    [
        (lambda frames: None, "None"),
        (lambda frames: frames[:-1], "[02] frames"),
        (lambda frames: [None, *frames[1:]], "None"),
        (lambda frames: iter(frames), "a value of the type list_iterator"),
    ],
)
def test_the_simulator_is_named_for_frames_that_are_not_one_for_each_pose(monkeypatch, rendered, told):
    whole = ToySimulator.render
    monkeypatch.setattr(ToySimulator, "render", lambda *arguments: rendered(whole(*arguments)))
    sentence = (
        rf"^the `render` of the simulator ToySimulator gives {told}: it must be a list with a deux\.contracts\.Frame"
    )
    with pytest.raises(DeuxError, match=f"{sentence} for each pose, here 1"):
        steps_of(Wanderer())
    with pytest.raises(DeuxError, match=f"{sentence} for each pose, here 3"):
        collect_viewpoints([plan_viewpoints(Path("nowhere"), ToyScene(), 0, 1)], ToySimulator)


def test_the_measure_is_named_for_an_uncertainty_below_0():
    class Signed(L1Residual):
        def __call__(self, view):
            return super().__call__(view) - 1.0

    sentence = "^the measure of uncertainty Signed gives values below 0: it must be 0 or more for each pixel"
    with pytest.raises(DeuxError, match=sentence):
        steps_of(guided_explorer(), perception=Perception(GuessingModel(), uncertainty=Signed()))
