#include "models_loops.hpp"

namespace teamslam {

RowLoops row_loops_baseline(Model model, int D, Kind a, Kind b) { return select_row_loops(model, D, a, b); }

RowLoops row_loops(Model model, int D, Kind a, Kind b) {
#if TEAMSLAM_HAS_AVX2
  static const bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (has_avx2) return row_loops_avx2(model, D, a, b);
#endif
  return row_loops_baseline(model, D, a, b);
}

}  // namespace teamslam
