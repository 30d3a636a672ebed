// Products with a block-sparse information I (block_matrix.hpp) whose variables have 2, 3 or 6 unknowns: Y = I X, and
// A' I A added to H block by block. Sizes are known to the compiler, block by block.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "block_matrix.hpp"
#include "pair.hpp"

namespace teamslam {

inline constexpr int largest_jacobian = 36;  // numbers

// Columns of [A_b, e] for a base of d_b unknowns: an even number, e in the last one.
constexpr int even_width(int d_b) { return (d_b + 2) / 2 * 2; }

// X = A_r' I A_c for one stored block I (n_r x n_c, column-major) and row-major Jacobians, added to H.
template <int n_r, int d_r, int n_c, int d_c>
inline void add_block(const double* I, const double* A_r, const double* A_c, double* target, bool transposed) {
  double half[n_r * d_c], X[d_r * d_c];
  for (int i = 0; i < n_r; ++i)
    for (int q = 0; q < d_c; ++q) {
      double sum = I[i] * A_c[q];
      for (int k = 1; k < n_c; ++k) sum += I[n_r * k + i] * A_c[d_c * k + q];
      half[d_c * i + q] = sum;
    }
  for (int p = 0; p < d_r; ++p)
    for (int q = 0; q < d_c; ++q) {
      double sum = A_r[p] * half[q];
      for (int i = 1; i < n_r; ++i) sum += A_r[d_r * i + p] * half[d_c * i + q];
      X[d_c * p + q] = sum;
    }
  if (transposed)
    for (int i = 0; i < d_r * d_c; ++i) target[i] += X[i];
  else
    for (int p = 0; p < d_r; ++p)
      for (int q = 0; q < d_c; ++q) target[d_r * q + p] += X[d_c * p + q];
}

// A member has (estimate's unknowns, variable's unknowns) of one of these shapes; points of poses come last.
inline constexpr int shapes = 8;
inline constexpr std::array<std::pair<int, int>, shapes> member_shapes = {
    {{2, 2}, {3, 3}, {6, 6}, {6, 3}, {2, 3}, {2, 6}, {3, 2}, {3, 6}}};

// `count` stored blocks below one another and alike, as add_block; a target of ~start is transposed.
template <int n_r, int d_r, int n_c, int d_c>
void add_run(const double* I, const int32_t* row, int64_t count, const double* A, const double* A_c,
             const int64_t* target, double* H) {
  for (int64_t k = 0; k < count; ++k, I += n_r * n_c)
    add_block<n_r, d_r, n_c, d_c>(I, A + largest_jacobian * row[k], A_c, H + (target[k] < 0 ? ~target[k] : target[k]),
                                  target[k] < 0);
}
using AddRun = void (*)(const double*, const int32_t*, int64_t, const double*, const double*, const int64_t*, double*);

template <std::size_t r, std::size_t... c>
constexpr std::array<AddRun, shapes> add_run_row(std::index_sequence<c...>) {
  constexpr auto rows = member_shapes[r];
  return {&add_run<rows.first, rows.second, member_shapes[c].first, member_shapes[c].second>...};
}
inline constexpr auto every_shape = std::make_index_sequence<shapes>{};
template <std::size_t... r>
constexpr std::array<std::array<AddRun, shapes>, shapes> add_run_rows(std::index_sequence<r...>) {
  return {add_run_row<r>(every_shape)...};
}
inline constexpr std::array<std::array<AddRun, shapes>, shapes> add_runs = add_run_rows(every_shape);

inline int shape_of(int estimate_dof, int variable_dof) {
  const auto* found = std::find(member_shapes.begin(), member_shapes.end(), std::pair(estimate_dof, variable_dof));
  return static_cast<int>(found - member_shapes.begin());
}

// target (n x n) += (X + X') / 2: the diagonal blocks of H are symmetric to the last bit.
inline void add_symmetric(const double* X, int n, double* target) {
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) target[n * i + j] += 0.5 * (X[n * i + j] + X[n * j + i]);
}

// Y += I X for `count` stored blocks below one another and alike (n_r x n_c each, column-major), off the diagonal and
// both ways across it; X and Y have `lanes` numbers or pairs a row, row[k] and c begin at `start`. The column's own part
// stays in registers.
template <int n_r, int n_c, class Lane, int lanes>
void multiply_run(const double* I, const int32_t* row, int64_t count, const int64_t* start, int32_t c, const double* X,
                  double* Y) {
  constexpr int width = lanes * (sizeof(Lane) / sizeof(double));
  Lane X_c[n_c][lanes], Y_c[n_c][lanes];
  for (int j = 0; j < n_c; ++j)
    for (int q = 0; q < lanes; ++q) {
      X_c[j][q] = lane<Lane>(X + width * (start[c] + j), q);
      Y_c[j][q] = lane<Lane>(Y + width * (start[c] + j), q);
    }
  for (int64_t k = 0; k < count; ++k, I += n_r * n_c)
    for (int i = 0; i < n_r; ++i)
      for (int q = 0; q < lanes; ++q) {
        const int64_t at = width * (start[row[k]] + i);
        const Lane x = lane<Lane>(X + at, q);
        Lane y = lane<Lane>(Y + at, q);
        for (int j = 0; j < n_c; ++j) {
          y = y + I[n_r * j + i] * X_c[j][q];
          Y_c[j][q] = Y_c[j][q] + I[n_r * j + i] * x;
        }
        set_lane(Y + at, q, y);
      }
  for (int j = 0; j < n_c; ++j)
    for (int q = 0; q < lanes; ++q) set_lane(Y + width * (start[c] + j), q, Y_c[j][q]);
}

