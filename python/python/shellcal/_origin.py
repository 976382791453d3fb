"""Creator and date of a document."""

from __future__ import annotations

import os
from datetime import datetime, timezone

from ._errors import OptionError
from ._native import __version__

#: The last second for which RFC 3339 has a four-digit year.
_LAST_SECOND = 253_402_300_799


def made_by() -> tuple[str, str]:
    """Returns program and version, and the UTC time or that of `SOURCE_DATE_EPOCH`, for reproducible results."""
    text = os.environ.get("SOURCE_DATE_EPOCH")
    if text is None:
        moment = datetime.now(timezone.utc)
    elif text.isascii() and text.isdigit() and int(text) <= _LAST_SECOND:
        moment = datetime.fromtimestamp(int(text), timezone.utc)
    else:
        raise OptionError(
            f"`SOURCE_DATE_EPOCH` is `{text}`, expected seconds since 1970, at most {_LAST_SECOND}"
        )
    return f"shellcal {__version__}", moment.strftime("%Y-%m-%dT%H:%M:%SZ")
