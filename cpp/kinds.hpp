// The four kinds of variable, and how a flat state vector holds them.
//
// A pose is X = (R, T), body to world, stored as T and then R row by row. Its tangent is [dT, dw]: T += dT in the world,
// R <- R Exp(dw). A planar pose stands for a yaw-only pose at z = 0 wherever a measurement is three-dimensional.
#pragma once

#include <cstdint>

namespace teamslam {

enum class Kind : int32_t { pose2 = 0, pose3 = 1, point2 = 2, point3 = 3 };
inline constexpr int kinds = 4;

constexpr int dof(Kind kind) { return kind == Kind::pose3 ? 6 : kind == Kind::point2 ? 2 : 3; }
inline constexpr int most_dof = 6;
constexpr int numbers(Kind kind) {  // length in the state vector
  return kind == Kind::pose3 ? 12 : kind == Kind::pose2 ? 6 : kind == Kind::point3 ? 3 : 2;
}
constexpr bool is_pose(Kind kind) { return kind == Kind::pose2 || kind == Kind::pose3; }
constexpr int dimension(Kind kind) { return kind == Kind::pose2 || kind == Kind::point2 ? 2 : 3; }

// Unknowns of a pose and of its rotation alone, in D dimensions.
constexpr int pose_dof(int D) { return D == 2 ? 3 : 6; }
constexpr int turn_dof(int D) { return D == 2 ? 1 : 3; }
constexpr int pose_numbers(int D) { return D == 2 ? 6 : 12; }

// Column j of a variable of this kind, as a column of the Jacobian of a D-dimensional pose.
constexpr int pose_column(Kind kind, int D, int j) { return kind == Kind::pose2 && D == 3 && j == 2 ? 5 : j; }

// The same for the Jacobian of a D-dimensional point; -1 where the point does not depend on that unknown (the rotation
// of a pose that is seen as a point, the height of a point whose shadow is seen).
constexpr int point_column(Kind kind, int D, int j) {
  const int axes = dimension(kind) < D ? dimension(kind) : D;
  return j < axes ? j : -1;
}

}  // namespace teamslam
