"""Tasks on processes and on Dask: every result once, kept as it comes, and none that was there before is computed again."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from sgtd.errors import UserError
from sgtd.jobs import Task, run


def square(x: float, folder: str) -> dict:
    """Leaves a trace of each call."""
    (Path(folder) / f"{x}-{os.getpid()}").touch()
    if x < 0:
        raise ValueError(f"{x} has no root")
    return {"square": x * x, "threads": os.environ.get("RAYON_NUM_THREADS")}


def fragile(x: float, folder: str) -> float:
    """Its process dies: every time if x is negative, and the first time if it is 0."""
    trace = Path(folder) / f"tried {x}"
    first = not trace.exists()
    trace.touch()
    if x < 0 or (x == 0 and first):
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def tasks(folder: Path, numbers) -> list[Task]:
    return [Task(f"x={x}", f"{__name__}:square", {"x": x, "folder": str(folder)}) for x in numbers]


@pytest.fixture
def calls(tmp_path, monkeypatch) -> Path:
    # workers import this module by its name
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]))
    folder = tmp_path / "calls"
    folder.mkdir()
    return folder


def test_results_come_once_and_stay(calls, tmp_path):
    file = tmp_path / "results.jsonl"
    seen = []
    found = run(tasks(calls, [1, 2, -3, 4]), file, workers=2, advance=seen.append)
    assert [outcome.result and outcome.result["square"] for outcome in found] == [1, 4, None, 16]
    assert found[2].error == "-3 has no root" and seen == [1] * 4
    assert all(outcome.result["threads"] == "1" for outcome in found if not outcome.error)
    assert len(list(calls.iterdir())) == 4 and len(file.read_text().splitlines()) == 4
    # a run that was cut off while it wrote, and one task more
    file.write_text(file.read_text() + '{"key": "x=5", "resu')
    seen.clear()
    again = run(tasks(calls, [1, 2, -3, 4, 5]), file, workers=1, advance=seen.append)
    assert [outcome.result and outcome.result["square"] for outcome in again] == [1, 4, None, 16, 25]
    assert seen == [3, 1, 1] and len(list(calls.iterdir())) == 6
    assert [json.loads(line)["key"] for line in file.read_text().splitlines() if line.endswith("}")][-2:] == [
        "x=-3",
        "x=5",
    ]
    # other arguments are another task
    changed = [Task("x=1", f"{__name__}:square", {"x": 7, "folder": str(calls)})]
    assert run(changed, file, workers=1)[0].result["square"] == 49


def test_a_killed_process_loses_nothing(calls, tmp_path):
    todo = [Task(f"x={x}", f"{__name__}:fragile", {"x": x, "folder": str(calls)}) for x in (1, 0, 2, -1, 3)]
    found = run(todo, tmp_path / "r.jsonl", workers=2)
    assert [outcome.result for outcome in found] == [1, 0, 2, None, 3]
    assert "its process was killed" in found[3].error
    assert len((tmp_path / "r.jsonl").read_text().splitlines()) == 5


def test_results_count_as_long_as_they_are_valid(calls, tmp_path):
    file = tmp_path / "r.jsonl"
    run(tasks(calls, [1, 2]), file, workers=1)
    run(tasks(calls, [1, 2]), file, workers=1, still_valid=lambda outcome: outcome.task.key != "x=2")
    assert [json.loads(line)["key"] for line in file.read_text().splitlines()] == ["x=1", "x=2", "x=2"]


def test_tasks_need_names_of_their_own(calls, tmp_path):
    with pytest.raises(UserError, match="same key"):
        run(tasks(calls, [1, 1]), tmp_path / "r.jsonl")


def test_on_a_dask_cluster(calls, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        found = run(tasks(calls, [1, 2, -3]), tmp_path / "r.jsonl", scheduler=cluster.scheduler_address)
    assert [outcome.error for outcome in found] == ["", "", "-3 has no root"] and found[1].result["square"] == 4


def test_a_scheduler_that_is_not_there(calls, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(UserError, match=r"pip install 'sgtd\[dask\]'"):
        run(tasks(calls, [1]), tmp_path / "r.jsonl", scheduler="tcp://127.0.0.1:1")
