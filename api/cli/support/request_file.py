"""Requests in files of JSON, or on standard input."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

Model = TypeVar("Model", bound=BaseModel)


def read_request(file: Path, model: type[Model]) -> Model:
    """Returns the request in a file (`-`: standard input).

    Raises:
        ProblemDetails: It is not UTF-8, has a key twice, or is not such a request; the same problem as the service's.
    """
    from api.http import invalid_field, invalid_request, refuse_ambiguous

    try:
        text = sys.stdin.buffer.read() if str(file) == "-" else file.read_bytes()
        refuse_ambiguous(text)
        return model.model_validate_json(text.decode())
    except ValidationError as error:
        raise invalid_request(error.errors(), model) from error
    except UnicodeDecodeError as error:
        raise invalid_field("file", "is not UTF-8") from error
