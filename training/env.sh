# Sourced by the run scripts: keep freed memory in the process. Page faults cost a seventh of each training step otherwise.
export MALLOC_MMAP_MAX_=0 MALLOC_TRIM_THRESHOLD_=100000000000 MALLOC_TOP_PAD_=500000000
# Waiting threads must sleep, not spin: on a shared machine spinning costs a factor of ten.
export OMP_WAIT_POLICY=passive GOMP_SPINCOUNT=0 OPENBLAS_NUM_THREADS=1
