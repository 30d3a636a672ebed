// Nested dissection of the block graph (George 1973): split by a small separator, number the separator last, go on with
// both sides.
//
// What is no longer worth splitting, a leaf, is ordered by minimum degree on a graph of its own: its vertices, and the
// separators' vertices that they touch, which stay. Leaves know nothing of each other, so the team orders them side by
// side, each within the cache. Separators follow, the deepest first. What eliminating a leaf or a half leaves on its
// border is close to one clique, so the order within a separator hardly matters and stays as it is.
#include <algorithm>
#include <atomic>
#include <cmath>

#include "dissection.hpp"
#include "ordering.hpp"
#include "threads.hpp"

namespace teamslam {
namespace {

constexpr int32_t deepest = 60;  // levels of dissection
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
        local_(graph.size(), 0) {}

  // Splits all, level by level, the parts of a level shared out among the team; parts do not depend on each other.
  void split(Vertices all) {
    std::vector<Vertices> parts;
    if (!all.empty()) parts.push_back(std::move(all));
    for (int32_t depth = 0; !parts.empty(); ++depth) {
      name(parts);
      std::vector<Halves> halves(parts.size());
      share(parts.size(), [&](size_t p) {
        if (parts[p].size() >= dissected_from && depth < deepest) halves[p] = halve(parts[p], static_cast<int32_t>(p));
      });
      std::vector<Vertices> next;
      for (size_t p = 0; p < parts.size(); ++p) {
        if (halves[p].separator.empty() && halves[p].first.empty()) {
          leaves_.push_back(std::move(parts[p]));
          continue;
        }
        separators_.push_back(std::move(halves[p].separator));
        for (Vertices* half : {&halves[p].first, &halves[p].second}) {
          if (!half->empty()) next.push_back(std::move(*half));
        }
      }
      parts = std::move(next);
    }
  }

  // Leaves, then separators from the deepest to the one that splits the whole graph.
  std::vector<int32_t> order() {
    name(leaves_);
    share(leaves_.size(), [&](size_t p) { order_leaf(leaves_[p], static_cast<int32_t>(p)); });
    std::vector<int32_t> result;
    result.reserve(group_.size());
    for (const Vertices& leaf : leaves_) result.insert(result.end(), leaf.begin(), leaf.end());
    for (size_t s = separators_.size(); s-- > 0;) {
      result.insert(result.end(), separators_[s].begin(), separators_[s].end());
    }
    return result;
  }

 private:
  struct Halves {
    Vertices first, second, separator;
  };

  // Marks the vertices of every part with its number and with their own within it.
  void name(const std::vector<Vertices>& parts) {
    std::fill(group_.begin(), group_.end(), unassigned);
    for (size_t p = 0; p < parts.size(); ++p) {
      for (size_t i = 0; i < parts[p].size(); ++i) {
        group_[parts[p][i]] = static_cast<int32_t>(p);
        local_[parts[p][i]] = static_cast<int32_t>(i);
      }
    }
  }

  template <class Work>
  void share(size_t parts, const Work& work) const {
    std::atomic<size_t> next{0};
    run_team(parts > 1 ? threads_ : 1, [&](Team&) {
      for (size_t p = next++; p < parts; p = next++) work(p);
    });
  }

  // Empty where no split is worth its separator.
  Halves halve(const Vertices& part, int32_t id) const {
    const WeightedGraph sub = subgraph(graph_, part, group_, id, local_);
    const Separation s = separation(sub, part);
    Halves halves;
    if (s.weight[separator] * 2 > sub.total) return halves;
    for (size_t i = 0; i < part.size(); ++i) {
      (s.side[i] == separator ? halves.separator : s.side[i] == left ? halves.first : halves.second).push_back(part[i]);
    }
    return halves;
  }

  Separation separation(const WeightedGraph& sub, const Vertices& part) const {
    if (positions_ == nullptr) return multilevel_separation(sub);
    std::vector<double> positions;
    positions.reserve(part.size() * 3);
    for (int32_t v : part) positions.insert(positions.end(), positions_ + 3 * v, positions_ + 3 * v + 3);
    return geometric_separation(sub, positions);
  }

  // Puts the vertices of a leaf in order of minimum degree.
  void order_leaf(Vertices& leaf, int32_t id) const {
    const Vertices border = border_of(leaf, id);
    std::vector<uint8_t> stage(leaf.size() + border.size(), 0);
    std::fill(stage.begin() + static_cast<std::ptrdiff_t>(leaf.size()), stage.end(), never_eliminated);
    Vertices ordered;
    ordered.reserve(leaf.size());
    for (int32_t i : minimum_degree(with_border(leaf, id, border), stage)) ordered.push_back(leaf[i]);
    leaf = std::move(ordered);
  }

  // What the leaf touches outside itself, in rising order.
  Vertices border_of(const Vertices& leaf, int32_t id) const {
    Vertices border;
    for (int32_t v : leaf) {
      for (int64_t k = graph_.start[v]; k < graph_.start[v + 1]; ++k) {
        if (group_[graph_.neighbour[k]] != id) border.push_back(graph_.neighbour[k]);
      }
    }
    std::sort(border.begin(), border.end());
    border.erase(std::unique(border.begin(), border.end()), border.end());
    return border;
  }

  // The graph of a leaf and its border, without the edges within the border.
  Graph with_border(const Vertices& leaf, int32_t id, const Vertices& border) const {
    Graph result;
    const auto inside = static_cast<int32_t>(leaf.size());
    std::vector<Vertices> touching(border.size());
    result.start.push_back(0);
    for (int32_t v : leaf) {
      result.weight.push_back(graph_.weight[v]);
      for (int64_t k = graph_.start[v]; k < graph_.start[v + 1]; ++k) {
        const int32_t u = graph_.neighbour[k];
        if (group_[u] == id) {
          result.neighbour.push_back(local_[u]);
          continue;
        }
        const auto b = static_cast<int32_t>(std::lower_bound(border.begin(), border.end(), u) - border.begin());
        result.neighbour.push_back(inside + b);
        touching[b].push_back(local_[v]);
      }
      result.start.push_back(static_cast<int64_t>(result.neighbour.size()));
    }
    for (size_t b = 0; b < border.size(); ++b) {
      result.weight.push_back(graph_.weight[border[b]]);
      result.neighbour.insert(result.neighbour.end(), touching[b].begin(), touching[b].end());
      result.start.push_back(static_cast<int64_t>(result.neighbour.size()));
    }
    return result;
  }

  const Graph& graph_;
  const double* positions_;
  int threads_;
  std::vector<int32_t> group_, local_;
  std::vector<Vertices> leaves_, separators_;  // separators from the root down
};

}  // namespace

std::vector<int32_t> nested_dissection(const Graph& graph, const std::vector<uint8_t>& frozen, const double* positions,
                                       int threads) {
  const int32_t n = graph.size();
  const int64_t dense = dense_degree(n);
  const auto degree = [&](int32_t v) { return graph.start[v + 1] - graph.start[v]; };
  Vertices free, hubs;
  for (int32_t v = 0; v < n; ++v) {
    if (frozen.empty() || !frozen[v]) (degree(v) > dense ? hubs : free).push_back(v);
  }
  Dissection dissection(graph, positions, threads);
  dissection.split(std::move(free));
  std::vector<int32_t> order = dissection.order();
  std::stable_sort(hubs.begin(), hubs.end(), [&](int32_t a, int32_t b) { return degree(a) < degree(b); });
  order.insert(order.end(), hubs.begin(), hubs.end());
  return order;
}

}  // namespace teamslam
