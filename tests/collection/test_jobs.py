"""Jobs shared out among workers: which plans meet in a job, and what is counted of those that are finished."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from toy_world import ToyScene

from deux.collection.jobs import Job, Plan, run_here, run_unfinished, share_out


@dataclass(frozen=True)
class Note(Plan):
    """A file of one word, of a size of ten."""

    @property
    def size(self) -> int:
        return 10

    @property
    def finished(self) -> bool:
        return self.folder.exists()


def jobs_of(folder: Path, *sizes: int, divisible: bool = True) -> list[Job[Note]]:
    notes = iter([Note(folder / str(number), ToyScene()) for number in range(sum(sizes))])
    return [Job(tuple(next(notes) for _ in range(size)), divisible) for size in sizes]


def write(job: Job[Note], count) -> None:
    for note in job.plans:
        note.folder.write_text("done")
        count(note.size)


@pytest.mark.parametrize(
    ("sizes", "workers", "expected"),
    [
        ((4,), 1, [4]),
        ((4,), 2, [2, 2]),
        ((4,), 3, [2, 1, 1]),
        ((4,), 100, [1, 1, 1, 1]),
        ((4, 4), 2, [4, 4]),
        ((4, 4, 2), 2, [3, 3, 2, 2]),
        ((4, 4, 4, 4), 2, [4, 4, 4, 4]),
        ((4, 1), 2, [3, 2]),
        ((1, 1, 1), 2, [1, 1, 1]),
    ],
)
def test_divisible_jobs_keep_all_workers_busy_and_grow_no_larger(tmp_path, sizes, workers, expected):
    jobs = jobs_of(tmp_path, *sizes)
    shared = share_out(jobs, workers, lambda new: pytest.fail("nothing is finished"))
    assert [len(job.plans) for job in shared] == expected
    assert [plan for job in shared for plan in job.plans] == [plan for job in jobs for plan in job.plans]
    assert all(job.divisible for job in shared)


def test_other_jobs_stay_as_they_are(tmp_path):
    jobs = jobs_of(tmp_path, 4, 2, divisible=False)
    (tmp_path / "1").touch()
    assert share_out(jobs, 5, lambda new: pytest.fail("the whole job runs")) == jobs


def test_of_divisible_jobs_what_is_finished_is_left_out(tmp_path):
    counted: list[int] = []
    for number in (0, 2, 3):
        (tmp_path / str(number)).touch()
    shared = share_out(jobs_of(tmp_path, 4, 2), 2, counted.append)
    assert [[plan.folder.name for plan in job.plans] for job in shared] == [["1", "4"], ["5"]]
    assert counted == [30]


@pytest.mark.parametrize("divisible", [True, False])
def test_progress_reaches_the_end_wherever_an_earlier_run_stopped(tmp_path, divisible):
    told: list[tuple[str, int, int]] = []
    for number in (0, 1, 2):
        (tmp_path / str(number)).touch()
    jobs = jobs_of(tmp_path, 2, 2, 1, divisible=divisible)
    run_unfinished("notes", write, jobs, run_here, lambda *report: told.append(report))
    assert all((tmp_path / str(number)).exists() for number in range(5))
    assert told == sorted(told)
    assert told[-1] == ("notes", 50, 50)
    assert told[0][1] == 30  # those that were done, whether or not they are done again with the rest of their job
    assert [(tmp_path / str(k)).read_text() for k in range(5)] == ["", "", "" if divisible else "done", "done", "done"]
    told.clear()
    run_unfinished("notes", write, jobs, run_here, lambda *report: told.append(report))
    assert told == []


def test_messages_name_the_folders_of_a_job_but_not_dozens(tmp_path):
    assert [str(job) for job in jobs_of(tmp_path, 1, 4, 9)] == ["0", "1 and 2 and 3 and 4", "5 to 13"]
