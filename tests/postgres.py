"""Databases of their own on a PostgreSQL server, for tests that are given one by FLING_TEST_POSTGRES."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy import create_engine, make_url, text

from store import new_id

POSTGRES = os.environ.get("FLING_TEST_POSTGRES")  # such as postgresql+psycopg://postgres@127.0.0.1:5432/postgres


@contextmanager
def database_on(server_url: str) -> Iterator[str]:
    """Makes an empty database on a server and drops it afterwards. Yields its URL."""
    name = f"fling_{new_id().replace('-', '')}"
    engine = create_engine(server_url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(text(f"CREATE DATABASE {name}"))
    yield make_url(server_url).set(database=name).render_as_string(hide_password=False)
    with engine.connect() as connection:
        connection.execute(text(f"DROP DATABASE {name} WITH (FORCE)"))
    engine.dispose()
