#include "sparse_rows.hpp"

#include <algorithm>
#include <utility>

#include "checks.hpp"
#include "threads.hpp"

namespace teamslam {

namespace {

void check(const SparseRows& rows, int64_t scalars) {
  if (rows.start[0] != 0) refuse("sparse matrix: its first row does not start at 0");
  for (int64_t i = 0; i < scalars; ++i)
    if (rows.start[i + 1] < rows.start[i]) refuse("sparse matrix: row ", i, " ends before it starts");
  for (int64_t i = 0; i < scalars; ++i) {
    const int64_t first = rows.start[i], end = rows.start[i + 1];
    if (end == first) continue;
    int32_t falls = 0;
    for (int64_t e = first + 1; e < end; ++e) falls |= rows.column[e] <= rows.column[e - 1];
    if (falls) refuse("sparse matrix: the columns of row ", i, " do not rise");
    if (rows.column[first] < 0 || rows.column[end - 1] >= scalars)
      refuse("sparse matrix: row ", i, " has columns ", rows.column[first], " to ", rows.column[end - 1],
             ", but there are ", scalars);
  }
}

// Block columns of the lower triangle that each block row holds, the diagonal last: column[start[r]] ..
// column[start[r + 1]].
struct BlockRows {
  std::vector<int64_t> start;
  std::vector<int32_t> column;
};

BlockRows block_rows_of(const SparseRows& rows, const BlockPattern& pattern, const std::vector<int32_t>& owner) {
  const int32_t n = pattern.variables();
  BlockRows found{{0}, {}};
  std::vector<int32_t> seen(n, -1);
  for (int32_t r = 0; r < n; ++r) {
    for (int64_t i = pattern.scalar_start[r]; i < pattern.scalar_start[r + 1]; ++i)
      for (int64_t e = rows.start[i]; e < rows.start[i + 1] && rows.column[e] < pattern.scalar_start[r]; ++e) {
        const int32_t c = owner[rows.column[e]];
        if (seen[c] == r) continue;
        seen[c] = r;
        found.column.push_back(c);
      }
    found.column.push_back(r);
    found.start.push_back(static_cast<int64_t>(found.column.size()));
  }
  return found;
}

// Turns blocks listed by rows into columns, and says where the values of each lie.
void place_by_columns(const BlockRows& blocks, BlockPattern& pattern) {
  const int32_t n = pattern.variables();
  pattern.column_start.assign(n + 1, 0);
  for (int32_t c : blocks.column) ++pattern.column_start[c + 1];
  for (int32_t c = 0; c < n; ++c) pattern.column_start[c + 1] += pattern.column_start[c];
  pattern.row.resize(blocks.column.size());
  std::vector<int64_t> next(pattern.column_start.begin(), pattern.column_start.end() - 1);
  for (int32_t r = 0; r < n; ++r)
    for (int64_t k = blocks.start[r]; k < blocks.start[r + 1]; ++k) pattern.row[next[blocks.column[k]]++] = r;
  pattern.value_start.reserve(pattern.row.size() + 1);
  pattern.value_start.assign(1, 0);
  for (int32_t c = 0; c < n; ++c)
    for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k)
      pattern.value_start.push_back(pattern.value_start.back() +
                                    static_cast<int64_t>(pattern.dof[pattern.row[k]]) * pattern.dof[c]);
}

}  // namespace

BlockPattern blocks_of(const SparseRows& rows, std::vector<int32_t> dof, std::vector<double>& values) {
  BlockPattern pattern;
  pattern.dof = std::move(dof);
  const int32_t n = pattern.variables();
  std::vector<int32_t> owner;  // of each scalar
  pattern.scalar_start.push_back(0);
  for (int32_t v = 0; v < n; ++v) {
    owner.insert(owner.end(), pattern.dof[v], v);
    pattern.scalar_start.push_back(pattern.scalar_start.back() + pattern.dof[v]);
  }
  check(rows, pattern.scalars());
  const BlockRows blocks = block_rows_of(rows, pattern, owner);
  place_by_columns(blocks, pattern);

  values.assign(pattern.size(), 0.0);
  std::vector<int64_t> next(pattern.column_start.begin(), pattern.column_start.end() - 1);
  std::vector<double*> target(pattern.scalars());  // where the entries of this block row and a scalar column begin
  for (int32_t r = 0; r < n; ++r) {
    const int32_t height = pattern.dof[r];
    for (int64_t k = blocks.start[r]; k < blocks.start[r + 1]; ++k) {
      const int32_t c = blocks.column[k];
      double* block = values.data() + pattern.value_start[next[c]++];
      for (int32_t j = 0; j < pattern.dof[c]; ++j) target[pattern.scalar_start[c] + j] = block + height * j;
    }
    const int64_t first = pattern.scalar_start[r], end = pattern.scalar_start[r + 1];
    for (int64_t i = first; i < end; ++i)
      for (int64_t e = rows.start[i]; e < rows.start[i + 1] && rows.column[e] < end; ++e)
        target[rows.column[e]][i - first] = rows.value[e];
  }
  return pattern;
}

