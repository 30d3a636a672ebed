// A symmetric positive definite matrix without some of its variables, which are eliminated exactly; the rest stays sparse.
//
//   H = [H_ss H_sb; H_bs H_bb]   s: stays, b: goes        condensed  H_ss - H_sb H_bb^-1 H_bs
//
// The variables that go fall into groups that do not touch each other. Each group is factored by itself and leaves a
// dense block over its border, the variables that it touches and that stay; where borders meet, blocks add up. On a
// robot's way that meets others at a few poses, groups are the stretches between, so that little fills in.
#pragma once

#include <cstdint>
#include <vector>

#include "block_matrix.hpp"
#include "cholesky.hpp"

namespace teamslam {

class Condensation {
 public:
  // gone: for each variable whether it goes. frugal: what would leave more numbers than it takes away stays instead: all
  // go where the whole shrinks by it, else each group whose dense block is no larger than what goes with it.
  // The same input gives the same bits for any number of threads.
  Condensation(const BlockPattern& whole, const double* values, std::vector<uint8_t> gone, bool frugal, int threads);

  // -1, or the variable at which a pivot was not positive: it is not determined when what stays is known.
  int32_t failed() const { return failed_; }
  const std::vector<uint8_t>& gone() const { return gone_; }
  // Over the variables that stay, in their order.
  const BlockPattern& pattern() const { return pattern_; }
  const std::vector<double>& values() const { return values_; }
  // The move of what is gone that x'Hx is least with, once that of what stays is known: -H_bb^-1 H_bs x_s. Both one
  // number for each unknown, in the order of the variables.
  void follow(const double* stays, double* gone) const;

 private:
  // A group's own matrix has the variables that go first, then its border, whose own blocks are zero in it.
  struct Group {
    std::vector<int32_t> inner, border;  // variables, rising
    std::vector<Cholesky> factor;        // one, once it is eliminated
    std::vector<double> complement;      // dense, over the border's unknowns
    int32_t failed = -1;
  };
  struct Whole;

  std::vector<Group> groups_of(const Whole& whole) const;
  void keep_what_pays(const Whole& whole);
  void eliminate(const Whole& whole, Group& group) const;
  void lay_out(const Whole& whole);
  void add_up(const Whole& whole);
  double* block(int32_t row, int32_t column);

  std::vector<uint8_t> gone_;
  int threads_;
  int32_t failed_ = -1;
  std::vector<Group> groups_;
  std::vector<int32_t> place_;         // of each variable among those that stay, or among those that go
  std::vector<int64_t> scalar_start_;  // of each variable, among the unknowns of those that stay, or go
  std::vector<int32_t> dof_;
  int64_t scalars_gone_ = 0;
  BlockPattern pattern_;
  std::vector<double> values_;
};

}  // namespace teamslam
