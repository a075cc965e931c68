"""Planning jobs: one at a time for the service and the command line, and many: batches and throwability maps."""
