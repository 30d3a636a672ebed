// Elimination tree, column counts and the layout of fronts: see symbolic.hpp.
#include "symbolic.hpp"

#include <algorithm>
#include <numeric>

namespace teamslam {
namespace {

constexpr int32_t none = -1;

std::vector<int32_t> inverse_of(const std::vector<int32_t>& order) {
  std::vector<int32_t> position(order.size());
  for (size_t i = 0; i < order.size(); ++i) position[order[i]] = static_cast<int32_t>(i);
  return position;
}

// Calls visit(k) for every earlier position k that shares an edge with position i; the last variables form a chain.
template <class Visit>
void earlier_neighbours(const Graph& graph, const std::vector<int32_t>& order, const std::vector<int32_t>& position,
                        int32_t first_last, int32_t i, Visit visit) {
  const int32_t v = order[i];
  for (int64_t e = graph.start[v]; e < graph.start[v + 1]; ++e) {
    const int32_t k = position[graph.neighbour[e]];
    if (k < i) visit(k);
  }
  if (i > first_last) visit(i - 1);
}

std::vector<int32_t> elimination_tree(const Graph& graph, const std::vector<int32_t>& order,
                                      const std::vector<int32_t>& position, int32_t first_last) {
  const auto n = static_cast<int32_t>(order.size());
  std::vector<int32_t> parent(n, none), ancestor(n, none);
  for (int32_t i = 0; i < n; ++i) {
    earlier_neighbours(graph, order, position, first_last, i, [&](int32_t k) {
      while (k != none && k < i) {  // compress paths while climbing to the root
        const int32_t next = ancestor[k];
        ancestor[k] = i;
        if (next == none) parent[k] = i;
        k = next;
      }
    });
  }
  return parent;
}

// Children before parents, every subtree consecutive, children of a node in rising order.
std::vector<int32_t> postorder(const std::vector<int32_t>& parent) {
  const auto n = static_cast<int32_t>(parent.size());
  std::vector<int32_t> head(n, none), next(n, none), result, stack;
  result.reserve(parent.size());
  for (int32_t v = n - 1; v >= 0; --v) {
    if (parent[v] == none) continue;
    next[v] = head[parent[v]];
    head[parent[v]] = v;
  }
  for (int32_t root = 0; root < n; ++root) {
    if (parent[root] != none) continue;
    stack.push_back(root);
    while (!stack.empty()) {
      const int32_t v = stack.back();
      if (head[v] != none) {
        stack.push_back(head[v]);
        head[v] = next[head[v]];
      } else {
        stack.pop_back();
        result.push_back(v);
      }
    }
  }
  return result;
}

// Row i of L has its pattern on a subtree of the elimination tree with root i. The weight of row i is added at the
// leaves of that subtree and taken away where two of its branches meet and above its root; sums over subtrees are then
// the column counts.
std::vector<int64_t> column_counts(const Graph& graph, const std::vector<int32_t>& order,
                                   const std::vector<int32_t>& position, const std::vector<int32_t>& parent,
                                   int32_t first_last) {
  const auto n = static_cast<int32_t>(order.size());
  std::vector<int64_t> count(n, 0);
  std::vector<int32_t> previous_neighbour(n, none), last_leaf(n, none), set(n);
  std::iota(set.begin(), set.end(), 0);
  std::vector<int32_t> subtree_first(n);
  for (int32_t i = 0; i < n; ++i) subtree_first[i] = i;
  for (int32_t i = 0; i < n; ++i) {
    if (parent[i] != none) subtree_first[parent[i]] = std::min(subtree_first[parent[i]], subtree_first[i]);
  }
  const auto find = [&](int32_t v) {
    int32_t root = v;
    while (set[root] != root) root = set[root];
    while (set[v] != root) {
      const int32_t up = set[v];
      set[v] = root;
      v = up;
    }
    return root;
  };
  // previous_neighbour[i] is the last column seen that reaches row i; j is a new leaf of row i's subtree when j's
  // subtree begins after it.
  for (int32_t j = 0; j < n; ++j) {
    const int32_t v = order[j];
    const auto reach = [&](int32_t i) {
      if (subtree_first[j] > previous_neighbour[i]) {
        const int64_t w = graph.weight[order[i]];
        count[j] += w;
        if (last_leaf[i] != none) count[find(last_leaf[i])] -= w;
        last_leaf[i] = j;
      }
      previous_neighbour[i] = j;
    };
    reach(j);
    for (int64_t e = graph.start[v]; e < graph.start[v + 1]; ++e) {
      const int32_t i = position[graph.neighbour[e]];
      if (i > j) reach(i);
    }
    if (j >= first_last && j + 1 < n) reach(j + 1);
    if (parent[j] != none) {
      count[parent[j]] -= graph.weight[v];
      set[j] = parent[j];
    }
  }
  for (int32_t j = 0; j < n; ++j) {
    if (parent[j] != none) count[parent[j]] += count[j];
  }
  return count;
}

}  // namespace

Elimination eliminate_symbolically(const Graph& graph, const std::vector<int32_t>& order, int32_t last_count) {
  const auto n = static_cast<int32_t>(order.size());
  const int32_t first_last = n - last_count;
  std::vector<int32_t> position = inverse_of(order);
  const std::vector<int32_t> tree = elimination_tree(graph, order, position, first_last);
  const std::vector<int32_t> visit = postorder(tree);
  const std::vector<int32_t> place = inverse_of(visit);
  Elimination result;
  result.order.resize(order.size());
  result.parent.resize(order.size());
  for (int32_t i = 0; i < n; ++i) {
    result.order[i] = order[visit[i]];
    const int32_t up = tree[visit[i]];
    result.parent[i] = up == none ? none : place[up];
  }
  position = inverse_of(result.order);
  result.count = column_counts(graph, result.order, position, result.parent, first_last);
  for (int32_t j = 0; j < n; ++j) {
    const int32_t w = graph.weight[result.order[j]];
    for (int32_t k = 0; k < w; ++k) {
      const auto c = static_cast<double>(result.count[j] - k);
      result.nonzeros += c;
      result.flops += c * c;
    }
  }
  return result;
}

size_t Symbolic::bytes() const {
  const auto size = [](const auto& v) { return v.capacity() * sizeof(v[0]); };
  return size(order) + size(position) + size(natural_scalar) + size(front) + size(child) + size(row_scalar) +
         size(scatter) + size(run) + size(task) + size(late) + size(top) + size(dof) + size(scalar_start);
}

}  // namespace teamslam
