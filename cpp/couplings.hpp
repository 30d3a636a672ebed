// From the pairs of variables that measurements couple to the block pattern of H.
#pragma once

#include <cstdint>
#include <vector>

#include "block_matrix.hpp"
#include "variables.hpp"

namespace teamslam {

// Every use of an off-diagonal block is a slot. The same pair may come up any number of times, in either order.
class Couplings {
 public:
  // The slot of the pair of free indices, or held if either is.
  int64_t add(int32_t a, int32_t b) {
    if (a == held || b == held) return held;
    row_.push_back(a > b ? a : b);
    column_.push_back(a > b ? b : a);
    return static_cast<int64_t>(row_.size()) - 1;
  }
  void reserve(int64_t more) { row_.reserve(row_.size() + more), column_.reserve(column_.size() + more); }

  // The pattern with all diagonal blocks and one block for every pair, and the block of every slot.
  BlockPattern pattern(std::vector<int32_t> dof, std::vector<int64_t>& block_of_slot) const;

 private:
  std::vector<int32_t> row_, column_;
};

// The stable order that sorts keys (each in 0 .. buckets - 1), taken in the order `first` (empty: as they come).
std::vector<int64_t> counting_order(const std::vector<int32_t>& keys, int64_t buckets,
                                    const std::vector<int64_t>& first = {});

}  // namespace teamslam
