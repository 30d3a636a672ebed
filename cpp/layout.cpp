#include "layout.hpp"

namespace teamslam {

namespace {
constexpr int64_t no_copy = -1;
constexpr int64_t largest_block = 36;  // pose by pose in space
}  // namespace

Layout::Layout(const BlockPattern& pattern, const std::vector<int64_t>& block_of_slot)
    : pattern_(pattern),
      block_of_slot_(block_of_slot),
      owner_(pattern.blocks(), nobody),
      block_copy_(pattern.blocks(), no_copy),
      gradient_copy_(pattern.variables(), no_copy),
      size_(pattern.size() + pattern.scalars()) {}

void Layout::claim(int32_t chunk) { chunk_ = chunk; }

void Layout::place(int32_t chunk) {
  chunk_ = chunk;
  placing_ = true;
  for (int64_t block : copied_blocks_) block_copy_[block] = no_copy;
  for (int32_t variable : copied_gradients_) gradient_copy_[variable] = no_copy;
  copied_blocks_.clear();
  copied_gradients_.clear();
  sink_ = size_;
  size_ += largest_block;
}

int64_t Layout::spill(int64_t target, int64_t length) {
  spills_.push_back({target, size_, length});
  size_ += length;
  return spills_.back().source;
}

int64_t Layout::block_copy(int64_t block) {
  if (block_copy_[block] == no_copy) {
    const int64_t start = pattern_.value_start[block];
    block_copy_[block] = spill(start, pattern_.value_start[block + 1] - start);
    copied_blocks_.push_back(block);
  }
  return block_copy_[block];
}

int64_t Layout::gradient_copy(int32_t free) {
  if (gradient_copy_[free] == no_copy) {
    gradient_copy_[free] = spill(pattern_.size() + pattern_.scalar_start[free], pattern_.dof[free]);
    copied_gradients_.push_back(free);
  }
  return gradient_copy_[free];
}

}  // namespace teamslam
