// Multilevel vertex separators (Karypis and Kumar 1998; Hendrickson and Leland 1995): see dissection.hpp.
//
// A graph is coarsened by contracting heavy edges until it is small. There several regions are grown to half the weight
// and the best border is kept. On the way back the separator is refined at every level, where a move of one coarse
// vertex does what many moves of single vertices would have to do.
#include <algorithm>
#include <numeric>

#include "dissection.hpp"

namespace teamslam {
namespace {

constexpr int32_t none = -1;
constexpr int32_t coarse_enough = 50;

// 0 .. n - 1 in an order that has nothing to do with the numbering, the same at every call. Runs of consecutive poses
// would otherwise be paired in step, and the coarse graph would inherit their regularity.
std::vector<int32_t> shuffled(int32_t n) {
  std::vector<int32_t> result(n);
  std::iota(result.begin(), result.end(), 0);
  uint64_t state = 88172645463325252ull;  // xorshift (Marsaglia 2003)
  for (int32_t i = n - 1; i > 0; --i) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    std::swap(result[i], result[static_cast<size_t>(state % static_cast<uint64_t>(i + 1))]);
  }
  return result;
}

// Pairs every vertex with the unmatched neighbour of heaviest edge (lightest vertex among equals), in shuffled order;
// left-over vertices that hang on one neighbour are paired with each other. Returns coarse indices.
std::vector<int32_t> contract(const WeightedGraph& graph, int32_t& coarse_size) {
  const int32_t n = graph.size();
  const int64_t heaviest = std::max<int64_t>(1, graph.total * 3 / (2 * coarse_enough));
  std::vector<int32_t> coarse(n, none);
  coarse_size = 0;
  for (int32_t v : shuffled(n)) {
    if (coarse[v] != none) continue;
    int32_t mate = none, weight = 0;
    for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
      const int32_t u = graph.neighbour[k];
      if (coarse[u] != none || graph.weight[u] + graph.weight[v] > heaviest) continue;
      const int32_t w = graph.edge_weight[k];
      if (w > weight || (w == weight && graph.weight[u] < graph.weight[mate])) {
        mate = u;
        weight = w;
      }
    }
    if (mate == none) continue;
    coarse[v] = coarse[mate] = coarse_size++;
  }
  // Two unmatched vertices with a common neighbour: otherwise stars would not shrink.
  for (int32_t hub = 0; hub < n; ++hub) {
    int32_t waiting = none;
    for (int32_t k = graph.start[hub]; k < graph.start[hub + 1]; ++k) {
      const int32_t u = graph.neighbour[k];
      if (coarse[u] != none || 2 * graph.weight[u] > heaviest) continue;
      if (waiting == none) {
        waiting = u;
      } else {
        coarse[waiting] = coarse[u] = coarse_size++;
        waiting = none;
      }
    }
  }
  for (int32_t v = 0; v < n; ++v) {
    if (coarse[v] == none) coarse[v] = coarse_size++;
  }
  return coarse;
}

WeightedGraph contracted(const WeightedGraph& graph, const std::vector<int32_t>& coarse, int32_t coarse_size) {
  WeightedGraph result;
  result.weight.assign(coarse_size, 0);
  result.total = graph.total;
  std::vector<int32_t> member(static_cast<size_t>(coarse_size) * 2, none), slot(coarse_size, none);
  for (int32_t v = 0; v < graph.size(); ++v) {
    result.weight[coarse[v]] += graph.weight[v];
    member[2 * coarse[v] + (member[2 * coarse[v]] == none ? 0 : 1)] = v;
  }
  result.start.reserve(static_cast<size_t>(coarse_size) + 1);
  result.start.push_back(0);
  result.neighbour.reserve(graph.neighbour.size());
  result.edge_weight.reserve(graph.neighbour.size());
  for (int32_t c = 0; c < coarse_size; ++c) {
    const auto begin = static_cast<int32_t>(result.neighbour.size());
    for (int m = 0; m < 2; ++m) {
      const int32_t v = member[2 * c + m];
      if (v == none) continue;
      for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
        const int32_t d = coarse[graph.neighbour[k]];
        if (d == c) continue;
        if (slot[d] < begin) {
          slot[d] = static_cast<int32_t>(result.neighbour.size());
          result.neighbour.push_back(d);
          result.edge_weight.push_back(graph.edge_weight[k]);
        } else {
          result.edge_weight[slot[d]] += graph.edge_weight[k];
        }
      }
    }
    result.start.push_back(static_cast<int32_t>(result.neighbour.size()));
  }
  return result;
}

// Grows `left` from a seed, breadth first, to half the weight; the rest of the frontier becomes the separator.
Separation grown(const WeightedGraph& graph, int32_t seed) {
  const int32_t n = graph.size();
  Separation result;
  result.side.assign(n, right);
  std::vector<int32_t> queue{seed};
  std::vector<uint8_t> queued(n, 0);
  queued[seed] = 1;
  int32_t unseen = 0;
  int64_t grown = 0;
  for (size_t head = 0; 2 * grown < graph.total; ++head) {
    if (head == queue.size()) {  // another component
      while (queued[unseen]) ++unseen;
      queued[unseen] = 1;
      queue.push_back(unseen);
    }
    const int32_t v = queue[head];
    result.side[v] = left;
    grown += graph.weight[v];
    for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
      const int32_t u = graph.neighbour[k];
      if (queued[u]) continue;
      queued[u] = 1;
      queue.push_back(u);
    }
  }
  for (int32_t v = 0; v < n; ++v) {
    if (result.side[v] != right) continue;
    for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
      if (result.side[graph.neighbour[k]] == left) {
        result.side[v] = separator;
        break;
      }
    }
  }
  for (int32_t v = 0; v < n; ++v) result.weight[result.side[v]] += graph.weight[v];
  return result;
}

Separation separate_coarsest(const WeightedGraph& graph) {
  constexpr int32_t tries = 4;
  Separation best;
  for (int32_t k = 0; k < tries; ++k) {
    const auto seed = static_cast<int32_t>((static_cast<int64_t>(graph.size()) * k) / tries);
    Separation trial = grown(graph, seed);
    refine(graph, trial, 6);
    if (k == 0 || better(trial, best, graph.total)) best = std::move(trial);
  }
  return best;
}

}  // namespace

Separation multilevel_separation(const WeightedGraph& graph) {
  if (graph.size() <= coarse_enough) return separate_coarsest(graph);
  int32_t coarse_size = 0;
  const std::vector<int32_t> coarse = contract(graph, coarse_size);
  if (coarse_size > graph.size() * 19 / 20) return separate_coarsest(graph);
  const Separation above = multilevel_separation(contracted(graph, coarse, coarse_size));
  Separation result;
  result.side.resize(static_cast<size_t>(graph.size()));
  for (int32_t v = 0; v < graph.size(); ++v) result.side[v] = above.side[coarse[v]];
  std::copy(above.weight, above.weight + 3, result.weight);
  refine(graph, result, 4);
  return result;
}

}  // namespace teamslam
