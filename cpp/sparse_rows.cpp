#include "sparse_rows.hpp"

#include <algorithm>

#include "checks.hpp"

namespace teamslam {

BlockPattern blocks_of(const SparseRows& rows, const std::vector<int32_t>& dof, std::vector<double>& values) {
  BlockPattern pattern;
  pattern.dof = dof;
  const int32_t n = pattern.variables();
  std::vector<int32_t> owner;  // of each scalar
  pattern.scalar_start.push_back(0);
  for (int32_t v = 0; v < n; ++v) {
    owner.insert(owner.end(), dof[v], v);
    pattern.scalar_start.push_back(pattern.scalar_start.back() + dof[v]);
  }
  const int64_t scalars = pattern.scalars();
  if (rows.start[0] != 0) refuse("sparse matrix: its first row does not start at 0");
  for (int64_t i = 0; i < scalars; ++i)
    if (rows.start[i + 1] < rows.start[i]) refuse("sparse matrix: row ", i, " ends before it starts");
  for (int64_t i = 0; i < scalars; ++i)
    for (int64_t e = rows.start[i]; e < rows.start[i + 1]; ++e)
      if (rows.column[e] < 0 || rows.column[e] >= scalars)
        refuse("sparse matrix: row ", i, " has column ", rows.column[e], ", but there are ", scalars);

  // Calls visit(row, column) for every block of the lower triangle once, row by row.
  const auto for_each_block = [&](const auto& visit) {
    std::vector<int32_t> seen(n, -1);
    for (int32_t r = 0; r < n; ++r) {
      seen[r] = r;
      visit(r, r);
      for (int64_t e = rows.start[pattern.scalar_start[r]]; e < rows.start[pattern.scalar_start[r + 1]]; ++e) {
        const int32_t c = owner[rows.column[e]];
        if (c >= r || seen[c] == r) continue;
        seen[c] = r;
        visit(r, c);
      }
    }
  };
  pattern.column_start.assign(n + 1, 0);
  for_each_block([&](int32_t, int32_t c) { ++pattern.column_start[c + 1]; });
  for (int32_t c = 0; c < n; ++c) pattern.column_start[c + 1] += pattern.column_start[c];
  pattern.row.resize(pattern.column_start[n]);
  std::vector<int64_t> next(pattern.column_start.begin(), pattern.column_start.end() - 1);
  for_each_block([&](int32_t r, int32_t c) { pattern.row[next[c]++] = r; });
  pattern.value_start.push_back(0);
  for (int32_t c = 0; c < n; ++c)
    for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k)
      pattern.value_start.push_back(pattern.value_start.back() + static_cast<int64_t>(dof[pattern.row[k]]) * dof[c]);

  values.assign(pattern.size(), 0.0);
  std::copy(pattern.column_start.begin(), pattern.column_start.end() - 1, next.begin());
  std::vector<int32_t> reached(n, -1);  // the last row of which next[c] is the block
  for (int32_t r = 0; r < n; ++r) {
    const int64_t first = pattern.scalar_start[r], end = pattern.scalar_start[r + 1];
    for (int64_t i = first; i < end; ++i)
      for (int64_t e = rows.start[i]; e < rows.start[i + 1]; ++e) {
        const int32_t c = owner[rows.column[e]];
        if (c > r) continue;
        while (reached[c] < r) reached[c] = pattern.row[next[c]] < r ? pattern.row[++next[c]] : r;
        values[pattern.value_start[next[c]] + (i - first) + (rows.column[e] - pattern.scalar_start[c]) * dof[r]] += rows.value[e];
      }
  }
  return pattern;
}

void rows_of(const BlockPattern& pattern, const double* values, int64_t* start, int32_t* column, double* value) {
  const auto for_each_block = [&](const auto& visit) {
    for (int32_t c = 0; c < pattern.variables(); ++c)
      for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k)
        visit(pattern.row[k], c, values + pattern.value_start[k]);
  };
  std::fill_n(start, pattern.scalars() + 1, 0);
  for_each_block([&](int32_t r, int32_t c, const double*) {
    for (int32_t i = 0; i < pattern.dof[r]; ++i) start[pattern.scalar_start[r] + i + 1] += pattern.dof[c];
    for (int32_t j = 0; j < pattern.dof[c] && r != c; ++j) start[pattern.scalar_start[c] + j + 1] += pattern.dof[r];
  });
  for (int64_t i = 0; i < pattern.scalars(); ++i) start[i + 1] += start[i];
  // A row gets its blocks left of the diagonal from the columns before it, then the others from its own column.
  std::vector<int64_t> next(start, start + pattern.scalars());
  const auto put = [&](int64_t row, int64_t where, double number) {
    column[next[row]] = static_cast<int32_t>(where);
    value[next[row]++] = number;
  };
  for_each_block([&](int32_t r, int32_t c, const double* block) {
    const int64_t at_r = pattern.scalar_start[r], at_c = pattern.scalar_start[c];
    const int32_t height = pattern.dof[r], width = pattern.dof[c];
    for (int32_t j = 0; j < width; ++j)
      for (int32_t i = 0; i < height; ++i) put(at_r + i, at_c + j, block[height * j + i]);
    for (int32_t j = 0; j < width && r != c; ++j)
      for (int32_t i = 0; i < height; ++i) put(at_c + j, at_r + i, block[height * j + i]);
  });
}

}  // namespace teamslam
