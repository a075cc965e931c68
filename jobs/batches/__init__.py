"""Runs of batches: what a batch asks for, its driver, and its results as a table."""

from jobs.batches.driver import BatchDriver, wait_and_claim
from jobs.batches.specification import BATCH_MAX, BatchRequests, BatchSpecification, CellUse
from jobs.batches.tables import PARQUET, Parameters, ParquetMissing, write_table, writes_to
from jobs.batches.writer import GROUP

__all__ = [
    "BATCH_MAX",
    "GROUP",
    "PARQUET",
    "BatchDriver",
    "BatchRequests",
    "BatchSpecification",
    "CellUse",
    "Parameters",
    "ParquetMissing",
    "wait_and_claim",
    "write_table",
    "writes_to",
]
