// Checks at the door, shared by all terms. Each throws std::invalid_argument.
#pragma once

#include <cmath>
#include <cstdint>
#include <sstream>
#include <stdexcept>

#include "kinds.hpp"

namespace teamslam {

inline bool all_finite(const double* numbers, int64_t count) {
  double sum = 0.0;  // zero times a number that is not finite is not a number
  for (int64_t i = 0; i < count; ++i) sum += 0.0 * numbers[i];
  return sum == 0.0;
}

// How far a row-major D x D matrix may be from a rotation: rounded to single precision, it still passes.
inline constexpr double rotation_tolerance = 1e-5;

inline bool is_rotation(const double* R, int D) {
  for (int i = 0; i < D; ++i)
    for (int j = i; j < D; ++j) {
      double product = 0.0;
      for (int k = 0; k < D; ++k) product += R[D * k + i] * R[D * k + j];
      if (!(std::abs(product - (i == j)) < rotation_tolerance)) return false;
    }
  const double determinant = D == 2 ? R[0] * R[3] - R[1] * R[2]
                                    : R[0] * (R[4] * R[8] - R[5] * R[7]) - R[1] * (R[3] * R[8] - R[5] * R[6]) +
                                          R[2] * (R[3] * R[7] - R[4] * R[6]);
  return determinant > 0.0;
}

// Says what is wrong, part after part. Callers test first, so that no message is built for what is right.
template <class... Parts>
[[noreturn]] void refuse(const Parts&... parts) {
  std::ostringstream message;
  (message << ... << parts);
  throw std::invalid_argument(message.str());
}

inline const char* name_of(Kind kind) {
  constexpr const char* names[] = {"pose2", "pose3", "point2", "point3"};
  return names[static_cast<int>(kind)];
}

}  // namespace teamslam
