"""Batch processing of image archives on one machine or a cluster."""

from .execution import BatchStatus, plan, run, status
from .job import BatchJob, load_job
from .planning import BatchPlan

__all__ = ["BatchJob", "BatchPlan", "BatchStatus", "load_job", "plan", "run", "status"]
