// Geometric bisection: see dissection.hpp. Maps are nearly planar and sightings short, so a straight line through the
// map crosses few of them. Lines of several directions are swept over the map, and the one of least ratio cut
// (edge weight crossed over the product of both sides' weights), within the balance allowed, is made a vertex separator
// and refined.
#include <algorithm>
#include <numeric>

#include "dissection.hpp"

namespace teamslam {
namespace {

constexpr int directions = 4;
constexpr double direction[directions][3] = {{1, 0, 0}, {0, 1, 0}, {0.7, 0.7, 0}, {0.7, -0.7, 0}};

// `left` is what lies before `cut` in `order`; of every edge cut, the end on the lighter side of the cut's border joins
// the separator.
Separation border(const WeightedGraph& graph, const std::vector<int32_t>& order, size_t cut) {
  Separation sides;
  sides.side.assign(order.size(), right);
  for (size_t i = 0; i < cut; ++i) sides.side[order[i]] = left;
  Separation best;
  for (int from = 0; from < 2; ++from) {
    Separation trial = sides;
    for (int32_t v = 0; v < graph.size(); ++v) {
      if (sides.side[v] != from) continue;
      for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
        if (sides.side[graph.neighbour[k]] == 1 - from) {
          trial.side[v] = separator;
          break;
        }
      }
    }
    for (int32_t v = 0; v < graph.size(); ++v) trial.weight[trial.side[v]] += graph.weight[v];
    if (from == 0 || better(trial, best, graph.total)) best = std::move(trial);
  }
  return best;
}

}  // namespace

Separation geometric_separation(const WeightedGraph& graph, const std::vector<double>& positions) {
  const auto n = static_cast<size_t>(graph.size());
  std::vector<double> along(n);
  std::vector<int32_t> order(n), rank(n), best_order;
  bool found = false;
  double lowest = 0;
  size_t best_cut = 0;
  for (const auto& d : direction) {
    for (size_t v = 0; v < n; ++v) {
      along[v] = d[0] * positions[3 * v] + d[1] * positions[3 * v + 1] + d[2] * positions[3 * v + 2];
    }
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](int32_t a, int32_t b) { return along[a] < along[b]; });
    for (size_t i = 0; i < n; ++i) rank[order[i]] = static_cast<int32_t>(i);
    int64_t crossing = 0, passed = 0;
    for (size_t i = 0; i + 1 < n; ++i) {
      const int32_t v = order[i];
      passed += graph.weight[v];
      for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
        const bool ahead = rank[graph.neighbour[k]] > static_cast<int32_t>(i);
        crossing += ahead ? graph.edge_weight[k] : -graph.edge_weight[k];
      }
      if (5 * passed < 2 * graph.total || 5 * passed > 3 * graph.total) continue;
      const double score = static_cast<double>(crossing) /
                           (static_cast<double>(passed) * static_cast<double>(graph.total - passed));
      if (found && score >= lowest) continue;
      found = true;
      lowest = score;
      best_cut = i + 1;
      best_order = order;
    }
  }
  if (!found) return multilevel_separation(graph);  // one vertex outweighs the balance
  Separation result = border(graph, best_order, best_cut);
  refine(graph, result, 8);
  return result;
}

}  // namespace teamslam
