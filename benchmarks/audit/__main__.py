"""`python -m benchmarks.audit --count 10000`: runs the audit alone."""

from benchmarks.audit.run import main

if __name__ == "__main__":
    main()
