// Layout of the fronts: memory and the index maps of the numeric phase, all prepared once.
#include <algorithm>
#include <numeric>
#include <span>

#include "symbolic_steps.hpp"

namespace teamslam {
namespace {

constexpr int32_t none = -1;

// Rows of every front, as positions, front after front.
struct Rows {
  std::vector<int64_t> start{0};
  std::vector<int32_t> position;

  std::span<const int32_t> of(size_t front) const {
    return {position.data() + start[front], position.data() + start[front + 1]};
  }
};

// Pivots, parents and children of every front.
void lay_out_tree(Symbolic& s, const FrontTree& tree, const std::vector<int32_t>& visit,
                  const Elimination& elimination) {
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
    front.variables = static_cast<int32_t>(tree.pivots(t).size());
    front.columns = static_cast<int32_t>(tree.columns[t]);
    front.parent = tree.parent[t] == none ? none : place[tree.parent[t]];
    front.first_scalar = scalar;
    scalar += front.columns;
    for (int32_t j : tree.pivots(t)) s.order.push_back(elimination.order[j]);
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

// A front's rows are its own neighbours and what its children pass on.
Rows front_rows(const Symbolic& s, const Graph& graph) {
  Rows rows;
  std::vector<int32_t> seen(s.order.size(), none);
  for (int32_t f = 0; f < static_cast<int32_t>(s.front.size()); ++f) {
    const Front& front = s.front[f];
    const int32_t end = front.first_position + front.variables;
    const auto take = [&](int32_t p) {
      if (p < end || seen[p] == f) return;
      seen[p] = f;
      rows.position.push_back(p);
    };
    for (int32_t j = front.first_position; j < end; ++j) {
      const int32_t v = s.order[j];
      for (int64_t e = graph.start[v]; e < graph.start[v + 1]; ++e) take(s.position[graph.neighbour[e]]);
    }
    for (int64_t c = front.child_start; c < front.child_end; ++c) {
      const int32_t child = s.child[c];
      for (int64_t k = rows.start[child]; k < rows.start[child + 1]; ++k) take(rows.position[k]);
    }
    std::sort(rows.position.begin() + rows.start.back(), rows.position.end());
    rows.start.push_back(static_cast<int64_t>(rows.position.size()));
  }
  return rows;
}

// Sizes, panels, and each front's rows within its parent.
void lay_out_fronts(Symbolic& s, const Rows& rows, const std::vector<int64_t>& scalar_at) {
  for (size_t f = 0; f < s.front.size(); ++f) {
    Front& front = s.front[f];
    front.row_start = static_cast<int64_t>(s.row_scalar.size());
    for (int32_t p : rows.of(f)) {
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
    const auto above = rows.of(static_cast<size_t>(front.parent));
    size_t at = 0;
    int32_t from = 0;
    int32_t below = parent.columns;  // scalar of above[at] in the parent
    for (int32_t p : rows.of(f)) {
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
void lay_out_scatter(Symbolic& s, const BlockPattern& pattern, const Rows& rows,
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
    for (int32_t p : rows.of(f)) {
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

}  // namespace

Symbolic analyse(const BlockPattern& pattern, const Graph& graph, const Elimination& elimination, int32_t last_count) {
  const int32_t n = pattern.variables();
  const FrontTree tree = front_tree(graph, elimination, last_count);
  Symbolic s;
  s.dof = pattern.dof;
  s.scalar_start = pattern.scalar_start;
  s.scalars = pattern.scalars();
  lay_out_tree(s, tree, visiting_order(tree), elimination);
  std::vector<int64_t> scalar_at(static_cast<size_t>(n) + 1, 0);
  s.natural_scalar.reserve(static_cast<size_t>(s.scalars));
  for (int32_t p = 0; p < n; ++p) {
    const int32_t v = s.order[p];
    scalar_at[p + 1] = scalar_at[p] + pattern.dof[v];
    for (int32_t k = 0; k < pattern.dof[v]; ++k) s.natural_scalar.push_back(pattern.scalar_start[v] + k);
  }
  s.last_scalars = scalar_at[n] - scalar_at[n - last_count];
  const Rows rows = front_rows(s, graph);
  lay_out_fronts(s, rows, scalar_at);
  lay_out_scatter(s, pattern, rows, scalar_at);
  lay_out_tasks(s);
  return s;
}

}  // namespace teamslam
