"""Value types of kernels: eight numbers at a time, numbers with derivatives, vectors and quaternions. No laws."""
