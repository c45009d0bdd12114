"""The one error that a user's mistake raises."""

import difflib
from collections.abc import Iterable


class DeuxError(Exception):
    """A mistake of the user's: one sentence that says what is wrong, where, and what would be right.

    The command line prints the sentence without a stack trace and exits with code 1.
    """


def near_matches(wrong: str, known: Iterable[str]) -> str:
    """Say which of the `known` names could have been meant by `wrong`, then list them all."""
    names = sorted(known)
    close = difflib.get_close_matches(wrong, names, n=3, cutoff=0.5)
    meant = f"did you mean {' or '.join(close)}? " if close else ""
    return f"{meant}There is: {', '.join(names) or 'nothing installed'}."
