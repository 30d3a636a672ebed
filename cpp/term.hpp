// One part of the cost: a table of measurements, a submap, a user's own sensor.
//
// The problem is frozen once, before its first use, by calls in this order: weigh, arrange, couple, place (twice, see
// layout.hpp). From then on linearise and cost may be called for different chunks at the same time.
#pragma once

#include <cstdint>
#include <vector>

#include "checks.hpp"
#include "couplings.hpp"
#include "curvature.hpp"
#include "layout.hpp"

namespace teamslam {

class Term {
 public:
  virtual ~Term() = default;

  // Adds the expected work (in multiplications) to the variable that each piece of it belongs to.
  virtual void weigh(std::vector<double>& work) const = 0;
  // Learns which chunk each variable's work belongs to.
  virtual void arrange(const std::vector<int32_t>& chunk_of_variable, int32_t chunks) = 0;
  virtual void couple(Couplings& couplings) = 0;
  virtual void place(int32_t chunk, Layout& layout) = 0;

  // Adds this chunk's part of H and g to the system, or of g alone, which is less work; all return its part of the
  // cost.
  virtual double linearise(int32_t chunk, const double* state, double* system) const = 0;
  virtual double slope(int32_t, const double*, double*) const { refuse("a user's blocks give no slope alone"); }
  virtual double cost(int32_t chunk, const double* state) const = 0;

  // The most information that it has on any one number; 0 where that is not its business.
  virtual double sharpest() const { return 0.0; }

  // The first row of a table, or member of a submap, of which a residual, Jacobian or cost is not finite; -1: none.
  virtual int64_t fault(const double*) const { return -1; }

  // What H takes in: nothing more (it is information), the curvature of losses, or all (for steps like Newton's).
  void set_curvature(Curvature curvature) { curvature_ = curvature; }

 protected:
  Curvature curvature_ = Curvature::none;
};

}  // namespace teamslam
