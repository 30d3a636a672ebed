// The loops of models_loops.hpp once more, for processors with AVX2 and FMA (chosen at run time in models.cpp).
#define TEAMSLAM_ISA avx2
#include "isa.hpp"

#if TEAMSLAM_HAS_AVX2
// These headers come before the switch: their inline functions are shared with other files and must stay baseline.
#include <cmath>
#include <cstdint>
#include <numbers>

#include "kinds.hpp"

#pragma GCC target("avx2,fma")
#include "models_loops.hpp"

namespace teamslam {

RowLoops row_loops_avx2(Model model, int D, Kind a, Kind b) { return select_row_loops(model, D, a, b); }

}  // namespace teamslam
#endif
