// The block graph of a pattern.
#include "ordering.hpp"

#include <cstddef>

namespace teamslam {

Graph graph_of(const BlockPattern& pattern) {
  const int32_t n = pattern.variables();
  Graph graph;
  graph.weight = pattern.dof;
  graph.start.assign(static_cast<size_t>(n) + 1, 0);
  for (int32_t c = 0; c < n; ++c) {
    for (int64_t k = pattern.column_start[c] + 1; k < pattern.column_start[c + 1]; ++k) {
      ++graph.start[c + 1];
      ++graph.start[pattern.row[k] + 1];
    }
  }
  for (int32_t v = 0; v < n; ++v) graph.start[v + 1] += graph.start[v];
  graph.neighbour.resize(static_cast<size_t>(graph.start[n]));
  std::vector<int64_t> next(graph.start.begin(), graph.start.end() - 1);
  for (int32_t c = 0; c < n; ++c) {
    for (int64_t k = pattern.column_start[c] + 1; k < pattern.column_start[c + 1]; ++k) {
      const int32_t r = pattern.row[k];
      graph.neighbour[next[c]++] = r;
      graph.neighbour[next[r]++] = c;
    }
  }
  return graph;
}

}  // namespace teamslam
