"""The adapter to Habitat-Sim: `simulator=habitat`. Habitat-Sim is imported when such a simulator is made."""

from deux_plugins.simulators.habitat.habitat_simulator import HabitatSimulator

__all__ = ["HabitatSimulator"]
