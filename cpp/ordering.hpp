// Fill-reducing orderings of the block graph. A vertex is a variable, an edge a stored off-diagonal block, and the
// weight of a vertex its number of unknowns, so that degrees and separators are counted in scalars.
#pragma once

#include <cstdint>
#include <vector>

#include "block_matrix.hpp"

namespace teamslam {

enum class Ordering { automatic, minimum_degree, nested_dissection, geometric, natural };

// Symmetric adjacency without self-loops: neighbours of v are neighbour[start[v]] .. neighbour[start[v + 1]].
struct Graph {
  std::vector<int64_t> start;
  std::vector<int32_t> neighbour;
  std::vector<int32_t> weight;

  int32_t size() const { return static_cast<int32_t>(weight.size()); }
};

Graph graph_of(const BlockPattern& pattern);

// Vertices with more neighbours than this are set aside by the orderings and come last.
int64_t dense_degree(int32_t vertices);

// Approximate minimum degree. Vertices of a later stage (may be empty: all 0) are eliminated after those of an earlier
// one; those of stage `never_eliminated` only count in the degrees of their neighbours and are absent from the result.
constexpr uint8_t never_eliminated = 255;
std::vector<int32_t> minimum_degree(const Graph& graph, const std::vector<uint8_t>& stage);

// Vertices from which on dissection pays; smaller parts of a dissection are left to minimum degree as well.
constexpr int32_t dissected_from = 2500;

// Nested dissection by multilevel vertex separators, minimum degree within. With `positions` (n x 3, row-major) the
// separators start from geometric bisection instead of coarsening. Vertices marked in `frozen` (may be empty) are
// absent from the result.
std::vector<int32_t> nested_dissection(const Graph& graph, const std::vector<uint8_t>& frozen, const double* positions,
                                       int threads);

}  // namespace teamslam
