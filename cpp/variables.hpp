// The variables of a problem: their kinds, where they lie in the state, and which of them are unknown.
#pragma once

#include <cstdint>
#include <vector>

#include "kinds.hpp"

namespace teamslam {

inline constexpr int32_t held = -1;  // in place of a free index: the variable is constant and absent from H

struct Variables {
  std::vector<Kind> kind;
  std::vector<int64_t> offset;  // size n + 1: where each begins in the flat state
  std::vector<int32_t> free;    // index among the free variables, or held

  int64_t count() const { return static_cast<int64_t>(kind.size()); }
  int64_t numbers() const { return offset.back(); }
};

}  // namespace teamslam
