// Measurements of whole poses (relative and absolute) and of absolute positions.
#pragma once

#include "lie.hpp"

namespace teamslam {

// Residual Log(Q' zR) of a rotation Q = R1'R2 (or R2 alone) against zR, which turns with
//   J_1 = -Jr^-1(e) zR'   (right perturbation of R1),   J_2 = Jl^-1(e)   (right perturbation of R2).
template <int D>
struct RotationResidual {
  RotationVector<D> e;
  void against(const double (&Q)[D * D], const double (&z_R)[D * D]) {
    double difference[D * D];
    multiply_transposed<D>(Q, z_R, difference);
    e = log_rotation(difference);
  }
  void jacobian_second(double (&J)[turn_dof(D) * turn_dof(D)]) const { left_jacobian_inverse(e, J); }
  void jacobian_first(const double (&z_R)[D * D], double (&J)[turn_dof(D) * turn_dof(D)]) const {
    double inverse[turn_dof(D) * turn_dof(D)];
    right_jacobian_inverse(e, inverse);
    if constexpr (D == 2) {
      J[0] = -inverse[0];
    } else {
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
          J[3 * i + k] = -(inverse[3 * i] * z_R[3 * k] + inverse[3 * i + 1] * z_R[3 * k + 1] +
                           inverse[3 * i + 2] * z_R[3 * k + 2]);
    }
  }
};

// e = [zT - R1'(T2 - T1); Log((R1'R2)' zR)], and if wanted its Jacobians, each pose_dof(D) square, row-major.
template <int D, bool with_jacobian>
inline void relate(const Pose<D>& z, const Pose<D>& X1, const Pose<D>& X2, double* e, double* J_1, double* J_2) {
  constexpr int turns = turn_dof(D), n = pose_dof(D);
  double h[D], Q[D * D];
  see(X1, X2.T, h);
  multiply_transposed<D>(X1.R, X2.R, Q);
  RotationResidual<D> rotation;
  rotation.against(Q, z.R);
  for (int i = 0; i < D; ++i) e[i] = z.T[i] - h[i];
  for (int i = 0; i < turns; ++i) e[D + i] = rotation.e.w[i];
  if constexpr (with_jacobian) {
    double turning[D * turns], first[turns * turns], second[turns * turns];
    seen_by_turning(h, turning);
    rotation.jacobian_first(z.R, first);
    rotation.jacobian_second(second);
    for (int i = 0; i < D; ++i) {
      for (int k = 0; k < D; ++k) J_1[n * i + k] = -X1.R[D * k + i], J_2[n * i + k] = X1.R[D * k + i];
      for (int k = 0; k < turns; ++k) J_1[n * i + D + k] = turning[turns * i + k], J_2[n * i + D + k] = 0.0;
    }
    for (int i = 0; i < turns; ++i) {
      for (int k = 0; k < D; ++k) J_1[n * (D + i) + k] = J_2[n * (D + i) + k] = 0.0;
      for (int k = 0; k < turns; ++k) {
        J_1[n * (D + i) + D + k] = first[turns * i + k];
        J_2[n * (D + i) + D + k] = second[turns * i + k];
      }
    }
  }
}

// e = [zT - T; Log(R' zR)], the relative pose seen from the world itself.
template <int D, bool with_jacobian>
inline void locate(const Pose<D>& z, const Pose<D>& X, double* e, double* J) {
  constexpr int turns = turn_dof(D), n = pose_dof(D);
  RotationResidual<D> rotation;
  rotation.against(X.R, z.R);
  for (int i = 0; i < D; ++i) e[i] = z.T[i] - X.T[i];
  for (int i = 0; i < turns; ++i) e[D + i] = rotation.e.w[i];
  if constexpr (with_jacobian) {
    double second[turns * turns];
    rotation.jacobian_second(second);
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k)
        J[n * i + k] = i < D || k < D ? (i == k ? 1.0 : 0.0) : second[turns * (i - D) + (k - D)];
  }
}

}  // namespace teamslam
