"""What the doctor says of packages."""

import re
from importlib.metadata import version

from deux.doctor import installation_checks
from deux.doctor.checkup import Checkup
from deux.doctor.installation_checks import check_packages


def facts(checkup: Checkup) -> dict[str, str]:
    return {name: value for section in checkup.as_json()["sections"] for name, value in section["facts"]}


def test_each_dependency_is_listed_with_its_version():
    checkup = Checkup(show=False)
    check_packages(checkup)
    assert checkup.faults == 0
    for package in ("deux", "torch", "kornia", "lightning", "numba"):
        assert facts(checkup)[package] == version(package)


def test_a_dependency_that_is_missing_or_too_old_is_a_fault(monkeypatch):
    found = {"kornia": "0.6.0", "trimesh": None, "moderngl": None}
    original = installation_checks._version
    monkeypatch.setattr(installation_checks, "_version", lambda name: found.get(name, original(name)))
    checkup = Checkup(show=False)
    check_packages(checkup)
    (fault,) = checkup.as_json()["sections"][0]["faults"]
    assert re.search(r"kornia>=[\d.]+ \(0\.6\.0 installed\)", fault)
    assert re.search(r"trimesh>=[\d.]+ \(not installed\)", fault)
    assert facts(checkup)["deux[gl]"] == "lacks moderngl"
