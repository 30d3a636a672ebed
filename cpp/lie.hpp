// Poses in D dimensions: load (and lift) them from the state, compose, see a point from one.
#pragma once

#include "kinds.hpp"
#include "lie_rotation.hpp"

namespace teamslam {

template <int D>
struct Pose {
  double T[D];
  double R[D * D];  // row-major
};

// C = A B, C = A' B, C = A B' for D x D matrices.
template <int D>
inline void multiply(const double (&A)[D * D], const double (&B)[D * D], double (&C)[D * D]) {
  for (int i = 0; i < D; ++i)
    for (int j = 0; j < D; ++j) {
      double sum = 0.0;
      for (int k = 0; k < D; ++k) sum += A[D * i + k] * B[D * k + j];
      C[D * i + j] = sum;
    }
}
template <int D>
inline void multiply_transposed(const double (&A)[D * D], const double (&B)[D * D], double (&C)[D * D]) {
  for (int i = 0; i < D; ++i)
    for (int j = 0; j < D; ++j) {
      double sum = 0.0;
      for (int k = 0; k < D; ++k) sum += A[D * k + i] * B[D * k + j];
      C[D * i + j] = sum;
    }
}

// R brought back to the rotations by one Newton step, R (3 I - R'R) / 2, so that rounding never piles up.
template <int D>
inline void sharpen(const double (&R)[D * D], double* out) {
  double square[D * D], rotation[D * D];
  multiply_transposed<D>(R, R, square);
  for (int i = 0; i < D * D; ++i) square[i] = (i % (D + 1) == 0 ? 1.5 : 0.0) - 0.5 * square[i];
  multiply<D>(R, square, rotation);
  for (int i = 0; i < D * D; ++i) out[i] = rotation[i];
}

// The pose that a variable of kind K stands for in D dimensions; a planar one is lifted to yaw only, z = 0.
template <int D, Kind K>
inline Pose<D> load_pose(const double* x) {
  static_assert(is_pose(K) && dimension(K) <= D);
  Pose<D> X;
  if constexpr (dimension(K) == D) {
    for (int i = 0; i < D; ++i) X.T[i] = x[i];
    for (int i = 0; i < D * D; ++i) X.R[i] = x[D + i];
  } else {
    X = {{x[0], x[1], 0.0}, {x[2], x[3], 0.0, x[4], x[5], 0.0, 0.0, 0.0, 1.0}};
  }
  return X;
}

template <int D>
inline Pose<D> load_any_pose(Kind kind, const double* x) {
  if constexpr (D == 3)
    if (kind == Kind::pose3) return load_pose<3, Kind::pose3>(x);
  return load_pose<D, Kind::pose2>(x);
}

// The point that a variable of kind K stands for in D dimensions: a pose's position, the shadow of a point in space.
template <int D, Kind K>
inline void load_point(const double* x, double (&p)[D]) {
  for (int i = 0; i < D; ++i) p[i] = i < dimension(K) ? x[i] : 0.0;
}

template <int D>
inline Pose<D> compose(const Pose<D>& A, const Pose<D>& B) {
  Pose<D> C;
  multiply<D>(A.R, B.R, C.R);
  for (int i = 0; i < D; ++i) {
    C.T[i] = A.T[i];
    for (int k = 0; k < D; ++k) C.T[i] += A.R[D * i + k] * B.T[k];
  }
  return C;
}

// h = R'(p - T): the point in the frame of the pose.
template <int D>
inline void see(const Pose<D>& X, const double (&p)[D], double (&h)[D]) {
  for (int i = 0; i < D; ++i) {
    h[i] = 0.0;
    for (int k = 0; k < D; ++k) h[i] += X.R[D * k + i] * (p[k] - X.T[k]);
  }
}

// dh/dw of Exp(-w) h at w = 0, row-major D x turn_dof(D): what a seen point does when the observer turns.
inline void seen_by_turning(const double (&h)[2], double (&M)[2]) { M[0] = h[1], M[1] = -h[0]; }
inline void seen_by_turning(const double (&h)[3], double (&M)[9]) {
  M[0] = 0.0, M[1] = -h[2], M[2] = h[1];
  M[3] = h[2], M[4] = 0.0, M[5] = -h[0];
  M[6] = -h[1], M[7] = h[0], M[8] = 0.0;
}

// From the Jacobian with respect to the sensor's pose X o S to that with respect to X, in place: rows x pose_dof(D).
//   T_s = T + R s  and  R_s = R S  give  dT_s = dT - R [s] dw,  dw_s = S' dw.
template <int D, int rows>
inline void carry_to_body(const Pose<D>& X, const Pose<D>& S, double* J) {
  constexpr int turns = turn_dof(D), columns = pose_dof(D);
  double lever[D * turns];  // -[s]: what the sensor's position does, in the body, when the body turns
  seen_by_turning(S.T, lever);
  for (double& number : lever) number = -number;
  for (int row = 0; row < rows; ++row) {
    double* j = J + row * columns;
    double turned[turns], in_body[D];
    for (int k = 0; k < D; ++k) {
      in_body[k] = 0.0;
      for (int i = 0; i < D; ++i) in_body[k] += j[i] * X.R[D * i + k];
    }
    for (int k = 0; k < turns; ++k) {
      turned[k] = 0.0;
      if constexpr (D == 2) {
        turned[k] = j[D];
      } else {
        for (int i = 0; i < turns; ++i) turned[k] += j[D + i] * S.R[D * k + i];
      }
      for (int i = 0; i < D; ++i) turned[k] += in_body[i] * lever[turns * i + k];
    }
    for (int k = 0; k < turns; ++k) j[D + k] = turned[k];
  }
}

}  // namespace teamslam
