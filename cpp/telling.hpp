// What a map knows of landmarks, told to a robot's filter that sees them for the first time
// (src/teamslam/robot/ahead.py has the method).
//
//   G = S_js S_ss^-1     x_j = m_j (+) G (x_s (-) m_s)     P_j. = G P_s.     P_jj = G P_ss G' + S_jj - G S_sj
//
// of the map's Gaussian (m, S): s, what the filter holds of it; j, what it sees now.
#pragma once

#include <cstdint>

#include "filter.hpp"

namespace teamslam {

// A Gaussian and its variables.
struct Held {
  const Moving& order;
  Gaussian of;
};

// The filter with the variables `fresh` (places in the map's order) at its end. What does not turn in it, it holds of
// the map: `theirs` are the places of these there, as they come. Nothing turns in the map. False where these hang
// together so firmly that nothing can be said.
bool told(const Held& filter, const Held& map, const int64_t* theirs, int64_t count, const int64_t* fresh, double* state,
          double* covariance);

}  // namespace teamslam
