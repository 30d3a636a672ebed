// From elimination tree to fronts, by amalgamation.
//
// Columns with the same structure make a fundamental front. A child is joined to its parent when a simple model of the
// time says that the saved assembly outweighs the arithmetic on the zeros that it adds (relaxed amalgamation, after
// Ashcraft and Grimes 1989). In SLAM graphs most fundamental fronts are one pose or landmark, so this matters much.
#include <algorithm>
#include <numeric>

#include "symbolic_steps.hpp"

namespace teamslam {
namespace {

constexpr int32_t none = -1;

struct Node {
  int32_t parent = none;
  int32_t columns = 0;  // scalars
  int64_t total = 0;    // scalars
  bool joined = false;  // to its parent
};

struct Fundamental {
  std::vector<int32_t> first;  // first position of each fundamental front, and n
  std::vector<Node> node;
};

Fundamental fundamental_fronts(const Graph& graph, const Elimination& elimination, int32_t first_last) {
  const auto n = static_cast<int32_t>(elimination.order.size());
  Fundamental tree;
  std::vector<int32_t> owner(n);
  for (int32_t j = 0; j < n; ++j) {
    const int32_t w = graph.weight[elimination.order[j]];
    const bool joins = j > 0 && (j > first_last || (j != first_last && elimination.parent[j - 1] == j &&
                                                    elimination.count[j - 1] -
                                                            graph.weight[elimination.order[j - 1]] ==
                                                        elimination.count[j]));
    if (!joins) {
      tree.first.push_back(j);
      tree.node.push_back({none, 0, elimination.count[j], false});
    }
    tree.node.back().columns += w;
    owner[j] = static_cast<int32_t>(tree.node.size()) - 1;
  }
  tree.first.push_back(n);
  for (size_t s = 0; s < tree.node.size(); ++s) {
    const int32_t up = elimination.parent[tree.first[s + 1] - 1];
    if (up != none) tree.node[s].parent = owner[up];
  }
  if (first_last < n) tree.node.back().total = tree.node.back().columns;
  return tree;
}

// Joins children to parents, leaves first. Nothing is joined to the front of the `last` variables.
void amalgamate(Fundamental& tree, bool has_last) {
  const auto count = static_cast<int32_t>(tree.node.size());
  std::vector<int32_t> head(count, none), next(count, none);
  std::vector<int32_t> candidates;
  for (int32_t s = 0; s < count; ++s) {
    Node& parent = tree.node[s];
    candidates.clear();
    for (int32_t c = head[s]; c != none; c = next[c]) candidates.push_back(c);
    const auto rows = [&](int32_t c) { return tree.node[c].total - tree.node[c].columns; };
    std::sort(candidates.begin(), candidates.end(),
              [&](int32_t a, int32_t b) { return rows(a) != rows(b) ? rows(a) > rows(b) : a > b; });
    for (int32_t c : candidates) {
      if (has_last && s == count - 1) break;
      const Node& child = tree.node[c];
      const double apart = front_time(child.columns, static_cast<double>(child.total)) +
                           front_time(parent.columns, static_cast<double>(parent.total));
      const double together =
          front_time(child.columns + parent.columns, static_cast<double>(child.columns + parent.total));
      if (together > apart) continue;
      parent.columns += child.columns;
      parent.total += child.columns;
      tree.node[c].joined = true;
    }
    if (parent.parent != none) {
      next[s] = head[parent.parent];
      head[parent.parent] = s;
    }
  }
}

// The joined fronts, still in a valid bottom-up order.
FrontTree join(const Fundamental& tree) {
  const auto count = static_cast<int32_t>(tree.node.size());
  std::vector<int32_t> target(count), index(count, none);
  for (int32_t s = count - 1; s >= 0; --s) target[s] = tree.node[s].joined ? target[tree.node[s].parent] : s;
  FrontTree result;
  for (int32_t s = 0; s < count; ++s) {
    if (target[s] != s) continue;
    index[s] = static_cast<int32_t>(result.parent.size());
    result.parent.push_back(none);
    result.columns.push_back(tree.node[s].columns);
    result.total.push_back(tree.node[s].total);
  }
  result.pivot_start.assign(result.parent.size() + 1, 0);
  for (int32_t s = 0; s < count; ++s) result.pivot_start[index[target[s]] + 1] += tree.first[s + 1] - tree.first[s];
  std::partial_sum(result.pivot_start.begin(), result.pivot_start.end(), result.pivot_start.begin());
  result.pivot.resize(static_cast<size_t>(result.pivot_start.back()));
  std::vector<int32_t> next(result.pivot_start.begin(), result.pivot_start.end() - 1);
  for (int32_t s = 0; s < count; ++s) {
    int32_t& to = next[index[target[s]]];
    for (int32_t j = tree.first[s]; j < tree.first[s + 1]; ++j) result.pivot[to++] = j;
    if (target[s] == s && tree.node[s].parent != none) result.parent[index[s]] = index[target[tree.node[s].parent]];
  }
  return result;
}

}  // namespace

double front_time(double columns, double total) {
  const double rows = total - columns;
  double flops = 0;
  flops += columns * columns * columns / 3 + columns * columns * rows + columns * rows * rows;
  return 200 + 0.4 * total * columns + 0.8 * rows * rows + flops * 0.08;
}

FrontTree front_tree(const Graph& graph, const Elimination& elimination, int32_t last_count) {
  const auto n = static_cast<int32_t>(elimination.order.size());
  Fundamental fundamental = fundamental_fronts(graph, elimination, n - last_count);
  amalgamate(fundamental, last_count > 0);
  return join(fundamental);
}

std::vector<int32_t> visiting_order(const FrontTree& tree) {
  const auto count = static_cast<int32_t>(tree.parent.size());
  std::vector<std::vector<int32_t>> children(count);
  std::vector<int32_t> roots;
  std::vector<int64_t> peak(count, 0), update(count);
  for (int32_t s = 0; s < count; ++s) {
    const int64_t rows = tree.total[s] - tree.columns[s];
    update[s] = rows * rows;
    auto& list = children[s];
    const auto excess = [&](int32_t c) { return peak[c] - update[c]; };
    std::sort(list.begin(), list.end(),
              [&](int32_t a, int32_t b) { return excess(a) != excess(b) ? excess(a) > excess(b) : a < b; });
    int64_t held = 0;
    for (int32_t c : list) {
      peak[s] = std::max(peak[s], held + peak[c]);
      held += update[c];
    }
    peak[s] = std::max(peak[s], held + update[s]);
    if (tree.parent[s] == none) {
      roots.push_back(s);
    } else {
      children[tree.parent[s]].push_back(s);
    }
  }
  std::vector<int32_t> result, stack, seen(count, 0);
  for (int32_t root : roots) {
    stack.push_back(root);
    while (!stack.empty()) {
      const int32_t s = stack.back();
      if (seen[s] < static_cast<int32_t>(children[s].size())) {
        stack.push_back(children[s][seen[s]++]);
      } else {
        stack.pop_back();
        result.push_back(s);
      }
    }
  }
  return result;
}

}  // namespace teamslam