// Y += I X for a diagonal block of n unknowns.
template <class Lane, int lanes>
void multiply_diagonal(const double* I, int n, const double* X, double* Y) {
  constexpr int width = lanes * (sizeof(Lane) / sizeof(double));
  for (int i = 0; i < n; ++i)
    for (int q = 0; q < lanes; ++q) {
      Lane y = lane<Lane>(Y + width * i, q);
      for (int j = 0; j < n; ++j) y = y + I[n * j + i] * lane<Lane>(X + width * j, q);
      set_lane(Y + width * i, q, y);
    }
}

// By the estimates' unknowns (2, 3, 6).
using MultiplyRun = void (*)(const double*, const int32_t*, int64_t, const int64_t*, int32_t, const double*, double*);
template <class Lane, int lanes>
constexpr MultiplyRun multiply_runs[3][3] = {
    {&multiply_run<2, 2, Lane, lanes>, &multiply_run<2, 3, Lane, lanes>, &multiply_run<2, 6, Lane, lanes>},
    {&multiply_run<3, 2, Lane, lanes>, &multiply_run<3, 3, Lane, lanes>, &multiply_run<3, 6, Lane, lanes>},
    {&multiply_run<6, 2, Lane, lanes>, &multiply_run<6, 3, Lane, lanes>, &multiply_run<6, 6, Lane, lanes>}};
constexpr int place_of(int n) { return n == 6 ? 2 : n - 2; }

// Calls visit(first, end) for the runs of blocks first <= k < end of column c whose rows are of one kind.
template <class KindOf, class Visit>
void for_each_run(const BlockPattern& pattern, int64_t first, int64_t end, const KindOf& kind_of, const Visit& visit) {
  for (int64_t next; first < end; first = next) {
    const auto kind = kind_of(pattern.row[first]);
    for (next = first + 1; next < end && kind_of(pattern.row[next]) == kind;) ++next;
    visit(first, next);
  }
}

// Y = I X for the whole information.
template <class Lane, int lanes>
void multiply(const BlockPattern& pattern, const double* values, const double* X, double* Y) {
  constexpr int width = lanes * (sizeof(Lane) / sizeof(double));
  std::fill_n(Y, width * pattern.scalars(), 0.0);
  const auto dof_of = [&](int32_t v) { return pattern.dof[v]; };
  for (int32_t c = 0; c < pattern.variables(); ++c) {
    const int64_t diagonal = pattern.column_start[c], at = width * pattern.scalar_start[c];
    multiply_diagonal<Lane, lanes>(values + pattern.value_start[diagonal], dof_of(c), X + at, Y + at);
    for_each_run(pattern, diagonal + 1, pattern.column_start[c + 1], dof_of, [&](int64_t first, int64_t end) {
      multiply_runs<Lane, lanes>[place_of(dof_of(pattern.row[first]))][place_of(dof_of(c))](
          values + pattern.value_start[first], pattern.row.data() + first, end - first, pattern.scalar_start.data(), c,
          X, Y);
    });
  }
}

// The last column of Y = I X alone.
inline void multiply_last(const BlockPattern& pattern, const double* values, int width, const double* X, double* Y) {
  std::vector<double> x(pattern.scalars()), y(pattern.scalars());
  for (int64_t i = 0; i < pattern.scalars(); ++i) x[i] = X[width * i + width - 1];
  multiply<double, 1>(pattern, values, x.data(), y.data());
  for (int64_t i = 0; i < pattern.scalars(); ++i) Y[width * i + width - 1] = y[i];
}

// Y = I X: all columns for a base of 3 or 6 unknowns, or the last of them alone.
inline void multiply(const BlockPattern& pattern, const double* values, int width, bool all, const double* X,
                     double* Y) {
  if (all && width == even_width(3)) return multiply<Pair, even_width(3) / 2>(pattern, values, X, Y);
  if (all && width == even_width(6)) return multiply<Pair, even_width(6) / 2>(pattern, values, X, Y);
  multiply_last(pattern, values, width, X, Y);
}

}  // namespace teamslam
