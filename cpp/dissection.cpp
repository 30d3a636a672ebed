// Nested dissection of the block graph (George 1973): split by a small separator, number the separator last, go on with
// both sides.
//
// The dissection only says at which stage each vertex is eliminated: leaves first, then separators from the smallest to
// the one that splits the whole graph. The order within a stage is left to minimum degree, which then knows the borders
// of leaves and separators and so orders them better than it could alone.
#include <algorithm>
#include <atomic>
#include <cmath>

#include "dissection.hpp"
#include "ordering.hpp"
#include "threads.hpp"

namespace teamslam {
namespace {

constexpr size_t leaf_size = 600;    // vertices; below, minimum degree does as well
constexpr int32_t deepest = 60;      // levels of dissection
constexpr int32_t unassigned = -1;

using Vertices = std::vector<int32_t>;

// The subgraph of `vertices`; local[v] is the index of v in them.
WeightedGraph subgraph(const Graph& graph, const Vertices& vertices, const std::vector<int32_t>& group, int32_t id,
                       const std::vector<int32_t>& local) {
  WeightedGraph result;
  result.start.reserve(vertices.size() + 1);
  result.weight.reserve(vertices.size());
  result.start.push_back(0);
  for (int32_t v : vertices) {
    result.weight.push_back(graph.weight[v]);
    result.total += graph.weight[v];
    for (int64_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
      const int32_t u = graph.neighbour[k];
      if (group[u] == id) result.neighbour.push_back(local[u]);
    }
    result.start.push_back(static_cast<int32_t>(result.neighbour.size()));
  }
  result.edge_weight.assign(result.neighbour.size(), 1);
  return result;
}

class Dissection {
 public:
  Dissection(const Graph& graph, const double* positions, int threads)
      : graph_(graph), positions_(positions), threads_(threads), group_(graph.size(), unassigned),
        local_(graph.size(), 0), depth_(graph.size(), unassigned) {}

  // Level by level, the parts of a level shared out among the team; parts do not depend on each other.
  void split(Vertices all) {
    std::vector<Vertices> parts{std::move(all)};
    for (int32_t depth = 0; depth < deepest; ++depth) {
      std::erase_if(parts, [](const Vertices& part) { return part.size() <= leaf_size; });
      if (parts.empty()) return;
      std::fill(group_.begin(), group_.end(), unassigned);
      for (size_t p = 0; p < parts.size(); ++p) {
        for (size_t i = 0; i < parts[p].size(); ++i) {
          group_[parts[p][i]] = static_cast<int32_t>(p);
          local_[parts[p][i]] = static_cast<int32_t>(i);
        }
      }
      std::vector<Vertices> halves(parts.size() * 2);
      std::atomic<size_t> next{0};
      run_team(parts.size() > 1 ? threads_ : 1, [&](Team&) {
        for (size_t p = next++; p < parts.size(); p = next++) {
          halve(parts[p], static_cast<int32_t>(p), depth, halves[2 * p], halves[2 * p + 1]);
        }
      });
      parts = std::move(halves);
    }
  }

  // 0 for leaves, then rising to the first separator.
  std::vector<uint8_t> stages() const {
    const int32_t most = *std::max_element(depth_.begin(), depth_.end());
    std::vector<uint8_t> stage(depth_.size(), 0);
    for (size_t v = 0; v < depth_.size(); ++v) {
      if (depth_[v] != unassigned) stage[v] = static_cast<uint8_t>(most - depth_[v] + 1);
    }
    return stage;
  }

 private:
  void halve(const Vertices& part, int32_t id, int32_t depth, Vertices& first, Vertices& second) {
    const WeightedGraph sub = subgraph(graph_, part, group_, id, local_);
    const Separation s = separation(sub, part);
    if (s.weight[separator] * 2 > sub.total) return;  // no useful split: leave it to minimum degree
    for (size_t i = 0; i < part.size(); ++i) {
      if (s.side[i] == separator) {
        depth_[part[i]] = depth;
      } else {
        (s.side[i] == left ? first : second).push_back(part[i]);
      }
    }
  }

  Separation separation(const WeightedGraph& sub, const Vertices& part) const {
    if (positions_ == nullptr) return multilevel_separation(sub);
    std::vector<double> positions;
    positions.reserve(part.size() * 3);
    for (int32_t v : part) positions.insert(positions.end(), positions_ + 3 * v, positions_ + 3 * v + 3);
    return geometric_separation(sub, positions);
  }

  const Graph& graph_;
  const double* positions_;
  int threads_;
  std::vector<int32_t> group_, local_, depth_;
};

}  // namespace

std::vector<int32_t> nested_dissection(const Graph& graph, const std::vector<uint8_t>& frozen, const double* positions,
                                       int threads) {
  const int32_t n = graph.size();
  const int64_t dense = dense_degree(n);
  Vertices free;
  for (int32_t v = 0; v < n; ++v) {
    const bool hub = graph.start[v + 1] - graph.start[v] > dense;
    if (!hub && (frozen.empty() || !frozen[v])) free.push_back(v);
  }
  if (free.empty()) return minimum_degree(graph, frozen);
  Dissection dissection(graph, positions, threads);
  dissection.split(std::move(free));
  std::vector<uint8_t> stage = dissection.stages();
  for (int32_t v = 0; v < n && !frozen.empty(); ++v) {
    if (frozen[v]) stage[v] = never_eliminated;
  }
  return minimum_degree(graph, stage);
}

}  // namespace teamslam
