"""Houses that several tests look at."""

import pytest

from deux.contracts import Scene
from deux_plugins.scenes.houses import house

SEEDS = (0, 2)


@pytest.fixture(scope="session")
def houses() -> dict[int, Scene]:
    return {seed: house(seed) for seed in SEEDS}


@pytest.fixture(scope="session", params=SEEDS)
def building(request: pytest.FixtureRequest, houses: dict[int, Scene]) -> Scene:
    return houses[request.param]
