// The table of measurement models, and the loops that run over rows of one model between variables of given kinds.
//
//   id name            keys                 z (D = 2, 3)            rows     e
//   0  relative_pose   pose, pose           6, 12: T then R          3, 6    [zT - R1'(T2-T1); Log((R1'R2)' zR)]
//   1  point           pose, target         2, 3                     2, 3    z - R'(p - T)
//   2  range           pose, target         1, 1                     1, 1    z - |p - T|
//   3  bearing         pose, target         1: angle, 3: unit        1, 2    z - angle; the logarithm on the sphere at z
//   4  range_bearing   pose, target         2, 4: range, bearing     2, 3    [range; bearing]
//   5  position        any                  2, 3                     2, 3    z - p
//   6  pose            pose                 6, 12: T then R          3, 6    [zT - T; Log(R' zR)]
//   7  corners         pose, pose           -, 24: four directions,  -, 8    the logarithm on the sphere at each direction
//                                           then four points c                of R1'(R2 c + T2 - T1)
//
// A target is a point or the position of a pose. With a constant sensor pose S in the body, X o S takes the place of
// the (first) pose. In D = 3, planar poses are lifted; in D = 2, points and poses in space are seen by their shadow.
#pragma once

#include <cstdint>

#include "curvature.hpp"
#include "kinds.hpp"
#include "losses.hpp"

namespace teamslam {

enum class Model : int32_t { relative_pose, point, range, bearing, range_bearing, position, pose, corners };
inline constexpr int models = 8;

constexpr int keys(Model model) { return model == Model::position || model == Model::pose ? 1 : 2; }

constexpr int measurement_numbers(Model model, int D) {
  switch (model) {
    case Model::relative_pose:
    case Model::pose: return pose_numbers(D);
    case Model::range: return 1;
    case Model::bearing: return D == 2 ? 1 : 3;
    case Model::range_bearing: return D == 2 ? 2 : 4;
    case Model::corners: return 24;
    default: return D;
  }
}

constexpr int residual_rows(Model model, int D) {
  switch (model) {
    case Model::relative_pose:
    case Model::pose: return pose_dof(D);
    case Model::range: return 1;
    case Model::bearing: return D - 1;
    case Model::corners: return 8;
    default: return D;
  }
}

// Unit vectors among the numbers of a measurement in space; a range comes before them.
constexpr int directions(Model model, int D) {
  if (D == 2) return 0;
  return model == Model::bearing || model == Model::range_bearing ? 1 : model == Model::corners ? 4 : 0;
}

// Where the parts of H and g that one row feeds begin in the linear system (see layout.hpp). The off-diagonal block
// has the rows of whichever variable comes later; if that is a, `coupling` holds ~start.
struct Places {
  int64_t diagonal_a, gradient_a, diagonal_b, gradient_b, coupling;
};

// Rows of one table whose variables have the same kinds.
struct Rows {
  int64_t count;
  const int64_t* state_a;    // where each row's first variable begins in the state
  const int64_t* state_b;    // and its second
  const double* z;           // count x measurement_numbers
  const double* whitening;   // count x rows x rows, row-major
  int64_t whitening_stride;  // 0: one for all rows
  const double* sensor;      // pose_numbers(D), or null. For the shadow of a pose in space it is lifted: 12 numbers
  const double* weight;      // per row, or null
  Loss loss;
  double scale;
  Curvature curvature;  // what H takes in beyond J'W'WJ
  const Places* places;
};

struct RowLoops {
  // Adds J'W'WJ and J'W'We, weighted, to the system. Returns the sum of weight * rho.
  double (*linearise)(const Rows&, const double* state, double* system);
  // Adds J'W'We, weighted, alone. Returns the same.
  double (*slope)(const Rows&, const double* state, double* system);
  // Returns the sum of weight * rho, and the whitened residuals (count x rows) if `whitened` is not null.
  double (*evaluate)(const Rows&, const double* state, double* whitened);
  // Writes WJ, without loss or weights: count x rows x 2 most_dof, the columns of the first variable first, then those of
  // the second, then nothing.
  void (*differentiate)(const Rows&, const double* state, double* whitened);
};

// Nulls if the model does not relate such variables. `b` is ignored by models of one key.
RowLoops row_loops(Model model, int D, Kind a, Kind b);

}  // namespace teamslam
