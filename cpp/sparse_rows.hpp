// A symmetric sparse matrix by rows of scalars (both triangles stored, as SciPy does), turned into blocks and back.
#pragma once

#include <cstdint>
#include <vector>

#include "block_matrix.hpp"

namespace teamslam {

struct SparseRows {
  const int64_t* start;  // size n + 1, from 0: entries of row i are start[i] .. start[i + 1], their columns rising
  const int32_t* column;
  const double* value;
};

// The pattern over variables of `dof` unknowns, every diagonal block included, and its values. Of the two triangles the
// lower one counts. Throws std::invalid_argument where the rows do not fit the unknowns.
BlockPattern blocks_of(const SparseRows& rows, std::vector<int32_t> dof, std::vector<double>& values);

// Both triangles by rows, columns rising: start (scalars + 1), column and value (all blocks, those off the diagonal twice).
void rows_of(const BlockPattern& pattern, const double* values, int threads, int64_t* start, int32_t* column,
             double* value);

}  // namespace teamslam
