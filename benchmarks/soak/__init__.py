"""A soak: service, executor and simulated controller under load, kills and hostile requests, for as long as is asked.

What must hold: nothing grows (descriptors, memory, threads, sockets, shared memory), nothing is lost, no answer is 5xx
but 503, and a stop is answered within a second at every moment. `python -m benchmarks.soak --minutes 10`.
"""
