// The dense kernels for x86-64 with AVX2 and FMA (compiled with those flags, called only where they are present).
#if defined(__AVX2__) && defined(__FMA__)
#define TEAMSLAM_KERNEL dense_avx2
#define TEAMSLAM_KERNEL_NAME "avx2"
#define TEAMSLAM_TILE 3
#include "dense_kernels.hpp"
#endif
