// Sightings: an observer with pose X sees a target at h = R'(p - T) and measures position, distance or direction of h.
//
// A measure gives, from z and h, the residual e = z (-) h and J = -de/dh (rows x D); the chain to pose and target is
// the same for all: dh/dT = -R', dh/dw = [h] (see seen_by_turning), dh/dp = R'.
// A target nearer than `coincident` has no direction: it is taken to lie straight ahead (on x), with zero Jacobian. That
// is for the sensor's own place alone: a hair's breadth from it a bearing to the wrong side is as wrong as anywhere.
#pragma once

#include <cmath>
#include <numbers>

#include "lie.hpp"

namespace teamslam {

inline constexpr double coincident = 1e-100;  // metres; its square is a number still
inline constexpr double opposite = 1e-12;     // of a direction, as the sine of the angle

template <int D>
struct PointMeasure {
  static constexpr int rows = D, numbers = D;
  static void residual(const double* z, const double (&h)[D], double* e, double* J) {
    for (int i = 0; i < D; ++i) {
      e[i] = z[i] - h[i];
      for (int k = 0; k < D; ++k) J[D * i + k] = i == k;
    }
  }
};

template <int D>
inline double length(const double (&h)[D]) {
  double square = 0.0;
  for (int i = 0; i < D; ++i) square += h[i] * h[i];
  return std::sqrt(square);
}

template <int D>
struct RangeMeasure {
  static constexpr int rows = 1, numbers = 1;
  static void residual(const double* z, const double (&h)[D], double* e, double* J) {
    const double distance = length<D>(h);
    e[0] = z[0] - distance;
    for (int k = 0; k < D; ++k) J[k] = distance < coincident ? 0.0 : h[k] / distance;
  }
};

// An angle in (-pi, pi], from one in (-3 pi, 3 pi].
inline double wrap_once(double angle) {
  constexpr double pi = std::numbers::pi;
  return angle > pi ? angle - 2.0 * pi : angle <= -pi ? angle + 2.0 * pi : angle;
}

// Orthonormal tangent basis of the unit vector z, the columns of B: towards rising azimuth, then towards rising
// elevation, so that the rows of a bearing's noise are those two angles. Within a hair of the poles, where azimuth has no
// meaning, the first is the y axis: the way azimuth rises from the x axis.
inline void tangent_basis(const double* z, double (&b1)[3], double (&b2)[3]) {
  const double flat = std::sqrt(z[0] * z[0] + z[1] * z[1]);
  const bool pole = flat < 1e-9;
  b1[0] = pole ? 0.0 : -z[1] / flat, b1[1] = pole ? 1.0 : z[0] / flat, b1[2] = 0.0;
  b2[0] = -z[2] * b1[1], b2[1] = z[2] * b1[0], b2[2] = z[0] * b1[1] - z[1] * b1[0];  // z x b1
}

template <int D>
struct BearingMeasure;

template <>
struct BearingMeasure<2> {
  static constexpr int rows = 1, numbers = 1;  // z: angle in (-pi, pi]
  static void residual(const double* z, const double (&h)[2], double* e, double* J) {
    const double square = h[0] * h[0] + h[1] * h[1];
    if (square < coincident * coincident) {
      e[0] = z[0], J[0] = J[1] = 0.0;
      return;
    }
    e[0] = wrap_once(z[0] - std::atan2(h[1], h[0]));
    J[0] = -h[1] / square, J[1] = h[0] / square;
  }
};

// With u = h / |h|, b = B'u, s = |b| = sin t and c = z'u = cos t:  e = -f b,  f = t / s, and from dt = c ds - s dc
//   -de = f db + b df,   df = k b'db - dc,   k = (c s - t) / s^3.
// At the antipode of z every direction is shortest: e = (-pi, 0), with zero Jacobian.
template <>
struct BearingMeasure<3> {
  static constexpr int rows = 2, numbers = 3;  // z: unit vector
  static void residual(const double* z, const double (&h)[3], double* e, double* J) {
    const double distance = length<3>(h);
    const bool near = distance < coincident;
    const double u[3] = {near ? 1.0 : h[0] / distance, near ? 0.0 : h[1] / distance, near ? 0.0 : h[2] / distance};
    double basis[2][3], b[2];
    tangent_basis(z, basis[0], basis[1]);
    for (int i = 0; i < 2; ++i) b[i] = basis[i][0] * u[0] + basis[i][1] * u[1] + basis[i][2] * u[2];
    const double square = b[0] * b[0] + b[1] * b[1], s = std::sqrt(square), c = z[0] * u[0] + z[1] * u[1] + z[2] * u[2];
    if (c < 0.0 && s < opposite) {
      e[0] = -std::numbers::pi, e[1] = 0.0;
      for (int k = 0; k < 6; ++k) J[k] = 0.0;
      return;
    }
    double f, k;
    if (c > 0.0 && square < 1e-5) {  // series in s^2: t = s (1 + s^2/6 + 3 s^4/40)
      f = 1.0 + square * (1.0 / 6.0 + square * (3.0 / 40.0));
      k = -2.0 / 3.0 - square * (1.0 / 5.0 + square * (3.0 / 28.0));
    } else {
      const double t = std::atan2(s, c);
      f = t / s, k = (c * s - t) / (square * s);
    }
    for (int i = 0; i < 2; ++i) {
      e[i] = -f * b[i];
      for (int m = 0; m < 3; ++m) {
        const double towards = b[0] * basis[0][m] + b[1] * basis[1][m];
        J[3 * i + m] = f * basis[i][m] + b[i] * (k * towards - z[m]);
      }
      // du = (I - u u') dh / |h|
      double* row = J + 3 * i;
      const double along = row[0] * u[0] + row[1] * u[1] + row[2] * u[2];
      for (int m = 0; m < 3; ++m) row[m] = near ? 0.0 : (row[m] - along * u[m]) / distance;
    }
  }
};

template <int D>
struct RangeBearingMeasure {
  static constexpr int rows = 1 + BearingMeasure<D>::rows, numbers = 1 + BearingMeasure<D>::numbers;
  static void residual(const double* z, const double (&h)[D], double* e, double* J) {
    RangeMeasure<D>::residual(z, h, e, J);
    BearingMeasure<D>::residual(z + 1, h, e + 1, J + D);
  }
};

// Residual, and if wanted J_X (rows x pose_dof(D)) and J_p (rows x D), row-major.
template <class Measure, int D, bool with_jacobian>
inline void sight(const double* z, const Pose<D>& X, const double (&p)[D], double* e, double* J_X, double* J_p) {
  constexpr int turns = turn_dof(D), columns = pose_dof(D);
  double h[D], J_h[Measure::rows * D];
  see(X, p, h);
  Measure::residual(z, h, e, J_h);
  if constexpr (with_jacobian) {
    double turning[D * turns];
    seen_by_turning(h, turning);
    for (int row = 0; row < Measure::rows; ++row) {
      const double* j = J_h + D * row;
      for (int k = 0; k < D; ++k) {
        double sum = 0.0;
        for (int i = 0; i < D; ++i) sum += j[i] * X.R[D * k + i];
        J_p[D * row + k] = sum;
        J_X[columns * row + k] = -sum;
      }
      for (int k = 0; k < turns; ++k) {
        double sum = 0.0;
        for (int i = 0; i < D; ++i) sum += j[i] * turning[turns * i + k];
        J_X[columns * row + D + k] = sum;
      }
    }
  }
}

// The four corners of a tag: an observer with pose X measures the directions z[0..12) of four points c = z[12..24) of a
// body with pose Y. Each is a bearing to p = R_Y c + T_Y; the body's own columns follow by dp/dT_Y = 1, dp/dw_Y = -R_Y [c].
template <bool with_jacobian>
inline void see_corners(const double* z, const Pose<3>& X, const Pose<3>& Y, double* e, double* J_X, double* J_Y) {
  for (int corner = 0; corner < 4; ++corner) {
    const double* c = z + 12 + 3 * corner;
    double p[3], J_p[6];
    for (int i = 0; i < 3; ++i)
      p[i] = Y.T[i] + Y.R[3 * i] * c[0] + Y.R[3 * i + 1] * c[1] + Y.R[3 * i + 2] * c[2];
    sight<BearingMeasure<3>, 3, with_jacobian>(z + 3 * corner, X, p, e + 2 * corner, J_X + 12 * corner, J_p);
    if constexpr (with_jacobian) {
      for (int row = 0; row < 2; ++row) {
        const double* j = J_p + 3 * row;
        double* out = J_Y + 12 * corner + 6 * row;
        double body[3];  // j R_Y
        for (int k = 0; k < 3; ++k) {
          out[k] = j[k];
          body[k] = j[0] * Y.R[k] + j[1] * Y.R[3 + k] + j[2] * Y.R[6 + k];
        }
        out[3] = body[2] * c[1] - body[1] * c[2];  // -body [c]
        out[4] = body[0] * c[2] - body[2] * c[0];
        out[5] = body[1] * c[0] - body[0] * c[1];
      }
    }
  }
}

}  // namespace teamslam
