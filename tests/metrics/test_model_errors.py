import numpy as np
import pytest
import torch

from deux.contracts import Batch, DepthModel, Prediction
from deux.errors import DeuxError
from deux.geometry.depth_correction import correct_depth
from deux.geometry.scaffolding import interpolate
from deux.metrics.depth_errors import depth_errors
from deux.metrics.model_errors import evaluate


class Constant(DepthModel):
    """Predicts the same depth everywhere."""

    min_depth, max_depth = 0.1, 10.0

    def __init__(self, depth: float) -> None:
        super().__init__()
        self.depth = torch.nn.Parameter(torch.tensor(depth))

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        return Prediction(self.depth.expand_as(sparse_depth))


def batch(seed: int = 0, frames: int = 2, size: int = 16) -> Batch:
    rng = np.random.default_rng(seed)
    truth = torch.from_numpy(rng.uniform(1.0, 4.0, (frames, 1, size, size))).float()
    sparse = torch.where(torch.from_numpy(rng.random(truth.shape) < 0.2), truth, 0.0)
    image = torch.from_numpy(rng.random((frames, 3, size, size))).float()
    intrinsics = torch.tensor([[8.0, 0.0, 7.5], [0.0, 8.0, 7.5], [0.0, 0.0, 1.0]]).expand(frames, 3, 3)
    still = torch.eye(4).expand(frames, 2, 4, 4)
    sources = image[:, None].expand(-1, 2, -1, -1, -1)
    return Batch(image, sources, sparse, (sparse > 0).float(), sparse, intrinsics, still, ground_truth=truth)


def test_the_model_and_both_baselines_are_measured_on_the_same_frames():
    batches = [batch(0), batch(1)]
    counted = []
    found = evaluate(Constant(2.0), batches, progress=counted.append)
    assert (found.images, counted) == (4, [2, 2])
    frames = [(b.ground_truth[i : i + 1], b.sparse_depth[i, 0].numpy()) for b in batches for i in range(2)]
    mine = np.mean([depth_errors(torch.full_like(truth, 2.0), truth)["mae"].item() for truth, _ in frames])
    linear = [torch.from_numpy(interpolate(sparse))[None, None] for _, sparse in frames]
    theirs = np.mean(
        [depth_errors(dense, truth)["rmse"].item() for dense, (truth, _) in zip(linear, frames, strict=True)]
    )
    assert found.metrics["mae"] == pytest.approx(mine)
    assert found.baseline["rmse"] == pytest.approx(theirs)
    assert found.constant["mae"] > 0


def test_the_corrected_depth_is_measured_too():
    batches = [batch(0), batch(1)]
    batches[1].ground_truth = batches[1].sparse_depth = torch.full_like(batches[1].ground_truth, 3.0)
    found = evaluate(Constant(2.0), batches)
    assert found.corrected.keys() == found.metrics.keys()
    frames = [correct_depth(torch.full_like(b.sparse_depth, 2.0), b.sparse_depth) for b in batches]
    mine = [depth_errors(depth, b.ground_truth)["mae"] for depth, b in zip(frames, batches, strict=True)]
    assert found.corrected["mae"] == pytest.approx(torch.cat(mine).mean().item())
    right = evaluate(Constant(2.0), batches[1:])
    assert right.metrics["mae"] == pytest.approx(1000.0)
    assert right.corrected["mae"] < 20.0


def test_in_a_frame_without_points_the_baselines_are_the_median_of_the_other_frames():
    """They are not 0, whose inverse would rule the mean, and no frame is left out."""
    first, second = batch(0), batch(1)
    second.sparse_depth[1] = 0.0
    found = evaluate(Constant(2.0), [first, second])
    assert (found.images, found.without_points, found.without_truth) == (4, 1, 0)
    frames = [(b.ground_truth[i : i + 1], b.sparse_depth[i, 0].numpy()) for b in (first, second) for i in range(2)]
    medians = [float(np.median(sparse[sparse > 0])) for _, sparse in frames[:3]]
    assert found.constant["imae"] == pytest.approx(
        np.mean(
            [
                depth_errors(torch.full_like(truth, median), truth)["imae"].item()
                for (truth, _), median in zip(frames, [*medians, np.median(medians)], strict=True)
            ]
        )
    )
    dense = [torch.from_numpy(interpolate(sparse))[None, None] for _, sparse in frames[:3]]
    dense.append(torch.full_like(dense[0], float(np.median(medians))))
    theirs = [depth_errors(depth, truth)["irmse"].item() for depth, (truth, _) in zip(dense, frames, strict=True)]
    assert found.baseline["irmse"] == pytest.approx(np.mean(theirs))


