"""The guided check: which stops it takes, how it judges them, and what it keeps."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from app.contract.drive import StoppedEvent
from app.contract.robots import CheckRecord, RobotNow, StopMeasured, Velocity
from app.server import Conflict, FieldError, NotThere
from app.server.robots.check_manager import CheckManager
from app.server.robots.check_records import CheckRecords, advice
from app.server.robots.circumstances import Circumstances
from app.server.robots.guard_check import GuardCheck
from app.storage import StorageFull
from observer.rig.rig import Rig, RigMount, RigValue
from observer.robots.contract import RobotPhase, RobotReport

NOW = "2026-11-22T02:09:41.000+00:00"
STOP = StoppedEvent(
    role="observer",
    kind="guard",
    sentence="obstacle 7 is within the stopping distance",
    incident_time=100.2,
    cause_time=100.0,
    zero_time=100.02,
    stood_time=100.61,
    speed_mps=0.26,
    before_mps=0.26,
    distance_m=0.1234,
    separation_m=0.42,
)
BLIND = replace(STOP, kind="sight", sentence="vision is none", separation_m=None)
GONE = replace(STOP, kind="lease", sentence="its operator released control", separation_m=None)
REPORT = RobotReport(
    RobotPhase.CONNECTED, name="x", model="amigo-sh", watchdog_s=2.0, speed_mps=0.0
)
ROBOT = RobotNow(
    port="external:127.0.0.1:7700",
    name="amigo",
    world="real",
    state="armed",
    operator="Anna",
    present=True,
    why=None,
    commanded=Velocity(0.0, 0.0),
    sent=Velocity(0.0, 0.0),
    guard=None,
    report=REPORT,
)


def circumstances(**changes: Any) -> Circumstances:
    values = {
        "software": {"dynamic-observer": "0.5"},
        "source": "camera:0,1",
        "calibration": "abc",
        "rig": Rig(
            mount=RigMount(height_m=RigValue(0.4)),
            ports={"observer": "external:127.0.0.1:7700?key=abcdefgh12345678"},
        ),
        "guard": {"guard.margin_m": 0.08, "guard.reaction_s": 0.3},
        **changes,
    }
    return Circumstances.of(**values)


def start_check(role: Any = "observer") -> GuardCheck:
    check = GuardCheck(role, circumstances(), started_at=NOW, started_by="Anna", note="new robot")
    check.robot_said(ROBOT)
    return check


def states(check: GuardCheck) -> list[str]:
    return [step.state for step in check.steps]


def test_each_step_accepts_the_first_stop_of_its_kind_from_motion() -> None:
    check = start_check()
    assert [step.name for step in check.steps] == [
        "walk_in", "cover_lens", "unplug", "close_browser",
    ]  # fmt: skip
    check.stopped(BLIND, NOW)
    assert states(check)[0] == "waiting"
    assert "sight, not guard" in str(check.steps[0].told)
    check.stopped(replace(STOP, role="obstacle"), NOW)
    # A robot that was slowed first counts with its speed before that; one that crept does not.
    check.stopped(replace(STOP, before_mps=0.05), NOW)
    assert "at 0.05 m/s; it must be driving at 0.1" in str(check.steps[0].told)
    check.stopped(replace(STOP, before_mps=None), NOW)
    assert "unknown speed" in str(check.steps[0].told)
    check.stopped(replace(STOP, speed_mps=0.04), NOW)
    assert (states(check)[0], check.steps[0].told) == ("passed", None)
    check.stopped(BLIND, NOW)
    check.stopped(BLIND, NOW)
    assert check.present == 3
    check.stopped(replace(GONE, kind="stop"), NOW)
    assert not check.over()
    check.stopped(GONE, NOW)
    assert (check.over(), check.present, check.outcome) == (True, None, "passed")
    step = check.facts().steps[0]
    assert step.figures == StopMeasured(20.0, 610.0, 0.123, 0.04, 0.42)
    assert step.verdict == (
        "stop command sent 20 ms after the guard's decision (limit 300 ms); the robot "
        "came to a standstill after 610 ms and 0.12 m, 0.42 m from the obstacle"
    )
    assert (step.operator, step.at) == ("Anna", NOW)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"zero_time": 100.301}, "stop command sent 301 ms after the guard's decision, later than"),
        ({"zero_time": None}, "no stop command was sent"),
        ({"stood_time": None}, "did not report standstill"),
        ({"separation_m": 0.05}, "0.05 m from the obstacle: less than the margin of 0.08 m"),
    ],
)
def test_a_stop_that_breaks_the_promise_fails(changes: dict[str, Any], words: str) -> None:
    check = start_check("obstacle")
    assert [step.name for step in check.steps] == ["walk_in", "close_browser"]
    check.stopped(replace(STOP, role="obstacle", **changes), NOW)
    assert states(check) == ["failed", "waiting"]
    assert words in str(check.steps[0].verdict)
    check.stopped(replace(GONE, role="obstacle"), NOW)
    assert check.outcome == "failed"


def test_driving_is_shown_and_skips_and_aborts_name_the_operator() -> None:
    check = start_check()
    check.robot_said(replace(ROBOT, report=replace(REPORT, speed_mps=-0.2)))
    assert states(check)[0] == "driving"
    check.robot_said(None)
    assert states(check)[0] == "waiting"
    for _ in range(3):
        check.skip("Bob (10.0.0.7)", NOW)
    check.stopped(GONE, NOW)
    assert check.outcome == "incomplete"
    assert check.facts().steps[1].skipped_by == "Bob (10.0.0.7)"
    other = start_check()
    other.give_up("Bob", NOW)
    other.stopped(STOP, NOW)
    other.skip("Bob", NOW)
    assert (other.outcome, states(other)) == ("given_up", ["waiting"] * 4)


def ended(outcome: str = "passed", started_at: str = NOW) -> CheckRecord:
    check = start_check()
    check.started_at = started_at
    if outcome == "given_up":
        check.give_up("Bob", NOW)
    for stop in (STOP, BLIND, replace(BLIND, sentence="no frame came"), GONE):
        check.stopped(stop, NOW)
    return check.record(circumstances(guard={"guard.margin_m": 0.1}))


def test_a_record_is_dated_complete_and_never_overwritten(tmp_path: Path) -> None:
    records = CheckRecords(tmp_path / "guard-checks")
    assert records.all() == []
    names = [records.save(replace(ended(), started_by=str(n))) for n in range(11)]
    assert names[:2] == ["2026-11-22T0209-observer", "2026-11-22T0209-observer-2"]
    record = json.loads(records.text(names[0], "json"))
    assert record["robot"] == {"name": "amigo", "model": "amigo-sh", "watchdog_s": 2.0}
    # A port may contain a key.
    assert "127.0.0.1" not in records.text(names[0], "json")
    assert (record["outcome"], record["operators"], record["note"]) == (
        "passed", ["Anna"], "new robot",
    )  # fmt: skip
    assert (record["calibration"], record["source"]) == ("abc", "camera:0,1")
    assert "height_m: 0.4" in record["rig_yaml"]
    assert record["guard"]["guard.margin_m"] == 0.08
    assert record["software"] == {"dynamic-observer": "0.5"}
    assert record["changed_meanwhile"] == ["the guard's parameters"]
    text = records.text(names[0], "md")
    assert "| Walk in | passed | 0.26 | 20 | 610 | 0.123 | 0.42 | stop command sent 20 ms" in text
    records.save(ended("given_up", "2026-12-01T10:00:00+00:00"))
    listed = records.all()
    assert [entry.name for entry in listed] == [
        "2026-12-01T1000-observer", *reversed(names),
    ]  # fmt: skip
    assert (listed[0].outcome, listed[-1].states["unplug"]) == ("given_up", "passed")
    # A check that was given up says nothing about the guard.
    newest = records.newest("observer")
    assert newest is not None
    assert newest.started_by == "10"
    assert records.newest("obstacle") is None
    assert not [each for each in (tmp_path / "guard-checks").iterdir() if each.name[0] == "."]


def test_nothing_is_left_of_a_record_that_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace_file = os.replace

    def full(source: Path, target: Path) -> None:
        if target.suffix == ".json":
            raise OSError(errno.ENOSPC, "No space left on device")
        replace_file(source, target)

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(StorageFull):
        CheckRecords(tmp_path).save(ended())
    assert not list(tmp_path.iterdir())


def test_only_records_are_found_by_any_name(tmp_path: Path) -> None:
    folder = tmp_path / "guard-checks"
    records = CheckRecords(folder)
    records.save(ended())
    (tmp_path / "secret.json").write_text("{}")
    (folder / "notes.json").write_text("{}")
    for name in ("../secret", "notes", "", ".", "2026-11-22T0209-observer/../../secret", "a\0b"):
        with pytest.raises(NotThere):
            records.text(name, "json")
    # Foreign files and incomplete records are left out.
    for number, text in enumerate(("", "[]", "{", '{"outcome": 3}', '{"started_at": "x"}')):
        (folder / f"2026-11-23T000{number}-observer.json").write_text(text)
    assert len(records.all()) == 1
    with pytest.raises(NotThere):
        records.text("2026-11-23T0000-observer", "json")
    with pytest.raises(Conflict):
        CheckRecords(None).save(ended())
    (tmp_path / "file").write_text("")
    with pytest.raises(FieldError):
        CheckRecords(tmp_path / "file").save(ended())


def test_the_advice_states_when_to_check_again(tmp_path: Path) -> None:
    records = CheckRecords(tmp_path)
    today = datetime.fromisoformat(NOW) + timedelta(days=3)
    assert "not been checked yet" in str(advice(records.newest("observer"), circumstances(), today))
    records.save(ended())
    newest = records.newest("observer")
    assert advice(newest, circumstances(), today) is None
    # The guard does not depend on how a robot is reached.
    rig = Rig(mount=RigMount(height_m=RigValue(0.4)), ports={"observer": "/dev/ttyUSB1"})
    assert advice(newest, circumstances(rig=rig), today) is None
    later = str(advice(newest, circumstances(), today + timedelta(days=30)))
    assert later == "Check again: the latest check is 33 days old."
    for changes, words in (
        ({"rig": Rig()}, "the rig changed"),
        ({"calibration": None}, "the calibration changed"),
        ({"guard": {"guard.margin_m": 0.2}}, "the guard's parameters changed"),
    ):
        assert words in str(advice(newest, circumstances(**changes), today))
    assert newest is not None
    own = replace(newest, calibration=None)
    assert advice(own, circumstances(calibration=None), today) is None
    other = circumstances(calibration=None, source="camera:2,3")
    assert "the calibration changed" in str(advice(own, other, today))


def checks_at(folder: Path, work: list[Any]) -> CheckManager:
    return CheckManager(
        folder, circumstances, changed=lambda: None, soon=work.append, clock=lambda: 101.0
    )


async def test_an_unwritable_record_is_not_lost(tmp_path: Path) -> None:
    work: list[Any] = []
    in_the_way = tmp_path / "guard-checks"
    in_the_way.write_text("")
    checks = checks_at(in_the_way, work)
    checks.start("observer", None, "Anna")
    with pytest.raises(Conflict, match="in progress"):
        checks.start("obstacle", None, "Bob")
    for _ in range(3):
        await checks.skip("Anna")
    checks.stopped(GONE)
    await work.pop()
    facts = checks.facts()
    assert (facts.record, facts.outcome) == (None, "incomplete")
    assert "could not be saved" in facts.trouble
    with pytest.raises(Conflict, match="not saved yet"):
        checks.start("observer", None, "Anna")
    with pytest.raises(FieldError):
        await checks.give_up("Anna")
    in_the_way.unlink()
    await checks.give_up("Anna")
    facts = checks.facts()
    assert (facts.outcome, facts.trouble) == ("incomplete", None)
    assert (in_the_way / f"{facts.record}.md").exists()
    with pytest.raises(Conflict, match="no check"):
        await checks.give_up("Anna")
    checks.start("observer", None, "Anna")


async def test_closing_the_server_saves_an_unfinished_check(tmp_path: Path) -> None:
    checks = checks_at(tmp_path, [])
    await checks.close()
    checks.start("observer", None, "Anna")
    checks.stopped(STOP)
    await checks.close()
    await checks.close()
    (entry,) = checks.records.all()
    assert (entry.outcome, entry.states["walk_in"]) == ("given_up", "passed")
    record = json.loads(checks.records.text(entry.name, "json"))
    assert record["given_up_by"] == "the server shutting down"
    started = datetime.fromisoformat(record["started_at"])
    assert abs(datetime.now(UTC) - started) < timedelta(minutes=1)
