"""Whether a plugin fulfils the contract of its kind, as the registry checks it."""

from pathlib import Path
from typing import Any

import pytest
import torch

from deux.contracts import DepthModel, Explorer, LossInputs, LossTerm, Need, Reader, SceneSource
from deux.errors import DeuxError
from deux.registry import Registry, registry


class Mean(LossTerm):
    def __call__(self, inputs: LossInputs) -> torch.Tensor:
        return inputs.prediction.depth.mean()


def test_an_option_without_a_name_is_refused() -> None:
    class ByPlace(Mean):
        def __init__(self, gain: float = 1.0, /, offset: float = 0.0) -> None: ...

    with pytest.raises(
        DeuxError, match="positional-only parameter 'gain', but options are passed by name: remove the /"
    ):
        Registry().register("losses", "by_place", ByPlace)


def test_a_constructor_that_does_not_take_what_it_is_given_is_refused() -> None:
    class Homeless(Reader):
        def __init__(self, points: int = 3) -> None: ...

        triplets = image = intrinsics = sparse_depth = None  # type: ignore[assignment]

    class Open(Homeless):
        def __init__(self, **settings: Any) -> None: ...

    class Colourless(registry().get("simulators", "mesh")):  # type: ignore[misc]
        def __init__(self, scene: Any, camera: Any, robot: Any) -> None: ...

    found = Registry()
    with pytest.raises(DeuxError, match="does not take 'folder': the constructor of a reader begins with self, folder"):
        found.register("readers", "homeless", Homeless)
    with pytest.raises(DeuxError, match=r"does not take 'colors': .* begins with self, scene, camera, robot, colors,"):
        found.register("simulators", "colourless", Colourless)
    assert found.register("readers", "open", Open)


def test_a_source_of_scenes_without_the_options_of_its_splits_is_refused() -> None:
    class Single(SceneSource):
        def __init__(self, folder: str = "", train: int = 1, test: int = 1) -> None: ...

        splits = None  # type: ignore[assignment]

    class Open(Single):
        def __init__(self, **options: Any) -> None: ...

    with pytest.raises(DeuxError, match=r"'mine' of .* has no option 'validation': .* train, validation, test"):
        Registry().register("scenes", "mine", Single)
    assert Registry().register("scenes", "open", Open).name == "open"


def test_a_reader_with_an_option_of_the_frameworks_own_is_refused() -> None:
    class Cached(Reader):
        def __init__(self, folder: Path, cache: int = 3) -> None:
            self.folder = folder

        triplets = image = intrinsics = sparse_depth = None  # type: ignore[assignment]

    with pytest.raises(DeuxError, match=r"has an option called 'cache', and data\.cache is an option of deux's own: "):
        Registry().register("readers", "cached", Cached)


NEEDS = r"it must be a frozenset of deux\.contracts\.Need, as in needs = frozenset\(\{Need\.SENSOR_DEPTH\}\)\.$"
DECLARED = [
    ("explorers", "needs", {Need.LABELS}, NEEDS),
    ("explorers", "needs", Need.LABELS, NEEDS),
    ("explorers", "needs", "labels", NEEDS),
    ("explorers", "needs", frozenset({"labels"}), NEEDS),
    ("losses", "needs", frozenset({"reconstruction"}), r"a frozenset of deux\.contracts\.LossNeed, as in needs = "),
    ("losses", "extras", "prior", r"it must be a frozenset of text, as in extras = frozenset\(\{\"prior\"\}\)\.$"),
]


@pytest.mark.parametrize(("kind", "attribute", "value", "sentence"), DECLARED)
def test_what_a_plugin_declares_is_a_frozenset(kind: str, attribute: str, value: Any, sentence: str) -> None:
    class Resting(Explorer):
        reset = act = None  # type: ignore[assignment]

    contract = {"explorers": Resting, "losses": Mean}[kind]
    found = Registry()
    found.register(kind, "mine", type("Mine", (contract,), {attribute: value}))
    with pytest.raises(DeuxError, match=rf"'mine' of registered by hand .* has {attribute} = .*: .*{sentence}"):
        found.create(kind, "mine", {})


def test_a_missing_attribute_of_the_contract_is_reported_when_the_plugin_is_made() -> None:
    class Unbounded(DepthModel):
        min_depth = 0.1

        def forward(self, image: Any, sparse_depth: Any, validity: Any, intrinsics: Any, **prepared: Any) -> Any: ...

    class Homeless(Reader):
        def __init__(self, folder: Path) -> None: ...

        triplets = image = intrinsics = sparse_depth = None  # type: ignore[assignment]

    class Lazy(Homeless):
        @property
        def folder(self) -> Path:  # type: ignore[override]
            raise AssertionError("asked for")

    found = Registry()
    for kind, cls in (("depth_models", Unbounded), ("readers", Homeless), ("readers", Lazy)):
        found.register(kind, cls.__name__, cls)
    with pytest.raises(DeuxError, match=r"^the depth model 'Unbounded' of .* has no max_depth: its class or its const"):
        found.create("depth_models", "Unbounded", {})
    with pytest.raises(DeuxError, match=r"^the reader 'Homeless' of .* has no folder"):
        found.create("readers", "Homeless", {}, Path())
    assert found.create("readers", "Lazy", {}, Path())


