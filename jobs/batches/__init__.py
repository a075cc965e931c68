"""Batches: what one asks for, what its driver plans, and its results as a table."""

from jobs.batches.driven import DrivenBatch, wait_and_claim
from jobs.batches.grids import check_axes
from jobs.batches.specification import BATCH_MAX, BatchRequests, BatchSpecification, CellUse
from jobs.batches.tables import (
    INTEGER,
    NUMBER,
    PARQUET,
    TEXT,
    TEXTS,
    Parameters,
    ParquetMissing,
    write_csv,
    write_parquet,
    write_table,
    writes_to,
)

__all__ = [
    "BATCH_MAX",
    "INTEGER",
    "NUMBER",
    "PARQUET",
    "TEXT",
    "TEXTS",
    "BatchRequests",
    "BatchSpecification",
    "DrivenBatch",
    "CellUse",
    "Parameters",
    "ParquetMissing",
    "check_axes",
    "wait_and_claim",
    "write_csv",
    "write_parquet",
    "write_table",
    "writes_to",
]
