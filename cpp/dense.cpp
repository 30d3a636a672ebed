// Which dense kernels to use on this processor.
#include "dense.hpp"

namespace teamslam {
namespace dense_baseline {
extern const DenseKernels kernels;
}
#if defined(TEAMSLAM_DENSE_AVX2)
namespace dense_avx2 {
extern const DenseKernels kernels;
}
#endif

const DenseKernels& dense_kernels() {
#if defined(TEAMSLAM_DENSE_AVX2)
  static const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (avx2) return dense_avx2::kernels;
#endif
  return dense_baseline::kernels;
}

}  // namespace teamslam
