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

// Approximate minimum degree. Vertices marked in `frozen` (may be empty: none) are never eliminated, but count in the
// degrees of their neighbours; they are absent from the returned elimination order.
std::vector<int32_t> minimum_degree(const Graph& graph, const std::vector<uint8_t>& frozen);

// Nested dissection by multilevel vertex separators, leaves by minimum degree with their border frozen. With
// `positions` (n x 3, row-major) the separators start from geometric bisection instead of coarsening. Frozen vertices
// as above.
std::vector<int32_t> nested_dissection(const Graph& graph, const std::vector<uint8_t>& frozen, const double* positions,
                                       int threads);

}  // namespace teamslam
