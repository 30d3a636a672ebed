// Moving along a step: x (+) d, variable by variable, or carried by frames so that a map is moved without being bent.
//
// A step that turns a whole submap by an angle a, taken along straight lines, bends it at lever arm l by l a^2 / 2. A
// variable with a home, a pose F that turns with the submap, moves along
//   X = F Y,   F+ = F (+) d_F,   Y+ = Y (+) d_Y,   X+ = F+ Y+     with d_Y such that X+ = X (+) d to first order:
//   dy = R_F' (dT - dT_F) - dw_F x y,   dw_Y = dw - R_Y' dw_F     (y, R_Y: the place and the rotation within the frame).
// Homes may have homes; they are moved first. What is held does not move.
#pragma once

#include <cstdint>
#include <vector>

#include "variables.hpp"

namespace teamslam {

class Retraction {
 public:
  explicit Retraction(const Variables& variables);

  // home: for each variable the one that carries it, or -1. Throws std::invalid_argument for a home that is no pose, that
  // is in space while the variable is planar, or that leads round in a circle.
  void set_homes(const int64_t* home);

  // delta over the free variables; rotations are kept orthonormal to rounding.
  void move(const double* state, const double* delta, double* out) const;

 private:
  void check_home(int64_t variable, int64_t home) const;
  template <int D>
  void carry(int32_t variable, const double* state, const double* delta, double* out) const;

  const Variables& variables_;
  std::vector<int64_t> delta_start_;  // of each variable, or held
  std::vector<int32_t> home_;         // or -1
  std::vector<int32_t> order_;        // free variables, homes before what they carry
};

}  // namespace teamslam
