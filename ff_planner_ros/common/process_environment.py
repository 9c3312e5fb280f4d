"""Environment variables of the processes that plan; libraries read them when they load.

Matrices of some dozens of rows gain nothing from several threads. On a machine with other work
these wait for each other: with two, joint splines took six times as long. And where several share a
sum, its last bit depends on their number.

Each step of a search frees arrays of a megabyte and asks for as many. Glibc gives such memory back
to the system, which clears it before it is used again: with 500 points a plan took 15 % more time.
"""

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_KEPT_MEMORY = {"MALLOC_TRIM_THRESHOLD_": f"{64 << 20}", "MALLOC_MMAP_THRESHOLD_": f"{32 << 20}"}
PLANNING = ONE_THREAD | _KEPT_MEMORY
