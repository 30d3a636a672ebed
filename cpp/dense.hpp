// Dense kernels on small column-major matrices in double precision: what the fronts are factored with.
//
// Every row count is a multiple of 4 (padded, with zeros), so that the kernels need no tails along rows. A kernel gives
// the same bits however its columns or rows are shared out among calls.
#pragma once

#include <cstdint>

namespace teamslam {

// Consecutive rows of a front that are consecutive scalars of its parent as well.
struct Run {
  int32_t from, to, length;
};

// A front: pivot block, rows below it and update matrix; scalars numbered pivots first.
struct Destination {
  int64_t columns;  // pivots
  double* pivots;
  int64_t pivot_leading;
  double* rows;
  double* update;
  int64_t row_leading;  // of rows and of update
};

struct DenseKernels {
  const char* name;
  // C -= A B: C is rows x columns, A is rows x inner; B(p, j) = b[p * b_inner + j * b_column].
  void (*subtract_product)(int64_t rows, int64_t columns, int64_t inner, const double* a, int64_t a_leading,
                           const double* b, int64_t b_inner, int64_t b_column, double* c, int64_t c_leading);
  // Lower triangle of C -= A A', columns begin .. end (multiples of 4); what stands above the diagonal is lost.
  void (*subtract_square)(int64_t rows, int64_t inner, const double* a, int64_t a_leading, double* c,
                          int64_t c_leading, int64_t begin, int64_t end);
  // Lower Cholesky factor of the leading columns x columns of D in place; inverse gets 1 / L_jj. A pivot that is not
  // above lowest[j] stops it: returns its index, or -1.
  int64_t (*factor)(int64_t columns, double* d, int64_t leading, const double* lowest, double* inverse);
  // X = X L^-T, X is rows x columns; L lower with reciprocal diagonal `inverse`.
  void (*divide_transposed)(int64_t rows, int64_t columns, const double* l, int64_t l_leading, const double* inverse,
                            double* x, int64_t x_leading);
  // X = X L^-1.
  void (*divide)(int64_t rows, int64_t columns, const double* l, int64_t l_leading, const double* inverse, double* x,
                 int64_t x_leading);
  // Adds a child's update matrix (lower triangle) to columns begin .. end of its parent's front.
  void (*extend_add)(const double* update, int64_t leading, const Run* run, int64_t runs, const Destination& to,
                     int64_t begin, int64_t end);
  // One right-hand side through a panel: x = D^-1 x, then t = -L x (rows padded).
  void (*forward_one)(int64_t columns, int64_t rows, const double* d, int64_t d_leading, const double* l,
                      int64_t l_leading, const double* inverse, double* x, double* t);
  // x = D^-T (x - L' t).
  void (*backward_one)(int64_t columns, int64_t rows, const double* d, int64_t d_leading, const double* l,
                       int64_t l_leading, const double* inverse, double* x, const double* t);
};

// The best kernels for this processor, chosen once.
const DenseKernels& dense_kernels();

}  // namespace teamslam
