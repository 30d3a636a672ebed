// The steps of `analyse`, between its files: elimination tree -> fronts -> layout -> tasks.
#pragma once

#include <span>

#include "symbolic.hpp"

namespace teamslam {

// Nanoseconds to assemble and factor a front of `columns` pivots and `total` scalars, as measured: a fixed cost, the
// memory touched, and arithmetic at a rate that small fronts do not reach.
double front_time(double columns, double total);

// The fronts as a tree: pivot positions of each, and its parent, children before parents.
struct FrontTree {
  std::vector<int32_t> pivot_start, pivot;  // positions in the elimination, front after front
  std::vector<int32_t> parent;              // or -1
  std::vector<int64_t> columns, total;      // scalar pivots, and scalars in all

  std::span<const int32_t> pivots(int32_t front) const {
    return {pivot.data() + pivot_start[front], pivot.data() + pivot_start[front + 1]};
  }
};

// Joins columns into fronts; the `last_count` last variables make one front of their own.
FrontTree front_tree(const Graph& graph, const Elimination& elimination, int32_t last_count);

// A postorder of the fronts in which the children that need most memory come first (Liu 1986).
std::vector<int32_t> visiting_order(const FrontTree& tree);

// Cuts the tree into tasks, late subtrees and the fronts above, the same for any number of threads; and places the
// update matrices on their stacks.
void lay_out_tasks(Symbolic& symbolic);

}  // namespace teamslam
