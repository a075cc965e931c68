from __future__ import annotations

from store import AuditLine


def test_the_last_heartbeat_of_an_executor_is_kept(store):
    assert store.cell_status("a") is None
    assert store.take_cell("a", "one", "sim", "here")
    assert store.record_heartbeat("a", "one", "sim", {"mode": "RUNNING"})
    store.leave_cell("a", "one")
    assert store.take_cell("a", "two", "sim", "there")
    assert store.record_heartbeat("a", "two", "sim", {"mode": "IDLE"}, fault={"reason": "late"}, read_only=True)
    row = store.cell_status("a")
    assert (row.executor_id, row.robot, row.fault, row.read_only) == ("two", {"mode": "IDLE"}, {"reason": "late"}, True)
    assert [r.cell for r in store.cell_statuses()] == ["a"]
    store.record_heartbeat("a", "two", "sim")
    assert store.cell_status("a").fault is None


def test_a_cell_has_one_executor(store):
    assert store.take_cell("a", "one", "sim", "here")
    assert not store.take_cell("a", "two", "sim", "there")
    assert not store.record_heartbeat("a", "two", "sim", {"mode": "IDLE"})
    row = store.cell_status("a")
    assert (row.executor_id, row.held_by, row.robot) == ("one", "here", {})


def test_who_is_seen_to_be_silent_is_replaced_unless_it_beats_meanwhile(store):
    store.take_cell("a", "one", "sim", "here")
    seen = store.cell_status("a")
    assert store.record_heartbeat("a", "one", "sim")
    assert not store.take_cell("a", "two", "sim", "there", seen)
    seen = store.cell_status("a")
    assert store.take_cell("a", "two", "sim", "there", seen)
    assert not store.take_cell("a", "three", "sim", "elsewhere", seen)
    assert not store.record_heartbeat("a", "one", "sim")
    store.leave_cell("a", "one")  # of another's
    assert store.cell_status("a").held_by == "there"


def test_an_acknowledgement_is_handled_once(store):
    assert not store.request_acknowledge("a", "me")
    assert not store.acknowledge_requested("a")
    assert store.take_cell("a", "one", "sim", "here")
    assert not store.acknowledge_requested("a")
    assert store.request_acknowledge("a", "me")
    assert store.acknowledge_requested("a")
    store.clear_acknowledge("a")
    assert not store.acknowledge_requested("a")
    assert store.cell_status("a").acknowledged_by == "me"
    assert store.request_acknowledge("a", "you")
    assert store.acknowledge_requested("a")


def test_a_request_to_operate_the_robot_is_answered_once(store):
    assert store.take_cell("a", "one", "sim", "here")
    assert store.cell_status("a").open_robot_request is None
    store.request_robot_action("a", "power_on", "me", AuditLine("me", "robot power_on", "127.0.0.1"))
    asked = store.cell_status("a").open_robot_request
    assert (asked["action"], asked["requested_by"]) == ("power_on", "me")
    store.answer_robot_request("a", asked["id"], True, "by the dashboard")
    assert store.cell_status("a").open_robot_request is None
    store.request_robot_action("a", "power_off", "you")
    store.answer_robot_request("a", asked["id"], True, "late")  # of the one before
    assert store.cell_status("a").open_robot_request["action"] == "power_off"
    assert store.audit_lines(1)[0]["action"] == "robot power_on"


def test_the_audit_trail_is_newest_first(store):
    store.add_audit(AuditLine("me", "execute", "127.0.0.1"))
    store.add_audit(AuditLine("you", "abort", "127.0.0.2"))
    assert [(line["who"], line["action"]) for line in store.audit_lines()] == [("you", "abort"), ("me", "execute")]
