"""Requests in files of JSON, or on standard input."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def read_document(file: Path) -> Any:
    """Returns the JSON in a file (`-`: standard input).

    Raises:
        ProblemDetails: It is no JSON, not UTF-8, or has a key twice; the same problem as the service's.
    """
    from api.http import invalid_field, refuse_ambiguous

    text = sys.stdin.buffer.read() if str(file) == "-" else file.read_bytes()
    refuse_ambiguous(text)
    try:
        return json.loads(text.decode())
    except UnicodeDecodeError:
        raise invalid_field("file", "is not UTF-8") from None
    except json.JSONDecodeError as error:
        reason = f"is not JSON at character {error.pos + 1}: {error.msg.lower()}"
        raise invalid_field("body", reason) from None
    except (ValueError, RecursionError) as error:  # a number of thousands of digits, brackets within brackets
        raise invalid_field("body", f"is not JSON: {error}") from None
