"""Tests of warnings that are logged once."""

import logging

from deux.log_once import warn_once


def test_a_message_is_logged_once_by_each_logger(caplog):
    for log in (logging.getLogger("deux.first"), logging.getLogger("deux.second")) * 2:
        warn_once(log, "100 % of the points are wrong")
    warn_once(logging.getLogger("deux.first"), "another message")
    assert [(record.name, record.getMessage()) for record in caplog.records] == [
        ("deux.first", "100 % of the points are wrong"),
        ("deux.second", "100 % of the points are wrong"),
        ("deux.first", "another message"),
    ]
