// Which dense kernels to use on this processor.
#include "dense.hpp"

#include <cstdlib>
#include <cstring>

namespace teamslam {
namespace dense_baseline {
extern const DenseKernels kernels;
}
#if defined(TEAMSLAM_DENSE_X86)
namespace dense_avx2 {
extern const DenseKernels kernels;
}
namespace dense_avx512 {
extern const DenseKernels kernels;
}
#endif

namespace {

// The best first. TEAMSLAM_DENSE names one that is to be used instead, if the processor has it: for tests.
const DenseKernels& choose() {
#if defined(TEAMSLAM_DENSE_X86)
  const char* wanted = std::getenv("TEAMSLAM_DENSE");
  const auto serves = [&](const DenseKernels& kernels) {
    return wanted == nullptr || std::strcmp(wanted, kernels.name) == 0;
  };
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl");
  if (avx512 && serves(dense_avx512::kernels)) return dense_avx512::kernels;
  if (avx2 && serves(dense_avx2::kernels)) return dense_avx2::kernels;
#endif
  return dense_baseline::kernels;
}

}  // namespace

const DenseKernels& dense_kernels() {
  static const DenseKernels& chosen = choose();
  return chosen;
}

}  // namespace teamslam
