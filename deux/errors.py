"""The one error that a user's mistake raises, the one that says so of a sweep's job, and parts of their sentences."""

import difflib
import math
import re
import reprlib
from collections.abc import Iterable
from typing import Any

_QUOTED = reprlib.Repr()
_QUOTED.maxstring = _QUOTED.maxother = 120
_QUOTED.maxlong = 60
_QUOTED.maxlist = _QUOTED.maxtuple = _QUOTED.maxdict = 12
_QUOTED.maxlevel = 4
_LONGEST_NUMBER = 10_000
"""Bits of the largest whole number that is written in digits; Python refuses those of some thousand digits."""

_CONTROLS = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that move a terminal's cursor, change the direction of its text, or stand for no character at all."""

_LONG_WORD = re.compile(r"\S{1000,}")

_PLURAL_VERBS = {"is": "are", "has": "have", "does": "do"}


class DeuxError(Exception):
    """A mistake of the user's: one sentence that says what is wrong, where, and what would be right.

    The command line prints the sentence without a stack trace and exits with code 1.
    """


class JobFailed(DeuxError):
    """A job of a sweep failed, in this process or in another one, where the error itself was told.

    Stands for errors of any kind, some of which cannot be sent from one process to another.
    """


def near_matches(wrong: str, known: Iterable[str]) -> str:
    """Which of the `known` names could have been meant by `wrong`, then all of them: the end of a sentence.

    Example:
        >>> near_matches("kbnt", ["kbnet", "voiced"]), near_matches("x", [])
        ('did you mean kbnet? There is: kbnet, voiced.', 'there is: none.')
    """
    names = sorted(known)
    listed = f"here is: {', '.join(names) or 'none'}."
    close = difflib.get_close_matches(wrong, names, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(close)}? T{listed}" if close else f"t{listed}"


def quoted(value: Any) -> str:
    """A value as messages quote it: its repr, shortened where it is long or deep.

    Example:
        >>> quoted("a"), len(quoted("a" * 5000)), quoted(1 << 20000)
        ("'a'", 120, 'a whole number of 20001 bits')
    """
    if isinstance(value, int) and value.bit_length() > _LONGEST_NUMBER:
        return f"a whole number of {value.bit_length()} bits"
    return _QUOTED.repr(value)


def printable(text: str) -> str:
    """Text without characters that a terminal would obey instead of showing them, such as of a file's name.

    Line breaks become blanks, other control characters are written as escapes, and words of 1,000 characters or more
    lose their middle.

    Example:
        >>> printable("a\\x1b[31m b\\nc"), len(printable("a" * 5000))
        ('a\\\\x1b[31m b c', 401)
    """
    visible = _CONTROLS.sub(lambda found: found[0].encode("unicode_escape").decode(), " ".join(text.split("\n")))
    return _LONG_WORD.sub(lambda found: f"{found[0][:200]}…{found[0][-200:]}", visible)


def plural(word: str, count: int) -> str:
    """A noun, or the verb "is", "has" or "does", as it stands with a number: in the singular with 1 only.

    Example:
        >>> plural("test scene", 1), plural("test scene", 2), plural("has", 0)
        ('test scene', 'test scenes', 'have')
    """
    return word if count == 1 else _PLURAL_VERBS.get(word, f"{word}s")


def counted(count: int, noun: str) -> str:
    """How many there are of something.

    Example:
        >>> counted(1, "run"), counted(12, "run")
        ('1 run', '12 runs')
    """
    return f"{count} {plural(noun, count)}"


def check_range(
    name: str, value: float, least: float = -math.inf, most: float = math.inf, *, ends: bool = True
) -> None:
    """Raise DeuxError unless a number lies between `least` and `most`; NaN lies nowhere.

    Args:
        name: what the number is called, such as "camera.hfov"; it begins the message.
        value: the number.
        least: the lower end.
        most: the upper end.
        ends: whether the ends belong to the range.
    """
    if least <= value <= most and (ends or value not in (least, most)):
        return
    limits = {("at least" if ends else "above"): least, ("at most" if ends else "below"): most}
    wanted = " and ".join(f"{word} {limit}" for word, limit in limits.items() if math.isfinite(limit))
    raise DeuxError(f"{name} is {value}: it must be {wanted}.")
