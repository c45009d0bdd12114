import pytest

from deux.training.fit import _arithmetic, _graphed, make_trainer
from deux.training.training_settings import TrainingSettings


def test_the_log_says_what_a_training_computes_with():
    trainer = make_trainer(
        {"accelerator": "cpu", "precision": "bf16-mixed", "logger": False, "enable_checkpointing": False}
    )
    assert _arithmetic(trainer, TrainingSettings()) == (
        "training on 1 x CPU with precision bf16-mixed, float32 convolutions exact, not compiled"
    )
    assert _arithmetic(trainer, TrainingSettings(tf32=True, compile=True)).endswith(
        "float32 convolutions in TensorFloat-32, compiled (default)"
    )
    assert _arithmetic(trainer, TrainingSettings(compile="max-autotune")).endswith("compiled (max-autotune)")


@pytest.mark.parametrize(
    ("settings", "graphed"),
    [({}, True), ({"compile": True}, True), ({"compile": "reduce-overhead"}, False), ({"cuda_graphs": False}, False)],
)
def test_no_graph_is_recorded_inside_another(settings, graphed):
    assert _graphed(TrainingSettings(**settings)) is graphed
