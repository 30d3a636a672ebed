// A robot's filter: one Gaussian over its pose and the landmarks about it, moved and sharpened row by row
// (src/teamslam/robot/filter.py has the method).
//
//   moved   x_new = x (+) u            F = -D^-1 B', Q = D^-1 from H = [A B; B' D] of the rows between the two poses
//   seen    x (+) P J' S^-1 (e + J d)  P - P J' S^-1 J P,  S = 1 + J P J'      d: how far x has moved since the start
//
// Covariances are dense, n x n over the unknowns of `Moving`, both triangles; pointers do not overlap.
#pragma once

#include <cstdint>
#include <functional>

#include "moving.hpp"

namespace teamslam {

// Rows of one table between one or two variables each, `index` (rows x keys), and how to linearise them at a state: e
// (rows x residuals) and J = -de/dx (rows x residuals x 2 most_dof: the unknowns of the first variable, then those of
// the second, then the zeros that stood there), whitened and weighted.
struct Sightings {
  int64_t rows;
  int keys;
  int64_t residuals;
  const int64_t* index;
  std::function<void(const double* state, double* e, double* J)> linearise;

  int64_t numbers() const { return rows * residuals; }
};

struct Gaussian {
  const double* state;
  const double* covariance;
};

// At a new pose: `steps` are rows between the pose of now (variable 0) and the new one (variable 1), which begins at
// X o `step`, or X o step^-1 where that runs `backward`; `settled`: that is its best place already. False where the
// rows leave it open, or are not finite.
bool moved(const Moving& order, const Gaussian& given, const Sightings& steps, const double* step, bool backward,
           bool settled, double* state, double* covariance);

// Sharpened by rows, linearised anew, `most` times at most, while the pose of now or the sight of things turns by more
// than `little` [rad]. False where they are not finite.
bool seen(const Moving& order, const Gaussian& given, const Sightings& rows, int64_t most, double little, double* state,
          double* covariance);

}  // namespace teamslam