def test_without_any_point_there_is_no_baseline():
    empty = batch()
    empty.sparse_depth = torch.zeros_like(empty.sparse_depth)
    found = evaluate(Constant(2.0), [empty])
    assert found.without_points == 2
    assert all(np.isnan(value) for value in (*found.baseline.values(), *found.constant.values()))
    assert all(np.isfinite(value) for value in found.metrics.values())


def test_frames_without_ground_truth_in_range_are_counted():
    dark = batch()
    dark.ground_truth[1] = 20.0
    found = evaluate(Constant(2.0), [dark])
    assert (found.images, found.without_truth) == (2, 1)


def test_no_source_frame_is_looked_at():
    single = batch()
    single.sources, single.source_from_target = single.sources[:, :0], None
    assert evaluate(Constant(2.0), [single]).metrics == evaluate(Constant(2.0), [batch()]).metrics


def test_what_is_missing_is_named_in_the_error():
    blind = batch()
    blind.ground_truth = None
    with pytest.raises(DeuxError, match="loaded without it"):
        evaluate(Constant(2.0), [blind])
    with pytest.raises(DeuxError, match="none of the 0 test frames"):
        evaluate(Constant(2.0), [])
    with pytest.raises(
        DeuxError, match=r"none of the 2 test frames has ground truth between 5\.0 and 6\.0 m.* its maximum is"
    ):
        evaluate(Constant(2.0), [batch()], min_depth=5.0, max_depth=6.0)
    empty = batch()
    empty.ground_truth = torch.zeros_like(empty.ground_truth)
    with pytest.raises(DeuxError, match=r"^none of the 2 test frames has ground truth: the maps contain only 0"):
        evaluate(Constant(2.0), [empty])


def test_the_constant_baseline_is_the_median_of_the_points():
    one = batch(frames=1)
    one.sparse_depth = torch.zeros_like(one.sparse_depth)
    one.sparse_depth.view(-1)[[0, 5, 9]] = torch.tensor([1.0, 2.0, 7.0])
    expected = depth_errors(torch.full_like(one.ground_truth, 2.0), one.ground_truth)
    assert evaluate(Constant(1.0), [one]).constant == pytest.approx({n: v.item() for n, v in expected.items()})


class Broken(Constant):
    """Predicts a depth of its own in one corner of each image, and with it only the images of a batch from `first`."""

    def __init__(self, corner: float, first: int) -> None:
        super().__init__(2.0)
        self.corner, self.first = corner, first

    def forward(self, image, sparse_depth, validity, intrinsics, **prepared):
        depth = self.depth.expand_as(sparse_depth).clone()
        depth[self.first :, :, :2, :3] = self.corner
        return Prediction(depth)


@pytest.mark.parametrize("corner", [float("nan"), float("inf"), 0.0, -2.0])
def test_a_prediction_that_is_no_depth_is_an_error_that_names_the_frame(corner):
    sentence = "test frame 1 .* is not finite or not above 0 at 6 pixels with ground truth"
    with pytest.raises(DeuxError, match=sentence) as caught:
        evaluate(Broken(corner, first=1), [batch(0), batch(1)])
    assert "\n" not in str(caught.value)
    with pytest.raises(DeuxError, match="test frame 2 "):
        evaluate(Broken(corner, first=0), iter([batch_without_corner(), batch(1)]))


def batch_without_corner() -> Batch:
    """A batch whose ground truth says nothing of the corner."""
    found = batch()
    found.ground_truth[:, :, :2, :3] = 0.0
    return found


def test_the_errors_of_each_scene_are_the_means_of_its_frames():
    """Frames without points, whose interpolation is known last, stay with their scene."""
    first, second = batch(0, frames=3), batch(1, frames=2)
    first.sparse_depth[1] = 0.0
    second.ground_truth[1] = 0.0  # counts nowhere
    found = evaluate(Constant(2.0), [first, second], scenes=["b", "b", "a", "a", "a"])
    assert [(one.scene, one.frames) for one in found.scenes] == [("a", 2), ("b", 2)]
    for name in ("mae", "irmse"):
        for part in ("metrics", "baseline"):
            mean = np.mean([getattr(one, part)[name] for one in found.scenes])  # of equally many frames each
            assert mean == pytest.approx(getattr(found, part)[name], abs=2e-3)
    truth, points = first.ground_truth[:2], first.sparse_depth[0, 0].numpy()
    medians = [
        np.median(one[one > 0]) for one in (*first.sparse_depth[[0, 2], 0].numpy(), *second.sparse_depth.numpy())
    ]
    dense = torch.stack([torch.from_numpy(interpolate(points)), torch.full(truth.shape[2:], float(np.median(medians)))])
    expected = depth_errors(dense[:, None], truth)["mae"].mean().item()
    assert found.scenes[1].baseline["mae"] == pytest.approx(expected, abs=2e-3)


def test_no_errors_by_scene_without_their_names():
    assert evaluate(Constant(2.0), [batch(0)]).scenes == []
