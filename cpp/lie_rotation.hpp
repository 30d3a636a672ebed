// Rotations in the plane and in space: exponential, logarithm, and the inverse Jacobian of the logarithm.
//
// Matrices are row-major arrays. Laws: log(exp(w)) = w for |w| < pi; log(R exp(d)) = log(R) + Jr^-1 d + O(d^2);
// log(exp(d) R) = log(R) + Jl^-1 d + O(d^2), where Jl^-1 = (Jr^-1)'.
#pragma once

#include <cmath>

#include "kinds.hpp"

namespace teamslam {

// w = log(R), with the coefficient that its inverse Jacobian needs (space only).
template <int D>
struct RotationVector {
  double w[turn_dof(D)];
  double square_coefficient;  // c in Jr^-1 = I + [w]/2 + c [w]^2
};

inline void exp_rotation(const double (&w)[1], double (&R)[4]) {
  const double c = std::cos(w[0]), s = std::sin(w[0]);
  R[0] = c, R[1] = -s, R[2] = s, R[3] = c;
}

// Rodrigues: R = I + a [w] + b [w]^2, a = sin(t)/t, b = (1 - cos t)/t^2 = sin(t/2)^2 / (t^2/2).
inline void exp_rotation(const double (&w)[3], double (&R)[9]) {
  const double x = w[0], y = w[1], z = w[2], square = x * x + y * y + z * z;
  double a, b;
  if (square < 1e-6) {
    a = 1.0 - square / 6.0 * (1.0 - square / 20.0);
    b = 0.5 - square / 24.0 * (1.0 - square / 30.0);
  } else {
    const double angle = std::sqrt(square), half = std::sin(0.5 * angle);
    a = std::sin(angle) / angle;
    b = 2.0 * half * half / square;
  }
  R[0] = 1.0 - b * (y * y + z * z), R[1] = b * x * y - a * z, R[2] = b * x * z + a * y;
  R[3] = b * x * y + a * z, R[4] = 1.0 - b * (x * x + z * z), R[5] = b * y * z - a * x;
  R[6] = b * x * z - a * y, R[7] = b * y * z + a * x, R[8] = 1.0 - b * (x * x + y * y);
}

inline RotationVector<2> log_rotation(const double (&R)[4]) {
  return {{std::atan2(R[2] - R[1], R[0] + R[3])}, 0.0};
}

// The unit quaternion (w, x, y, z), w >= 0, of a rotation matrix; always from its largest component, so that no
// rotation, not even by pi, loses digits.
inline void quaternion_of(const double (&R)[9], double (&q)[4]) {
  const double trace = R[0] + R[4] + R[8];
  if (trace > 0.0) {
    q[0] = 0.5 * std::sqrt(1.0 + trace);
    const double f = 0.25 / q[0];
    q[1] = f * (R[7] - R[5]), q[2] = f * (R[2] - R[6]), q[3] = f * (R[3] - R[1]);
    return;
  }
  const int i = R[0] >= R[4] ? (R[0] >= R[8] ? 0 : 2) : (R[4] >= R[8] ? 1 : 2), j = (i + 1) % 3, k = (i + 2) % 3;
  const double largest = 0.5 * std::sqrt(1.0 + R[4 * i] - R[4 * j] - R[4 * k]), f = 0.25 / largest;
  q[0] = f * (R[3 * k + j] - R[3 * j + k]);
  q[1 + i] = largest, q[1 + j] = f * (R[3 * j + i] + R[3 * i + j]), q[1 + k] = f * (R[3 * k + i] + R[3 * i + k]);
  if (q[0] < 0.0)
    for (double& component : q) component = -component;
}

inline RotationVector<3> log_rotation(const double (&R)[9]) {
  double q[4];
  quaternion_of(R, q);
  const double sine_square = q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  double angle_over_sine, square, c;  // angle / sin(angle/2); angle^2; the coefficient
  if (sine_square < 1e-6 * q[0] * q[0]) {
    const double t = sine_square / (q[0] * q[0]);
    angle_over_sine = 2.0 / q[0] * (1.0 - t / 3.0 * (1.0 - 0.6 * t));
    square = angle_over_sine * angle_over_sine * sine_square;
    c = 1.0 / 12.0 + square / 720.0;
  } else {
    const double sine = std::sqrt(sine_square), angle = 2.0 * std::atan2(sine, q[0]);
    angle_over_sine = angle / sine;
    square = angle * angle;
    // c = (1 - (angle/2) cot(angle/2)) / angle^2, by its series where the difference would cancel.
    c = square < 0.04 ? 1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30240.0 + square / 1209600.0))
                      : (1.0 - 0.5 * angle_over_sine * q[0]) / square;
  }
  return {{angle_over_sine * q[1], angle_over_sine * q[2], angle_over_sine * q[3]}, c};
}

inline void right_jacobian_inverse(const RotationVector<2>&, double (&J)[1]) { J[0] = 1.0; }
inline void left_jacobian_inverse(const RotationVector<2>&, double (&J)[1]) { J[0] = 1.0; }

inline void log_jacobian_inverse(const RotationVector<3>& r, double half, double (&J)[9]) {
  const double x = r.w[0], y = r.w[1], z = r.w[2], c = r.square_coefficient;
  J[0] = 1.0 - c * (y * y + z * z), J[1] = c * x * y - half * z, J[2] = c * x * z + half * y;
  J[3] = c * x * y + half * z, J[4] = 1.0 - c * (x * x + z * z), J[5] = c * y * z - half * x;
  J[6] = c * x * z - half * y, J[7] = c * y * z + half * x, J[8] = 1.0 - c * (x * x + y * y);
}
inline void right_jacobian_inverse(const RotationVector<3>& r, double (&J)[9]) { log_jacobian_inverse(r, 0.5, J); }
inline void left_jacobian_inverse(const RotationVector<3>& r, double (&J)[9]) { log_jacobian_inverse(r, -0.5, J); }

}  // namespace teamslam
