"""Profiles: what was learnt of a cell, never changed; and which one the cell uses."""

from __future__ import annotations

import hashlib
import time

from sqlalchemy import insert, select

from store.database import Repository, writing
from store.idempotency_and_audit import write_audit
from store.rows import AuditLine, ProfileRow, new_id
from store.tables import adoptions, profiles


class ProfileRepository(Repository):
    """Tables `profiles` and `adoptions`."""

    def add_profile(
        self,
        cell: str,
        cell_sha256: str,
        created_by: str,
        document: bytes,
        audit: AuditLine | None = None,
        cell_version: int | None = None,
    ) -> ProfileRow:
        """Stores one profile, without adopting it."""
        hash = hashlib.sha256(document).hexdigest()
        row = ProfileRow(new_id(), time.time(), cell, cell_sha256, created_by, hash, document, cell_version)
        with writing(self._engine) as connection:
            connection.execute(insert(profiles).values(**vars(row)))
            write_audit(connection, audit, f"/profiles/{row.id}")
        return row

    def profile(self, id: str) -> ProfileRow | None:
        """Returns one profile."""
        return self._row(ProfileRow, select(profiles).where(profiles.c.id == id))

    def latest_profile(self) -> ProfileRow | None:
        """Returns the newest profile of any cell."""
        return self._row(ProfileRow, select(profiles).order_by(profiles.c.id.desc()).limit(1))

    def profiles_of_cell(self, cell: str, limit: int = 200) -> list[ProfileRow]:
        """Returns the profiles of a cell, newest first."""
        query = select(profiles).where(profiles.c.cell == cell)
        return self._rows(ProfileRow, query.order_by(profiles.c.id.desc()).limit(limit))

    def adopt_profile(self, cell: str, profile_id: str | None, who: str, audit: AuditLine | None = None) -> None:
        """Makes a cell use a profile from now on; None: the cell file's numbers again."""
        line = {"at": time.time(), "cell": cell, "profile_id": profile_id, "adopted_by": who}
        with writing(self._engine) as connection:
            connection.execute(insert(adoptions).values(**line))
            write_audit(connection, audit, f"/cells/{cell}/profiles/{profile_id or ''}")

    def profile_in_use(self, cell: str, cell_sha256: str) -> ProfileRow | None:
        """Returns the profile that a cell uses; None where it uses the cell file's numbers.

        A profile of another version of the cell's files does not count: arm or gripper may have been exchanged.

        Args:
            cell: name of the cell.
            cell_sha256: hash of its files now.
        """
        adopted = self.adopted_profile(cell)
        return adopted if adopted is not None and adopted.cell_sha256 == cell_sha256 else None

    def adopted_profile(self, cell: str) -> ProfileRow | None:
        """Returns the profile that was adopted for a cell, for whatever version of its files; None after a revert."""
        newest = select(adoptions.c.profile_id).where(adoptions.c.cell == cell).order_by(adoptions.c.id.desc()).limit(1)
        id = self._value(newest)
        return None if id is None else self.profile(id)
