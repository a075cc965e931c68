"""Runs of batches: what a batch asks for, its driver, and its results as a table."""

from batch.runs.driver import BatchDriver, wait_and_claim
from batch.runs.specification import BATCH_MAX, BatchRequests, BatchSpecification, CellUse
from batch.runs.tables import PARQUET, ParquetMissing, parquet_of, rows_of, write_table, writes_to

__all__ = [
    "BATCH_MAX",
    "PARQUET",
    "BatchDriver",
    "BatchRequests",
    "BatchSpecification",
    "CellUse",
    "ParquetMissing",
    "parquet_of",
    "rows_of",
    "wait_and_claim",
    "write_table",
    "writes_to",
]
