"""Kill commands repeatedly and compare their final files: `python -m deux.testing.kills`.

Each command runs once without a kill. In each pass it is then started and killed by SIGKILL repeatedly until a start
completes. The resulting files must equal those of the uninterrupted run, without additional files. Passes alternate
between two kinds: in the first, the k-th start is killed at its k-th call of `os.replace` or `os.rename`, alternately
before and after the call; in the second, starts are killed at random times, in some scenarios only one of several
processes. Passes are repeated until the requested number of kills is reached.
"""

import argparse
import logging
import random
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path

from deux.errors import DeuxError, near_matches
from deux.io.atomic import write_json
from deux.testing.kill_scenarios import SCENARIOS, Scenario, preparation
from deux.testing.killed_commands import Ending, Hung, Kill, KillAfter, KillAtMove, preload, run_command
from deux.testing.left_files import differences, digests

MOST_OF_A_PASS = 12
"""Maximum number of kills at random times in one pass, after which the command is not killed."""

_PREPARED, _WORK = "prepared", "killed"

log = logging.getLogger(__name__)


@dataclass
class Count:
    """Result of a scenario.

    Args:
        scenario: name of the scenario.
        kills: number of kills that ended a process.
        restarts: number of starts after a kill.
        passes: number of passes.
        differences: descriptions of all faults, empty if all passes ended like the uninterrupted run.
    """

    scenario: str
    kills: int = 0
    restarts: int = 0
    passes: int = 0
    differences: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        found = len(self.differences)
        return f"{self.scenario:18}{self.kills:7}{self.restarts:10}{self.passes:8}{found:13}"


HEADER = f"{'scenario':18}{'kills':>7}{'restarts':>10}{'passes':>8}{'differences':>13}"