def test_options_called_name_and_weights_of_loss_terms_are_the_frameworks_own() -> None:
    class Named(Mean):
        def __init__(self, name: str = "bob") -> None:
            self.name = name

    class Weighted(Mean):
        def __init__(self, weight: float = 2.0) -> None:
            self.weight = weight

    for cls, option in ((Named, "name"), (Weighted, "weight")):
        own = rf"has an option called '{option}', and objective\.mine\.{option} is an option of deux's own: rename the"
        with pytest.raises(DeuxError, match=own):
            Registry().register("losses", "mine", cls)


@pytest.mark.parametrize(
    ("least", "most"),
    [(10.0, 0.1), (1.0, 1.0), (-1.0, 10.0), (0.1, float("inf")), (float("nan"), 1.0), ("0.1", 10.0), (None, None)],
)
def test_a_depth_range_that_is_empty_or_no_range_is_refused(least: Any, most: Any) -> None:
    class Ranged(DepthModel):
        min_depth, max_depth = 0.0, 80

        def forward(self, image: Any, sparse_depth: Any, validity: Any, intrinsics: Any, **prepared: Any) -> Any: ...

    class Odd(Ranged):
        min_depth, max_depth = least, most

    found = Registry()
    found.register("depth_models", "ranged", Ranged)
    found.register("depth_models", "odd", Odd)
    assert found.create("depth_models", "ranged", {})
    with pytest.raises(DeuxError, match=r"^the depth model 'odd' of .* has min_depth = .* and max_depth = .*: they"):
        found.create("depth_models", "odd", {})


@pytest.mark.parametrize(
    "use",
    [
        lambda model: setattr(model, "layer", torch.nn.Conv2d(5, 1, 1)),
        lambda model: setattr(model, "scale", torch.nn.Parameter(torch.ones(()))),
        lambda model: model.register_buffer("scale", torch.ones(())),
        lambda model: list(model.parameters()),
        lambda model: model.requires_grad_(False),
        lambda model: model.eval(),
        lambda model: model.register_forward_hook(print),
        lambda model: None,
    ],
)
def test_a_model_that_is_used_before_super_init_is_reported(use: Any) -> None:
    class Early(DepthModel):
        min_depth, max_depth = 0.1, 10.0

        def __init__(self) -> None:
            use(self)

        def forward(self, image: Any, sparse_depth: Any, validity: Any, intrinsics: Any, **prepared: Any) -> Any: ...

    found = Registry()
    found.register("depth_models", "early", Early)
    with pytest.raises(
        DeuxError,
        match=r"^the depth model 'early' of .* (not initialised|uninitialised).* must .* super\(\)\.__init__\(\)",
    ):
        found.create("depth_models", "early", {})


def test_other_mistakes_of_a_constructor_are_its_own() -> None:
    class Mistaken(DepthModel):
        min_depth, max_depth = 0.1, 10.0

        def __init__(self) -> None:
            super().__init__()
            self.layer = self.missing

        def forward(self, image: Any, sparse_depth: Any, validity: Any, intrinsics: Any, **prepared: Any) -> Any: ...

    found = Registry()
    found.register("depth_models", "mistaken", Mistaken)
    with pytest.raises(AttributeError, match="missing"):
        found.create("depth_models", "mistaken", {})


def test_a_method_with_other_parameters_than_the_contracts_is_refused() -> None:
    class Older(LossTerm):
        def __call__(self, batch: Any, prediction: Any, reconstructions: Any) -> torch.Tensor: ...  # type: ignore[override]

    class Posed(DepthModel):
        def forward(self, *inputs: Any, **prepared: Any) -> Any: ...

        def pose_network(self, size: int) -> Any: ...  # type: ignore[override]

    class Roomy(Explorer):
        def reset(self, *anything: Any) -> None: ...

        def act(self, observation: Any, greedy: bool = False) -> Any: ...

    found = Registry()
    called = (
        r"^the loss term 'a' of .* defines __call__\(self, batch, prediction, reconstructions\), and it is called as "
    )
    with pytest.raises(DeuxError, match=called + r"__call__\(self, inputs\): give it these parameters\."):
        found.register("losses", "a", Older)
    with pytest.raises(DeuxError, match=r"pose_network\(self, size\), and it is called as pose_network\(self\)"):
        found.register("depth_models", "a", Posed)
    assert found.register("explorers", "a", Roomy)
