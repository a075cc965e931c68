"""Runs of batches: what a batch asks for, its driver, and its results as a table."""

from batch.runs.driver import BatchDriver, wait_and_claim
from batch.runs.specification import BATCH_MAX, BatchRequests, BatchSpecification, CellUse
from batch.runs.tables import PARQUET, Parameters, ParquetMissing, write_table, writes_to
from batch.runs.writer import GROUP

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
