// What a Cholesky factorisation holds besides its analysis; shared by the files that implement it.
#pragma once

#include <memory>
#include <vector>

#include "buffer.hpp"
#include "cholesky.hpp"
#include "dense.hpp"
#include "symbolic.hpp"
#include "threads.hpp"

namespace teamslam {

struct Cholesky::Numeric {
  void prepare(const Symbolic& symbolic, int threads);  // allocates what is missing

  Buffer panel;                   // the factor, front after front
  std::vector<double> inverse;    // reciprocal diagonal of L, in elimination order
  std::vector<double> lowest;     // the smallest pivot that each diagonal entry allows
  Buffer handoff;                 // update matrices that tasks hand to the fronts above them: stacks 2, 3 and 4
  std::vector<Buffer> workspace;  // stacks 0 and 1, one pair for each worker
};

// One numeric factorisation, by a team. Every member makes its own.
class Factorisation {
 public:
  struct Input {
    const Symbolic& symbolic;
    const double* values;
    const double* damping;  // or null
    bool keep_last;         // assemble the last front without factoring it
  };

  Factorisation(const Input& input, double* panel, double* inverse, double* lowest, double* handoff, double* workspace);

  // Each returns whether all pivots were positive; if not, failed_scalar says where, in elimination order.
  bool factor_alone(int32_t f);
  bool factor_together(int32_t f, Team& team, std::atomic<bool>& failed);
  int64_t failed_scalar() const { return failed_scalar_; }

 private:
  double* update_of(const Front& front) const;
  Destination destination(const Front& front) const;
  void scatter(const Front& front) const;
  void add_children(const Front& front, int64_t begin, int64_t end) const;

  const Input& input_;
  const DenseKernels& dense_;
  double* panel_;
  double* inverse_;
  double* lowest_;
  double* stack_[5];
  int64_t failed_scalar_ = -1;
};

}  // namespace teamslam
