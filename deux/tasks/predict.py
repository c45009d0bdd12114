"""`task=predict`: complete the depth of one or many frames from files."""

from omegaconf import DictConfig

from deux.configuration import sections_of
from deux.figures.viewer_recording import check_viewer
from deux.geometry.camera import Camera
from deux.tasks.checkpoints import load_required_model
from deux.tasks.console import quieten_libraries
from deux.tasks.frame_prediction import predict_frame
from deux.tasks.predict_settings import PredictSettings
from deux.tasks.sequence_prediction import predict_sequences


def run(cfg: DictConfig) -> None:
    """Complete the depth of `predict.image` or of the frames of `predict.data` with the model `predict.checkpoint`."""
    quieten_libraries()
    sections = sections_of(cfg)
    settings, camera = sections.read("predict", PredictSettings), sections.read("camera", Camera)
    if settings.viewer:
        check_viewer("predict.viewer")
    measure = settings.make_measure()
    name, model = load_required_model(sections.plugin("model"), settings.checkpoint, "predict.checkpoint")
    if settings.data is None:
        predict_frame(settings, name, model, measure, camera)
    else:
        predict_sequences(sections, settings, name, model, measure)
