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

namespace teamslam {

inline constexpr int largest_jacobian = 36;  // numbers

// X = A_r' I A_c for one stored block I (n_r x n_c, column-major) and row-major Jacobians, added to H.
template <int n_r, int d_r, int n_c, int d_c>
void add_block(const double* I, const double* A_r, const double* A_c, double* target, bool transposed) {
  double half[n_r * d_c] = {}, X[d_r * d_c] = {};
  for (int k = 0; k < n_c; ++k)
    for (int i = 0; i < n_r; ++i)
      for (int q = 0; q < d_c; ++q) half[d_c * i + q] += I[n_r * k + i] * A_c[d_c * k + q];
  for (int i = 0; i < n_r; ++i)
    for (int p = 0; p < d_r; ++p)
      for (int q = 0; q < d_c; ++q) X[d_c * p + q] += A_r[d_r * i + p] * half[d_c * i + q];
  if (transposed)
    for (int i = 0; i < d_r * d_c; ++i) target[i] += X[i];
  else
    for (int p = 0; p < d_r; ++p)
      for (int q = 0; q < d_c; ++q) target[d_r * q + p] += X[d_c * p + q];
}

// A member has (estimate's unknowns, variable's unknowns) of one of four shapes.
inline constexpr std::array<std::pair<int, int>, 4> member_shapes = {{{2, 2}, {3, 3}, {6, 6}, {6, 3}}};
using AddBlock = void (*)(const double*, const double*, const double*, double*, bool);

template <std::size_t r, std::size_t... c>
constexpr std::array<AddBlock, 4> add_block_row(std::index_sequence<c...>) {
  constexpr auto rows = member_shapes[r];
  return {&add_block<rows.first, rows.second, member_shapes[c].first, member_shapes[c].second>...};
}
inline constexpr auto every_shape = std::make_index_sequence<4>{};
inline constexpr std::array<std::array<AddBlock, 4>, 4> add_blocks = {
    add_block_row<0>(every_shape), add_block_row<1>(every_shape), add_block_row<2>(every_shape),
    add_block_row<3>(every_shape)};

inline int shape_of(int estimate_dof, int variable_dof) {
  return estimate_dof == 2 ? 0 : estimate_dof == 3 ? 1 : variable_dof == 6 ? 2 : 3;
}

// target (n x n) += (X + X') / 2: the diagonal blocks of H are symmetric to the last bit.
inline void add_symmetric(const double* X, int n, double* target) {
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) target[n * i + j] += 0.5 * (X[n * i + j] + X[n * j + i]);
}

// Y += I X for one stored block (n_r x n_c, column-major) and `width` row-major columns, both ways across the diagonal.
template <int n_r, int n_c, int width>
void multiply_block(const double* I, const double* X_r, const double* X_c, double* Y_r, double* Y_c, bool diagonal) {
  for (int i = 0; i < n_r; ++i) {
    double sum[width];
    for (int c = 0; c < width; ++c) sum[c] = Y_r[width * i + c];
    for (int j = 0; j < n_c; ++j)
      for (int c = 0; c < width; ++c) sum[c] += I[n_r * j + i] * X_c[width * j + c];
    for (int c = 0; c < width; ++c) Y_r[width * i + c] = sum[c];
  }
  if (diagonal) return;
  for (int j = 0; j < n_c; ++j) {
    double sum[width];
    for (int c = 0; c < width; ++c) sum[c] = Y_c[width * j + c];
    for (int i = 0; i < n_r; ++i)
      for (int c = 0; c < width; ++c) sum[c] += I[n_r * j + i] * X_r[width * i + c];
    for (int c = 0; c < width; ++c) Y_c[width * j + c] = sum[c];
  }
}

// By the estimates' unknowns (2, 3, 6).
using MultiplyBlock = void (*)(const double*, const double*, const double*, double*, double*, bool);
template <int width>
constexpr MultiplyBlock multiply_blocks[3][3] = {
    {&multiply_block<2, 2, width>, &multiply_block<2, 3, width>, &multiply_block<2, 6, width>},
    {&multiply_block<3, 2, width>, &multiply_block<3, 3, width>, &multiply_block<3, 6, width>},
    {&multiply_block<6, 2, width>, &multiply_block<6, 3, width>, &multiply_block<6, 6, width>}};
constexpr int place_of(int n) { return n == 6 ? 2 : n - 2; }

// Y = I X for the whole information.
template <int width>
void multiply(const BlockPattern& pattern, const double* values, const double* X, double* Y) {
  std::fill_n(Y, width * pattern.scalars(), 0.0);
  for (int32_t c = 0; c < pattern.variables(); ++c) {
    const int64_t at_c = width * pattern.scalar_start[c];
    for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k) {
      const int32_t r = pattern.row[k];
      const int64_t at_r = width * pattern.scalar_start[r];
      multiply_blocks<width>[place_of(pattern.dof[r])][place_of(pattern.dof[c])](
          values + pattern.value_start[k], X + at_r, X + at_c, Y + at_r, Y + at_c, r == c);
    }
  }
}

// The last column of Y = I X alone.
inline void multiply_last(const BlockPattern& pattern, const double* values, int width, const double* X, double* Y) {
  std::vector<double> x(pattern.scalars()), y(pattern.scalars());
  for (int64_t i = 0; i < pattern.scalars(); ++i) x[i] = X[width * i + width - 1];
  multiply<1>(pattern, values, x.data(), y.data());
  for (int64_t i = 0; i < pattern.scalars(); ++i) Y[width * i + width - 1] = y[i];
}

// Y = I X: all of 1, 4 or 7 columns, or the last of them alone.
inline void multiply(const BlockPattern& pattern, const double* values, int width, bool all, const double* X,
                     double* Y) {
  if (all && width == 4) return multiply<4>(pattern, values, X, Y);
  if (all && width == 7) return multiply<7>(pattern, values, X, Y);
  multiply_last(pattern, values, width, X, Y);
}

}  // namespace teamslam
