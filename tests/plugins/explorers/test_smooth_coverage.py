from deux.testing.learned_explorers import LearnedExplorerSuite
from deux_plugins.explorers.smooth_coverage import SmoothCoverageExplorer


class TestSmoothCoverageExplorer(LearnedExplorerSuite):
    explorer_class = SmoothCoverageExplorer
