"""What the benchmarks share: turns in one run, the words of the machine, results as JSON, and the table of them."""
