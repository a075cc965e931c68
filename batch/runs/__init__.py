"""Runs of batches: what a batch asks for, its driver, and its results as a table."""

from batch.runs.driver import BatchDriver, wait_and_claim
from batch.runs.specification import BatchRequests, BatchSpecification, CellUse
from batch.runs.tables import PARQUET, ParquetMissing, parquet_of, rows_of, write_table

__all__ = [
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
]
