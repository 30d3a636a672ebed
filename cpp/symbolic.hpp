// Symbolic factorisation: everything about the factor of a pattern that does not depend on the values.
//
// Two steps. `eliminate_symbolically` finds the elimination tree and the size of every column of L without forming L
// (Liu 1986; Gilbert, Ng and Peyton 1994), in time almost linear in the pattern: cheap enough to compare orderings.
// `analyse` then joins columns into fronts, lays out memory and prepares every index that the numeric phase needs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "block_matrix.hpp"
#include "dense.hpp"
#include "ordering.hpp"

namespace teamslam {

// Columns of dense matrices are padded to a multiple of 4 rows, so that the kernels work on whole vectors.
inline int64_t padded(int64_t rows) { return (rows + 3) & ~int64_t{3}; }

// An ordering, made a postorder of its elimination tree.
struct Elimination {
  std::vector<int32_t> order;   // variable at each position; the `last` variables hold the last positions
  std::vector<int32_t> parent;  // position of the parent in the elimination tree, or -1
  std::vector<int64_t> count;   // scalar rows of L in a column of the block column, its own dof included
  double nonzeros = 0;          // of L, lower triangle
  double flops = 0;
};

// `order` must end with the `last_count` variables that have to stay last; these are treated as mutually connected.
Elimination eliminate_symbolically(const Graph& graph, const std::vector<int32_t>& order, int32_t last_count);

// A front has `columns` pivot scalars and `rows` further scalars. Its panel of the factor is the pivot block, `columns`
// columns of padded(columns) rows, followed by the rows below, `columns` columns of padded(rows) rows. Its update
// matrix is padded(rows) square. Scalars of a front are numbered pivots first.
struct Front {
  int32_t first_position;   // of its pivot variables
  int32_t variables;        // pivot variables
  int32_t columns;
  int32_t rows;
  int32_t parent;           // front, or -1
  int32_t depth;            // 0 for roots
  int64_t first_scalar;     // of the pivots, in elimination order
  int64_t panel;            // where its panel begins
  int64_t row_start;        // in Symbolic::row_scalar: elimination-order scalars of its `rows` rows
  int64_t child_start, child_end;      // in Symbolic::child
  int64_t scatter_start, scatter_end;  // in Symbolic::scatter
  int64_t run_start, run_end;          // in Symbolic::run: its rows within its parent
  int64_t update;                      // where its update matrix begins in its stack
  int32_t stack;                       // which: see Symbolic::stack_size

  int64_t leading_pivot() const { return padded(columns); }
  int64_t leading_rows() const { return padded(rows); }
  int64_t below() const { return leading_pivot() * columns; }  // panel offset of the rows below
  int64_t panel_size() const { return (leading_pivot() + leading_rows()) * columns; }
  int64_t update_size() const { return leading_rows() * leading_rows(); }
};

// A pattern block's place in its front's panel. A negative leading dimension says that the block is transposed there.
struct Scatter {
  int64_t value;
  int32_t target;
  int32_t leading;
  int32_t rows, columns;  // of the block in the pattern
};

// A subtree that one thread factors alone.
struct Task {
  int32_t first, end;  // fronts of the subtree, the last is its root
  double work;
};

// A front above all tasks and the late subtrees that it waits for. `shared` fronts are large enough for the whole team.
struct Step {
  int32_t front;
  int32_t late_start, late_end;
  bool shared;
};

struct Symbolic {
  std::vector<int32_t> order, position;
  std::vector<int64_t> natural_scalar;  // of each elimination-order scalar: its natural one
  std::vector<Front> front;             // in postorder
  std::vector<int32_t> child;
  std::vector<int32_t> row_scalar;
  std::vector<Scatter> scatter;
  std::vector<Run> run;
  std::vector<Task> task;  // disjoint subtrees, in rising order
  std::vector<Task> late;  // small subtrees that hang on the fronts above the tasks, done just before their parent
  std::vector<Step> top;   // fronts above the tasks, in postorder
  std::vector<int32_t> dof;  // by variable
  std::vector<int64_t> scalar_start;  // by variable, natural
  int64_t panel_total = 0;
  int64_t scalars = 0;
  int64_t last_scalars = 0;
  // Update matrices live on stacks: 0 and 1 in a worker's own memory (fronts of even and odd depth, so that a front and
  // its children never share one), 2 holds the results of tasks, 3 and 4 are as 0 and 1 for the fronts above the tasks
  // and the results of late subtrees.
  int64_t stack_size[5] = {0, 0, 0, 0, 0};
  int32_t largest_front = 0;  // columns + rows
  double nonzeros = 0, flops = 0;
  Ordering used = Ordering::natural;

  size_t bytes() const;
};

Symbolic analyse(const BlockPattern& pattern, const Graph& graph, const Elimination& elimination, int32_t last_count);

}  // namespace teamslam