class Campaign:
    """Runs kill tests of scenarios.

    Args:
        folder: parent of the folder in which all commands run. They use the same one, since some files contain paths.
        seed: seed of the random times of the kills.
        patience: time limit of a start in seconds.
    """

    def __init__(self, folder: Path, seed: int = 0, patience: float = 1800.0) -> None:
        self.folder = folder
        self._random = random.Random(seed)
        self._patience = patience

    def run(self, name: str, kills: int) -> Count:
        """Kill the command of a scenario a given number of times.

        Args:
            name: name of the scenario.
            kills: number of kills.

        Returns:
            The counts and the faults. It ends early after 20 faults.

        Raises:
            DeuxError: the command fails or hangs without a kill.
        """
        scenario, count = SCENARIOS[name], Count(name)
        self._begin(scenario)
        try:
            unbroken = self._start(scenario, None)
        except Hung as hung:
            raise DeuxError(f"the scenario {name} hangs before any kill: {hung}.") from hung
        if unbroken.code != 0:
            raise DeuxError(f"the scenario {name} fails before any kill: {_last_line(unbroken.errors)}")
        preload(self.folder / _WORK)
        expected = digests(self.folder / _WORK, scenario.varying)
        while count.kills < kills and len(count.differences) < 20:
            plans = [self._at_moves(count.passes), self._at_random_times(scenario, unbroken.seconds)]
            self._pass(scenario, plans[count.passes % 2], kills, count)
            if count.kills:
                found = differences(expected, digests(self.folder / _WORK, scenario.varying))
                count.differences += [f"pass {count.passes}: {one}" for one in found]
            count.passes += 1
        return count

    def _pass(self, scenario: Scenario, plan: Iterator[Kill], kills: int, count: Count) -> None:
        """Start and kill the command until it completes."""
        self._begin(scenario)
        before = count.kills
        while True:
            kill = next(plan, None) if count.kills < kills else None
            count.restarts += count.kills > before
            try:
                ending = self._start(scenario, kill)
            except Hung as hung:
                count.differences.append(f"pass {count.passes}: {hung} after {kill}")
                return
            count.kills += ending.killed
            log.info("%s: %s, exit code %d after %.1f s", count.scenario, kill, ending.code, ending.seconds)
            if "Traceback" in ending.errors and not (ending.killed and _kills_all(kill)):
                count.differences.append(
                    f"pass {count.passes}: a stack trace after {kill}: {_last_line(ending.errors)}"
                )
            if ending.killed and ending.code != 0:
                continue
            if ending.code != 0:
                count.differences.append(
                    f"pass {count.passes}: ended with code {ending.code}: {_last_line(ending.errors)}"
                )
            return

    def _begin(self, scenario: Scenario) -> None:
        """Create the working folder: an empty one, or a copy of the prepared one."""
        work, prepared = self.folder / _WORK, self.folder / _PREPARED
        shutil.rmtree(work, ignore_errors=True)
        if not scenario.prepared:
            work.mkdir(parents=True)
            return
        if not prepared.exists():
            work.mkdir(parents=True)
            ending = run_command(preparation(), work, patience=self._patience)
            if ending.code != 0:
                raise DeuxError(f"the experiment that scenarios begin after fails: {_last_line(ending.errors)}")
            preload(work)
            work.rename(prepared)
        shutil.copytree(prepared, work, ignore=shutil.ignore_patterns("command.*"))

    def _start(self, scenario: Scenario, kill: Kill | None) -> Ending:
        work = self.folder / _WORK
        return run_command(scenario.arguments(work), work, kill, self._patience)

    def _at_moves(self, number: int) -> Iterator[Kill]:
        """Kills of a pass: the k-th start at its k-th move."""
        for move in range(1, 10_000):
            yield KillAtMove(move, before=(move + number // 2) % 2 == 0)

    def _at_random_times(self, scenario: Scenario, seconds: float) -> Iterator[Kill]:
        """Kills of a pass: at random times within the duration of an uninterrupted run."""
        for _ in range(MOST_OF_A_PASS):
            alone = scenario.children and self._random.random() < 0.5
            child = self._random.randrange(1000) if alone else None
            yield KillAfter(self._random.uniform(0.02, 1.0) * seconds, child)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run kill tests, print their table and return the exit code: 0 without faults, otherwise 1."""
    options = _parser().parse_args(arguments)
    names = options.scenarios or [name for name, scenario in SCENARIOS.items() if scenario.installed]
    unknown = next((name for name in names if name not in SCENARIOS), None)
    if unknown is not None:
        print(f"deux: there is no scenario {unknown!r}: {near_matches(unknown, SCENARIOS)}", file=sys.stderr)
        return 1
    if options.verbose:
        logging.basicConfig(format="%(message)s", level=logging.INFO)
    counts = []
    with ExitStack() as stack:
        folder = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="deux-kills-")))
        campaign = Campaign(folder.resolve(), options.seed)
        print(HEADER, flush=True)
        try:
            for name in names:
                counts.append(campaign.run(name, options.kills))
                print(counts[-1], flush=True)
                if options.json is not None:
                    write_json(options.json, [asdict(count) for count in counts])
        except DeuxError as error:
            print(f"deux: {error}", file=sys.stderr)
            return 1
    found = [f"{count.scenario}, {one}" for count in counts for one in count.differences]
    print("\n".join([f"{'all':18}{sum(c.kills for c in counts):7}{sum(c.restarts for c in counts):10}", *found]))
    return 1 if found else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m deux.testing.kills", description=(__doc__ or "").partition(":")[0])
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"default: all of {', '.join(SCENARIOS)}")
    parser.add_argument("--kills", type=int, default=20, metavar="N", help="of each scenario; default: 20")
    parser.add_argument("--seed", type=int, default=0, help="of the times of the kills; default: 0")
    parser.add_argument("--folder", type=Path, metavar="PATH", help="where commands run; default: a temporary folder")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write the counts to this file, too")
    parser.add_argument("--verbose", action="store_true", help="tell each start and kill on stderr")
    return parser


def _kills_all(kill: Kill | None) -> bool:
    return not (isinstance(kill, KillAfter) and kill.child is not None)


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["without a word"])[-1]


if __name__ == "__main__":
    sys.exit(main())
