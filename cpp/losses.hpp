// Robust losses rho(s) of the squared whitened residual s = |We|^2; k is the scale, in standard deviations.
//
//   squared         s
//   huber           s if s <= k^2, else 2 k sqrt(s) - k^2
//   cauchy          k^2 log(1 + s / k^2)
//   geman_mcclure   k^2 s / (k^2 + s)
//
// All are s + O(s^2) near zero. The weight rho'(s) multiplies the row's part of H and g (iteratively re-weighted least
// squares: the gradient is exact, the second derivative of rho is left out). The curvature 2 s rho''(s) / rho'(s) <= 0
// is what that leaves out, along the residual: steps may take it in (curvature.hpp).
#pragma once

#include <cmath>
#include <cstdint>

namespace teamslam {

enum class Loss : int32_t { squared = 0, huber = 1, cauchy = 2, geman_mcclure = 3 };
inline constexpr int losses = 4;

struct LossValue {
  double rho;
  double weight;
  double curvature;
};

inline LossValue robust(Loss loss, double scale, double s) {
  if (loss == Loss::squared) return {s, 1.0, 0.0};
  const double square = scale * scale;
  switch (loss) {
    case Loss::huber: {
      if (s <= square) return {s, 1.0, 0.0};
      const double root = std::sqrt(s);
      return {2.0 * scale * root - square, scale / root, -1.0};
    }
    case Loss::cauchy:
      return {square * std::log1p(s / square), square / (square + s), -2.0 * s / (square + s)};
    default: {
      const double share = square / (square + s);
      return {share * s, share * share, -4.0 * s / (square + s)};
    }
  }
}

}  // namespace teamslam
