// From elimination tree to fronts: amalgamation, layout and the index maps of the numeric phase.
//
// Columns with the same structure make a fundamental front. A child is joined to its parent when a simple model of the
// time says that the saved assembly outweighs the arithmetic on the zeros that it adds (relaxed amalgamation, after
// Ashcraft and Grimes 1989). In SLAM graphs most fundamental fronts are one pose or landmark, so this matters much.
#include <algorithm>
#include <numeric>

#include "symbolic.hpp"

namespace teamslam {
namespace {

constexpr int32_t none = -1;

// Nanoseconds to assemble and factor a front of `columns` pivots and `total` scalars, as measured: a fixed cost, the
// memory touched, and arithmetic at a rate that small fronts do not reach.
double front_time(double columns, double total) {
  const double rows = total - columns;
  double flops = 0;
  flops += columns * columns * columns / 3 + columns * columns * rows + columns * rows * rows;
  return 200 + 0.4 * total * columns + 0.8 * rows * rows + flops * 0.08;
}

struct Node {
  int32_t parent = none;
  int32_t columns = 0;  // scalars
  int64_t total = 0;    // scalars
  bool joined = false;  // to its parent
};

struct FrontTree {
  std::vector<int32_t> first;  // first position of each fundamental front, and n
  std::vector<Node> node;
};

FrontTree fundamental_fronts(const Graph& graph, const Elimination& elimination, int32_t first_last) {
  const auto n = static_cast<int32_t>(elimination.order.size());
  FrontTree tree;
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

using Lists = std::vector<std::vector<int32_t>>;

// Joins children to parents, leaves first. Nothing is joined to the front of the `last` variables.
void amalgamate(FrontTree& tree, bool has_last) {
  const auto count = static_cast<int32_t>(tree.node.size());
  std::vector<int32_t> head(count, none), next(count, none);
  std::vector<int32_t> candidates;
  for (int32_t s = 0; s < count; ++s) {
    Node& parent = tree.node[s];
    candidates.clear();
    for (int32_t c = head[s]; c != none; c = next[c]) candidates.push_back(c);
    std::stable_sort(candidates.begin(), candidates.end(), [&](int32_t a, int32_t b) {
      return tree.node[a].total - tree.node[a].columns > tree.node[b].total - tree.node[b].columns;
    });
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

// The joined fronts as a tree of their own: pivot positions of each, and parents; still in a valid bottom-up order.
struct Joined {
  Lists pivots;
  std::vector<int32_t> parent;
  std::vector<int64_t> columns, total;
};

Joined join(const FrontTree& tree) {
  const auto count = static_cast<int32_t>(tree.node.size());
  std::vector<int32_t> target(count), index(count, none);
  for (int32_t s = count - 1; s >= 0; --s) target[s] = tree.node[s].joined ? target[tree.node[s].parent] : s;
  Joined result;
  for (int32_t s = 0; s < count; ++s) {
    if (target[s] != s) continue;
    index[s] = static_cast<int32_t>(result.parent.size());
    result.parent.push_back(none);
    result.columns.push_back(tree.node[s].columns);
    result.total.push_back(tree.node[s].total);
  }
  result.pivots.resize(result.parent.size());
  for (int32_t s = 0; s < count; ++s) {
    auto& list = result.pivots[index[target[s]]];
    for (int32_t j = tree.first[s]; j < tree.first[s + 1]; ++j) list.push_back(j);
    if (target[s] == s && tree.node[s].parent != none) result.parent[index[s]] = index[target[tree.node[s].parent]];
  }
  return result;
}

// Postorder in which the children that need most memory come first (Liu 1986).
std::vector<int32_t> visiting_order(const Joined& tree) {
  const auto count = static_cast<int32_t>(tree.parent.size());
  Lists children(count);
  std::vector<int32_t> roots;
  std::vector<int64_t> peak(count, 0), update(count);
  for (int32_t s = 0; s < count; ++s) {
    const int64_t rows = tree.total[s] - tree.columns[s];
    update[s] = rows * rows;
    auto& list = children[s];
    std::stable_sort(list.begin(), list.end(),
                     [&](int32_t a, int32_t b) { return peak[a] - update[a] > peak[b] - update[b]; });
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

// Pivots, parents and children of every front.
void lay_out_tree(Symbolic& s, const Joined& tree, const std::vector<int32_t>& visit, const Elimination& elimination) {
  const auto count = static_cast<int32_t>(visit.size());
  std::vector<int32_t> place(count);
  for (int32_t f = 0; f < count; ++f) place[visit[f]] = f;
  s.front.resize(visit.size());
  s.order.reserve(elimination.order.size());
  int64_t scalar = 0;
  for (int32_t f = 0; f < count; ++f) {
    const int32_t t = visit[f];
    Front& front = s.front[f];
    front = Front{};
    front.first_position = static_cast<int32_t>(s.order.size());
    front.variables = static_cast<int32_t>(tree.pivots[t].size());
    front.columns = static_cast<int32_t>(tree.columns[t]);
    front.parent = tree.parent[t] == none ? none : place[tree.parent[t]];
    front.first_scalar = scalar;
    scalar += front.columns;
    for (int32_t j : tree.pivots[t]) s.order.push_back(elimination.order[j]);
  }
  s.position.resize(s.order.size());
  for (size_t i = 0; i < s.order.size(); ++i) s.position[s.order[i]] = static_cast<int32_t>(i);
  std::vector<int64_t> start(visit.size() + 1, 0);
  for (const Front& front : s.front) {
    if (front.parent != none) ++start[front.parent + 1];
  }
  std::partial_sum(start.begin(), start.end(), start.begin());
  s.child.resize(static_cast<size_t>(start.back()));
  for (int32_t f = count - 1; f >= 0; --f) {
    Front& front = s.front[f];
    front.child_start = start[f];
    front.child_end = start[f + 1];
    front.depth = front.parent == none ? 0 : s.front[front.parent].depth + 1;
  }
  std::vector<int64_t> next(start.begin(), start.end() - 1);
  for (int32_t f = 0; f < count; ++f) {
    if (s.front[f].parent != none) s.child[next[s.front[f].parent]++] = f;
  }
}

// Rows of every front, as positions: its own neighbours' and what its children pass on.
Lists front_rows(const Symbolic& s, const Graph& graph) {
  Lists rows(s.front.size());
  std::vector<int32_t> seen(s.order.size(), none);
  for (int32_t f = 0; f < static_cast<int32_t>(s.front.size()); ++f) {
    const Front& front = s.front[f];
    const int32_t end = front.first_position + front.variables;
    auto& list = rows[f];
    const auto take = [&](int32_t p) {
      if (p < end || seen[p] == f) return;
      seen[p] = f;
      list.push_back(p);
    };
    for (int32_t j = front.first_position; j < end; ++j) {
      const int32_t v = s.order[j];
      for (int64_t e = graph.start[v]; e < graph.start[v + 1]; ++e) take(s.position[graph.neighbour[e]]);
    }
    for (int64_t c = front.child_start; c < front.child_end; ++c) {
      for (int32_t p : rows[s.child[c]]) take(p);
    }
    std::sort(list.begin(), list.end());
  }
  return rows;
}

// Sizes, panels, and each front's rows within its parent.
void lay_out_fronts(Symbolic& s, const Lists& rows, const std::vector<int64_t>& scalar_at) {
  for (size_t f = 0; f < s.front.size(); ++f) {
    Front& front = s.front[f];
    front.row_start = static_cast<int64_t>(s.row_scalar.size());
    for (int32_t p : rows[f]) {
      for (int64_t i = scalar_at[p]; i < scalar_at[p + 1]; ++i) s.row_scalar.push_back(static_cast<int32_t>(i));
    }
    front.rows = static_cast<int32_t>(static_cast<int64_t>(s.row_scalar.size()) - front.row_start);
    front.panel = s.panel_total;
    s.panel_total += front.panel_size();
    s.largest_front = std::max(s.largest_front, front.columns + front.rows);
    const double k = front.columns, m = front.rows;
    s.nonzeros += k * (k + 1) / 2 + k * m;
    s.flops += k * k * k / 3 + k * k * m + k * m * m;
  }
  for (size_t f = 0; f < s.front.size(); ++f) {
    Front& front = s.front[f];
    front.run_start = front.run_end = static_cast<int64_t>(s.run.size());
    if (front.parent == none) continue;
    const Front& parent = s.front[front.parent];
    const int32_t end = parent.first_position + parent.variables;
    const auto& above = rows[front.parent];
    size_t at = 0;
    int32_t from = 0;
    int32_t below = parent.columns;  // scalar of above[at] in the parent
    for (int32_t p : rows[f]) {
      int32_t to = 0;
      if (p < end) {
        to = static_cast<int32_t>(scalar_at[p] - parent.first_scalar);
      } else {
        for (; above[at] != p; ++at) below += static_cast<int32_t>(scalar_at[above[at] + 1] - scalar_at[above[at]]);
        to = below;
      }
      const auto length = static_cast<int32_t>(scalar_at[p + 1] - scalar_at[p]);
      const bool extends = static_cast<int64_t>(s.run.size()) > front.run_start &&
                           s.run.back().to + s.run.back().length == to && to != parent.columns;
      if (extends) {
        s.run.back().length += length;
      } else {
        s.run.push_back({from, to, length});
      }
      from += length;
    }
    front.run_end = static_cast<int64_t>(s.run.size());
  }
}

// Where every pattern block goes.
void lay_out_scatter(Symbolic& s, const BlockPattern& pattern, const Lists& rows,
                     const std::vector<int64_t>& scalar_at) {
  std::vector<int32_t> owner(s.order.size());
  for (size_t f = 0; f < s.front.size(); ++f) {
    std::fill_n(owner.begin() + s.front[f].first_position, s.front[f].variables, static_cast<int32_t>(f));
  }
  const int32_t n = pattern.variables();
  std::vector<int64_t> next(s.front.size() + 1, 0);
  const auto front_of = [&](int32_t r, int32_t c) { return owner[std::min(s.position[r], s.position[c])]; };
  for (int32_t c = 0; c < n; ++c) {
    for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k) {
      ++next[front_of(pattern.row[k], c) + 1];
    }
  }
  std::partial_sum(next.begin(), next.end(), next.begin());
  for (size_t f = 0; f < s.front.size(); ++f) {
    s.front[f].scatter_start = next[f];
    s.front[f].scatter_end = next[f + 1];
  }
  struct Block {
    int32_t row, column;
    int64_t id;
  };
  std::vector<Block> block(static_cast<size_t>(pattern.blocks()));
  for (int32_t c = 0; c < n; ++c) {
    for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k) {
      block[next[front_of(pattern.row[k], c)]++] = {pattern.row[k], c, k};
    }
  }
  s.scatter.resize(block.size());
  std::vector<int32_t> row_at(s.order.size(), 0);
  for (size_t f = 0; f < s.front.size(); ++f) {
    const Front& front = s.front[f];
    const int32_t end = front.first_position + front.variables;
    int32_t at = 0;
    for (int32_t p : rows[f]) {
      row_at[p] = at;
      at += static_cast<int32_t>(scalar_at[p + 1] - scalar_at[p]);
    }
    for (int64_t e = front.scatter_start; e < front.scatter_end; ++e) {
      const Block& b = block[e];
      const bool transposed = s.position[b.row] < s.position[b.column];
      const int32_t column = transposed ? s.position[b.row] : s.position[b.column];
      const int32_t row = transposed ? s.position[b.column] : s.position[b.row];
      const int64_t local_column = scalar_at[column] - front.first_scalar;
      const bool pivot = row < end;
      const int64_t leading = pivot ? front.leading_pivot() : front.leading_rows();
      const int64_t local_row = pivot ? scalar_at[row] - front.first_scalar : row_at[row];
      const int64_t target = (pivot ? 0 : front.below()) + local_row + local_column * leading;
      s.scatter[e] = {pattern.value_start[b.id], static_cast<int32_t>(target),
                      static_cast<int32_t>(transposed ? -leading : leading), pattern.dof[b.row], pattern.dof[b.column]};
    }
  }
}

// Cuts the tree into subtrees small enough to share out; the same cut for any number of threads.
void cut_tasks(Symbolic& s) {
  const auto count = static_cast<int32_t>(s.front.size());
  std::vector<double> work(count, 0);
  std::vector<int32_t> first(count);
  double total = 0;
  for (int32_t f = 0; f < count; ++f) first[f] = f;
  for (int32_t f = 0; f < count; ++f) {
    const Front& front = s.front[f];
    const double own = front_time(front.columns, front.columns + front.rows);
    work[f] += own;
    total += own;
    if (front.parent != none) {
      work[front.parent] += work[f];
      first[front.parent] = std::min(first[front.parent], first[f]);
    }
  }
  const double worth_sharing = 1e6;  // ns: below this a second thread costs more than it gives
  const double grain = std::max(total / 24, 5e4);
  if (total < worth_sharing) {
    if (count > 0) s.task.push_back({0, count, total});
    return;
  }
  // Where a long chain of fronts carries many small branches, the results of all branches together would take more
  // memory than the factor. Such branches wait until their parent's turn.
  const double crumb = grain / 8;
  std::vector<std::vector<Task>> late(s.front.size());
  for (int32_t f = 0; f < count; ++f) {
    const int32_t parent = s.front[f].parent;
    const Task task{first[f], f + 1, work[f]};
    if (work[f] > grain) {
      const auto start = static_cast<int32_t>(s.late.size());
      s.late.insert(s.late.end(), late[f].begin(), late[f].end());
      s.top.push_back({f, start, static_cast<int32_t>(s.late.size())});
    } else if (parent == none || (work[parent] > grain && work[f] > crumb)) {
      s.task.push_back(task);
    } else if (work[parent] > grain) {
      late[parent].push_back(task);
    }
  }
}

// Update matrices on their stacks, by playing the numeric phase through.
void lay_out_stacks(Symbolic& s) {
  int64_t height[5] = {0, 0, 0, 0, 0};
  const auto place = [&](int32_t f, int32_t stack) {
    Front& front = s.front[f];
    for (int64_t c = front.child_start; c < front.child_end; ++c) {
      const Front& child = s.front[s.child[c]];
      if (child.stack != 2) height[child.stack] -= child.update_size();
    }
    front.stack = stack;
    front.update = height[stack];
    height[stack] += front.update_size();
    s.stack_size[stack] = std::max(s.stack_size[stack], height[stack]);
  };
  const auto place_task = [&](const Task& task, int32_t result) {
    for (int32_t f = task.first; f < task.end; ++f) place(f, f == task.end - 1 ? result : s.front[f].depth & 1);
  };
  for (const Task& task : s.task) place_task(task, 2);
  for (const Step& step : s.top) {
    const int32_t stack = 3 + (s.front[step.front].depth & 1);
    for (int32_t k = step.late_start; k < step.late_end; ++k) place_task(s.late[k], 7 - stack);
    place(step.front, stack);
  }
}

}  // namespace

Symbolic analyse(const BlockPattern& pattern, const Graph& graph, const Elimination& elimination, int32_t last_count) {
  const int32_t n = pattern.variables();
  FrontTree fundamental = fundamental_fronts(graph, elimination, n - last_count);
  amalgamate(fundamental, last_count > 0);
  const Joined joined = join(fundamental);
  Symbolic s;
  s.dof = pattern.dof;
  s.scalar_start = pattern.scalar_start;
  s.scalars = pattern.scalars();
  lay_out_tree(s, joined, visiting_order(joined), elimination);
  std::vector<int64_t> scalar_at(static_cast<size_t>(n) + 1, 0);
  s.natural_scalar.reserve(static_cast<size_t>(s.scalars));
  for (int32_t p = 0; p < n; ++p) {
    const int32_t v = s.order[p];
    scalar_at[p + 1] = scalar_at[p] + pattern.dof[v];
    for (int32_t k = 0; k < pattern.dof[v]; ++k) s.natural_scalar.push_back(pattern.scalar_start[v] + k);
  }
  s.last_scalars = scalar_at[n] - scalar_at[n - last_count];
  const Lists rows = front_rows(s, graph);
  lay_out_fronts(s, rows, scalar_at);
  lay_out_scatter(s, pattern, rows, scalar_at);
  cut_tasks(s);
  lay_out_stacks(s);
  return s;
}

}  // namespace teamslam
