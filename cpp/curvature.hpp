// What Gauss-Newton leaves out of the second derivative of the cost, for steps that converge like Newton's.
//
// With lambda = rho' W'W e, half the second derivative of one row's rho(|W e|^2) is
//   rho' J'W'W J  +  2 rho'' (J'W'We)(J'W'We)'  -  d(J'lambda)/dx |_lambda ,      J = -de/dx.
// The second term is the loss's curvature (losses.hpp), the third the residual's: zero where the prediction is linear or
// the residual small. It is taken by central differences of the analytic J in the chart of each variable, and its
// symmetric part is the second derivative along x (+) t d, which are one-parameter curves.
#pragma once

#include <algorithm>
#include <cstdint>

#include "lie.hpp"

namespace teamslam {

enum class Curvature : int32_t { none, losses, all };

inline constexpr double curvature_step = 1e-5;  // [m], [rad]: error 1e-10 of the third derivative, rounding 1e-11

// x (+) step along unknown j of a variable of kind K.
template <Kind K>
inline void displace(const double* x, int j, double step, double* out) {
  constexpr int D = dimension(K);
  std::copy_n(x, numbers(K), out);
  if (j < D) {
    out[j] += step;
    return;
  }
  if constexpr (is_pose(K)) {
    double w[turn_dof(D)] = {}, turn[D * D], before[D * D], after[D * D];
    w[j - D] = step;
    exp_rotation(w, turn);
    std::copy_n(x + D, D * D, before);
    multiply<D>(before, turn, after);
    std::copy_n(after, D * D, out + D);
  }
}

inline void displace(Kind kind, const double* x, int j, double step, double* out) {
  switch (kind) {
    case Kind::pose2: return displace<Kind::pose2>(x, j, step, out);
    case Kind::pose3: return displace<Kind::pose3>(x, j, step, out);
    case Kind::point2: return displace<Kind::point2>(x, j, step, out);
    case Kind::point3: return displace<Kind::point3>(x, j, step, out);
  }
}

// C (columns x columns, row-major) -= d(J'lambda)/dx over the unknowns of two variables, the columns of a first.
// jacobian_at(a, b, J) fills J (rows x columns). A variable that is held (kinds alone do not say) is moved all the same.
template <int most_rows, int most_columns, class JacobianAt>
void subtract_bend(Kind kind_a, const double* a, Kind kind_b, const double* b, int dof_a, int dof_b, int rows,
                   const double* lambda, const JacobianAt& jacobian_at, double* C) {
  const int columns = dof_a + dof_b;
  double slope[most_columns * most_columns], J[most_rows * most_columns], moved[12];
  for (int j = 0; j < columns; ++j) {
    double* of_j = slope + most_columns * j;
    std::fill_n(of_j, columns, 0.0);
    for (const double sign : {1.0, -1.0}) {
      const bool first = j < dof_a;
      displace(first ? kind_a : kind_b, first ? a : b, first ? j : j - dof_a, sign * curvature_step, moved);
      jacobian_at(first ? moved : a, first ? b : moved, J);
      for (int i = 0; i < rows; ++i)
        for (int k = 0; k < columns; ++k) of_j[k] += sign * lambda[i] * J[columns * i + k];
    }
  }
  for (int j = 0; j < columns; ++j)
    for (int k = 0; k < columns; ++k)
      C[columns * j + k] -= (slope[most_columns * j + k] + slope[most_columns * k + j]) / (4.0 * curvature_step);
}

}  // namespace teamslam
