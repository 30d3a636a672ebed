// The dense kernels for x86-64 with AVX-512 (compiled with those flags, called only where they are present).
#if defined(__AVX512F__) && defined(__AVX512VL__)
#define TEAMSLAM_KERNEL dense_avx512
#define TEAMSLAM_KERNEL_NAME "avx512"
#define TEAMSLAM_TILE 3
#define TEAMSLAM_WIDE
#include "dense_kernels.hpp"
#endif
