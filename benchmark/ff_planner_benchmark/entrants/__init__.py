"""Methods that take part in the benchmark: a file each, with a function `answer`."""
