// The one shape of matrix that the kernel knows: symmetric, sparse, made of small dense blocks.
//
// Variable v has dof[v] unknowns. Only the lower triangle is stored, by block column: column c holds its diagonal
// block first and then its rows in rising order. Block k = (row[k], column c) is a dense dof[row[k]] x dof[c]
// rectangle, column-major, at values[value_start[k]]. Diagonal blocks are stored whole and are symmetric.
#pragma once

#include <cstdint>
#include <vector>

namespace teamslam {

struct BlockPattern {
  std::vector<int32_t> dof;           // unknowns per variable
  std::vector<int64_t> column_start;  // size n + 1: blocks of column c are column_start[c] .. column_start[c + 1]
  std::vector<int32_t> row;           // row variable of each block; the first of every column is the column itself
  std::vector<int64_t> value_start;   // size blocks + 1: where each block's values begin
  std::vector<int64_t> scalar_start;  // size n + 1: first scalar unknown of each variable

  int32_t variables() const { return static_cast<int32_t>(dof.size()); }
  int64_t blocks() const { return static_cast<int64_t>(row.size()); }
  int64_t scalars() const { return scalar_start.empty() ? 0 : scalar_start.back(); }
  int64_t size() const { return value_start.empty() ? 0 : value_start.back(); }
};

}  // namespace teamslam