namespace {

// The blocks left of the diagonal by block rows, in the order of their columns: the lower triangle, transposed.
struct LeftBlocks {
  std::vector<int64_t> start, block;
  std::vector<int32_t> column;
};

LeftBlocks left_blocks_of(const BlockPattern& pattern) {
  const int32_t n = pattern.variables();
  LeftBlocks left{std::vector<int64_t>(n + 1, 0), std::vector<int64_t>(pattern.blocks() - n),
                  std::vector<int32_t>(pattern.blocks() - n)};
  for (int32_t r : pattern.row) ++left.start[r + 1];
  for (int32_t r = 0; r < n; ++r) left.start[r + 1] += left.start[r] - 1;  // without the diagonal block
  std::vector<int64_t> next(left.start.begin(), left.start.end() - 1);
  for (int32_t c = 0; c < n; ++c)
    for (int64_t k = pattern.column_start[c] + 1; k < pattern.column_start[c + 1]; ++k) {
      const int64_t place = next[pattern.row[k]]++;
      left.block[place] = k, left.column[place] = c;
    }
  return left;
}

void start_rows(const BlockPattern& pattern, const LeftBlocks& left, int64_t* start) {
  start[0] = 0;
  for (int32_t r = 0; r < pattern.variables(); ++r) {
    int64_t length = 0;
    for (int64_t k = left.start[r]; k < left.start[r + 1]; ++k) length += pattern.dof[left.column[k]];
    for (int64_t k = pattern.column_start[r]; k < pattern.column_start[r + 1]; ++k)
      length += pattern.dof[pattern.row[k]];
    for (int64_t i = pattern.scalar_start[r]; i < pattern.scalar_start[r + 1]; ++i) start[i + 1] = start[i] + length;
  }
}

}  // namespace

void rows_of(const BlockPattern& pattern, const double* values, int threads, int64_t* start, int32_t* column,
             double* value) {
  const LeftBlocks left = left_blocks_of(pattern);
  start_rows(pattern, left, start);
  // Row i of variable r: `width` numbers from `first` on, `stride` apart, are those of variable c.
  const auto write_row = [&](int32_t r, int32_t i) {
    int64_t next = start[pattern.scalar_start[r] + i];
    const auto append = [&](int32_t c, const double* first, int32_t stride) {
      for (int32_t j = 0; j < pattern.dof[c]; ++j, ++next) {
        column[next] = static_cast<int32_t>(pattern.scalar_start[c] + j);
        value[next] = first[stride * j];
      }
    };
    const int32_t height = pattern.dof[r];
    for (int64_t k = left.start[r]; k < left.start[r + 1]; ++k)
      append(left.column[k], values + pattern.value_start[left.block[k]] + i, height);
    const int64_t diagonal = pattern.column_start[r];
    append(r, values + pattern.value_start[diagonal] + i, height);
    for (int64_t k = diagonal + 1; k < pattern.column_start[r + 1]; ++k)
      append(pattern.row[k], values + pattern.value_start[k] + pattern.dof[pattern.row[k]] * i, 1);
  };
  constexpr int64_t share = 128;  // variables
  share_out((pattern.variables() + share - 1) / share, threads, [&](int64_t part) {
    const int64_t end = std::min<int64_t>(pattern.variables(), share * (part + 1));
    for (int64_t r = share * part; r < end; ++r)
      for (int32_t i = 0; i < pattern.dof[r]; ++i) write_row(static_cast<int32_t>(r), i);
  });
}

}  // namespace teamslam
