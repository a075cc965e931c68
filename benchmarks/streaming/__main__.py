"""`python -m benchmarks.streaming`: runs the streaming part alone and writes `streaming.md`."""

from benchmarks.streaming.report import main

if __name__ == "__main__":
    main()
