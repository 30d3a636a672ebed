// Sparse Cholesky factorisation A = P' L L' P of a symmetric positive definite block matrix: analysis once for a
// pattern, then as many factorisations, solves and (partial) inverses as wanted.
//
// Method: multifrontal (Duff and Reid 1983). The unknowns of a supernode and all rows that they touch form a small
// dense matrix, the front; dense kernels factor it, and what is left goes to its parent in the assembly tree. The
// fronts of SLAM graphs are small, so all indexing is done once, in the analysis, and in blocks.
//
// The same input gives the same bits for any number of threads. A `const` member may be called from several threads
// at once; the others may not. The caller keeps to the documented sizes: nothing is validated here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "block_matrix.hpp"
#include "ordering.hpp"

namespace teamslam {

struct Symbolic;

// Of a pattern: order, fronts and every index. Any number of factors may share one.
using Analysis = std::shared_ptr<const Symbolic>;

// positions: variables x 3, row-major, or null: where each variable is, for geometric bisection (Ordering::geometric
//   needs them; automatic may use them).
// last: variables that must be eliminated last, in the order given (Schur complements); they form one dense front.
Analysis analysed(const BlockPattern& pattern, Ordering ordering, const double* positions, const int32_t* last,
                  int32_t last_count, int threads);

class Cholesky {
 public:
  Cholesky(Analysis analysis, int threads);
  ~Cholesky();
  Cholesky(Cholesky&&) noexcept;
  Cholesky& operator=(Cholesky&&) noexcept;

  // Factors values (on the pattern) plus diag(damping) (scalars(), or null). Returns -1, or the variable at which a
  // pivot was not positive: not above 64 machine epsilons of its own diagonal entry, or not a number. Nothing is
  // regularised; after a failure only factor and eliminate may be called.
  int32_t factor(const double* values, const double* damping);

  // A X = B in place, row-major scalars() x columns, natural (input) order.
  void solve(double* rhs, int64_t columns) const;
  // X = L^-1 P B in place. Row i of the result belongs to elimination position i: the scalars of variable order()[0]
  // come first, then those of order()[1], and so on. Columns of B = J' give J A^-1 J' as X' X.
  void solve_lower(double* rhs, int64_t columns) const;
  // X = P' L^-T B in place, rows of B by elimination position: solve_upper after solve_lower is solve. Of columns of
  // white noise it makes draws whose covariance is A^-1.
  void solve_upper(double* rhs, int64_t columns) const;
  double log_determinant() const;  // of A

  // Entries of A^-1 on the input pattern, in its layout (diagonal blocks whole).
  void inverse_on_pattern(double* values_out) const;
  // Diagonal blocks of A^-1 of some variables, one after another as they are named, each dof x dof, column-major. Only
  // what these depend on is computed.
  void diagonal_inverse(const int32_t* variables, int64_t count, double* blocks_out) const;

  // Eliminates all variables but `last`. With m scalars in `last` (in the order given): complement (m x m,
  // column-major, whole) = A_ll - A_li A_ii^-1 A_il, and reduced_rhs (m) = b_l - A_li A_ii^-1 b_i. rhs is in natural
  // order; rhs and reduced_rhs may both be null. Returns as factor. Afterwards only back_substitute, factor and
  // eliminate may be called.
  int32_t eliminate(const double* values, const double* damping, double* complement, const double* rhs,
                    double* reduced_rhs);
  // The interiors from the solution of `last`: rhs_inout is b in natural order on entry and x on return, with
  // last_solution copied into the entries of `last`.
  void back_substitute(const double* last_solution, double* rhs_inout) const;

  // Gives back what only a factorisation needs; solves go on as before, and the next factorisation fetches it anew.
  void put_away();

  const int32_t* order() const;     // variable at each elimination position
  int64_t last_scalars() const;     // m
  int64_t factor_nonzeros() const;  // of L, scalars, lower triangle, with the zeros that amalgamation added
  double flops() const;             // of one factorisation
  Ordering used() const;            // the ordering that `automatic` settled on
  size_t bytes() const;             // held by the object: analysis, factor and working stacks

 private:
  int32_t run(const double* values, const double* damping, bool keep_last);

  Analysis symbolic_;
  struct Numeric;
  std::unique_ptr<Numeric> numeric_;
  int threads_;
};

}  // namespace teamslam
