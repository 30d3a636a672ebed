// The dense kernels for any processor; the compiler turns their vectors into what the baseline has.
#define TEAMSLAM_KERNEL dense_baseline
#define TEAMSLAM_KERNEL_NAME "baseline"
#if defined(__aarch64__)
#define TEAMSLAM_TILE 2
#else
#define TEAMSLAM_TILE 1
#endif
#include "dense_kernels.hpp"
