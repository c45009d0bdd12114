from deux.testing.learned_explorers import LearnedExplorerSuite
from deux_plugins.explorers.coverage import CoverageExplorer


class TestCoverageExplorer(LearnedExplorerSuite):
    explorer_class = CoverageExplorer
