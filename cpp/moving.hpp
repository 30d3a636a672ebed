// The variables of a robot's filter and how they move together (the formulas: src/teamslam/robot/order.py).
//
// Variable 0 is the pose of now; what `turns` turns with it about a centre:
//   T' = c + Exp(w) (T - c) + Exp(w/2) v      R' = Exp(w) R Exp(u)      w: the turn of the pose of now
// and all else moves by itself. The pose of now is of the plane or of space; others may have more dimensions.
#pragma once

#include <cstdint>
#include <vector>

#include "kinds.hpp"

namespace teamslam {

class Moving {
 public:
  // centre: as many numbers as the pose of now has dimensions. Throws std::invalid_argument where variable 0 is no
  // pose, or where something of the plane turns in space.
  Moving(int64_t count, const int32_t* kinds, const uint8_t* turns, const double* centre);

  int64_t count() const { return static_cast<int64_t>(kind.size()); }
  int64_t unknowns() const { return unknown.back(); }
  int64_t numbers() const { return number.back(); }
  int own() const { return dof(kind[0]); }         // unknowns of the pose of now
  int axes() const { return turn_dof(dimension); }  // of its turn, the last of them

  // How each unknown of the mixed chart moves as what turns turns: unknowns x axes, row-major; zero where nothing does.
  void turning(const double* state, double* out) const;
  // x (+) delta.
  void retract(const double* state, const double* delta, double* out) const;

  std::vector<Kind> kind;
  std::vector<uint8_t> turns;
  std::vector<int64_t> number, unknown;  // where each begins in the state and among the unknowns, and the total
  int dimension;                         // of the pose of now

 private:
  double centre_[3];
};

// How a variable moves in the mixed chart as it turns about a centre: dof x axes, row-major.
template <int D>
void turning_of(Kind kind, const double* x, const double* centre, double* out);

}  // namespace teamslam
