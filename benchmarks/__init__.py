"""What measures: each figure of the documents has its command here, `python -m benchmarks NAME`."""
