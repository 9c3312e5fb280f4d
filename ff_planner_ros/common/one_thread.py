"""Environment variables that limit linear algebra libraries to one thread; read when they load.

Matrices of some dozens of rows gain nothing from several. On a machine with other work these wait
for each other: with two, joint splines took six times as long. And where several share a sum, its
last bit depends on their number.
"""

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
