#include "couplings.hpp"

#include <cstddef>
#include <utility>

namespace teamslam {

std::vector<int64_t> counting_order(const std::vector<int32_t>& keys, int64_t buckets,
                                    const std::vector<int64_t>& first) {
  std::vector<int64_t> next(buckets + 1, 0), order(keys.size());
  for (int32_t key : keys) ++next[key + 1];
  for (int64_t b = 0; b < buckets; ++b) next[b + 1] += next[b];
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const int64_t item = first.empty() ? static_cast<int64_t>(i) : first[i];
    order[next[keys[item]]++] = item;
  }
  return order;
}

BlockPattern Couplings::pattern(std::vector<int32_t> dof, std::vector<int64_t>& block_of_slot) const {
  const int64_t n = static_cast<int64_t>(dof.size()), slots = static_cast<int64_t>(row_.size());
  BlockPattern pattern;
  pattern.dof = std::move(dof);
  pattern.scalar_start.assign(n + 1, 0);
  for (int64_t v = 0; v < n; ++v) pattern.scalar_start[v + 1] = pattern.scalar_start[v] + pattern.dof[v];

  // Two stable passes sort the slots by column, then by row within a column; equal pairs lie side by side.
  const std::vector<int64_t> order = counting_order(column_, n, counting_order(row_, n));
  block_of_slot.assign(slots, 0);
  pattern.column_start.reserve(n + 1);
  pattern.row.reserve(n + slots);
  pattern.value_start.reserve(n + slots + 1);
  int64_t values = 0;
  const auto append = [&](int64_t row, int64_t column) {
    pattern.row.push_back(static_cast<int32_t>(row));
    pattern.value_start.push_back(values);
    values += static_cast<int64_t>(pattern.dof[row]) * pattern.dof[column];
  };
  int64_t next = 0;
  for (int64_t column = 0; column < n; ++column) {
    pattern.column_start.push_back(pattern.blocks());
    append(column, column);
    for (; next < slots && column_[order[next]] == column; ++next) {
      if (pattern.row.back() != row_[order[next]]) append(row_[order[next]], column);
      block_of_slot[order[next]] = pattern.blocks() - 1;
    }
  }
  pattern.column_start.push_back(pattern.blocks());
  pattern.value_start.push_back(values);
  pattern.row.shrink_to_fit();
  pattern.value_start.shrink_to_fit();
  return pattern;
}

}  // namespace teamslam
